"""What is to blame for data that do not fit, in the order in which it can be told.

Frames first, then what was given wrongly, then a recording that cannot fix the cameras; and where
none of them explains the data, that nobody can tell.
"""

from __future__ import annotations

import numpy as np

from stereocal.calibration.readings import contradiction, fit_at, fit_of, wrongly_given
from stereocal.refined.refine import RefinedResult
from stereocal.refined.screening import Screening
from stereocal.refined.weakness import weakness
from stereocal.rig.dataset import Dataset

MOST_NAMED = 10


def why_nothing_fits(dataset: Dataset, fit: RefinedResult | None) -> str:
    """What is wrong with data that no pose of the cameras explains, as far as they tell.

    Args:
        fit: the robust fit of all frames, where there is one.
    """
    if fit is not None:
        bad = fit.frames[fit.outlying & np.isin(fit.frames, dataset.correspondences.frames)]
        if len(bad):
            named = ", ".join(str(frame) for frame in bad[:MOST_NAMED])
            return f"Frames that contradict the others are among them ({named}): leave them out."
    given = fit_of(dataset)
    if given.scale_alone_is_off:
        return contradiction(dataset, given)
    if fit is not None and not np.isfinite(given.px):
        given = fit_at(fit.apply(dataset), fit.pose)
    return (
        wrongly_given(dataset, given)
        or (weakness(fit) if fit is not None else "")
        or contradiction(dataset, given)
    )


def doubts_about(dataset: Dataset, screening: Screening, poor: bool) -> list[str]:
    """What speaks against a result though there is one, a sentence each.

    Args:
        poor: whether the 3D set measures badly.
    """
    found = []
    if screening.failure:
        found.append(f"No frame could be held against the others: {screening.failure}")
    if screening.together:
        found.append(screening.together)
    if screening.fit is not None and (why := weakness(screening.fit)):
        found.append(why)
    elif poor:
        found.append(wrongly_given(dataset) or contradiction(dataset))
    return found
