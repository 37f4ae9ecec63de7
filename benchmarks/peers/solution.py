"""What every program gives back, and what it used to get there."""

from collections.abc import Callable
from dataclasses import dataclass

from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.pair import Pair
from stereocal.system.array_types import FloatArray

THRESHOLD_PX = 2.0
"""From here on an epipolar distance is an outlier, for every program that asks for such a limit.

Ten times the noise of the simulated rigs: a lens off by 0.3 % and 5 px stays well below.
"""


class NoSolutionError(RuntimeError):
    """The program found no pose."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Pose and lenses, `x_secondary = R x_primary + T`, in metres."""

    R: FloatArray
    T: FloatArray
    cameras: tuple[Camera, Camera]
    """As given, or as the program changed them."""

    @property
    def pose(self) -> Pose:
        """The pose as stereocal has it."""
        return Pose(self.R, self.T)

    @classmethod
    def as_given(cls, pose: Pose, dataset: Pair) -> "Solution":
        """A pose with the lenses that the data set states."""
        return cls(pose.R, pose.T, (dataset.primary, dataset.secondary))


@dataclass(frozen=True)
class Peer:
    """A program, how it is called, and what it knows."""

    name: str
    solve: Callable[[Pair], Solution]
    """Raises `NoSolutionError`, or what the program itself raises."""
    scale: str
    lenses: str
    outliers: str
