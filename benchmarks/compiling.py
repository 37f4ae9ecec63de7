"""What compiling costs: processor time of a first use, with nothing on disk, and of the next.

    python -m benchmarks.compiling

Each line is two fresh processes with one new cache: `calibrate` is the command on the sample field,
`everything` is what the first page waits for (`warming.compile_all`). User and system time of the
child process, from the operating system; instructions where `perf` may count them, which do not
depend on other work. The import of the program is in all of them.
"""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

FIELD = Path(__file__).parents[1] / "sample_data" / "field"
COUNTED = """
import gc
from numba.core.dispatcher import Dispatcher
every = [one for one in gc.get_objects() if isinstance(one, Dispatcher)]
own = [one for one in every if one.py_func.__module__.startswith("stereocal")]
print("specialisations", sum(len(one.signatures) for one in own))
"""
WORK = {
    "calibrate": """
import sys
from tempfile import TemporaryDirectory
from stereocal.cli import main
with TemporaryDirectory() as out:
    try:
        main(["calibrate", sys.argv[1], "--out", out])
    except SystemExit as end:
        assert not end.code, end.code
""",
    "everything": """
import sys
from pathlib import Path
from stereocal.commands.warming import compile_all
compile_all(Path(sys.argv[1]))
""",
}


def measure(work: str, cache: str) -> tuple[float, int, float | None]:
    """CPU seconds, specialisations, and instructions (1e9; None where they are not counted)."""
    command = [sys.executable, "-c", work + COUNTED, str(FIELD)]
    counting = can_count()
    if counting:
        command = ["perf", "stat", "-x,", "-e", "instructions:u", *command]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    run = subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "NUMBA_CACHE_DIR": cache},
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    instructions = float(run.stderr.splitlines()[-1].split(",")[0]) / 1e9 if counting else None
    return seconds, int(run.stdout.split()[-1]), instructions


def can_count() -> bool:
    """Whether `perf` is there and this machine lets it count."""
    if shutil.which("perf") is None:
        return False
    probe = ["perf", "stat", "-x,", "-e", "instructions:u", "true"]
    run = subprocess.run(probe, capture_output=True, text=True, check=False)
    return run.returncode == 0 and run.stderr.split(",")[0].isdigit()


def main() -> None:
    """Measure and print."""
    print("| | cache | CPU, s | instructions, 1e9 | specialisations |\n|---|---|---|---|---|")
    for name, work in WORK.items():
        with TemporaryDirectory() as cache:
            for state in ("empty", "full"):
                seconds, count, instructions = measure(work, cache)
                counted = f"{instructions:.1f}" if instructions else "not counted"
                print(f"| {name} | {state} | {seconds:.1f} | {counted} | {count} |", flush=True)
    print(f"load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
