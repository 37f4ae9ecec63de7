"""What was observed to find the world frame, the choice of origin and axes, and what was found."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from stereocal.errors import StereocalError
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import rounded

LineKind = Literal["plumb", "level", "horizon"]
KINDS: tuple[LineKind, ...] = ("plumb", "level", "horizon")
Source = Literal["survey", "plumb", "level", "throw"]
SOURCES: tuple[Source, ...] = ("survey", "plumb", "level", "throw")


@dataclass(frozen=True, eq=False)
class Survey:
    """Points with surveyed coordinates, n rows; several rows may be of one point."""

    names: tuple[str, ...]
    """(n,)."""
    world_m: FloatArray
    """(n, 3): surveyed coordinates."""
    pixels: FloatArray
    """(n, 4): raw pixels u, v in the primary and in the secondary; NaN if `measured_m` is given."""
    measured_m: FloatArray
    """(n, 3): already reconstructed, in the primary's frame; NaN if `pixels` is given."""


@dataclass(frozen=True, eq=False)
class Line:
    """Points along a straight line; those of the two images need not be the same points."""

    name: str
    kind: LineKind
    pixels: tuple[FloatArray, FloatArray]
    """(m, 2) raw pixels in the primary, (k, 2) in the secondary; m or k may be 0."""


@dataclass(frozen=True, eq=False)
class Throw:
    """Images of objects in free flight, n rows, with a time for each frame."""

    tracks: tuple[str, ...]
    """(n,): names of the throws; all are of the same object."""
    frames: IntArray
    """(n,)."""
    pixels: FloatArray
    """(n, 4): raw pixels u, v in the primary and in the secondary."""
    frame_rate: float
    """Frames per second."""

    def __post_init__(self) -> None:
        if not 0.1 <= self.frame_rate <= 1e6:
            raise StereocalError(
                f"The frame rate is {self.frame_rate:g} frames per second; it must be from 0.1 to "
                "1,000,000."
            )


Observed = Survey | Sequence[Line] | Throw
CAMERA, VIEW, BASELINE = "camera", "view", "baseline"
SURVEY, FIRST = "survey", "first"
NEAREST_TO_UP = float(np.sin(np.radians(5.0)))
"""A direction within 5 degrees of the vertical cannot be the x axis."""
LARGEST_TILT = float(np.radians(5.0))
"""A vertical with a larger 95 % error counts as undetermined."""


@dataclass(frozen=True)
class Axes:
    """The chosen origin and axes; the z axis always points up, or as surveyed."""

    origin: str | None = None
    """`camera` (the primary's centre), `first` (the first point of a throw), or the name of a
    surveyed point, which becomes (0, 0, 0). None: the survey's own origin, else `camera`."""
    x_axis: str | None = None
    """Horizontal part of `view` (the primary's viewing direction), `baseline` (from the primary to
    the secondary) or the level line of this name. None: the survey's own axes, else `view`."""
    heading_deg: float = 0.0
    """Turns the x axis from there, counter-clockwise as seen from above."""

    def __post_init__(self) -> None:
        if not abs(self.heading_deg) <= 360:
            raise StereocalError(
                f"The heading is {self.heading_deg:g} degrees; it must be from -360 to 360."
            )


@dataclass(frozen=True)
class WorldSettings:
    """What a person states about the observations, and the axes they choose."""

    axes: Axes = field(default_factory=Axes)
    sigma_px: float | None = None
    """Noise of an image coordinate; None: as the points of lines or of a throw scatter, else that
    of the parameters."""
    survey_sigma_m: float = 0.005
    """Standard error of a surveyed coordinate."""
    drag: bool = True
    """Whether the air may slow a thrown object; False for one that is heavy for its size."""
    upside_down: bool = False
    """Whether the cameras hang upside down, for lines."""


@dataclass(frozen=True, eq=False)
class WorldFrame:
    """The world frame, and what is known about it."""

    pose: Pose
    """`world_from_primary`."""
    source: Source
    uncertainty: Mapping[str, Any]
    """The entries of `world.json`: 95 % limits, in degrees and metres."""
    sentence: str
    notes: tuple[str, ...] = ()
    about: Mapping[str, Any] = field(default_factory=dict)
    """Further entries of `world.json`: residuals of surveyed points, gravity."""


def frame_of_up(
    rig: Rig,
    up: FloatArray,
    axes: Axes,
    origins: Mapping[str, FloatArray],
    directions: Mapping[str, FloatArray],
    usual: tuple[str, str],
) -> Pose:
    """`world_from_primary` with the z axis along a unit vector (3,) in the primary's frame.

    Args:
        origins, directions: what `axes` may name besides the camera's, in that frame too.
        usual: origin and x axis where `axes` names none.
    """
    origins = {**origins, CAMERA: np.zeros(3)}
    of_rig = {VIEW: np.array([0.0, 0.0, 1.0]), BASELINE: rig.pose.inverse().T}
    directions = {**of_rig, **directions}
    chosen = axes.origin or usual[0], axes.x_axis or usual[1]
    for name, known, what in zip(chosen, (origins, directions), ("origin", "x axis"), strict=True):
        if name not in known:
            raise StereocalError(
                f'The {what} "{name[:60]}" is unknown here; choose one of: '
                f"{', '.join(known)[:200]}."
            )
    origin, along = origins[chosen[0]], directions[chosen[1]]
    along = along / np.linalg.norm(along)
    level = along - (along @ up) * up
    if np.linalg.norm(level) < NEAREST_TO_UP:
        raise StereocalError(
            f"The x axis cannot follow {chosen[1]}, which points straight up or down; choose "
            f"another: {', '.join(directions)}."
        )
    x, heading = level / np.linalg.norm(level), np.radians(axes.heading_deg)
    turned = np.cos(heading) * x + np.sin(heading) * np.cross(up, x)
    R = np.array([turned, np.cross(up, turned), up])
    return Pose(R, -R @ origin)


def uprightness(rig: Rig, up: FloatArray) -> float:
    """Mean over the cameras of the part of the image's up direction along `up`: 1 for upright
    cameras, -1 upside down, 0 if they look straight up or down or lie on their side."""
    return -0.5 * float(up[1] + (rig.pose.R @ up)[1])


def check_tilt(what: str, bound: float, advice: str) -> None:
    """Check that axes are determined; `bound` holds their error at 95 %, in radians."""
    if not bound <= LARGEST_TILT:
        raise StereocalError(f"{what} undetermined (within {degrees(bound)}). {advice}")


def vertical_in_words(pose: Pose, bound: float) -> str:
    """How well the vertical is known, and the primary's tilt and roll, to be compared with what is
    known of the place."""
    view, right, image_up = pose.R[:, 2], pose.R[:, 0], -pose.R[:, 1]
    tilt = float(np.degrees(np.arcsin(np.clip(view[2], -1, 1))))
    text = (
        f"the vertical is known within {degrees(bound)} (95 %); the primary looks {abs(tilt):.1f}° "
        f"{'upwards' if tilt > 0 else 'downwards'}"
    )
    if abs(tilt) > 80:
        return text
    roll = float(np.degrees(np.arctan2(-right[2], image_up[2])))
    way = "clockwise" if roll > 0 else "counter-clockwise"
    return f"{text} and is rolled {way} by {abs(roll):.1f}°"


def degrees(radians: float) -> str:
    return f"{rounded(np.degrees(radians))}°"
