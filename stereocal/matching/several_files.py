"""Tables of the points of three cameras and more: matched into tracks.csv, measured from it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.matching.matching_files import check_points
from stereocal.matching.pairs import ERROR_DECIMALS, POINT, pixels_of
from stereocal.matching.point_noise import PointNoise, check_sigma
from stereocal.matching.point_table import PointTable, open_table
from stereocal.matching.reconstruction import name_of_world
from stereocal.matching.reconstruction_files import COORDINATES, OUTSIDE_VOLUME, SIGMA_COLUMNS
from stereocal.matching.several_views import (
    ViewFitter,
    expected_wrong,
    images_of_groups,
    match_views,
)
from stereocal.matching.threshold import choose_threshold
from stereocal.network.rig_file import RigFile
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.rig.geometry import Pose
from stereocal.system.atomic_files import read_whole
from stereocal.system.numbers import count, rounded
from stereocal.system.tables import EMPTY, Column, read_rows
from stereocal.system.tasks import Progress, StoppedError

SAMPLE_FRAMES = 60
OF_TRACKS = ("views", "error_px", "ambiguous")
FEWEST_DECOYS = 3
"""Frames without which the share of wrong groups is not estimated."""


@dataclass(frozen=True)
class TracksReport:
    """The result of a matching of several cameras in numbers."""

    frames: int
    by_views: Mapping[int, int]
    """Points by the number of cameras that see them."""
    ambiguous: int
    noise: PointNoise
    wrong: Mapping[int, float]
    """Share of wrong ones, at most about, by the number of cameras; empty if unknown."""
    notes: Sequence[str] = ()

    def sentences(self) -> list[str]:
        counts = ", ".join(f"{seen} by {views}" for views, seen in self.by_views.items())
        wrong = ", ".join(
            f"{rounded(100 * share)} % of those seen by {views}"
            for views, share in self.wrong.items()
        )
        return [
            f"Your points scatter by {self.noise.in_words}.",
            f"{count(sum(self.by_views.values()), 'point')} in {count(self.frames, 'frame')}: "
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
) -> TracksReport | None:
    """Match the tables of several cameras (`frame,u,v`) and write tracks.csv.

    Further columns are passed through, with the name of their camera: `target_left`.

    Args:
        sigma_px: noise of the points; None: estimated, else that of the targets.
        progress: called with the frames done and the total.

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
    contents = {
        name: check_points(table, rig.cameras[name], name) for name, table in tables.items()
    }
    by_frame: dict[int, dict[str, pd.DataFrame]] = {}
    for name, table in tables.items():
        for frame, rows in table.frames():
            by_frame.setdefault(frame, {})[name] = rows
    frames = sorted(by_frame)
    empty = np.empty((0, 2))
    points = [
        [
            pixels_of(by_frame[frame][name]) if name in by_frame[frame] else empty
            for name in rig.names
        ]
        for frame in frames
    ]
    fitter = ViewFitter(rig)
    noise = _noise(rig, points, sigma_px)
    sigma = max(noise.sigma_px, 1e-3)
    pixels = [f"{axis}_{name}" for name in rig.names for axis in POINT]
    further = {
        (name, column): f"{column}_{name}" for name in tables for column in tables[name].further
    }
    counts, ambiguous = np.zeros(len(rig.names) + 1, dtype=np.int64), 0
    columns = ["frame", *pixels, *OF_TRACKS, *further.values()]
    try:
        with open_table(out, columns) as writer:
            for number, (frame, own) in enumerate(zip(frames, points, strict=True)):
                found = match_views(fitter, own, sigma)
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
                ambiguous += int(found.ambiguous.sum())
                counts += np.bincount(found.views, minlength=len(counts))
                if progress is not None:
                    progress(number + 1, len(frames))
                if cancelled is not None and cancelled():
                    raise StoppedError
    except StoppedError:
        return None
    sample = points[:: max(len(points) // SAMPLE_FRAMES, 1)]
    wrong = expected_wrong(fitter, sample, sigma) if len(sample) >= FEWEST_DECOYS else {}
    notes = [
        f"The camera {name} is {late:+.3f} frames late: points that move are used as recorded."
        for name, late in rig.time_offsets.items()
        if late
    ]
    notes += [
        f"{tables[name].label}: {count(own.left_out, 'row')} without a point left out."
        for name, own in contents.items()
        if own.left_out
    ]
    by_views = {int(views): int(counts[views]) for views in np.flatnonzero(counts)[::-1]}
    return TracksReport(len(frames), by_views, ambiguous, noise, wrong, notes)


def _of_images(rows: pd.DataFrame | None, column: str, images: IntArray) -> list[Any]:
    """The values (k,) of a column of a camera's rows, of the images -1 or a row of each point."""
    values = [] if rows is None else rows[column].tolist()
    return [None if image < 0 else values[image] for image in images.tolist()]


def _noise(
    rig: RigFile, frames: Sequence[Sequence[FloatArray]], sigma_px: float | None
) -> PointNoise:
    """The noise of the points, by the two cameras that see most of them together."""
    if sigma_px is not None:
        return PointNoise(sigma_px, "stated")
    seen = np.array([[len(own) for own in frame] for frame in frames], dtype=np.float64)
    both = np.minimum(seen[:, :, None], seen[:, None, :]).sum(axis=0)
    np.fill_diagonal(both, -1.0)
    first, second = sorted(np.unravel_index(int(both.argmax()), both.shape))
    pair = rig.pair(rig.names[int(first)], rig.names[int(second)])
    sample = [(frame[int(first)], frame[int(second)]) for frame in frames]
    sample = [own for own in sample if len(own[0]) and len(own[1])]
    found = choose_threshold(pair, sample[:: max(len(sample) // SAMPLE_FRAMES, 1)]).noise
    return found or PointNoise(rig.noise_px, "calibration")


@dataclass(frozen=True)
class RigPointsReport:
    """The result of a reconstruction in numbers."""

    points: int
    lost: int
    """Rows whose images do not meet in front of the cameras; their coordinates are empty."""
    median_error_px: float
    sigma_px: float
    outside: int | None
    """Points outside the volume of the object; None if unknown."""

    def sentence(self) -> str:
        lost = f"; {self.lost} do not meet in front of the cameras" if self.lost else ""
        volume = (
            f" {self.outside} lie outside the volume that the object filled, where errors can be "
            "larger than stated."
            if self.outside
            else ""
        )
        return (
            f"{self.points - self.lost} points, median reprojection error "
            f"{rounded(self.median_error_px, 3)} px{lost}.{volume} Standard errors are for points "
            f"known to {rounded(self.sigma_px)} px."
        )


def reconstruct_rig(
    rig: RigFile, tracks: Path, out: Path, world: Pose | None = None, sigma_px: float | None = None
) -> RigPointsReport:
    """Measure the points of tracks.csv from all cameras that see each, and write them.

    Args:
        world: `world_from_reference`.
        sigma_px: noise of the points, for the standard errors; None: estimated from their errors.
    """
    check_sigma(sigma_px)
    frame, pixels, passed = read_tracks(rig, tracks)
    fitter = ViewFitter(rig)
    rays = fitter.rays(pixels)
    if sigma_px is None:
        sigma_px = _noise_of_tracks(fitter, pixels, rays)
    found = fitter.fit(pixels, rays, max(sigma_px, 1e-6))
    outside = None if rig.volume is None else ~rig.volume.contains(found.xyz)
    xyz, covariance = found.xyz, found.covariance
    if world is not None:
        xyz, covariance = world.apply(xyz), world.R @ covariance @ world.R.T
    table = pd.DataFrame({"frame": frame, **dict(zip("xyz", xyz.T, strict=True))})
    table["error_px"] = found.error_px.round(ERROR_DECIMALS)
    for k, name in enumerate(SIGMA_COLUMNS):
        table[name] = np.sqrt(covariance[:, k, k])
    table["views"] = np.isfinite(pixels[..., 0]).sum(axis=1)
    if outside is not None:
        table[OUTSIDE_VOLUME] = outside
    if world is not None:
        table[COORDINATES] = name_of_world(world)
    for name in map(str, passed):
        table[f"{name}_of_track" if name in table else name] = passed[name].array
    with open_table(out) as writer:
        writer.add(table)
    lost = ~np.isfinite(found.xyz[:, 0])
    median = float(np.nanmedian(found.error_px)) if not lost.all() else float("nan")
    count = None if outside is None else int((outside & ~lost).sum())
    return RigPointsReport(len(frame), int(lost.sum()), median, sigma_px, count)


def read_tracks(rig: RigFile, path: Path) -> tuple[IntArray, FloatArray, pd.DataFrame]:
    """Frames (n,) and pixels (n, c, 2) of tracks.csv, NaN where a camera does not see a point; and
    its further columns, of those with a camera's name one for all cameras."""
    content = read_whole(path)
    names = [f"{axis}_{name}".lower() for name in rig.names for axis in POINT]
    columns = [Column(name, may_be_empty=True) for name in names]
    rows = read_rows(
        content, str(path), ["frame", *names], [Column("frame", is_whole=True), *columns], (), EMPTY
    )
    rows.check(str(path))
    pixels = np.column_stack([rows.values[name] for name in names])
    shaped = pixels.reshape(len(pixels), len(rig.names), 2)
    sizes = np.array([camera.image_size for camera in rig.cameras.values()])
    outside = ((shaped < -0.5) | (shaped > sizes - 0.5)).any(axis=2)
    if outside.any():
        row, camera = np.argwhere(outside)[0]
        raise StereocalError(
            f"{path}: line {rows.raw.index[row]}: the point is outside the image of the camera "
            f"{rig.names[camera]}."
        )
    shaped[~np.isfinite(shaped).all(axis=2)] = np.nan
    own = {"frame", *names, *OF_TRACKS}
    further = rows.raw[[name for name in map(str, rows.raw) if name.lower() not in own]]
    return rows.values["frame"].astype(np.int64), shaped, _common(further, rig.names)


def _common(further: pd.DataFrame, cameras: Sequence[str]) -> pd.DataFrame:
    """One column in place of those that end in the cameras' names: what all that have a value say;
    empty where they differ, and not there where none agree."""
    groups: dict[str, list[str]] = {}
    by_length = sorted(map(str.lower, cameras), key=len, reverse=True)
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


def _noise_of_tracks(fitter: ViewFitter, pixels: FloatArray, rays: FloatArray) -> float:
    """By the errors of the points; that of the targets where they are few."""
    found = fitter.fit(pixels, rays)
    freedom = 2 * np.isfinite(pixels[..., 0]).sum(axis=1) - 3
    known = np.isfinite(found.xyz[:, 0])
    if known.sum() < 20:
        return fitter.rig.noise_px
    # robust: the median of each chi-square over that of its distribution, (1 - 2 / 9 k)^3 k
    median = freedom[known] * (1 - 2 / (9 * freedom[known])) ** 3
    return float(np.sqrt(np.median(found.chi_square[known] / median)))
