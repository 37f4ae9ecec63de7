"""Results in words and tables for the user, with units and significant digits."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pandas as pd

from stereocal.calibration.methods import ALL_METHODS, COST_UNITS, METHOD_NAMES, METHODS, Method
from stereocal.calibration.results import MethodResult
from stereocal.evaluation.summary import Estimate, MethodSummary, best_methods
from stereocal.figures.validation_panels import COLUMNS, Standing, standings
from stereocal.refined.refine import RefinedResult
from stereocal.refined.results import Calibration
from stereocal.refined.two_views import BAR
from stereocal.refined.uncertainty import standard_errors
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import RigParameters
from stereocal.system.numbers import rounded
from stereocal.verdict.in_words import digits, interval, percent

LENS_TITLES = {
    "fx": "Focal length fx",
    "fy": "Focal length fy",
    "cx": "Image centre cx",
    "cy": "Image centre cy",
}
ANGLE_TITLES = {
    "yaw": "Yaw α (degrees)",
    "pitch": "Pitch β (degrees)",
    "roll": "Roll γ (degrees)",
    "delta": "Direction of the baseline δ (degrees)",
    "epsilon": "Direction of the baseline ε (degrees)",
}


def errors_table(calibration: Calibration) -> pd.DataFrame:
    """The errors of the paper's methods on all frames not left out."""
    return pd.DataFrame(
        {
            METHOD_NAMES[name]: {
                "Mean reprojection error (px)": digits(errors.mean_reprojection_px),
                "Mean bar length error (%)": digits(100 * errors.mean_length),
                "95 % of bars within (%)": digits(100 * errors.p95_length),
                "Pairs behind a camera": f"{int(np.isnan(errors.reprojection_px).sum())}",
            }
            for name, errors in calibration.errors.items()
        }
    ).rename_axis(_frames_in_words(calibration))


def _frames_in_words(calibration: Calibration) -> str:
    held_out = ", fitted and held out" if len(calibration.held_out_frames) else ""
    left_out = len(calibration.screening.left_out)
    return f"All frames{f' but the {left_out} left out' if left_out else ''}{held_out}"


def angles_table(calibration: Calibration) -> pd.DataFrame:
    """Angles, baseline and cost of each set, and how its computation ended."""
    columns = {
        METHOD_NAMES[name]: _column(found.pose, name, found, found.evaluations)
        for name, found in calibration.methods.items()
    }
    if (refined := calibration.refined) is not None:
        columns[METHOD_NAMES["refined"]] = _column(refined.pose, "refined", refined, refined.steps)
    return pd.DataFrame(columns).rename_axis("Parameters")


def _column(
    pose: Pose, name: Method, found: MethodResult | RefinedResult, evaluations: int
) -> dict[str, str]:
    angles = pose.angles
    return {
        **{
            title: f"{math.degrees(getattr(angles, key)):.4f}"
            for key, title in ANGLE_TITLES.items()
        },
        "Baseline (m)": f"{pose.baseline:.4f}",
        "Cost": f"{digits(found.cost)} {COST_UNITS[name]}".strip(),
        "Evaluations of the cost": f"{evaluations}",
        "Time (ms)": digits(1000 * found.seconds, 2),
        "Stopped because": found.stop_reason,
    }


def refined_table(result: RefinedResult) -> pd.DataFrame:
    """The refined set with its standard errors: angles in degrees, lengths in m, lenses in px."""
    lines = {}
    for name, value in standard_errors(result).items():
        if name in ANGLE_TITLES:
            title, scale = ANGLE_TITLES[name], 180 / math.pi
        elif name == "baseline_m":
            title, scale = "Baseline (m)", 1.0
        else:
            camera, key = name.split("_")
            title, scale = f"{LENS_TITLES[key]}, {camera} camera (px)", 1.0
        error = "held" if value.sigma == 0 else f"± {digits(scale * value.sigma, 2)}"
        decimals = 4 if scale != 1.0 or name == "baseline_m" else 2
        lines[title] = {"Value": f"{scale * value.value:.{decimals}f}", "Standard error": error}
    bar = result.dataset.target_distance_m
    lines["Distance A–B (m)"] = {
        "Value": f"{bar * result.bar_factor:.5f}",
        "Standard error": f"± {digits(bar * math.sqrt(result.covariance[BAR, BAR]), 2)}",
    }
    return pd.DataFrame(lines).T.rename_axis("Refined set")


def parameters_table(rig: RigParameters) -> pd.DataFrame:
    """One set of parameters: angles in degrees, baseline in m, lenses in px."""
    lines = {
        ANGLE_TITLES[name]: f"{math.degrees(value):.4f}"
        for name, value in rig.pose.angles._asdict().items()
    }
    lines["Baseline (m)"] = f"{rig.pose.baseline:.4f}"
    for which, camera in (("primary", rig.primary), ("secondary", rig.secondary)):
        K = camera.K
        for key, value in zip(LENS_TITLES, (K[0, 0], K[1, 1], K[0, 2], K[1, 2]), strict=True):
            lines[f"{LENS_TITLES[key]}, {which} camera (px)"] = f"{value:.2f}"
    return pd.DataFrame({"Value": lines}).rename_axis("Parameter")


def contents_table(dataset: Dataset) -> pd.DataFrame:
    """The contents of a data set, one row per quantity."""
    rows = dataset.correspondences
    frames = rows.frames
    primary, secondary = dataset.primary, dataset.secondary
    of_object = rows.rigid_object is not None
    single = 0 if of_object else len(frames) - len(rows.bars)
    lines = {
        "Frames": f"{len(frames)} (numbers {frames[0]} to {frames[-1]})",
        "Pairs of points": f"{len(rows)}",
        "Known distances" if of_object else "Frames with both targets": f"{len(rows.bars)}"
        + (f" ({single} with one target serve the 2D method only)" if single else ""),
        "Primary image": f"{primary.image_size[0]} × {primary.image_size[1]} px, focal length "
        f"{primary.K[0, 0]:.1f} px",
        "Secondary image": f"{secondary.image_size[0]} × {secondary.image_size[1]} px, focal "
        f"length {secondary.K[0, 0]:.1f} px",
        "Baseline": f"{rounded(dataset.baseline_m, 4)} m, found from the known lengths"
        if dataset.baseline_is_free
        else f"{dataset.baseline_m:g} m",
        "Length of the known distances" if of_object else "Distance between the targets": (
            _distances(dataset)
        ),
    }
    return pd.DataFrame({"Read": lines}).rename_axis("What")


def _distances(dataset: Dataset) -> str:
    own = dataset.bar_distances_m
    by_frame = ", by frame" if dataset.correspondences.rigid_object is None else ""
    if len(own) and np.ptp(own) > 0:
        return f"{own.min():g} to {own.max():g} m{by_frame}"
    return f"{own[0] if len(own) else dataset.target_distance_m:g} m"


def validation_table(summaries: Mapping[Method, MethodSummary]) -> pd.DataFrame:
    """The validation figures as text: one column per method, one row per quantity."""
    standing = {quantity: standings(summaries, quantity) for quantity in COLUMNS}
    return pd.DataFrame(
        {
            METHOD_NAMES[method]: {
                **_matching_column(
                    summaries[method],
                    standing["residual"].get(method, ""),
                    standing["reprojection"].get(method, ""),
                ),
                **_measuring_column(summaries[method], standing["reconstruction"].get(method, "")),
                **_counts_column(summaries[method]),
            }
            for method in ALL_METHODS
            if method in summaries
        }
    ).rename_axis("Held-out frames; in brackets 95 % intervals; level: they overlap")


def _matching_column(
    summary: MethodSummary, by_residual: Standing, by_reprojection: Standing
) -> dict[str, str]:
    looks_right = "How often a wrong pair looks right (FCP)"
    residual, matching = summary.residual, summary.reprojection
    return {
        f"{looks_right}, residual (%)": _with_interval(residual.fcp, by_residual),
        f"{looks_right}, reprojection error (%)": _with_interval(matching.fcp, by_reprojection),
        "Recommended threshold, residual (no unit)": digits(residual.threshold),
        "Recommended threshold, reprojection error (px)": digits(matching.threshold),
        "Correct pairs lost at that many px (%)": percent(matching.correct_lost),
        "Wrong pairs let in at that many px (%)": percent(matching.wrong_let_in),
    }


def _measuring_column(summary: MethodSummary, standing: Standing) -> dict[str, str]:
    lengths = summary.reconstruction
    return {
        "3D error of the bars, median (%)": _with_interval(lengths.median, standing),
        "95 % of bars within (%)": percent(lengths.p95),
        "3D error of the bars, mean (%)": percent(lengths.mean),
        "Bars with a 3D error above 1 % (%)": percent(lengths.fraction_above_1_percent),
        "Spread of the lengths, blind to scale (wand score, %)": digits(lengths.wand_score, 2),
        "Error of the scale (mean length error, %)": percent(lengths.mean_length_error),
    }


def _counts_column(summary: MethodSummary) -> dict[str, str]:
    residual, matching = summary.residual, summary.reprojection
    bars = summary.reconstruction.pdf
    return {
        "Correct pairs counted": f"{matching.correct.n}",
        "Wrong pairs counted": f"{matching.wrong.n}",
        "Pairs behind a camera, correct and wrong": f"{matching.correct.nans} and "
        f"{matching.wrong.nans}",
        "Residuals of zero": f"{residual.correct.zeros + residual.wrong.zeros}",
        "Reprojection errors of zero": f"{matching.correct.zeros + matching.wrong.zeros}",
        "Bars counted": f"{max(bars.n, bars.nans)}",
        "Bars without value": f"{bars.nans}",
        "3D errors of zero": f"{bars.zeros}",
    }


def validation_answer(summaries: Mapping[Method, MethodSummary]) -> str:
    """Which set to match with, at which threshold, and which to measure with, with their errors.

    The 2D set is recommended for matching and the 3D set for measuring if they are best, or if
    their intervals overlap that of the best. The refined set has a separate sentence.
    """
    paper = {method: summaries[method] for method in METHODS if method in summaries}
    answer = _answer_of(paper)
    if "refined" in summaries:
        refined = summaries["refined"]
        answer += (
            f" The one refined set does both: at {digits(refined.reprojection.threshold, 2)} px "
            f"{percent(refined.reprojection.wrong_let_in)} % of wrong pairs are accepted, and 95 % "
            f"of bars are within {percent(refined.reconstruction.p95)} %."
        )
    return answer


def _answer_of(summaries: Mapping[Method, MethodSummary]) -> str:
    best = best_methods(summaries)
    fcps = {method: summary.reprojection.fcp for method, summary in summaries.items()}
    medians = {method: summary.reconstruction.median for method, summary in summaries.items()}
    match = _recommended(fcps, best["reprojection"], "2d")
    matching = summaries[match].reprojection
    first = (
        f"Match with {_name(match)} at {digits(matching.threshold, 2)} px: "
        f"{percent(matching.wrong_let_in)} % of wrong pairs are accepted and "
        f"{percent(matching.correct_lost)} % of correct ones are lost."
    )
    measure = _recommended(medians, best["reconstruction"], "3d")
    if not math.isfinite(medians[measure].value):
        return f"{first} No bar could be measured."
    lengths = summaries[measure].reconstruction
    return f"{first} Measure with {_name(measure)}: 95 % of bars within {percent(lengths.p95)} %."


def _recommended(found: Mapping[Method, Estimate], best: Method, made_for_it: Method) -> Method:
    own, least = found.get(made_for_it), found[best]
    overlap = own is not None and own.low <= least.high and least.low <= own.high
    return made_for_it if overlap else best


def _name(method: Method) -> str:
    return "the essential matrix" if method == "essential" else f"the {METHOD_NAMES[method]}"


def _with_interval(estimate: Estimate, standing: Standing) -> str:
    if not math.isfinite(estimate.value):
        return "none"
    return ", ".join(filter(None, [f"{percent(estimate.value)} ({interval(estimate)})", standing]))
