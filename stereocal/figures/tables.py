"""Results in words and tables for the user, with units and significant digits."""

import math
from collections.abc import Mapping

import numpy as np
import pandas as pd

from stereocal.calibration.methods import COST_UNITS, FILE_METHODS, METHOD_NAMES, Method
from stereocal.calibration.montecarlo import MethodResult
from stereocal.evaluation.summary import Estimate, MethodSummary
from stereocal.field.planning.forecast import PlanForecast
from stereocal.figures.style import in_order
from stereocal.figures.validation import COLUMNS, note_on_intervals, standings
from stereocal.fit.least_squares.small_steps import FACTOR, largest_turn_sigma
from stereocal.fit.parameter_file import errors_of_set
from stereocal.fit.refined_result import RefinedResult
from stereocal.fit.results import Calibration
from stereocal.rig.pair import Pair
from stereocal.rig.parameters import ForecastEntries
from stereocal.system.numbers import digits, rounded
from stereocal.verdict.file_figures import stated_in
from stereocal.verdict.in_words import interval, percent

LENS_TITLES = {"f": "Focal length", "c": "Image centre"}
POLE = 2.0
"""Where the largest error of an angle is so many times that of any rotation, angles say little."""
ANGLE_TITLES = {
    "yaw": "Yaw α (degrees)",
    "pitch": "Pitch β (degrees)",
    "roll": "Roll γ (degrees)",
    "delta": "Direction of the baseline δ (degrees)",
    "epsilon": "Direction of the baseline ε (degrees)",
}
THRESHOLD_ROW = "Matching threshold (px)"
METRIC_ROW = "95 % of lengths in metres within (%)"
FORECAST_ROWS = {
    "Overlap of correct and wrong pairs, FCP (%)": "fcp_reprojection",
    "Reprojection error, mean (px)": "mean_reprojection_px",
    THRESHOLD_ROW: "threshold_px",
    "Length error, median (%)": "median_error_3d",
    "95 % of lengths, relative to the bar, within (%)": "p95_error_3d",
    METRIC_ROW: "p95_metric_error_3d",
}


def errors_table(calibration: Calibration) -> pd.DataFrame:
    """The errors of the methods on all frames not left out."""
    held_out = ", fitted and held out" if len(calibration.held_out_frames) else ""
    left_out = len(calibration.screening.left_out)
    columns = {
        METHOD_NAMES[name]: {
            "Mean reprojection error (px)": digits(errors.mean_reprojection_px),
            "Mean bar length error (%)": digits(100 * errors.mean_length),
            "95 % of bars within (%)": digits(100 * errors.p95_length),
            "Pairs behind a camera": f"{int(np.isnan(errors.reprojection_px).sum())}",
        }
        for name, errors in calibration.errors.items()
    }
    title = f"All frames{f' but the {left_out} left out' if left_out else ''}{held_out}"
    return pd.DataFrame(columns).rename_axis(title)


def angles_table(calibration: Calibration) -> pd.DataFrame:
    """Angles, baseline and cost of each set, and how its computation ended."""
    every: dict[Method, tuple[MethodResult | RefinedResult, int]]
    every = {name: (result, result.evaluations) for name, result in calibration.methods.items()}
    if (refined := calibration.refined) is not None:
        every["refined"] = refined, refined.steps
    columns = {}
    for name, (result, evaluations) in every.items():
        angles = zip(ANGLE_TITLES.values(), np.degrees(result.pose.angles), strict=True)
        columns[METHOD_NAMES[name]] = {
            **{title: f"{degrees:.4f}" for title, degrees in angles},
            "Baseline (m)": f"{result.pose.baseline:.4f}",
            "Cost": f"{digits(result.cost)} {COST_UNITS[name]}".strip(),
            "Evaluations of the cost": f"{evaluations}",
            "Time (ms)": digits(1000 * result.seconds, 2),
            "Stopped because": result.stop_reason,
        }
    return pd.DataFrame(columns).rename_axis("Parameters")


def refined_table(result: RefinedResult) -> pd.DataFrame:
    """The refined set with its standard errors: angles in degrees, lengths in m, lenses in px."""
    lines = {}
    errors = errors_of_set(result)
    for name, value in errors.items():
        title, scale, decimals = "Baseline (m)", 1.0, 4
        if name in ANGLE_TITLES:
            title, scale = ANGLE_TITLES[name], 180 / math.pi
        elif name != "baseline_m":
            camera, key = name.split("_")
            title, decimals = f"{LENS_TITLES[key[0]]} {key}, {camera} camera (px)", 2
        error = "held" if value.sigma == 0 else f"± {digits(scale * value.sigma, 2)}"
        lines[title] = {"Value": f"{scale * value.value:.{decimals}f}", "Standard error": error}
    largest = math.degrees(largest_turn_sigma(result.at, result.covariance))
    if max(math.degrees(errors[name].sigma) for name in ANGLE_TITLES) > POLE * largest:
        lines["Largest error as a rotation (°)"] = {
            "Value": "",
            "Standard error": f"± {digits(largest, 2)}",
        }
    bar = result.dataset.target_distance_m
    lines["Distance A–B (m)"] = {
        "Value": f"{bar * result.bar_factor:.5f}",
        "Standard error": f"± {digits(bar * math.sqrt(result.covariance[FACTOR, FACTOR]), 2)}",
    }
    return pd.DataFrame(lines).T.rename_axis("Refined set")


def contents_table(dataset: Pair) -> pd.DataFrame:
    """The contents of a data set, one row per quantity."""
    rows, lengths_m = dataset.correspondences, dataset.bar_distances_m
    frames, of_object = rows.frames, rows.rigid_object is not None
    single = 0 if of_object else len(frames) - len(rows.bars)
    serving = f" ({single:,} with one target serve the 2D method only)" if single else ""
    baseline = f"{dataset.baseline_m:g} m"
    if dataset.baseline_is_free:
        baseline = f"{rounded(dataset.baseline_m, 4)} m, found from the known lengths"
    distance = f"{lengths_m[0] if len(lengths_m) else dataset.target_distance_m:g} m"
    if len(lengths_m) and np.ptp(lengths_m) > 0:
        by_frame = "" if of_object else ", by frame"
        distance = f"{lengths_m.min():g} to {lengths_m.max():g} m{by_frame}"
    lines = {
        "Frames": f"{len(frames):,} (numbers {frames[0]} to {frames[-1]})",
        "Pairs of points": f"{len(rows):,}",
        "Known distances"
        if of_object
        else "Frames with both targets": f"{len(rows.bars):,}{serving}",
        "Primary image": dataset.primary.in_words,
        "Secondary image": dataset.secondary.in_words,
        "Baseline": baseline,
        "Length of the known distances" if of_object else "Distance between the targets": distance,
    }
    return pd.DataFrame({"Read": lines}).rename_axis("What")


def forecast_table(
    entries: Mapping[Method, ForecastEntries], thresholds: Mapping[Method, float | None]
) -> pd.DataFrame:
    """What each file will do on frames to come; a row for each figure.

    Args:
        entries: as the files have them.
        thresholds: of the files, px: a file has one, and the forecast has no other.
    """
    columns = {}
    for method, figures in entries.items():
        in_file = thresholds.get(method)
        columns[METHOD_NAMES[method]] = {
            row: _forecast(stated_in(figures, name), name)
            for row, name in FORECAST_ROWS.items()
            if row != THRESHOLD_ROW
        } | {THRESHOLD_ROW: "" if in_file is None else digits(in_file, 2)}
    title = "On frames to come (95 % intervals)"
    return pd.DataFrame(columns).loc[list(FORECAST_ROWS)].rename_axis(title)


def plan_table(forecast: PlanForecast) -> pd.DataFrame:
    """What each file of a planned field day will do; a row for each figure."""
    columns = {
        METHOD_NAMES[method]: {
            row: _forecast(forecast.estimate(method, name), name)
            for row, name in FORECAST_ROWS.items()
            if not name.endswith("_3d")  # of length errors the one that the headline says
        }
        | {METRIC_ROW: _forecast(forecast.metric_p95(method), "")}
        for method in FILE_METHODS
    }
    return pd.DataFrame(columns).rename_axis("Mean over field days (95 % of them)")


def _forecast(estimate: Estimate, name: str) -> str:
    if not name.endswith("_px"):
        return _with_interval(estimate)
    value, low, high = (digits(v, 2) for v in (estimate.value, estimate.low, estimate.high))
    return f"{value} ({low} to {high})"


def validation_table(summaries: Mapping[Method, MethodSummary]) -> pd.DataFrame:
    """The validation figures as text: one column per method, one row per quantity."""
    standing = {quantity: standings(summaries, quantity) for quantity in COLUMNS}
    columns = {}
    for method in in_order(summaries):
        summary, overlap = summaries[method], "Overlap of correct and wrong pairs (FCP)"
        residual, matching, lengths = summary.residual, summary.reprojection, summary.reconstruction
        bars, behind = lengths.pdf, f"{matching.correct.nans} and {matching.wrong.nans}"
        of_residual, of_matching, of_lengths = (standing[name].get(method, "") for name in COLUMNS)
        columns[METHOD_NAMES[method]] = {
            f"{overlap}, residual (%)": _with_interval(summary.main("residual"), of_residual),
            f"{overlap}, reprojection error (%)": _with_interval(
                summary.main("reprojection"), of_matching
            ),
            "Recommended threshold, residual (no unit)": digits(residual.threshold),
            "Recommended threshold, reprojection error (px)": digits(matching.threshold),
            "Correct pairs lost at that threshold (%)": percent(matching.correct_lost),
            "Wrong pairs accepted at that threshold (%)": percent(matching.wrong_let_in),
            "3D error of the bars, median (%)": _with_interval(
                summary.main("reconstruction"), of_lengths
            ),
            "95 % of bars within (%)": percent(lengths.p95),
            "3D error of the bars, mean (%)": percent(lengths.mean),
            "Bars with a 3D error above 1 % (%)": percent(lengths.fraction_above_1_percent),
            "Spread of the lengths, blind to scale (wand score, %)": digits(lengths.wand_score, 2),
            "Error of the scale (mean length error, %)": percent(lengths.mean_length_error),
            "Correct pairs counted": f"{matching.correct.n}",
            "Wrong pairs counted": f"{matching.wrong.n}",
            "Pairs behind a camera, correct and wrong": behind,
            "Residuals of zero": f"{residual.correct.zeros + residual.wrong.zeros}",
            "Reprojection errors of zero": f"{matching.correct.zeros + matching.wrong.zeros}",
            "Bars counted": f"{max(bars.n, bars.nans)}",
            "Bars without value": f"{bars.nans}",
            "3D errors of zero": f"{bars.zeros}",
        }
    title = f"Held-out frames. {note_on_intervals(summaries)}"
    return pd.DataFrame(columns).rename_axis(title)


def _with_interval(estimate: Estimate, standing: str = "") -> str:
    if not math.isfinite(estimate.value):
        return "none"
    among = f" ({interval(estimate)})" if math.isfinite(estimate.low) else ""
    return ", ".join(filter(None, [f"{percent(estimate.value)}{among}", standing]))
