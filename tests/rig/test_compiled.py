"""What is kept of compiled code on disk, and what Python sees of it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

from stereocal.rig.compiled import contiguous, internal

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
