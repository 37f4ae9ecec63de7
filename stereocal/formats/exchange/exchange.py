"""Parameters in the formats of other programs, out and in, by the name of the format."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from stereocal.errors import StereocalError
from stereocal.formats.exchange.aniposelib import read_aniposelib, write_aniposelib
from stereocal.formats.exchange.colmap import read_colmap, write_colmap
from stereocal.formats.exchange.dlt import read_dlt, write_dlt
from stereocal.formats.exchange.kalibr import read_kalibr, write_kalibr
from stereocal.formats.exchange.lens_fit import fewer_coefficients
from stereocal.formats.exchange.matlab import read_matlab, write_matlab
from stereocal.formats.exchange.opencv_stereo import read_opencv, write_opencv
from stereocal.formats.exchange.options import LARGEST_BYTES, OUR_UNIT, ExchangeOptions, ReadRig
from stereocal.formats.exchange.ros import read_ros, write_ros
from stereocal.formats.lens_model import FourCoefficientsError
from stereocal.formats.other_files import refuse_other_camera
from stereocal.formats.units import Unit, UnitError, metres_per_unit
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import Rig
from stereocal.system.atomic_files import write_all

Files = Mapping[str, bytes]


@dataclass(frozen=True)
class ExchangeFormat:
    """One format: what people call it, and its functions."""

    title: str
    write: Callable[[Rig, ExchangeOptions], dict[str, bytes]]
    read: Callable[[Files, ExchangeOptions, str], ReadRig]
    """The rig, and the unit of its lengths where the file says it."""
    ignores_skew: bool = False
    without_lens: bool = False
    unit: Unit | None = None
    """Of all its files, by its documentation."""
    coefficients: int | None = None
    """How many of the lens it holds, where it is fewer than OpenCV's model has."""


FORMATS: Mapping[str, ExchangeFormat] = {
    "opencv": ExchangeFormat(
        "OpenCV (intrinsics.yml, extrinsics.yml)", write_opencv, read_opencv, ignores_skew=True
    ),
    "kalibr": ExchangeFormat(
        "Kalibr (camchain.yaml)", write_kalibr, read_kalibr, unit="m", coefficients=4
    ),
    "ros": ExchangeFormat(
        "ROS (two camera_info files)", write_ros, read_ros, ignores_skew=True, unit="m"
    ),
    "matlab": ExchangeFormat(
        "MATLAB (stereoParameters)", write_matlab, read_matlab, coefficients=5
    ),
    "aniposelib": ExchangeFormat(
        "aniposelib (calibration.toml)",
        write_aniposelib,
        read_aniposelib,
        ignores_skew=True,
        coefficients=5,
    ),
    "colmap": ExchangeFormat("COLMAP (rig)", write_colmap, read_colmap),
    "dlt": ExchangeFormat(
        "DLT coefficients (DLTdv, easyWand, Argus)", write_dlt, read_dlt, without_lens=True
    ),
}


def export_files(rig: Rig, name: str, options: ExchangeOptions | None = None) -> dict[str, bytes]:
    """The files of a format by name.

    Raises:
        StereocalError: an unknown format, or one that cannot hold this rig.
    """
    return _format(name).write(rig, options or ExchangeOptions())


def export(
    rig: Rig, name: str, path: str | Path, options: ExchangeOptions | None = None
) -> list[Path]:
    """Write a format: into the folder `path`, which is made; a single file as `path` if that has an
    ending, as `dlt.csv`.

    Returns:
        The files that were written.

    Raises:
        StereocalError: as `export_files`, or the disk cannot be written to.
    """
    files = export_files(rig, name, options)
    path = Path(path)
    alone = len(files) == 1 and path.suffix != "" and not path.is_dir()
    placed = {path if alone else path / each: content for each, content in files.items()}
    write_all(placed)
    return list(placed)


def export_notes(rig: Rig, name: str) -> list[str]:
    """What the other program will not know, a sentence each."""
    known = _format(name)
    notes = []
    if known.ignores_skew and any(c.K[0, 1] != 0 for c in (rig.primary, rig.secondary)):
        notes.append(
            "A camera has a skew. It stands in its matrix, but the other program's functions do "
            "not use it."
        )
    if known.without_lens and any(c.distortion.any() for c in (rig.primary, rig.secondary)):
        notes.append(
            "The file does not hold the lenses: undistort the points before they are used with it."
        )
    for which, camera in (("primary", rig.primary), ("secondary", rig.secondary)):
        count = known.coefficients
        if count is not None and camera.distortion[count:].any():
            notes.append(
                f"The file holds {count} coefficients of a lens; those of the {which} camera were "
                f"fitted anew, and differ by {fewer_coefficients(camera, count)[1]:.2g} px at most."
            )
    return notes


def import_files(
    files: Files, name: str, options: ExchangeOptions | None = None, source: str = "parameters"
) -> RigParameters:
    """Parameters of a format, from its files by name; the method is `imported`.

    Raises:
        StereocalError: an unknown format, or files that are not of it or not sound.
    """
    if not files:
        raise StereocalError(f"{source}: there are no files.")
    try:
        rig = _in_metres(files, _format(name), options or ExchangeOptions(), source)
    except (FourCoefficientsError, UnitError):
        raise
    except StereocalError as error:
        text = str(error)
        known = text.startswith(source) or any(text.startswith(each) for each in files)
        raise StereocalError(text if known else f"{source}: {text}") from error
    digest = hashlib.sha256(b"".join(files[each] for each in sorted(files))).hexdigest()
    return RigParameters(
        rig.primary, rig.secondary, rig.pose, method="imported", cost=None, settings={},
        inputs={"format": name, "sha256": digest},
    )  # fmt: skip


def _in_metres(files: Files, known: ExchangeFormat, options: ExchangeOptions, source: str) -> Rig:
    if len(files) == 1:
        ((name, content),) = files.items()
        refuse_other_camera(content, name, may_be_toml=known.read is read_aniposelib)
    rig, unit = known.read(files, options, source)
    ours = any(OUR_UNIT.encode() in content for content in files.values())
    stated: Unit | None = "m" if ours else unit
    scale = metres_per_unit(rig.pose.baseline, stated, options.unit, known.unit, source)
    return replace(rig, pose=Pose(rig.pose.R, scale * rig.pose.T))


def import_parameters(
    path: str | Path, name: str, options: ExchangeOptions | None = None
) -> RigParameters:
    """Parameters of a format, from a file or a folder.

    Raises:
        StereocalError: as `import_files`, or the path cannot be read.
    """
    path = Path(path)
    try:
        path.stat()
        found = sorted(path.iterdir()) if path.is_dir() else [path]
        files = {
            each.name: each.read_bytes()
            for each in found
            if each.is_file() and each.stat().st_size <= LARGEST_BYTES
        }
    except OSError as error:
        raise StereocalError(f"{path} cannot be read: {error.strerror or error}.") from error
    return import_files(files, name, options, str(path))


def _format(name: str) -> ExchangeFormat:
    if name not in FORMATS:
        raise StereocalError(
            f'The format "{name}" is not known; stereocal knows {", ".join(FORMATS)}.'
        )
    return FORMATS[name]
