"""How small a movement new images would reveal: the information bound.

The cost difference of the two hypotheses is noncentral chi-square with noncentrality d' I d, where
I is the information of the new images about the change d with the old parameters eliminated, their
covariance included.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.special import chdtri, chndtr, chndtrinc

from stereocal.field.checking.fits import Fit, pose_difference, turned
from stereocal.refined.two_views import BASELINE
from stereocal.rig.compiled import FloatArray

LEVEL = 0.01
"""False alarms."""
ENOUGH = 0.8
AXES = np.array([v for v in product((-1, 0, 1), repeat=3) if v > (0, 0, 0)], dtype=np.float64)
"""13 directions, evenly spread over all axes."""


@dataclass(frozen=True)
class Smallest:
    """The smallest movement that matters."""

    turn_rad: float = float(np.radians(0.05))
    baseline: float = 0.001
    """Fraction of the baseline."""


@dataclass(frozen=True)
class Power:
    """What new images would reveal."""

    turn: float
    """Probability that the smallest turn of interest is found, about the worst axis."""
    turn_anywhere: float
    """The same about an axis at random."""
    baseline: float | None
    """Probability that the smallest change of the baseline is found; None without lengths."""
    detectable_turn_rad: float
    """Turn about the worst axis that is found with a probability of 80 %."""
    detectable_baseline: float | None
    """Fraction of the baseline, likewise."""

    @property
    def is_enough(self) -> bool:
        return self.turn >= ENOUGH and (self.baseline is None or self.baseline >= ENOUGH)


def information_of(fit: Fit) -> FloatArray:
    """(m, m): information of the images of a fit about its change, old parameters eliminated."""
    root, U = fit.prior.root, fit.change.directions
    across = U.T @ fit.H @ root
    known = root.T @ fit.H @ root + np.eye(root.shape[1])
    return np.asarray(U.T @ fit.H @ U - across @ np.linalg.solve(known, across.T))


def power_of(information: FloatArray, change: FloatArray, level: float = LEVEL) -> float:
    """Probability that a change (m,) is found, for a known noise, at a level of false alarms."""
    degrees = len(change)
    noncentrality = float(change @ information @ change)
    return float(1.0 - chndtr(chdtri(degrees, level), degrees, noncentrality))


def power(fit: Fit, smallest: Smallest) -> Power:
    """The power of new images.

    Args:
        fit: of the pose; its change is the five angles and, with lengths, the baseline.
    """
    pose, information, m = fit.prior.rig.pose, information_of(fit), len(fit.change)
    # The noncentrality that is found with a probability of 80 %.
    needed = float(chndtrinc(chdtri(m, LEVEL), m, 1.0 - ENOUGH))

    def factor(change: FloatArray) -> float:
        """By which a small change must be larger, whose square the noncentrality is."""
        return float(np.sqrt(needed / max(float(change @ information @ change), 1e-300)))

    # One camera turned in place, about 13 axes each.
    axes = smallest.turn_rad * AXES / np.linalg.norm(AXES, axis=1, keepdims=True)
    turns = [
        pose_difference(turned(pose, camera, axis), pose)[:m] for camera in (0, 1) for axis in axes
    ]
    powers = [power_of(information, turn) for turn in turns]
    longer = smallest.baseline * pose.baseline * np.eye(m)[-1]
    lengths = m > BASELINE
    return Power(
        min(powers),
        float(np.mean(powers)),
        power_of(information, longer) if lengths else None,
        min(smallest.turn_rad * max(map(factor, turns)), float(np.pi)),
        smallest.baseline * factor(longer) if lengths else None,
    )
