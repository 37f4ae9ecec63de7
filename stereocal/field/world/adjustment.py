"""Weighted least squares, and what its errors are.

The fit holds the parameters: points are reconstructed with them as they are, and the world frame
has to suit those points. What the errors of the parameters do is added to the covariance.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from scipy.optimize import brentq, least_squares
from scipy.special import chdtri, fdtrc, fdtri, ndtri, stdtrit

from stereocal.errors import StereocalError
from stereocal.evaluation.summary import Estimate
from stereocal.system.array_types import FloatArray, IntArray

LEVEL = 0.95
STEP = float(np.sqrt(np.finfo(np.float64).eps))
"""Step of finite differences, for an unknown of 1 or less."""
FEWEST_DEGREES = 10
"""Below this number of degrees of freedom, residuals do not show the noise."""

SMALLEST_PART = 1e-5
"""Relative singular value below which columns count as dependent: finite differences are exact to
1e-8."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Estimates, and what their errors are."""

    x: FloatArray
    """(m,)."""
    J: FloatArray
    """(n, m): derivatives of the errors by x."""
    errors: FloatArray
    """(n,) over their standard deviations."""
    by_rig: FloatArray
    """(n, r): derivatives of the errors by the common errors z of the parameters."""
    noise_is_known: bool = False
    """Whether the noise was estimated from these residuals, which then cannot widen the errors."""

    @property
    def degrees(self) -> int:
        return len(self.errors) - len(self.x)

    @cached_property
    def chi_square(self) -> float:
        """The chi-square of the residuals, without what likely errors of the parameters explain."""
        r = self.by_rig.shape[1]
        design = np.block([[self.J, self.by_rig], [np.zeros((r, len(self.x))), np.eye(r)]])
        whole = np.concatenate([self.errors, np.zeros(r)])
        return _squares_left(design, whole)[0]

    @property
    def widening(self) -> float:
        """Factor of the standard errors: above 1 where residuals exceed the stated noise."""
        if self.noise_is_known or not self.degrees:
            return 1.0
        return float(np.sqrt(max(1.0, self.chi_square / self.degrees)))

    @cached_property
    def covariance(self) -> FloatArray:
        """(m, m), of the noise of the observations."""
        return np.asarray(self._stated * self.widening**2)

    @cached_property
    def _stated(self) -> FloatArray:
        return np.asarray(np.linalg.pinv(self.J.T @ self.J), dtype=np.float64)

    @cached_property
    def shift(self) -> FloatArray:
        """(m, r): derivatives of the estimates by z."""
        return np.asarray(-self._stated @ (self.J.T @ self.by_rig))

    @property
    def noise_factor(self) -> float | None:
        """The noise that the residuals show, without what errors of the parameters can explain,
        over the stated one; None if they are too few."""
        left, degrees = _squares_left(np.column_stack([self.J, self.by_rig]), self.errors)
        return float(np.sqrt(left / degrees)) if degrees >= FEWEST_DEGREES else None

    def scaled(self, factor: float) -> "Solution":
        """The solution where the noise is this factor larger, as the residuals show."""
        J, errors, by_rig = self.J / factor, self.errors / factor, self.by_rig / factor
        return Solution(self.x, J, errors, by_rig, noise_is_known=True)

    @property
    def _has_t(self) -> bool:
        return self.widening > 1 or self.noise_is_known

    @property
    def quantile(self) -> float:
        """Half of a 95 % interval over the standard error."""
        upper = 0.5 + 0.5 * LEVEL
        return float(stdtrit(self.degrees, upper) if self._has_t else ndtri(upper))

    def interval(self, value: float, variance: float) -> Estimate:
        """The 95 % interval of an estimate."""
        half = self.quantile * float(np.sqrt(variance))
        return Estimate(value, value - half, value + half)

    def bound(self, covariance: FloatArray) -> float:
        """Length that holds 95 % of errors with a covariance (k, k); for k = 3, at least 95 %."""
        values = np.linalg.eigvalsh(covariance)
        if len(values) == 1:
            return self.quantile * float(np.sqrt(values[0]))
        top = float(np.sqrt(values[-1]))
        if len(values) > 2 or not top > 0 or not np.isfinite(top):
            square = chdtri(len(values), 1.0 - LEVEL)
            if self._has_t:
                square = len(values) * fdtri(len(values), self.degrees, LEVEL)
            return float(np.sqrt(square)) * top
        # The error has a direction that is uniform before it is stretched by both roots.
        angle = (np.arange(32) + 0.5) * np.pi / 64
        stretched = (values[0] * np.cos(angle) ** 2 + values[1] * np.sin(angle) ** 2) / top**2

        def outside(length: float) -> float:
            squares = 0.5 * length**2 / stretched
            beyond = fdtrc(2, self.degrees, squares) if self._has_t else np.exp(-squares)
            return float(np.mean(beyond)) - (1 - LEVEL)

        return top * float(brentq(outside, 1.0, 1e3))


@dataclass(frozen=True, eq=False)
class Blocks:
    """Which unknowns act on which errors: some on all, the others in blocks on their own errors.

    Derivatives then need a few evaluations, not one for each unknown.
    """

    common: int
    """Number of the first unknowns, which act on all errors."""
    size: int
    """Unknowns of each block; the blocks follow one another."""
    of_error: IntArray
    """(n,): the block that acts on each error; -1: none."""

    def jacobian(self, errors: Callable[[FloatArray], FloatArray], x: FloatArray) -> FloatArray:
        """(n, m): derivatives by finite differences."""
        here = errors(x)
        steps = STEP * np.maximum(1.0, np.abs(x))
        J = np.zeros((len(here), len(x)))
        everywhere, inside = np.arange(len(here)), np.flatnonzero(self.of_error >= 0)
        first = self.common + self.size * self.of_error[inside]
        for k in range(self.common + self.size):
            block = k - self.common
            moved_ones = slice(k, None, self.size) if block >= 0 else slice(k, k + 1)
            rows, columns = (inside, first + block) if block >= 0 else (everywhere, k)
            moved = x.copy()
            moved[moved_ones] += steps[moved_ones]
            J[rows, columns] = (errors(moved) - here)[rows] / steps[columns]
        return J


def solve(
    errors: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    by_rig: Callable[[FloatArray], FloatArray] | None = None,
    blocks: Blocks | None = None,
) -> Solution:
    """Minimise the sum of the squares of errors (n,), differences over their standard deviations.

    Args:
        by_rig: (n, r) at the solution: derivatives of the errors by z; None: not known.
        blocks: which unknowns act on which errors; None: all on all.
    """
    sparsity = blocks or Blocks(len(start), 0, np.full(len(errors(start)), -1))
    minimum = least_squares(errors, start, partial(sparsity.jacobian, errors), x_scale="jac")
    J, e = (np.asarray(values, dtype=np.float64) for values in (minimum.jac, minimum.fun))
    return Solution(minimum.x, J, e, np.zeros((len(e), 0)) if by_rig is None else by_rig(minimum.x))


def _squares_left(design: FloatArray, errors: FloatArray) -> tuple[float, int]:
    """Sum of squares that no combination of the columns explains, and its degrees of freedom."""
    scale = np.linalg.norm(design, axis=0)
    design = design / np.where(scale > 0, scale, 1.0)
    fitted, _, rank, _ = np.linalg.lstsq(design, errors, rcond=SMALLEST_PART)
    return float(np.sum((errors - design @ fitted) ** 2)), len(errors) - int(rank)


def culprit(names: Sequence[str], agree_without: Callable[[str], bool], most: int) -> str:
    """Which observation contradicts the others, if it is just one; of at most `most` names."""
    culprits = []
    for name in names if len(names) <= most else []:
        with suppress(StereocalError):
            culprits += [name] * agree_without(name)
    return (
        f"without {culprits[0]} the others agree"
        if len(culprits) == 1
        else "cannot tell which is wrong"
    )
