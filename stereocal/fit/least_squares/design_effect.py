"""How much less the frames of a recording tell than as many independent ones.

At the minimum of a fit the gradient of a cluster of frames, J_c^T r, has the covariance
H_c - H_c A^-1 H_c if frames are independent, A being the sum of all H_c and the priors. So the sum
of g_c^T A^-1 g_c over its expectation is 1, however few clusters there are; where frames follow
each other it is larger, and so it is where the points of one placing of a board share an error.
This design effect is one number for all parameters: of 10 to 30 clusters, the ratio of a single
parameter is less certain than it differs from the others. (Differences of quarters in time of three
real recordings over stated errors, rms: 0.8 to 1.2, without it 1.3 to 1.9. Simulated bars that are
waved: 1.1, without it 1.9 to 3.6.)
"""

from collections.abc import Mapping

import numpy as np

from stereocal.fit.least_squares.robust import RobustFit
from stereocal.fit.least_squares.small_steps import OF_PAIR, OF_PAIR_BEHIND_WINDOWS, lens_places
from stereocal.fit.least_squares.unknowns import RefineSettings, Unknowns, lens_prior, lenses_of
from stereocal.rig.clusters import Clusters, clusters_of
from stereocal.rig.correspondences import Correspondences
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray, IntArray

WORTH = 2.0
"""Boards that the model's covariance counts for."""
FEWEST = 6
"""Boards from which a scatter is taken."""


def clusters_in(rows: Correspondences, rig: Rig, frames: IntArray) -> Clusters:
    """The clusters of some frames, by their distances from the epipolar lines.

    Args:
        rows: without rows of the other frames.
        rig: that was fitted to them.
        frames: (f,): the numbers of the frames, ascending.
    """
    frame_of = np.searchsorted(frames, rows.frame)
    times = np.empty(len(frames), dtype=np.int64)
    errors = np.full((len(frames), len(rows.names)), np.nan)
    times[frame_of] = rows.time_frame
    errors[frame_of, rows.target] = rig.epipolar_errors(rows.primary, rows.secondary)
    order = np.argsort(times)
    in_time = clusters_of(times[order], errors[order])
    return Clusters(in_time.of_frames[np.argsort(order)], in_time.length)


def design_effect(
    solve: RobustFit, used: IntArray, clusters: Clusters, step: FloatArray | None = None
) -> float:
    """How many times the clusters scatter more than independent frames would; at least 1.

    With gradient g_c and normal matrix H_c of each cluster, and A the sum of all H_c and the
    priors, it is the sum of g_c^T A^-1 g_c over the trace of the sum of
    A^-1 H_c - A^-1 H_c A^-1 H_c (docs/refined.md, *Uncertainty*).

    Args:
        solve: at its minimum, or `step` from it.
        used: (f,): indices of the frames of the clusters among those of the solve.
        step: (k,): from there to the minimum, in the free parameters.
    """
    if not (clusters.has_runs or solve.seen.has_parts):
        return 1.0
    order = np.argsort(clusters.of_frames, kind="stable")
    groups = np.split(used[order], np.cumsum(np.bincount(clusters.of_frames))[:-1])
    H, g, _ = solve.equations(groups)
    if not H.any():  # with points behind a camera
        return 1.0
    unknowns = solve.at_end
    M, C = unknowns.M, unknowns.covariance(H.sum(axis=0))
    H = M.T @ H @ M
    g, CH = g @ M, C @ H
    if step is not None:
        g += H @ step
    expected = np.trace(CH.sum(axis=0)) - np.einsum("cij,cji->", CH, CH)
    return max(float(np.einsum("ci,ij,cj->", g, C, g) / expected), 1.0)


def lenses_without(dataset: Pair, settings: RefineSettings) -> dict[str, FloatArray]:
    """The unknowns (33,) of both lenses without each board minus those with all, by frame.

    Empty where a lens has another uncertainty than that of its boards.
    """
    changes: dict[str, FloatArray] = {}
    size = OF_PAIR_BEHIND_WINDOWS if dataset.recording.has_windows else OF_PAIR
    priors = lenses_of(dataset.recording, settings).values()
    stated = zip(dataset.recording.cameras.values(), priors, strict=True)
    for number, (camera, prior) in enumerate(stated):
        known = camera.uncertainty
        if known is None or not known.without or prior != lens_prior(camera, None):
            return {}
        for frame, change in known.without.items():
            changes.setdefault(frame, np.zeros(size))[lens_places(number)] = change
    return changes


def covariance_of_boards(
    unknowns: Unknowns,
    by_model: FloatArray,
    equations: Mapping[str, tuple[FloatArray, FloatArray]],
    without: Mapping[str, FloatArray],
) -> FloatArray:
    """(k, k): covariance of the free parameters of a fit of boards whose photographs have also
    given the lenses.

    The errors of both lenses then go together, and the corners count twice: in the lenses and in
    the pose. What a board's corners did to the lenses, and to the fit, is one sum; the scatter of
    these sums over the boards is the covariance (sandwich over clusters; each board is compared
    with the fit of the others, as in the jackknife: Bell & McCaffrey 2002, Survey Methodology 28,
    169). With few boards it is uncertain, and of a lower rank than the unknowns, so that of the
    model is mixed in. Stated errors of pose and lenses over the spread of drawings of 13 boards:
    0.9 to 1.3; by the model, 1.5 for the yaw and 1.8 for the baseline (docs/comparison.md).

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
    by_scatter = C @ (apart.T @ apart * (n - 1) / n + P * np.outer(others, others)) @ C
    share = WORTH / (WORTH + n - 1)
    return np.asarray((1 - share) * by_scatter + share * by_model)
