"""Figures of long recordings: as large as those of short ones, and no large error is hidden."""

from __future__ import annotations

from typing import Any

import plotly.graph_objects as go
import pytest

from stereocal.figures import frame_errors, plot_coverage, plot_frame_errors, plot_rig, style
from stereocal.refined.results import Calibration
from tests.refined.test_outliers import make_calibration

MOST = 8


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return make_calibration(noise_px=0.2, shift_px=10.0)


def points_in(figure: go.Figure, **wanted: Any) -> int:
    """The largest number of points of a trace."""
    chosen = [t for t in figure.data if all(t[name] == value for name, value in wanted.items())]
    return max((len(trace.x) for trace in chosen), default=0)


def test_no_figure_draws_all_points(
    calibration: Calibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = len(calibration.dataset.correspondences.frames)
    assert frames > 3 * MOST
    markers = [
        plot_coverage(calibration.dataset),
        plot_frame_errors(calibration),
        plot_rig(calibration, "3d"),
    ]
    assert all(points_in(figure, mode="markers") > 2 * MOST for figure in markers)
    for module in (style, frame_errors):
        monkeypatch.setattr(module, "MOST_DRAWN", MOST)
    for figure in (
        plot_coverage(calibration.dataset),
        plot_frame_errors(calibration),
        plot_rig(calibration, "3d"),
    ):
        assert points_in(figure, mode="markers") <= 2 * MOST  # some targets are alone
        assert points_in(figure, mode="lines") <= 5 * MOST
        said = figure.to_json()
        assert f"{MOST} drawn" in said or "the worst" in said
