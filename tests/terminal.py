"""Commands in processes of their own, as a terminal runs them."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from stereocal.system.array_types import FloatArray
from tests.sample_field import FIELD as FIELD
from tests.sample_field import calibrated_field

ROOT = Path(__file__).parents[1]
LONGEST_S = 600
"""Only so that a test that hangs ends."""


def command(*arguments: str | Path) -> list[str]:
    """The words that start a command."""
    return [sys.executable, "-m", "stereocal", *map(str, arguments)]


@contextmanager
def started(*arguments: str | Path, **environment: str) -> Iterator[subprocess.Popen[bytes]]:
    """A command under way, the leader of a process group; ended at the latest by the test's end."""
    process = subprocess.Popen(
        command(*arguments),
        cwd=ROOT,
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    with process:
        try:
            yield process
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)  # its workers too


def sentences(said: str) -> list[str]:
    """The lines of stderr, but for the one that a command says when it compiles, once."""
    return [line for line in said.splitlines() if not line.startswith("Compiling once")]


def tables(folder: Path) -> dict[str, Path]:
    """Parameters and points of the sample field, to match and to measure, as files."""
    found = calibrated_field()
    rows = found.dataset.correspondences
    files = {name: folder / f"{name}.csv" for name in ("primary", "secondary", "pairs")}
    for name, points in (("primary", rows.primary), ("secondary", rows.secondary)):
        _table(files[name], "frame,u,v", np.column_stack([rows.frame, points]))
    both = np.column_stack([rows.frame, rows.primary, rows.secondary])
    _table(files["pairs"], "frame,u_primary,v_primary,u_secondary,v_secondary", both)
    files["parameters"] = folder / "parameters_2d.json"
    found.parameters("2d").save(files["parameters"])
    return files


def _table(path: Path, header: str, rows: FloatArray) -> None:
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.6g")
