"""Files of one camera each, and stereocal's parameter file, as sources of two cameras."""

from __future__ import annotations

from stereocal.errors import StereocalError
from stereocal.formats.camera_file import K_NAMES, read_camera
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.exchange.reading import STORAGES, CameraPair, Files, ForeignFile
from stereocal.formats.exchange.ros import ONE_LENS, PRIMARY_FIRST, SINGLE_FILES, is_ros
from stereocal.formats.file_storage import find_node
from stereocal.rig.parameters import RigParameters


def is_camera(file: ForeignFile) -> bool:
    """Whether it is our camera file, or OpenCV's of a single camera."""
    if not file.ends_with(*STORAGES) or is_ros(file):
        return False
    stated = _our_format(file)
    return stated == "camera" or (not stated and find_node(file.storage, K_NAMES) is not None)


def is_parameters(file: ForeignFile) -> bool:
    """Whether it is our parameter file."""
    return file.ends_with(".json") and _our_format(file) == "parameters"


def _our_format(file: ForeignFile) -> str:
    """`camera` of `stereocal-camera/1`; empty for other programs' files."""
    stated = str(file.storage.get("format", ""))
    return stated.removeprefix("stereocal-").split("/")[0] if stated[:10] == "stereocal-" else ""


def read_cameras(files: Files, options: ExchangeOptions, source: str) -> CameraPair:
    """The cameras of two files, or a nominal lens for both."""
    if len(files) > 2:
        raise StereocalError(f"{source}: {len(files)} camera files; give one or two.")
    cameras = [read_camera(file.content, file.name, options.lens_model) for file in files]
    words = ONE_LENS if len(cameras) == 1 else PRIMARY_FIRST
    no_pose = f"{source}: files of single cameras have no pose."
    return CameraPair(cameras[0], cameras[-1], None, no_pose, SINGLE_FILES, words)


def read_parameters(files: Files, _: ExchangeOptions, source: str) -> CameraPair:
    """The cameras and the pose of our parameter file."""
    if len(files) > 1:
        raise StereocalError(f"{source}: {len(files)} parameter files; give one.")
    rig = RigParameters.loads(files[0].text, files[0].name)
    return CameraPair(rig.primary, rig.secondary, rig.pose, program="stereocal", stated="m")
