"""The data set of a calibration: image points of the bar, cameras, measured lengths."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from stereocal.errors import StereocalError, refuse
from stereocal.rig.camera import CAMERAS, Camera, CameraName, one_file_in_words, pixel_scales
from stereocal.rig.correspondences import Correspondences, refuse_points_outside
from stereocal.rig.fisheye import LARGEST_ANGLE
from stereocal.rig.geometry import Pose, stack_rays, triangulate_rays
from stereocal.rig.rig import camera_in_words
from stereocal.rig.rigid_object import BoardPattern, placed
from stereocal.rig.tracks import TimeOffset, interpolate
from stereocal.system.answers import TableAnswer
from stereocal.system.array_types import BoolArray, FloatArray, IntArray
from stereocal.system.numbers import count, rounded

LONGEST_PLAUSIBLE_M = 1000.0
"""A longer baseline or bar is taken for a number in millimetres."""
LARGEST_UNCERTAINTY, SMALLEST_UNCERTAINTY = 0.2, 1e-7
"""Of a measured length, as fractions of it. A larger one is taken for a number in another unit;
with a smaller one the fit cannot be computed in double precision."""
DIGESTED = ("frame", "target", "primary", "recorded_secondary", "distance_m", "known_points_m")


@dataclass(frozen=True, eq=False, repr=False)
class Dataset(TableAnswer):
    """Correspondences with the two cameras and the two measured lengths."""

    name: str
    primary: Camera
    secondary: Camera
    correspondences: Correspondences
    baseline_m: float
    """1 m while it is free and not found yet."""
    target_distance_m: float
    baseline_sigma_m: float | None = None
    """Infinite if the baseline is free: then the lengths of the bars alone give the scale."""
    target_distance_sigma_m: float | None = None
    notes: str = ""
    time_offset: TimeOffset | None = None
    """By which the secondary points have been shifted; None if they are as recorded."""
    camera_names: tuple[str, str] | None = None
    """Their names in a recording of more, the primary first; None if they have no others."""
    beyond_view: Mapping[str, int] = field(default_factory=dict)
    """By camera, how many points were left out by `with_points`."""
    start_frame: int = 0
    """The primary's frame at which the secondary's frame 0 was taken, by their own counts."""
    step_notes: tuple[str, ...] = ()
    """As of `Recording`."""
    baseline_found: bool = True
    """Whether a free baseline is found already (`network.baseline`)."""

    def __post_init__(self) -> None:
        check_lengths(
            self.baseline_m,
            self.target_distance_m,
            self.baseline_sigma_m,
            self.target_distance_sigma_m,
        )
        refuse_points_outside("", self.correspondences, self.primary, self.secondary)
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

    def with_points(self, rows: Correspondences) -> "Dataset":
        """The data set with these points, without pairs that a fisheye images farther from its
        axis than it is used; `beyond_view` counts them.

        Raises:
            StereocalError: more than half of a camera's points are there.
        """
        seen, beyond = rows.in_view(self.primary, self.secondary)
        return replace(self, correspondences=seen, beyond_view=beyond)

    @property
    def answer(self) -> list[str]:
        rows, lengths = self.correspondences, self.bar_distances_m
        held = "bar" if rows.rigid_object is None else rows.rigid_object.word
        found = "found from the known lengths" if self.baseline_is_free else "measured"
        apart = f"{rounded(self.baseline_m, 4)} m apart ({found})"
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

    @property
    def baseline_is_free(self) -> bool:
        """Whether the baseline was not measured, but found from the lengths of the bars."""
        return self.baseline_sigma_m == np.inf

    @property
    def baseline_is_to_be_found(self) -> bool:
        """Whether the baseline is free, and not found yet."""
        return self.baseline_is_free and not self.baseline_found

    @property
    def board(self) -> BoardPattern | None:
        """The board that is seen; None of another object."""
        rigid_object = self.correspondences.rigid_object
        return None if rigid_object is None else rigid_object.board

    def of_frames(self, frames: npt.ArrayLike) -> "Dataset":
        """The same data set with the given frames only."""
        return replace(self, correspondences=self.correspondences.of_frames(frames))

    def with_targets_exchanged(self, frames: npt.ArrayLike) -> "Dataset":
        """The data set with A and B exchanged in the secondary image of the given frames.

        An object is turned (`RigidObject.half_turn`).
        """
        rows = self.correspondences
        turned = np.array([1, 0]) if rows.rigid_object is None else rows.rigid_object.half_turn
        return self.renumbered(turned, frames)

    def renumbered(self, numbers: IntArray, frames: npt.ArrayLike) -> "Dataset":
        """The data set with other targets in the secondary image of the given frames.

        Targets whose counterpart is not seen in their frame are not changed.

        Args:
            numbers: (k,): of each target, whose secondary point it takes.
        """
        rows = self.correspondences
        width = len(numbers)
        key = rows.frame * width + rows.target
        wanted = rows.frame * width + numbers[rows.target]
        by_key = np.argsort(key)
        at = by_key[np.searchsorted(key, wanted, sorter=by_key).clip(max=len(key) - 1)]
        changes = np.isin(rows.frame, np.asarray(frames)) & (key[at] == wanted)
        order = np.where(changes, at, np.arange(len(rows)))
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
            if self.secondary.is_fisheye:
                known &= self.secondary.uses(self.secondary.undistort(found.positions))
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


def check_lengths(
    baseline_m: float,
    target_distance_m: float,
    baseline_sigma_m: float | None,
    target_distance_sigma_m: float | None,
) -> None:
    """Check the lengths of a data set and their standard errors, in metres, as of `Dataset`."""
    bar, free = "distance between the targets", baseline_sigma_m == np.inf
    refuse(
        (
            free and baseline_m > LONGEST_PLAUSIBLE_M,
            f"By a {bar} of {target_distance_m:g} m the cameras are {baseline_m:g} m apart: this "
            f"looks like millimetres. Give the distance in metres ({target_distance_m / 1000:g}).",
        )
    )
    check_length("baseline", baseline_m)
    check_length(bar, target_distance_m)
    if not free:
        check_uncertainty("baseline", baseline_sigma_m, baseline_m)
    check_uncertainty(bar, target_distance_sigma_m, target_distance_m)


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
