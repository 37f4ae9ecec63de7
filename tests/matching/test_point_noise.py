"""The noise of points, by the points: the threshold, and the errors of what they measure."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from stereocal.library.tables import match, reconstruct
from stereocal.matching.reconstruction import midpoints
from stereocal.matching.threshold import FramePixels, choose_threshold
from stereocal.matching.views import TwoViews
from stereocal.rig.parameters import RigParameters
from stereocal.system.array_types import FloatArray
from tests.further import further
from tests.rigs.known_rig import PRIMARY, RIG, SECONDARY, images

TARGETS_PX, OF_FILE_PX = 0.03, 0.1
PLAIN = RigParameters(PRIMARY, SECONDARY, RIG, "refined", 1.0, {}, {})
FILE = replace(PLAIN, matching_threshold_px=OF_FILE_PX, noise_px=TARGETS_PX)
PIXELS = ["u_primary", "v_primary", "u_secondary", "v_secondary"]


def seen(
    noise_px: float, frames: int = 150, points: int = 4, missing: float = 0.1
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Points of both cameras, shuffled, some of them missing; `bird` tells which is which."""
    rng = np.random.default_rng([1, round(1000 * noise_px)])
    sides: tuple[list[FloatArray], list[FloatArray]] = ([], [])
    for frame in range(frames):
        both = images(rng.uniform([-1.3, -1.1, 6.0], [1.3, 1.0, 10.5], (points, 3)))
        for side, pixels in zip(sides, both, strict=True):
            kept = rng.permutation(points)[rng.random(points) > missing]
            noisy = pixels[kept] + noise_px * rng.standard_normal((len(kept), 2))
            side.append(np.column_stack([np.full(len(kept), frame), noisy, kept]))
    whole = {"frame": np.int64, "bird": np.int64}
    first, second = (
        pd.DataFrame(np.concatenate(side), columns=["frame", "u", "v", "bird"]).astype(whole)
        for side in sides
    )
    return first, second


def sample(tables: tuple[pd.DataFrame, pd.DataFrame]) -> list[FramePixels]:
    """The frames of two tables."""
    pixels = [table[["u", "v"]].to_numpy() for table in tables]
    frames = [table["frame"].to_numpy() for table in tables]
    both = np.intersect1d(frames[0], frames[1])
    first, second = (
        [own[number == frame] for frame in both] for own, number in zip(pixels, frames, strict=True)
    )
    return list(zip(first, second, strict=True))


@pytest.mark.parametrize(
    ("noise", "points", "frames", "least"),
    # Measured: 99.2, 96.7 and 89 %; 2 px are much where points fill a third of the image.
    [(2.0, 4, 150, 0.96), (0.3, 100, 8, 0.85), *further((0.2, 4, 150, 0.98))],
)
def test_partners_are_found_whatever_the_noise(
    noise: float, points: int, frames: int, least: float
) -> None:
    """With the threshold of the targets, few of them."""
    tables = seen(noise, frames, points)
    chosen = choose_threshold(FILE, sample(tables))
    assert chosen.noise is not None and chosen.shares is not None
    # 600 points: a standard error of 3.3 %; measured within 6 %.
    assert chosen.noise.source == "estimated"
    assert chosen.noise.sigma_px == pytest.approx(noise, rel=0.12)
    assert 0.02 < chosen.noise.relative_error < 0.08
    # Errors of correct pairs are a half-normal of the noise over the root of 2.
    assert 3 < chosen.threshold_px / (noise / np.sqrt(2)) < 14
    pairs = match(FILE, *tables)
    right = (pairs["bird_primary"] == pairs["bird_secondary"]).sum()
    possible = len(tables[0].merge(tables[1], on=["frame", "bird"]))

    assert right / possible >= least
    assert 1 - right / len(pairs) <= chosen.shares.wrong + 0.015
    assert len(match(FILE, *tables, threshold_px=OF_FILE_PX)) < 0.7 * possible
    # What is measured has the standard errors of these points, not of the targets.
    assert pairs["sigma_primary_px"].eq(chosen.noise.sigma_px).all()
    pixels = pairs[PIXELS].to_numpy().reshape(-1, 2, 2)
    stated = midpoints(PLAIN, pixels, chosen.noise.sigma_px).in_frame(None, None, True).sigma_m
    measured = reconstruct(FILE, pairs)[["sigma_x", "sigma_y", "sigma_z"]]
    assert stated is not None
    np.testing.assert_allclose(measured, stated, rtol=1e-6)


def test_a_threshold_says_what_it_is_for() -> None:
    """The fewer points a frame has, the larger it is, so that it is not that of the file."""
    by_points = {n: sample(seen(0.5, points=n, missing=0.0)) for n in (1, 8)}
    few, many = (choose_threshold(FILE, frames) for frames in by_points.values())
    assert few.threshold_px > many.threshold_px
    of_file = f"in its file {OF_FILE_PX} px"
    assert f"px, chosen for 1 point a frame and the refined set ({of_file}, " in few.sentence()
    assert f"px, chosen for 8 points a frame and the refined set ({of_file}, " in many.sentence()
    assert few.shares is not None
    certain = replace(few, shares=replace(few.shares, lost=1e-5, wrong=1e-5)).sentence()
    assert "100" not in certain and "0.0 %" not in certain
    stated = choose_threshold(FILE, by_points[8], threshold_px=1.0)
    assert stated.threshold_px == 1.0 and "chosen for" not in stated.sentence()


def test_the_cut_of_the_threshold_does_not_bias_the_noise() -> None:
    """Pairs of 0.5 px below 2.8 standard deviations of their error; columns left out."""
    pairs = match(FILE, *seen(0.5), threshold_px=1.0)
    noise = TwoViews(FILE).noise_of(pairs[["frame", *PIXELS]])
    assert noise is not None and noise.source == "estimated"
    # Measured: 0.51.
    assert noise.sigma_px == pytest.approx(0.5, rel=0.12)


@pytest.mark.parametrize("by_columns", [False, True])
def test_a_stated_noise_is_taken_and_contradicted(by_columns: bool) -> None:
    """0.5 px stated as 0.1 px is taken as stated, and what the errors show is said beside it."""
    frames = sample(seen(0.5))
    if by_columns:
        frames = [
            (np.pad(a, ((0, 0), (0, 1)), constant_values=0.1), np.insert(b, 2, 0.1, axis=1))
            for a, b in frames
        ]
    chosen = choose_threshold(FILE, frames, sigma_px=None if by_columns else 0.1)
    assert chosen.noise is not None and chosen.noise.sigma_px == pytest.approx(0.1)
    assert chosen.noise.source == ("columns" if by_columns else "stated")
    # 600 points know it to 3 %. Measured: 0.51 px.
    assert chosen.noise.seen_px == pytest.approx(0.5, rel=0.12)
    honest = choose_threshold(FILE, sample(seen(0.5)), sigma_px=0.5).noise
    assert honest is not None and honest.seen_px is None
