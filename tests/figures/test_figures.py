"""The figures show the numbers of the result."""

from dataclasses import replace
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest

from stereocal.calibration.methods import METHODS, Method
from stereocal.calibration.montecarlo import Trace
from stereocal.figures.coverage import plot_coverage
from stereocal.figures.frame_errors import describe_frame_errors, plot_frame_errors
from stereocal.figures.rig import plot_rig
from stereocal.figures.style import METHOD_COLOURS, METHOD_NAMES, METHOD_SYMBOLS, TARGET_COLOURS
from stereocal.figures.traces import MAXIMUM_DRAWN, drawn_moves, plot_traces
from stereocal.fit.results import Calibration
from stereocal.fit.screening.outliers import frame_reprojection_px
from stereocal.rig.geometry import triangulate_rays
from tests.fit.test_outliers import MIXED_UP, make_calibration
from tests.rigs import known_rig as rig


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return make_calibration(noise_px=0.2, shift_px=10.0)


def traces_of(figure: go.Figure, **wanted: Any) -> list[Any]:
    return [t for t in figure.data if all(t[name] == value for name, value in wanted.items())]


def with_traces(calibration: Calibration, trace: Trace | None) -> Calibration:
    found = {name: replace(method, trace=trace) for name, method in calibration.methods.items()}
    return replace(calibration, methods=found)


def test_coverage_shows_the_points_of_both_images(calibration: Calibration) -> None:
    rows = calibration.dataset.correspondences
    figure = plot_coverage(calibration.dataset)
    for number, target in enumerate("AB"):
        for axis, points in (("x", rows.primary), ("x2", rows.secondary)):
            (trace,) = traces_of(figure, legendgroup=target, xaxis=axis)
            np.testing.assert_array_equal(trace.x, points[rows.target == number, 0])
            np.testing.assert_array_equal(trace.y, points[rows.target == number, 1])
            np.testing.assert_array_equal(trace.customdata, rows.frame[rows.target == number])
            assert trace.marker.color == TARGET_COLOURS[target]
            assert f"n = {(rows.target == number).sum()}" in trace.name
    symbols = {t.legendgroup: t.marker.symbol for t in figure.data if t.mode == "markers"}
    assert symbols["A"] != symbols["B"]


def test_traces_show_cost_step_and_ratio(calibration: Calibration) -> None:
    figure = plot_traces(calibration)
    panels: dict[Method, tuple[str, ...]] = {"2d": ("y", "y3", "y4"), "3d": ("y2", "y3", "y4")}
    for method in panels:
        trace = calibration.methods[method].trace
        assert trace is not None
        moves = drawn_moves(len(trace.cost))
        for axis, values in zip(
            panels[method], (trace.cost, trace.delta, trace.ratio), strict=True
        ):
            (line,) = traces_of(figure, legendgroup=method, yaxis=axis)
            np.testing.assert_array_equal(line.x, moves + 1)
            np.testing.assert_array_equal(line.y, values[moves])
            assert line.line.color == METHOD_COLOURS[method]


def test_long_traces_are_thinned_and_keep_their_ends(calibration: Calibration) -> None:
    assert drawn_moves(MAXIMUM_DRAWN).tolist() == list(range(MAXIMUM_DRAWN))
    kept = drawn_moves(1_000_003)
    assert len(kept) == MAXIMUM_DRAWN
    assert (kept[0], kept[-1]) == (0, 1_000_002)
    assert (np.diff(kept) > 0).all()
    long = Trace(np.linspace(5, 1, 90_001), np.geomspace(1e-3, 1e-6, 90_001), np.zeros(90_001))
    line = plot_traces(with_traces(calibration, long)).data[0]
    assert (len(line.x), line.x[0], line.x[-1]) == (MAXIMUM_DRAWN, 1, 90_001)
    assert (line.y[0], line.y[-1]) == (5, 1)


def test_frame_errors_are_those_of_the_result_and_held_out_ones_open(
    calibration: Calibration,
) -> None:
    figure = plot_frame_errors(calibration)
    rows = calibration.dataset.correspondences
    bar_frames = rows.frame[rows.bars[:, 0]]
    for method in METHODS:
        for axis, frames, values in (
            ("y", rows.frames, frame_reprojection_px(calibration, method)),
            ("y2", bar_frames, 100 * calibration.errors[method].length),
        ):
            traces = traces_of(figure, legendgroup=method, yaxis=axis)
            shown = {k: y for t in traces for k, y in zip(t.customdata, t.y, strict=True)}
            assert shown == dict(zip(frames, values, strict=True))
            assert {t.marker.color for t in traces} == {METHOD_COLOURS[method]}
            assert {t.name for t in traces} == {METHOD_NAMES[method]}
    for method in METHODS:
        filled, opened, dotted = traces_of(figure, legendgroup=method, yaxis="y")
        assert filled.marker.symbol == METHOD_SYMBOLS[method]
        assert opened.marker.symbol == METHOD_SYMBOLS[method] + "-open"
        assert set(filled.customdata) == set(calibration.frames)
        assert not set(opened.customdata) & set(calibration.frames)
        assert len(opened.x) == 4
        assert dotted.marker.symbol == METHOD_SYMBOLS[method] + "-open-dot"
        assert set(dotted.customdata) == {MIXED_UP}
    names = [t.name for t in figure.data]
    assert "Open: held out (n = 4)" in names
    assert "Dotted: left out (n = 1)" in names


def test_the_outlying_frame_is_named(calibration: Calibration) -> None:
    labels = traces_of(plot_frame_errors(calibration), mode="text", yaxis="y")
    assert [(list(t.text), list(t.x)) for t in labels] == [([f"<b>{MIXED_UP}</b>"], [MIXED_UP])]
    assert f"standing out: {MIXED_UP}" in describe_frame_errors(calibration)


@pytest.mark.parametrize("method", METHODS)
def test_rig_shows_the_reconstructed_bars(calibration: Calibration, method: Method) -> None:
    dataset, pose = calibration.dataset, calibration.methods[method].pose
    points = triangulate_rays(pose.R, pose.T, dataset.rays)
    (bars,) = [t for t in plot_rig(calibration, method).data if t.name.startswith("Bars")]
    path = np.column_stack([bars.x, bars.y, bars.z]).reshape(-1, 4, 3)
    ends = points[dataset.correspondences.bars]
    np.testing.assert_array_equal(path[:, 0], ends[:, 0][:, [0, 2, 1]] * [1, 1, -1])
    np.testing.assert_array_equal(path[:, 2], ends[:, 1][:, [0, 2, 1]] * [1, 1, -1])
    lengths = np.linalg.norm(path[:, 0] - path[:, 2], axis=1)
    error = calibration.errors[method].length
    np.testing.assert_allclose(np.abs(lengths - rig.BAR_M) / rig.BAR_M, error, atol=1e-12)
    assert bars.text[0] == f"frame 2<br>length {lengths[0]:.4f} m, error {100 * error[0]:.2f} %"
    assert bars.line.color == METHOD_COLOURS[method]
    assert "n = 24" in bars.name


def test_rig_places_the_cameras(calibration: Calibration) -> None:
    pose = calibration.methods["3d"].pose
    figure = plot_rig(calibration, "3d")
    (centre,) = traces_of(figure, name="optical centre, secondary")
    assert centre.text == ("secondary",)
    there = np.array([centre.x[0], -centre.z[0], centre.y[0]])
    np.testing.assert_allclose(pose.apply(there), 0, atol=1e-12)
    assert traces_of(figure, name="optical centre, primary")[0].x[0] == 0
    (baseline,) = traces_of(figure, name="Baseline 2.370 m")
    assert np.linalg.norm([np.ptp(baseline[axis]) for axis in "xyz"]) == pytest.approx(2.37)
    for name, camera in (
        ("primary", calibration.dataset.primary),
        ("secondary", calibration.dataset.secondary),
    ):
        (frustum,) = traces_of(figure, name=f"{name} camera")
        path = np.column_stack([frustum.x, -np.array(frustum.z), frustum.y])
        own = path if name == "primary" else pose.apply(path)
        pixels = own[1] / own[1, 2] @ camera.K.T
        np.testing.assert_allclose(pixels[:2], [-0.5, -0.5], atol=1e-6)
