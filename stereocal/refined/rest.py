"""The other images of a rig as the prior of a pair of it, whose fit is then the rig's.

Fitted by itself with the lenses of the rig as stated ones, a pair would count its own images twice:
they are in those lenses already. So the information of its images is taken from that of the rig,
and the rest is the prior. With it the pair's fit ends where the rig's did, with the rig's
covariance; without some of its frames, their images in this pair are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from stereocal.rig.compiled import FloatArray

if TYPE_CHECKING:
    from stereocal.refined.unknowns import Unknowns

OWN = 1.0 - 1e-6
"""Share of the information in a direction from which on all of it is the pair's own."""
Row = tuple[float, ...]


@dataclass(frozen=True)
class Rest:
    """A normal prior of the shared unknowns of a pair (`two_views`), and where its fit begins."""

    values: Row
    """(25,): those of the rig."""
    mean: Row
    """(25,)."""
    precision: tuple[Row, ...]
    """(25, 25): in the directions of the free parameters; 0 of all others."""
    design_effect: float
    """Of the rig."""

    def __post_init__(self) -> None:
        numbers = np.array([self.values, self.mean, *self.precision], dtype=np.float64)
        if numbers.shape != (27, 25) or not np.isfinite(numbers).all():
            raise ValueError("what the rig says of its pair has other numbers")

    @classmethod
    def of(
        cls,
        values: FloatArray,
        covariance: FloatArray,
        unknowns: Unknowns,
        equations: tuple[FloatArray, FloatArray],
        design_effect: float,
    ) -> Rest:
        """The prior of a pair.

        Args:
            values: (25,): the rig's, and covariance: (25, 25).
            unknowns: of the pair.
            equations: H (25, 25) and J^T r (25,) of all its images and lengths at `values`.
        """
        M, (H, g) = unknowns.M, equations
        to_free = np.linalg.pinv(M)
        L = np.linalg.cholesky(to_free @ covariance @ to_free.T)
        # In these directions the rig has the information 1; the pair's images a share of it.
        shares, V = np.linalg.eigh(L.T @ (M.T @ H @ M / design_effect) @ L)
        left = np.where(shares < OWN, 1.0 - shares, 0.0)
        W = np.linalg.solve(L.T, V)
        away = np.divide(V.T @ L.T @ (M.T @ g), left, out=np.zeros(len(left)), where=left > 0.0)
        precision = to_free.T @ (W * left) @ W.T @ to_free
        return cls(
            tuple(values.tolist()),
            tuple((values + M @ (L @ (V @ away))).tolist()),
            tuple(map(tuple, precision.tolist())),
            design_effect,
        )

    def prior(self, unknowns: Unknowns) -> Unknowns:
        """The unknowns with this prior; a parameter that is fixed in the rig keeps its own."""
        M = unknowns.M
        found = M.T @ np.array(self.precision) @ M
        other = np.diag(found) == 0.0
        found += np.where(np.outer(other, other), unknowns.precision, 0.0)
        with np.errstate(divide="ignore"):
            sigma = 1.0 / np.sqrt(np.diag(found))
        return replace(unknowns, origin=np.array(self.mean), sigma=sigma, precision=found)

    def start(self, unknowns: Unknowns) -> FloatArray:
        """(k,): the free parameters of the rig's values."""
        return np.asarray(np.linalg.pinv(unknowns.M) @ (np.array(self.values) - unknowns.origin))
