"""Results in words and in tables, for people: units said, digits that mean something."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd

from stereocal.calibrate import COST_UNITS, METHOD_NAMES, METHODS, Calibration, Method, errors_of
from stereocal.dataset import Dataset

ANGLE_TITLES = {
    "yaw": "Yaw α (degrees)",
    "pitch": "Pitch β (degrees)",
    "roll": "Roll γ (degrees)",
    "delta": "Direction of the baseline δ (degrees)",
    "epsilon": "Direction of the baseline ε (degrees)",
}


def results_table(calibration: Calibration) -> pd.DataFrame:
    """The three methods side by side: a column a method, a row a quantity, all as text."""
    return pd.DataFrame(
        {METHOD_NAMES[name]: _column(calibration, name) for name in METHODS}
    ).rename_axis(
        "All frames" if not len(calibration.held_out_frames) else "All frames, fitted and held out"
    )


def _column(calibration: Calibration, name: Method) -> dict[str, str]:
    found, errors = calibration.methods[name], calibration.errors[name]
    angles = found.pose.angles
    unit = COST_UNITS[name]
    return {
        "Mean reprojection error (px)": digits(errors.mean_reprojection_px),
        "Mean bar length error (%)": digits(100 * errors.mean_length),
        "95 % of bars within (%)": digits(100 * errors.p95_length),
        "Pairs behind a camera": f"{int(np.isnan(errors.reprojection_px).sum())}",
        **{
            title: f"{math.degrees(getattr(angles, key)):.4f}"
            for key, title in ANGLE_TITLES.items()
        },
        "Baseline (m)": f"{found.pose.baseline:.4f}",
        "Cost": f"{digits(found.cost)} {unit}".strip(),
        "Evaluations of the cost": f"{found.evaluations}",
        "Time (ms)": digits(1000 * found.seconds, 2),
        "Stopped because": found.stop_reason,
    }


def answer(calibration: Calibration) -> str:
    """The result in one or two sentences, on the held-out frames where there are any."""
    testing = calibration.held_out_frames
    dataset = calibration.dataset
    where = "the frames it was fitted to"
    if len(testing):
        dataset = dataset.of_frames(testing)
        where = f"{len(testing)} frames that took no part in the fit"
    matching = errors_of(dataset, calibration.methods["2d"].pose)
    measuring = errors_of(dataset, calibration.methods["3d"].pose)
    first = (
        f"To find which points belong together, use the 2D set: on {where}, points "
        f"reproject to within {digits(matching.mean_reprojection_px)} px on average."
    )
    if math.isnan(measuring.mean_length):
        return first
    return (
        f"{first} To measure, use the 3D set: bar lengths come out right to "
        f"{digits(100 * measuring.mean_length)} % on average, and 95 % of them within "
        f"{digits(100 * measuring.p95_length)} % (with the 2D set "
        f"{digits(100 * matching.mean_length)} % on average)."
    )


def contents_table(dataset: Dataset) -> pd.DataFrame:
    """What was read: a row a quantity."""
    rows = dataset.correspondences
    frames = rows.frames
    primary, secondary = dataset.primary, dataset.secondary
    single = len(frames) - len(rows.bars)
    lines = {
        "Frames": f"{len(frames)} (numbers {frames[0]} to {frames[-1]})",
        "Pairs of points": f"{len(rows)}",
        "Frames with both targets": f"{len(rows.bars)}"
        + (f" ({single} with one target serve the 2D method only)" if single else ""),
        "Primary image": f"{primary.image_size[0]} × {primary.image_size[1]} px, focal length "
        f"{primary.K[0, 0]:.1f} px",
        "Secondary image": f"{secondary.image_size[0]} × {secondary.image_size[1]} px, focal "
        f"length {secondary.K[0, 0]:.1f} px",
        "Baseline": f"{dataset.baseline_m:g} m",
        "Distance between the targets": _distances(dataset),
    }
    return pd.DataFrame({"Read": lines}).rename_axis("What")


def _distances(dataset: Dataset) -> str:
    own = dataset.bar_distances_m
    if len(own) and np.ptp(own) > 0:
        return f"{own.min():g} to {own.max():g} m, by frame"
    return f"{own[0] if len(own) else dataset.target_distance_m:g} m"


def digits(value: float, significant: int = 3) -> str:
    """A number with so many significant digits, without an exponent where it can be read."""
    if not math.isfinite(value):
        return "none"
    if value == 0 or 1e-4 <= abs(value) < 1e5:
        decimals = 0 if value == 0 else significant - 1 - math.floor(math.log10(abs(value)))
        return f"{value:.{max(0, decimals)}f}"
    return f"{value:.{significant - 1}e}"
