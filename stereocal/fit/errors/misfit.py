"""Where in the images residuals are not noise: what tells a lens that is wrong.

The distances of the pairs from their epipolar lines, with their signs, are summed over the cells of
each image. Were they noise, the sign of each cluster of frames could as well be the other: random
signs show how large sums get by chance, with whatever runs and tails the noise has. What the fit
takes up of each cluster (its gradient times the covariance) is subtracted from its sums first:
without that, the random ones would be too large. (Simulated rigs without misfit: of 200 with 25
frames 2.5 % have a probability below 1 %, and 8 % one below 5 %; of 60 with 200 frames 3 and 3 %,
of 60 in runs of 40 frames 0 and 7 %; of 200 of fisheyes of 140 and 150 degrees, 40 frames, 4.5 and
10 %.)
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stereocal.fit.least_squares.small_steps import derivatives_by_rig
from stereocal.fit.refined_result import RefinedResult
from stereocal.rig.residual_field import ResidualField, cells_of, residual_field
from stereocal.system.array_types import FloatArray, IntArray

FEWEST_POINTS = 10
"""In a cell that has a mean."""
TYPICAL_POINTS = 20
"""By which the number of cells is chosen."""
MOST_ROWS = 10
MOST_GROUPS = 400
"""Neighbouring clusters are joined above this number, so that long recordings take no longer."""
MINIMUM_LEFT = 0.1
"""Share of the degrees of freedom, for recordings of a few frames."""
FLIPS = 999
SURE = 0.01
"""Probability below which noise is no explanation."""
LEVEL = 0.95
"""Of all cells together. Single cells are marked only where noise is no explanation."""


@dataclass(frozen=True, eq=False)
class Misfit:
    """Mean residuals across the epipolar lines over both images."""

    fields: tuple[ResidualField, ResidualField]
    """Of the primary and of the secondary: found minus fitted points."""
    shares: tuple[float, float]
    """Of the sum of squared residuals that the means of each image explain, beyond chance."""
    probability: float
    """That noise has means as large as these."""

    @property
    def is_sure(self) -> bool:
        """Whether the residuals are more than noise."""
        return self.probability < SURE


def misfit_of(result: RefinedResult) -> Misfit:
    """Where the residuals of the frames that were fitted are not noise."""
    table, used = result.dataset.correspondences, result.used_rows
    pixels = table.primary[used], table.secondary[used]
    fields = _fields(result, pixels)
    cells = [
        cells_of(points, field.image_size, field.count.shape[::-1])
        for points, field in zip(pixels, fields, strict=True)
    ]
    sums, by_chance = _sums_of_clusters(result, pixels, cells, [f.count.size for f in fields])
    known = np.concatenate([field.known.ravel() for field in fields])
    root = np.sqrt(np.concatenate([field.count.ravel() for field in fields])[known])
    seen, by_chance = sums[known] / root, by_chance[:, known] / root
    rng = np.random.default_rng([0, 0x515])
    flipped = rng.choice([-1.0, 1.0], (FLIPS, len(by_chance))) @ by_chance
    squares, chance = np.square(seen), np.square(flipped)
    probability = float((1 + np.sum(chance.sum(axis=1) >= squares.sum())) / (FLIPS + 1))
    spread = np.sqrt(np.square(by_chance).sum(axis=0))
    limit = np.quantile((np.abs(flipped) / spread).max(axis=1, initial=0.0), LEVEL)
    apart = (probability < SURE) & (np.abs(seen) > limit * spread)
    first = int(fields[0].known.sum())
    shares, total = [], np.square(result.rig.epipolar_errors(*pixels)).sum()
    for field, part in zip(fields, (slice(first), slice(first, None)), strict=True):
        field.apart[field.known] = apart[part]
        shares.append(max(float((squares - chance.mean(axis=0))[part].sum() / total), 0.0))
    return Misfit(fields, (shares[0], shares[1]), probability)


def _sums_of_clusters(
    result: RefinedResult,
    pixels: tuple[FloatArray, FloatArray],
    cells: Sequence[IntArray],
    counts: Sequence[int],
) -> tuple[FloatArray, FloatArray]:
    """Sums of the residuals over the cells (c,) of both images, and the part (g, c) of each group
    of frames in them, of which noise could have either sign.
    """
    table, used = result.dataset.correspondences, result.used_rows
    errors = result.rig.epipolar_errors(*pixels)
    clusters, groups = result.clusters, min(result.clusters.count, MOST_GROUPS)
    of_frames = clusters.of_frames * groups // clusters.count
    group = of_frames[np.searchsorted(result.frames[~result.outlying], table.frame[used])]
    # Derivatives and covariance in units of the standard errors.
    sigma = np.sqrt(np.diag(result.p_covariance_by_model))
    J = derivatives_by_rig(
        lambda rig: rig.epipolar_errors(*pixels), result.rig, result.unknowns.M * sigma
    )
    C = result.p_covariance_by_model / np.outer(sigma, sigma) / result.sigma_px.value**2
    steps = _sums(J * errors[:, None], group, groups) @ C
    parts = []
    for cell, count in zip(cells, counts, strict=True):
        of_groups = np.bincount(group * count + cell, errors, groups * count).reshape(groups, count)
        parts.append((of_groups.sum(axis=0), of_groups - steps @ _sums(J, cell, count).T))
    # Residuals are smaller than the noise by the degrees of freedom that the fit has absorbed.
    left = max(1.0 - float(np.sum((J @ C) * J)) / len(errors), MINIMUM_LEFT)
    sums, by_chance = (np.concatenate(part, axis=-1) for part in zip(*parts, strict=True))
    return sums, by_chance / np.sqrt(left)


def _fields(
    result: RefinedResult, pixels: tuple[FloatArray, FloatArray]
) -> tuple[ResidualField, ResidualField]:
    """The mean residuals of both cameras; with more points in smaller cells."""
    shifts, rows = result.rig.epipolar_residuals(*pixels), len(pixels[0]) / TYPICAL_POINTS
    rows = int(np.clip(round(np.sqrt(rows)), 2, MOST_ROWS))

    def field(camera: int, size: tuple[int, int]) -> ResidualField:
        grid = max(round(rows * size[0] / size[1]), 1), rows
        shift = shifts[:, 2 * camera : 2 * camera + 2]
        return residual_field(pixels[camera], shift, size, grid, FEWEST_POINTS)

    return field(0, result.primary.image_size), field(1, result.secondary.image_size)


def _sums(values: FloatArray, of: IntArray, count: int) -> FloatArray:
    """(count, k): sums of the rows of values (n, k) that belong together."""
    sums = np.zeros((count, values.shape[1]))
    np.add.at(sums, of, values)
    return sums
