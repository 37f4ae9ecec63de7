"""The world frame of whatever was observed."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from stereocal.errors import StereocalError
from stereocal.field.world.frame import Axes, WorldFrame
from stereocal.field.world.lines import world_of_lines
from stereocal.field.world.observed import Observed, Survey, Throw
from stereocal.field.world.survey import SURVEY_SIGMA_M, world_of_survey
from stereocal.field.world.throw import world_of_throw
from stereocal.rig.parameters import RigParameters


@dataclass(frozen=True)
class WorldSettings:
    """What a person states about the observations, and the axes they choose."""

    axes: Axes = field(default_factory=Axes)
    sigma_px: float | None = None
    """Noise of an image coordinate; None: that of the parameters, or of a throw's residuals."""
    survey_sigma_m: float = SURVEY_SIGMA_M
    """Standard error of a surveyed coordinate."""
    drag: bool = True
    """Whether the air may slow a thrown object."""
    upside_down: bool = False
    """Whether the cameras hang upside down, for lines."""


def find_world(
    rig: RigParameters, observed: Observed, settings: WorldSettings | None = None
) -> WorldFrame:
    """The world frame."""
    try:
        with np.errstate(all="ignore"):
            return _find(rig, observed, settings or WorldSettings())
    except StereocalError:
        raise
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        raise StereocalError(
            "No world frame fits these observations; are the numbers in pixels and metres?"
        ) from error


def _find(rig: RigParameters, observed: Observed, stated: WorldSettings) -> WorldFrame:
    if isinstance(observed, Survey):
        return world_of_survey(rig, observed, stated.axes, stated.sigma_px, stated.survey_sigma_m)
    if isinstance(observed, Throw):
        return world_of_throw(rig, observed, stated.axes, stated.sigma_px, stated.drag)
    return world_of_lines(rig, observed, stated.axes, stated.sigma_px, stated.upside_down)
