"""Cameras and parameters in the formats of other programs, by format name or recognised."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from stereocal.errors import StereocalError, disk_errors
from stereocal.formats.exchange.aniposelib import (
    aniposelib_names,
    read_aniposelib,
    write_aniposelib,
    write_caliscope,
)
from stereocal.formats.exchange.camera_files import (
    is_camera,
    is_parameters,
    read_cameras,
    read_parameters,
)
from stereocal.formats.exchange.colmap import read_colmap, write_colmap
from stereocal.formats.exchange.dlt import read_dlt, write_dlt
from stereocal.formats.exchange.kalibr import kalibr_names, read_kalibr, write_kalibr
from stereocal.formats.exchange.lens_fit import fewer_coefficients
from stereocal.formats.exchange.matlab import is_matlab_file, read_matlab, write_matlab
from stereocal.formats.exchange.opencv_stereo import is_opencv, read_opencv, write_opencv
from stereocal.formats.exchange.options import OUR_UNIT, ExchangeOptions, Posed, posed
from stereocal.formats.exchange.reading import LARGEST_BYTES, CameraPair, Files, ForeignFile
from stereocal.formats.exchange.ros import is_ros, read_ros, write_ros
from stereocal.formats.other_files import is_matlab, refuse_other_camera
from stereocal.formats.units import Unit
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import Rig
from stereocal.system.atomic_files import write_all
from stereocal.system.numbers import rounded


@dataclass(frozen=True)
class CameraFormat:
    """How the camera files of a program are read."""

    title: str
    read: Callable[[Files, ExchangeOptions, str], CameraPair]
    recognises: Callable[[ForeignFile], bool] | None = None
    """Whether a file is of this format; None: files are not recognised, but read by its name."""
    names: Callable[[ForeignFile], tuple[str, ...]] | None = None
    """Names of the cameras, if a file can have any number of them."""
    one_camera: bool = False
    """Whether each file has one camera."""
    unit: Unit | None = None
    """Unit of all its files, by its documentation."""


@dataclass(frozen=True, kw_only=True)
class ExchangeFormat(CameraFormat):
    """A format that is written too."""

    write: Callable[[Sequence[Posed], ExchangeOptions], dict[str, bytes]]
    of_rigs: bool = False
    """Whether any number of cameras can be written; else two, which have the names of `posed`."""
    ignores_skew: bool = False
    without_lens: bool = False
    coefficients: int | None = None
    """Number of distortion coefficients, if fewer than in OpenCV's model."""


FORMATS: Mapping[str, ExchangeFormat] = {
    "opencv": ExchangeFormat(
        "OpenCV (intrinsics.yml, extrinsics.yml)",
        read_opencv,
        is_opencv,
        write=write_opencv,
        ignores_skew=True,
    ),
    "kalibr": ExchangeFormat(
        "Kalibr (camchain.yaml)",
        read_kalibr,
        lambda file: bool(kalibr_names(file)),
        kalibr_names,
        unit="m",
        write=write_kalibr,
        of_rigs=True,
        coefficients=4,
    ),
    "ros": ExchangeFormat(
        "ROS (two camera_info files)",
        read_ros,
        is_ros,
        one_camera=True,
        unit="m",
        write=write_ros,
        ignores_skew=True,
    ),
    "matlab": ExchangeFormat(
        "MATLAB (stereoParameters)", read_matlab, is_matlab_file, write=write_matlab, coefficients=5
    ),
    "aniposelib": ExchangeFormat(
        "aniposelib (calibration.toml)",
        read_aniposelib,
        lambda file: file.ends_with(".toml"),
        aniposelib_names,
        write=write_aniposelib,
        of_rigs=True,
        ignores_skew=True,
        coefficients=5,
    ),
    "caliscope": ExchangeFormat(
        "Caliscope (camera_array.toml)",
        read_aniposelib,
        None,
        aniposelib_names,
        write=write_caliscope,
        of_rigs=True,
        ignores_skew=True,
        coefficients=5,
    ),
    "colmap": ExchangeFormat("COLMAP (rig)", read_colmap, write=write_colmap),
    "dlt": ExchangeFormat(
        "DLT coefficients (DLTdv, easyWand, Argus)",
        read_dlt,
        write=write_dlt,
        of_rigs=True,
        without_lens=True,
    ),
}
READ: Mapping[str, CameraFormat] = {
    **FORMATS,
    "camera": CameraFormat("camera files", read_cameras, is_camera, one_camera=True),
    "stereocal": CameraFormat("stereocal", read_parameters, is_parameters),
}


def format_of(name: str, content: bytes) -> str | None:
    """The name in `READ` of a camera file's format, by its content; None if it is none."""
    file = ForeignFile(name, content)
    found = (key for key, each in READ.items() if each.recognises and each.recognises(file))
    return next(found, None)


def has_both_cameras(name: str, content: bytes) -> bool:
    """Whether a single file has both cameras; errors as `format_of`."""
    found = format_of(name, content)
    return found is not None and not READ[found].one_camera


def camera_names(name: str, content: bytes) -> tuple[str, ...]:
    """Names of the cameras in a file with any number of them; empty for other formats."""
    found = format_of(name, content)
    names = None if found is None else READ[found].names
    return () if names is None else names(ForeignFile(name, content))


def read_camera_pair(files: Mapping[str, bytes], options: ExchangeOptions) -> CameraPair:
    """Two cameras from the files of one program, which is recognised.

    A single file with one camera serves for both: a nominal lens.
    """
    found = {name: format_of(name, content) for name, content in files.items()}
    key = next(iter(found.values()))
    if key is None or len(set(found.values())) > 1:
        named = ", ".join(f"{name} ({each or 'unknown'})" for name, each in found.items())
        raise StereocalError(
            f"These camera files are not of one program: {named}. Give both cameras in one format."
        )
    return _read(files, READ[key], options, ", ".join(files))


def _read(
    files: Mapping[str, bytes], known: CameraFormat, options: ExchangeOptions, source: str
) -> CameraPair:
    pair = known.read([ForeignFile(*each) for each in files.items()], options, source)
    ours = any(OUR_UNIT.encode() in content for content in files.values())
    stated: Unit | None = "m" if ours else pair.stated
    return replace(pair, program=pair.program or known.title, stated=stated, usual=known.unit)


def export_files(rig: Rig, name: str, options: ExchangeOptions | None = None) -> dict[str, bytes]:
    """The files of a format by name."""
    return _format(name).write(posed(rig), options or ExchangeOptions())


def export_rig(
    cameras: Sequence[Posed], name: str, path: str | Path, options: ExchangeOptions | None = None
) -> list[Path]:
    """As `export`, of any number of cameras.

    Args:
        cameras: the first is the reference.
    """
    known = _format(name)
    if not known.of_rigs:
        others = ", ".join(key for key, each in FORMATS.items() if each.of_rigs)
        raise StereocalError(
            f"The format {name} is written for two cameras; for a rig there are {others}."
        )
    return _placed(known.write(cameras, options or ExchangeOptions()), path)


def export(
    rig: Rig, name: str, path: str | Path, options: ExchangeOptions | None = None
) -> list[Path]:
    """Write the files of a format into the folder `path`.

    A single file is written as `path` itself if that has an ending, as `dlt.csv`.

    Returns:
        The written files.
    """
    return _placed(export_files(rig, name, options), path)


def _placed(files: Mapping[str, bytes], path: str | Path) -> list[Path]:
    """Write files into a folder; a single one as `path` itself if that has an ending."""
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
    for which, camera, _ in posed(rig):
        count = known.coefficients
        if count is not None and not camera.is_fisheye and camera.distortion[count:].any():
            notes.append(
                f"The format has {count} distortion coefficients: those of the {which} camera were "
                f"refitted, which moves pixels by {rounded(fewer_coefficients(camera, count)[1])} "
                "px at most."
            )
    return notes


def import_files(
    files: Mapping[str, bytes],
    name: str,
    options: ExchangeOptions | None = None,
    source: str = "parameters",
) -> RigParameters:
    """Parameters from the files of a format by name; the method is `imported`."""
    if not files:
        raise StereocalError(f"{source}: there are no files.")
    known, options = _format(name), options or ExchangeOptions()
    if len(files) == 1:
        ((only, content),) = files.items()
        if known.read is not read_matlab or not is_matlab(content):
            refuse_other_camera(content, only, may_be_toml=known.read is read_aniposelib)
    rig = _read(files, known, options, source).rig(options, source)
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


def import_parameters(
    path: str | Path, name: str, options: ExchangeOptions | None = None
) -> RigParameters:
    """Parameters from a file or a folder of a format."""
    path = Path(path)
    with disk_errors(f"{path} cannot be read"):
        path.stat()
        found = sorted(path.iterdir()) if path.is_dir() else [path]
        files = {
            each.name: each.read_bytes()
            for each in found
            if each.is_file() and each.stat().st_size <= LARGEST_BYTES
        }
    return import_files(files, name, options, str(path))


def _format(name: str) -> ExchangeFormat:
    if name not in FORMATS:
        raise StereocalError(f'The format "{name}" is not known; use one of {", ".join(FORMATS)}.')
    return FORMATS[name]
