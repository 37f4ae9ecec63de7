"""One program on one task: held-out errors, error of the rotation, time."""

import contextlib
import signal
import time
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.peers.scenarios import Task
from benchmarks.peers.solution import Peer, Solution
from stereocal.rig.geometry import triangulate
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray

LIMIT_S = 10.0
"""CPU time after which a solve is broken off."""

ENOUGH_S = 0.05
"""A quick solve is repeated for so long: clocks of CPU time are coarse on some systems."""

MIDDLE_M = (0.13, 0.26)
"""Distances of ewand12's third marker from A and from B."""


@dataclass(frozen=True)
class Measured:
    """What one solve is worth. Lengths are fractions; NaN is not known."""

    epipolar_px: float
    length: float
    rotation_rad: float
    middle: float
    baseline_m: float
    cpu_s: float
    wall_s: float


def measure(peer: Peer, task: Task) -> Measured | str:
    """Errors on the task's test data and the time of the solve; a sentence if it failed."""
    wall, cpu = time.perf_counter(), time.process_time()
    solves, spent = 0, 0.0
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            while spent < ENOUGH_S:
                with _at_most(LIMIT_S):
                    found = peer.solve(task.fit)
                solves, spent = solves + 1, time.process_time() - cpu
    except Exception as error:  # whatever a program raises, the others are still measured
        return f"{type(error).__name__}: {error}".splitlines()[0]
    return errors_of(found, task, spent / solves, (time.perf_counter() - wall) / solves)


def errors_of(found: Solution, task: Task, cpu_s: float = 0.0, wall_s: float = 0.0) -> Measured:
    """Errors of a solution on the test data, seen through the solution's own lenses."""
    test = task.test.changed(primary=found.cameras[0], secondary=found.cameras[1])
    rows = test.correspondences
    rig = Rig(test.primary, test.secondary, found.pose)
    distances = rig.epipolar_distances(rows.primary, rows.secondary)
    lengths = np.abs(test.reconstructed_lengths_m(found.pose) / test.bar_distances_m - 1)
    return Measured(
        epipolar_px=float(np.sqrt(_best((distances**2).mean(axis=1), task.kept).mean())),
        length=float(_best(lengths, task.kept).mean()),
        rotation_rad=_turned(found, task.truth) if task.truth else float("nan"),
        middle=_middle(found, task) if task.middle is not None else float("nan"),
        baseline_m=found.pose.baseline,
        cpu_s=cpu_s,
        wall_s=wall_s,
    )


def _turned(found: Solution, truth: Solution) -> float:
    """Angle between two rotations: arcsin of half the chord holds its digits near 0."""
    chord = np.linalg.norm(found.R - truth.R) / (2 * np.sqrt(2))
    return float(2 * np.arcsin(min(chord, 1.0)))


def _middle(found: Solution, task: Task) -> float:
    """Mean relative error of the third marker's distances from A and from B."""
    assert task.middle is not None
    rows = task.test.correspondences
    first, second = found.cameras
    pose = found.pose
    ends = triangulate(pose, first.undistort(rows.primary), second.undistort(rows.secondary))
    # An unseen marker is NaN, which `undistort` passes on.
    middle = triangulate(
        pose, first.undistort(task.middle[:, 0]), second.undistort(task.middle[:, 1])
    )
    apart = [
        np.abs(np.linalg.norm(ends[rows.bars[:, i]] - middle, axis=1) / MIDDLE_M[i] - 1)
        for i in (0, 1)
    ]
    both = np.concatenate(apart)
    return float(_best(both[np.isfinite(both)], task.kept).mean())


def _best(values: FloatArray, kept: float) -> FloatArray:
    """The best part; a point behind a camera (NaN) counts as infinitely wrong."""
    return np.sort(np.where(np.isnan(values), np.inf, values))[: int(kept * len(values))]


@contextlib.contextmanager
def _at_most(seconds: float) -> Iterator[None]:
    """Raise `TimeoutError` after so much CPU time, where the system can (not on Windows)."""
    if not hasattr(signal, "setitimer"):
        yield
        return

    def stop(*_: object) -> None:
        raise TimeoutError(f"broken off after {seconds:g} s of CPU time")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def each(measured: Iterable[Measured], name: str) -> FloatArray:
    """One figure of all solves."""
    return np.array([getattr(one, name) for one in measured])
