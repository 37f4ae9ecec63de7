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
    from stereocal.formats.camera_file import read_camera as read_camera
    from stereocal.formats.dataset_files import read_dataset as read_dataset
    from stereocal.formats.exchange.exchange import export as export
    from stereocal.formats.exchange.exchange import import_parameters as import_parameters
    from stereocal.matching.measure_tables import reconstruct as reconstruct
    from stereocal.matching.pairs import match as match
    from stereocal.rig.camera import Camera as Camera
    from stereocal.rig.correspondences import Correspondences as Correspondences
    from stereocal.rig.dataset import Dataset as Dataset
    from stereocal.rig.geometry import Pose as Pose
    from stereocal.rig.parameters import RigParameters as RigParameters
    from stereocal.workflow import calibrate as calibrate

_MODULES = {
    "CalibrationSettings": "calibration.methods",
    "Camera": "rig.camera",
    "Correspondences": "rig.dataset",
    "Dataset": "rig.dataset",
    "Pose": "rig.geometry",
    "RigParameters": "rig.parameters",
    "StereocalError": "errors",
    "calibrate": "workflow",
    "export": "formats.exchange.exchange",
    "import_parameters": "formats.exchange.exchange",
    "match": "matching.pairs",
    "read_camera": "formats.camera_file",
    "read_dataset": "formats.dataset_files",
    "reconstruct": "matching.measure_tables",
}
__all__ = [*_MODULES]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'stereocal' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"stereocal.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


use_writable_cache()  # before anything is compiled
