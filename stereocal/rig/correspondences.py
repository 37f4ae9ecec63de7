"""Image points of the targets in two cameras, row by row."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from stereocal.errors import PointsOutsideError, RowProblem, refuse
from stereocal.rig.camera import CAMERAS, Camera, CameraName
from stereocal.rig.field_of_view import beyond_either
from stereocal.rig.rigid_object import RigidObject, parts_of_bars
from stereocal.system.array_types import FloatArray, IntArray

TARGETS = ("A", "B")
PIXELS = ("u_primary", "v_primary", "u_secondary", "v_secondary")
KNOWN_POINT = ("x_m", "y_m", "z_m")
SIGMAS = ("sigma_primary_px", "sigma_secondary_px")
OPTIONAL = ("distance_m", *KNOWN_POINT, *SIGMAS)
SOURCE, TIME = "source", "time_frame"
OBJECT = ("x_object_m", "y_object_m", "z_object_m")
"""Columns of `correspondences.csv`; the last are where the target is on a rigid object, in the
object's own frame."""
SOURCES = ("detected", "corrected", "manual")
"""Origin of an image point: detector, detector after a user's click, or user alone."""
UNKNOWN_SOURCE = -1
SHAPES: Mapping[str, tuple[int, ...]] = {
    **dict.fromkeys(("target", "distance_m", "sigma_primary_px", "sigma_secondary_px"), ()),
    **dict.fromkeys(("source", "line", "time_frame"), ()),
    **dict.fromkeys(("primary", "secondary", "recorded"), (2,)),
    **dict.fromkeys(("known_points_m", "motion"), (3,)),
}
"""The shape of a row of each column of correspondences."""


def _missing() -> Any:
    """A column that is not given."""
    return np.empty(0)


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Image points of the targets in both cameras, one row per frame and target.

    All arrays have n rows. Pixels are raw (distorted); (0, 0) is the centre of the top-left pixel.
    """

    frame: IntArray
    target: IntArray
    """0 for A, 1 for B; of an object, index into its names."""
    primary: FloatArray
    """(n, 2)."""
    secondary: FloatArray
    """(n, 2)."""
    distance_m: FloatArray = field(default_factory=_missing)
    """Distance A-B measured for this frame; NaN to use the distance of the data set."""
    known_points_m: FloatArray = field(default_factory=_missing)
    """(n, 3) known 3D points in the primary camera's frame; NaN if unknown."""
    sigma_primary_px: FloatArray = field(default_factory=_missing)
    """Standard error of each coordinate of the primary point; NaN if unknown."""
    sigma_secondary_px: FloatArray = field(default_factory=_missing)
    source: IntArray = field(default_factory=_missing)
    """Index into `SOURCES`; -1 if unknown."""
    line: IntArray = field(default_factory=_missing)
    """Line of the row in its file, for messages; 0 if there is no file."""
    time_frame: IntArray = field(default_factory=_missing)
    """The frame's number as recorded, gaps and all; `frame` if not given."""
    recorded: FloatArray = field(default_factory=_missing)
    """(n, 2): the secondary point as recorded; NaN where `secondary` is that."""
    motion: FloatArray = field(default_factory=_missing)
    """(n, 3): velocity of the secondary point in pixels per frame, and the variance of its position
    over that of a recorded one; NaN if unknown."""
    rigid_object: RigidObject | None = None
    """What carries the targets; None for a bar of A and B."""

    def __post_init__(self) -> None:
        n = len(self.frame)
        unknown = {"time_frame": self.frame, "line": 0, "source": UNKNOWN_SOURCE}
        for name, shape in SHAPES.items():
            if not len(getattr(self, name)):
                values = np.full((n, *shape), unknown.get(name, np.nan))
                object.__setattr__(self, name, values)
            actual = getattr(self, name).shape
            wrong = actual != (n, *shape)
            refuse((wrong, f"{name} has shape {actual}; it must be {(n, *shape)}."))
        points = self.primary, self.secondary
        sigmas = self.sigma_primary_px, self.sigma_secondary_px
        places, times = (
            np.unique(np.column_stack([self.frame, other]), axis=0)
            for other in (self.target, self.time_frame)
        )
        one_each = len(self.frames) == len(times) == len(np.unique(self.time_frame))
        refuse(
            (not np.isfinite(points).all(), "An image point is not a finite number."),
            (
                not np.isin(self.target, range(len(self.names))).all(),
                f"A target is none of {', '.join(self.names[:8])}.",
            ),
            (
                not np.isin(self.source, range(UNKNOWN_SOURCE, len(SOURCES))).all(),
                f"A source is invalid: it must be {', '.join(SOURCES)} or empty.",
            ),
            (
                any((sigma <= 0).any() for sigma in sigmas),
                "The standard error of an image point must be above 0.",
            ),
            (len(places) < n, "A frame has the same target twice."),
            (
                not one_each,
                "The column time_frame must give each frame one number, and each frame another.",
            ),
        )
        for name in ("frame", *SHAPES):
            getattr(self, name).setflags(write=False)

    @classmethod
    def from_arrays(
        cls,
        frame: npt.ArrayLike,
        target: Iterable[str],
        primary: npt.ArrayLike,
        secondary: npt.ArrayLike,
        distance_m: npt.ArrayLike | None = None,
        known_points_m: npt.ArrayLike | None = None,
        sigma_primary_px: npt.ArrayLike | None = None,
        sigma_secondary_px: npt.ArrayLike | None = None,
        source: Iterable[str] | None = None,
        time_frame: npt.ArrayLike | None = None,
        rigid_object: RigidObject | None = None,
    ) -> "Correspondences":
        """Correspondences from plain arrays of n rows.

        Args:
            target: "A" or "B", or a name of the object.
            source: a word of `SOURCES`, or "" if unknown.
        """
        names = TARGETS if rigid_object is None else rigid_object.names
        given = (distance_m, known_points_m, sigma_primary_px, sigma_secondary_px)
        distances, points, primary_px, secondary_px = (
            _missing() if column is None else np.array(column, dtype=np.float64) for column in given
        )
        codes = () if source is None else [source_code(word) for word in source]
        return cls(
            np.array(frame, dtype=np.int64),
            np.array([names.index(name) for name in target], dtype=np.int64),
            np.array(primary, dtype=np.float64),
            np.array(secondary, dtype=np.float64),
            distances,
            points,
            primary_px,
            secondary_px,
            source=np.array(codes, dtype=np.int64),
            time_frame=np.array(() if time_frame is None else time_frame, dtype=np.int64),
            rigid_object=rigid_object,
        )

    def to_dataframe(self) -> pd.DataFrame:
        """The table as in `correspondences.csv`; columns that say nothing are left out."""
        table = pd.DataFrame({"frame": self.frame, "target": np.array(self.names)[self.target]})
        table[list(PIXELS)] = np.hstack([self.primary, self.recorded_secondary])
        seen = np.column_stack(
            [self.distance_m, self.known_points_m, self.sigma_primary_px, self.sigma_secondary_px]
        )
        known = np.asarray(np.isfinite(seen).any(axis=0))
        known[1:4] = known[1:4].any()
        names = [name for name, there in zip(OPTIONAL, known.tolist(), strict=True) if there]
        table[names] = seen[:, known]
        if (self.source != UNKNOWN_SOURCE).any():
            table[SOURCE] = np.array(("", *SOURCES))[self.source - UNKNOWN_SOURCE]
        if self.has_times:
            table[TIME] = self.time_frame
        if self.rigid_object is not None:
            table[list(OBJECT)] = self.rigid_object.points[self.target]
        return table

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the targets."""
        return TARGETS if self.rigid_object is None else self.rigid_object.names

    @property
    def has_sigmas(self) -> bool:
        """Whether the standard error of any point is known."""
        return bool(np.isfinite([self.sigma_primary_px, self.sigma_secondary_px]).any())

    @property
    def has_times(self) -> bool:
        """Whether frames have another number than they were recorded with."""
        return bool((self.time_frame != self.frame).any())

    @property
    def mean_time(self) -> float:
        """The whole number next to the mean of `time_frame`."""
        first = int(self.time_frame.min())
        return float(first + np.round((self.time_frame - first).mean()))

    @property
    def recorded_secondary(self) -> FloatArray:
        """(n, 2): the secondary points as recorded, before a shift in time."""
        return np.where(np.isnan(self.recorded), self.secondary, self.recorded)

    @cached_property
    def frames(self) -> IntArray:
        """The distinct frame numbers, ascending."""
        return np.unique(self.frame)

    @cached_property
    def bars(self) -> IntArray:
        """(m, 2): the rows of the ends of each known distance, ascending by frame.

        These are A and B of each frame that has both; of an object the pairs of its targets with
        the longest distances (`RigidObject.pairs_among`).
        """
        part, place = self.parts
        pair, order = np.flatnonzero(np.bincount(part) == 2), np.lexsort([place, part])
        first = np.searchsorted(part[order], pair)
        return np.column_stack([order[first], order[first + 1]])

    @cached_property
    def parts(self) -> tuple[IntArray, IntArray]:
        """(n,) each: of each row the part of its frame that is fitted by itself, and its place.

        A part is a pair of targets with a known distance, places 0 and 1, or a single target. Parts
        are numbered from 0, ascending by frame; a bar is one part.
        """
        if self.rigid_object is None:
            return parts_of_bars(self.frame, self.target)
        return self.rigid_object.parts_of(self.frame, self.target)

    @cached_property
    def copies(self) -> dict[int, int]:
        """Frames with exactly the points of an earlier frame in both images, and that frame."""
        return self._same_as_earlier(np.column_stack([self.primary, self.recorded_secondary]))

    @cached_property
    def half_copies(self) -> dict[CameraName, dict[int, int]]:
        """The frames with exactly an earlier frame's points in one image alone, and which, as in
        `copies`."""
        by_camera: dict[CameraName, dict[int, int]] = {}
        for which, points in zip(CAMERAS, (self.primary, self.recorded_secondary), strict=True):
            same = self._same_as_earlier(points).items()
            by_camera[which] = {frame: first for frame, first in same if frame not in self.copies}
        return by_camera

    def _same_as_earlier(self, points: FloatArray) -> dict[int, int]:
        """The frames whose targets and points (n, k) are those of an earlier frame."""
        order = np.lexsort([self.target, self.frame])
        ends = np.flatnonzero(np.diff(self.frame[order])) + 1
        first: dict[bytes, int] = {}
        copies = {}
        for rows in np.split(order, ends) if len(order) else ():
            key = np.column_stack([self.target[rows], points[rows]]).tobytes()
            frame = int(self.frame[rows[0]])
            if first.setdefault(key, frame) != frame:
                copies[frame] = first[key]
        return copies

    def where(self, keep: npt.NDArray[np.bool_]) -> "Correspondences":
        """The rows for which `keep` (n,) is true."""
        return replace(self, **{name: getattr(self, name)[keep] for name in ("frame", *SHAPES)})

    def in_view(
        self, primary: Camera, secondary: Camera
    ) -> tuple["Correspondences", dict[str, int]]:
        """The rows without those that a fisheye images farther from its axis than it is used, and
        how many points of each camera are there; empty if none is.

        Raises:
            StereocalError: more than half of a camera's points are there.
        """
        lost, counts = beyond_either((primary, secondary), (self.primary, self.secondary))
        return (self.where(~lost), counts) if lost.any() else (self, {})

    def of_frames(self, frames: npt.ArrayLike) -> "Correspondences":
        """The rows of the given frames."""
        return self.where(np.isin(self.frame, np.asarray(frames)))

    def without_lines(self, lines: Iterable[int]) -> "Correspondences":
        """All rows except those from these lines of the file."""
        return self.where(~np.isin(self.line, list(lines)))

    def name_of(self, row: int) -> str:
        """The name of a row in messages: "frame 12, target A (line 25)"."""
        name = f"frame {self.frame[row]}, target {self.names[self.target[row]]}"
        return f"{name} (line {self.line[row]})" if self.line[row] else name


def source_code(word: str) -> int:
    """The index of `word` in `SOURCES`; -1 if it is empty."""
    allowed = f"it must be {', '.join(SOURCES)} or empty."
    refuse((word not in ("", *SOURCES), f'The source "{word[:40]}" is invalid: {allowed}'))
    return SOURCES.index(word) if word else UNKNOWN_SOURCE


def refuse_points_outside(
    source: str,
    rows: Correspondences,
    primary: Camera | None,
    secondary: Camera | None,
    recording: object = None,
) -> None:
    """Raise an error if there are `points_outside`.

    Args:
        recording: as of `PointsOutsideError`.
    """
    if problems := points_outside(rows, primary, secondary):
        raise PointsOutsideError(source, problems, "with a point outside its image", recording)


def points_outside(
    rows: Correspondences, primary: Camera | None, secondary: Camera | None
) -> list[RowProblem]:
    """Rows with a point outside its image; a camera that is None is not checked."""
    problems = []
    for which, camera in zip(CAMERAS, (primary, secondary), strict=True):
        if camera is None:
            continue
        for row, what in camera.outside(getattr(rows, which)):
            target = rows.names[rows.target[row]]
            reason = f"frame {rows.frame[row]}, target {target}: the {which} {what}"
            problems.append(RowProblem(int(rows.line[row]), reason))
    return sorted(problems, key=lambda problem: problem.line)
