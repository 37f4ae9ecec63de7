"""The figures of a lens show its numbers, and its pictures its photographs."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from stereocal.figures.lens import (
    arrow_scale,
    describe_draws,
    describe_residual_field,
    plot_draws,
    plot_residual_field,
)
from stereocal.intrinsics.quality import lens_residuals, preview, typical_and_noise_px
from tests.intrinsics.test_intrinsics import FEW, usual
from tests.lens import facing, photographed, png


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
    arrows = next(trace for trace in plot_residual_field(lens).data if trace.type == "scatter")
    assert f"×{scale:g}" in arrows.name
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
    path.write_bytes(png(photographed(facing(tilt=0.0, distance_m=0.42))))
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
