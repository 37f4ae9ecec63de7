"""Run all programs on all tasks and print the tables: python -m benchmarks.peers --rigs 20."""

import argparse
import importlib.metadata
import os
from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.peers.measure import Measured, each, errors_of, measure
from benchmarks.peers.registry import installed
from benchmarks.peers.scenarios import RECORDING, SCENARIOS, Task, recording
from benchmarks.peers.solution import Peer

PACKAGES = (
    "stereocal",
    "numpy",
    "scipy",
    "numba",
    "poselib",
    "pycolmap",
    "aniposelib",
    "caliscope",
)
THREADS = "OMP_NUM_THREADS"
TIMES = 5
"""Solves of the recording, for the time."""


def main() -> None:
    """Print a Markdown table for each scenario and one for the recording."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description=__doc__)
    parser.add_argument("--rigs", type=int, default=20, help="simulated rigs of each kind")
    parser.add_argument(
        "--only", nargs="+", default=[""], help="only programs whose name contains one of these"
    )
    kinds = [*(scenario.key for scenario in SCENARIOS), RECORDING]
    parser.add_argument("--kinds", nargs="+", choices=kinds, default=kinds, help="which tasks")
    parsed = parser.parse_args()
    peers, skipped = installed()
    peers = [peer for peer in peers if any(part in peer.name for part in parsed.only)]
    print(_conditions(), *skipped, sep="\n")
    print(_knowledge(peers))
    for peer in peers:
        measure(peer, SCENARIOS[0].task(np.random.default_rng(0)))  # compiles and warms up
    for scenario in SCENARIOS:
        if scenario.key not in parsed.kinds:
            continue
        print(f"\n### {scenario.name}, {parsed.rigs} rigs\n")
        _simulated(peers, list(scenario.tasks(parsed.rigs)))
    if RECORDING in parsed.kinds:
        _recorded(peers, recording())


def _simulated(peers: Sequence[Peer], tasks: Sequence[Task]) -> None:
    truth = [errors_of(task.truth, task) for task in tasks if task.truth is not None]
    print(
        "| program | epipolar RMS (px) | length error (%) | rotation error (mrad) | CPU (ms) "
        "| wall (ms) | failed |\n|---|---|---|---|---|---|---|"
    )
    print(
        f"| *the truth itself* | {_spread(each(truth, 'epipolar_px'))} "
        f"| {_spread(100 * each(truth, 'length'))} | 0 | | | |"
    )
    for peer in peers:
        found = [measure(peer, task) for task in tasks]
        good = [one for one in found if isinstance(one, Measured)]
        print(
            f"| {peer.name} | {_spread(each(good, 'epipolar_px'))} | "
            f"{_spread(100 * each(good, 'length'))} | {_spread(1000 * each(good, 'rotation_rad'))} "
            f"| {_spread(1000 * each(good, 'cpu_s'))} | {_spread(1000 * each(good, 'wall_s'))} | "
            f"{_failures(found)} |",
            flush=True,
        )
    print(_load())


def _recorded(peers: Sequence[Peer], task: Task) -> None:
    print(f"\n### {RECORDING}, {len(task.fit.correspondences.bars)} frames fitted\n")
    print(
        "| program | epipolar RMS (px) | length error (%) | third marker (%) | baseline (m) "
        "| CPU (ms) | wall (ms) |\n|---|---|---|---|---|---|---|"
    )
    for peer in peers:
        measure(peer, task)  # other sizes compile anew in some programs
        found = [measure(peer, task) for _ in range(TIMES)]
        good = [one for one in found if isinstance(one, Measured)]
        if not good:
            print(f"| {peer.name} | {_failures(found)} | | | | | |")
            continue
        last = good[-1]
        print(
            f"| {peer.name} | {last.epipolar_px:.3f} | {100 * last.length:.3f} "
            f"| {100 * last.middle:.3f} | {last.baseline_m:.3f} "
            f"| {_spread(1000 * each(good, 'cpu_s'))} | {_spread(1000 * each(good, 'wall_s'))} |",
            flush=True,
        )
    print(_load())


def _spread(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> str:
    """Median and, in brackets, the middle 80 %."""
    if not len(values):
        return ""
    low, middle, high = np.percentile(values, (10, 50, 90), method="nearest")
    return f"{_digits(middle)} ({_digits(low)} to {_digits(high)})"


def _digits(value: float) -> str:
    return f"{value:.0f}" if 1000 <= value < np.inf else f"{value:.3g}"


def _failures(found: Sequence[Measured | str]) -> str:
    """How many failed, and what the first of them said."""
    said = [one for one in found if isinstance(one, str)]
    return f"{len(said)}: {said[0][:70]}" if said else "0"


def _knowledge(peers: Sequence[Peer]) -> str:
    rows = [f"| {one.name} | {one.scale} | {one.lenses} | {one.outliers} |" for one in peers]
    return "\n".join(["\n| program | scale | lenses | outliers |", "|---|---|---|---|", *rows])


def _conditions() -> str:
    versions: Mapping[str, str] = {name: _version(name) for name in PACKAGES}
    known = ", ".join(f"{name} {version}" for name, version in versions.items() if version)
    return f"{known}; {THREADS}={os.environ.get(THREADS, 'not set')}. {_load()}"


def _load() -> str:
    return f"\nLoad {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ""


if __name__ == "__main__":
    main()
