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
from stereocal.refined.refine import RefinedResult
from stereocal.refined.screening import Screening
from stereocal.refined.weak_geometry import geometry_warning
from stereocal.rig.dataset import Dataset

MAXIMUM_NAMED = 10


def explain_failure(dataset: Dataset, fit: RefinedResult | None) -> str:
    """The message for data that no pose of the cameras explains: the likely cause and the remedy.

    Args:
        fit: the robust fit of all frames; None if there is none.
    """
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


def warnings_about_fit(dataset: Dataset, screening: Screening, poor: bool) -> list[str]:
    """Warnings about a calibration that succeeded but may be wrong.

    Args:
        poor: whether the length errors of the 3D set are large.
    """
    found = []
    if screening.failure:
        found.append(f"The frames could not be screened: {screening.failure}")
    if screening.together:
        found.append(screening.together)
    if screening.fit is not None and (warning := geometry_warning(screening.fit)):
        found.append(warning)
    elif poor:
        found.append(find_wrong_input(dataset) or inconsistency_message(dataset))
    return found
