"""What a planned field day will give: the figures of its files, errors by place, what would help.

Values are means over rigs drawn from the plan (`drawn_rigs`). Intervals hold 95 % of these rigs:
what one field day may give. They are not intervals of the mean.
"""

import json
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from stereocal.calibration.methods import FILE_METHODS, Method
from stereocal.errors import StereocalError
from stereocal.evaluation.summary import Estimate
from stereocal.field.planning.advice import LIMITS, Advice, advise
from stereocal.field.planning.drawn_rigs import FIGURES, DrawnRigs, draw_rigs
from stereocal.field.planning.expected import ExpectedFit, expect
from stereocal.field.planning.plan import Plan
from stereocal.fit.errors.length_in_metres import BarKnown, length_in_words
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import distance, rounded, without_nan
from stereocal.system.tasks import Progress, Task, run_tasks
from stereocal.verdict.in_words import percent

FORECAST_FORMAT = "stereocal-forecast/1"
RIGS, FEWEST_RIGS, MOST_RIGS = 128, 64, 10_000
FRAMES_OF_RIGS = 50
"""With more frames than this, fewer rigs are drawn; each then gives more information."""
CHUNK = 16
LEVEL = (2.5, 97.5)
TOLD_APART = 0.05
"""Share of the points that may have a wrong partner within the threshold."""
SURE = 0.95
"""Share of field days from which an accuracy is reached, or missed."""
Reached = Literal["yes", "no", "not sure"]
MOST_FAILED = 0.5
"""Share of drawn rigs that may fail before the plan is rejected."""
STATED = FIGURES[:-1]
"""The figures of `forecast.json`."""


@dataclass(frozen=True, eq=False)
class PlanForecast:
    """The forecast of a plan."""

    plan: Plan
    rigs: DrawnRigs
    fit: ExpectedFit
    seed: int

    def estimate(self, method: Method, figure: str) -> Estimate:
        """A figure of a file: mean over the drawn rigs, and the interval of 95 % of them."""
        return _over_rigs(self.rigs.figures[:, FILE_METHODS.index(method), FIGURES.index(figure)])

    def metric_p95(self, method: Method) -> Estimate:
        """The error that 95 % of lengths in metres are within, on all field days together: the bar
        is off by the same on each, so that the mean over them would have less of it. The interval
        is that of the single field days."""
        errors = self.rigs.length_errors[:, FILE_METHODS.index(method)]
        value, single = float(np.nanpercentile(errors, 95)), self.estimate(method, "p95_error_3d")
        return Estimate(value, min(single.low, value), max(single.high, value))

    @cached_property
    def position_error_m(self) -> Estimate:
        """Mean distance of reconstructed from true points in the primary's frame, refined set."""
        return _over_rigs(self.rigs.position_m)

    @cached_property
    def advice(self) -> Advice:
        """What limits the plan and what would help."""
        return advise(self.fit)

    @cached_property
    def match_with(self) -> Method:
        """The file with the smaller FCP."""
        return self._better("2d", "fcp_reprojection")

    @cached_property
    def measure_with(self) -> Method:
        """The file with the smallest length error."""
        return self._better("3d", "mean_length_error")

    def _better(self, other: Method, figure: str) -> Method:
        files: tuple[Method, ...] = ("refined", other)
        return min(files, key=lambda method: self.estimate(method, figure).value)

    @cached_property
    def points_per_frame(self) -> Estimate:
        """How many points of a frame can be matched, spread over the common view.

        With that many, on average 5 % have a wrong partner within the matching threshold.
        """
        wrong = self.estimate(self.match_with, "wrong_let_in_at_threshold")
        with np.errstate(divide="ignore"):
            value, low, high = 1.0 + TOLD_APART / np.array([wrong.value, wrong.high, wrong.low])
        return Estimate(float(value), float(low), float(high))

    @cached_property
    def field_days_that_reach(self) -> float | None:
        """Share of field days on which 95 % of lengths are as good as needed; None if not asked."""
        if self.plan.needed is None:
            return None
        method, figure = FILE_METHODS.index(self.measure_with), FIGURES.index("p95_error_3d")
        within = self.rigs.figures[:, method, figure]
        return float(np.mean(within[np.isfinite(within)] <= self.plan.needed))

    @property
    def reached(self) -> Reached | None:
        """Whether the accuracy that is needed is reached; None if not asked."""
        share = self.field_days_that_reach
        if share is None:
            return None
        return "yes" if share >= SURE else "no" if share <= 1 - SURE else "not sure"

    def to_json(self) -> dict[str, Any]:
        """The content of `forecast.json`; errors are fractions, missing values null."""
        depths, needed = self.fit.by_depth, dict[str, Any]()
        if self.plan.needed is not None:
            needed["needed"] = {
                "length_error": self.plan.needed,
                "reached": self.reached,
                "field_days": self.field_days_that_reach,
            }
        content = {
            "format": FORECAST_FORMAT,
            "plan": self.plan.name,
            "methods": {
                method: {
                    **{figure: vars(self.estimate(method, figure)) for figure in STATED},
                    "p95_metric_error_3d": vars(self.metric_p95(method)),
                }
                for method in FILE_METHODS
            },
            "position_error_m": vars(self.position_error_m),
            "points_per_frame": vars(self.points_per_frame),
            **needed,
            "limited_by": self.advice.limited_by,
            "advice": list(self.advice.sentences),
            "by_depth": [
                {"depth_m": z, "mean_length_error": error, "position_error_m": away}
                for z, error, away in np.column_stack(
                    [depths.depths_m, depths.mean_length, depths.position_m]
                ).tolist()
            ],
            "rigs": self.rigs.count,
            "rigs_failed": self.rigs.failed,
            "seed": self.seed,
        }
        return {key: without_nan(value) for key, value in content.items()}

    def dumps(self) -> bytes:
        """The file; equal plans and seeds give equal bytes."""
        return (json.dumps(self.to_json(), indent=2, allow_nan=False) + "\n").encode()


def forecast(
    plan: Plan,
    executor: Executor | None = None,
    seed: int = 0,
    rigs: int | None = None,
    progress: Progress | None = None,
) -> PlanForecast:
    """The forecast of a plan.

    Args:
        executor: for the drawn rigs; None: in turn in this thread. Every executor gives the same
            figures (those of the refined set to about 1e-9).
        rigs: number of drawn rigs; None: 128, fewer for many frames.
        progress: called with the drawn rigs done, and those in all.
    """
    if rigs is None:
        rigs = int(np.clip(RIGS * FRAMES_OF_RIGS / plan.frames, FEWEST_RIGS, RIGS))
    fit = expect(plan, seed)
    ranges = ((first, min(first + CHUNK, rigs)) for first in range(0, rigs, CHUNK))
    tasks = [Task(draw_rigs, (plan, seed, a, b), b - a) for a, b in ranges]
    with closing(run_tasks(tasks, executor, rigs, progress)) as finished:
        every = ((part.figures, part.position_m, part.length_errors) for _, part in finished)
        parts = zip(*every, strict=True)
        rigs_drawn = DrawnRigs(*map(np.concatenate, parts))
    if rigs_drawn.failed > MOST_FAILED * rigs_drawn.count:
        raise StereocalError(
            "Most recordings simulated from this plan cannot be calibrated: plan more frames, a "
            "larger common view, or less noise."
        )
    return PlanForecast(plan, rigs_drawn, fit, seed)


def _over_rigs(values: FloatArray) -> Estimate:
    finite = values[np.isfinite(values)]
    finite = finite if len(finite) else np.full(1, np.nan)
    value, (low, high) = float(finite.mean()), np.percentile(finite, LEVEL).tolist()
    return Estimate(value, min(low, value), max(high, value))


def plan_answer(forecast: PlanForecast) -> str:
    """What the plan will measure, how well, and what limits it."""
    by_depth = forecast.fit.by_depth
    depths, within, position = by_depth.depths_m, by_depth.length_p95, by_depth.position_m
    known = np.flatnonzero(np.isfinite(within))
    middle, far = known[len(known) // 2], known[-1]
    first = f"{_about_needed(forecast)}{_length_in_words(forecast)}"
    return (
        f"{first}With the refined set 95 % of lengths are within {percent(within[middle])} % at "
        f"{rounded(depths[middle], 3)} m and {percent(within[far])} % at {rounded(depths[far], 3)} "
        f"m, and positions have standard errors of {distance(float(position[middle]))} and "
        f"{distance(float(position[far]))} there. About {points_per_frame(forecast)} points of a "
        f"frame can be matched. Limited by {LIMITS[forecast.advice.limited_by]}."
    )


def _length_in_words(forecast: PlanForecast) -> str:
    """How well a length in metres will be known, and what of that is the bar."""
    plan = forecast.plan
    total = forecast.metric_p95(forecast.measure_with).value
    bar = BarKnown.of("bar", plan.bar_m, plan.uncertainty.bar_m, None)
    return f"{length_in_words(total, None, bar, [plan.bar_m])} "


def _about_needed(forecast: PlanForecast) -> str:
    """Whether the accuracy that is needed is reached; empty if none is stated."""
    needed, days = forecast.plan.needed, forecast.field_days_that_reach
    if needed is None or days is None:
        return ""
    within = percent(forecast.estimate(forecast.measure_with, "p95_error_3d").value)
    reached = {
        "yes": "Yes, it reaches what you need",
        "no": "No, it does not reach what you need",
        "not sure": f"It reaches what you need on {100 * days:.0f} % of field days",
    }
    return (
        f"{reached[forecast.reached or 'no']}: 95 % of lengths within {within} % (needed: "
        f"{percent(needed)} %). "
    )


def points_per_frame(forecast: PlanForecast) -> str:
    """How many points of a frame can be matched, with two digits at most."""
    value = forecast.points_per_frame.value
    if not value < 10_000:
        return "more than 10,000"
    return str(int(float(f"{value:.2g}"))) if value >= 10 else str(int(value))
