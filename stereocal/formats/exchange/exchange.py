"""Export and import parameters in the formats of other programs, by format name."""

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
from stereocal.system.numbers import rounded

Files = Mapping[str, bytes]


@dataclass(frozen=True)
class ExchangeFormat:
    """One format: its title and functions."""

    title: str
    write: Callable[[Rig, ExchangeOptions], dict[str, bytes]]
    read: Callable[[Files, ExchangeOptions, str], ReadRig]
    """Returns the rig, and the unit of its lengths if the file states it."""
    ignores_skew: bool = False
    without_lens: bool = False
    unit: Unit | None = None
    """Unit of all its files, by its documentation."""
    coefficients: int | None = None
    """Number of distortion coefficients, if fewer than in OpenCV's model."""


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
        StereocalError: an unknown format, or one that cannot represent this rig.
    """
    return _format(name).write(rig, options or ExchangeOptions())


def export(
    rig: Rig, name: str, path: str | Path, options: ExchangeOptions | None = None
) -> list[Path]:
    """Write the files of a format into the folder `path`.

    A single file is written as `path` itself if that has an ending, as `dlt.csv`.

    Returns:
        The written files.

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
    """Sentences on what the format does not represent."""
    known = _format(name)
    notes = []
    if known.ignores_skew and any(c.K[0, 1] != 0 for c in (rig.primary, rig.secondary)):
        notes.append(
            "A camera has a skew. It is in the camera matrix, but the other program's functions do "
            "not use it."
        )
    if known.without_lens and any(c.distortion.any() for c in (rig.primary, rig.secondary)):
        notes.append("The file does not contain the lenses: undistort points before using it.")
    for which, camera in (("primary", rig.primary), ("secondary", rig.secondary)):
        count = known.coefficients
        if count is not None and camera.distortion[count:].any():
            notes.append(
                f"The format has {count} distortion coefficients: those of the {which} camera were "
                "refitted, which moves pixels by "
                f"{rounded(fewer_coefficients(camera, count)[1])} px at "
                "most."
            )
    return notes


def import_files(
    files: Files, name: str, options: ExchangeOptions | None = None, source: str = "parameters"
) -> RigParameters:
    """Parameters from the files of a format by name; the method is `imported`.

    Raises:
        StereocalError: an unknown format, or files of another format or damaged.
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
        rig.primary,
        rig.secondary,
        rig.pose,
        method="imported",
        cost=None,
        settings={},
        inputs={"format": name, "sha256": digest},
    )


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
    """Parameters from a file or a folder of a format.

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
        raise StereocalError(f'The format "{name}" is not known; use one of {", ".join(FORMATS)}.')
    return FORMATS[name]
