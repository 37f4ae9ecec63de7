"""Two cameras of a recording: what is special of two is asked here."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import numpy as np
import numpy.typing as npt
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.rig.camera import (
    CAMERAS,
    Camera,
    CameraName,
    camera_in_words,
    one_file_in_words,
    pixel_scales,
)
from stereocal.rig.correspondences import TARGETS, Correspondences, refuse_points_outside
from stereocal.rig.fisheye import LARGEST_ANGLE
from stereocal.rig.geometry import Pose, stack_rays, triangulate_rays
from stereocal.rig.measured_lengths import check_lengths
from stereocal.rig.rig import Rig
from stereocal.rig.rigid_object import BoardPattern, RigidObject, placed
from stereocal.rig.tracks import TimeOffset
from stereocal.system.answers import TableAnswer
from stereocal.system.array_types import BoolArray, FloatArray, IntArray
from stereocal.system.made_from import digest_of
from stereocal.system.numbers import count, rounded

if TYPE_CHECKING:
    from stereocal.rig.recording import Recording

DIGESTED = ("frame", "target", "primary", "recorded_secondary", "distance_m", "known_points_m")


class Stated(TypedDict, total=False):
    """What can be stated otherwise of two cameras and their points (`Pair.changed`)."""

    name: str
    notes: str
    primary: Camera
    secondary: Camera
    correspondences: Correspondences
    baseline_m: float
    baseline_sigma_m: float | None
    target_distance_m: float
    target_distance_sigma_m: float | None


@dataclass(frozen=True, eq=False, repr=False)
class Pair(TableAnswer):
    """A view of two cameras of a recording: points and rays of what both see, made once."""

    recording: "Recording"
    """The recording of these cameras alone, the primary first; the points of the primary, then
    those of the secondary in the same order (`Recording.pair`)."""

    def __post_init__(self) -> None:
        check_lengths(
            self.baseline_m,
            self.target_distance_m,
            self.baseline_sigma_m,
            self.target_distance_sigma_m,
        )
        cameras = self.primary, self.secondary
        refuse_points_outside("", self.correspondences, *cameras, self.recording)
        # A fisheye that a fit has moved within its errors may see points beyond `LARGEST_ANGLE`.
        known = np.isfinite(self.rays)
        lost = np.flatnonzero(~known.all(axis=0))
        if len(lost):
            which = CAMERAS[int(known[:2, lost[0]].all())]
            twice = one_file_in_words((self.primary, self.secondary))
            raise StereocalError(twice + self._not_inverted(int(lost[0]), which))

    def _not_inverted(self, row: int, which: CameraName) -> str:
        """The message for a point where the lens model cannot be inverted."""
        camera: Camera = getattr(self, which)
        words = camera_in_words((self.camera_names or CAMERAS)[CAMERAS.index(which)])
        of_camera = f"{words[0].upper()}{words[1:]}'s"
        width, height = camera.image_size
        if camera.is_fisheye:
            largest = min(camera.largest_angle, LARGEST_ANGLE)
            return (
                f"{of_camera} fisheye lens images {self.correspondences.name_of(row)} "
                f"more than {np.degrees(largest):.0f} degrees from its axis: at most "
                f"{np.degrees(LARGEST_ANGLE):.0f} degrees can be used (a field of view of "
                f"{2 * np.degrees(LARGEST_ANGLE):.0f}). Leave such points out, or check the camera "
                "file."
            )
        size = camera.size_factor
        hint = f" K seems to belong to an image {rounded(size, 3)} times as large." if size else ""
        return (
            f"{of_camera} lens model cannot be inverted at "
            f"{self.correspondences.name_of(row)}: its focal length and distortion are impossible "
            f"for a point this far from the centre of the {width}x{height} px image. Check the "
            f"camera file.{hint}"
        )

    @property
    def names(self) -> tuple[str, str]:
        """The names of the two cameras, the primary first."""
        primary, secondary = self.recording.cameras
        return primary, secondary

    @property
    def camera_names(self) -> tuple[str, str] | None:
        """Their names; None if they are called primary and secondary."""
        return None if self.names == CAMERAS else self.names

    @property
    def name(self) -> str:
        """The name of the recording."""
        return self.recording.name

    @property
    def notes(self) -> str:
        """The notes of the recording."""
        return self.recording.notes

    @property
    def primary(self) -> Camera:
        """The first camera."""
        return self.recording.cameras[self.names[0]]

    @property
    def secondary(self) -> Camera:
        """The other one."""
        return self.recording.cameras[self.names[1]]

    @property
    def baseline_m(self) -> float:
        """Their measured distance; 1 m while it is free and not found yet."""
        measured = self.recording.baseline_m(*self.names)
        return 1.0 if measured is None else measured

    @property
    def baseline_sigma_m(self) -> float | None:
        """Its standard error; infinite if it is free: then the lengths of the bars alone give the
        scale."""
        return np.inf if self.baseline_is_to_be_found else self.recording.baseline_sigma_m

    @property
    def baseline_is_free(self) -> bool:
        """Whether the baseline was not measured, but found from the lengths of the bars."""
        return self.baseline_sigma_m == np.inf

    @property
    def baseline_is_to_be_found(self) -> bool:
        """Whether the baseline is free, and not found yet (`fit.start.baseline`)."""
        return self.recording.baseline_m(*self.names) is None

    @property
    def target_distance_m(self) -> float:
        """The length of the bar; of an object its longest distance."""
        return self.recording.object.longest_m

    @property
    def target_distance_sigma_m(self) -> float | None:
        """Its standard error; None if not stated."""
        return self.recording.object.sigma_m

    @property
    def board(self) -> BoardPattern | None:
        """The board that is seen; None of another object."""
        return self.recording.object.board

    @property
    def time_offset(self) -> TimeOffset | None:
        """How far the secondary points have been shifted in time; None if they are as recorded."""
        return self.recording.offsets.get(self.names[1])

    @property
    def start_frame(self) -> int:
        """The primary's frame at which the secondary's frame 0 was taken, by their own counts."""
        first, second = (self.recording.start_frames.get(name, 0) for name in self.names)
        return second - first

    @cached_property
    def correspondences(self) -> Correspondences:
        """The points that both see."""
        recording, n = self.recording, len(self.recording.frame) // 2
        known = {
            name: column[:n]
            for name in ("distance_m", "known_points_m", "source", "line", "time_frame")
            if (column := getattr(recording, name)) is not None
        }
        known |= {
            name: column[n:]
            for name in ("recorded", "motion")
            if (column := getattr(recording, name)) is not None
        }
        return Correspondences(
            recording.frame[:n],
            recording.target[:n],
            recording.points[:n],
            recording.points[n:],
            sigma_primary_px=recording.sigma_px[:n],
            sigma_secondary_px=recording.sigma_px[n:],
            rigid_object=None if recording.object.names == TARGETS else recording.object,
            **known,
        )

    @property
    def answer(self) -> list[str]:
        rows, lengths = self.correspondences, self.bar_distances_m
        held = "bar" if rows.rigid_object is None else rows.rigid_object.word
        how = "found from the known lengths" if self.baseline_is_free else "measured"
        apart = f"{rounded(self.baseline_m, 4)} m apart ({how})"
        if self.baseline_is_to_be_found:
            apart = "at a distance that the known lengths tell"
        known = f" of {rounded(float(np.median(lengths)), 4)} m" if len(lengths) else ""
        bars = f"{count(len(lengths), 'known length')}{known} ({held})"
        return [
            f"{self.name}: two cameras {apart}.",
            f"{count(len(rows), 'pair')} of points in {count(len(rows.frames), 'frame')}, {bars}.",
            f"Primary: {self.primary.in_words}. Secondary: {self.secondary.in_words}.",
        ]

    def to_dataframe(self) -> pd.DataFrame:
        """The table of points, as in `correspondences.csv`."""
        return self.correspondences.to_dataframe()

    def of_both(self, rows: BoolArray | None) -> BoolArray | None:
        """(2 n,): which points of the recording a mask (n,) chooses; None: all."""
        return None if rows is None else np.tile(rows, 2)

    def where(self, rows: BoolArray) -> "Pair":
        """The pair with some of its points, by a mask (n,)."""
        return Pair(self.recording.where(np.tile(rows, 2)))

    def of_frames(self, frames: npt.ArrayLike) -> "Pair":
        """The pair with the points of the given frames."""
        return self.where(np.isin(self.correspondences.frame, np.asarray(frames)))

    def changed(self, **given: Unpack[Stated]) -> "Pair":
        """The pair with something stated otherwise. The length is a bar's: another object has its
        own."""
        cameras = given.get("primary", self.primary), given.get("secondary", self.secondary)
        recording = replace(self.recording, cameras=dict(zip(self.names, cameras, strict=True)))
        if "correspondences" in given:
            recording = recording.holding(given["correspondences"])
        lengths = (
            given.get("baseline_m", self.baseline_m),
            given.get("target_distance_m", recording.object.longest_m),
            given.get("baseline_sigma_m", self.baseline_sigma_m),
            given.get("target_distance_sigma_m", self.target_distance_sigma_m),
        )
        check_lengths(*lengths)
        free = self.baseline_is_to_be_found and "baseline_m" not in given
        return Pair(
            replace(
                recording,
                name=given.get("name", self.name),
                notes=given.get("notes", self.notes),
                object=_of_length(recording.object, lengths[1], lengths[3]),
                baselines_m={} if free else {self.names: lengths[0]},
                baseline_sigma_m=lengths[2],
            )
        )

    def with_targets_exchanged(self, frames: npt.ArrayLike) -> "Pair":
        """The pair with A and B exchanged in the secondary image of the given frames.

        An object is turned (`RigidObject.half_turn`).
        """
        rows = self.correspondences
        turned = np.array([1, 0]) if rows.rigid_object is None else rows.rigid_object.half_turn
        return self.renumbered(turned, frames)

    def renumbered(self, numbers: IntArray, frames: npt.ArrayLike) -> "Pair":
        """The pair with other targets in the secondary image of the given frames.

        Targets whose counterpart is not seen in their frame are not changed.

        Args:
            numbers: (k,): of each target, whose secondary point it takes.
        """
        rows = self.correspondences
        width = len(numbers)
        key = rows.frame * width + rows.target
        wanted = rows.frame * width + numbers[rows.target]
        by_key = np.argsort(key)
        source_row = by_key[np.searchsorted(key, wanted, sorter=by_key).clip(max=len(key) - 1)]
        changes = np.isin(rows.frame, np.asarray(frames)) & (key[source_row] == wanted)
        order = np.where(changes, source_row, np.arange(len(rows)))
        names = ("secondary", "sigma_secondary_px", "recorded", "motion")
        changed = {name: getattr(rows, name)[order] for name in names}
        return Pair(self.recording.holding(replace(rows, **changed)))

    def shifted(self, offset: TimeOffset) -> "Pair":
        """The pair with the secondary points at the instants of the primary's frames
        (`Recording.shifted`)."""
        return Pair(self.recording.shifted({self.names[1]: offset}))

    @cached_property
    def rays(self) -> FloatArray:
        """Undistorted, normalised points, shape (4, n), as in `geometry`."""
        return stack_rays(*np.split(self.recording.rays, 2))

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
        """(m,): which bars of `correspondences.bars` are selected by `rows`, a mask (n,) of whole
        frames: a bar's first end tells."""
        return rows[self.correspondences.bars[:, 0]]

    def reconstructed_lengths_m(self, pose: Pose) -> FloatArray:
        """(m,): the lengths of the bars reconstructed with `pose`; NaN behind a camera."""
        points = triangulate_rays(pose.R, pose.T, self.rays)
        if self.recording.has_windows:
            rows = self.correspondences
            points = Rig(self.primary, self.secondary, pose).reconstruct(
                rows.primary, rows.secondary
            )
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
        return digest_of(content)

    @property
    def identity(self) -> list[Any]:
        """The digest, the stated uncertainties and the words: all that its results tell."""
        sigmas = [self.baseline_sigma_m, self.target_distance_sigma_m]
        return [self.sha256, *sigmas, self.name, self.notes]


def _of_length(known: RigidObject, longest_m: float, sigma_m: float | None) -> RigidObject:
    """The object with this standard error, and a bar with this length."""
    is_bar = known.names == TARGETS
    return RigidObject.bar(longest_m, sigma_m) if is_bar else replace(known, sigma_m=sigma_m)
