"""The world frame of whatever was observed."""

from dataclasses import replace

import numpy as np

from stereocal.errors import StereocalError, refuse
from stereocal.field.world.frame import Observed, Survey, Throw, WorldFrame, WorldSettings
from stereocal.field.world.lines import world_of_lines
from stereocal.field.world.survey import world_of_survey
from stereocal.field.world.throw import world_of_throw
from stereocal.fit.rig_file import Parameters
from stereocal.rig.camera import CAMERAS
from stereocal.rig.recording import CameraPair
from stereocal.rig.rig import Rig
from stereocal.verdict.in_words import percent

AIR = 1.01
"""Indices of refraction up to this one are of air."""


def find_world(
    rig: Parameters,
    observed: Observed,
    settings: WorldSettings | None = None,
    cameras: CameraPair = CAMERAS,
) -> WorldFrame:
    """The world frame; its pose is `world_from_reference`.

    Args:
        observed: points already reconstructed are in the frame of the reference, the first camera.
        cameras: those that observed.
    """
    stated, of_first = settings or WorldSettings(), rig.placed[cameras[0]].pose
    pair = rig.pair(*cameras)
    _check_windows(pair, observed)
    try:
        with np.errstate(all="ignore"):
            if isinstance(observed, Survey):
                seen = replace(observed, measured_m=of_first.apply(observed.measured_m))
                world = world_of_survey(pair, seen, stated)
            elif isinstance(observed, Throw):
                world = world_of_throw(pair, observed, stated)
            else:
                world = world_of_lines(pair, observed, stated)
        texts = (world.sentence, *world.notes)
        sentence, *notes = (_naming(cameras, text) for text in texts)
        if rig.metric_p95 is not None:
            notes.append(
                f"95 % of lengths in this frame are within {percent(rig.metric_p95)} %, with the "
                "error of the bar that the cameras were calibrated with."
            )
        return replace(world, pose=world.pose @ of_first, sentence=sentence, notes=tuple(notes))
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        if isinstance(error, StereocalError):
            raise
        raise StereocalError(
            "No world frame fits these observations; are the numbers in pixels and metres?"
        ) from error


def _check_windows(rig: Rig, observed: Observed) -> None:
    """Refuse what windows and water make of straight lines and free flights."""
    windows = [it.window for it in (rig.primary, rig.secondary) if it.window is not None]
    is_line, is_throw = not isinstance(observed, Survey | Throw), isinstance(observed, Throw)
    refuse(
        (
            is_line and bool(windows),
            "Through a window, a straight line is seen as a curve, so that plumb lines, level "
            "lines and horizons do not show the vertical: survey three points or more instead.",
        ),
        (
            is_throw and any(window.medium > AIR for window in windows),
            "In water a thrown object is slowed and lifted, so that its path does not show the "
            "vertical: survey three points or more instead.",
        ),
    )


def _naming(pair: CameraPair, text: str) -> str:
    """A sentence with the names of the cameras in place of primary and secondary."""
    if pair == CAMERAS:
        return text
    for side, name in zip(CAMERAS, pair, strict=True):
        text = text.replace(f"The {side}", f"Camera {name}")
        text = text.replace(f"the {side}", f"camera {name}")
    return text
