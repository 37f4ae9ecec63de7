"""Measure the points of three cameras and more from tracks.csv."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.matching.pairs import ERROR_DECIMALS, POINT
from stereocal.matching.point_noise import check_sigma
from stereocal.matching.point_table import open_table
from stereocal.matching.reconstruction import name_of_world
from stereocal.matching.reconstruction_files import COORDINATES, OUTSIDE_VOLUME, SIGMA_COLUMNS
from stereocal.matching.several_files import OF_TRACKS, noise_of_points
from stereocal.matching.several_views import ViewFitter
from stereocal.network.rig_file import RigFile
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.rig.geometry import Pose
from stereocal.system.atomic_files import read_whole
from stereocal.system.numbers import rounded
from stereocal.system.tables import EMPTY, Column, read_rows


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
        views = np.isfinite(pixels[..., 0]).sum(axis=1)
        sigma_px = noise_of_points(rig, views, fitter.fit(pixels, rays).chi_square).sigma_px
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
