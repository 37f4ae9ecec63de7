"""Figures of a lens and of the refined method: what they draw, and the same in words."""

import re
from pathlib import Path
from typing import get_args

import cv2
import numpy as np
import pytest

from stereocal.figures import one_set
from stereocal.figures.accuracy import Quantity, describe_accuracy, plot_accuracy
from stereocal.figures.lens import (
    arrow_scale,
    describe_draws,
    describe_residual_field,
    plot_draws,
    plot_residual_field,
)
from stereocal.fit.errors.disagreement import ACCUSED, compare_inputs
from stereocal.fit.errors.uncertainty import Plane, accuracy_map
from stereocal.fit.least_squares.unknowns import FIXED_LENS, RefineSettings
from stereocal.fit.refine import refine
from stereocal.formats.dataset_files import read_dataset
from stereocal.intrinsics.quality import lens_residuals, preview, typical_and_noise_px
from stereocal.rig.camera import CAMERAS
from tests.figures.every_figure import refined_field
from tests.files import encoded
from tests.intrinsics.test_intrinsics import FEW, usual
from tests.photographs.lens import facing, photographed
from tests.sample_field import FIELD


def test_every_draw_is_in_its_histogram() -> None:
    lens = usual()
    histograms = [trace for trace in plot_draws(lens).data if trace.type == "histogram"]
    assert len(histograms) == 9
    for at, trace in enumerate(histograms):
        np.testing.assert_array_equal(trace.x, lens.draws[:, at])
        assert trace.xbins.start <= trace.x.min() and trace.xbins.end >= trace.x.max()
    assert f"{FEW.repeats} calibrations, each with {FEW.subset} of 30" in describe_draws(lens)


def test_arrows_are_the_mean_residuals_enlarged() -> None:
    lens = usual()
    field = lens_residuals(lens)
    scale = arrow_scale([field])
    figure = plot_residual_field(lens)
    arrows = next(trace for trace in figure.data if trace.type == "scatter")
    said = re.search(r"an arrow over ([\d.]+) px is ([\d.]+) px", figure.layout.xaxis.title.text)
    assert said and float(said[1]) == pytest.approx(scale * float(said[2]))
    known = field.known
    drawn = np.column_stack([arrows.x, arrows.y]).reshape(-1, 3, 2)
    np.testing.assert_allclose(drawn[:, 0], field.centres[known])
    np.testing.assert_allclose((drawn[:, 1] - drawn[:, 0]) / scale, field.mean[known], atol=1e-12)
    assert np.abs(drawn[:, 1] - drawn[:, 0]).max() <= 640 / 16
    assert f"{typical_and_noise_px(lens)[0]:.3f} px" in describe_residual_field(lens)


def test_preview_takes_the_distortion_away(tmp_path: Path) -> None:
    """An edge of the board is straight in the second picture and bent in the first."""
    lens = usual()
    path = tmp_path / "board.png"
    path.write_bytes(encoded(photographed(facing(tilt=0.0, distance_m=0.42))))
    marked, straight = (
        cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE)
        for content in preview(path, lens.camera, lens.search.views[0])
    )
    assert marked is not None and straight is not None
    assert marked.shape == straight.shape == (675, 900)

    def bend(picture: np.ndarray[tuple[int, ...], np.dtype[np.uint8]]) -> float:
        found, corners = cv2.findChessboardCornersSB(picture, (8, 6))
        assert found
        row = np.asarray(corners).reshape(6, 8, 2)[0]
        line = np.polyfit(row[:, 0], row[:, 1], 1)
        return float(np.abs(np.polyval(line, row[:, 0]) - row[:, 1]).max())

    plain, _ = preview(path, lens.camera, None)
    as_taken = cv2.imdecode(np.frombuffer(plain, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert as_taken is not None
    # Measured: 1.9 px and 0.1 px.
    assert bend(np.asarray(straight, dtype=np.uint8)) < 0.4
    assert bend(np.asarray(as_taken, dtype=np.uint8)) > 1.0


@pytest.mark.parametrize(("quantity", "unit"), [("distance", " %"), ("point", " mm")])
def test_accuracy_shows_both_maps_cameras_and_targets(quantity: Quantity, unit: str) -> None:
    result = refined_field()
    maps = [accuracy_map(result, 20, plane) for plane in get_args(Plane)]
    figure = plot_accuracy(maps, result, quantity)
    centre = -result.pose.R.T @ result.pose.T
    for at, (found, axis) in enumerate(zip(maps, (0, 1), strict=True)):
        heat, cameras, targets = figure.data[3 * at : 3 * at + 3]
        values = 100 * found.distance if quantity == "distance" else 1000 * found.point_m
        np.testing.assert_allclose(10**heat.z, values.T)
        np.testing.assert_allclose([cameras.x[1], cameras.y[1]], [centre[2], centre[axis]])
        assert len(targets.x) == 50
        assert heat.yaxis == targets.yaxis == ("y2" if at else "y")
    words = describe_accuracy(maps, quantity)
    median = np.nanmedian([100 * m.distance if unit == " %" else 1000 * m.point_m for m in maps])
    assert f"{median:.2g}{unit} (median)" in words


def test_an_accused_input_stands_out() -> None:
    wrong = read_dataset(FIELD).changed(baseline_m=4.7)
    inputs = compare_inputs(refine(wrong, RefineSettings(baseline_sigma_m=0.005))).inputs
    figure = one_set.plot_disagreement(inputs)
    bars = figure.data[0]
    assert list(bars.y)[-1] == "Baseline"
    assert bars.x[-1] > ACCUSED
    assert bars.marker.color[-1] != bars.marker.color[0]
    assert bars.marker.pattern.shape[-1] == "/" and bars.marker.pattern.shape[0] == ""
    assert figure.layout.shapes[0].x0 == ACCUSED
    assert "Baseline: stated 4.7 m" in one_set.describe_disagreement(inputs)


def test_the_table_of_inputs_says_stated_and_estimated() -> None:
    inputs = compare_inputs(refined_field()).inputs
    table = one_set.disagreement_table(inputs)
    assert len(table) == len(inputs) <= 8
    baseline = next(item for item in inputs if item.key == "baseline")
    row = table.loc["Baseline"]
    assert float(str(row["Stated"]).split()[0]) == pytest.approx(float(baseline.stated[0]))
    value, _, sigma, unit = str(row["Estimated"]).split()
    assert float(value) == pytest.approx(float(baseline.estimate[0]), abs=float(sigma))
    assert float(sigma) == pytest.approx(float(baseline.sigma[0]), rel=0.1) and unit == "m"
    held = compare_inputs(
        refine(read_dataset(FIELD), RefineSettings(lenses=dict.fromkeys(CAMERAS, FIXED_LENS)))
    ).inputs
    assert "held as stated" in set(one_set.disagreement_table(held)["Estimated"])
