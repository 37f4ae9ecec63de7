"""Reconstruct whole tables of pairs, or of tracks, into tables of 3D points."""

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from stereocal.errors import RowProblem
from stereocal.matching.in_step import pairs_in_step
from stereocal.matching.matching import purpose_warning
from stereocal.matching.pairs import ERROR_DECIMALS
from stereocal.matching.point_noise import (
    FEWEST_PAIRS,
    PointNoise,
    check_sigma,
    fit_noise,
    noise_of_calibration,
    on_far,
    pair_errors,
)
from stereocal.matching.point_table import PAIR_SIGMAS, SIGMAS, PointTable, open_table
from stereocal.matching.reconstruction import Points3D, name_of_world, reconstruct_points
from stereocal.matching.tables_by_camera import Report, pixel_columns
from stereocal.matching.tracks import OF_TRACKS, noise_of_tracks
from stereocal.matching.trajectories import (
    COORDINATES,
    OUTSIDE_VOLUME,
    POINT_COLUMNS,
    SIGMA_COLUMNS,
    with_track,
)
from stereocal.matching.view_groups import ViewFitter
from stereocal.network.rig_file import Parameters, RigFile
from stereocal.rig.correspondences import PIXELS
from stereocal.rig.field_of_view import beyond_in_words, count_beyond
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import PlacedCameras
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import count, rounded
from stereocal.system.tasks import Progress, Task, run_tasks

LARGE_ERRORS = " The 3D set is fitted to lengths; its reprojection errors may be large."
OF_MATCHING = ("error_px", "runner_up_px")
"""Errors by the matching's parameters, not passed on; the points have their own error."""

FAR_OFF = 0.05
"""A median error above this fraction of the image's diagonal means another rig."""

AHEAD = 2
"""Blocks in memory: each may have 100,000 rows."""
MOST_WITH_TRACK = 1_000_000
"""Rows of a table that is held whole, which its trajectories need; longer ones get no `track`."""
SAMPLE_PAIRS = 4000
"""Pairs that show the noise."""


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


def measure_tables(
    rig: Parameters,
    table: PointTable,
    out: Path | None,
    world: Pose | None = None,
    sigma_px: float | None = None,
    progress: Progress | None = None,
    executor: Executor | None = None,
    passed_on: list[pd.DataFrame] | None = None,
) -> Report:
    """Reconstruct the points of a table of pairs, or of the tracks of a rig, and write them.

    Args:
        table: of pairs, or of tracks; pairs are measured a block at a time.
        world: `world_from_primary`, of a rig `world_from_reference`.
        sigma_px: standard deviation of a pixel coordinate; None: as `noise_of_pairs` finds it, of a
            rig from the errors in all cameras.
        progress: called with the number of rows done and the total; what it raises ends the work,
            and no file is written.
        executor: measures blocks; None: the calling thread.
        out: None: nothing is written, only passed on.
        passed_on: gets what is written.
    """
    check_sigma(sigma_px)
    timing, sample, beyond = "", list[pd.DataFrame](), dict.fromkeys(rig.placed, 0)
    if isinstance(rig, RigParameters):
        table, timing = pairs_in_step(table, rig)

    def look(block: pd.DataFrame) -> list[RowProblem]:
        sample.append(block.iloc[:: max(len(block) // SAMPLE_PAIRS, 1)])
        for which, (camera, _) in rig.placed.items():
            pixels = block[[f"u_{which}", f"v_{which}"]].to_numpy(dtype=np.float64)
            beyond[which] += count_beyond(camera, pixels)
        return points_outside_images(rig, block)

    rows = table.check(look).rows
    blocks: Iterable[pd.DataFrame] = table.blocks()
    measuring: _Pairs | _Tracks
    if isinstance(rig, RigFile):
        blocks = [pd.concat(list(blocks))]
        measuring = _Tracks.settled(rig, blocks[0], world, sigma_px)
    else:
        noise = noise_of_pairs(rig, pd.concat(sample), sigma_px)
        measuring = _Pairs(rig, world, noise, timing)
    tasks = (Task(measuring.points, (block,), len(block)) for block in blocks)
    measured = run_tasks(tasks, executor, rows, progress, ahead=AHEAD)
    errors, outside, waiting = list[FloatArray](), 0, list[pd.DataFrame]()
    with open_table(out, passed_on=passed_on) as writer, closing(measured):
        for _, points in measured:
            (waiting.append if rows <= MOST_WITH_TRACK else writer.add)(points)
            errors.append(points["error_px"].to_numpy(dtype=np.float64))
            if OUTSIDE_VOLUME in points:
                outside += int((points[OUTSIDE_VOLUME] & points["error_px"].notna()).sum())
        if waiting:
            writer.add(with_track(pd.concat(waiting, ignore_index=True)))
    report = measuring.report(np.concatenate(errors), outside)
    return replace(report, notes=[*report.notes, *filter(None, [beyond_in_words(beyond)])])


@dataclass(frozen=True, eq=False)
class _Pairs:
    """How pairs are measured."""

    rig: RigParameters
    world: Pose | None
    noise: PointNoise | None
    timing: str = ""
    """A note on points that were brought into step."""

    def points(self, pairs: pd.DataFrame) -> pd.DataFrame:
        """The table of points of pairs that are in step."""
        pixels = pairs[list(PIXELS)].to_numpy(dtype=np.float64)
        sigmas = None
        if self.noise is not None:  # of the points of both cameras
            sigmas = np.full((len(pairs), 2), self.noise.sigma_px)
            if self.noise.source == "columns":
                stated = pairs[list(PAIR_SIGMAS)].to_numpy(dtype=np.float64)
                sigmas = np.where(np.isfinite(stated), stated, sigmas)
        found = reconstruct_points(self.rig, pixels[:, :2], pixels[:, 2:], self.world, sigmas)
        passed = pairs.drop(columns=["frame", *PIXELS, *OF_MATCHING, *SIGMAS], errors="ignore")
        return _table(pairs["frame"], found, self.world, {}, passed, "of_pair")

    def report(self, errors: FloatArray, outside: int) -> Report:
        """The result, by the errors (n,) of all points, NaN where there is none."""
        lost, median = _lost_and_median(errors)
        notes = [*filter(None, [self.timing, purpose_warning(self.rig, "reconstruction")])]
        diagonal = float(np.hypot(*self.rig.primary.image_size))
        targets = noise_of_calibration(self.rig)
        if lost > len(errors) / 2 or median > FAR_OFF * diagonal:
            notes.append(
                "Most pairs do not fit these parameters at all: make sure that both are of the "
                "same rig, and that primary and secondary are not exchanged."
            )
        elif self.rig.purpose != "reconstruction":
            notes += filter(None, [on_far(median, targets.sigma_px if targets else None)])
        behind = f"; {count(lost, 'pair', 'do')} not meet in front of both cameras" * bool(lost)
        found = len(errors) - lost
        text = (
            f"{count(found, 'point')}, median reprojection error {rounded(median, 3)} px{behind}."
        )
        if self.rig.purpose == "reconstruction":
            text += LARGE_ERRORS
        if self.rig.volume is not None:
            filled = f"outside the volume that the bars filled ({self.rig.volume.depths})"
            beyond = (
                f"{outside} of {found} points {'lies' if outside == 1 else 'lie'} {filled}; errors "
                "there can be larger than stated."
            )
            text = f"{text} {beyond if outside else f'No point lies {filled}.'}"
        return Report(len(errors), [text, self._on_errors()], notes, lost)

    def _on_errors(self) -> str:
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


@dataclass(frozen=True, eq=False)
class _Tracks:
    """How tracks are measured: by all cameras that see each."""

    fitter: ViewFitter
    world: Pose | None
    sigma_px: float
    """The noise of the points."""

    @classmethod
    def settled(
        cls, rig: RigFile, tracks: pd.DataFrame, world: Pose | None, sigma_px: float | None
    ) -> "_Tracks":
        """With the noise as stated, else by the errors of all tracks."""
        fitter = ViewFitter(rig)
        if sigma_px is None:
            pixels = _pixels(rig, tracks)
            views = np.isfinite(pixels[..., 0]).sum(axis=1)
            chi_square = fitter.fit(pixels, fitter.rays(pixels)).chi_square
            sigma_px = noise_of_tracks(rig, views, chi_square).sigma_px
        return cls(fitter, world, sigma_px)

    def points(self, tracks: pd.DataFrame) -> pd.DataFrame:
        """The table of points."""
        rig, world = self.fitter.rig, self.world
        pixels = _pixels(rig, tracks)
        found = self.fitter.fit(pixels, self.fitter.rays(pixels), max(self.sigma_px, 1e-6))
        about = found.xyz, found.error_px, found.errors.covariances
        points = Points3D.in_frame(world, rig.volume, *about)
        further = tracks.drop(columns=["frame", *pixel_columns(rig), *OF_TRACKS], errors="ignore")
        views = {"views": np.isfinite(pixels[..., 0]).sum(axis=1)}
        return _table(
            tracks["frame"], points, world, views, _common(further, rig.names), "of_track"
        )

    def report(self, errors: FloatArray, outside: int) -> Report:
        """As that of pairs."""
        lost, median = _lost_and_median(errors)
        behind = f"; {lost} do not meet in front of the cameras" if lost else ""
        beyond = (
            f" {outside} lie outside the volume that the object filled, where errors can be "
            "larger than stated."
        )
        sentence = (
            f"{len(errors) - lost} points, median reprojection error {rounded(median, 3)} px"
            f"{behind}.{beyond * bool(outside)} Standard errors are for points known to "
            f"{rounded(self.sigma_px)} px."
        )
        return Report(len(errors), [sentence], lost=lost)


def _lost_and_median(errors: FloatArray) -> tuple[int, float]:
    """The number of points that there are not, and the median error of the others."""
    lost = int(np.isnan(errors).sum())
    return lost, float(np.nanmedian(errors)) if lost < len(errors) else float("nan")


def _table(
    frame: "pd.Series[int]",
    found: Points3D,
    world: Pose | None,
    views: Mapping[str, IntArray],
    passed: pd.DataFrame,
    source: str,
) -> pd.DataFrame:
    """Rows of `points.csv`; columns that are passed on get the name of their `source` added where
    it is taken.
    """
    columns: dict[str, Any] = {"frame": frame.to_numpy()}
    columns |= dict(zip("xyz", found.xyz.T, strict=True))
    columns["error_px"] = found.error_px.round(ERROR_DECIMALS)
    if found.sigma_m is not None:
        columns |= dict(zip(SIGMA_COLUMNS, found.sigma_m.T, strict=True))
    columns |= views
    if found.outside_volume is not None:
        columns[OUTSIDE_VOLUME] = found.outside_volume
    if world is not None:
        columns[COORDINATES] = np.full(len(frame), name_of_world(world))
    taken = {*POINT_COLUMNS, *SIGMA_COLUMNS, OUTSIDE_VOLUME, COORDINATES, *views}
    for name in passed:
        columns[f"{name}_{source}" if name in taken else str(name)] = passed[name].array
    return pd.DataFrame(columns)


def _pixels(rig: RigFile, tracks: pd.DataFrame) -> FloatArray:
    """(n, c, 2): of all cameras; NaN where one does not see a point."""
    pixels = tracks[pixel_columns(rig)].to_numpy(dtype=np.float64)
    shaped = pixels.reshape(len(pixels), len(rig.names), 2).copy()
    shaped[~np.isfinite(shaped).all(axis=2)] = np.nan
    return shaped


def _common(further: pd.DataFrame, cameras: Sequence[str]) -> pd.DataFrame:
    """One column in place of those that end in the cameras' names: what all that have a value say;
    empty where they differ, and not there where none agree."""
    groups: dict[str, list[str]] = {}
    by_length = sorted(cameras, key=len, reverse=True)
    for name in map(str, further):
        camera = next((each for each in by_length if name.endswith(f"_{each}")), None)
        groups.setdefault(name if camera is None else name[: -len(camera) - 1], []).append(name)
    found = {}
    for stem, names in groups.items():
        values = further[names].where(further[names] != "")
        first = values.bfill(axis=1).iloc[:, 0]
        agree = (values.eq(first, axis=0) | values.isna()).all(axis=1) & first.notna()
        if agree.any():
            found[stem] = first.where(agree, "")
    return pd.DataFrame(found, index=further.index)


def points_outside_images(rig: PlacedCameras, block: pd.DataFrame) -> list[RowProblem]:
    """The rows of a block of pairs, or of tracks, with a point outside its image."""
    problems = []
    for which, (camera, _) in rig.placed.items():
        pixels = block[[f"u_{which}", f"v_{which}"]].to_numpy(dtype=np.float64)
        problems += [
            RowProblem(
                int(block.index[row]), f"the {which} {what}: are these parameters of other images?"
            )
            for row, what in camera.outside(pixels)
        ]
    return sorted(problems, key=lambda problem: problem.line)
