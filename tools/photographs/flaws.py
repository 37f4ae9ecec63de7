"""What goes wrong in the field: glare, motion blur, leaves in front of a target.

Only the frames concerned change: the random numbers of all others stay the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from stereocal.rig.camera import CameraName
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from tools.photographs.rendering import Board, Picture, Placed, turned

MOTION_STEPS = 41
"""Positions of a moving bar in one exposure; they are less than 1 px apart in the sample."""
LEAF_GREY = 70.0
LEAF_AT = 0.7
"""Where a leaf is, of the way from the camera to the target: the other camera sees it elsewhere."""
LEAF_SPIN = 0.4


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
        leaves = self._leaves(ends_m[self.target], board_m, secondary)
        if not any(self.motion_m):
            return [[*bar, *leaves]]
        steps = np.linspace(-0.5, 0.5, MOTION_STEPS)[:, None] * np.array(self.motion_m)
        moves = [Pose(np.eye(3), step) for step in steps]
        return [[*(placed.seen_from(move) for placed in bar), *leaves] for move in moves]

    def _leaves(self, target_m: FloatArray, board_m: float, secondary: Pose) -> list[Placed]:
        if not self.leaf:
            return []
        eye = np.zeros(3) if self.camera == "primary" else secondary.inverse().T
        scale = LEAF_AT * board_m
        place = eye + LEAF_AT * (target_m - eye) + scale * np.array([*self.leaf_offset, 0.0])
        leaf = Board(np.array([[LEAF_GREY]]), (scale * self.leaf, scale * self.leaf))
        return [Placed(leaf, Pose(turned((0.0, 0.0, LEAF_SPIN)), place))]


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


def add_glare(picture: Picture, centre: FloatArray, width_px: float, grey: float) -> None:
    """Add a bright spot (Gaussian, two standard deviations wide), in place.

    Args:
        centre: (2,) in pixels.
    """
    height, width = picture.shape
    u = np.exp(-0.5 * ((np.arange(width) - centre[0]) / (0.5 * width_px)) ** 2)
    v = np.exp(-0.5 * ((np.arange(height) - centre[1]) / (0.5 * width_px)) ** 2)
    picture += (grey * np.outer(v, u)).astype(np.float32)
