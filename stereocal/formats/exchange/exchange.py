"""Cameras and parameters in the formats of other programs, by format name or recognised."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path, PurePath
from typing import Any, TypeVar

from stereocal.errors import StereocalError, disk_errors
from stereocal.formats.camera_file import refuse_window
from stereocal.formats.described import PROGRAMS
from stereocal.formats.exchange.camera_format import (
    OUR_UNIT,
    STORAGES,
    CameraFormat,
    ExchangeFormat,
    Files,
    ForeignPair,
    Posed,
    fewer_coefficients,
    lenses_of,
)
from stereocal.formats.exchange.dlt import DLT
from stereocal.formats.exchange.matlab import MATLAB
from stereocal.formats.exchange.options import Contents, ExchangeOptions, Unit
from stereocal.formats.exchange.other_programs import DESCRIBED
from stereocal.formats.exchange.ros import ROS, is_ros
from stereocal.formats.exchange.text_formats import ANIPOSELIB, ARGUS, CALISCOPE, COLMAP
from stereocal.formats.exchange.yaml_formats import KALIBR, OPENCV
from stereocal.formats.file_storage import LARGEST_BYTES, ForeignFile
from stereocal.formats.lens_nodes import has_matrix, has_one_lens, what_is_in
from stereocal.formats.other_files import is_matlab, refuse_other_camera
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import PlacedCameras, Rig
from stereocal.system.arguments import checked
from stereocal.system.atomic_files import write_all
from stereocal.system.numbers import rounded
from stereocal.system.zip_files import is_npz

FORMATS: Mapping[str, ExchangeFormat] = {
    "opencv": OPENCV,
    "kalibr": KALIBR,
    "ros": ROS,
    "matlab": MATLAB,
    "aniposelib": ANIPOSELIB,
    "caliscope": CALISCOPE,
    "colmap": COLMAP,
    "dlt": DLT,
}


READABLE: Mapping[str, CameraFormat] = {
    **FORMATS,
    **{name: known for name, known in DESCRIBED.items() if PROGRAMS[name].pose is not None},
}
"""Those that may have a pose."""


def our_word(content: bytes) -> str:
    """`camera` of a JSON file of ours with `stereocal-camera/1`; empty for other files."""
    begins = content.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{") and b"stereocal-" in content
    if not begins or len(content) > LARGEST_BYTES:
        return ""
    try:
        stated = str(json.loads(content.decode("utf-8-sig")).get("format", ""))
    except (ValueError, RecursionError):
        return ""
    return stated.removeprefix("stereocal-").split("/")[0] if stated[:10] == "stereocal-" else ""


def _is_camera(file: ForeignFile) -> bool:
    """Whether it is our camera file, or OpenCV's of a single camera."""
    if not (file.ends_with(*STORAGES) or is_npz(file.content)) or is_ros(file):
        return False
    stated = our_word(file.content)
    if stated:
        return stated == "camera"
    return has_matrix(file.storage) or has_one_lens(file.storage)


def _read_cameras(files: Files, options: ExchangeOptions, source: str) -> ForeignPair:
    """The cameras of two files, or a nominal lens for both."""
    if len(files) > 2:
        raise StereocalError(f"{source}: {len(files)} camera files; give one or two.")
    return lenses_of(files, options, f"{source}: files of single cameras have no pose.")


def _read_parameters(files: Files, _: ExchangeOptions, source: str) -> ForeignPair:
    if len(files) > 1:
        raise StereocalError(f"{source}: {len(files)} parameter files; give one.")
    rig = RigParameters.loads(files[0].text, files[0].name)
    return ForeignPair(rig.primary, rig.secondary, rig.pose, program="stereocal", stated="m")


READ: Mapping[str, CameraFormat] = {
    **DESCRIBED,
    **FORMATS,
    "argus": ARGUS,
    "camera": CameraFormat("camera files", _read_cameras, _is_camera, one_camera=True),
    "stereocal": CameraFormat(
        "stereocal",
        _read_parameters,
        lambda file: file.ends_with(".json") and our_word(file.content) == "parameters",
    ),
}


def format_of(name: str, content: bytes) -> str | None:
    """The name in `READ` of a camera file's format, by its content; None if it is none."""
    file = ForeignFile(name, content)
    keys = (key for key, known in READ.items() if known.recognises and known.recognises(file))
    return next(keys, None)


def camera_names(name: str, content: bytes) -> tuple[str, ...]:
    """Names of the cameras in a file with any number of them; empty for other formats."""
    key = format_of(name, content)
    names = None if key is None else READ[key].names
    return () if names is None else names(ForeignFile(name, content))


def what_it_holds(name: str, content: bytes) -> str:
    """What a file of nodes holds that is no known camera file, in brackets; else empty."""
    file = ForeignFile(name, content)
    if not file.ends_with(*STORAGES):
        return ""
    try:
        return f" ({what_is_in(file.storage)})"
    except StereocalError as error:
        return f" ({error.reason or error})"


def holds_pose_alone(name: str, content: bytes) -> bool:
    """Whether a file has R and T of the lenses in another, as OpenCV's `extrinsics.yml`."""
    return format_of(name, content) == "opencv" and not camera_names(name, content)


def names_in_files(files: Contents, name: str) -> tuple[str, ...]:
    """Names of the cameras in the files of a format by name, to choose from; empty if none are."""
    known = _named(READABLE, name)
    if known.one_camera:
        return tuple(PurePath(file).stem for file in files)
    if known.names is None or len(files) != 1:
        return ()
    ((only, content),) = files.items()
    return known.names(ForeignFile(only, content))


def read_camera_pair(files: Contents, options: ExchangeOptions) -> ForeignPair:
    """Two cameras from the files of one program, which is recognised.

    A single file with one camera serves for both: a nominal lens.
    """
    formats = {name: format_of(name, content) for name, content in files.items()}
    if {*formats.values()} == {"ros", "camera"}:  # one without the pair's matrices
        formats = dict.fromkeys(formats, "camera")
    key = next(iter(formats.values()))
    if key is None or len(set(formats.values())) > 1:
        named = ", ".join(f"{name} ({key or 'unknown'})" for name, key in formats.items())
        raise StereocalError(
            f"These camera files are not of one program: {named}. Give both cameras in one format."
        )
    return _read(files, READ[key], options, ", ".join(files))


def _read(
    files: Contents, known: CameraFormat, options: ExchangeOptions, source: str
) -> ForeignPair:
    pair = known.read([ForeignFile(*file) for file in files.items()], options, source)
    ours = any(OUR_UNIT.encode() in content for content in files.values())
    stated: Unit | None = "m" if ours else pair.stated
    return replace(pair, program=pair.program or known.title, stated=stated, usual=known.unit)


def export_files(
    rig: PlacedCameras, name: str, options: ExchangeOptions | None = None
) -> dict[str, bytes]:
    """The files of a format by name.

    Args:
        rig: as for `export`.
    """
    known = _named(FORMATS, name)
    cameras: list[Posed] = [(name, *it) for name, it in rig.placed.items()]
    for which, camera, _ in cameras:
        refuse_window(camera, f"The {which} camera", known.title)
    if len(cameras) != 2 and not known.of_rigs:
        others = ", ".join(key for key, known in FORMATS.items() if known.of_rigs)
        raise StereocalError(
            f"The format {name} is written for two cameras; for a rig there are {others}."
        )
    return known.write(
        [known.as_supported(camera) for camera in cameras], options or ExchangeOptions()
    )


@checked
def export(
    rig: PlacedCameras, name: str, path: str | Path, options: ExchangeOptions | None = None
) -> list[Path]:
    """Write the files of a format into the folder `path`.

    A single file is written as `path` itself if that has an ending, as `dlt.csv`.

    Args:
        rig: a parameter set, or a rig of any number of cameras.

    Returns:
        The written files.
    """
    path, files = Path(path), export_files(rig, name, options)
    alone = len(files) == 1 and path.suffix != "" and not path.is_dir()
    placed = {path if alone else path / file: content for file, content in files.items()}
    write_all(placed)
    return list(placed)


def export_notes(rig: Rig, name: str) -> list[str]:
    """Sentences on what the format does not represent."""
    known, notes = _named(FORMATS, name), []
    if known.skew == "ignored" and any(c.K[0, 1] != 0 for c in (rig.primary, rig.secondary)):
        notes.append(
            "A camera has a skew. It is in the camera matrix, but the other program's functions do "
            "not use it."
        )
    if known.without_lens and any(c.distortion.any() for c in (rig.primary, rig.secondary)):
        notes.append("The file does not contain the lenses: undistort points before using it.")
    for which, (camera, _) in rig.placed.items():
        count = known.coefficients
        if count in (4, 5) and not camera.is_fisheye and camera.distortion[count:].any():
            notes.append(
                f"The format has {count} distortion coefficients: those of the {which} camera were "
                f"refitted, which moves pixels by {rounded(fewer_coefficients(camera, count)[1])} "
                "px at most."
            )
    return notes


def import_files(
    files: Contents, name: str, options: ExchangeOptions | None = None, source: str = "parameters"
) -> RigParameters:
    """Parameters from the files of a format by name; the method is `imported`.

    `inputs["notes"]` has what the user is to know of how they were read.
    """
    if not files:
        raise StereocalError(f"{source}: there are no files.")
    known, options = _named(READABLE, name), replace(options or ExchangeOptions(), in_order=False)
    if len(files) == 1:
        ((only, content),) = files.items()
        if name not in DESCRIBED and (known is not MATLAB or not is_matlab(content)):
            refuse_other_camera(content, only, may_be_toml=known in (ANIPOSELIB, CALISCOPE))
    pair = _read(files, known, options, source)
    rig = pair.rig(options, source)
    digest = hashlib.sha256(b"".join(files[file] for file in sorted(files))).hexdigest()
    inputs: dict[str, Any] = {"format": name, "sha256": digest}
    inputs |= {"notes": [*pair.remarks]} if pair.remarks else {}
    return RigParameters(rig.primary, rig.secondary, rig.pose, "imported", None, {}, inputs)


@checked
def import_parameters(
    path: str | Path, name: str, options: ExchangeOptions | None = None
) -> RigParameters:
    """Parameters from a file or a folder of a format."""
    path = Path(path)
    with disk_errors(f"{path} cannot be read"):
        path.stat()
        paths = sorted(path.iterdir()) if path.is_dir() else [path]
        if name in DESCRIBED and path.is_dir():
            paths += sorted(path.glob("*/*"))  # EuRoC's cam0/sensor.yaml
        files = {
            file.relative_to(path if path.is_dir() else path.parent).as_posix(): file.read_bytes()
            for file in paths
            if file.is_file() and file.stat().st_size <= LARGEST_BYTES
        }
    return import_files(files, name, options, str(path))


F = TypeVar("F", bound=CameraFormat)


def _named(formats: Mapping[str, F], name: str) -> F:
    if name not in formats:
        raise StereocalError(f'The format "{name}" is not known; use one of {", ".join(formats)}.')
    return formats[name]
