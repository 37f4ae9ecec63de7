"""Find the likely cause when a data set does not fit.

Candidates in order: single frames, a wrong input, a recording whose geometry does not determine the
pose. If none explains the data, the message says that the cause is unknown.
"""

from __future__ import annotations

import numpy as np

from stereocal.calibration.wrong_inputs import (
    essential_fit,
    find_wrong_input,
    inconsistency_message,
    pose_fit,
)
from stereocal.errors import StereocalError
from stereocal.refined.refine import RefinedResult
from stereocal.refined.screening import (
    MAXIMUM_LEFT_OUT,
    MINIMUM_FRAMES,
    Screening,
    screen,
    wide_settings,
)
from stereocal.refined.time_offset import CLAIMED, MAXIMUM_SIGMA, apparent_offset, bring_into_step
from stereocal.refined.weak_geometry import geometry_warning
from stereocal.rig.dataset import Dataset
from stereocal.rig.tracks import MeasuredOffset

MAXIMUM_NAMED = 10
EXPLAINED = 0.05
"""An offset that explains less of the residuals is not offered. Measured on the real recording:
0.02 with a distortion of the wrong sign, 0.5 with an offset of 0.02 frames."""
SMALLEST_CLAIM = 0.01
"""In frames. A smaller offset is not offered: with frames that do not follow each other, other
errors gave offsets of 0.001 frames with far smaller standard errors."""
OUT_OF_STEP = "The cameras seem to be out of step"


def explain_failure(dataset: Dataset, screening: Screening) -> str:
    """The message for data that no pose of the cameras explains: the likely cause and the remedy.

    Args:
        dataset: the frames to calibrate with.
        screening: of all frames.
    """
    if not screening.fit:
        screening = screen(dataset)
    if offer := offer_time_offset(screening):
        return offer
    fit = screening.fit
    if fit is not None:
        bad = fit.frames[fit.outlying & np.isin(fit.frames, dataset.correspondences.frames)]
        if len(bad):
            named = ", ".join(str(frame) for frame in bad[:MAXIMUM_NAMED])
            return f"Some frames contradict the others ({named}): leave them out."
    nominal = essential_fit(dataset)
    if nominal.only_scale_is_wrong:
        return inconsistency_message(dataset, nominal)
    if fit is not None and not np.isfinite(nominal.px):
        nominal = pose_fit(fit.apply(dataset), fit.pose)
    return (
        find_wrong_input(dataset, nominal)
        or (geometry_warning(fit) if fit is not None else "")
        or inconsistency_message(dataset, nominal)
    )


def warnings_about_fit(dataset: Dataset, screening: Screening, poor: bool, offer: str) -> list[str]:
    """Warnings about a calibration that succeeded but may be wrong.

    Args:
        poor: whether the length errors of the 3D set are large.
        offer: the message of `offer_time_offset`; no input is blamed where it explains the fit.
    """
    found = []
    if screening.failure:
        found.append(f"The frames could not be screened: {screening.failure}")
    if offer:
        found.append(offer)
    if screening.together:
        found.append(screening.together)
    if screening.fit is not None and (warning := geometry_warning(screening.fit)):
        found.append(warning)
    elif poor and not offer:
        found.append(find_wrong_input(dataset) or inconsistency_message(dataset))
    return found


def offer_time_offset(screening: Screening) -> str:
    """A message if the cameras seem to be out of step; empty if not, or if the offset was fitted.

    The residuals of the screening's fit follow the velocities then. Where no pose fits at all, as
    with a large offset, one is tried with the offset.
    """
    if screening.time_note:
        return ""
    found = _seen_offset(screening) if screening.fit is None else _following(screening.fit)
    if found is None or not found.is_claimed(CLAIMED) or found.sigma > MAXIMUM_SIGMA:
        return ""
    if abs(found.frames) < SMALLEST_CLAIM:
        return ""
    return (
        f"{OUT_OF_STEP}: the residuals follow the motion in the images, as if "
        f"the secondary took its frames {found.frames:+.2f} ± {found.sigma:.2f} frame intervals "
        "late. Calibrate with the time offset as an unknown (in the settings of the page "
        "Calibrate; on the command line --time-offset)."
    )


def _following(fit: RefinedResult) -> MeasuredOffset | None:
    """The offset that the residuals of a fit show, if it explains enough of them."""
    found = apparent_offset(fit)
    degrees = float(fit.degrees_of_freedom[~fit.outlying].sum())
    if found is None or (found.frames / found.sigma) ** 2 < EXPLAINED * degrees:
        return None
    return found


def _seen_offset(screening: Screening) -> MeasuredOffset | None:
    """The offset with which most frames fit, where without one nothing does."""
    dataset = screening.full_dataset
    if len(dataset.correspondences.frames) < MINIMUM_FRAMES:
        return None
    try:
        fit = bring_into_step(dataset, wide_settings(dataset)).fit
    except StereocalError:
        return None
    return fit.time_offset if fit and fit.outlying.mean() < MAXIMUM_LEFT_OUT else None
