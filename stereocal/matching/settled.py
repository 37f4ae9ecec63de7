"""How points are matched: what a person states, and what is settled before the first frame."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from stereocal.matching.matching import ANY_DEPTH
from stereocal.matching.names import AUTO, Names
from stereocal.matching.point_table import POINT, SIGMAS
from stereocal.matching.tables_by_camera import Report, TablesByCamera
from stereocal.system.array_types import IntArray

ERROR_DECIMALS = 6


@dataclass(frozen=True)
class Stated:
    """What a person states about the points to be matched."""

    threshold_px: float | None = None
    """Of two cameras; None: by the noise of the points."""
    depths_m: tuple[float, float] = ANY_DEPTH
    """Nearest and farthest in the primary's frame, of two cameras."""
    sigma_px: float | None = None
    """The noise of the points, if it is known; None: that of the column `sigma_px`, else
    estimated."""
    names: str = AUTO
    """`AUTO`: where all tables name their points (`names.name_columns`), only points of one name
    belong together; `OFF`: names are not used; else the columns that name points."""
    usual_px: float | None = None
    """The noise taken where none is stated and points of two cameras do not show their own; None:
    that of the targets."""


class Settled(NamedTuple):
    """What is settled before points are measured that a person clicked."""

    sigma_px: float
    """The noise of the clicks."""
    threshold_px: float = 0.0
    """Of two cameras; of more, the noise decides."""


def further_of(columns: Iterable[Any]) -> list[str]:
    """The columns of a table of points that are passed through."""
    return [str(name) for name in columns if name not in ("frame", *POINT, *SIGMAS)]


@dataclass(frozen=True, eq=False)
class Matching(ABC):
    """How the points of some cameras are matched: what is settled before the first frame."""

    cameras: tuple[str, ...]
    """Those whose points are given."""
    further: Sequence[Mapping[str, str]]
    """Of each camera the columns that are passed through, and their names in the table."""
    columns: list[str] | None
    """Of the table that is written; None: all that `match_frame` makes."""
    reported: list[str]
    """Those of what belongs together that the report needs."""
    names: Names
    contradiction: str
    """A note on names that the images contradict."""

    def match_frame(
        self, frame: int, rows: Sequence[pd.DataFrame]
    ) -> tuple[pd.DataFrame, list[IntArray]]:
        """What belongs together in one frame, and the rows (n,) of each camera without a partner.

        Args:
            rows: of each of `cameras`.
        """
        images, of_groups = self.groups(rows)
        columns: dict[str, Any] = {"frame": np.full(len(images), frame)}
        for camera, table, image in zip(self.cameras, rows, images.T, strict=True):
            for axis in POINT:
                pixels = np.append(table[axis].to_numpy(np.float64), np.nan)
                columns[f"{axis}_{camera}"] = pixels[image]  # -1 is the last one
        columns |= of_groups
        for names, table, image in zip(self.further, rows, images.T, strict=True):
            columns |= {new: self._passed(table[name], image) for name, new in names.items()}
        left = [
            np.setdiff1d(np.arange(len(n)), image) for n, image in zip(rows, images.T, strict=True)
        ]
        return pd.DataFrame(columns), left

    def _passed(self, column: "pd.Series[Any]", image: IntArray) -> Any:
        if len(self.cameras) == 2:  # both see every point
            return column.array[image]
        values = column.tolist()
        passed = [None if k < 0 else values[k] for k in image.tolist()]
        return pd.Series(passed, dtype=object)  # 1 does not become 1.0

    @abstractmethod
    def groups(self, rows: Sequence[pd.DataFrame]) -> tuple[IntArray, dict[str, Any]]:
        """The row (k, c) of each camera's points that belong together in one frame, -1 where it
        does not see the point, and columns about each."""

    @abstractmethod
    def report(self, reported: pd.DataFrame, by_camera: TablesByCamera) -> Report:
        """The result, by the columns `reported` of all frames."""
