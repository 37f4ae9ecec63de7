"""How well the points of two cameras fit together at each whole offset of their counts of frames.

At a wrong offset the points of different moments are compared: no fundamental matrix fits them. The
sums that determine it are correlations of what one camera saw with what the other did, which a
Fourier transform gives at all offsets at once.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from stereocal.rig.compiled import BoolArray, FloatArray, IntArray
from stereocal.rig.tracks import interpolate

FEWEST = 25
"""Points in common, and moments of them: with fewer, an offset is not judged."""
CELLS, IN_CELL = 32, 4
"""A camera's points are counted on a grid of so many cells a side; those of a cell count as so many
at the most: a bar at rest is one place, and one place alone fits whatever the other camera sees."""
MOST = 0.99
"""Of the points, in order of their weight; those that count most count as one."""
WILD = 99.0
"""How many times less a point counts that jumps, at the most."""
FREEDOM = 8
"""Of a fundamental matrix, whose points fit by as many less."""
PROBABLE = 0.6745
"""The median distance over the root mean square, of normal errors."""
BLOCK = 10_000
"""Offsets at once."""
AROUND, APART = 30, 2
"""Frames about an offset that something else tells; and between likely offsets."""
HILL, LEAST_PX = 0.5, 1e-3
"""Of the median over all offsets: offsets next to the best are part of its valley below it; and the
least distance that counts."""
SYMMETRIC = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
"""Where the entries of a symmetric matrix are in its upper half."""


@dataclass(frozen=True, eq=False)
class Track:
    """What one camera saw, by its own count of frames."""

    first: int
    """The number of the first frame."""
    rays: FloatArray
    """(n, k, 2): of the targets in frames that follow each other; NaN where not seen."""

    @cached_property
    def seen(self) -> BoolArray:
        """(n, k)."""
        return np.asarray(np.isfinite(self.rays[..., 0]))

    @cached_property
    def placed(self) -> tuple[FloatArray, float]:
        """(n, k, 2): where in the rectangle that holds nearly all points, whose longer side is 1
        about 0; and that side, on z = 1."""
        if not self.seen.any():
            return self.rays, 1.0
        low, high = np.percentile(self.rays[self.seen], [1, 99], axis=0)
        width = max(float((high - low).max()), 1e-12)
        return (self.rays - (low + high) / 2) / width, width

    @cached_property
    def number(self) -> FloatArray:
        """(n, k): how much each point counts; 0 where not seen."""
        places = self.placed[0][self.seen]
        cells = ((places + 0.5) * CELLS).clip(0, CELLS - 1).astype(np.int64) @ [1, CELLS]
        counted = np.zeros(self.seen.shape)
        counted[self.seen] = np.minimum(1.0, IN_CELL / np.bincount(cells)[cells])
        most = np.quantile(counted[self.seen], MOST) if len(cells) else 1.0
        return np.asarray(np.minimum(1.0, counted / most))

    @cached_property
    def signals(self) -> FloatArray:
        """(7, n, k): the products of the coordinates and 1, of points that jump with less weight;
        and how much points count."""
        places, _ = self.placed
        before, after = np.roll(places, 1, axis=0), np.roll(places, -1, axis=0)
        jump, step = 2.0 * places - before - after, after - before
        jump, step = (np.square(each).sum(axis=2) for each in (jump, step))
        weights = self.number / (1.0 + np.nan_to_num(jump / (step + 1e-18)).clip(max=WILD))
        x, y = np.nan_to_num(places).clip(-1.0, 1.0).transpose(2, 0, 1)
        products = np.array([x * x, x * y, x, y * y, y, np.ones_like(x)]) * weights
        return np.array([*products, self.number])

    def earlier(self, fraction: float) -> "Track":
        """What it saw at the instants of its frames less a fraction of one."""
        if not fraction:
            return self
        frame, target = np.nonzero(self.seen)
        late, rays = np.full(len(frame), fraction), np.full_like(self.rays, np.nan)
        rays[frame, target] = interpolate(target, frame, self.rays[frame, target], late).positions
        return Track(self.first, rays)


@dataclass(frozen=True, eq=False)
class Scan:
    """How well the points fit together at m offsets, half a frame from each other."""

    offsets: FloatArray
    """(m,): the second camera's frame j is taken for frame j + offset of the first."""
    px: FloatArray
    """(m,): how far the points are from their epipolar lines, in the median of normal errors; NaN
    with less than `FEWEST`."""
    number: FloatArray
    """(m,): of the points."""

    @classmethod
    def of(cls, one: Track, other: Track, focal_px: float, near: float | None) -> "Scan":
        """At all offsets, or at those within `AROUND` of one."""
        whole = np.arange(FEWEST - len(other.rays), len(one.rays) - FEWEST + 1)
        whole = whole + one.first - other.first
        if near is not None:
            whole = whole[np.abs(whole - near) <= AROUND]
        both = [_scanned(one, each, whole) for each in (other, other.earlier(0.5))]
        far, number = (np.column_stack(each).ravel() for each in zip(*both, strict=True))
        return cls((whole[:, None] + [0.0, 0.5]).ravel(), focal_px * far, number)

    @cached_property
    def usual_px(self) -> float:
        """The distance at wrong offsets; NaN if none has enough points."""
        known = self.px[np.isfinite(self.px)]
        return float(np.median(known)) if len(known) else np.nan

    def evidence(self, number: FloatArray | int, px: FloatArray | float) -> FloatArray:
        """The logarithm of how unlikely chance brings a number of points so near to their lines."""
        return np.asarray((number - FREEDOM) * np.log(self.usual_px / np.maximum(px, LEAST_PX)))

    def likely(self, most: int) -> list[float]:
        """The offsets with the most evidence, each some frames from the others."""
        evidence, found = self.evidence(self.number, self.px), list[int]()
        for k in np.argsort(-evidence, kind="stable")[: np.isfinite(self.px).sum()].tolist():
            if len(found) < most and all(abs(k - each) > 2 * APART for each in found):
                found.append(k)
        # About a lowest one the squares of the distances are on a parabola.
        square = np.pad(np.square(self.px), 1, constant_values=np.nan)
        before, at, after = (square[np.array(found, dtype=np.int64) + k] for k in range(3))
        bend, slope = before - 2.0 * at + after, before - after
        step = np.where(bend > np.abs(slope) / 2.0, slope / (4.0 * bend), 0.0)
        return [float(self.offsets[k] + own) for k, own in zip(found, step, strict=True)]

    def valley(self, best: float) -> tuple[float, float]:
        """The offsets about the best one at which the distances are far below those at others."""
        high = self.offsets[~(self.px < HILL * self.usual_px)]
        low_end = high[high < best].max(initial=-np.inf)
        high_end = high[high > best].min(initial=np.inf)
        return min(low_end, best - APART), max(high_end, best + APART)


def _scanned(one: Track, other: Track, offsets: IntArray) -> tuple[FloatArray, FloatArray]:
    """The distances on z = 1 at whole offsets, and the numbers of points, (m,) each."""
    far = np.full(len(offsets), np.nan)
    if not (one.seen.any() and other.seen.any()):
        return far, np.zeros(len(offsets))
    size = next_fast_len(len(one.rays) + len(other.rays), real=True)
    a, b = (rfft(each.signals, size, axis=1) for each in (one, other))
    at = (offsets + other.first - one.first) % size

    def correlated(i: int, j: int) -> FloatArray:
        return np.asarray(irfft((a[i] * b[j].conj()).sum(axis=1), size)[at])

    sums = np.array([[correlated(i, j) for j in range(6)] for i in range(6)])
    number = correlated(6, 6)
    enough = np.flatnonzero(number >= FEWEST)
    for part in np.array_split(enough, len(enough) // BLOCK + 1):
        mean = _mean_square(sums[..., part], one.placed[1], other.placed[1])
        far[part] = PROBABLE * np.sqrt(mean / (1.0 - FREEDOM / number[part]))
    return far, number


@dataclass(frozen=True, eq=False)
class Common:
    """The frames that both have at an offset."""

    frames: IntArray
    """(n,): their numbers in the one."""
    rays: FloatArray
    """(n, k, 4): of both."""
    number: FloatArray
    """(n, k): how much each point counts."""

    @classmethod
    def of(cls, one: Track, other: Track, offset: float) -> "Common":
        """At a whole offset or between two."""
        whole = int(np.floor(offset))
        other, late = other.earlier(offset - whole), whole + other.first - one.first
        a = slice(max(0, late), max(0, len(other.rays) + late))
        b = slice(max(0, -late), max(0, len(one.rays) - late))
        rays = np.concatenate([one.rays[a], other.rays[b]], axis=2)
        frames = one.first + a.start + np.arange(len(rays))
        return cls(frames, rays, one.number[a] * other.number[b])

    def drawn(self, most: int) -> tuple[IntArray, FloatArray]:
        """Of the points, as many as they count, drawn by that: their frames of the one (m,) and
        their rays (4, m)."""
        size = min(int(self.number.sum()), most)
        if not size:
            return np.empty(0, dtype=np.int64), np.empty((4, 0))
        chance = self.number.ravel() / self.number.sum()
        drawn = np.random.default_rng(0).choice(chance.size, size, replace=False, p=chance)
        rays = self.rays.reshape(-1, 4)[drawn]
        return self.frames[drawn // self.rays.shape[1]], np.ascontiguousarray(rays.T)


def _mean_square(sums: FloatArray, one: float, other: float) -> FloatArray:
    """The least mean square distance that a fundamental matrix leaves: Taubin's, the sum of squared
    residuals over that of their squared derivatives.

    Args:
        sums: (6, 6, m): of the products of both cameras.
        one, other: the units of length.
    """
    products = sums[SYMMETRIC[:, None, :, None], SYMMETRIC[None, :, None, :]]
    slopes = np.zeros_like(products)
    for i in range(2):  # the derivatives by the coordinates of either
        slopes[i, :, i] += sums[5][SYMMETRIC] / one**2
        slopes[:, i, :, i] += sums[:, 5][SYMMETRIC] / other**2
    A, B = (np.moveaxis(each.reshape(9, 9, -1), 2, 0) for each in (products, slopes))
    # The last entry has no derivative, and is what leaves the least.
    A = A[:, :8, :8] - A[:, :8, 8:] * A[:, 8:, :8] / A[:, 8:, 8:]
    B = B[:, :8, :8] + 1e-8 * np.trace(B, axis1=1, axis2=2)[:, None, None] * np.eye(8)
    unit = np.linalg.inv(np.linalg.cholesky(B))
    return np.asarray(np.linalg.eigvalsh(unit @ A @ unit.transpose(0, 2, 1))[:, 0].clip(1e-20))
