"""Simulated fisheyes of 175 to 220 degrees and boards before them, some of them at the rim.

Lenses have the projections that makers build (equidistant, equisolid, stereographic, between them),
with the image circle inside the image, across it, or beyond it; their centre lies up to 60 px of
1920 off that of the image. Points are projected at any angle from the axis, by formulas of their
own.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stereocal.frames.pairing import pair_names
from stereocal.intrinsics.boards import BoardSearch, BoardView
from stereocal.intrinsics.stereo_boards import StereoBoards, stereo_boards
from stereocal.rig.camera import CAMERAS
from stereocal.rig.geometry import Pose
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.array_types import FloatArray
from tools.photographs.rendering import turned

SIZES = (
    (640, 480),
    (1032, 778),
    (1280, 1024),
    (1920, 1080),
    (1920, 1440),
    (2704, 2028),
    (3840, 1920),
)
PATTERNS = (BoardPattern(5, 4, 0.03), BoardPattern(4, 5, 0.03), BoardPattern(8, 6, 0.03))
SLOPE = 0.05
"""Least pixels per angle within the view, over those on the axis."""
SPACING_PX = 5.0
MOST_TRIES = 100_000


@dataclass(frozen=True, eq=False)
class Fisheye:
    """A lens, and the angle from its axis to which it sees."""

    values: FloatArray
    """(8,): fx, fy, cx, cy, k1 to k4."""
    image_size: tuple[int, int]
    half: float

    def project(self, points: FloatArray) -> FloatArray:
        """Pixels (n, 2) of points (n, 3), NaN beyond the view."""
        r = np.hypot(points[:, 0], points[:, 1])
        angle = np.arctan2(r, points[:, 2])
        scale = radius_of(angle, self.values[4:]) / np.maximum(r, 1e-12)
        pixels = scale[:, None] * points[:, :2] * self.values[:2] + self.values[2:4]
        return np.where((angle <= self.half)[:, None], pixels, np.nan)


def radius_of(angle: FloatArray, k: FloatArray) -> FloatArray:
    """The radius in the image, in focal lengths."""
    powers = np.array([angle**3, angle**5, angle**7, angle**9])
    return np.asarray(angle + np.tensordot(k, powers, 1))


def draw_fisheye(rng: np.random.Generator) -> Fisheye:
    """A lens at random."""
    while True:
        half = float(np.radians(rng.uniform(175.0, 220.0) / 2))
        angle: FloatArray = np.linspace(0.01, half, 200)
        goals = (
            angle,
            2.0 * np.sin(angle / 2),
            2.0 * np.tan(angle / 2),
            1.25 * np.sin(angle / 1.25),
            angle + rng.uniform(-0.6, 1.6) * (2.0 * np.sin(angle / 2) - angle),
        )
        goal = goals[rng.integers(len(goals))]
        powers = np.column_stack([angle**3, angle**5, angle**7, angle**9])
        fitted = np.linalg.lstsq(powers, goal - angle, rcond=None)[0]
        k = np.asarray(fitted * rng.uniform(0.8, 1.2), dtype=np.float64)
        width, height = size = SIZES[rng.integers(len(SIZES))]
        across = (height, width, np.hypot(width, height))[rng.integers(3)]
        if np.diff(radius_of(angle, k)).min() < SLOPE * (angle[1] - angle[0]):
            continue
        f = 0.5 * across / radius_of(np.array([half]), k)[0]
        off = rng.uniform(-60.0, 60.0, 2) * width / 1920
        centre = 0.5 * (np.array(size) - 1.0) + off
        values = np.array([f, f * rng.uniform(0.995, 1.005), *centre, *k])
        return Fisheye(values, size, half)


def draw_boards(
    lens: Fisheye,
    pattern: BoardPattern,
    count: int,
    noise_px: float,
    rng: np.random.Generator,
    to: float = np.pi,
) -> BoardSearch:
    """Boards that are in view whole.

    Args:
        to: largest angle of a corner from the axis.
    """
    views: list[BoardView] = []
    for points in _placed(min(lens.half, to), pattern, rng):
        pixels = _whole(lens, pattern, points)
        if pixels is not None and away_of(points).max() <= to:
            views.append(_view(f"{len(views):02}.png", lens, pixels, noise_px, rng))
        if len(views) >= count:
            return BoardSearch(pattern, tuple(views))
    raise AssertionError


def draw_pairs(
    lenses: tuple[Fisheye, Fisheye],
    rig: Pose,
    pattern: BoardPattern,
    count: int,
    noise_px: float,
    rng: np.random.Generator,
) -> StereoBoards:
    """Boards that two cameras see whole; `rig` is secondary from primary."""
    views: list[tuple[BoardView, BoardView]] = []
    for points in _placed(lenses[0].half, pattern, rng):
        both = [
            _whole(lens, pattern, seen)
            for lens, seen in zip(lenses, (points, rig.apply(points)), strict=True)
        ]
        if both[0] is not None and both[1] is not None:
            first, second = (
                _view(f"{side}{len(views):02}.png", lens, pixels, noise_px, rng)
                for side, lens, pixels in zip(("left", "right"), lenses, both, strict=True)
                if pixels is not None
            )
            views.append((first, second))
        if len(views) >= count:
            break
    by_camera = zip(CAMERAS, zip(*views, strict=True), strict=True)
    searches = {str(camera): BoardSearch(pattern, own) for camera, own in by_camera}
    return stereo_boards(pair_names(view.name for each in views for view in each), searches)


def _placed(half: float, pattern: BoardPattern, rng: np.random.Generator) -> Iterator[FloatArray]:
    """Points (n, 3) of boards that are turned towards the camera and then tilted by 5 to 50
    degrees; the middles of half of them are in the outer third of the view."""
    points = pattern.points - pattern.points.mean(axis=0)
    for _ in range(MOST_TRIES):
        away = half * (rng.uniform(0.65, 1.0) if rng.random() < 0.5 else rng.uniform(0.0, 0.7))
        about, lean = rng.uniform(0.0, 2 * np.pi, 2)
        axes = [np.array([-np.sin(a), np.cos(a), 0.0]) for a in (about, lean)]
        facing = turned(away * axes[0])
        R = facing @ turned(np.radians(rng.uniform(5.0, 50.0)) * axes[1])
        R = R @ turned(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]))
        distance = np.ptp(points, axis=0).max() / rng.uniform(0.3, 1.3)
        yield points @ R.T + distance * facing[:, 2]


def _whole(lens: Fisheye, pattern: BoardPattern, points: FloatArray) -> FloatArray | None:
    """Pixels (n, 2) of the points of a board; None if it is not in view whole, or too small."""
    pixels = lens.project(points)
    grid = pixels.reshape(pattern.rows, pattern.columns, 2)
    steps = [np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)]
    inside = ((pixels > 2.0) & (pixels < np.array(lens.image_size) - 3.0)).all()
    return pixels if inside and min(steps) >= SPACING_PX else None


def _view(
    name: str, lens: Fisheye, pixels: FloatArray, noise_px: float, rng: np.random.Generator
) -> BoardView:
    corners = pixels + noise_px * rng.normal(size=pixels.shape)
    return BoardView(name, lens.image_size, np.arange(len(pixels)), corners)


def away_of(points: FloatArray) -> FloatArray:
    """(n,): angles of points (n, 3) from the axis."""
    return np.asarray(np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2]))


def draw_case(seed: int) -> tuple[Fisheye, BoardSearch, BoardSearch]:
    """A lens, 5 to 15 boards with noise of 0.1 to 0.5 px, and 20 more within 74 degrees to test."""
    rng = np.random.default_rng(seed)
    lens, pattern = draw_fisheye(rng), PATTERNS[rng.integers(len(PATTERNS))]
    count, noise_px = int(rng.integers(5, 16)), rng.uniform(0.1, 0.5)
    boards = draw_boards(lens, pattern, count, noise_px, rng)
    return lens, boards, draw_boards(lens, pattern, 20, noise_px, rng, np.radians(74.0))
