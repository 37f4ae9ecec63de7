"""Match with one parameter set, measure with the other, and write both tables.

The tables are identical to those of the commands `match` and `reconstruct`.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.matching.matching import ANY_DEPTH, refuse_different_rigs
from stereocal.matching.matching_files import match_tables
from stereocal.matching.names import AUTO, WITHIN, Sample
from stereocal.matching.pairs import PIXELS, POINT
from stereocal.matching.point_table import PointTable
from stereocal.matching.reconstruction import name_of_world
from stereocal.matching.reconstruction_files import OUTSIDE_VOLUME, reconstruct_table
from stereocal.matching.threshold import sample_of
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.dataset import Correspondences
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import PlacedCamera, PlacedCameras, Rig, SeveralCameras
from stereocal.system.numbers import count, rounded

PAIRS, POINTS = "pairs.csv", "points.csv"
LARGE_ERRORS = " The 3D set is fitted to lengths; its reprojection errors may be large."
STAGES = ("frames matched", "pairs measured")
SECONDS_PER_FRAME, SECONDS_PER_ROW, SECONDS_PER_PAIR = 3.5e-3, 2.2e-5, 6e-9
"""CPU time per frame, row and candidate pair: within 10 % of the measured 1.4 s for 400 frames of 3
points and 11.6 s for 200 frames of 1,000."""


@dataclass(frozen=True)
class Points:
    """One camera's points."""

    name: str
    """Name of the table's file: a digest of its content, with an ending."""
    label: str
    """Name of the file in messages."""
    rows: int
    frames: int


class Input(Protocol):
    """What a result is compared with."""

    @property
    def used(self) -> dict[str, Any]:
        """As of `Outcome`."""

    @property
    def shown_depths_m(self) -> list[float | None]:
        """As of `Outcome.depths_m`."""

    @property
    def sigma_px(self) -> float | None:
        """Noise of the points, if it was stated."""


@dataclass(frozen=True, eq=False)
class Application:
    """The input: points, parameter sets, threshold and depth range."""

    primary: Points
    secondary: Points
    matching: RigParameters
    measuring: RigParameters
    threshold_px: float | None = None
    """None: by the noise of the points."""
    depths_m: tuple[float, float] = ANY_DEPTH
    world: Pose | None = None
    """`world_from_primary` of the points; None: points in the primary's frame."""
    sigma_px: float | None = None
    """Noise of the points; None: by their columns, or estimated."""
    names: str = AUTO
    """As of `pairs.match`."""

    @property
    def points(self) -> dict[str, Points]:
        """By camera."""
        return dict(zip(CAMERAS, (self.primary, self.secondary), strict=True))

    @property
    def rows(self) -> list[int]:
        """The numbers of points of the cameras."""
        return [self.primary.rows, self.secondary.rows]

    @property
    def digest(self) -> str:
        """Digest of the input, independent of dates."""
        content: list[Any] = [
            [self.primary.name, self.secondary.name],
            [digest_of(each) for each in (self.matching, self.measuring)],
            self.threshold_px,
            [repr(depth) for depth in self.depths_m],
            ["names", self.names],
        ]
        if self.world is not None:
            content.append(name_of_world(self.world))
        if self.sigma_px is not None:
            content.append(["sigma_px", self.sigma_px])
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()

    @property
    def used(self) -> dict[str, Any]:
        """The labels of both files, and method and digest of the sets, as in `Outcome.used`."""
        return {
            "points": [self.primary.label, self.secondary.label],
            "matching": [self.matching.method, digest_of(self.matching)],
            "measuring": [self.measuring.method, digest_of(self.measuring)],
        }

    @property
    def shown_depths_m(self) -> list[float | None]:
        """Nearest and farthest, as in `Outcome.depths_m`."""
        return [depth if np.isfinite(depth) else None for depth in self.depths_m]

    @property
    def expected_seconds(self) -> float:
        """Estimated time, for frames with about equal numbers of points."""
        rows = self.primary.rows + self.secondary.rows
        frames = max(self.primary.frames, self.secondary.frames)
        pairs = self.primary.rows * self.secondary.rows / max(frames, 1)
        return SECONDS_PER_FRAME * frames + SECONDS_PER_ROW * rows + SECONDS_PER_PAIR * pairs


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
    behind: int
    """Pairs that do not meet in front of both cameras."""
    sentences: list[str]
    notes: list[str]
    """Warnings, a sentence each."""
    made_with: str
    tables: list[str]
    """Names of the cameras' tables in the project, in the order of `cameras`."""
    measured_with: dict[str, Any]
    """Cameras and poses that measured, and the world frame of the points, as JSON."""
    used: dict[str, Any] = field(default_factory=dict)
    """`points`: the labels of the files; `matching`, `measuring`: method and digest of the sets, or
    `rig`: its digest. Empty in results of version 1.0."""
    sigma_px: float | None = None
    """Noise of the points, if it was stated."""
    names: str = AUTO
    """As of the `Application`."""
    matched: str = PAIRS
    """Name of the table of what belongs together."""
    cameras: list[str] = field(default_factory=lambda: [*CAMERAS])
    """Those whose points were given."""

    def changed_since(self, work: Input) -> str:
        """What of an input is another than it was for this result, as a list in words."""
        used = self.used | {"depths": self.depths_m, "sigma_px": self.sigma_px}
        now = work.used | {"depths": work.shown_depths_m, "sigma_px": work.sigma_px}
        names = {
            "points": "points",
            "matching": "set to match with",
            "measuring": "set to measure with",
            "rig": "rig",
            "depths": "depths",
            "sigma_px": "noise of the points",
        }
        found = [name for key, name in names.items() if used.get(key) != now.get(key)]
        return ", ".join(found) or "threshold or world frame"

    @property
    def rig(self) -> PlacedCameras:
        """The cameras that measured, and their poses."""
        if (several := self.measured_with.get("rig")) is not None:
            return SeveralCameras(
                {
                    name: PlacedCamera(
                        Camera.from_json(own, name), Pose(*(np.array(own[key]) for key in "RT"))
                    )
                    for name, own in several.items()
                }
            )
        first, second = (Camera.from_json(self.measured_with[name], name) for name in CAMERAS)
        R, T = (np.array(self.measured_with[key], dtype=np.float64) for key in "RT")
        return Rig(first, second, Pose(R, T))

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
    tables: Mapping[str, Path],
    folder: Path,
    begin: Callable[[str], None] | None = None,
    progress: Callable[[int, int], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
    executor: Executor | None = None,
) -> Outcome | None:
    """Write `pairs.csv` and `points.csv` into a folder; None if cancelled.

    Args:
        tables: the points by camera.
        executor: computes blocks of both tables; None: the calling thread.
    """
    refuse_different_rigs(work.matching, work.measuring)
    if begin is not None:
        begin(STAGES[0])
    first, second = (
        PointTable(tables[name], POINT, points.label) for name, points in work.points.items()
    )
    how: dict[str, Any] = {"progress": progress, "cancelled": cancelled, "executor": executor}
    given = work.threshold_px, work.depths_m
    pairs = folder / PAIRS
    matched = match_tables(
        work.matching, first, second, pairs, *given, sigma_px=work.sigma_px, names=work.names, **how
    )
    if matched is None:
        return None
    chosen = matched.chosen
    if not matched.pairs:
        raise StereocalError(
            f"No pair of points has an error of {rounded(chosen.threshold_px, 3)} px or less: "
            "raise the threshold, or make sure that points, parameters and the two cameras "
            "(primary, secondary) belong together."
        )
    if begin is not None:
        begin(STAGES[1])
    measured = reconstruct_table(
        work.measuring, PointTable(pairs, PIXELS, PAIRS), folder / POINTS, work.world, **how
    )
    if measured is None:
        return None
    return Outcome(
        digest=work.digest,
        threshold_px=chosen.threshold_px,
        depths_m=work.shown_depths_m,
        pairs=matched.pairs,
        behind=measured.behind,
        sentences=[
            chosen.sentence(),
            matched.sentence(),
            measured.sentence() + LARGE_ERRORS * (work.measuring.purpose == "reconstruction"),
            measured.about_errors,
        ],
        notes=[*matched.notes, *measured.notes],
        made_with=_made_with(work, chosen.threshold_px),
        tables=[work.primary.name, work.secondary.name],
        measured_with={
            "primary": work.measuring.primary.to_json(),
            "secondary": work.measuring.secondary.to_json(),
            "R": work.measuring.pose.R.tolist(),
            "T": work.measuring.pose.T.tolist(),
            "world_from_primary": world_to_json(work.world),
        },
        used=work.used,
        sigma_px=work.sigma_px,
        names=work.names,
    )


def world_to_json(world: Pose | None) -> list[list[float]] | None:
    """(3, 4) of a world frame."""
    return None if world is None else np.column_stack([world.R, world.T]).tolist()


def sample_frames(primary: pd.DataFrame, secondary: pd.DataFrame) -> Sample:
    """A sample of the frames common to both tables, to choose a threshold from."""
    common = np.intersect1d(primary["frame"], secondary["frame"])
    wanted = sorted(sample_of(common, len(primary) / max(primary["frame"].nunique(), 1)))
    sides = []
    for table in (primary, secondary):
        rows = table[table["frame"].isin(wanted)]
        sides.append(dict(list(rows.groupby("frame"))))
    return [(sides[0][frame], sides[1][frame]) for frame in wanted]


def unlabelled(rows: Correspondences) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The bar's points as two tables; `target` is passed through and not used for matching."""
    targets = np.array(rows.names)[rows.target]
    order = np.lexsort([rows.target, rows.frame])
    first, second = (
        pd.DataFrame(
            {"frame": rows.frame, "u": side[:, 0], "v": side[:, 1], "target": targets}
            | ({"time_frame": rows.time_frame} if rows.has_times else {})
        ).iloc[order]
        for side in (rows.primary, rows.secondary)
    )
    return first, second


def answer(pairs: pd.DataFrame, points: pd.DataFrame) -> str:
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


def digest_of(rig: RigParameters) -> str:
    """Digest of a parameter set, independent of date and version."""
    content = rig.to_json()
    for key in ("created", "software"):
        del content[key]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _made_with(work: Application, threshold_px: float) -> str:
    near, far = work.depths_m
    frame = "" if work.world is None else f", in the world frame {name_of_world(work.world)}"
    depths = "" if work.depths_m == ANY_DEPTH else f", depths from {near:g} to {far:g} m"
    return (
        f"{work.primary.label} and {work.secondary.label}; matched with the "
        f"{work.matching.set_name}, threshold {rounded(threshold_px, 4)} px{depths}; measured with "
        f"the {work.measuring.set_name}{frame}."
    )
