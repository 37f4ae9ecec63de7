"""Clusters: frames whose errors are alike, because they follow each other.

A bar waved in front of running cameras stays in one part of the images for a while, where the error
of the lens is the same, and blurs alike from frame to frame. Such frames tell less than their
number. How long errors stay alike shows in the autocorrelation of the residuals; frames are then
counted in runs of twice that length. Frames taken one by one are clusters of one.
"""

from dataclasses import dataclass

import numpy as np

from stereocal.system.array_types import FloatArray, IntArray

FEWEST = 8
"""Runs into which a recording is divided at least."""
RUNS = 6
"""Into which frames that follow each other are divided for the design effect: shorter runs repeat
each other. Halves in time of 16 simulated rigs differ by 1.01 (poses) and 1.12 (lenses) of their
stated errors, with 8 runs by 1.04 and 1.15, with 16 by 1.18 and 1.32."""
LONGEST = 200
"""Lag of the autocorrelation, in frames; the most in any case."""
NOTICED = 2.33
"""Standard errors of the first two autocorrelations above which errors are alike: of recordings
without runs 1 in 100."""
FEWEST_PLACES, NEAR = 16, 0.5
"""Places, and their median step over their median distance from the middle, of an object that is
waved; at random places it is about 1.4."""
PAIRS = 10
"""Pairs of frames that an autocorrelation needs."""


@dataclass(frozen=True, eq=False)
class Clusters:
    """A division of the frames of a recording."""

    of_frames: IntArray
    """(f,): number of the cluster of each frame, from 0, ascending with time."""
    length: int
    """Number of frames over which errors are alike; 1 for frames taken one by one."""

    @property
    def count(self) -> int:
        """Number of clusters."""
        return int(self.of_frames.max(initial=-1)) + 1

    @property
    def has_runs(self) -> bool:
        """Whether frames follow each other."""
        return self.count < len(self.of_frames)

    @property
    def text(self) -> str:
        """Such as "387 frames, about 30 independent ones"; empty without runs."""
        if not self.has_runs:
            return ""
        return f"{len(self.of_frames)} frames, about {self.count} independent ones"


def clusters_of(times: IntArray, residuals: FloatArray) -> Clusters:
    """The clusters of a recording.

    A run ends where more frames are missing than errors stay alike for.

    Args:
        times: (f,): the frames' numbers as recorded, ascending.
        residuals: (f, c): standardised residuals of each frame, NaN where there is none.
    """
    n = len(times)
    places = _places(times)
    length = run_length(places, residuals)
    window = min(2 * length, n // FEWEST)
    if length == 1 or window < 2:
        return Clusters(np.arange(n), 1)
    numbers = np.zeros(n, dtype=np.int64)
    start = places[0]
    for i in range(1, n):
        new = places[i] - start >= window or places[i] - places[i - 1] > length
        numbers[i] = numbers[i - 1] + new
        start = places[i] if new else start
    return Clusters(numbers, length)


def in_runs(clusters: Clusters) -> Clusters:
    """The clusters, in `FEWEST` runs where there are none; for frames that follow each other though
    too few show that their errors are alike."""
    n = len(clusters.of_frames)
    return clusters if clusters.has_runs or n < FEWEST else evenly_divided(n, FEWEST)


def evenly_divided(frames: int, runs: int) -> Clusters:
    """Some frames in runs that are equally long."""
    return Clusters(np.arange(frames) * runs // frames, frames // runs)


def in_equal_runs(clusters: Clusters, places: FloatArray) -> Clusters:
    """The clusters, in `RUNS` where frames follow each other, by their errors or as of a waved
    object (`places`, as of `follow_each_other`): whose scatter says how much frames tell."""
    n = len(clusters.of_frames)
    follow = n >= RUNS and (clusters.has_runs or follow_each_other(places))
    return evenly_divided(n, RUNS) if follow else clusters


def follow_each_other(places: FloatArray, fewest: int = FEWEST_PLACES) -> bool:
    """Whether each place (n, 2) in an image is near the one before it, as of a waved object;
    places that are not seen are NaN, and fewer than some tell nothing."""
    seen = places[np.isfinite(places[:, 0])]
    if len(seen) < fewest:
        return False
    steps = np.linalg.norm(np.diff(seen, axis=0), axis=1)
    apart = np.linalg.norm(seen - np.median(seen, axis=0), axis=1)
    return bool(np.median(steps) < NEAR * np.median(apart))


def _places(times: IntArray) -> IntArray:
    """(f,): the times in steps of a recording, with gaps of at most `LONGEST` + 1."""
    steps = np.diff(times)
    usual = max(float(np.median(steps)), 1.0) if len(steps) else 1.0
    steps = np.clip(np.rint(steps / usual), 1, LONGEST + 1).astype(np.int64)
    return np.concatenate([[0], np.cumsum(steps)])


def run_length(places: IntArray, residuals: FloatArray) -> int:
    """Over how many frames errors are alike; 1 if they are not.

    Errors that change every L frames have an autocorrelation that falls evenly to 0 at a lag of L:
    a max(1 - k / L, 0) at lag k. This line is fitted, with its height a, by least squares weighted
    by the pairs of frames: the L of the largest gain, from 2 on (docs/refined.md, Uncertainty).

    Args:
        places: (f,): as of `_places`; `residuals`: (f, c).
    """
    lags = min(max(len(places) // 4, 3), LONGEST)
    correlations, pairs = _autocorrelation(places, residuals, lags)
    if correlations[:2].sum() * np.sqrt(0.5 * pairs[:2].mean()) < NOTICED:
        return 1
    negative = np.flatnonzero(correlations <= 0)
    lags = min(max(2 * int(negative[0]) if len(negative) else lags, 4), lags)
    k = np.arange(1, lags + 1)
    lines = np.maximum(1.0 - k / np.arange(2, 2 * lags + 2)[:, None], 0.0)
    weights = pairs[:lags]
    gain = np.maximum(lines @ (weights * correlations[:lags]), 0.0) ** 2 / (
        np.square(lines) @ weights
    )
    return 2 + int(np.argmax(gain))


def _autocorrelation(
    places: IntArray, residuals: FloatArray, lags: int
) -> tuple[FloatArray, FloatArray]:
    """(lags,) each: the autocorrelation at lags from 1, 0 for few pairs; and pairs of frames."""
    shape = int(places[-1]) + 1, residuals.shape[1]
    series, known = np.zeros(shape), np.zeros(shape)
    seen = np.isfinite(residuals)
    known[places] = seen
    series[places] = np.where(seen, residuals, 0.0)
    variance = np.square(series).sum(axis=0) / np.maximum(known.sum(axis=0), 1.0)
    series /= np.sqrt(np.maximum(variance, 1e-300))
    size = 1 << (2 * shape[0]).bit_length()

    def products(values: FloatArray) -> FloatArray:
        spectrum = np.abs(np.fft.rfft(values, size, axis=0)) ** 2
        return np.asarray(np.fft.irfft(spectrum, size, axis=0)[1 : lags + 1].sum(axis=1))

    pairs = np.maximum(np.rint(products(known)), 0.0)
    pairs[pairs < PAIRS * shape[1]] = 0.0
    return products(series) * (pairs > 0) / np.maximum(pairs, 1.0), pairs / shape[1]
