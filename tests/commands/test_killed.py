"""A command that is killed leaves no process."""

import os
import random
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from tests.further import further
from tests.soak import repeats
from tests.terminal import FIELD, LONGEST_S, ROOT, started

pytestmark = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="it looks into /proc")
PHOTOGRAPHS = ROOT / "sample_data" / "photographs"
WITHIN_S = 5.0
"""Measured: 0.1 s at most with two cores at work."""
PARENT = """
import sys, time
from pathlib import Path
from stereocal.system.executors import engine
from stereocal.system.guarded import Guard
from tests import deadly

file = Path(sys.argv[1])
with engine(1) as workers:
    workers.submit(abs, 1).result()
    Guard([deadly.hang], children=1).read(deadly.hang, file, "a")
"""
COMMANDS = {
    "evaluate": f"evaluate {FIELD} --workers 2 --runs 100000",
    "detect": f"detect {PHOTOGRAPHS} --workers 2",
    "compile": "compile",
}


def running(group: int) -> list[str]:
    """The processes of a group that have not ended, but for those that nobody waits for."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it has just ended
            state, _, own, *_ = stat.read_text().rpartition(")")[2].split()
            if int(own) == group and state != "Z":
                found.append(stat.with_name("cmdline").read_text().replace("\0", " "))
    return found


def left_after(group: int, seconds: float) -> list[str]:
    """Those of `running` after this time; returns as soon as there are none."""
    end = time.monotonic() + seconds
    while (found := running(group)) and time.monotonic() < end:
        time.sleep(0.02)
    return found


@pytest.mark.parametrize("how", ["SIGTERM", "SIGKILL"])
def test_children_end_with_a_parent_that_is_killed(how: str, tmp_path: Path) -> None:
    """An idle worker, and one that decodes a file."""
    file = tmp_path / "file"
    file.touch()
    words = [sys.executable, "-c", PARENT, str(file)]
    parent = subprocess.Popen(words, cwd=ROOT, start_new_session=True, stderr=subprocess.DEVNULL)
    try:
        begun = file.with_suffix(".begun")
        while not begun.exists():
            assert parent.poll() is None
            time.sleep(0.02)
        assert len(running(parent.pid)) >= 3
        parent.send_signal(signal.Signals[how])
        parent.wait()
        assert left_after(parent.pid, WITHIN_S) == []
    finally:
        with suppress(ProcessLookupError):
            os.killpg(parent.pid, signal.SIGKILL)


@pytest.mark.soak
@pytest.mark.parametrize("how", ["SIGKILL", *further("SIGTERM", "SIGINT")])
def test_commands_killed_at_any_moment(how: str, tmp_path: Path) -> None:
    """SIGINT to the command alone, as of `kill -INT`; a terminal's goes to all processes."""
    moments, times = random.Random(how), repeats(len(COMMANDS), 36)
    for number in range(times):
        words = [*COMMANDS.values()][number % len(COMMANDS)].split()
        out = [] if words == ["compile"] else ["--out", f"{tmp_path / str(number)}"]
        cache = {"NUMBA_CACHE_DIR": f"{tmp_path / 'cache'}"} if words == ["compile"] else {}
        with started(*words, *out, **cache) as process:
            with suppress(subprocess.TimeoutExpired):
                process.communicate(timeout=moments.uniform(0.2, 8.0))
            process.send_signal(signal.Signals[how])
            # Of what was killed, the workers may still hold the pipes: none is read to its end.
            process.wait(LONGEST_S)
            left = left_after(process.pid, WITHIN_S)
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            assert left == [], f"{words[0]}, number {number}"
