"""A recording of one object by any number of cameras: what is read, kept, screened and fitted."""

import hashlib
import math
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from stereocal.errors import PointsOutsideError, RowProblem, StereocalError, refuse
from stereocal.rig.camera import CAMERAS, Camera, camera_in_words
from stereocal.rig.correspondences import (
    TARGETS,
    UNKNOWN_SOURCE,
    Correspondences,
    refuse_points_outside,
)
from stereocal.rig.field_of_view import beyond_view
from stereocal.rig.measured_lengths import check_length, check_lengths, check_uncertainty
from stereocal.rig.pair import Pair
from stereocal.rig.rigid_object import Held, RigidObject
from stereocal.rig.tracks import Interpolated, TimeOffset, interpolate
from stereocal.rig.window import StatedWindow, check_windows, windows_of_some
from stereocal.system.answers import TableAnswer
from stereocal.system.arguments import checked
from stereocal.system.array_types import BoolArray, FloatArray, IntArray
from stereocal.system.made_from import digest_of
from stereocal.system.names import check_camera_names
from stereocal.system.numbers import count
from stereocal.system.tables import LARGEST_WHOLE, refuse_missing

CameraPair = tuple[str, str]
_NO_ROWS = np.empty(0, dtype=np.int64)
NO_POINTS = _NO_ROWS, _NO_ROWS, _NO_ROWS, np.empty((0, 2)), np.empty(0)
"""The columns of a recording that has none yet."""
COLUMNS = ("frame", "camera", "target", "points", "sigma_px")
OF_TABLES = ("distance_m", "known_points_m", "time_frame", "source", "line")
"""Columns that `correspondences.csv` may have; its two points of a row have the same values."""
SHIFTED = ("recorded", "motion")
"""Columns that a shift in time adds."""
REFINED_ONLY = "behind a window there is no essential matrix, and so only the refined set"
"""Why nothing else is made of a recording through windows."""
MOST_IMAGES = 50_000_000
"""The most images of all targets in all frames and cameras: 800 MB of pixels."""


@dataclass(frozen=True, eq=False, repr=False)
class Recording(TableAnswer):
    """Image points of the targets of an object, one row per frame, camera and target.

    All arrays have n rows. Pixels are raw (distorted); (0, 0) is the centre of the top-left pixel.
    """

    name: str
    cameras: Mapping[str, Camera]
    """The cameras by name. The first of two is the primary."""
    object: RigidObject
    frame: IntArray
    camera: IntArray
    """Index into `cameras`."""
    target: IntArray
    """Index into `object.names`."""
    points: FloatArray
    """(n, 2)."""
    sigma_px: FloatArray
    """Standard error of each coordinate; NaN if unknown."""
    baselines_m: Mapping[CameraPair, float] = field(default_factory=dict)
    """The measured baselines; each pair in one order or the other."""
    baseline_sigma_m: float | None = None
    """Infinite if the baselines are not measured, but found from the lengths."""
    notes: str = ""
    beyond_view: Mapping[str, int] = field(default_factory=dict)
    """How many points of each camera were left out by `within_view` or `with_pairs`."""
    start_frames: Mapping[str, int] = field(default_factory=dict)
    """Which of `frame` was frame 0 of each camera that counted its own frames."""
    step_notes: tuple[str, ...] = ()
    """How cameras were brought into step that counted their own frames, where that was found."""
    own_frames: bool = False
    """Whether each camera counts its own frames, so that they are still to be brought into step."""
    distance_m: FloatArray | None = None
    """(n,): the distance A-B measured for this frame; NaN, or None, to use that of the object."""
    known_points_m: FloatArray | None = None
    """(n, 3): known 3D points in the first camera's frame; NaN, or None, if unknown."""
    time_frame: IntArray | None = None
    """(n,): the frame's number as recorded, gaps and all; None: `frame`."""
    source: IntArray | None = None
    """(n,): index into `SOURCES`; -1, or None, if unknown."""
    line: IntArray | None = None
    """(n,): the line of the row in its file, for messages; 0, or None, if there is no file."""
    offsets: Mapping[str, TimeOffset] = field(default_factory=dict)
    """The offsets by which the points of some cameras have been shifted in time (`shifted`)."""
    recorded: FloatArray | None = None
    """(n, 2): the points as recorded; NaN, or None, where `points` are that."""
    motion: FloatArray | None = None
    """(n, 3): velocity of a point in pixels per frame, and the variance of its position over that
    of a recorded one; NaN, or None, if unknown."""
    windows: tuple[StatedWindow, ...] = ()
    """Those that cameras look through into another medium, still to be found; a camera whose window
    is known has it itself."""

    def __post_init__(self) -> None:
        check_camera_names(self.cameras)
        check_windows(self.windows, self.cameras)

    @property
    def has_windows(self) -> bool:
        """Whether a camera looks through a window, known or still to be found."""
        known = (camera.window is not None for camera in self.cameras.values())
        return bool(self.windows) or any(known)

    @property
    def labels(self) -> tuple[str, ...]:
        """What settings and files call the cameras: two are the primary and the secondary, more go
        by their names."""
        return labels_of(tuple(self.cameras))

    @property
    def answer(self) -> list[str]:
        seen = np.bincount(self.camera, minlength=len(self.cameras)).tolist()
        by_camera = zip(self.cameras, seen, strict=True)
        return [
            f"{self.name}: {count(len(self.cameras), 'camera')} and "
            f"{'an' if self.object.word == 'object' else 'a'} {self.object.word} of "
            f"{self.object.longest_m:g} m in {count(len(np.unique(self.frame)), 'frame')}.",
            f"Points: {', '.join(f'{number:,} of {name}' for name, number in by_camera)}.",
            self.describe_pairs(),
        ]

    @cached_property
    def sha256(self) -> str:
        """Digest of all numbers that a rig depends on; a shift in time does not change it."""
        order = np.lexsort([self.target, self.camera, self.frame])
        rows = self.frame, self.camera, self.target, self.recorded_points, self.sigma_px
        content = {
            "cameras": {
                name: [camera.to_json(), camera.uncertainty and camera.uncertainty.to_json()]
                for name, camera in self.cameras.items()
            },
            "object": dict(zip(self.object.names, self.object.points.tolist(), strict=True)),
            "baselines_m": {"-".join(pair): value for pair, value in self.baselines_m.items()},
            "rows": [column[order].tolist() for column in rows],
            **({"windows": [it.to_json() for it in self.windows]} if self.windows else {}),
        }
        for name in OF_TABLES[:3]:  # `source` and `line` change no result
            if (column := getattr(self, name)) is not None:
                content[name] = column[order].tolist()
        return digest_of(content)

    @cached_property
    def points_digest(self) -> str:
        """Digest of the points and of how their frames belong together; of `sha256` and its time a
        tenth, for pages that tell what has changed."""
        content = hashlib.sha256(
            repr((sorted(self.start_frames.items()), self.own_frames)).encode()
        )
        order = np.lexsort([self.target, self.camera, self.frame])
        names = "frame", "camera", "target", "recorded_points", "sigma_px", *OF_TABLES[:3]
        for name in names:
            if (column := getattr(self, name)) is not None:
                content.update(name.encode() + column[order].tobytes())
        return content.hexdigest()

    def to_dataframe(self) -> pd.DataFrame:
        """The table as in `points.csv`."""
        named = np.array([*self.cameras])[self.camera]
        targets = np.array(self.object.names)[self.target]
        table = pd.DataFrame({"frame": self.frame, "camera": named, "target": targets})
        table[["u", "v"]] = self.recorded_points
        if np.isfinite(self.sigma_px).any():
            table["sigma_px"] = self.sigma_px
        return table

    @classmethod
    @checked
    def from_dataframe(
        cls,
        table: pd.DataFrame,
        cameras: Mapping[str, Camera],
        held: Held,
        baselines_m: float | Mapping[str, float] | None = None,
        baseline_sigma_m: float | None = None,
        name: str = "recording",
    ) -> "Recording":
        """The recording of a table of raw pixels.

        Args:
            table: a row a point and camera, `frame,camera,target,u,v[,sigma_px]`; or a row a point,
                `frame,target` and `u_NAME,v_NAME` of each camera, empty where it is not seen.
            cameras, held, baselines_m, baseline_sigma_m: as of `from_arrays`.

        Raises:
            StereocalError: as of `from_arrays`; or a column is missing.
        """
        if "camera" not in table:
            wide = ["frame", "target", *(f"{axis}_{which}" for which in cameras for axis in "uv")]
            refuse_missing("The table", table, wide)
            parts = [
                table[["frame", "target"]].assign(
                    camera=which, u=table[f"u_{which}"], v=table[f"v_{which}"]
                )
                for which in cameras
            ]
            table = pd.concat(parts, ignore_index=True).dropna(subset=["u", "v"])
        refuse_missing("The table", table, ["frame", "camera", "target", "u", "v"])
        return cls.from_arrays(
            table["frame"],
            table["camera"],
            table["target"],
            table[["u", "v"]],
            cameras,
            held,
            baselines_m,
            baseline_sigma_m,
            table.get("sigma_px"),
            name,
        )

    @classmethod
    @checked
    def from_arrays(
        cls,
        frame: npt.ArrayLike,
        camera: Iterable[Hashable],
        target: Iterable[Hashable],
        points: npt.ArrayLike,
        cameras: Mapping[str, Camera],
        held: Held,
        baselines_m: float | Mapping[str, float] | None = None,
        baseline_sigma_m: float | None = None,
        sigma_px: npt.ArrayLike | None = None,
        name: str = "recording",
    ) -> "Recording":
        """The recording of n points.

        Args:
            frame: (n,) whole numbers.
            camera, target: n names each.
            points: (n, 2) raw pixels.
            cameras: by name; the first is the primary.
            held: a bar's length A-B in metres, points by name in metres, or a board.
            baselines_m: of two cameras a length; of more by pair, as {"left-right": 4.976}; None
                where nothing is measured: the object alone gives the scale.
            sigma_px: (n,) standard error of each coordinate; NaN where unknown.

        Raises:
            StereocalError: a name is unknown, a point is twice, not finite or outside its image,
                or a length is impossible.
        """
        rigid_object = RigidObject.of(held)
        cameras = {str(called): lens for called, lens in cameras.items()}
        pixels, frames = _numbers("image point", points), _whole(frame)
        camera, target = [*camera], [*target]
        _refuse_unusable(frames, len(camera), len(target), pixels, len(cameras))
        pixels = pixels.reshape(-1, 2)
        sigmas = np.full(len(pixels), np.nan) if sigma_px is None else sigma_px
        recording = cls(
            name,
            cameras,
            rigid_object,
            frames.astype(np.int64),
            _codes("camera", camera, [*cameras]),
            _codes("target", target, rigid_object.names),
            pixels,
            np.array(sigmas, dtype=np.float64),
            baseline_sigma_m=baseline_sigma_m,
        )
        recording._refuse_repeated()
        check_length("longest distance between points of the object", rigid_object.longest_m)
        check_uncertainty("object", rigid_object.sigma_m, rigid_object.longest_m)
        measured = recording._baselines_by_pair(baselines_m)
        recording.refuse_points_outside()
        return replace(recording, baselines_m=measured).within_view()

    def _refuse_repeated(self) -> None:
        """Raise an error if a point is there twice."""
        rows = {"frame": self.frame, "camera": self.camera, "target": self.target}
        if (repeated := pd.DataFrame(rows).duplicated().to_numpy()).any():
            row = int(np.argmax(repeated))
            camera, target = [*self.cameras][self.camera[row]], self.object.names[self.target[row]]
            raise StereocalError(
                f"Frame {self.frame[row]}, camera {camera}, target {target} is there twice."
            )

    def _baselines_by_pair(
        self, stated_m: float | Mapping[str, float] | None
    ) -> dict[CameraPair, float]:
        """The baselines of `from_arrays` by pair; none that are to be found from the lengths."""
        if stated_m is not None and not isinstance(stated_m, Mapping):
            stated_m = {"-".join(self.pairs[0]): float(stated_m)}
        measured = {self.pair_named(pair): value for pair, value in (stated_m or {}).items()}
        for pair, value in measured.items():
            check_length(f"baseline {'-'.join(pair)}", value)
        return {} if self.baseline_sigma_m == np.inf else measured

    @classmethod
    def of_two(
        cls,
        name: str,
        primary: Camera,
        secondary: Camera,
        baseline_m: float | None,
        target_distance_m: float,
        baseline_sigma_m: float | None = None,
        target_distance_sigma_m: float | None = None,
        notes: str = "",
    ) -> "Recording":
        """The recording of a bar by a primary and a secondary camera, still without points:
        `holding` and `with_pairs` add them, with the object that they are of.

        Args:
            baseline_m: as measured, or found where `baseline_sigma_m` is infinite; None: not yet.
        """
        sigmas = baseline_sigma_m, target_distance_sigma_m
        if baseline_m is None:
            sigmas = np.inf, target_distance_sigma_m
        check_lengths(1.0 if baseline_m is None else baseline_m, target_distance_m, *sigmas)
        return cls(
            name,
            dict(zip(CAMERAS, (primary, secondary), strict=True)),
            RigidObject.bar(target_distance_m, target_distance_sigma_m),
            *NO_POINTS,
            baselines_m={} if baseline_m is None else {CAMERAS: baseline_m},
            baseline_sigma_m=sigmas[0],
            notes=notes,
        )

    def with_pairs(self, rows: Correspondences) -> "Recording":
        """The recording of two cameras with these points, without pairs that a fisheye images
        farther from its axis than it is used; `beyond_view` counts them.

        Raises:
            StereocalError: a point is outside its image, or as of `Correspondences.in_view`.
        """
        primary, secondary = self.cameras.values()
        refuse_points_outside("", rows, primary, secondary, self.holding(rows))
        seen, beyond = rows.in_view(primary, secondary)
        counts = dict(zip(self.cameras, beyond.values(), strict=True)) if beyond else {}
        return replace(self.holding(seen), beyond_view=counts)

    def holding(self, rows: Correspondences) -> "Recording":
        """The recording of two cameras with these points."""
        held = self.object
        if rows.rigid_object is not None:
            held = replace(rows.rigid_object, sigma_m=held.sigma_m)
        elif held.names != TARGETS:
            held = RigidObject.bar(held.longest_m, held.sigma_m)
        return replace(self, object=held, **_of_two(rows))

    def refuse_points_outside(self) -> None:
        """Raise an error if points are outside their image."""
        problems = []
        for number, (name, camera) in enumerate(self.cameras.items()):
            part = self.where(self.camera == number)
            for row, what in camera.outside(part.points):
                target = self.object.names[part.target[row]]
                reason = f"frame {part.frame[row]}, camera {name}, target {target}: the {what}"
                problems.append(RowProblem(0, reason))
        if problems:
            raise PointsOutsideError("", problems, "cannot be used", self)

    @property
    def has_all_inside(self) -> bool:
        """Whether no point is outside its image."""
        return not any(
            lens.is_outside(self.points[self.camera == number]).any()
            for number, lens in enumerate(self.cameras.values())
        )

    def within_view(self) -> "Recording":
        """The recording without points that a fisheye images farther from its axis than it is used;
        `beyond_view` counts them.

        Raises:
            StereocalError: more than half of a camera's points are there.
        """
        beyond, counts = np.zeros(len(self.frame), dtype=np.bool_), dict[str, int]()
        for number, (name, camera) in enumerate(self.cameras.items()):
            rows = np.flatnonzero(self.camera == number)
            beyond[rows] = beyond_view(camera, self.points[rows], name, self.cameras.values())
            counts[name] = int(beyond[rows].sum())
        return replace(self.where(~beyond), beyond_view=counts) if beyond.any() else self

    def where(self, kept: BoolArray) -> "Recording":
        """The rows for which `kept` (n,) is true."""
        return replace(self, **self._columns(kept))

    def _columns(self, rows: BoolArray | IntArray) -> dict[str, Any]:
        """The columns that are known, at these rows, by name."""
        known = {name: getattr(self, name) for name in (*COLUMNS, *OF_TABLES, *SHIFTED)}
        return {name: column[rows] for name, column in known.items() if column is not None}

    def with_targets_exchanged(self, camera: str, frames: npt.ArrayLike) -> "Recording":
        """The recording with A and B exchanged in the images of one camera in the given frames.

        An object is turned (`RigidObject.half_turn`).
        """
        number = [*self.cameras].index(camera) if camera in self.cameras else -1
        here = (self.camera == number) & np.isin(self.frame, np.asarray(frames))
        return replace(self, target=np.where(here, self.object.half_turn[self.target], self.target))

    def counted_from(self, starts: Mapping[str, int]) -> "Recording":
        """The recording with the frames of some cameras renumbered: 0 becomes their start."""
        added = np.array([starts.get(name, 0) for name in self.cameras])[self.camera]
        times = None if self.time_frame is None else self.time_frame + added
        return replace(self, frame=self.frame + added, time_frame=times, own_frames=False)

    @property
    def first_frames(self) -> dict[str, int]:
        """The first frame with points of each camera; 0 of one without any."""
        frames_of = {name: self.frame[self.camera == k] for k, name in enumerate(self.cameras)}
        return {name: int(frames.min()) if len(frames) else 0 for name, frames in frames_of.items()}

    def of_cameras(self, names: Sequence[str]) -> "Recording":
        """The recording with some of its cameras only, in the order of all."""
        every = list(self.cameras)
        if list(names) == every:
            return self
        numbers = np.array([names.index(name) if name in names else -1 for name in every])
        kept = self.where(numbers[self.camera] >= 0)
        return replace(
            kept,
            cameras={name: self.cameras[name] for name in names},
            start_frames={
                name: start for name, start in self.start_frames.items() if name in names
            },
            camera=numbers[kept.camera],
            baselines_m={
                pair: length for pair, length in self.baselines_m.items() if {*pair} <= {*names}
            },
            windows=windows_of_some(self.windows, names),
        )

    @cached_property
    def rays(self) -> FloatArray:
        """(n, 2): undistorted and normalised; NaN where a lens cannot be inverted."""
        rays = np.empty_like(self.points)
        for number, camera in enumerate(self.cameras.values()):
            of_camera = self.camera == number
            rays[of_camera] = camera.undistort(self.points[of_camera])
        return rays

    @property
    def times(self) -> IntArray:
        """(n,): the frame's number as recorded, gaps and all."""
        return self.frame if self.time_frame is None else self.time_frame

    @property
    def recorded_points(self) -> FloatArray:
        """(n, 2): the points before a shift in time."""
        if self.recorded is None:
            return self.points
        return np.where(np.isnan(self.recorded), self.points, self.recorded)

    @property
    def usable(self) -> BoolArray:
        """(n,): which points a shift in time has not left without a position."""
        late = [self.offsets.get(name, TimeOffset()).is_shift for name in self.cameras]
        if self.motion is None or not any(late):
            return np.ones(len(self.frame), dtype=np.bool_)
        return ~np.array(late)[self.camera] | np.isfinite(self.motion[:, 0])

    def shifted(self, offsets: Mapping[str, TimeOffset]) -> "Recording":
        """The recording with the points of these cameras at the instants of the reference's frames.

        They are interpolated, and their `motion` is known, from the true neighbours of the same
        target (`tracks.interpolate`). A point without neighbours, or that would leave the image or
        the view of a fisheye, stays as recorded, with unknown motion. Without an offset all stay as
        recorded.
        """
        camera_offsets = [offsets.get(name, TimeOffset()) for name in self.cameras]
        known_of = np.array([name in offsets for name in self.cameras])
        rows = np.flatnonzero(known_of[self.camera])
        times, late = self.times[rows], np.zeros(len(rows))
        for number, offset in enumerate(camera_offsets):
            mine = self.camera[rows] == number
            late[mine] = offset.at(times[mine])
        interpolated, inside = self.moved(late, rows)
        recorded, motion = self.recorded_points, np.full((len(self.frame), 3), np.nan)
        motion[rows] = np.column_stack([interpolated.velocities, interpolated.variance])
        shifted = replace(self, points=recorded, recorded=None, motion=motion, offsets={**offsets})
        moves = np.array([offset.is_shift for offset in camera_offsets])[self.camera[rows]]
        if not moves.any():
            return shifted
        motion[rows[moves & ~inside]] = np.nan
        points, before = recorded.copy(), np.full_like(recorded, np.nan)
        points[rows[moves & inside]] = interpolated.positions[moves & inside]
        before[rows[moves]] = recorded[rows[moves]]
        return replace(shifted, points=points, recorded=before)

    def moved(
        self, late: FloatArray, rows: IntArray | None = None
    ) -> tuple[Interpolated, BoolArray]:
        """The points at the instants of their frames less some frames, and whether they are known,
        in their image and in the view of a fisheye, (m,).

        Args:
            late: (m,), in frames.
            rows: (m,): of which points; all if None.
        """
        rows = np.arange(len(self.frame)) if rows is None else rows
        camera = self.camera[rows]
        track = camera * len(self.object.names) + self.target[rows]
        interpolated = interpolate(track, self.times[rows], self.recorded_points[rows], late)
        inside = np.zeros(len(rows), dtype=np.bool_)
        for number, lens in enumerate(self.cameras.values()):
            of_camera = camera == number
            inside |= of_camera & interpolated.inside(lens.image_size)
            if lens.is_fisheye:
                inside[of_camera] &= lens.uses(lens.undistort(interpolated.positions[of_camera]))
        return interpolated, inside

    def taken_as_recorded(self) -> "Recording":
        """The recording with the points as they are, and nothing known of a shift in time."""
        return replace(self, recorded=None, motion=None, offsets={})

    def images(self, values: FloatArray | None = None) -> tuple[IntArray, FloatArray]:
        """The frame numbers (f,), and the pixels of all targets (f, k, c, 2); NaN where not seen.

        Args:
            values: (n, v): others of the rows, instead of their pixels.
        """
        of_rows = self.points if values is None else values
        frames, frame_index = np.unique(self.frame, return_inverse=True)
        shape = len(frames), len(self.object.names), len(self.cameras)
        if math.prod(shape) > MOST_IMAGES:
            raise StereocalError(
                f"{shape[0]} frames of an object with {shape[1]} points before {shape[2]} cameras "
                "are too many: name only the points that are seen, or take fewer frames."
            )
        pixels = np.full((*shape, of_rows.shape[1]), np.nan)
        pixels[frame_index, self.target, self.camera] = of_rows
        return frames, pixels

    @property
    def pairs(self) -> list[CameraPair]:
        """All pairs of cameras, in the cameras' order."""
        return list(combinations(self.cameras, 2))

    def pair_named(self, text: str) -> CameraPair:
        """The pair of a name such as `left-right`, in its order."""
        for first, second in self.pairs:
            for pair in ((first, second), (second, first)):
                if text == "-".join(pair):
                    return pair
        raise StereocalError(f'There is no pair "{text[:60]}". {self.describe_pairs()}')

    def chosen_pair(self, text: str | None) -> CameraPair:
        """The pair of a name such as `left-right`; None: of the only two cameras.

        Raises:
            StereocalError: there is no such pair, or several to choose from.
        """
        if text is not None:
            return self.pair_named(text)
        if len(self.cameras) > 2:
            raise StereocalError(
                f"it has {len(self.cameras)} cameras: choose two. {self.describe_pairs()}",
                option="--pair",
            )
        return self.pairs[0]

    def describe_pairs(self) -> str:
        """The pairs and how many frames both cameras of each see."""
        seen = [f"{a}-{b} ({count(len(self.common_frames(a, b)), 'frame')})" for a, b in self.pairs]
        return f"Pairs and the frames that both cameras see: {', '.join(seen)}."

    def common_frames(self, first: str, second: str) -> IntArray:
        """The frames in which both cameras see the same target, ascending."""
        return np.unique(self.frame[self._common(first, second)[0]])

    def baseline_m(self, first: str, second: str) -> float | None:
        """The stated distance of two cameras; None if there is none."""
        return self.baselines_m.get((first, second), self.baselines_m.get((second, first)))

    @checked
    def pair(self, first: str, second: str) -> Pair:
        """The view of two cameras, of the points that both see.

        A baseline that was not measured is free, and still to be found.
        """
        a, b = self._common(first, second)
        cameras = camera_in_words(first, second, begins=True)
        if self.own_frames:
            raise StereocalError(
                f"{cameras} count their own frames, since they were started "
                "by hand: bring them into step first, with `sync`."
            )
        if not len(a) and len(self.frame):
            raise StereocalError(
                f"{cameras} see no point in the same frame. "
                f"{self.describe_pairs()} If each counts its own frames, since it was started by "
                "hand, bring them into step first, with `sync`."
            )
        both = [first, second]
        columns = self._columns(np.concatenate([a, b]))
        columns["camera"] = np.repeat([0, 1], len(a))
        if first != next(iter(self.cameras)):  # they are in the frame of the first camera
            columns["known_points_m"] = None
        measured = self.baseline_m(first, second)
        return Pair(
            replace(
                self,
                name=self.name if len(self.cameras) == 2 else f"{self.name}, {first}-{second}",
                cameras={name: self.cameras[name] for name in both},
                **columns,
                baselines_m={} if measured is None else {(first, second): measured},
                beyond_view={name: n for name, n in self.beyond_view.items() if name in both},
                start_frames={name: n for name, n in self.start_frames.items() if name in both},
                offsets={name: offset for name, offset in self.offsets.items() if name in both},
                windows=windows_of_some(self.windows, both),
            )
        )

    def _common(self, first: str, second: str) -> tuple[IntArray, IntArray]:
        """The rows of two cameras with the same target in the same frame, in the first's order."""
        names = list(self.cameras)
        if unknown := {first, second} - {*names}:
            raise StereocalError(
                f'There is no camera "{unknown.pop()}": there are {", ".join(names)}.'
            )
        rows = [np.flatnonzero(self.camera == names.index(name)) for name in (first, second)]
        width = len(self.object.names)
        of_first, of_second = (
            self.frame[of_camera] * width + self.target[of_camera] for of_camera in rows
        )
        _, one, other = np.intersect1d(of_first, of_second, True, return_indices=True)
        order = np.argsort(one)
        return rows[0][one[order]], rows[1][other[order]]


def labels_of(names: Sequence[str]) -> tuple[str, ...]:
    """The labels of some cameras (`Recording.labels`)."""
    return CAMERAS if len(names) == 2 else tuple(names)


def _of_two(rows: Correspondences) -> dict[str, Any]:
    """The columns of the points of two cameras, those of the first before the others; None of those
    that say nothing."""
    says = {
        "distance_m": np.isfinite(rows.distance_m),
        "known_points_m": np.isfinite(rows.known_points_m),
        "time_frame": rows.time_frame != rows.frame,
        "source": rows.source != UNKNOWN_SOURCE,
        "line": rows.line != 0,
    }
    of_shift = {"recorded": np.isfinite(rows.recorded), "motion": np.isfinite(rows.motion)}
    return {
        "frame": np.tile(rows.frame, 2),
        "camera": np.repeat([0, 1], len(rows)),
        "target": np.tile(rows.target, 2),
        "points": np.vstack([rows.primary, rows.secondary]),
        "sigma_px": np.concatenate([rows.sigma_primary_px, rows.sigma_secondary_px]),
        **{
            name: np.concatenate([getattr(rows, name)] * 2) if mask.any() else None
            for name, mask in says.items()
        },
        **{
            name: np.vstack([np.full_like(column, np.nan), column]) if mask.any() else None
            for name, mask in of_shift.items()
            for column in [getattr(rows, name)]
        },
    }


def _refuse_unusable(
    frames: FloatArray | IntArray, cameras: int, targets: int, pixels: FloatArray, of_cameras: int
) -> None:
    """Raise an error if columns of `from_arrays` have other shapes than (n,) and (n, 2), or values
    that are none of a recording.

    Args:
        cameras, targets: the numbers of names in these columns.
        of_cameras: the number of cameras.
    """
    n = frames.size
    refuse(
        (of_cameras < 2, "A recording needs two cameras or more."),
        (
            [cameras, targets] != [n, n] or pixels.shape not in ((n, 2), (0,)),
            "Frame, camera and target need n values each, and the points the shape (n, 2).",
        ),
        (not np.isfinite(pixels).all(), "An image point is not a finite number."),
        (not (frames == np.round(frames)).all(), "A frame is not a whole number."),
        (
            frames.dtype.kind == "f" and np.abs(frames).max(initial=0) > LARGEST_WHOLE,
            "A frame is above 2^53 - 1, up to which numbers are told apart.",
        ),
    )


def _whole(frames: npt.ArrayLike) -> FloatArray | IntArray:
    """The frames as numbers, exactly if they are integers."""
    given = np.asarray(frames)
    return given.astype(np.int64) if given.dtype.kind == "i" else _numbers("frame", frames)


def _numbers(what: str, values: npt.ArrayLike) -> FloatArray:
    """The values as numbers."""
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise StereocalError(f"Not every {what} is a number: {error}.") from None


def _codes(what: str, values: Iterable[Hashable], names: Sequence[str]) -> IntArray:
    """(n,): indices into the names."""
    known = {name: code for code, name in enumerate(names)}
    words = [str(value) for value in values]
    unknown = next((word for word in words if word not in known), None)
    if unknown is not None:
        several = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
        raise StereocalError(f"The {what} {unknown[:40]!r} is none of {several}.")
    return np.array([known[word] for word in words], dtype=np.int64)
