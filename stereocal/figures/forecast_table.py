"""The forecast of all files as a table."""

from __future__ import annotations

import pandas as pd

from stereocal.calibration.methods import METHOD_NAMES
from stereocal.evaluation.summary import Estimate
from stereocal.field.planning.drawn_rigs import FILES
from stereocal.field.planning.forecast import PlanForecast
from stereocal.verdict.in_words import digits, interval, percent
from stereocal.verdict.predictive import Predictive

PLAN_COLUMN = "Mean over field days (95 % of them)"
COLUMN = "On frames to come (95 % intervals)"


ROWS = {
    "Wrong pairs that look right, FCP (%)": "fcp_reprojection",
    "Reprojection error, mean (px)": "mean_reprojection_px",
    "Matching threshold (px)": "threshold_px",
    "Length error, median (%)": "median_error_3d",
    "95 % of lengths within (%)": "p95_error_3d",
}


def forecast_table(predictive: Predictive) -> pd.DataFrame:
    """What each file will do on frames to come; a row for each figure."""
    found = predictive.forecasts
    return pd.DataFrame(
        {
            METHOD_NAMES[method]: [_cell(getattr(own, name), name) for name in ROWS.values()]
            for method, own in found.items()
        },
        index=pd.Index(list(ROWS), name=COLUMN),
    )


def plan_table(found: PlanForecast) -> pd.DataFrame:
    """What each file of a planned field day will do; a row for each figure."""
    return pd.DataFrame(
        {
            METHOD_NAMES[method]: [
                _cell(found.estimate(method, name), name) for name in ROWS.values()
            ]
            for method in FILES
        },
        index=pd.Index(list(ROWS), name=PLAN_COLUMN),
    )


def _cell(estimate: Estimate, name: str) -> str:
    if name.endswith("_px"):
        low, high = digits(estimate.low, 2), digits(estimate.high, 2)
        return f"{digits(estimate.value, 2)} ({low} to {high})"
    return f"{percent(estimate.value)} ({interval(estimate)})"
