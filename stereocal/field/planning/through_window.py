"""What a plan whose cameras look through a window will measure: simulated field days, calibrated.

There is no forecast of errors by place behind a window. A few recordings are simulated with the
plan's errors of lenses, baseline and bar, calibrated with the window's distance and tilt to be
found, and fresh bars are measured with each.
"""

import json
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from stereocal.errors import StereocalError
from stereocal.evaluation.summary import Estimate
from stereocal.field.planning.bars import place_planned_bars
from stereocal.field.planning.expected import planned_dataset
from stereocal.field.planning.forecast import Reached
from stereocal.field.planning.plan import Plan
from stereocal.fit.calibrate import calibrate_rig
from stereocal.fit.least_squares.unknowns import LensPrior, RefineSettings
from stereocal.rig.camera import CAMERAS
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.rig.window import StatedWindow, moved_window
from stereocal.simulation.simulate import lens_off_by
from stereocal.system.array_types import FloatArray
from stereocal.system.tasks import Progress, Task, run_tasks
from stereocal.verdict.in_words import percent

FORMAT = "stereocal-forecast-window/1"
FIELD_DAYS, TEST_BARS = 8, 100
WRONG_INDEX = 0.002
"""Error of the medium's index whose cost is stated: in water about 20 degrees of temperature, or 1
per cent of salt."""

REACHED: dict[Reached, str] = {
    "yes": "Yes, it reaches what you need: ",
    "no": "No, it does not reach what you need: ",
    "not sure": "It is not sure that it reaches what you need: ",
}


@dataclass(frozen=True, eq=False)
class WindowForecast:
    """The forecast of a plan with a window."""

    plan: Plan
    p95: FloatArray
    """(field days,): what 95 % of lengths are within, a fraction; NaN where no calibration was
    found."""
    seed: int

    @property
    def failed(self) -> int:
        return int(np.isnan(self.p95).sum())

    @property
    def length_p95(self) -> Estimate:
        """The median over the simulated field days, the least and the largest."""
        known = self.p95[np.isfinite(self.p95)]
        return Estimate(float(np.median(known)), float(known.min()), float(known.max()))

    @cached_property
    def bars(self) -> FloatArray:
        """(TEST_BARS, 2, 3): bars in the volume, in the primary's frame."""
        return place_planned_bars(self.plan, TEST_BARS, np.random.default_rng([self.seed, 1]))

    @cached_property
    def of_wrong_index(self) -> float:
        """The median relative change of lengths with an index of the medium that is too large by
        `WRONG_INDEX`."""
        rig = self.plan.rig
        one, other = (
            replace(it, window=replace(it.window, medium=it.window.medium + WRONG_INDEX))
            for it in (rig.primary, rig.secondary)
            if it.window is not None
        )
        wrong = _lengths(Rig(one, other, rig.pose), _seen(rig, self.bars))
        return float(np.median(wrong / self.plan.bar_m - 1.0))

    @property
    def reached(self) -> Reached | None:
        """Whether the accuracy that is needed is reached on all field days, or on none; None if not
        asked."""
        errors, needed = self.length_p95, self.plan.needed
        if needed is None:
            return None
        return "yes" if errors.high <= needed else "no" if needed < errors.low else "not sure"

    @property
    def answer(self) -> str:
        """What the plan will measure, and what a wrong index costs."""
        errors, wrong = self.length_p95, self.of_wrong_index
        reached = REACHED[self.reached] if self.reached else ""
        failed = f" {self.failed} of {len(self.p95)} simulated recordings could not be calibrated."
        return (
            f"{reached}95 % of lengths are within {percent(errors.value)} % "
            f"({percent(errors.low)} to {percent(errors.high)} % in {len(self.p95) - self.failed} "
            f"simulated field days). With an index of the medium that is {WRONG_INDEX:g} too "
            f"large, lengths become {percent(abs(wrong))} % {'longer' if wrong > 0 else 'shorter'}."
        ) + failed * (self.failed > 0)

    def dumps(self) -> bytes:
        """The content of `forecast.json`."""
        content: dict[str, Any] = {
            "format": FORMAT,
            "plan": self.plan.name,
            "length_error_p95": vars(self.length_p95),
            "of_field_days": [None if np.isnan(error) else error for error in self.p95.tolist()],
            "reached": self.reached,
            "index_error": WRONG_INDEX,
            "length_change_by_index_error": self.of_wrong_index,
            "seed": self.seed,
        }
        return (json.dumps(content, indent=2, allow_nan=False) + "\n").encode()


def forecast_through_window(
    plan: Plan,
    executor: Executor | None = None,
    seed: int = 0,
    days: int = FIELD_DAYS,
    progress: Progress | None = None,
) -> WindowForecast:
    """The forecast of a plan with a window.

    Args:
        executor: for the simulated field days; None: in turn in this thread.
        progress: called with the field days done, and those in all.
    """
    tasks = [Task(field_day, (plan, seed, day), 1) for day in range(days)]
    with closing(run_tasks(tasks, executor, days, progress)) as finished:
        found = WindowForecast(plan, np.array([error for _, error in finished]), seed)
    if found.failed > days / 2:
        raise StereocalError(
            "Most recordings simulated from this plan cannot be calibrated: plan more frames, a "
            "larger common view, or less noise."
        )
    return found


def field_day(plan: Plan, seed: int, day: int) -> float:
    """What 95 % of lengths are within on one simulated field day; NaN if it cannot be calibrated.

    Lengths are relative to true ones, so that the error of the bar is among theirs.
    """
    rng, sigma = np.random.default_rng([seed, 2, day]), plan.uncertainty
    window = plan.primary.window
    assert window is not None
    longer = 1.0 + sigma.baseline_m / plan.baseline_m * rng.standard_normal()
    pose = Pose(plan.pose.R, plan.pose.T * longer)
    off = np.array([sigma.focal, sigma.centre_px, sigma.centre_px]) * rng.standard_normal((2, 3))
    one, other = (
        lens_off_by(it, focal, (u, v))
        for it, (focal, u, v) in zip((plan.primary, plan.secondary), off.tolist(), strict=True)
    )
    truth = Rig(one, replace(other, window=moved_window(window, pose)), pose)
    held = 1.0 + sigma.bar_m / plan.bar_m * rng.standard_normal()
    placed = place_planned_bars(plan, plan.frames + TEST_BARS, rng)
    middle = placed.mean(axis=1, keepdims=True)
    pixels = _seen(truth, middle + held * (placed - middle))
    pixels += plan.noise_px * rng.standard_normal(pixels.shape)
    recorded, tests = np.split(pixels, [2 * plan.frames])
    stated = StatedWindow(CAMERAS, window.thickness_m, window.glass, window.medium)
    recording = planned_dataset(plan, recorded).recording
    bare = {name: replace(camera, window=None) for name, camera in recording.cameras.items()}
    recording = replace(recording, cameras=bare, windows=(stated,))
    known = dict.fromkeys(map(str, CAMERAS), LensPrior(sigma.focal, sigma.centre_px))
    settings = RefineSettings(known, sigma.baseline_m, sigma.bar_m)
    try:
        rig = calibrate_rig(recording, settings).pair(*CAMERAS)
    except StereocalError:
        return float("nan")
    errors = np.abs(_lengths(rig, tests) / (held * plan.bar_m) - 1.0)
    return float(np.nanpercentile(errors, 95)) if np.isfinite(errors).any() else float("nan")


def _seen(rig: Rig, bars: FloatArray) -> FloatArray:
    """(2 n, 4): pixels of both ends of bars (n, 2, 3) in both cameras."""
    ends = bars.reshape(-1, 3)
    return np.hstack([rig.primary.project(ends), rig.secondary.project(rig.pose.apply(ends))])


def _lengths(rig: Rig, pixels: FloatArray) -> FloatArray:
    """(n,): the lengths of bars by their pixels (2 n, 4)."""
    ends = rig.reconstruct(pixels[:, :2], pixels[:, 2:])
    return np.asarray(np.linalg.norm(ends[0::2] - ends[1::2], axis=1))
