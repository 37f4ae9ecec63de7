"""Match the tables of points of three cameras and more, and write tracks.csv."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.matching.matching_files import check_points
from stereocal.matching.names import AUTO, Names, TwoCameras, choose_names, stated_columns
from stereocal.matching.pairs import ERROR_DECIMALS, POINT, pixels_of
from stereocal.matching.point_noise import PointNoise, check_sigma
from stereocal.matching.point_table import Contents, PointTable, open_table
from stereocal.matching.several_views import (
    ViewFitter,
    ViewGroups,
    expected_wrong,
    images_of_groups,
    match_views,
)
from stereocal.matching.threshold import choose_threshold
from stereocal.network.rig_file import RigFile
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.system.numbers import count, rounded
from stereocal.system.tasks import Progress, StoppedError
from stereocal.verdict.in_words import listed

SAMPLE_FRAMES = 60
OF_TRACKS = ("views", "error_px", "ambiguous")
FEWEST_DECOYS = 3
"""Frames without which the share of wrong groups is not estimated."""
FEWEST_POINTS = 20
"""Without which their noise is not estimated."""


@dataclass(frozen=True)
class TracksReport:
    """The result of a matching of several cameras in numbers."""

    frames: int
    by_views: Mapping[int, int]
    """Points by the number of cameras that see them."""
    ambiguous: int
    names: Names
    noise: PointNoise
    """By their errors in all cameras, as `reconstruct_rig` has it."""
    wrong: Mapping[int, float]
    """Share of wrong ones, at most about, by the number of cameras; empty if unknown."""
    notes: Sequence[str] = ()

    def sentences(self) -> list[str]:
        counts = ", ".join(f"{seen} by {views}" for views, seen in self.by_views.items())
        wrong = ", ".join(
            f"{rounded(100 * share)} % of those seen by {views}"
            for views, share in self.wrong.items()
        )
        noise = f"{rounded(self.noise.sigma_px)} px"
        about = {
            "estimated": f"Your points scatter by {noise}.",
            "calibration": "Your points are too few to show their noise, so that of the targets is "
            f"used, {noise}.",
        }
        by = f", of one name ({self.names.in_words})" if self.names.columns else ""
        return [
            about.get(self.noise.source, f"Your points scatter by {noise}, as stated."),
            f"{count(sum(self.by_views.values()), 'point')} in {count(self.frames, 'frame')}{by}: "
            f"{counts} cameras; "
            f"{self.ambiguous} ambiguous (another partner fits as well).",
            f"At most about {wrong} are wrong."
            if wrong
            else "What share of them is wrong cannot be told from so few frames.",
        ]


def match_rig(
    rig: RigFile,
    tables: Mapping[str, PointTable],
    out: Path,
    sigma_px: float | None = None,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
    names: str = AUTO,
) -> TracksReport | None:
    """Match the tables of several cameras (`frame,u,v`) and write tracks.csv.

    Further columns are passed through, with the name of their camera: `target_left`.

    Args:
        sigma_px: noise of the points; None: estimated, else that of the targets.
        progress: called with the frames done and the total.
        names: as of `pairs.match`, of all tables.

    Returns:
        The report; None if cancelled, then no file is written.
    """
    unknown = [name for name in tables if name not in rig.cameras]
    if unknown or len(tables) < 2:
        raise StereocalError(
            f"Give the points of two cameras at least, each as NAME=FILE; the rig has the cameras "
            f"{', '.join(rig.names)}" + (f", not {unknown[0]!r}." if unknown else ".")
        )
    check_sigma(sigma_px)
    called = stated_columns(names, *(table.further for table in tables.values()))
    contents = {
        name: check_points(table, rig.cameras[name], name, called) for name, table in tables.items()
    }
    by_frame: dict[int, dict[str, pd.DataFrame]] = {}
    for name, table in tables.items():
        for frame, rows in table.frames():
            by_frame.setdefault(frame, {})[name] = rows
    by_two = _by_two(rig, list(by_frame.values()), called)
    distinct = [own.distinct for own in contents.values()]
    known, note = choose_names(by_two, distinct, called, names != AUTO)
    frames = sorted(by_frame)
    empty = pd.DataFrame(columns=[*POINT, *called])
    rows_of = [[by_frame[frame].get(name, empty) for name in rig.names] for frame in frames]
    points = [[pixels_of(rows) for rows in own] for own in rows_of]
    numbers = [[known.numbers(rows) for rows in own] for own in rows_of]
    fitter = ViewFitter(rig)
    sigma = max(sigma_px or _sigma_of_two(rig, by_two[0], known), 1e-3)
    pixels = [f"{axis}_{name}" for name in rig.names for axis in POINT]
    further = {
        (name, column): f"{column}_{name}" for name in tables for column in tables[name].further
    }
    done: list[ViewGroups] = []
    try:
        with open_table(out, ["frame", *pixels, *OF_TRACKS, *further.values()]) as writer:
            for frame, own, of_names in zip(frames, points, numbers, strict=True):
                found = match_views(fitter, own, sigma, of_names)
                images = images_of_groups(found.images, own).reshape(-1, len(pixels))
                rows = pd.DataFrame(images, columns=pixels)
                rows["frame"] = frame
                errors = found.error_px.round(ERROR_DECIMALS)
                for name, values in zip(
                    OF_TRACKS, (found.views, errors, found.ambiguous), strict=True
                ):
                    rows[name] = values
                for (camera, column), name in further.items():
                    at = found.images[:, rig.names.index(camera)]
                    rows[name] = _of_images(by_frame[frame].get(camera), column, at)
                writer.add(rows)
                done.append(found)
                if progress is not None:
                    progress(len(done), len(frames))
                if cancelled is not None and cancelled():
                    raise StoppedError
    except StoppedError:
        return None
    some = slice(None, None, max(len(frames) // SAMPLE_FRAMES, 1))
    few = len(frames) < FEWEST_DECOYS
    wrong = {} if few else expected_wrong(fitter, points[some], sigma, numbers[some])
    of_views, chi_square, ambiguous = (
        np.concatenate([getattr(own, what) for own in done])
        for what in ("views", "chi_square", "ambiguous")
    )
    counts = np.bincount(of_views)
    return TracksReport(
        frames=len(frames),
        by_views={int(views): int(counts[views]) for views in np.flatnonzero(counts)[::-1]},
        ambiguous=int(ambiguous.sum()),
        names=known,
        noise=noise_of_points(rig, of_views, chi_square, sigma_px),
        wrong=wrong,
        notes=[*filter(None, [note]), *_notes(rig, tables, contents)],
    )


def noise_of_points(
    rig: RigFile, views: IntArray, chi_square: FloatArray, sigma_px: float | None = None
) -> PointNoise:
    """As stated, else by the errors of points in all cameras; that of the targets of few points.

    Args:
        views, chi_square: (n,) of the points, as of `several_views.Measured`.
    """
    if sigma_px is not None:
        return PointNoise(sigma_px, "stated")
    known = np.isfinite(chi_square)
    if known.sum() < FEWEST_POINTS:
        return PointNoise(rig.noise_px, "calibration")
    # robust: the median of each chi-square over that of its distribution, (1 - 2 / 9 k)^3 k
    freedom = 2.0 * views[known] - 3.0
    median = freedom * (1 - 2 / (9 * freedom)) ** 3
    return PointNoise(float(np.sqrt(np.median(chi_square[known] / median))), "estimated")


def _notes(
    rig: RigFile, tables: Mapping[str, PointTable], contents: Mapping[str, Contents]
) -> list[str]:
    notes = [
        f"The camera {name} is {late:+.3f} frames late: points that move are used as recorded."
        for name, late in rig.time_offsets.items()
        if late
    ]
    return notes + [
        f"{tables[name].label}: {count(own.left_out, 'row')} without a point left out."
        for name, own in contents.items()
        if own.left_out
    ]


def _of_images(rows: pd.DataFrame | None, column: str, images: IntArray) -> list[Any]:
    """The values (k,) of a column of a camera's rows, of the images -1 or a row of each point."""
    values = [] if rows is None else rows[column].tolist()
    return [None if image < 0 else values[image] for image in images.tolist()]


def _by_two(
    rig: RigFile, frames: Sequence[Mapping[str, pd.DataFrame]], columns: Sequence[str]
) -> list[TwoCameras]:
    """Every two cameras, first those that see most points together."""
    found = []
    for pair in combinations([name for name in rig.names if any(name in own for own in frames)], 2):
        both = [[own[name] for name in pair] for own in frames if all(name in own for name in pair)]
        seen = sum(min(map(len, own)) for own in both)
        wanted = [*POINT, *columns]
        sample = [
            (one[wanted], two[wanted]) for one, two in both[:: max(len(both) // SAMPLE_FRAMES, 1)]
        ]
        found.append((seen, TwoCameras(rig.pair(*pair), sample, f" of the cameras {listed(pair)}")))
    return [two for _, two in sorted(found, key=lambda own: -own[0])]


def _sigma_of_two(rig: RigFile, two: TwoCameras, names: Names) -> float:
    """The noise of the points by two cameras, before all are matched."""
    found = choose_threshold(two.rig, [px for own in two.sample for px in names.samples(*own)])
    return found.noise.sigma_px if found.noise else rig.noise_px
