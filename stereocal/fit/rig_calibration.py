"""A calibrated rig of N cameras: poses, lenses, their covariance, and what the points say."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from stereocal.fit.about_rig import Gap, Loop, ThirdCamera
from stereocal.fit.errors.held_out import (
    Groups,
    HeldOut,
    frame_errors,
    held_out,
    point_fits,
    relative_length_errors,
)
from stereocal.fit.least_squares.design_effect import design_effect
from stereocal.fit.least_squares.robust import RobustFit
from stereocal.fit.least_squares.small_steps import camera_at, rig_of, with_own_windows
from stereocal.fit.least_squares.views import DRIFT, EACH, TIME
from stereocal.fit.screening.wrong_images import WrongImage
from stereocal.fit.start.pairs import Pairs
from stereocal.fit.timing.out_of_step import SIGNIFICANT, SMALLEST
from stereocal.rig.camera import Camera
from stereocal.rig.clusters import Clusters, clusters_of, follow_each_other, in_equal_runs
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import Recording
from stereocal.rig.rig import Rig
from stereocal.rig.tracks import MeasuredOffset, TimeOffset
from stereocal.system.array_types import FloatArray


@dataclass(frozen=True, eq=False)
class RigCalibration:
    """A rig, with its data and how it was found."""

    fit: RobustFit
    """The joint fit of the sound images of the cameras that are connected."""
    pairs: Pairs
    wrong: tuple[WrongImage, ...]
    left_out: tuple[int, ...]
    """Frames that contradict the others, and no single image does; ascending."""
    unreached: Mapping[str, str]
    """Cameras that could not be connected with the others, and why."""
    shifts: tuple[TimeOffset, ...]
    """By how much each camera is late; 0 if they are in step."""
    warnings: tuple[str, ...] = ()
    moved: str = ""
    """Which camera moved among the frames, and when; empty if none did."""
    sha256: str = ""
    """Digest of the recording that was given; of `recording`, something may have been left out."""

    @property
    def recording(self) -> Recording:
        """What the rig was fitted to."""
        return self.fit.recording

    @property
    def names(self) -> list[str]:
        return list(self.recording.cameras)

    @cached_property
    def poses(self) -> dict[str, Pose]:
        """`camera_from_reference`; the first camera is the reference."""
        return dict(zip(self.names, self.fit.poses, strict=True))

    @cached_property
    def cameras(self) -> dict[str, Camera]:
        """With the refined lenses."""
        stated, at = self.recording.cameras, self.fit.at
        return {name: camera_at(stated[name], at, number) for number, name in enumerate(self.names)}

    @cached_property
    def point_fits(self) -> tuple[FloatArray, FloatArray]:
        """Points (n, 2, 3) of the units of `fit.seen`, from their pixels alone, and residuals
        (n, 2, c, 2) in pixels; NaN where not seen."""
        return point_fits(self.fit.at, self.fit.seen)

    @cached_property
    def clusters(self) -> Clusters:
        """The used frames, in clusters of alike errors."""
        fit, (_, residuals) = self.fit, self.point_fits
        first = np.full((len(fit.frames), residuals[0].size), np.nan)
        for unit in np.flatnonzero(~fit.outlying[fit.frame_of])[::-1]:
            first[fit.frame_of[unit]] = residuals[unit].ravel()
        return clusters_of(fit.frames[self.fit.used], first[self.fit.used] / fit.sigma_px)

    @cached_property
    def frames_follow(self) -> bool:
        """Whether the frames follow each other: by their errors, or as of a waved object."""
        return self.clusters.has_runs or follow_each_other(self._places)

    @property
    def _places(self) -> FloatArray:
        """(f, 2): of the object in the images of the camera that sees most of it."""
        of_frames = np.searchsorted(self.fit.frame_of, self.fit.used)  # the first unit of each
        seen = self.fit.seen.pixels[of_frames, 0]
        return np.asarray(seen[:, int(np.isfinite(seen[..., 0]).sum(axis=0).argmax())])

    @cached_property
    def design_effect(self) -> float:
        """How many times the clusters scatter more than independent frames would; at least 1."""
        fit, clusters = self.fit, in_equal_runs(self.clusters, self._places)
        return design_effect(fit, fit.used, clusters)

    @cached_property
    def covariance(self) -> FloatArray:
        """(Q, Q): of the unknowns of `views`, windows in the frame of each camera; 0 for fixed
        ones."""
        fit, M = self.fit, self.fit.unknowns.M
        of_p = fit.at_end.covariance(fit.H / self.design_effect)
        if self.recording.windows:
            M = with_own_windows(fit.at)[1] @ M
        return np.asarray(M @ of_p @ M.T)

    @property
    def time_offsets(self) -> FloatArray:
        """(c,): by how many frames each camera is late, in the middle of the recording."""
        return np.array([shift.frames for shift in self.shifts])

    @cached_property
    def offsets(self) -> tuple[MeasuredOffset, ...]:
        """How late each camera is, with its errors."""
        errors = np.sqrt(np.diag(self.covariance))[: EACH * len(self.names)]
        of_times = errors.reshape(-1, EACH)[:, [TIME, DRIFT]]
        return tuple(
            MeasuredOffset(shift.frames, shift.drift, shift.reference, *sigma)
            for shift, sigma in zip(self.shifts, of_times.tolist(), strict=True)
        )

    @property
    def out_of_step(self) -> bool:
        """Whether a camera is out of step with the reference, significantly."""
        return any(
            offset.is_claimed(SIGNIFICANT) and offset.most(self.fit.frames) >= SMALLEST
            for offset in self.offsets
        )

    @property
    def image_px(self) -> Mapping[str, float]:
        """Median distance of each camera's images from where two others or more see the point, on
        frames not fitted; NaN without such points."""
        unknown = dict.fromkeys(self.names, float("nan"))
        return unknown if self.further is None else self.further.apart_px

    @property
    def weakest(self) -> str:
        """The camera whose images are predicted worst; where no three cameras see the same points,
        the one that shares fewest bars."""
        if np.isfinite(list(self.image_px.values())).all():
            return max(self.image_px, key=lambda name: self.image_px[name])
        bars = self.pairs.bars.items()
        return min(self.names, key=lambda name: max(n for pair, n in bars if name in pair))

    @cached_property
    def reprojection_px(self) -> FloatArray:
        """(f,): root mean square distance of the images of each frame; NaN if left out."""
        errors_px = frame_errors(self.point_fits[1], self.fit.frame_of, len(self.fit.frames))
        return np.where(self.fit.outlying, np.nan, errors_px)

    @cached_property
    def length_errors(self) -> FloatArray:
        """(m,): relative errors of the lengths of the frames used."""
        units = ~self.fit.outlying[self.fit.frame_of]
        return relative_length_errors(self.point_fits[0][units], self.fit.seen.distances[units])

    @cached_property
    def _held_out_runs(self) -> HeldOut | None:
        return held_out(self.fit, "runs") if self.frames_follow else None

    @cached_property
    def _held_out_frames(self) -> HeldOut | None:
        return held_out(self.fit, "frames")

    @property
    def held_out(self) -> dict[Groups, HeldOut]:
        """Errors on frames not fitted, as of `held_out.held_out`, as far as they are known."""
        by_groups: dict[Groups, HeldOut | None]
        by_groups = {"frames": self._held_out_frames, "runs": self._held_out_runs}
        return {name: errors for name, errors in by_groups.items() if errors is not None}

    @property
    def further(self) -> HeldOut | None:
        """What a further recording is to be expected to show: the errors of whole runs held out, or
        of single frames where these do not follow each other; None for too few frames."""
        return self._held_out_runs or self._held_out_frames

    @cached_property
    def loops(self) -> tuple[Loop, ...]:
        """How far every three cameras whose three pairs were calibrated are from closing, before
        they are one rig."""
        entries = []
        for trio in combinations(self.names, 3):
            ab, bc, ca = (self.pair_alone(trio[i], trio[(i + 1) % 3]) for i in range(3))
            if ab is None or bc is None or ca is None:
                continue
            round_trip = ca.pose @ bc.pose @ ab.pose
            angle = np.degrees(np.arccos(np.clip((np.trace(round_trip.R) - 1) / 2, -1, 1)))
            before = Gap(float(angle), round_trip.baseline)
            entries.append(Loop(trio, 0.0, 0.0, before))
        return tuple(entries)

    def pair_alone(self, first: str, second: str) -> Rig | None:
        """Two cameras as their pair by itself has them; None if it was not calibrated."""
        for pair in ((first, second), (second, first)):
            if (fit := self.pairs.fits.get(pair)) is not None:
                one, other = (self.recording.cameras[name] for name in pair)
                rig = rig_of(one, other, fit.at)
                reverse = Rig(rig.secondary, rig.primary, rig.pose.inverse())
                return rig if pair[0] == first else reverse
        return None

    def pair(self, first: str, second: str) -> Rig:
        """Two cameras as the rig has them."""
        pose = self.poses[second] @ self.poses[first].inverse()
        return Rig(self.cameras[first], self.cameras[second], pose)


FEWEST_POINTS = 10
MOST_TRIPLES = 120


def third_cameras(rig: RigCalibration, images: FloatArray | None = None) -> tuple[ThirdCamera, ...]:
    """How far points of two cameras are from their images in a third.

    Args:
        images: (n, c, 2): of points; None for those that the rig was fitted to.
    """
    entries: list[ThirdCamera] = []
    if images is None:
        used = rig.fit.seen.pixels[~rig.fit.outlying[rig.fit.frame_of]]
        images = used.reshape(-1, len(rig.names), 2)
    for trio in combinations(range(len(rig.names)), 3):
        seen = images[:, trio]
        seen = seen[np.isfinite(seen[..., 0]).all(axis=1)]
        if len(seen) < FEWEST_POINTS or len(entries) >= MOST_TRIPLES:
            continue
        for order in ((0, 1, 2), (0, 2, 1), (1, 2, 0)):
            a, b, c = (rig.names[trio[k]] for k in order)
            pair, with_third = rig.pair_alone(a, b), rig.pair_alone(a, c)
            if pair is None or with_third is None:
                continue
            before = _off(pair, with_third, seen[:, order])
            after = _off(rig.pair(a, b), rig.pair(a, c), seen[:, order])
            if np.isfinite([before, after]).all():
                entries.append(ThirdCamera((a, b), c, len(seen), before, after))
    return tuple(entries)


def _off(pair: Rig, with_third: Rig, images: FloatArray) -> float:
    """Median distance of the points of a pair from their images (n, 3, 2) in a third camera, the
    secondary of another pair with the same primary; infinite if none is in front of it."""
    points = with_third.pose.apply(pair.reconstruct(images[:, 0], images[:, 1]))
    predicted = with_third.secondary.project(points)
    apart = np.linalg.norm(predicted - images[:, 2], axis=1)
    return float(np.nanmedian(apart)) if np.isfinite(apart).any() else np.inf
