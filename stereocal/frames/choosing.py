"""Choose the two targets where a photograph shows more than two boards.

The unambiguous ("sure") frames determine the epipolar geometry and the length of the bar in units
of the baseline. A choice is a pair of boards in each camera with one of the two labellings. It is
accepted if it fits both within their errors and every other choice is clearly off.
"""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from stereocal.calibration.essential import calibrate_essential
from stereocal.detection.target import Sighting
from stereocal.errors import StereocalError
from stereocal.fit.screening.outliers import MAD_TO_SIGMA
from stereocal.frames.epipolar_labels import SMALLEST_EXCESS_PX, frame_focal_px
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.geometry import Angles, Pose, sampson, triangulate_rays
from stereocal.system.array_types import BoolArray, FloatArray

MINIMUM_SURE = 8
"""Sure frames: 16 distances and 5 angles give the noise to 21 %. With fewer frames, noise and
length spread are too uncertain to rule a choice out."""
FITS = 4.0
"""Largest deviation of the right choice, in standard errors."""
CLEARLY_OFF = 2.0
"""Every other choice must deviate by more than this multiple of the limit for the right one."""
SMALLEST_LENGTH = 0.005
"""What `SMALLEST_EXCESS_PX` is for lengths, as a fraction."""
LARGEST_PX, LARGEST_LENGTH = 1.0, 0.05
"""With larger limits (sure frames too similar to each other) wrong choices fit by chance."""
SAME_POSITION_PX = 3.0
"""A board this close, in both cameras, to a board of another frame is stationary."""
STEP = 1e-6
"""Step of finite differences, radians and normalised coordinates."""


@dataclass(frozen=True)
class ChosenBoards:
    """The detections of a frame with too many boards."""

    primary: Sighting
    secondary: Sighting
    sentence: str
    """What was chosen, or why nothing was."""


def choose_boards(
    sure: FloatArray,
    open_frames: Mapping[int, tuple[Sighting, Sighting]],
    cameras: tuple[Camera, Camera],
) -> dict[int, ChosenBoards]:
    """The chosen detections of frames with alternatives; the original ones if undecided.

    Args:
        sure: (n, 2, 2, 2): raw pixels in n sure frames, by frame, target, camera, (u, v).
        open_frames: by frame number, the primary and secondary detection to choose from.
    """
    expected = None
    if len(sure) >= MINIMUM_SURE:
        of_sure = [_undistorted(cameras[i], sure[:, :, i]) for i in range(2)]
        focal = float(np.median(frame_focal_px(cameras, of_sure)))
        expected = _expect(np.concatenate(of_sure, axis=-1), focal)
    seen = {frame: [_all_centres(one) for one in both] for frame, both in open_frames.items()}
    chosen = {}
    for frame, both in open_frames.items():
        elsewhere = [
            np.concatenate(
                [sure[:, :, i].reshape(-1, 2), *(its[i] for f, its in seen.items() if f != frame)]
            )
            for i in range(2)
        ]
        chosen[frame] = _choose(expected, len(sure), both, cameras, elsewhere)
    return chosen


@dataclass(frozen=True, eq=False)
class _Expected:
    """Geometry and errors estimated from the sure frames."""

    angles: FloatArray
    covariance: FloatArray
    """(5, 5), radians^2."""
    noise: float
    """Standard deviation of one coordinate, normalised units."""
    log_length: float
    """Logarithm of the bar's length per baseline."""
    spread: float
    """Robust standard deviation of `log_length`."""
    focal_px: float

    def off(self, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Deviation (k,) of choices (k, 2, 4) over the limits, infinite behind a camera, and the
        limits (k, 2): distance from the epipolar line in px, length error as a fraction."""
        values = _values(self.angles, rays)
        values[:, 2] -= self.log_length
        by_angles = _derivatives(lambda d: _values(self.angles + d, rays), 5)
        by_ray = _derivatives(lambda d: _values(self.angles, rays + d.reshape(2, 4)), 8)
        variance = np.einsum("kvi,ij,kvj->kv", by_angles, self.covariance, by_angles)
        variance += self.noise**2 * (by_ray**2).sum(axis=2)
        variance[:, 2] += self.spread**2
        smallest = SMALLEST_EXCESS_PX / self.focal_px
        limits = np.maximum(FITS * np.sqrt(variance), [smallest, smallest, SMALLEST_LENGTH])
        off = np.nan_to_num(np.abs(values) / limits, nan=np.inf).max(axis=1)
        return off, np.column_stack([limits[:, :2].max(axis=1) * self.focal_px, limits[:, 2]])

    def leaves_an_end(self, rays: FloatArray, left: list[FloatArray], limit_px: float) -> bool:
        """Whether a board outside the choice (2, 4) may be a target hidden from one camera: seen by
        the other alone, within one bar length of a chosen board.

        Args:
            left: for each camera, normalised points (m, 2) of the moving boards not chosen.
        """
        pose = Pose.from_angles(Angles(*self.angles.tolist()), 1.0)
        ends = triangulate_rays(pose.R, pose.T, rays.T.copy())
        apart = np.array([[np.hstack([p, q]) for q in left[1]] for p in left[0]])
        apart = np.abs(sampson(pose.essential, apart.reshape(len(left[0]), len(left[1]), 4)))
        alone = ~(apart < limit_px / self.focal_px)
        longest = (1 + LARGEST_LENGTH) * np.exp(self.log_length)
        for i, eye, R in ((0, np.zeros(3), np.eye(3)), (1, pose.inverse().T, pose.R.T)):
            for point in left[i][alone.all(axis=1 - i)]:
                sight = R @ [*point, 1.0]
                away = np.linalg.norm(np.cross(ends - eye, sight), axis=1) / np.linalg.norm(sight)
                if (away < longest).any():
                    return True
        return False


def _expect(rays: FloatArray, focal_px: float) -> _Expected | None:
    """The geometry from the rays (n, 2, 4) of the sure frames; None if undetermined."""
    pairs = rays.reshape(-1, 4)
    try:
        angles = np.array(calibrate_essential(pairs.T.copy(), 1.0).pose.angles)
        values = _values(angles, rays)
        residuals = values[:, :2].ravel()
        noise = np.sqrt(residuals @ residuals / (len(residuals) - 5))
        J = _derivatives(lambda d: _values(angles + d, rays), 5)[:, :2].reshape(-1, 5)
        covariance = noise**2 * np.linalg.inv(J.T @ J)
    except (StereocalError, np.linalg.LinAlgError):
        return None
    lengths = values[np.isfinite(values[:, 2]), 2]
    if len(lengths) < MINIMUM_SURE:
        return None
    usual = float(np.median(lengths))
    spread = MAD_TO_SIGMA * float(np.median(np.abs(lengths - usual)))
    return _Expected(angles, covariance, float(noise), usual, spread, focal_px)


def _choose(
    expected: _Expected | None,
    sure: int,
    both: tuple[Sighting, Sighting],
    cameras: tuple[Camera, Camera],
    elsewhere: list[FloatArray],
) -> ChosenBoards:
    """Decide on one frame; `elsewhere`: for each camera, boards (m, 2) of the other frames, px."""
    pairs = [one.alternatives or (one,) for one in both]
    if not all(all(one.spots) for one in (*pairs[0], *pairs[1])):
        return ChosenBoards(*both, "")  # one photograph shows no pair at all
    if expected is None:
        few = f": {sure} found, {MINIMUM_SURE} needed" if sure < MINIMUM_SURE else ""
        return ChosenBoards(
            *both, f"The sure frames do not determine which boards are the targets{few}."
        )
    ends = [
        _undistorted(camera, np.array([_centres(pair) for pair in of_camera]))
        for camera, of_camera in zip(cameras, pairs, strict=True)
    ]
    choices = [*itertools.product(range(len(pairs[0])), range(len(pairs[1])), (1, -1))]
    rays = np.array([np.hstack([ends[0][i], ends[1][j][::way]]) for i, j, way in choices])
    off, limits = expected.off(rays)
    best = int(np.argmin(off))
    i, j, way = choices[best]
    chosen = pairs[0][i], pairs[1][j]
    # Both boards of a resting bar are still. A background board is in every frame, and may by
    # chance be at the bar's length from a visible target while the other target is hidden.
    places = _centres(chosen[0]), _centres(chosen[1])[::way]
    still = np.logical_and(*map(_is_still, places, elsewhere))
    objections = {
        "No choice of boards fits the other frames.": off[best] > 1.0,
        "More than one choice of boards fits the other frames.": (
            np.delete(off, best) <= CLEARLY_OFF
        ).any(),
        "The sure frames are too similar to determine which boards are the targets.": (
            limits[best] > [LARGEST_PX, LARGEST_LENGTH]
        ).any(),
        "Of the two boards that fit, one is stationary and the other moves.": still[0] != still[1],
        "A target may be hidden: only one camera sees a board near those that fit.": (
            expected.leaves_an_end(
                rays[best], _left_over(both, chosen, elsewhere, cameras), limits[best, 0]
            )
        ),
    }
    for why, applies in objections.items():
        if applies:
            return ChosenBoards(*both, why)
    among = " and ".join(
        f"{len(_all_centres(one))} boards in the {name}"
        for name, one in zip(CAMERAS, both, strict=True)
        if one.alternatives
    )
    return ChosenBoards(*chosen, f"Chosen among {among} by comparison with the other frames.")


def _left_over(
    both: tuple[Sighting, Sighting],
    chosen: tuple[Sighting, Sighting],
    elsewhere: list[FloatArray],
    cameras: tuple[Camera, Camera],
) -> list[FloatArray]:
    """For each camera, the moving boards (m, 2) that were not chosen, normalised."""
    left = []
    for seen, kept, others, camera in zip(both, chosen, elsewhere, cameras, strict=True):
        centres, known = _all_centres(seen), np.vstack([_centres(kept), others])
        left.append(_undistorted(camera, centres[~_is_still(centres, known)]))
    return left


def _is_still(centres: FloatArray, elsewhere: FloatArray) -> BoolArray:
    """(m,): whether another frame has a board at the same position, px."""
    away = np.linalg.norm(elsewhere[:, None] - centres, axis=2).min(axis=0)
    return np.asarray(away < SAME_POSITION_PX)


def _all_centres(seen: Sighting) -> FloatArray:
    """(m, 2): raw pixels of all boards that may be targets."""
    centres = [_centres(one) for one in (seen, *seen.alternatives)]
    return np.unique(np.concatenate(centres), axis=0)


def _centres(pair: Sighting) -> FloatArray:
    """(2, 2): raw pixels of the two boards; (0, 2) if none were found."""
    return np.array([spot.centre for spot in pair.spots if spot]).reshape(-1, 2)


def _undistorted(camera: Camera, pixels: FloatArray) -> FloatArray:
    """(..., 2): normalised points of raw pixels (..., 2)."""
    return camera.undistort(pixels.reshape(-1, 2)).reshape(pixels.shape)


def _values(angles: FloatArray, rays: FloatArray) -> FloatArray:
    """(k, 3): Sampson distances of both targets, logarithm of the bar's length per baseline."""
    pose = Pose.from_angles(Angles(*angles.tolist()), 1.0)
    points = triangulate_rays(pose.R, pose.T, rays.reshape(-1, 4).T.copy()).reshape(-1, 2, 3)
    length = np.linalg.norm(points[:, 0] - points[:, 1], axis=1)
    with np.errstate(divide="ignore"):
        return np.column_stack([sampson(pose.essential, rays), np.log(length)])


def _derivatives(function: Callable[[FloatArray], FloatArray], unknowns: int) -> FloatArray:
    """(k, 3, unknowns): central differences of a function that returns (k, 3)."""
    steps = STEP * np.eye(unknowns)
    with np.errstate(invalid="ignore"):
        slopes = [(function(step) - function(-step)) / (2 * STEP) for step in steps]
    return np.stack(slopes, axis=-1)
