"""What is kept of compiled code on disk, and what Python sees of it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numba import types

from stereocal.rig.compiled import _ON_DISK, _readable_index, compiled, contiguous, internal

ROOT = Path(__file__).parents[2]
ASK = """
import numpy as np
from stereocal.calibration import costs
rays = np.array([[0.0], [0.0], [-0.5], [0.0]])
R, T, scale = np.eye(3), np.array([-1.0, 0.0, 0.0]), np.ones((2, 3))
print(costs.cost(costs.POINTS, R, T, rays, np.zeros((3, 1)), scale))
"""


def test_code_on_disk_is_not_used_when_what_it_calls_has_changed(tmp_path: Path) -> None:
    """The cost stands in costs.py and holds a copy of the midpoint, which stands in geometry.py."""
    shutil.copytree(ROOT / "stereocal", tmp_path / "stereocal")

    def cost() -> float:
        run = subprocess.run(
            [sys.executable, "-c", ASK],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")},
        )
        return float(run.stdout)

    assert cost() == 2.0
    changed = tmp_path / "stereocal" / "rig" / "geometry.py"
    depth = "    z1 *= keep\n"
    text = changed.read_text()
    assert text.count(depth) == 1
    changed.write_text(text.replace(depth, "    z1 *= 3.0 * keep\n"))
    assert cost() == 6.0


def test_python_runs_an_internal_function_as_it_is_written() -> None:
    assert internal(lambda value: value + 1)(2) == 3


def test_plain_copies_only_what_is_not_plain() -> None:
    writable = np.zeros((2, 3))
    assert contiguous(writable) is writable
    assert contiguous(writable.T).flags.carray
    writable.setflags(write=False)
    assert contiguous(writable).flags.carray


@compiled
def _power(base: float, exponent: int) -> float:
    return float(base**exponent)


def test_a_constant_in_compiled_code_compiles_nothing_again() -> None:
    dispatcher: Any = _power
    constant: Any = types.IntegerLiteral
    for exponent in (constant(3), constant(4), types.int64):
        dispatcher.get_call_template((types.float64, exponent), {})
    assert len(dispatcher.overloads) == 1


def test_what_others_compile_is_not_compiled_ahead() -> None:
    """Else all would be compiled again wherever something else has such a function."""
    other: Any = _power
    assert other._cache._cache_file not in _ON_DISK


def test_code_on_disk_that_names_a_lost_class_is_not_used() -> None:
    def load() -> dict[object, str]:
        raise AttributeError("Can't get attribute 'Moved'")

    assert _readable_index(load) == {}
