"""Match and measure tables in memory: results are tables that say what was found."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.fit.rig_file import Parameters
from stereocal.library.drawing import draw
from stereocal.matching.match_tables import match_tables
from stereocal.matching.matching import ANY_DEPTH
from stereocal.matching.measure_tables import measure_tables
from stereocal.matching.names import AUTO
from stereocal.matching.pairs import PAIR_COLUMNS, further_names
from stereocal.matching.point_table import PointTable
from stereocal.matching.settled import Stated
from stereocal.matching.tables_by_camera import Report
from stereocal.matching.trajectories import POINT_COLUMNS
from stereocal.matching.views import views_of
from stereocal.rig.camera import CAMERAS
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import PlacedCameras
from stereocal.system.answers import TableAnswer
from stereocal.system.arguments import checked

if TYPE_CHECKING:
    import plotly.graph_objects as go

NOTHING = Report(0, ["Nothing to match: the tables have no frame in common."])


class _Table(TableAnswer, pd.DataFrame):
    """A table with the report of how it was made; what is cut out of it is a plain table."""

    _metadata = ["report"]  # noqa: RUF012 - pandas asks for it
    report: Report

    @classmethod
    def of(cls, table: pd.DataFrame, report: Report) -> Self:
        """The table with its report."""
        result = cls(table)
        result.report = report
        return result

    @property
    def _constructor(self) -> type[pd.DataFrame]:
        return pd.DataFrame

    @property
    def answer(self) -> list[str]:
        return [*self.report.sentences, *(f"Note: {note}" for note in self.report.notes)]

    def __deepcopy__(self, memo: Any = None) -> Self:
        copied = type(self)(pd.DataFrame(self).copy())
        for name in self._metadata:
            setattr(copied, name, copy.deepcopy(getattr(self, name), memo))
        return copied

    def to_dataframe(self) -> pd.DataFrame:
        """The plain table."""
        return pd.DataFrame(self)


class Pairs(_Table):
    """Pairs of points, of a rig tracks; the columns are those of `pairs.csv` and `tracks.csv`."""

    @checked
    def plot(self) -> go.Figure:  # type: ignore[override]
        """The errors of the pairs, and of their second-best partners, with the threshold."""
        table = self.to_dataframe().reindex(columns=["error_px", "runner_up_px"])
        errors_px = table.to_numpy(dtype=np.float64)
        return draw("matches.plot_pair_errors", errors_px, self.report.threshold_px)


class Points(_Table):
    """3D points in metres; the columns are those of `points.csv`."""

    _metadata = ["report", "rig", "world"]  # noqa: RUF012 - pandas asks for it
    rig: PlacedCameras
    world: Pose | None

    @checked
    def plot(self, colour: Literal["frame", "error"] = "error") -> go.Figure:  # type: ignore[override]
        """The points in space with the cameras."""
        return draw("measured.plot_points", self.to_dataframe(), colour, self.rig, world=self.world)


@checked
def match(
    rig: Parameters,
    primary: pd.DataFrame | Mapping[str, pd.DataFrame],
    secondary: pd.DataFrame | None = None,
    threshold_px: float | Literal["auto"] | None = "auto",
    depths_m: tuple[float, float] = ANY_DEPTH,
    sigma_px: float | None = None,
    names: str = AUTO,
) -> Pairs:
    """Match the points of two cameras, or of those of a rig.

    Args:
        rig: the set to match with; or a rig.
        primary, secondary: tables with the columns `frame`, `u`, `v` (raw pixels) and any further
            ones, which are carried along; of a rig one mapping of tables by camera. Rows without
            `u` and `v` are left out.
        threshold_px: "auto" or None: by the noise of the points.
        depths_m: nearest and farthest in front of the primary camera.
        sigma_px: the noise of the points, if it is known; None: that of the column `sigma_px`,
            else estimated.
        names: "auto": where all tables name their points (`names.name_columns`), only points of
            one name belong together; "none": names are not used; else the columns that name them.

    Returns:
        The pairs, with the columns of `pairs.csv`, ordered by frame; of a rig its tracks.

    Raises:
        StereocalError: a column is missing, a number is none, or a point is outside its image.
    """
    tables: dict[str, pd.DataFrame] = (
        dict(primary) if isinstance(primary, Mapping) else {CAMERAS[0]: primary}
    )
    if secondary is not None:
        tables[CAMERAS[1]] = secondary
    if not tables:
        raise StereocalError("There are no points to match: give a table of each camera.")
    given = {
        which: PointTable(table, label=f"the {which} table") for which, table in tables.items()
    }
    first, last = (tables[name]["frame"] for name in (min(tables), max(tables)))
    two = len(tables) == 2 and views_of(rig).IN_PAIRS
    apart = two and rig.pair(*rig.placed).start_frame and len(first) and len(last)
    if two and not apart and not len(np.intersect1d(first, last)):
        further = further_names(*map(tuple, tables.values()))
        columns = [*PAIR_COLUMNS, *(name for names in further for name in names.values())]
        return Pairs.of(pd.DataFrame(columns=columns), NOTHING)
    limit = None if threshold_px == "auto" else threshold_px
    rows: list[pd.DataFrame] = []
    stated = Stated(limit, depths_m, sigma_px, names)
    report = match_tables(rig, given, None, stated, passed_on=rows)
    return Pairs.of(pd.concat(rows, ignore_index=True), report)


@checked
def reconstruct(
    rig: Parameters, pairs: pd.DataFrame, world: Pose | None = None, sigma_px: float | None = None
) -> Points:
    """3D points of what `match` returns.

    Args:
        rig: the set to measure with; or a rig.
        world: `world_from_primary`; None: points in the primary's frame, in metres.
        sigma_px: standard deviation of a pixel coordinate, for `sigma_x`, `sigma_y`, `sigma_z`.
            None: by the columns `sigma_primary_px` and `sigma_secondary_px`, else estimated from
            the pairs, else that of the calibration's targets.

    Returns:
        `frame,x,y,z,error_px`, then any standard errors, then `outside_volume` if the parameters
        know the volume of the bars, then `coordinates` with the name of the world frame, if there
        is one, then the further columns, then `track` if trajectories are known (`with_track`).
        NaN, and outside, for pairs that do not meet in front of both cameras.

    Raises:
        StereocalError: a column is missing, or a point outside its image.
    """
    if not len(pairs):
        measured, report = pd.DataFrame(columns=[*POINT_COLUMNS]), Report(0, ["No points."])
    else:
        rows: list[pd.DataFrame] = []
        table = views_of(rig).table(pd.DataFrame(pairs), "the table of pairs")
        report = measure_tables(rig, table, None, world, sigma_px, passed_on=rows)
        measured = pd.concat(rows, ignore_index=True)
    points = Points.of(measured, report)
    points.rig, points.world = rig, world
    return points
