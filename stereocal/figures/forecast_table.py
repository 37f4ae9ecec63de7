"""The forecast of all files as a table."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from stereocal.calibration.methods import METHOD_NAMES, Method
from stereocal.evaluation.summary import Estimate
from stereocal.field.planning.drawn_rigs import FILES
from stereocal.field.planning.forecast import PlanForecast
from stereocal.verdict.in_words import digits, interval, percent
from stereocal.verdict.predictive import Forecast, Predictive

PLAN_COLUMN = "Mean over field days (95 % of them)"
COLUMN = "On frames to come (95 % intervals)"


THRESHOLD = "threshold_px"
ROWS = {
    "Wrong pairs that look right, FCP (%)": "fcp_reprojection",
    "Reprojection error, mean (px)": "mean_reprojection_px",
    "Matching threshold (px)": THRESHOLD,
    "Length error, median (%)": "median_error_3d",
    "95 % of lengths within (%)": "p95_error_3d",
}


def forecast_table(
    predictive: Predictive, thresholds: Mapping[Method, float | None]
) -> pd.DataFrame:
    """What each file will do on frames to come; a row for each figure.

    Args:
        thresholds: of the files, px: a file has one, and the forecast has no other.
    """

    def cell(method: Method, own: Forecast, name: str) -> str:
        if name != THRESHOLD:
            return _cell(getattr(own, name), name)
        in_file = thresholds.get(method)
        return "" if in_file is None else digits(in_file, 2)

    return pd.DataFrame(
        {
            METHOD_NAMES[method]: [cell(method, own, name) for name in ROWS.values()]
            for method, own in predictive.forecasts.items()
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
