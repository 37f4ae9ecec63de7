"""Positions of tracked image points between the recorded frames.

A point that moves has, at the time of frame k of the other camera, a position between those of its
own frames. It is interpolated from the true neighbours of the same track: by a cubic where there
are four, by a parabola where there are three, else on the straight line between two. (On a real
recording at 10 frames a second, off by 0.3 frames, the straight line instead of the parabola makes
the noise of all points 0.41 px instead of 0.30.)
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from stereocal.errors import DAMAGED, StereocalError
from stereocal.system.array_types import BoolArray, FloatArray, IntArray
from stereocal.system.numbers import with_error

WINDOW = np.array([-1.0, 0.0, 1.0, 2.0])
"""Frames about an instant between frame 0 and frame 1."""
THIRD_DIFFERENCE = np.array([-1.0, 3.0, -3.0, 1.0])
NEARER = 2.0
"""How much nearer exchanged ends are to those of the frame before."""
NO_SHIFT = 1e-9
"""Instants this close to a frame, in frames, are that frame."""


WHOLE, COUNTED = 0.02, 3.2
"""Offsets this near to a whole number of frames, and so many standard errors more, are errors of
counting."""


@dataclass(frozen=True)
class TimeOffset:
    """How much later than the primary the secondary camera takes its frames.

    Frame k of the secondary is taken `frames` + `drift` * (k - `reference`) frame intervals after
    frame k of the primary.
    """

    frames: float = 0.0
    drift: float = 0.0
    """In frames per frame."""
    reference: float = 0.0
    """The frame at which the offset is `frames`."""

    @property
    def is_shift(self) -> bool:
        """Whether it moves anything."""
        return bool(self.frames or self.drift)

    def at(self, time_frame: npt.ArrayLike) -> FloatArray:
        """(n,): the offset at these frames."""
        times = np.asarray(time_frame, dtype=np.float64)
        return np.asarray(self.frames + self.drift * (times - self.reference))


@dataclass(frozen=True)
class MeasuredOffset(TimeOffset):
    """A time offset with the standard errors of a fit; that of the drift is 0 if it was not
    fitted."""

    sigma: float = 0.0
    drift_sigma: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """The entries of a parameter file: `time_offset_frames`, and `time_drift` if fitted."""
        entries = {"time_offset_frames": {"value": self.frames, "standard_error": self.sigma}}
        if self.drift or self.drift_sigma:
            entries["time_drift"] = {
                "value": self.drift,
                "standard_error": self.drift_sigma,
                "reference_frame": self.reference,
            }
        return entries

    @classmethod
    def from_json(cls, data: Any) -> "MeasuredOffset | None":
        """The inverse of `to_json`; None if there is no offset."""
        if data.get("time_offset_frames") is None:
            return None
        names = "value", "standard_error", "reference_frame"
        try:
            offset, drift = data["time_offset_frames"], data.get("time_drift") or {}
            frames, sigma = (float(offset[name]) for name in names[:2])
            change, spread, reference = (float(drift.get(name, 0.0)) for name in names)
        except DAMAGED as error:
            raise StereocalError(f"the time offset is damaged ({error}).") from error
        numbers = [frames, change, reference, sigma, spread]
        if not np.isfinite(numbers).all() or min(sigma, spread) < 0:
            raise StereocalError("the time offset is not a finite number.")
        return cls(*numbers)

    def split(self) -> "tuple[int, MeasuredOffset]":
        """The whole frames by which the cameras were counted apart, and what the shutter is late.

        A shutter is late by less than a frame. An offset next to a whole number is one of counting.
        """
        near = round(self.frames)
        is_whole = abs(self.frames - near) <= WHOLE + COUNTED * self.sigma
        whole = near if is_whole else math.trunc(self.frames)
        return whole, replace(self, frames=self.frames - whole)

    def most(self, time_frame: npt.ArrayLike) -> float:
        """The largest offset at these frames, either way."""
        return float(np.abs(self.at(time_frame)).max())

    def is_claimed(self, sigmas: float) -> bool:
        """Whether the offset or its drift is at least this many standard errors from 0."""
        return abs(self.frames) > sigmas * self.sigma or abs(self.drift) > sigmas * self.drift_sigma

    def sentence(self) -> str:
        """The offset in words."""
        way = "later" if self.frames >= 0 else "earlier"
        return (
            f"The secondary camera takes its frames {self.interval(abs(self.frames))} frame "
            f"intervals {way} than the primary{self.drift_in_words}."
        )

    @property
    def drift_in_words(self) -> str:
        """How the offset changes; empty if it does not."""
        if not self.drift_sigma:
            return ""
        return f", drifting by {self.drift:.1e} ± {self.drift_sigma:.1e} frames per frame"

    def interval(self, value: float) -> str:
        """A value with the standard error of the offset."""
        return with_error(value, self.sigma, least=2)


@dataclass(frozen=True, eq=False)
class Interpolated:
    """Positions of the points of tracks at other instants; NaN where neighbours are missing."""

    positions: FloatArray
    """(n, 2)."""
    velocities: FloatArray
    """(n, 2), per frame."""
    variance: FloatArray
    """(n,): variance of a position over that of a recorded one."""

    @property
    def known(self) -> BoolArray:
        """(n,)."""
        return np.asarray(np.isfinite(self.positions[:, 0]))

    def inside(self, image_size: tuple[int, int]) -> BoolArray:
        """(n,): whether a position is known and in the image."""
        within = (self.positions >= -0.5) & (self.positions + 0.5 <= image_size)
        return np.asarray(self.known & within.all(axis=1))


def exchanged_ends(ends: FloatArray) -> BoolArray:
    """(n,): in which frames the two ends of an object have each other's names, if they have their
    own in the first: exchanged, they are nearer to those of the frame before.

    Args:
        ends: (n, 2, d): by frame, NaN where not seen; a frame without both stays as it is.
    """
    whole = np.flatnonzero(np.isfinite(ends).all(axis=(1, 2)))
    before, now = ends[whole[:-1]], ends[whole[1:]]
    kept, turned = (np.square(way - before).sum(axis=(1, 2)) for way in (now, now[:, ::-1]))
    exchanged = np.zeros(len(ends), dtype=np.bool_)
    exchanged[whole[1:]] = np.cumsum(NEARER**2 * turned < kept) % 2 == 1
    return exchanged


def interpolate(
    track: IntArray, time_frame: IntArray, positions: FloatArray, offset: FloatArray
) -> Interpolated:
    """The positions of the points at the instants `time_frame` - `offset`.

    The velocity is one whose noise is independent of that of the position: otherwise the noise
    alone would pull a fitted offset towards half a frame, where an interpolated position has least
    noise (measured with 300 frames at 5 px a frame and 0.2 px of noise: by 1.4 standard errors
    from 0.25 frames, instead of 0.2).

    Args:
        track: (n,): which points belong together; two points of a track in one frame have no
            neighbours.
        time_frame: (n,): frame numbers as recorded.
        positions: (n, 2).
        offset: (n,): frames by which the camera of these points is late.
    """
    # Of each track from its first frame: a part of one is lost in numbers near 2^53.
    tracks, track = np.unique(track, return_inverse=True)
    first_frame = np.full(len(tracks), np.iinfo(np.int64).max)
    np.minimum.at(first_frame, track, time_frame)
    time_frame = time_frame - first_frame[track]
    instant = time_frame - offset
    near = np.round(instant)
    instant = np.where(np.abs(instant - near) < NO_SHIFT, near, instant)
    interpolated = Interpolated(
        np.full(positions.shape, np.nan),
        np.full(positions.shape, np.nan),
        np.full(len(instant), np.nan),
    )
    base = np.floor(instant).astype(np.int64)
    # At a frame itself the interval before it will do as well as the one after it.
    for first in (base, base - (instant == near)):
        rows = _rows_of(track, time_frame, first[:, None] + WINDOW.astype(np.int64))
        left = ~interpolated.known
        both = left & (rows[:, 1:3] >= 0).all(axis=1)
        before, after = both & (rows[:, 0] >= 0), both & (rows[:, 3] >= 0)
        for use, columns in (
            (before & after, slice(0, 4)),
            (before & ~after, slice(0, 3)),
            (after & ~before, slice(1, 4)),
            (both & ~before & ~after, slice(1, 3)),
        ):
            if use.any():
                weights, slopes = _weights((instant - first)[use], WINDOW[columns])
                seen = positions[rows[use, columns]]
                interpolated.positions[use] = np.einsum("nk,nkc->nc", weights, seen)
                interpolated.velocities[use] = np.einsum("nk,nkc->nc", slopes, seen)
                interpolated.variance[use] = np.square(weights).sum(axis=1)
    return interpolated


def _weights(f: FloatArray, frames: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n, k) each: weights of the positions at some frames of `WINDOW` for the position at f, and
    for the velocity.

    The position is Lagrange's polynomial. With four frames at x = -1.5, -0.5, 0.5, 1.5 from the
    middle the velocity is the slope of the parabola by least squares, whose weights are
    x / sum x^2 + 2 t (x^2 - mean) / sum (x^2 - mean)^2, at t from the middle: sum x^2 is 5, the
    mean of x^2 is 1.25, and the sum of (x^2 - 1.25)^2 is 4.
    """
    weights = _lagrange(f, frames)
    if len(frames) < len(WINDOW):  # of a parabola and a line, this is the derivative
        return weights, _lagrange(f + 0.5, frames) - _lagrange(f - 0.5, frames)
    # The derivative of the parabola through all four by least squares, plus as much of the third
    # difference, which is 0 for parabolas, as makes its noise independent of the position's.
    centred = WINDOW - 0.5
    slopes = centred / 5.0 + (f - 0.5)[:, None] * (np.square(centred) - 1.25) / 2.0
    third = weights @ THIRD_DIFFERENCE
    third = np.where(np.abs(third) < 1e-4, 1e-4, third)  # halfway both are 0
    share = (weights * slopes).sum(axis=1) / third
    return weights, slopes - share[:, None] * THIRD_DIFFERENCE


def _lagrange(f: FloatArray, frames: FloatArray) -> FloatArray:
    """(n, k): at f, the polynomials that are 1 at one of k frames and 0 at the others."""
    others = (np.delete(frames, k) for k in range(len(frames)))
    return np.column_stack(
        [np.prod((f[:, None] - o) / (k - o), axis=1) for k, o in zip(frames, others, strict=True)]
    )


def _rows_of(track: IntArray, time_frame: IntArray, frames: IntArray) -> IntArray:
    """(n, k): of each point's track, numbered from 0, the row in frames (n, k); -1 if there is not
    exactly one."""
    least, most = int(time_frame.min(initial=0)) - 1, int(time_frame.max(initial=0)) + 1
    numbers = track * (most - least + 1)
    codes, row, count = np.unique(
        numbers + (time_frame - least), return_index=True, return_counts=True
    )
    wanted = numbers[:, None] + (np.clip(frames, least, most) - least)
    place = np.minimum(np.searchsorted(codes, wanted), len(codes) - 1)
    return np.asarray(np.where((codes[place] == wanted) & (count[place] == 1), row[place], -1))
