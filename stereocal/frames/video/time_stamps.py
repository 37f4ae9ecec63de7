"""Frames of videos that belong together, by their time stamps: pairs of two cameras, or of each
video by itself; which of them to take; and the stamps in words."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from stereocal.errors import StereocalError
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import rounded

GAP = 1.5
"""Frame periods above which a step between time stamps is a gap."""
NEIGHBOURS = 11
"""Steps whose median is the frame period at a place: a variable rate is no gap."""
NEAREST = 0.5
"""Most frame periods between the frames of a pair."""
FEWEST = 30
"""Parts of a short video of which one pair each is taken, as many as frames serve well."""
DENSE = 15.0
"""Frames a second that tell the motion of what is waved by hand."""


def _period(seconds: FloatArray) -> float:
    """The usual time from frame to frame, in seconds."""
    return float(np.median(np.diff(seconds)))


def gaps_of(seconds: FloatArray) -> list[tuple[float, int]]:
    """The steps of more than 1.5 frame periods, by the period at the place: time stamp of the frame
    before, from the first, and number of missing frames.
    """
    steps = np.diff(seconds)
    periods = median_filter(steps, NEIGHBOURS, mode="mirror")
    return [
        (float(seconds[k] - seconds[0]), round(float(steps[k] / periods[k])) - 1)
        for k in np.flatnonzero(steps > GAP * periods)
    ]


@dataclass(frozen=True, eq=False)
class VideoPairs:
    """Frames of videos that belong together."""

    frames: IntArray
    """(n, c): indices into the time stamps of each camera; ascending, but -1 of a camera that has
    no frame then."""
    apart_s: FloatArray
    """(n,): time of the secondary's frame after the primary's; empty if that is still open."""
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
    nearest = _nearest(theirs, primary)
    apart = theirs[nearest] - primary
    limit = NEAREST * max(_period(primary), _period(secondary))
    ours = np.flatnonzero(np.abs(apart) <= limit)
    # A frame of the secondary belongs to the nearest of the primary's frames.
    ours = ours[np.argsort(np.abs(apart[ours]), kind="stable")]
    ours = np.sort(ours[np.unique(nearest[ours], return_index=True)[1]])
    if not len(ours):
        raise StereocalError(
            "The two videos have no frames of the same moment: check that they are of the same "
            "recording, and by how much the secondary's clock is ahead."
        )
    frames = np.column_stack([ours, nearest[ours]])
    return VideoPairs(frames, apart[ours], _numbered(primary, ours))


def of_one(seconds: FloatArray) -> VideoPairs:
    """All frames of one video, by their time stamps."""
    every = np.arange(len(seconds))
    return VideoPairs(every[:, None], np.empty(0), _numbered(seconds, every))


def _numbered(seconds: FloatArray, chosen: IntArray) -> IntArray:
    """Numbers of the chosen frames from 1, ascending, which count missing frames too."""
    times = seconds[chosen] - seconds[0]
    numbers: IntArray = 1 + np.round(times / _period(seconds)).astype(np.int64)
    for k in range(1, len(numbers)):  # a variable rate
        numbers[k] = max(numbers[k], numbers[k - 1] + 1)
    return numbers


def _nearest(seconds: FloatArray, wanted: FloatArray) -> IntArray:
    """Which of ascending times is the nearest to each wanted one."""
    after = np.clip(np.searchsorted(seconds, wanted), 1, len(seconds) - 1)
    return np.asarray(after - (wanted - seconds[after - 1] < seconds[after] - wanted))


def by_themselves(times: Sequence[FloatArray], n: int | None) -> tuple[VideoPairs, float]:
    """Frames of each video at equal steps of time from its first, and the step in seconds: their
    numbers are not of the same moments.

    Args:
        times: the time stamps of each video, in seconds.
        n: a step is so many frames of the slowest camera; None: not shorter than 1 / `DENSE`.
    """
    slowest = max(map(_period, times))
    step_s = slowest * (n or int(np.ceil(1.0 / (DENSE * slowest) - 0.01)))
    columns = []
    for seconds in times:
        wanted = np.arange(seconds[0], seconds[-1] + 0.1 * slowest, step_s)
        nearest = _nearest(seconds, wanted)
        near = np.abs(seconds[nearest] - wanted) <= NEAREST * slowest
        columns.append(np.where(near, nearest, -1))
    most = max(map(len, columns))
    frames = [np.pad(column, (0, most - len(column)), constant_values=-1) for column in columns]
    return VideoPairs(np.column_stack(frames), np.empty(0), np.arange(1, most + 1)), step_s


def every(pairs: VideoPairs, n: int) -> IntArray:
    """The pairs of every n-th recorded frame: the first of each n numbers."""
    groups = (pairs.numbers - 1) // n
    return np.unique(groups, return_index=True)[1].astype(np.int64)


def stillest(
    pairs: VideoPairs, seconds: FloatArray, sharpness: FloatArray, motion: FloatArray
) -> IntArray:
    """In each second, the sharpest pair of the still half; of short videos in each
    `FEWEST`-th part. Both are relative to the median of each camera, and added over the cameras.

    Args:
        seconds: time stamps of the primary.
        sharpness, motion: (n, c), of each pair in all cameras.
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
        rows = np.flatnonzero(bins == second)
        calm = rows[still[rows] <= np.median(still[rows])]
        chosen.append(calm[np.argmax(sharp[calm])])
    return np.array(chosen, dtype=np.int64)


def describe_times(videos: Mapping[str, FloatArray], pairs: VideoPairs) -> list[str]:
    """The rates, the gaps and the agreement of videos, in words."""
    sentences = []
    for which, seconds in videos.items():
        period, steps = _period(seconds), np.diff(seconds)
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
    if not len(pairs.apart_s):
        return sentences
    largest = 1000 * float(np.abs(pairs.apart_s).max())
    sentences.append(
        f"{len(pairs.frames)} frames of both belong together; their time stamps differ by at most "
        f"{rounded(largest)} ms."
    )
    return sentences
