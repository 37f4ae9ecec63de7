"""The world frame found: pose, uncertainty, and the choice of origin and axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stereocal.errors import StereocalError
from stereocal.field.world.noise import Noise
from stereocal.field.world.observed import Source
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.system.numbers import rounded

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
    """As in `world.json`: 95 % limits, in degrees and metres."""
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
    """`world_from_primary` with the z axis along a unit vector.

    Args:
        up: (3,) in the primary's frame, as all vectors here.
        origins, directions: what `axes` may name besides the camera's.
        usual: origin and x axis where `axes` names none.
    """
    origins = {**origins, CAMERA: np.zeros(3)}
    own = {VIEW: np.array([0.0, 0.0, 1.0]), BASELINE: rig.pose.inverse().T}
    directions = {**own, **directions}
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
            f"The x axis cannot follow {chosen[1]}, which points straight up or "
            f"down; choose another: {', '.join(directions)}."
        )
    x = level / np.linalg.norm(level)
    y = np.cross(up, x)
    heading = np.radians(axes.heading_deg)
    turned = np.cos(heading) * x + np.sin(heading) * y
    R = np.array([turned, np.cross(up, turned), up])
    return Pose(R, -R @ origin)


def uprightness(rig: Rig, up: FloatArray) -> float:
    """Mean over the cameras of the part of the image's up direction along `up`: 1 for upright
    cameras, -1 upside down, 0 if they look straight up or down or lie on their side.
    """
    return -0.5 * float(up[1] + (rig.pose.R @ up)[1])


def check_tilt(what: str, bound: float, advice: str) -> None:
    """Check that axes are determined: the angle (radians) that holds their error at 95 %."""
    if not bound <= LARGEST_TILT:
        raise StereocalError(f"{what} undetermined (within {degrees(bound)}). {advice}")


def about_noise(noise: Noise) -> dict[str, Any]:
    """Entries of `uncertainty` that say what it rests on."""
    return {
        "level": 0.95,
        "noise_px": {"value": noise.sigma_px, "source": noise.source},
        "errors_of_parameters": noise.of_cameras,
    }


def how_cameras_stand(pose: Pose) -> str:
    """The primary's tilt and roll in words, to be compared with what is known of the place."""
    view, right = pose.R[:, 2], pose.R[:, 0]
    tilt = float(np.degrees(np.arcsin(np.clip(view[2], -1, 1))))
    looks = "upwards" if tilt > 0 else "downwards"
    text = f"the primary looks {abs(tilt):.1f}° {looks}"
    if abs(tilt) > 80:
        return text
    image_up = -pose.R[:, 1]
    roll = float(np.degrees(np.arctan2(-right[2], image_up[2])))
    way = "clockwise" if roll > 0 else "counter-clockwise"
    return f"{text} and is rolled {way} by {abs(roll):.1f}°"


def degrees(radians: float) -> str:
    """An angle for people: 0.03°."""
    return f"{rounded(np.degrees(radians))}°"
