"""Match with one parameter set, measure with the other, and write both tables.

The tables are identical to those of the commands `match` and `reconstruct`.
"""

import hashlib
import io
import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.fit.rig_file import Parameters
from stereocal.matching.match_tables import match_tables
from stereocal.matching.matching import refuse_different_rigs
from stereocal.matching.measure_tables import measure_tables
from stereocal.matching.names import AUTO, WITHIN
from stereocal.matching.pairs import PAIR_COLUMNS
from stereocal.matching.point_table import POINT, SIGMAS, PointTable
from stereocal.matching.reconstruction import name_of_world
from stereocal.matching.settled import Stated
from stereocal.matching.tracks import OF_TRACKS
from stereocal.matching.trajectories import OUTSIDE_VOLUME, POINT_COLUMNS, SIGMA_COLUMNS
from stereocal.matching.views import PAIRS, Views, views_of
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import Recording
from stereocal.rig.rig import PlacedCamera, PlacedCameras, Rig, SeveralCameras
from stereocal.system.csv_text import unquoted, without_apostrophes
from stereocal.system.made_from import changed
from stereocal.system.numbers import count, rounded
from stereocal.system.tasks import Progress
from stereocal.verdict.in_words import listed

POINTS = "points.csv"
STAGES = ("frames matched", "pairs measured")
IN_ALL = "points, parameters or what is stated"
"""Of results of version 1.0, which do not say more."""


@dataclass(frozen=True)
class Points:
    """One camera's points."""

    name: str
    """Name of the table's file: a digest of its content, with an ending."""
    label: str
    """Name of the file in messages."""
    rows: int
    frames: int


@dataclass(frozen=True, eq=False)
class Application:
    """The input: points by camera, what matches and what measures them, and what is stated."""

    points: Mapping[str, Points]
    """Of the primary and the secondary, or of cameras of a rig."""
    matching: Parameters
    measuring: Parameters
    """The same rig, where it is one of three cameras and more."""
    files: Sequence[str]
    """Names of the parameter files: to match with and to measure with, or of the rig."""
    stated: Stated = field(default_factory=Stated)
    world: Pose | None = None
    """`world_from_primary` of the points, of a rig `world_from_reference`; None: points in the
    camera's frame."""

    @property
    def rows(self) -> list[int]:
        """The numbers of points of the cameras."""
        return [points.rows for points in self.points.values()]

    @property
    def views(self) -> Views:
        """How the points are matched."""
        return views_of(self.matching)

    @property
    def made_from(self) -> dict[str, list[Any]]:
        """Digests of the input, and what is stated."""
        stated, world = self.stated, self.world and name_of_world(self.world)
        cameras = [*self.points]
        return {
            "points": [points.name for points in self.points.values()],
            "parameters": [self.matching.digest, self.measuring.digest],
            "threshold, depths, noise, names or world frame": [
                stated.threshold_px,
                [repr(depth) for depth in stated.depths_m],
                ["names", stated.names],
                *([] if cameras == [*CAMERAS] else [cameras]),
                *([] if world is None else [world]),
                *([] if stated.sigma_px is None else [["sigma_px", stated.sigma_px]]),
            ],
        }

    @property
    def digest(self) -> str:
        """Digest of the input, independent of dates."""
        points, parameters, settings = self.made_from.values()
        content = json.dumps([points, parameters, *settings])
        return hashlib.sha256(content.encode()).hexdigest()

    @property
    def used(self) -> dict[str, Any]:
        """What was used, as `Outcome.used` has it."""
        labels = {"points": [points.label for points in self.points.values()]}
        return labels | self.views.used(self.measuring)

    @property
    def shown_depths_m(self) -> list[float | None]:
        """Nearest and farthest, as in `Outcome.depths_m`."""
        return [depth if np.isfinite(depth) else None for depth in self.stated.depths_m]

    @property
    def expected_seconds(self) -> float:
        """Estimated time, for frames with about equal numbers of points."""
        frames, rows = max(points.frames for points in self.points.values()), sum(self.rows)
        parts = frames, rows, rows**2 / max(frames, 1)
        return float(np.dot(self.views.seconds, parts))


@dataclass(frozen=True)
class Outcome:
    """The result in numbers and sentences."""

    digest: str
    """Of the `Application`."""
    threshold_px: float
    """0 for a rig, where the noise of the points decides."""
    depths_m: list[float | None]
    """Nearest and farthest; None is unlimited."""
    pairs: int
    sentences: list[str]
    notes: list[str]
    """Warnings, a sentence each."""
    made_with: str
    tables: list[str]
    """Names of the cameras' tables in the project, in the order of `cameras`."""
    measured_with: dict[str, Any]
    """Cameras and poses that measured, and the world frame of the points, as JSON."""
    used: dict[str, Any] = field(default_factory=dict)
    """`points`: the labels of the files; of two cameras `matching`, `measuring`: method and digest
    of the sets. Empty in results of version 1.0."""
    sigma_px: float | None = None
    """Noise of the points, if it was stated."""
    names: str = AUTO
    """As of the `Application`."""
    matched: str = PAIRS
    """Name of the table of what belongs together."""
    cameras: list[str] = field(default_factory=lambda: [*CAMERAS])
    """Those whose points were given."""
    files: list[str] = field(default_factory=list)
    """As of the `Application`; empty in results of version 1.0."""
    made_from: dict[str, list[Any]] = field(default_factory=dict)
    """As of the `Application`; empty in results of version 1.0."""

    def changed_since(self, work: Application) -> str:
        """What of an input is another than it was for this result, as a list in words; empty if the
        result is current."""
        if self.made_from:
            return changed(self.made_from, work.made_from)
        return changed({IN_ALL: [self.digest]}, {IN_ALL: [work.digest]})

    @property
    def rig(self) -> PlacedCameras:
        """The cameras that measured, and their poses."""
        stored = self.measured_with
        if (several := stored.get("rig")) is not None:
            return SeveralCameras(
                {name: PlacedCamera.from_json(placed, name) for name, placed in several.items()}
            )
        # As results of two cameras were stored before.
        first, second = (Camera.from_json(stored[name], name) for name in CAMERAS)
        return Rig(first, second, Pose.from_json(stored))

    @property
    def world(self) -> Pose | None:
        """`world_from_primary` of the points; None: they are in the primary's frame."""
        stored = self.measured_with.get("world_from_primary")
        if stored is None:
            return None
        table = np.array(stored, dtype=np.float64)
        return Pose(table[:3, :3], table[:3, 3])


def apply_sets(
    work: Application,
    tables: Mapping[str, PointTable],
    folder: Path,
    begin: Callable[[str], None] = lambda _: None,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> Outcome:
    """Write `pairs.csv`, of a rig `tracks.csv`, and `points.csv` into a folder.

    Args:
        tables: the points by camera.
        executor: computes blocks of both tables; None: the calling thread.
    """
    rig, measuring, stated = work.matching, work.measuring, work.stated
    if rig.digest != measuring.digest:
        refuse_different_rigs(
            *(parameters.pair(*parameters.placed) for parameters in (rig, measuring))
        )
    begin(STAGES[0])
    rows: list[pd.DataFrame] = []
    table = work.views.TABLE
    out = folder / table
    matched = match_tables(rig, tables, out, stated, None, progress, executor, passed_on=rows)
    if not matched.rows:
        raise StereocalError(work.views.NONE_FOUND.format(rounded(matched.threshold_px, 3)))
    begin(STAGES[1])
    whole = pd.concat(rows, ignore_index=True)
    rows.clear()  # in memory once
    together = views_of(measuring).table(whole, table)
    measured = measure_tables(
        measuring, together, folder / POINTS, work.world, matched.sigma_px, progress, executor
    )
    return Outcome(
        digest=work.digest,
        threshold_px=matched.threshold_px,
        depths_m=work.shown_depths_m,
        pairs=matched.rows,
        sentences=[*matched.sentences, *measured.sentences],
        notes=[*matched.notes, *measured.notes],
        made_with=_made_with(work, matched.threshold_px),
        tables=[points.name for points in work.points.values()],
        measured_with=_measured_with(work),
        used=work.used,
        sigma_px=stated.sigma_px,
        names=stated.names,
        matched=table,
        cameras=[*work.points],
        files=[*work.files],
        made_from=work.made_from,
    )


def _made_with(work: Application, threshold_px: float) -> str:
    labels = listed([points.label for points in work.points.values()])
    frame = "" if work.world is None else f", in the world frame {name_of_world(work.world)}"
    sets = work.views.in_words(work.files, work.measuring, threshold_px, work.stated)
    return f"{labels}; {sets}{frame}."


def _measured_with(work: Application) -> dict[str, Any]:
    world = work.world
    frame = None if world is None else np.column_stack([world.R, world.T]).tolist()
    placed = {name: placed.to_json() for name, placed in work.measuring.placed.items()}
    return {"rig": placed, "world_from_primary": frame}


def result_in_words(pairs: pd.DataFrame, points: pd.DataFrame) -> str:
    """The result in one sentence.

    Args:
        pairs: rows of `pairs.csv`; `points`: of `points.csv`.
    """
    frames, ambiguous = pairs["frame"].nunique(), int(pairs["ambiguous"].sum())
    what = "point" if "views" in pairs else "pair"
    text = (
        f"{count(len(pairs), what)} in {count(frames, 'frame')}, "
        f"{f'{ambiguous:,}' if ambiguous else 'none'} of them ambiguous"
    )
    if OUTSIDE_VOLUME in points:
        measured = np.isfinite(points["x"].to_numpy(dtype=np.float64))
        outside = int((points[OUTSIDE_VOLUME].to_numpy(dtype=bool) & measured).sum())
        text += f", {f'{outside:,}' if outside else 'none'} outside the volume of the bars"
    return text + "."


def read_result(content: bytes) -> pd.DataFrame:
    """A table of `apply_sets`; what the user's tables had stays text, as names must.

    Raises:
        ValueError: it is damaged.
    """
    names = pd.read_csv(io.BytesIO(content), nrows=0).columns
    columns = {"frame", *POINT_COLUMNS, *SIGMA_COLUMNS, OUTSIDE_VOLUME, WITHIN, *PAIR_COLUMNS}
    columns |= {*OF_TRACKS, *SIGMAS}
    texts = [name for name in names if name not in columns and name[:2] not in ("u_", "v_")]
    table = pd.read_csv(
        io.BytesIO(content), dtype=dict.fromkeys(texts, str), keep_default_na=False, na_values=[""]
    )
    for name in texts:
        table[name] = without_apostrophes(table[name])
    return table.rename(columns=unquoted)


def agreement(pairs: pd.DataFrame) -> str | None:
    """How many pairs have equal values in a column of both tables that was not used for matching;
    None without such a column.
    """
    if WITHIN in pairs:
        return None
    for name in pairs.columns:
        first = str(name).removesuffix("_primary")
        other = f"{first}_secondary"
        if first == name or first in POINT or other not in pairs:
            continue
        same = int((pairs[name].astype(str) == pairs[other].astype(str)).sum())
        return (
            f"{same:,} of {count(len(pairs), 'pair')} have the same {first} in both cameras (not "
            "used for matching)."
        )
    return None


def points_by_camera(recording: Recording) -> dict[str, pd.DataFrame]:
    """The object's points as a table of each camera that sees any; `target` is passed through and
    not used for matching."""
    targets = np.array(recording.object.names)[recording.target]
    u, v = recording.recorded_points.T
    table = pd.DataFrame({"frame": recording.frame, "u": u, "v": v, "target": targets})
    if recording.time_frame is not None:
        table["time_frame"] = recording.time_frame
    table = table.iloc[np.lexsort([recording.target, recording.frame])]
    of = recording.camera[table.index]
    return {name: table[of == k] for k, name in enumerate(recording.cameras) if (of == k).any()}
