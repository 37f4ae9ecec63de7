"""easyWand's `easyWandData.mat`: bars, background points, a thrown object, lenses, a solution.

All image coordinates in the file count v from the bottom: `v' = h - v` with the image height h.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.formats.archives.archive import (
    THROW,
    Archive,
    Taken,
    baseline_taken,
    check_bar,
    lens_taken,
    points_taken,
    with_background,
)
from stereocal.formats.correspondences_csv import PIXELS
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.exchange.reading import camera_matrix, camera_of, chosen_pair
from stereocal.formats.matlab_file import Fields, numbers_of, read_structs, required
from stereocal.formats.pixel_origin import LOWER_LEFT, PixelOrigin
from stereocal.formats.units import UNITS
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.rig.dataset import Correspondences
from stereocal.system.limits import Limits

STRUCT = "easyWandData"
MOST_CAMERAS = 64
COEFFICIENTS = 11
TABLES = (("wandPts", 0), ("wandPts", 1), ("backgroundPts", 0), ("axisPts", 0))
"""Of points; those of the bar with its end."""
Seen = tuple[IntArray, FloatArray]
"""Frame numbers (n,) and our pixels (n, 4) of the points that both cameras saw."""
LENS_FIELDS = "focalLengths, principalPoints, nlin"


@dataclass(frozen=True)
class EasyWandFile:
    """The struct of a file."""

    fields: Fields
    source: str

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras."""
        wand = self._rows("wandPts", None)
        if wand is None:
            raise StereocalError(f"{self.source}: wandPts, the points of the bar, is missing.")
        count, rest = divmod(wand.shape[1], 4)
        if rest or not 2 <= count <= MOST_CAMERAS:
            raise StereocalError(
                f"{self.source}: wandPts has {wand.shape[1]} columns; 4 for each of two or more "
                "cameras are expected."
            )
        return tuple(f"cam{k + 1}" for k in range(count))

    def points(self, name: str, camera: int, end: int = 0) -> FloatArray | None:
        """(n, 2): the points of a camera as in the file; NaN if missing. None without the field.

        Args:
            name: `wandPts`, `backgroundPts` or `axisPts`.
            end: 0 or 1, of the bar.
        """
        count = len(self.cameras)
        table = self._rows(name, count * (4 if name == "wandPts" else 2))
        if table is None:
            return None
        at = 2 * (camera + end * count)
        pixels = table[:, at : at + 2].copy()
        pixels[(pixels == 0).all(axis=1) | np.isnan(pixels).any(axis=1)] = np.nan
        return pixels

    def image_size(self, camera: int) -> tuple[int, int]:
        """Width and height as stated in the file."""
        count = len(self.cameras)
        width, height = (
            required(self.fields, name, count, self.source)[camera]
            for name in ("imageWidth", "imageHeight")
        )
        if not (1 <= width <= 1e6 and 1 <= height <= 1e6):
            raise StereocalError(
                f"{self.source}: an image of {width:g}x{height:g} px is not possible; state "
                "--image-size WxH."
            )
        return int(width), int(height)

    def camera(self, k: int, size: tuple[int, int], origin: PixelOrigin) -> Camera:
        """A camera with its lens, whose principal point and p1 have the origin of the points."""
        count = len(self.cameras)
        focal = required(self.fields, "focalLengths", count, self.source)[k]
        centre = required(self.fields, "principalPoints", 2 * count, self.source)[2 * k : 2 * k + 2]
        u, v = origin.to_ours(centre[None], size[1])[0]
        K = camera_matrix(focal, focal, u, v)
        distortion = self._distortion(count)[k]
        if origin.corner == "lower-left":
            distortion[2] *= -1.0
        where = f"{self.source}, camera {k + 1}"
        return camera_of(K, distortion, size, False, ExchangeOptions(), 0, where)

    def baseline(self, first: int, second: int) -> float | None:
        """Distance of two cameras by the DLT coefficients of its solution, in the file's unit."""
        table = numbers_of(self.fields, "coefs", self.source)
        count = len(self.cameras)
        if table is None or table.shape != (COEFFICIENTS, count):
            return None
        centres = []
        for column in (table[:, first], table[:, second]):
            P = np.append(column, 1.0).reshape(3, 4)
            if not np.isfinite(P).all() or abs(np.linalg.det(P[:, :3])) < 1e-300:
                return None
            centres.append(-np.linalg.solve(P[:, :3], P[:, 3]))
        found = float(np.linalg.norm(centres[0] - centres[1]))
        return found if np.isfinite(found) and found > 0 else None

    def _distortion(self, count: int) -> FloatArray:
        """(count, 5): k1 k2 p1 p2 k3 of each camera; zeros if the file has none."""
        for name in ("nlin_est", "nlin"):
            found = numbers_of(self.fields, name, self.source)
            if found is not None and found.size == 5 * count and np.nan_to_num(found).any():
                table = found if found.shape == (count, 5) else found.T
                return np.nan_to_num(table.reshape(count, 5))
        return np.zeros((count, 5))

    def _rows(self, name: str, columns: int | None) -> FloatArray | None:
        table = numbers_of(self.fields, name, self.source)
        if table is None or np.isnan(table).all():
            return None
        table = np.atleast_2d(table)  # SciPy drops the axis of a single frame
        if table.ndim != 2 or columns not in (None, table.shape[1]):
            raise StereocalError(
                f"{self.source}: {name} has the shape {table.shape}; {columns or '4 a camera'} "
                "columns are expected."
            )
        Limits.from_environment().check_pairs(len(table), f"{self.source}, {name}")
        return table


def open_easywand(content: bytes, source: str) -> EasyWandFile | None:
    """The struct of a .mat file; None if it has none of easyWand's."""
    fields = read_structs(content, source).get(STRUCT)
    return None if fields is None else EasyWandFile(fields, source)


def _check_sizes(file: EasyWandFile, pair: tuple[int, int]) -> None:
    """Refuse an image size of the file that points lie outside of."""
    for which, k in zip(CAMERAS, pair, strict=True):
        width, height = file.image_size(k)
        found = [file.points(name, k, end) for name, end in TABLES]
        points = np.concatenate([each for each in found if each is not None])
        if not np.isfinite(points).any():
            continue
        u, v = np.nanmax(points, axis=0)
        if u > width + 1 or v > height + 1:
            raise StereocalError(
                f"{file.source}: the file states images of {width}x{height} px, but the {which} "
                f"camera's points reach ({u:.0f}, {v:.0f}): state the size of the sensor, as "
                "--image-size 640x512."
            )


def read_easywand(file: EasyWandFile, options: ExchangeOptions) -> Archive:
    """All parts of a data set in the file."""
    chosen = chosen_pair(file.cameras, options.cameras, file.source)
    pair, stated = chosen.pair, options.image_sizes
    if None in stated:
        _check_sizes(file, pair)
    sizes = [size or file.image_size(k) for k, size in zip(pair, stated, strict=True)]
    origin = options.origin(LOWER_LEFT)
    cameras = [file.camera(k, size, origin) for k, size in zip(pair, sizes, strict=True)]
    seen: dict[tuple[str, int], Seen] = {}
    for name, end in TABLES:
        sides = [file.points(name, k, end) for k in pair]
        ours = [
            origin.to_ours(p, h) for p, (_, h) in zip(sides, sizes, strict=True) if p is not None
        ]
        if len(ours) == 2:
            both = np.hstack(ours)
            rows = np.isfinite(both).all(axis=1)
            seen[name, end] = np.flatnonzero(rows) + 1, both[rows]
    points, taken, notes = _points(seen, chosen.words, file.source)
    throw, more, about = _throw(file, seen.get(("axisPts", 0)))
    taken += more + [lens_taken(w, c, LENS_FIELDS) for w, c in zip(CAMERAS, cameras, strict=True)]
    length = numbers_of(file.fields, "wandLen", file.source)
    distance = None
    if length is not None and length.size == 1 and length.item() > 0:
        distance = check_bar(length.item(), options.unit, file.source)
        taken.append(Taken("distance A-B", f"{distance:g} m", "wandLen"))
    baseline = file.baseline(*pair)
    if baseline is not None:
        baseline *= UNITS[options.unit or "m"]
        taken.append(baseline_taken(baseline, "coefs, its own solution"))
    return Archive(
        tuple(taken),
        cameras[0],
        cameras[1],
        points,
        baseline,
        distance,
        throw,
        (f"From easyWand, {chosen.words}.", *notes, *about),
        chosen.remarks,
    )


def _points(
    seen: Mapping[tuple[str, int], Seen], words: str, source: str
) -> tuple[Correspondences, list[Taken], tuple[str, ...]]:
    """The bars, and the background points as further frames."""
    ends = [seen["wandPts", end] for end in (0, 1)]
    frames = np.concatenate([each[0] for each in ends])
    pixels = np.concatenate([each[1] for each in ends])
    if not len(frames):
        raise StereocalError(
            f"no end of the bar was seen by both cameras, {words}: choose others with --cameras.",
            source,
        )
    targets = "A" * len(ends[0][0]) + "B" * len(ends[1][0])
    found = Correspondences.from_arrays(frames, targets, pixels[:, :2], pixels[:, 2:])
    taken = [points_taken(found, f"wandPts, {words}")]
    _, background = seen.get(("backgroundPts", 0), (frames, frames[:0]))
    if not len(background):
        return found, taken, ()
    found, more, note = with_background(found, background, "backgroundPts")
    return found, [*taken, more], (note,)


def _throw(
    file: EasyWandFile, found: Seen | None
) -> tuple[pd.DataFrame | None, list[Taken], tuple[str, ...]]:
    """The thrown object, whose points are in `axisPts` if `gravityFreq` is set."""
    if found is None:
        return None, [], ()
    rate = numbers_of(file.fields, "gravityFreq", file.source)
    hertz = float(rate.ravel()[0]) if rate is not None else 0.0
    frames, points = found
    if not hertz > 0:
        return None, [Taken("axis points", "not used", "axisPts, no gravityFreq")], ()
    if not len(frames):
        return None, [Taken("thrown object", "not seen by both cameras", "axisPts")], ()
    table = pd.DataFrame(points, columns=list(PIXELS))
    table.insert(0, "frame", frames)
    words = f"{len(frames)} frames at {hertz:g} frames a second"
    about = f"{THROW} has a thrown object, recorded at {hertz:g} frames a second."
    return table, [Taken("thrown object", f"{words}: {THROW}", "axisPts, gravityFreq")], (about,)
