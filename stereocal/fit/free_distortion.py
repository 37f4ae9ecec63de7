"""Whether the radial distortion of a rig's lenses is fitted too, where no file states its error.

Files of lenses that state no uncertainty have one nevertheless. That of focal length and centre is
assumed; k1 and k2 are unknowns only where the images contradict the stated ones and the rig then
measures frames better that it was not fitted to. (Halves and quarters in time of a real recording
of three cameras: the other part 2 to 8 % better in all of six; simulated rigs with errors that no
coefficient contains gain nothing.)
"""

from dataclasses import replace

import numpy as np
from scipy.special import chdtrc

from stereocal.fit.least_squares.small_steps import lens_places
from stereocal.fit.least_squares.unknowns import FIXED, LensPrior, lenses_of
from stereocal.fit.rig_calibration import RigCalibration

OF_LENS = 4
"""Of k1 among a lens's unknowns."""
DEFAULT_DISTORTION = (0.01, 0.02, 0.0, 0.0)
"""Standard deviations of k1, k2, p1, p2 where none are stated."""
CONTRADICTED = 0.001
"""Probability of the gradient by them, were all errors noise."""
BETTER = 0.99
"""Errors on frames not fitted, over those with the stated coefficients, at most."""


def lenses_with_distortion(rig: RigCalibration) -> dict[str, LensPrior]:
    """Priors of the lenses with k1 and k2 uncertain, by camera, where nothing is stated of them;
    empty where the images agree with the stated ones."""
    fit, freed, places = rig.fit, dict[str, LensPrior](), list[int]()
    priors, cameras = lenses_of(rig.recording, fit.settings), rig.recording.cameras.values()
    for number, (camera, (label, prior)) in enumerate(zip(cameras, priors.items(), strict=True)):
        if camera.uncertainty is None and not any(prior.distortion) and prior.focal > FIXED:
            freed[label] = replace(prior, distortion=DEFAULT_DISTORTION)
            places += lens_places(number)[OF_LENS : OF_LENS + 2]
    if not (freed and fit.is_determined):
        return {}
    # The score test: what a step in these unknowns would gain, with all others following.
    (H,), (g,), _ = fit.equations([fit.used])
    along = H[places] @ fit.unknowns.M
    left = H[np.ix_(places, places)] - along @ fit.at_end.covariance(fit.H) @ along.T
    gain = float(g[places] @ np.linalg.pinv(left, hermitian=True) @ g[places])
    return freed if chdtrc(len(places), gain) < CONTRADICTED else {}


def better_held_out(rig: RigCalibration, other: RigCalibration) -> RigCalibration:
    """The other rig if it measures frames better that it was not fitted to, else the first."""
    now, then = rig.further, other.further
    if now is None or then is None:
        return rig
    better = then.errors.reprojection_px < BETTER * now.errors.reprojection_px
    return other if better else rig
