"""How much later one of two cameras was started, by what both microphones heard.

The envelopes of both sounds, as their rises, are compared at every offset. Sound is heard late by
3 ms a metre, and cameras store it some hundredths of a second early or late: images decide.
"""

from pathlib import Path
from typing import Any

import numpy as np

from stereocal.frames.video.decoding import MOST_FRAMES, opened
from stereocal.system.array_types import FloatArray

BIN_S, SAMPLES_S = 0.01, 8000
APART_S, STANDS_OUT = 0.3, 1.7
"""An offset is heard if it fits better by this factor than all that are farther from it: of sounds
that have nothing in common, 1 in 100 do."""
LOUD = 1.5
"""A rise by this logarithm is as good as any."""
LEAST_S = 1.0
"""The shortest sound of both that is compared."""


def read_rises(path: Path) -> FloatArray:
    """(n,): how much louder it becomes in each `BIN_S` from the time stamp 0 on, as a logarithm;
    empty without sound."""
    import av

    with opened(path) as (container, _):
        if not container.streams.audio:
            return np.empty(0)
        mono, parts = av.AudioResampler(format="flt", layout="mono", rate=SAMPLES_S), []
        stream: Any = container.streams.audio[0]
        start: float | None = None
        for frame in container.decode(stream):
            start = float(frame.time or 0.0) if start is None else start
            parts += [part.to_ndarray().ravel() for part in mono.resample(frame)]
            if len(parts) > MOST_FRAMES:
                break
    width = int(BIN_S * SAMPLES_S)
    heard = np.abs(np.diff(np.concatenate(parts or [np.empty(0)]), prepend=0.0))
    bins = heard[: len(heard) // width * width].reshape(-1, width).mean(axis=1)
    before = max(round((start or 0.0) / BIN_S), 0)
    loud = np.log(bins + 0.1 * bins.mean() + 1e-6) if len(bins) else bins
    return np.pad(np.maximum(np.diff(loud, prepend=loud[:1]), 0.0), (before, 0))


def heard_later(primary: FloatArray, secondary: FloatArray) -> float | None:
    """The time stamp of the primary's that is 0 in the secondary, in s; None if it is not clear.

    Args:
        primary, secondary: of `read_rises`.
    """
    n, m, least = len(primary), len(secondary), round(LEAST_S / BIN_S)
    if min(n, m) < least:
        return None
    # Squared, so that noise counts less, but no rise for many; it may fall between two bins.
    squares = (np.minimum(rises, LOUD) ** 2 for rises in (primary, secondary))
    sharp = [np.convolve(squared, (0.5, 1.0, 0.5), "same") for squared in squares]
    first, second = (smoothed - smoothed.mean() for smoothed in sharp)
    lags = np.arange(1 - m, n)
    spectra = (np.fft.rfft(sound, len(lags)) for sound in (first, second[::-1]))
    score = np.fft.irfft(np.multiply(*spectra), len(lags))
    common = np.minimum(n, lags + m) - np.maximum(0, lags)
    score = np.where(common < least, 0.0, score / np.sqrt(common))
    best = int(score.argmax())
    far = np.abs(lags - lags[best]) * BIN_S > APART_S
    if not score[best] > STANDS_OUT * score[far].max(initial=0.0):
        return None
    return float(lags[best]) * BIN_S
