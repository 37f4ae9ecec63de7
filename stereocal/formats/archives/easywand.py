"""easyWand's `easyWandData.mat`: bars, background points, a thrown object, lenses, a solution.

All image coordinates in the file count v from the bottom: `v' = h - v` with the image height h.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.formats.archives.archive import (
    THROW,
    Archive,
    Part,
    baseline_taken,
    lens_taken,
    points_taken,
    with_background,
)
from stereocal.formats.exchange.camera_format import camera_from, camera_matrix
from stereocal.formats.exchange.chosen_cameras import chosen_pair
from stereocal.formats.exchange.options import (
    LOWER_LEFT,
    UNITS,
    ExchangeOptions,
    ImageSize,
    PixelOrigin,
    Unit,
)
from stereocal.formats.matlab_file import Fields, numbers_in_field, read_structs, required
from stereocal.formats.point_files import BarPoints
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.correspondences import PIXELS
from stereocal.system.array_types import FloatArray
from stereocal.system.limits import Limits

STRUCT = "easyWandData"
MOST_CAMERAS = 64
COEFFICIENTS = 11
LENS_FIELDS = "focalLengths, principalPoints, nlin"
TABLES = ("wandPts", "backgroundPts", "axisPts")


@dataclass(frozen=True)
class EasyWandFile:
    fields: Fields
    source: str

    @property
    def cameras(self) -> tuple[str, ...]:
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

    def seen(
        self, name: str, cameras: Sequence[int], sizes: Sequence[ImageSize], origin: PixelOrigin
    ) -> BarPoints | None:
        """What two or more of some cameras saw; None without the field.

        Args:
            name: one of `TABLES`; only `wandPts` has both ends of the bar.
        """
        table = self._points(name)
        if table is None:
            return None
        ours = [origin.to_ours(table[:, :, k], h) for k, (_, h) in zip(cameras, sizes, strict=True)]
        pixels = np.stack(ours, axis=2)
        frames, ends = pixels.shape[:2]
        return BarPoints(
            np.tile(np.arange(1, frames + 1), ends),
            np.repeat(np.arange(ends), frames),
            pixels.swapaxes(0, 1).reshape(-1, len(sizes), 2),
        ).seen_by_two()

    def seen_bars(
        self, cameras: Sequence[int], sizes: Sequence[ImageSize], origin: PixelOrigin
    ) -> tuple[BarPoints, BarPoints | None]:
        """The bars that two or more of some cameras saw, and the background points, if any."""
        bars, background = (
            self.seen(name, cameras, sizes, origin) for name in ("wandPts", "backgroundPts")
        )
        assert bars is not None  # it names the cameras
        return bars, background if background is not None and len(background.frame) else None

    def image_sizes(
        self, cameras: Sequence[int], stated: Sequence[ImageSize | None]
    ) -> list[ImageSize]:
        """The stated sizes of images, or those of the file, if all points lie inside."""
        sizes, count = list[ImageSize](), len(self.cameras)
        tables = [table for name in TABLES if (table := self._points(name)) is not None]
        for k, size in zip(cameras, stated, strict=True):
            if size is not None:
                sizes.append(size)
                continue
            width, height = (
                required(self.fields, name, count, self.source)[k]
                for name in ("imageWidth", "imageHeight")
            )
            points = [table[:, :, k].reshape(-1, 2) for table in tables]
            u, v = np.nanmax(np.vstack([np.zeros((1, 2)), *points]), axis=0)
            if not (
                1 <= width <= 1e6 and 1 <= height <= 1e6 and u <= width + 1 and v <= height + 1
            ):
                raise StereocalError(
                    f"{self.source}: the file states images of {width:g}x{height:g} px, but the "
                    f"points of {self.cameras[k]} reach ({u:.0f}, {v:.0f}): state the size of the "
                    "sensor.",
                    option="--image-size, as --image-size 640x512",
                )
            sizes.append((int(width), int(height)))
        return sizes

    def camera(self, k: int, size: ImageSize, origin: PixelOrigin) -> Camera:
        """A camera with its lens, whose principal point and p1 have the origin of the points."""
        count = len(self.cameras)
        focal = required(self.fields, "focalLengths", count, self.source)[k]
        centre = required(self.fields, "principalPoints", 2 * count, self.source)[2 * k : 2 * k + 2]
        u, v = origin.to_ours(centre[None], size[1])[0]
        distortion = np.zeros(5)
        for name in ("nlin_est", "nlin"):
            lenses = numbers_in_field(self.fields, name, self.source)
            if lenses is not None and lenses.size == 5 * count and np.nan_to_num(lenses).any():
                table = lenses if lenses.shape == (count, 5) else lenses.T
                distortion = np.nan_to_num(table.reshape(count, 5))[k]
                break
        if origin.corner == "lower-left":
            distortion[2] *= -1.0
        K, where = camera_matrix(focal, focal, u, v), f"{self.source}, camera {k + 1}"
        return camera_from(K, distortion, size, False, ExchangeOptions(), 0, where)

    def baseline(self, first: int, second: int) -> float | None:
        """Distance of two cameras by the DLT coefficients of its solution, in the file's unit."""
        table = numbers_in_field(self.fields, "coefs", self.source)
        if table is None or table.shape != (COEFFICIENTS, len(self.cameras)):
            return None
        centres = []
        for column in (table[:, first], table[:, second]):
            P = np.append(column, 1.0).reshape(3, 4)
            if not np.isfinite(P).all() or abs(np.linalg.det(P[:, :3])) < 1e-300:
                return None
            centres.append(-np.linalg.solve(P[:, :3], P[:, 3]))
        baseline = float(np.linalg.norm(centres[0] - centres[1]))
        return baseline if np.isfinite(baseline) and baseline > 0 else None

    def bar_length(self, unit: Unit | None) -> float | None:
        """In metres; None if the file states none."""
        length = numbers_in_field(self.fields, "wandLen", self.source)
        if length is None or length.size != 1 or not length.item() > 0:
            return None
        metres = float(length.item()) * UNITS[unit or "m"]
        if metres > 20:
            raise StereocalError(
                f"{self.source}: the bar would be {metres:g} m long: state the unit of its "
                "lengths, or the length.",
                option="--unit mm or cm, or --distance",
            )
        return metres

    @property
    def frame_rate(self) -> float:
        """Frames a second of a thrown object; 0 if `axisPts` is none."""
        rate = numbers_in_field(self.fields, "gravityFreq", self.source)
        return 0.0 if rate is None else float(np.nan_to_num(rate.ravel()[0]))

    def _points(self, name: str) -> FloatArray | None:
        """(frames, ends, cameras, 2): a table as in the file; NaN if missing."""
        count = len(self.cameras)
        table = self._rows(name, count * (4 if name == "wandPts" else 2))
        if table is None:
            return None
        pixels = table.reshape(len(table), -1, count, 2).copy()
        pixels[(pixels == 0).all(axis=-1) | np.isnan(pixels).any(axis=-1)] = np.nan
        return pixels

    def _rows(self, name: str, columns: int | None) -> FloatArray | None:
        table = numbers_in_field(self.fields, name, self.source)
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


def read_easywand(file: EasyWandFile, options: ExchangeOptions) -> Archive:
    """All parts of a data set in the file."""
    chosen = chosen_pair(file.cameras, options.cameras, file.source)
    origin = options.origin(LOWER_LEFT)
    sizes = file.image_sizes(chosen.pair, options.image_sizes)
    of_pair = zip(chosen.pair, sizes, strict=True)
    primary, secondary = (file.camera(k, size, origin) for k, size in of_pair)
    bars, background = file.seen_bars(chosen.pair, sizes, origin)
    if not len(bars.frame):
        raise StereocalError(
            f"no end of the bar was seen by both cameras, {chosen.words}: choose others.",
            file.source,
            option="--cameras",
        )
    taken = [points_taken(bars.correspondences, f"wandPts, {chosen.words}")]
    notes = [f"From easyWand, {chosen.words}."]
    if background is not None:
        bars, words = with_background(bars, background)
        pairs = f"{len(background.frame)} pairs, {words}"
        taken.append(Part("background points", pairs, "backgroundPts"))
        note = f"Background points are the {words}, with one target each: they serve matching only."
        notes.append(note)
    throw = file.seen("axisPts", chosen.pair, sizes, origin)
    table = None
    if throw is not None:
        line, table = _thrown(throw, rate := file.frame_rate)
        taken.append(line)
        if table is not None:
            notes.append(f"{THROW} has a thrown object, recorded at {rate:g} frames a second.")
    for which, camera in zip(CAMERAS, (primary, secondary), strict=True):
        taken.append(lens_taken(which, camera, LENS_FIELDS))
    distance = file.bar_length(options.unit)
    if distance is not None:
        taken.append(Part("distance A-B", f"{distance:g} m", "wandLen"))
    baseline = file.baseline(*chosen.pair)
    if baseline is not None:
        baseline *= UNITS[options.unit or "m"]
        taken.append(baseline_taken(baseline, "coefs, its own solution"))
    archive = Archive(
        tuple(taken), primary, secondary, bars.correspondences, baseline, distance, table
    )
    return replace(archive, notes=tuple(notes), remarks=chosen.remarks)


def _thrown(throw: BarPoints, rate: float) -> tuple[Part, pd.DataFrame | None]:
    """The line of the report on a thrown object, and its table; None if it is not used."""
    if not rate > 0:
        return Part("axis points", "not used", "axisPts, no gravityFreq"), None
    if not len(throw.frame):
        return Part("thrown object", "not seen by both cameras", "axisPts"), None
    table = pd.DataFrame(throw.pixels.reshape(-1, 4), columns=list(PIXELS))
    table.insert(0, "frame", throw.frame)
    words = f"{len(throw.frame)} frames at {rate:g} frames a second: {THROW}"
    return Part("thrown object", words, "axisPts, gravityFreq"), table
