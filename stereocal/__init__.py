"""Stereo camera calibration from a bar: one parameter set to match points, one to measure.

The names that a script needs are here; docs/library.md shows them at work. Each is imported when it
is first used: all together take half a second, `import stereocal` alone takes 10 ms.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from stereocal.rig.compile_cache import use_writable_cache
from stereocal.version import __version__ as __version__

if TYPE_CHECKING:
    from stereocal.calibration.methods import CalibrationSettings as CalibrationSettings
    from stereocal.errors import StereocalError as StereocalError
    from stereocal.fit.rig_file import RigFile as RigFile
    from stereocal.formats.camera_file import read_camera as read_camera
    from stereocal.formats.dataset_files import read_dataset as read_dataset
    from stereocal.formats.exchange.exchange import export as export
    from stereocal.formats.exchange.exchange import import_parameters as import_parameters
    from stereocal.library.calibrations import calibrate as calibrate
    from stereocal.library.calibrations import calibrate_rig as calibrate_rig
    from stereocal.library.calibrations import evaluate as evaluate
    from stereocal.library.calibrations import read as read
    from stereocal.library.field_day import calibrate_lens as calibrate_lens
    from stereocal.library.field_day import check as check
    from stereocal.library.field_day import plan as plan
    from stereocal.library.field_day import sample as sample
    from stereocal.library.field_day import simulate as simulate
    from stereocal.library.field_day import sync as sync
    from stereocal.library.tables import match as match
    from stereocal.library.tables import reconstruct as reconstruct
    from stereocal.rig.camera import Camera as Camera
    from stereocal.rig.correspondences import Correspondences as Correspondences
    from stereocal.rig.geometry import Pose as Pose
    from stereocal.rig.pair import Pair as Pair
    from stereocal.rig.parameters import RigParameters as RigParameters
    from stereocal.rig.recording import Recording as Recording
    from stereocal.rig.rigid_object import BoardPattern as BoardPattern

_MODULES = {
    "BoardPattern": "rig.rigid_object",
    "CalibrationSettings": "calibration.methods",
    "Camera": "rig.camera",
    "Correspondences": "rig.correspondences",
    "Pair": "rig.pair",
    "Pose": "rig.geometry",
    "Recording": "rig.recording",
    "RigFile": "fit.rig_file",
    "RigParameters": "rig.parameters",
    "StereocalError": "errors",
    "calibrate": "library.calibrations",
    "calibrate_lens": "library.field_day",
    "calibrate_rig": "library.calibrations",
    "check": "library.field_day",
    "detect": "library.targets",
    "evaluate": "library.calibrations",
    "export": "formats.exchange.exchange",
    "import_parameters": "formats.exchange.exchange",
    "match": "library.tables",
    "plan": "library.field_day",
    "read": "library.calibrations",
    "read_camera": "formats.camera_file",
    "read_dataset": "formats.dataset_files",
    "reconstruct": "library.tables",
    "sample": "library.field_day",
    "simulate": "library.field_day",
    "sync": "library.field_day",
}
__all__ = [*_MODULES]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'stereocal' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"stereocal.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)


use_writable_cache()  # before anything is compiled
