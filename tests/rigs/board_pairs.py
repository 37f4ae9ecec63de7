"""A board before two cameras as a recording: sound ones of unlike cameras, and one thing wrong."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation, Slerp

from stereocal.rig.camera import CAMERAS, Camera, LensUncertainty
from stereocal.rig.geometry import Pose
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.rig.rig import Rig
from stereocal.rig.rigid_object import BoardPattern, RigidObject
from stereocal.simulation.rigs import recording_of
from stereocal.simulation.simulate import lens_off_by
from stereocal.system.array_types import FloatArray
from tests.rigs.fisheye_rig import fisheye

SIZES = ((9, 6), (7, 5), (11, 8), (8, 6))
MARGIN_PX = 8.0
TRIES = 4000
WAVED_NOISE_PX = 0.2


@dataclass(frozen=True, eq=False)
class BoardPair:
    """Corners of a board in the images of two cameras, and what is stated of them."""

    cameras: tuple[Camera, Camera]
    """As stated."""
    board: BoardPattern
    points: FloatArray
    """(f, k, 2, 2): by frame, corner, camera; NaN where it is not seen."""
    baseline_m: float | None = None
    truth: Rig | None = None
    """With the true lenses; None of real photographs."""
    placings: tuple[Pose, ...] = ()
    """`primary_from_board` of each frame."""
    noise_px: float = 0.0

    @property
    def recording(self) -> Recording:
        """All that is seen, under the names of the corners that the board has."""
        board = RigidObject.of_board(self.board)
        cameras: dict[str, Camera] = dict(zip(CAMERAS, self.cameras, strict=True))
        pixels = np.moveaxis(self.points[:, : len(board.names)], 2, 0)
        found = recording_of("boards", cameras, board, [*pixels])
        found = found.counted_from(dict.fromkeys(CAMERAS, 1))
        if self.baseline_m is None:
            return found
        return replace(found, baselines_m={CAMERAS: self.baseline_m}, baseline_sigma_m=0.002)

    @property
    def dataset(self) -> Pair:
        """The recording as of two cameras."""
        return self.recording.pair(*CAMERAS)


def lens(rng: np.random.Generator) -> Camera:
    """A camera that is no other's like."""
    width, height = ((1280, 960), (1600, 1200), (1920, 1080), (640, 480))[rng.integers(4)]
    focal = width * rng.uniform(0.8, 1.5)
    centre = np.array([width, height]) * (0.5 + 0.02 * rng.standard_normal(2))
    K = np.array(
        [[focal, 0, centre[0]], [0, focal * rng.uniform(0.997, 1.003), centre[1]], [0, 0, 1]]
    )
    k1 = rng.uniform(-0.25, 0.05)
    return Camera(
        K, np.array([k1, -0.4 * k1, *(5e-4 * rng.standard_normal(2)), 0.0]), (width, height)
    )


def wide_lens(rng: np.random.Generator) -> Camera:
    """A fisheye of 120 to 175 degrees, its centre off that of the image."""
    camera = fisheye(float(rng.uniform(120.0, 175.0)), float(rng.uniform(0.6, 1.1)))
    return lens_off_by(camera, 0.0, tuple(20.0 * rng.standard_normal(2)))


def drawn_rig(
    rng: np.random.Generator, draw: Callable[[np.random.Generator], Camera] = lens
) -> tuple[Rig, float]:
    """Two unlike cameras that look at one place, the secondary rolled; and how far that is."""
    one, two = draw(rng), draw(rng)
    far = rng.uniform(0.6, 2.0)
    turn = rng.uniform(0.15, 0.8) * rng.choice([-1, 1])
    R = (
        Rotation.from_rotvec([0, 0, rng.normal(0, 0.2)])
        * Rotation.from_rotvec([rng.normal(0, 0.1), turn, 0.0])
    ).as_matrix()
    at = np.array([0.0, 0.0, far])
    return Rig(one, two, Pose(R, at * np.array([1, 1, rng.uniform(0.85, 1.15)]) - R @ at)), far


def true_corners(board: BoardPattern, bend_m: float) -> FloatArray:
    """(k, 3): the corners of a board that is bent by so much from the middle to its far corners."""
    own = board.points - board.points.mean(axis=0)
    x = own[:, 0] / np.abs(own[:, 0]).max()
    y = own[:, 1] / np.abs(own[:, 1]).max()
    own[:, 2] = bend_m * (0.8 * x**2 + 0.2 * x * y)
    return np.asarray(own)


def images_of(rig: Rig, pose: Pose, corners: FloatArray) -> FloatArray | None:
    """(k, 2, 2): the corners in both images; None if they are not whole in both."""
    points = pose.apply(corners)
    found = []
    for camera, seen in ((rig.primary, points), (rig.secondary, rig.pose.apply(points))):
        if (seen[:, 2] < 0.05).any() or not camera.uses(seen[:, :2] / seen[:, 2:]).all():
            return None
        pixels = camera.project(seen)
        inside = (pixels > MARGIN_PX) & (pixels < np.array(camera.image_size) - 1 - MARGIN_PX)
        if not inside.all():
            return None
        found.append(pixels)
    return np.stack(found, axis=1)


def draw_placings(
    rig: Rig,
    far: float,
    board: BoardPattern,
    rng: np.random.Generator,
    count: int,
    largest_roll: float = np.pi,
) -> tuple[Pose, ...]:
    """Boards that both cameras see whole, from the front."""
    found, corners = [], true_corners(board, 0.0)
    for _ in range(TRIES):
        depth = far * rng.uniform(0.6, 1.4)
        size = np.array(rig.primary.image_size)
        pixel = rng.uniform(0.1, 0.9, 2) * size
        ray = rig.primary.undistort(pixel[None])[0]
        turn = Rotation.from_rotvec([0, 0, rng.uniform(-largest_roll, largest_roll)])
        tilt = Rotation.from_rotvec([*rng.normal(0, 0.35, 2), 0.0])
        half = Rotation.from_matrix(rig.pose.R.T).as_rotvec() / 2
        R = (Rotation.from_rotvec(half) * tilt * turn).as_matrix()
        if not np.isfinite(ray).all():
            continue  # beyond the image circle of a fisheye
        pose = Pose(R, depth * np.array([*ray, 1.0]))
        if images_of(rig, pose, corners) is not None:
            found.append(pose)
            if len(found) == count:
                break
    return tuple(found)


def waved_placings(
    rig: Rig, far: float, board: BoardPattern, rng: np.random.Generator, frames: int, length: int
) -> tuple[Pose, ...]:
    """A board that is somewhere else every `length` frames, and moves evenly between; fewer frames
    where it would leave the images.

    It turns at once where no hand would: positions between the three frames about such a place are
    wrong by up to many pixels, so that a fit leaves up to 30 % of the frames out.
    """
    keys = [*draw_placings(rig, far, board, rng, frames // length + 12)]
    corners, found = true_corners(board, 0.0), list[Pose]()
    here = keys.pop()
    while keys and len(found) < frames:
        there = keys.pop()
        turns = Slerp([0, 1], Rotation.from_matrix(np.stack([here.R, there.R])))
        way = [
            Pose(turns(share).as_matrix(), (1.0 - share) * here.T + share * there.T)
            for share in np.arange(length) / length
        ]
        if all(images_of(rig, pose, corners) is not None for pose in way):
            found += way
            here = there
    return tuple(found[:frames])


def sound(
    number: int,
    frames: int = 20,
    baseline: bool = False,
    draw: Callable[[np.random.Generator], Camera] = lens,
) -> BoardPair:
    """A sound pair, asymmetric in everything; bent a bit; noise of 0.1 to 0.5 px."""
    for attempt in range(50):
        rng = np.random.default_rng([number, attempt, 0xB0A])
        rig, far = drawn_rig(rng, draw)
        columns, rows = SIZES[rng.integers(len(SIZES))]
        focal = rig.primary.K[0, 0]
        # The board fills a third of the image at the middle distance.
        square = 0.3 * rig.primary.image_size[0] * far / focal / columns
        board = BoardPattern(columns, rows, float(np.round(square, 4)))
        placings = draw_placings(rig, far, board, rng, frames)
        if len(placings) == frames:
            break
    noise = rng.uniform(0.1, 0.5)
    bend = rng.choice([-1.0, 0.0, 1.0]) * 0.004 * board.square_m * columns
    return seen_by(rig, board, placings, rng, noise, bend, baseline)


def seen_by(
    rig: Rig,
    board: BoardPattern,
    placings: tuple[Pose, ...],
    rng: np.random.Generator,
    noise_px: float,
    bend_m: float = 0.0,
    baseline: bool = False,
) -> BoardPair:
    """What the cameras see, with lenses stated as a calibration gives them."""
    corners = true_corners(board, bend_m)
    points = np.stack([seen_at(rig, pose, corners) for pose in placings])
    points += noise_px * rng.standard_normal(points.shape)
    focal, centre = 5e-4, 0.5
    cameras = []
    for camera in (rig.primary, rig.secondary):
        off = lens_off_by(camera, focal * rng.normal(), tuple(centre * rng.normal(size=2)))
        focal_px = focal * camera.K[0, 0]
        sigma = LensUncertainty(focal_px, focal_px, centre, centre, 0.0 * camera.distortion)
        cameras.append(replace(off, uncertainty=sigma) if rng.random() < 0.5 else off)
    stated = rig.pose.baseline + 0.001 * rng.normal() if baseline else None
    return BoardPair((cameras[0], cameras[1]), board, points, stated, rig, placings, noise_px)


def seen_at(rig: Rig, pose: Pose, corners: FloatArray, late: Pose | None = None) -> FloatArray:
    """(k, 2, 2): the corners in both images, the second perhaps of another moment."""
    first, second = pose.apply(corners), rig.pose.apply((late or pose).apply(corners))
    return np.stack([rig.primary.project(first), rig.secondary.project(second)], axis=1)


def board_of(pair: BoardPair, scale: npt.ArrayLike, second_half: bool = False) -> BoardPair:
    """The printed board is larger by a factor along its columns and rows than is stated; all along
    or in the second half."""
    assert pair.truth is not None
    rng, points = np.random.default_rng(7), pair.points.copy()
    corners = true_corners(pair.board, 0.0) * np.append(scale, 1.0)
    for frame, pose in enumerate(pair.placings):
        if not second_half or frame >= len(points) // 2:
            points[frame] = seen_at(pair.truth, pose, corners)
            points[frame] += pair.noise_px * rng.standard_normal(points[frame].shape)
    sizes = np.array([camera.image_size for camera in pair.cameras])
    inside = ((points > 0) & (points < sizes - 1)).all(axis=(1, 2, 3))
    return replace(pair, points=points[inside])


def waved(number: int, late: float, frames: int = 80, length: int = 10) -> BoardPair:
    """A board that is waved before exact lenses, the secondary late by a part of a frame."""
    placings: tuple[Pose, ...] = ()
    for attempt in range(20):
        rng = np.random.default_rng([number, attempt, 31])
        rig, far = drawn_rig(rng)
        square = 0.3 * rig.primary.image_size[0] * far / rig.primary.K[0, 0] / 7
        board = BoardPattern(7, 5, float(np.round(square, 4)))
        placings = waved_placings(rig, far, board, rng, frames, length)
        if len(placings) == frames:
            break
    corners, points = true_corners(board, 0.0), []
    for here, there in pairwise(placings):
        turns = Slerp([0, 1], Rotation.from_matrix(np.stack([here.R, there.R])))
        then = Pose(turns(late).as_matrix(), (1.0 - late) * here.T + late * there.T)
        points.append(seen_at(rig, here, corners, then))
    noisy = np.stack(points) + WAVED_NOISE_PX * rng.standard_normal((len(points), 35, 2, 2))
    cameras = rig.primary, rig.secondary
    return BoardPair(cameras, board, noisy, None, rig, placings[:-1], WAVED_NOISE_PX)
