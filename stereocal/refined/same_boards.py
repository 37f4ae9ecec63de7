"""Covariance of a fit of boards whose photographs have also given the lenses.

The errors of both lenses then go together, and the corners count twice: in the lenses and in the
pose. What a board's corners did to the lenses, and to the fit, is one sum; the scatter of these
sums over the boards is the covariance (sandwich over clusters; each board is compared with the fit
of the others, as in the jackknife: Bell & McCaffrey 2002, Survey Methodology 28, 169). With few
boards it is uncertain, and of a lower rank than the unknowns, so that of the model is mixed in.
Stated errors of pose and lenses over the spread of drawings of 13 boards: 0.9 to 1.3; by the model,
1.5 for the yaw and 1.8 for the baseline (docs/comparison.md).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stereocal.refined.two_views import SHARED
from stereocal.refined.unknowns import RefineSettings, Unknowns, lens_places, lens_prior
from stereocal.rig.compiled import FloatArray
from stereocal.rig.dataset import Dataset

WORTH = 2.0
"""Boards that the model's covariance counts for."""
FEWEST = 6
"""Boards from which a scatter is taken."""


def lenses_without(dataset: Dataset, settings: RefineSettings) -> dict[str, FloatArray]:
    """The shared unknowns (25,) of both lenses without each board minus those with all, by frame.

    Empty where a lens has another uncertainty than that of its boards.
    """
    found: dict[str, FloatArray] = {}
    stated = (dataset.primary, settings.primary), (dataset.secondary, settings.secondary)
    for number, (camera, prior) in enumerate(stated):
        known = camera.uncertainty
        if known is None or not known.without or prior != lens_prior(camera, None):
            return {}
        for frame, change in known.without.items():
            found.setdefault(frame, np.zeros(SHARED))[lens_places(number)] = change
    return found


def covariance_of_boards(
    unknowns: Unknowns,
    by_model: FloatArray,
    equations: Mapping[str, tuple[FloatArray, FloatArray]],
    without: Mapping[str, FloatArray],
) -> FloatArray:
    """(k, k): covariance of the free parameters.

    Args:
        by_model: (k, k): the same if the lenses were calibrated with other boards.
        equations: of each frame used, H (Q, Q) and g (Q,) at the minimum, without priors.
        without: (Q,) of each board: by how much the lenses change without it.
    """
    M, P = unknowns.M, unknowns.precision
    C = unknowns.covariance(np.sum([H for H, _ in equations.values()], axis=0))
    to_free = np.linalg.pinv(M)
    scores = {frame: P @ to_free @ change for frame, change in without.items()}
    for frame, (H, g) in equations.items():
        alone = np.linalg.solve(np.eye(len(C)) - M.T @ H @ M @ C, M.T @ g)
        scores[frame] = alone + scores.get(frame, np.zeros(len(C)))
    n = len(scores)
    apart = np.array([*scores.values()])
    apart -= apart.mean(axis=0)
    others = np.where(np.abs(to_free @ np.array([*without.values()]).T).max(axis=1) > 0, 0.0, 1.0)
    found = C @ (apart.T @ apart * (n - 1) / n + P * np.outer(others, others)) @ C
    share = WORTH / (WORTH + n - 1)
    return np.asarray((1 - share) * found + share * by_model)
