"""The tables of points of two cameras or more, checked once, then read frame by frame; and the
report of what was found in them."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, reduce
from heapq import merge
from itertools import groupby, repeat

import numpy as np
import pandas as pd

from stereocal.errors import RowProblem, StereocalError
from stereocal.matching.names import AUTO, NO_NAMES, Names, stated_columns
from stereocal.matching.point_table import POINT, Contents, PointTable, pixels_of
from stereocal.rig.camera import Camera
from stereocal.rig.field_of_view import count_beyond
from stereocal.rig.rig import PlacedCameras
from stereocal.system.array_types import IntArray
from stereocal.system.numbers import count

OTHER_IMAGES = 0.2
"""With a larger fraction of points outside the image, the parameters are of other images."""
Frame = tuple[int, list[pd.DataFrame]]
"""Number, and rows of each camera, in the order of the tables; none where it saw nothing."""


@dataclass(frozen=True)
class Report:
    """The result of matching tables of points, or of measuring what belongs together."""

    rows: int
    """Rows of the table that was written: pairs, tracks of several cameras, or 3D points."""
    sentences: list[str]
    notes: list[str] = field(default_factory=list)
    """Warnings, a sentence each."""
    lost: int = 0
    """Rows that do not meet in front of the cameras; their coordinates are empty."""
    threshold_px: float = 0.0
    """With which two cameras were matched; 0 of more, where the noise of the points decides."""
    sigma_px: float | None = None
    """The stated noise of the points, to measure them with; None: not stated, or in the table."""
    names: Names = NO_NAMES
    """Those by which points were matched."""


@dataclass(frozen=True, eq=False)
class TablesByCamera:
    """Tables `frame,u,v` with further columns, and what was found when they were checked."""

    tables: Mapping[str, PointTable]
    contents: Mapping[str, Contents]
    columns: tuple[str, ...]
    """The columns that may name points."""
    beyond: Mapping[str, int]
    """By camera, how many points are beyond the view of its fisheye; they have no partner."""

    @classmethod
    def checked(
        cls, tables: Mapping[str, PointTable], rig: PlacedCameras, names: str = AUTO
    ) -> "TablesByCamera":
        """Read each table once and check its points.

        Args:
            rig: which has cameras of these names.
            names: as of `names.stated_columns`.
        """
        columns = stated_columns(names, *(table.further for table in tables.values()))
        beyond = dict.fromkeys(tables, 0)
        contents = {
            name: _check_points(table, rig.placed[name].camera, name, columns, beyond)
            for name, table in tables.items()
        }
        return cls(tables, contents, columns, beyond)

    @cached_property
    def frames(self) -> IntArray:
        """The frames of any table, in order."""
        return reduce(np.union1d, (contents.frames for contents in self.contents.values()))

    @property
    def distinct(self) -> list[pd.DataFrame]:
        """The different names in each table."""
        return [contents.distinct for contents in self.contents.values()]

    @property
    def left_out(self) -> dict[str, str]:
        """A note on the rows without a point, by camera."""
        return {
            name: f"{self.tables[name].label}: {count(contents.left_out, 'row')} without a point "
            "left out."
            for name, contents in self.contents.items()
            if contents.left_out
        }

    def side_by_side(self) -> Iterator[Frame]:
        """Each frame of any table in order, with its rows in all of them."""
        tables = list(self.tables.values())
        empty = [
            pd.DataFrame({name: [] for name in ("frame", *POINT, *table.sigmas, *table.further)})
            for table in tables
        ]
        numbered = (zip(repeat(k), table.frames(), strict=False) for k, table in enumerate(tables))
        for frame, sides in groupby(merge(*numbered, key=_frame_of), key=_frame_of):
            seen = {k: rows for k, (_, rows) in sides}
            yield frame, [seen.get(k, none) for k, none in enumerate(empty)]


def _frame_of(side: tuple[int, tuple[int, pd.DataFrame]]) -> int:
    return side[1][0]


def _check_points(
    table: PointTable, camera: Camera, which: str, columns: tuple[str, ...], beyond: dict[str, int]
) -> Contents:
    """What is in a table; to `beyond` is added how many points are beyond the camera's view."""
    size = np.array(camera.image_size)
    image = f"{size[0]}x{size[1]} px"

    def refuse(block: pd.DataFrame) -> list[RowProblem]:
        pixels = pixels_of(block)
        off = camera.outside(pixels)
        if len(off) > OTHER_IMAGES * len(block):
            u, v = pixels.max(axis=0)
            raise StereocalError(
                f"{table.label}: the points of the {which} camera reach ({u:.0f}, {v:.0f}) px, but "
                f"the parameters are of images of {image}: they are of another camera, or the "
                "images were scaled or cropped."
            )
        beyond[which] += count_beyond(camera, pixels)
        again = np.flatnonzero(block.duplicated(["frame", *POINT]).to_numpy())
        lines, frames = block.index.to_numpy(), block["frame"].to_numpy()
        twice = [
            (row, f"point ({u:g}, {v:g}) is there twice")
            for row, (u, v) in zip(again.tolist(), pixels[again], strict=True)
        ]
        problems = [
            RowProblem(int(lines[row]), f"frame {frames[row]}: the {which} {what}")
            for row, what in off + twice
        ]
        return sorted(problems, key=lambda problem: problem.line)

    return table.check(refuse, columns)


def pixel_columns(rig: PlacedCameras) -> list[str]:
    """The columns of image points in a table of pairs, or of tracks."""
    return [f"{axis}_{name}" for name in rig.placed for axis in POINT]


def without_partner(
    rows: Sequence[pd.DataFrame], cameras: Iterable[str], left: Sequence[IntArray]
) -> pd.DataFrame:
    """The rows of each camera in one frame that have no partner, with the camera's name.

    Args:
        left: (n,) of each camera: which rows.
    """
    lonely = [table.iloc[rows_left] for table, rows_left in zip(rows, left, strict=True)]
    for camera, alone in zip(cameras, lonely, strict=True):
        alone.insert(0, "camera", camera)
    return pd.concat(lonely)
