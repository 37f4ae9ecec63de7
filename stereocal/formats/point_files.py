"""Read point files of tracking programs by a layout of their columns.

    layout = propose_layout(content, "xypts.csv")     # to be checked and corrected
    table = read_points(content, layout, "cam1", image_height=1024, source="xypts.csv")

A layout is proposed from the header. `questions` are for the user, on what the file does not state
(the pixel origin, which cameras to use).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from stereocal.errors import RefusedRowsError, RowProblem, StereocalError
from stereocal.formats.exchange.options import PixelOrigin
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.rig.dataset import TARGETS, Correspondences
from stereocal.system.dialect import Dialect, head_of
from stereocal.system.limits import Limits
from stereocal.system.tables import MISSING, Column, numbers_in, rows_below, text_of


@dataclass(frozen=True)
class PointColumns:
    """Column indices, from 0, of one point in one camera."""

    camera: str
    point: str
    u: int
    v: int
    likelihood: int | None = None
    """Column with the tracker's likelihood, if there is one."""


@dataclass(frozen=True)
class PointLayout:
    """Meaning of the columns of a point file."""

    program: str
    """Program that writes such files, for messages."""
    columns: tuple[PointColumns, ...]
    header_rows: int = 1
    dialect: Dialect = field(default_factory=Dialect)
    frame: int | None = None
    """Column of the frame number; None: rows are counted from 1."""
    further: tuple[tuple[str, int], ...] = ()
    """Names and indices of columns that are passed through."""
    origin: PixelOrigin = field(default_factory=PixelOrigin)
    px_per_unit: float = 1.0
    least_likelihood: float = 0.0
    """Less likely points count as missing."""
    zero_is_missing: bool = False
    """Whether (0, 0) marks a missing point."""
    questions: tuple[str, ...] = ()

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras, in the file's order."""
        return tuple(dict.fromkeys(each.camera for each in self.columns))

    @property
    def states_cameras(self) -> bool:
        """Whether the names of the cameras are the file's own, and not counted."""
        return self.header_rows > 0

    @property
    def points(self) -> tuple[str, ...]:
        """Names of the points, in the file's order."""
        return tuple(dict.fromkeys(each.point for each in self.columns))


def read_points(
    content: bytes,
    layout: PointLayout,
    camera: str,
    image_height: int | None = None,
    source: str = "points",
    first_rows: int | None = None,
) -> pd.DataFrame:
    """The points of one camera: `frame,u,v`, `point` if there are several, and further columns.

    Pixels are stereocal's: the centre of the top-left pixel is (0, 0). Missing points are left out.

    Args:
        image_height: rows of the image; required if the file's origin is at the lower left.
        first_rows: read only this number of rows, for a preview.
    """
    chosen = [each for each in layout.columns if each.camera == camera]
    if not chosen:
        raise StereocalError(
            f"{source}: there is no camera {camera}; the file has {', '.join(layout.cameras)}."
        )
    rows = _Rows(_table(content, layout, source, first_rows), layout, source)
    frames, parts = rows.frames(), []
    for each in chosen:
        pixels = rows.pixels(each, image_height)
        part = pd.DataFrame({"frame": frames, "u": pixels[:, 0], "v": pixels[:, 1]})
        if len(layout.points) > 1:
            part["point"] = each.point
        for name, index in layout.further:
            part[name] = rows.raw[index].array
        parts.append(part[np.isfinite(pixels).all(axis=1)])
    return pd.concat(parts).sort_values("frame", kind="stable", ignore_index=True)


@dataclass(frozen=True, eq=False)
class BarPoints:
    """Ends of a bar in some frames, as any number of cameras saw them."""

    frame: IntArray
    target: IntArray
    pixels: FloatArray
    """(n, cameras, 2): ours; NaN where a camera did not see it."""

    @classmethod
    def seen_by_two(cls, frame: IntArray, target: IntArray, pixels: FloatArray) -> "BarPoints":
        """Those that two cameras saw, or more."""
        rows = np.isfinite(pixels).all(axis=2).sum(axis=1) >= 2
        return cls(frame[rows], target[rows], pixels[rows])

    @property
    def correspondences(self) -> Correspondences:
        """Of two cameras."""
        names = [TARGETS[target] for target in self.target]
        return Correspondences.from_arrays(self.frame, names, self.pixels[:, 0], self.pixels[:, 1])


def read_bars(
    content: bytes,
    layout: PointLayout,
    cameras: Sequence[str],
    ends: tuple[str, str],
    image_heights: Sequence[int | None],
    source: str = "points",
) -> BarPoints:
    """The ends of a bar that two cameras saw, for calibration.

    Args:
        cameras: their names, the primary first.
        ends: names of the points A and B.
    """
    rows = _Rows(_table(content, layout, source, None), layout, source)
    columns = {(each.camera, each.point): each for each in reversed(layout.columns)}
    found = []
    for end in ends:
        for camera, height in zip(cameras, image_heights, strict=True):
            if (camera, end) not in columns:
                raise StereocalError(f"{source}: there is no point {end} of camera {camera}.")
            found.append(rows.pixels(columns[camera, end], height))
    pixels = np.stack(found).reshape(2, len(cameras), -1, 2).swapaxes(1, 2)
    frames, shape = rows.frames(), (-1, len(cameras), 2)
    ends_of = np.repeat([0, 1], len(frames))
    return BarPoints.seen_by_two(np.tile(frames, 2), ends_of, pixels.reshape(shape))


def _table(
    content: bytes, layout: PointLayout, source: str, first_rows: int | None
) -> pd.DataFrame:
    """The rows below the header, all as text, with their lines as index."""
    text = text_of(content, source)
    Limits.from_environment().check_rows(text.count("\n"), source)
    cells = layout.dialect.cells("".join(head_of(text)[layout.dialect.above :]), source)
    below = [len(row) for row in cells[layout.header_rows :] if any(row)]
    named = max((len(row) for row in cells[: layout.header_rows]), default=max(below, default=0))
    raw, problems = rows_below(text, layout.dialect, layout.header_rows, named, source, first_rows)
    if problems:
        raise RefusedRowsError(f"{source}: ", problems, "cannot be used")
    wanted = [layout.frame, *(index for _, index in layout.further)]
    for each in layout.columns:
        wanted += [each.u, each.v, each.likelihood]
    last = max(index for index in wanted if index is not None)
    there = min(named, below[0] if below else named)
    if there <= last:
        raise StereocalError(
            f"{source}: the layout ({layout.program}) needs {last + 1} columns; the file has "
            f"{there}."
        )
    return raw


@dataclass(frozen=True)
class _Rows:
    """The rows below the header, with their layout."""

    raw: pd.DataFrame
    layout: PointLayout
    source: str

    def frames(self) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """(n,): their frame numbers."""
        if self.layout.frame is None:
            return np.arange(1, len(self.raw) + 1)
        return self._numbers(self.layout.frame, is_whole=True).astype(np.int64)

    def pixels(self, columns: PointColumns, image_height: int | None) -> FloatArray:
        """(n, 2): our pixels; NaN for missing points."""
        layout = self.layout
        if layout.origin.corner == "lower-left" and image_height is None:
            raise StereocalError(
                f"{self.source}: the points are counted from the lower left, so the image height "
                "is needed."
            )
        pixels = np.column_stack([self._numbers(k) for k in (columns.u, columns.v)])
        if layout.zero_is_missing:
            pixels[(pixels == 0).all(axis=1)] = np.nan
        if columns.likelihood is not None:
            pixels[self._numbers(columns.likelihood) < layout.least_likelihood] = np.nan
        pixels[np.isnan(pixels).any(axis=1)] = np.nan
        return layout.origin.to_ours(pixels * layout.px_per_unit, image_height or 0)

    def _numbers(self, index: int, is_whole: bool = False) -> FloatArray:
        name = f"column {index + 1}"
        column = Column(name, may_be_empty=not is_whole, is_whole=is_whole)
        own = self.raw[[index]].set_axis([name], axis=1)
        values, reasons = numbers_in(own, [column], self.layout.dialect.decimal_comma, MISSING)
        if reasons:
            problems = [RowProblem(int(self.raw.index[row]), reasons[row]) for row in reasons]
            raise RefusedRowsError(f"{self.source}: ", problems, "cannot be used")
        return values[name]
