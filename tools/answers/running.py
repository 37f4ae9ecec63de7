"""Run the cases with the code of a checkout, and keep what they write."""

import os
import re
import shutil
import statistics
import subprocess
import sys
from collections.abc import Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path

from tools.answers.inputs import MADE, ROOT

INPUT = re.compile(r"@(\w+)")
CREATED = re.compile(r'"created": "[^"]*"')
AT_ONCE = 2
# Several threads round sums otherwise than one; a help is as wide as the terminal.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
ENVIRONMENT = {**dict.fromkeys(THREADS, "1"), "COLUMNS": "100", "LC_ALL": "C.UTF-8", "TZ": "UTC"}


def keep(folder: Path, checkout: Path, only: Collection[str]) -> float:
    """Run cases, each in its folder of this name; returns the seconds of CPU time.

    There its `stdout`, `stderr` and `exit` are beside the files that it writes.
    """
    cases = dict(_possible(_chosen("cases", only)))
    inputs = _make_inputs(folder, cases)
    _compile(checkout)
    total = 0.0
    with ThreadPoolExecutor(AT_ONCE) as pool:
        runs = {
            name: pool.submit(_run_settled, folder / name, command, inputs, checkout)
            for name, command in cases.items()
        }
        for name, run in runs.items():
            total += run.result()
            print(f"{run.result():6.1f} s  {name}", flush=True)
    return total


def compare_times(
    checkouts: tuple[Path, Path], only: Collection[str], folder: Path, pairs: int
) -> None:
    """Print for each command the ratio of the CPU times of two checkouts that run by turns."""
    cases = _chosen("timed", only)
    inputs = _make_inputs(folder, cases)
    for checkout in checkouts:
        _compile(checkout)
    for name, command in cases.items():
        took: tuple[list[float], list[float]] = ([], [])
        for pair in range(pairs + 1):
            for which in (0, 1) if pair % 2 else (1, 0):
                took[which].append(_run(folder / name, command, inputs, checkouts[which]))
        old, new = (times[1:] for times in took)  # the first pair only fills the disk's cache
        ratios = sorted(b / a for a, b in zip(old, new, strict=True))
        print(
            f"{name:10s} new/old {statistics.median(ratios):.3f}, from {ratios[0]:.3f} to "
            f"{ratios[-1]:.3f} in {pairs} pairs; CPU {statistics.median(old):.2f} s old, "
            f"{statistics.median(new):.2f} s new",
            flush=True,
        )


def _table(section: str) -> dict[str, str]:
    """The commands of a section of `cases.txt`, by name."""
    text = Path(__file__).with_name("cases.txt").read_text(encoding="utf-8")
    lines = text.partition(f"\n[{section}]\n")[2].partition("\n[")[0].splitlines()
    words = (line.partition(" ") for line in lines if line)
    return {name: command.strip() for name, _, command in words}


def _chosen(section: str, only: Collection[str]) -> dict[str, str]:
    """Those that a pattern of `only` names; all if it is empty."""
    cases = _table(section)
    for pattern in only:
        if not any(fnmatchcase(name, pattern) for name in cases):
            sys.exit(f"No case is called {pattern}: there are {', '.join(cases)}.")
    wanted = only or ["*"]
    return {n: command for n, command in cases.items() if any(fnmatchcase(n, p) for p in wanted)}


def _possible(cases: dict[str, str]) -> Iterator[tuple[str, str]]:
    """Those whose inputs can be made; the others need recordings that are not at hand."""
    made = {*_table("inputs"), *MADE}
    for name, command in cases.items():
        missing = [of for of in INPUT.findall(command) if of not in made and not _shipped(of)]
        if missing:
            print(f"left out: {name}; STEREOCAL_REAL_DATA has no {', '.join(missing)}")
        else:
            yield name, command


def _shipped(name: str) -> Path | None:
    """The recording or sample of this name."""
    folders = Path(os.environ.get("STEREOCAL_REAL_DATA", "none"), name), ROOT / "sample_data" / name
    return next(filter(Path.is_dir, folders), None)


def _make_inputs(folder: Path, cases: dict[str, str]) -> Path:
    for command in cases.values():
        for name in INPUT.findall(command):
            _make(name, folder / "inputs")
    return folder / "inputs"


def _make(name: str, inputs: Path) -> None:
    """Make an input, after those that it needs; one that is there already stays."""
    if (inputs / name).exists():
        return
    part = inputs / f"{name}.part"
    shutil.rmtree(part, ignore_errors=True)
    if (command := _table("inputs").get(name)) is not None:
        for needed in INPUT.findall(command):
            _make(needed, inputs)
        _compile(ROOT)
        _run_settled(part, command, inputs, ROOT)
        if (part / "exit").read_text() != "0\n":
            sys.exit(f"The input {name} cannot be made:\n{(part / 'stderr').read_text()}")
        for path in part.rglob("*.json"):  # a command may write a digest of its input
            path.write_text(CREATED.sub('"created": "2020-01-01T00:00:00+00:00"', path.read_text()))
    elif (folder := _shipped(name)) is not None:
        shutil.copytree(folder, part)
    else:
        part.mkdir(parents=True)
        MADE[name](part)
    part.rename(inputs / name)


def _run_settled(folder: Path, command: str, inputs: Path, checkout: Path) -> float:
    """Run a command, and again if it compiled what `stereocal compile` does not."""
    compiled = _compiled(checkout)
    seconds = _run(folder, command, inputs, checkout)
    return seconds if _compiled(checkout) == compiled else _run(folder, command, inputs, checkout)


def _compiled(checkout: Path) -> dict[Path, float]:
    return {path: path.stat().st_mtime for path in (checkout / "stereocal").rglob("*.nbc")}


def _run(folder: Path, command: str, inputs: Path, checkout: Path) -> float:
    """Run a command in an empty folder, which then has its files; returns its CPU seconds."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    near = os.path.relpath(inputs, folder)  # messages name files as the command does
    script = 'stereocal() { python -m stereocal "$@"; }\n' + INPUT.sub(rf"{near}/\1", command)
    with (folder / "stdout").open("wb") as out, (folder / "stderr").open("wb") as err:
        started = subprocess.Popen(
            ["sh", "-c", script], cwd=folder, env=_environment(checkout), stdout=out, stderr=err
        )
        _, status, used = os.wait4(started.pid, 0)
    started.returncode = os.waitstatus_to_exitcode(status)
    (folder / "exit").write_text(f"{started.returncode}\n")
    return used.ru_utime + used.ru_stime


def _environment(checkout: Path) -> dict[str, str]:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return {**os.environ, **ENVIRONMENT, "PATH": path, "PYTHONPATH": str(checkout)}


@cache
def _compile(checkout: Path) -> None:
    """Compile before: a process that compiles rounds otherwise than those that load what it did."""
    command = [sys.executable, "-m", "stereocal", "compile"]
    subprocess.run(
        command, env=_environment(checkout), cwd=checkout, check=True, capture_output=True
    )
