"""Reconstruct whole tables of pairs into tables of 3D points."""

from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from stereocal.errors import RowProblem, StereocalError
from stereocal.matching.in_step import bring_into_step, shift_pixels
from stereocal.matching.matching import purpose_warning
from stereocal.matching.pairs import ERROR_DECIMALS, PIXELS
from stereocal.matching.point_noise import (
    FEWEST_PAIRS,
    PointNoise,
    check_sigma,
    fit_noise,
    noise_of_calibration,
    pair_errors,
)
from stereocal.matching.point_table import PAIR_SIGMAS, SIGMAS, PointTable, open_table
from stereocal.matching.reconstruction import name_of_world, reconstruct_points
from stereocal.rig.camera import CAMERAS
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import RigParameters
from stereocal.rig.volume import Volume
from stereocal.system.numbers import count, rounded
from stereocal.system.tasks import Progress, StoppedError, Task, run_tasks

POINT_COLUMNS = ("frame", "x", "y", "z", "error_px")
SIGMA_COLUMNS = ("sigma_x", "sigma_y", "sigma_z")
OUTSIDE_VOLUME = "outside_volume"
COORDINATES = "coordinates"
"""Names the world frame of x, y, z; without this column they are in the primary's frame."""
OF_MATCHING = ("error_px", "runner_up_px")
"""Errors by the matching's parameters, not passed on; the points have their own error."""

FAR_OFF = 0.05
"""A median error above this fraction of the image's diagonal means another rig."""

AHEAD = 2
"""Blocks in memory: each may have 100,000 rows."""
SAMPLE_PAIRS = 4000
"""Pairs that show the noise."""


@dataclass(frozen=True)
class ReconstructionReport:
    """The result of a reconstruction in numbers."""

    points: int
    behind: int
    """Pairs that do not meet in front of both cameras; their coordinates are empty."""
    median_error_px: float
    notes: list[str] = field(default_factory=list)
    outside: int = 0
    """Points outside the volume of the bars."""
    volume: Volume | None = None
    """The volume of the bars, if the parameter file has one."""
    noise: PointNoise | None = None
    """Of the points' coordinates; None if unknown, then the points have no standard errors."""

    @property
    def about_errors(self) -> str:
        """What the standard errors rest on."""
        if self.noise is None:
            return "No standard errors: the noise of the points is unknown. State it in pixels."
        words = (
            "The standard errors contain those of pose and lenses, which neighbouring points "
            f"share; the points are known to {self.noise.in_words}"
        )
        if self.noise.source != "calibration":
            return f"{words}.{self.noise.disagreement}"
        return (
            f"{words}: that of the targets, because the pairs do not show their own. If your "
            "points are less exact, state their noise."
        )

    def sentence(self) -> str:
        lost = f"; {count(self.behind, 'pair', 'do')} not meet in front of both cameras" * bool(
            self.behind
        )
        found, error = self.points - self.behind, rounded(self.median_error_px, 3)
        text = f"{count(found, 'point')}, median reprojection error {error} px{lost}."
        if self.volume is None:
            return text
        filled = f"outside the volume that the bars filled ({self.volume.depths})"
        if not self.outside:
            return f"{text} No point lies {filled}."
        return (
            f"{text} {self.outside} of {found} points {'lies' if self.outside == 1 else 'lie'} "
            f"{filled}; errors there can be larger than stated."
        )


def reconstruct(
    rig: RigParameters,
    pairs: pd.DataFrame,
    world: Pose | None = None,
    sigma_px: float | None = None,
) -> pd.DataFrame:
    """3D points from a table of matched pairs as returned by `match`.

    Args:
        world: `world_from_primary`; None: points in the primary's frame, in metres.
        sigma_px: standard deviation of a pixel coordinate, for `sigma_x`, `sigma_y`, `sigma_z`.
            None: by the columns `sigma_primary_px` and `sigma_secondary_px`, else estimated from
            the pairs, else that of the calibration's targets.

    Returns:
        `frame,x,y,z,error_px`, then any standard errors, then `outside_volume` if the parameters
        know the volume of the bars, then `coordinates` with the name of the world frame, if there
        is one, then the further columns. NaN, and outside, for pairs that do
        not meet in front of both cameras.
    """
    missing = [name for name in ("frame", *PIXELS) if name not in pairs]
    if missing:
        raise StereocalError(f"The table of pairs has no column {missing[0]}.")
    pairs = shift_pixels(rig, pairs, PIXELS[2:])
    return _measured(rig, pairs, world, noise_of_pairs(rig, pairs, sigma_px))


def noise_of_pairs(
    rig: RigParameters, pairs: pd.DataFrame, sigma_px: float | None = None
) -> PointNoise | None:
    """The noise of matched points; None if nothing is known of it.

    Pairs were matched below some threshold, and what lies beyond it is missing: the estimate takes
    the largest error for the threshold.

    Args:
        sigma_px: the noise, if it is known; None: by their columns, else by their errors, else that
            of the calibration.
    """
    check_sigma(sigma_px)
    if sigma_px is not None:
        return PointNoise(sigma_px, "stated")
    if set(PAIR_SIGMAS) <= set(pairs):
        stated = pairs[list(PAIR_SIGMAS)].to_numpy(dtype=np.float64)
        if np.isfinite(stated).any():
            return PointNoise(float(np.sqrt(np.nanmean(stated**2))), "columns")
    thin = pairs.iloc[:: max(len(pairs) // SAMPLE_PAIRS, 1)]
    pixels = thin[list(PIXELS)].to_numpy(dtype=np.float64)
    errors = pair_errors(rig, pixels[:, :2], pixels[:, 2:], thin["frame"].to_numpy())
    if len(errors) >= FEWEST_PAIRS:
        limit = errors.error_px.max() / np.quantile(errors.relative, 0.99)
        found = fit_noise(errors, float(limit))
        if found is not None and found.is_clear:
            return PointNoise(found.deviation, "estimated", found.relative_error)
    return noise_of_calibration(rig)


def _measured(
    rig: RigParameters, pairs: pd.DataFrame, world: Pose | None, noise: PointNoise | None
) -> pd.DataFrame:
    """As `reconstruct`, of pairs in step and with their noise."""
    pixels = pairs[list(PIXELS)].to_numpy(dtype=np.float64)
    sigmas = None
    if noise is not None:  # of the points of both cameras
        sigmas = np.full((len(pairs), 2), noise.sigma_px)
        if noise.source == "columns":
            own = pairs[list(PAIR_SIGMAS)].to_numpy(dtype=np.float64)
            sigmas = np.where(np.isfinite(own), own, sigmas)
    found = reconstruct_points(rig, pixels[:, :2], pixels[:, 2:], world, sigmas)
    columns: dict[str, Any] = {"frame": pairs["frame"].to_numpy()}
    columns |= dict(zip("xyz", found.xyz.T, strict=True))
    columns["error_px"] = found.error_px.round(ERROR_DECIMALS)
    if found.sigma_m is not None:
        columns |= dict(zip(SIGMA_COLUMNS, found.sigma_m.T, strict=True))
    if found.outside_volume is not None:
        columns[OUTSIDE_VOLUME] = found.outside_volume
    if world is not None:
        columns[COORDINATES] = np.full(len(pairs), name_of_world(world))
    taken = {*POINT_COLUMNS, *SIGMA_COLUMNS, OUTSIDE_VOLUME, COORDINATES}
    for name in pairs.columns.difference(["frame", *PIXELS, *OF_MATCHING, *SIGMAS], sort=False):
        columns[f"{name}_of_pair" if name in taken else str(name)] = pairs[name].array
    return pd.DataFrame(columns)


def reconstruct_table(
    rig: RigParameters,
    pairs: PointTable,
    out: Path,
    world: Pose | None = None,
    sigma_px: float | None = None,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
    executor: Executor | None = None,
) -> ReconstructionReport | None:
    """Reconstruct a table of pairs on disk, a block at a time, and write the points.

    Args:
        progress: called with the number of pairs done and the total.
        executor: measures blocks; None: the calling thread.

    Returns:
        The report; None if cancelled, then no file is written.
    """
    pairs, timing = bring_into_step(pairs, PIXELS[2:], rig)
    sample: list[pd.DataFrame] = []

    def look(block: pd.DataFrame) -> list[RowProblem]:
        sample.append(block.iloc[:: max(len(block) // SAMPLE_PAIRS, 1)])
        return points_outside_images(rig, block)

    contents = pairs.check(look)
    noise = noise_of_pairs(rig, pd.concat(sample), sigma_px)
    tasks = (
        Task(_measure_block, (rig, block, world, noise), len(block)) for block in pairs.blocks()
    )
    measured = run_tasks(tasks, executor, contents.rows, progress, cancelled, ahead=AHEAD)
    errors, outside = [], 0
    try:
        with open_table(out) as writer, closing(measured):
            for _, (points, beyond, own) in measured:
                writer.add(points)
                outside += beyond
                errors.append(own)
    except StoppedError:
        return None
    pooled = np.concatenate(errors)
    behind = int(np.isnan(pooled).sum())
    median = float(np.nanmedian(pooled)) if behind < len(pooled) else float("nan")
    notes = [*filter(None, [timing, purpose_warning(rig, "reconstruction")])]
    diagonal = float(np.hypot(*rig.primary.image_size))
    if behind > len(pooled) / 2 or median > FAR_OFF * diagonal:
        notes.append(
            "Most pairs do not fit these parameters at all: make sure that both are of the same "
            "rig, and that primary and secondary are not exchanged."
        )
    return ReconstructionReport(len(pooled), behind, median, notes, outside, rig.volume, noise)


def _measure_block(
    rig: RigParameters, block: pd.DataFrame, world: Pose | None, noise: PointNoise | None
) -> tuple[pd.DataFrame, int, npt.NDArray[np.float32]]:
    """The points of a block, how many lie outside the volume of the bars, and the errors in px."""
    table = _measured(rig, block, world, noise)
    errors = table["error_px"].to_numpy(dtype=np.float32)
    outside = 0
    if OUTSIDE_VOLUME in table:
        outside = int((table[OUTSIDE_VOLUME].to_numpy() & ~np.isnan(errors)).sum())
    return table, outside, errors


def points_outside_images(rig: RigParameters, block: pd.DataFrame) -> list[RowProblem]:
    """The rows of a block of pairs with a point outside its image."""
    problems = []
    for which, names in zip(CAMERAS, (PIXELS[:2], PIXELS[2:]), strict=True):
        pixels = block[list(names)].to_numpy(dtype=np.float64)
        size, lines = np.array(getattr(rig, which).image_size), block.index.to_numpy()
        problems += [
            RowProblem(
                int(lines[row]),
                f"the {which} point ({pixels[row, 0]:g}, {pixels[row, 1]:g}) is outside the "
                f"{size[0]}x{size[1]} px image: are these parameters of other images?",
            )
            for row in np.flatnonzero(((pixels < -0.5) | (pixels > size - 0.5)).any(axis=1))
        ]
    return sorted(problems, key=lambda problem: problem.line)
