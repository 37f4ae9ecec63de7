"""Synthetic pairs of photographs of a bar with a board at each end, with the true image points, and
what goes wrong in the field: glare, motion blur, leaves in front of a target.

    scene = place_visible_bars(field_rig(), rng, frames=25, length_m=0.9)
    for pair in photograph_bars(scene, (120.0, 120.0), BarSettings(), PhotographSettings(), rng):
        ...

Pairs are rendered one at a time, to save memory. What spoils a frame changes no other: the random
numbers of all others stay the same.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from stereocal.errors import StereocalError
from stereocal.field.printing.print_target import SEPARATION
from stereocal.rig.camera import CAMERAS, CameraName
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import FIELD_DEPTHS_M, MAXIMUM_ROUNDS, Scene, place_bars
from stereocal.system.array_types import FloatArray
from tools.photographs.rendering import (
    HERE,
    Board,
    Photograph,
    PhotographSettings,
    Picture,
    Placed,
    expose,
    exposed,
    turned,
    x_corner_board,
)
from tools.photographs.scenery import GROUND_M

VISIBLE_MARGIN_PX = 110.0
"""Least distance of a target from the edge of an image: a 0.18 m board at 8 m extends to 113 px if
it is rotated by 45 degrees, so almost all boards are completely visible."""
ROD_SHADES = (60.0, 110.0, 145.0, 160.0, 140.0, 105.0, 65.0)
"""Grey levels across a round rod lit from the front."""
MOTION_STEPS = 41
"""Positions of a moving bar in one exposure; they are less than 1 px apart in the sample."""
LEAF_GREY = 70.0
LEAF_AT = 0.7
"""Where a leaf is, of the way from the camera to the target: the other camera sees it elsewhere."""
LEAF_SPIN = 0.4


@dataclass(frozen=True)
class BarSettings:
    """The bar and its boards."""

    board_m: float = 0.18
    """Side of a 2x2 checkerboard: at 8 to 25 m and f = 7120 px it is 160 to 51 px across."""
    black: float = 35.0
    white: float = 205.0
    """Grey levels of the squares, of 255."""
    tilt_rad: tuple[float, float] = (0.0, float(np.deg2rad(35.0)))
    """Range of the angle between a board's normal and the line to the middle of the cameras."""
    rod_m: float = 0.025
    """Thickness of the rod between the boards and of the pole below it; 0 draws none."""


@dataclass(frozen=True)
class Flaw:
    """What spoils one frame; `camera` and `target` (0 A, 1 B) say where, but for motion."""

    what: str
    camera: CameraName = "primary"
    target: int = 0
    glare: float = 0.0
    """Brightest grey level added to the image; the spot is as wide as a board."""
    motion_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """How far the bar moves in an exposure, in the primary's frame."""
    leaf: float = 0.0
    """Side of a square leaf in front of the target, in sides of the board; 0 for none."""
    leaf_offset: tuple[float, float] = (0.0, 0.0)
    """Of its centre from the target, to the right and down, in sides of the board."""

    def exposure(
        self, bar: Sequence[Placed], ends_m: FloatArray, board_m: float, secondary: Pose
    ) -> list[list[Placed]]:
        """What is in view during the exposure, step by step, from the farthest to the nearest.

        Args:
            bar: the boards of the bar, in the primary's frame, as is the result.
            ends_m: (2, 3) targets A and B.
            board_m: side of a board.
            secondary: the rig's pose, `secondary_from_primary`.
        """
        leaves: list[Placed] = []
        if self.leaf:
            eye = np.zeros(3) if self.camera == "primary" else secondary.inverse().T
            scale, offset = LEAF_AT * board_m, np.array([*self.leaf_offset, 0.0])
            place = eye + LEAF_AT * (ends_m[self.target] - eye) + scale * offset
            leaf = Board(np.array([[LEAF_GREY]]), (scale * self.leaf, scale * self.leaf))
            leaves.append(Placed(leaf, Pose(turned((0.0, 0.0, LEAF_SPIN)), place)))
        if not any(self.motion_m):
            return [[*bar, *leaves]]
        steps = np.linspace(-0.5, 0.5, MOTION_STEPS)[:, None] * np.array(self.motion_m)
        moves = [Pose(np.eye(3), step) for step in steps]
        return [[*(placed.seen_from(move) for placed in bar), *leaves] for move in moves]


NO_FLAW = Flaw("")
SAMPLE_FLAWS: Mapping[int, Flaw] = MappingProxyType(
    {
        9: Flaw("glare on A in the secondary camera", "secondary", 0, glare=90.0),
        11: Flaw("motion blur", motion_m=(0.035, 0.02, 0.0)),
        19: Flaw("a leaf over half of A in the primary camera", leaf=0.9, leaf_offset=(0.35, 0.3)),
        22: Flaw("a leaf over B in the primary camera", target=1, leaf=1.7),
    }
)
"""By frame of the sample photographs."""


@dataclass(frozen=True, eq=False)
class PhotographPair:
    """The photographs of one frame, and the true image points of its targets."""

    frame: int
    primary: Photograph
    secondary: Photograph
    centres_primary: FloatArray
    """(2, 2): raw pixels (u, v) of the targets A and B."""
    centres_secondary: FloatArray


def photograph_bars(
    scene: Scene,
    backgrounds: tuple[Picture | float, Picture | float],
    bar: BarSettings,
    settings: PhotographSettings,
    rng: np.random.Generator,
    flaws: Mapping[int, Flaw] = MappingProxyType({}),
) -> Iterator[PhotographPair]:
    """Render the photographs of a scene frame by frame, numbered from 1.

    Tilt, in-plane rotation and polarity of each board are random.

    Args:
        backgrounds: backgrounds of the primary and the secondary, the same in all frames.
        flaws: what spoils some frames, by their numbers.
    """
    rig = scene.rig
    viewpoint = 0.5 * rig.pose.inverse().T
    for frame, ends in enumerate(scene.ends_m, start=1):
        objects = place_boards(ends, viewpoint, bar, rng)
        flaw = flaws.get(frame, NO_FLAW)
        exposure = flaw.exposure(objects, ends, bar.board_m, rig.pose)
        images, centres = [], []
        for which, camera, pose, background in zip(
            CAMERAS, (rig.primary, rig.secondary), (HERE, rig.pose), backgrounds, strict=True
        ):
            picture = exposed(camera, pose, background, exposure, settings.blur_px)
            points = pose.apply(ends)
            centres.append(camera.project(points))
            if flaw.glare and flaw.camera == which:
                width_px = camera.K[0, 0] * bar.board_m / points[flaw.target, 2]
                _add_glare(picture, centres[-1][flaw.target], width_px, flaw.glare)
            images.append(expose(picture, settings, rng))
        yield PhotographPair(frame, images[0], images[1], centres[0], centres[1])


def _add_glare(picture: Picture, centre: FloatArray, width_px: float, grey: float) -> None:
    """Add a bright spot (Gaussian, two standard deviations wide) at a pixel (2,), in place."""
    height, width = picture.shape
    u = np.exp(-0.5 * ((np.arange(width) - centre[0]) / (0.5 * width_px)) ** 2)
    v = np.exp(-0.5 * ((np.arange(height) - centre[1]) / (0.5 * width_px)) ** 2)
    picture += (grey * np.outer(v, u)).astype(np.float32)


def place_boards(
    ends_m: FloatArray, viewpoint: FloatArray, bar: BarSettings, rng: np.random.Generator
) -> list[Placed]:
    """Pole, rod and the boards of one frame, at the targets (2, 3) A and B, from the farthest to
    the nearest; the boards face the viewpoint (3,), between the cameras."""
    objects = []
    if bar.rod_m:
        middle = ends_m.mean(axis=0)
        foot = np.array([middle[0], GROUND_M, middle[2]])
        if middle[1] < GROUND_M - 0.1:
            objects.append(rod(middle, foot, viewpoint, bar.rod_m))
        objects.append(rod(ends_m[0], ends_m[1], viewpoint, bar.rod_m))
    boards = []
    for end in ends_m:
        tilt = float(rng.uniform(*bar.tilt_rad))
        pose = facing(end, viewpoint, tilt, *rng.uniform(-np.pi, np.pi, 2))
        board = x_corner_board(bar.board_m, bar.black, bar.white, bool(rng.integers(2)))
        boards.append(Placed(board, pose))
    boards.sort(key=lambda placed: -float(np.linalg.norm(placed.camera_from_board.T - viewpoint)))
    return objects + boards


def facing(
    centre: FloatArray, viewpoint: FloatArray, tilt: float, azimuth: float, spin: float
) -> Pose:
    """The pose of a board at `centre` (3,) that faces a viewpoint (3,), except for a tilt towards
    an azimuth, and is turned by `spin` in its own plane; angles in radians."""
    away = (centre - viewpoint) / np.linalg.norm(centre - viewpoint)
    across = np.cross([0.0, 1.0, 0.0], away)
    across /= np.linalg.norm(across)
    upright = np.column_stack([across, np.cross(away, across), away])
    axis = (tilt * np.cos(azimuth), tilt * np.sin(azimuth), 0.0)
    return Pose(upright @ turned(axis) @ turned((0.0, 0.0, spin)), centre)


def rod(start: FloatArray, end: FloatArray, viewpoint: FloatArray, thickness_m: float) -> Placed:
    """A round rod, approximated by a flat strip that faces the viewpoint."""
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length
    middle = 0.5 * (start + end)
    across = np.cross(middle - viewpoint, along)
    if np.linalg.norm(across) < 1e-6 * np.linalg.norm(middle - viewpoint):
        across = np.cross([1.0, 0.0, 0.0], along)
    across /= np.linalg.norm(across)
    shades = np.array(ROD_SHADES)[:, None]
    R = np.column_stack([along, across, np.cross(along, across)])
    return Placed(Board(shades, (length, thickness_m)), Pose(R, middle))


def place_visible_bars(
    rig: Rig,
    rng: np.random.Generator,
    frames: int,
    length_m: float,
    board_m: float = BarSettings.board_m,
    depths_m: tuple[float, float] = FIELD_DEPTHS_M,
    margin_px: float = VISIBLE_MARGIN_PX,
) -> Scene:
    """As `simulate.place_bars`, for bars whose boards do not hide each other in either camera."""
    eyes = (np.zeros(3), rig.pose.inverse().T)
    found = np.empty((0, 2, 3))
    for _ in range(MAXIMUM_ROUNDS):
        drawn = place_bars(rig, rng, frames, length_m, depths_m, margin_px).ends_m
        clear = np.ones(len(drawn), dtype=bool)
        for eye in eyes:
            sight = drawn[:, 0] - eye
            sight = sight / np.linalg.norm(sight, axis=1, keepdims=True)
            across = np.linalg.norm(np.cross(drawn[:, 1] - drawn[:, 0], sight), axis=1)
            clear &= across > SEPARATION * board_m
        found = np.concatenate([found, drawn[clear]])
        if len(found) >= frames:
            return Scene(rig, found[:frames])
    raise StereocalError(
        f"Boards of {board_m:g} m hide each other on a bar of {length_m:g} m; make them smaller."
    )
