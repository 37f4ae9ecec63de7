"""The world frame of whatever was observed."""

import numpy as np

from stereocal.errors import StereocalError
from stereocal.field.world.frame import Observed, Survey, Throw, WorldFrame, WorldSettings
from stereocal.field.world.lines import world_of_lines
from stereocal.field.world.survey import world_of_survey
from stereocal.field.world.throw import world_of_throw
from stereocal.rig.parameters import RigParameters


def find_world(
    rig: RigParameters, observed: Observed, settings: WorldSettings | None = None
) -> WorldFrame:
    """The world frame."""
    stated = settings or WorldSettings()
    try:
        with np.errstate(all="ignore"):
            if isinstance(observed, Survey):
                return world_of_survey(rig, observed, stated)
            if isinstance(observed, Throw):
                return world_of_throw(rig, observed, stated)
            return world_of_lines(rig, observed, stated)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        if isinstance(error, StereocalError):
            raise
        raise StereocalError(
            "No world frame fits these observations; are the numbers in pixels and metres?"
        ) from error
