"""What is kept of compiled code on disk, and what Python sees of it."""

import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from stereocal.rig.compiled import _ON_DISK, _folder, _source, compiled, contiguous

ROOT = Path(__file__).parents[2]
ASK = """
import numpy as np
from stereocal.calibration import costs
rays = np.array([[0.0], [0.0], [-0.5], [0.0]])
R, T, scale = np.eye(3), np.array([-1.0, 0.0, 0.0]), np.ones((2, 3))
print(costs.cost(costs.POINTS, R, T, rays, np.zeros((3, 1)), scale))
"""


@pytest.mark.parametrize("writable", [True, False])
def test_code_on_disk_is_not_used_when_what_it_calls_has_changed(
    writable: bool, tmp_path: Path
) -> None:
    """The cost stands in costs.py and holds a copy of the midpoint, which stands in geometry.py."""
    at = tmp_path / "cache"
    if not writable:  # a file in the place of the folder of each state
        at.touch()
    shutil.copytree(ROOT / "stereocal", tmp_path / "stereocal")

    def cost() -> float:
        run = subprocess.run(
            [sys.executable, "-c", ASK],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "NUMBA_CACHE_DIR": str(at)},
        )
        return float(run.stdout)

    assert cost() == 2.0
    changed = tmp_path / "stereocal" / "rig" / "geometry.py"
    depth = "    z1 *= keep\n"
    text = changed.read_text()
    assert text.count(depth) == 1
    changed.write_text(text.replace(depth, "    z1 *= 3.0 * keep\n"))
    assert cost() == 6.0


PUBLIC = """
import sys
import numba
from numba.core.dispatcher import Dispatcher

OPTIONS = {"cache", "nogil", "error_model", "fastmath", "forceinline"}

def refuse(*names):
    if names and sys._getframe(2).f_globals["__name__"] == "stereocal.rig.compiled":
        raise PermissionError(names)

def is_private(name):
    return name.startswith("_") and not name.startswith("__") or name == "get_call_template"

def get(dispatcher, name):
    refuse(*filter(is_private, [name]))
    return object.__getattribute__(dispatcher, name)

def assign(dispatcher, name, value):
    refuse(*filter(is_private, [name]))
    object.__setattr__(dispatcher, name, value)

def njit(*functions, **options):
    refuse(*options.keys() - OPTIONS)
    return plain(*functions, **options)

plain, numba.njit = numba.njit, njit
Dispatcher.__getattribute__, Dispatcher.__setattr__ = get, assign
"""
CALIBRATE = """
from pathlib import Path
from stereocal.calibration.methods import CalibrationSettings
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.formats.dataset_files import read_dataset
from stereocal.library.calibrations import calibrate
dataset = read_dataset(Path("sample_data/nineteen/03"))
found = calibrate(dataset, CalibrationSettings(essential="linear"), refined=RefineSettings())
print({name: (method.pose.R.tolist(), method.pose.T.tolist())
       for name, method in found.methods.items()})
"""


def test_nothing_private_of_numba_is_needed() -> None:
    """Neither a private attribute of its functions, nor an option that its type hints lack."""

    def calibrated(script: str) -> str:
        words = [sys.executable, "-c", script]
        run = subprocess.run(words, capture_output=True, text=True, check=False, cwd=ROOT)
        assert run.returncode == 0, run.stderr
        return run.stdout

    calibrated(CALIBRATE)  # what is compiled here rounds otherwise than what is loaded
    assert calibrated(PUBLIC + CALIBRATE) == calibrated(CALIBRATE)


def test_plain_copies_only_what_is_not_plain() -> None:
    writable = np.zeros((2, 3))
    assert contiguous(writable) is writable
    assert contiguous(writable.T).flags.carray
    writable.setflags(write=False)
    assert contiguous(writable).flags.carray


@compiled
def _power(base: float, exponent: int) -> float:
    return float(base**exponent)


def test_what_others_compile_is_not_compiled_ahead() -> None:
    """Else all would be compiled again wherever something else has such a function."""
    assert "_power" not in {name for _, name in _ON_DISK}


def test_folders_of_earlier_states_of_a_file_go(tmp_path: Path) -> None:
    source = tmp_path / "source.py"
    source.write_text("ONE = 1\n")
    earlier = _folder(source)
    earlier.mkdir(parents=True)
    assert _folder.__wrapped__(source) == earlier
    assert earlier.exists()
    source.write_text("ONE = 2\n")
    _source.cache_clear()
    assert _folder.__wrapped__(source) != earlier
    assert earlier.exists()  # another process may run it
    os.utime(earlier, (0, 0))
    assert _folder.__wrapped__(source) != earlier
    assert not earlier.exists()


def test_files_that_are_cut_off_are_removed(tmp_path: Path) -> None:
    """A power cut leaves them, and numba raises an error where it reads one."""
    source = tmp_path / "source.py"
    source.write_text("ONE = 1\n")
    kept = _folder(source) / "rig"
    kept.mkdir(parents=True)
    whole = pickle.dumps("0.68") + pickle.dumps({"cost": 1})
    contents = {"empty": b"", "zeros": bytes(len(whole)), "cut": whole[:-3], "whole": whole}
    for name, content in contents.items():
        (kept / f"{name}.nbi").write_bytes(content)
    _folder.__wrapped__(source)
    assert [file.name for file in kept.iterdir()] == ["whole.nbi"]
