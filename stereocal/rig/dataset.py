"""The data set of a calibration: image points of the bar, cameras, measured lengths."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from stereocal.errors import RefusedRowsError, RowProblem, StereocalError, refuse
from stereocal.rig.camera import CAMERAS, Camera, CameraName, pixel_scales
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray
from stereocal.rig.fisheye import LARGEST_ANGLE
from stereocal.rig.geometry import Pose, stack_rays, triangulate_rays
from stereocal.rig.rigid_object import RigidObject, placed
from stereocal.rig.tracks import TimeOffset, interpolate
from stereocal.system.numbers import rounded

TARGETS = ("A", "B")
SOURCES = ("detected", "corrected", "manual")
"""Origin of an image point: detector, detector after a user's click, or user alone."""
UNKNOWN_SOURCE = -1
MISREAD = 0.1
"""Share of rows with a point outside its image above which another order of the table's columns is
looked at."""
LONGEST_PLAUSIBLE_M = 1000.0
"""A longer baseline or bar is taken for a number in millimetres."""
LARGEST_UNCERTAINTY, SMALLEST_UNCERTAINTY = 0.2, 1e-7
"""Of a measured length, as fractions of it. A larger one is taken for a number in another unit;
with a smaller one the fit cannot be computed in double precision."""
DIGESTED = ("frame", "target", "primary", "recorded_secondary", "distance_m", "known_points_m")
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
            found = getattr(self, name).shape
            wrong = found != (n, *shape)
            refuse((wrong, f"{name} has shape {found}; it must be {(n, *shape)}."))
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
            _missing() if each is None else np.array(each, dtype=np.float64) for each in given
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
            return np.searchsorted(self.frames, self.frame), self.target
        return self.rigid_object.parts_of(self.frame, self.target)

    @cached_property
    def copies(self) -> dict[int, int]:
        """Frames with exactly the points of an earlier frame in both images, and that frame."""
        return self._same_as_earlier(np.column_stack([self.primary, self.recorded_secondary]))

    @cached_property
    def half_copies(self) -> dict[CameraName, dict[int, int]]:
        """As `copies`, frames with exactly an earlier frame's points in one image alone."""
        found: dict[CameraName, dict[int, int]] = {}
        for which, points in zip(CAMERAS, (self.primary, self.recorded_secondary), strict=True):
            same = self._same_as_earlier(points).items()
            found[which] = {frame: first for frame, first in same if frame not in self.copies}
        return found

    def _same_as_earlier(self, points: FloatArray) -> dict[int, int]:
        """The frames whose targets and points (n, k) are those of an earlier frame."""
        order = np.lexsort([self.target, self.frame])
        ends = np.flatnonzero(np.diff(self.frame[order])) + 1
        first: dict[bytes, int] = {}
        found = {}
        for rows in np.split(order, ends) if len(order) else ():
            key = np.column_stack([self.target[rows], points[rows]]).tobytes()
            frame = int(self.frame[rows[0]])
            if first.setdefault(key, frame) != frame:
                found[frame] = first[key]
        return found

    def where(self, keep: npt.NDArray[np.bool_]) -> "Correspondences":
        """The rows for which `keep` (n,) is true."""
        return replace(self, **{name: getattr(self, name)[keep] for name in ("frame", *SHAPES)})

    def camera_by_camera(self) -> "Correspondences":
        """The bars, with the secondary's A exchanged for the primary's B: a table whose columns are
        A and B of one camera, then those of the other, and not A of both cameras, then B."""
        a, b = self.bars.T
        primary, secondary = self.primary.copy(), self.secondary.copy()
        secondary[a], primary[b] = self.primary[b], self.secondary[a]
        whole = np.isin(np.arange(len(self)), self.bars)
        return replace(self, primary=primary, secondary=secondary).where(whole)

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


@dataclass(frozen=True, eq=False)
class Dataset:
    """Correspondences with the two cameras and the two measured lengths."""

    name: str
    primary: Camera
    secondary: Camera
    correspondences: Correspondences
    baseline_m: float
    target_distance_m: float
    baseline_sigma_m: float | None = None
    """Infinite if the baseline is free: then the lengths of the bars alone give the scale."""
    target_distance_sigma_m: float | None = None
    notes: str = ""
    time_offset: TimeOffset | None = None
    """By which the secondary points have been shifted; None if they are as recorded."""
    camera_names: tuple[str, str] | None = None
    """Their names in a recording of more, the primary first; None if they have no others."""

    def __post_init__(self) -> None:
        bar = "distance between the targets"
        refuse(
            (
                self.baseline_is_free and self.baseline_m > LONGEST_PLAUSIBLE_M,
                f"By a {bar} of {self.target_distance_m:g} m the cameras are {self.baseline_m:g} m "
                "apart: this looks like millimetres. Give the distance in metres "
                f"({self.target_distance_m / 1000:g}).",
            )
        )
        check_length("baseline", self.baseline_m)
        check_length(bar, self.target_distance_m)
        if not self.baseline_is_free:
            check_uncertainty("baseline", self.baseline_sigma_m, self.baseline_m)
        check_uncertainty(bar, self.target_distance_sigma_m, self.target_distance_m)
        refuse_points_outside("", self.correspondences, self.primary, self.secondary)
        used = self.primary.uses(self.rays[:2].T), self.secondary.uses(self.rays[2:].T)
        lost = np.flatnonzero(~(used[0] & used[1]))
        if len(lost):
            which = CAMERAS[int(used[0][lost[0]])]
            raise StereocalError(self._not_inverted(int(lost[0]), which))

    def _not_inverted(self, row: int, which: CameraName) -> str:
        """The message for a point where the lens model cannot be inverted."""
        camera: Camera = getattr(self, which)
        width, height = camera.image_size
        if camera.is_fisheye:
            largest = min(camera.largest_angle, LARGEST_ANGLE)
            return (
                f"The {which} camera's fisheye lens images {self.correspondences.name_of(row)} "
                f"more than {np.degrees(largest):.0f} degrees from its axis: at most "
                f"{np.degrees(LARGEST_ANGLE):.0f} degrees can be used (a field of view of "
                f"{2 * np.degrees(LARGEST_ANGLE):.0f}). Leave such points out, or check the camera "
                "file."
            )
        size = camera.size_factor
        hint = f" K seems to belong to an image {rounded(size, 3)} times as large." if size else ""
        return (
            f"The {which} camera's lens model cannot be inverted at "
            f"{self.correspondences.name_of(row)}: its focal length and distortion are impossible "
            f"for a point this far from the centre of the {width}x{height} px image. Check the "
            f"camera file.{hint}"
        )

    @property
    def baseline_is_free(self) -> bool:
        """Whether the baseline was not measured, but found from the lengths of the bars."""
        return self.baseline_sigma_m == np.inf

    def of_frames(self, frames: npt.ArrayLike) -> "Dataset":
        """The same data set with the given frames only."""
        return replace(self, correspondences=self.correspondences.of_frames(frames))

    def with_targets_exchanged(self, frames: npt.ArrayLike) -> "Dataset":
        """The data set with A and B exchanged in the secondary image of the given frames.

        An object is turned (`RigidObject.half_turn`). Targets whose counterpart is not seen in
        their frame are not changed.
        """
        rows = self.correspondences
        turned = np.array([1, 0]) if rows.rigid_object is None else rows.rigid_object.half_turn
        at = {key: row for row, key in enumerate(zip(rows.frame, rows.target, strict=True))}
        order = np.arange(len(rows))
        for row in np.flatnonzero(np.isin(rows.frame, np.asarray(frames))):
            order[row] = at.get((rows.frame[row], turned[rows.target[row]]), row)
        names = ("secondary", "sigma_secondary_px", "recorded", "motion")
        changed = {name: getattr(rows, name)[order] for name in names}
        return replace(self, correspondences=replace(rows, **changed))

    def shifted(self, offset: TimeOffset) -> "Dataset":
        """The data set with the secondary points at the instants of the primary's frames.

        They are interpolated, and their `motion` is known, from the true neighbours of the same
        target (`tracks.interpolate`). A point without neighbours, or that would leave the image,
        stays as recorded, with unknown motion. Without an offset all stay as recorded.
        """
        rows = self.correspondences
        recorded = rows.recorded_secondary
        found = interpolate(rows.target, rows.time_frame, recorded, offset.at(rows.time_frame))
        motion = np.column_stack([found.velocities, found.variance])
        shifted = replace(rows, secondary=recorded, recorded=recorded * np.nan, motion=motion)
        if offset.is_shift:
            known = found.inside(self.secondary.image_size)
            shifted = replace(
                rows,
                secondary=np.where(known[:, None], found.positions, recorded),
                recorded=recorded,
                motion=np.where(known[:, None], motion, np.nan),
            )
        return replace(self, correspondences=shifted, time_offset=offset)

    @cached_property
    def rays(self) -> FloatArray:
        """Undistorted, normalised points, shape (4, n), as in `geometry`."""
        rows = self.correspondences
        return stack_rays(
            self.primary.undistort(rows.primary), self.secondary.undistort(rows.secondary)
        )

    @cached_property
    def known_points_m(self) -> FloatArray:
        """Known points in the primary camera's frame, (n, 3); NaN where unknown.

        Those of the table. Of an object in a plane, such as a board, where the image of the primary
        camera alone places it (paper, footnote 4).
        """
        rows = self.correspondences
        if rows.rigid_object is None or np.isfinite(rows.known_points_m).any():
            return rows.known_points_m
        return placed(rows.frame, rows.rigid_object.points[rows.target], self.rays[:2])

    @cached_property
    def pixel_scale(self) -> FloatArray:
        """`pixel_scales` of both cameras."""
        return pixel_scales((self.primary, self.secondary))

    @cached_property
    def bar_distances_m(self) -> FloatArray:
        """(m,): the measured length of each bar of `correspondences.bars`."""
        rows = self.correspondences
        if rows.rigid_object is not None:
            one, other = rows.target[rows.bars].T
            return rows.rigid_object.distance(one, other)
        measured = rows.distance_m[rows.bars]
        of_frame = np.where(np.isnan(measured[:, 0]), measured[:, 1], measured[:, 0])
        return np.where(np.isnan(of_frame), self.target_distance_m, of_frame)

    def bars_among(self, rows: BoolArray) -> BoolArray:
        """(m,): which bars of `correspondences.bars` are selected by `rows`, a mask (n,)."""
        return rows[self.correspondences.bars[:, 0]]

    def reconstructed_lengths_m(self, pose: Pose) -> FloatArray:
        """(m,): the lengths of the bars reconstructed with `pose`; NaN behind a camera."""
        points = triangulate_rays(pose.R, pose.T, self.rays)
        bars = self.correspondences.bars
        lengths: FloatArray = np.linalg.norm(points[bars[:, 0]] - points[bars[:, 1]], axis=1)
        return lengths

    @cached_property
    def sha256(self) -> str:
        """Digest of all numbers that a calibration depends on, independent of the file format.

        A shift in time does not change it.
        """
        rows = self.correspondences
        content: dict[str, Any] = {
            "cameras": [
                camera.to_json()
                | ({"uncertainty": camera.uncertainty.to_json()} if camera.uncertainty else {})
                for camera in (self.primary, self.secondary)
            ],
            "baseline_m": self.baseline_m,
            "target_distance_m": self.target_distance_m,
            "rows": [getattr(rows, name).tolist() for name in DIGESTED],
        }
        if rows.rigid_object is not None:
            # By name, and of the targets seen: whatever else the object has is of no effect.
            seen = np.unique(rows.target)
            content["targets"] = [rows.names[target] for target in rows.target]
            content["object"] = {rows.names[k]: rows.rigid_object.points[k].tolist() for k in seen}
            content["rows"][1] = []
        if rows.has_times:
            content["time_frame"] = rows.time_frame.tolist()
        if rows.has_sigmas:
            # A separate entry keeps the digest of tables without standard errors unchanged.
            sigmas = (rows.sigma_primary_px, rows.sigma_secondary_px)
            content["sigmas_px"] = [sigma.tolist() for sigma in sigmas]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    @property
    def identity(self) -> list[Any]:
        """The digest, the stated uncertainties and the words: all that its results tell."""
        sigmas = [self.baseline_sigma_m, self.target_distance_sigma_m]
        return [self.sha256, *sigmas, self.name, self.notes]


def source_code(word: str) -> int:
    """The index of `word` in `SOURCES`; -1 if it is empty."""
    allowed = f"it must be {', '.join(SOURCES)} or empty."
    refuse((word not in ("", *SOURCES), f'The source "{word[:40]}" is invalid: {allowed}'))
    return SOURCES.index(word) if word else UNKNOWN_SOURCE


def check_length(what: str, value: float) -> None:
    """Check a measured length in metres."""
    refuse(
        (
            not np.isfinite(value) or value <= 0,
            f"The {what} is {value:g} m: it must be a length above 0.",
        ),
        (
            value > LONGEST_PLAUSIBLE_M,
            f"The {what} is {value:g} m: this looks like millimetres. Give it in metres "
            f"({value / 1000:g}).",
        ),
    )


def check_uncertainty(what: str, sigma: float | None, length: float) -> None:
    """Check the stated standard error of a measured length, both in metres."""
    if sigma is None:
        return
    free = " A baseline that was not measured can be left free." if what == "baseline" else ""
    stated, finest = f"The uncertainty of the {what} is", SMALLEST_UNCERTAINTY * length
    refuse(
        (not (np.isfinite(sigma) and sigma > 0), f"{stated} {sigma}: it must be above 0."),
        (
            sigma > LARGEST_UNCERTAINTY * length,
            f"{stated} {sigma:g} m, more than {100 * LARGEST_UNCERTAINTY:g} % of its {length:g} m. "
            f"Is it in millimetres? Then it is {sigma / 1000:g} m: state it in metres.{free}",
        ),
        (
            sigma < finest,
            f"{stated} {sigma:g} m, for a length of {length:g} m: no such length is known to "
            f"better than {rounded(finest, 1)} m. State it in metres, as 0.002 for 2 mm.",
        ),
    )


def refuse_points_outside(
    source: str, rows: Correspondences, primary: Camera | None, secondary: Camera | None
) -> None:
    """Raise an error if there are `points_outside`; it names the likely cause where all points lie
    in the images once that is mended: exchanged camera files, or columns camera by camera."""
    problems = points_outside(rows, primary, secondary)
    if not problems:
        return
    both = primary is not None and secondary is not None
    hint = ""
    if both and not points_outside(rows, secondary, primary):
        hint = ", and none outside those of the other camera (are the camera files exchanged?)"
    # One mistyped point is no reason to doubt the columns.
    elif both and rows.rigid_object is None and len(problems) > MISREAD * len(rows):
        bars = rows.camera_by_camera()
        if len(bars) and not points_outside(bars, primary, secondary):
            hint = (
                ", and none if the columns are A and B of one camera, then those of the other "
                "(they are read as A of both cameras, then B: put them in this order, or name them)"
            )
    raise RefusedRowsError(source, problems, f"with a point outside its image{hint}")


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
