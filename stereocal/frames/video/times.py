"""Which frames of two videos belong together, by their time stamps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from stereocal.errors import StereocalError
from stereocal.rig.camera import CAMERAS
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.system.numbers import rounded

GAP = 1.5
"""Frame periods above which a step between time stamps is a gap."""
NEIGHBOURS = 11
"""Steps whose median is the frame period at a place: a variable rate is no gap."""
NEAREST = 0.5
"""Most frame periods between the frames of a pair."""
FEWEST = 30
"""Parts of a short video of which one pair each is taken, as many as frames serve well."""
Choice = Literal["every", "still"]


def period_of(seconds: FloatArray) -> float:
    """The usual time from frame to frame, in seconds."""
    return float(np.median(np.diff(seconds)))


def gaps_of(seconds: FloatArray) -> list[tuple[float, int]]:
    """The steps of more than 1.5 frame periods, by the period at the place: time stamp of the frame
    before, from the first, and number of missing frames.
    """
    steps = np.diff(seconds)
    half = NEIGHBOURS // 2
    padded = np.pad(steps, half, mode="reflect" if len(steps) > half else "edge")
    periods = np.median(np.lib.stride_tricks.sliding_window_view(padded, NEIGHBOURS), axis=1)
    return [
        (float(seconds[k] - seconds[0]), round(float(steps[k] / periods[k])) - 1)
        for k in np.flatnonzero(steps > GAP * periods)
    ]


@dataclass(frozen=True, eq=False)
class VideoPairs:
    """Frames of two videos that belong together."""

    frames: IntArray
    """(n, 2): indices into the time stamps of the primary and the secondary; ascending."""
    apart_s: FloatArray
    """(n,): time of the secondary's frame after the primary's."""
    numbers: IntArray
    """(n,): numbers of the recorded frames, from 1, which count missing frames too."""


def pair_times(
    primary: FloatArray, secondary: FloatArray, later_s: float | None = None
) -> VideoPairs:
    """Pair the frames whose time stamps agree best.

    Args:
        primary, secondary: time stamps in seconds, ascending.
        later_s: by how much the clock of the secondary is ahead of the primary's; None: both
            videos start at the same moment.
    """
    shift = secondary[0] - primary[0] if later_s is None else later_s
    theirs = secondary - shift
    after = np.clip(np.searchsorted(theirs, primary), 1, len(theirs) - 1)
    nearest = after - (primary - theirs[after - 1] < theirs[after] - primary)
    apart = theirs[nearest] - primary
    limit = NEAREST * max(period_of(primary), period_of(secondary))
    ours = np.flatnonzero(np.abs(apart) <= limit)
    # A frame of the secondary belongs to the nearest of the primary's frames.
    ours = ours[np.argsort(np.abs(apart[ours]), kind="stable")]
    ours = np.sort(ours[np.unique(nearest[ours], return_index=True)[1]])
    if not len(ours):
        raise StereocalError(
            "The two videos have no frames of the same moment: check that they are of the same "
            "recording, and by how much the secondary's clock is ahead."
        )
    numbers = 1 + np.round((primary[ours] - primary[0]) / period_of(primary)).astype(np.int64)
    for k in range(1, len(numbers)):  # a variable rate
        numbers[k] = max(numbers[k], numbers[k - 1] + 1)
    return VideoPairs(np.column_stack([ours, nearest[ours]]), apart[ours], numbers)


def every(pairs: VideoPairs, n: int) -> IntArray:
    """The pairs of every n-th recorded frame: the first of each n numbers."""
    groups = (pairs.numbers - 1) // n
    return np.unique(groups, return_index=True)[1].astype(np.int64)


def stillest(
    pairs: VideoPairs, seconds: FloatArray, sharpness: FloatArray, motion: FloatArray
) -> IntArray:
    """In each second, the sharpest pair of the still half; of short videos in each
    `FEWEST`-th part.

    Motion and sharpness are relative to the median of each camera, and added over the cameras.

    Args:
        seconds: time stamps of the primary.
        sharpness, motion: (n, 2), of each pair in both cameras.
    """

    def relative(values: FloatArray) -> FloatArray:
        middle = np.median(values, axis=0)
        return np.asarray((values / np.where(middle > 0, middle, 1.0)).sum(axis=1))

    still, sharp = relative(motion), relative(sharpness)
    times = seconds[pairs.frames[:, 0]]
    part_s = min(1.0, (times[-1] - times[0]) / FEWEST) if len(times) > 1 else 1.0
    bins = np.floor((times - times[0]) / part_s + 1e-9).astype(np.int64)
    chosen = []
    for second in np.unique(bins):
        own = np.flatnonzero(bins == second)
        calm = own[still[own] <= np.median(still[own])]
        chosen.append(calm[np.argmax(sharp[calm])])
    return np.array(chosen, dtype=np.int64)


def describe_times(primary: FloatArray, secondary: FloatArray, pairs: VideoPairs) -> list[str]:
    """The rates, the gaps and the agreement of two videos, in words."""
    sentences = []
    for which, seconds in zip(CAMERAS, (primary, secondary), strict=True):
        period, steps = period_of(seconds), np.diff(seconds)
        low, high = np.percentile(steps, [5, 95])
        rate = f"{rounded(1 / period, 4)} frames a second"
        if high > 1.1 * low:
            rate = f"a variable rate, about {rate}"
        gaps = gaps_of(seconds)
        lost = "no frame is missing"
        if gaps:
            first = ", ".join(f"{missing} after {at_s:.3f} s" for at_s, missing in gaps[:3])
            more = f" and at {len(gaps) - 3} more places" if len(gaps) > 3 else ""
            count = sum(missing for _, missing in gaps)
            lost = f"{count} frame{'s are' if count > 1 else ' is'} missing: {first}{more}"
        sentences.append(f"The {which} video has {len(seconds)} frames, {rate}; {lost}.")
    largest = 1000 * float(np.abs(pairs.apart_s).max())
    sentences.append(
        f"{len(pairs.frames)} frames of both belong together; their time stamps differ by at most "
        f"{rounded(largest)} ms."
    )
    return sentences
