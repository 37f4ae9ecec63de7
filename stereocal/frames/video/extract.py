"""Take frames out of videos: of two those that belong together by their time stamps, as photographs
that pair by their names; of one, or of cameras started by hand, each by itself."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from scipy.ndimage import median_filter

from stereocal.errors import StereocalError
from stereocal.frames.video.decoding import (
    SUFFIXES,
    VideoTimes,
    encoded_frames,
    read_times,
    score_frames,
)
from stereocal.frames.video.sound import heard_later, read_rises
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.atomic_files import write_atomically
from stereocal.system.guarded import Guard
from stereocal.system.limits import Limits
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
HEARD_APART_S = 0.25
"""Less may be the sound's way to the cameras, and what they store late."""
FrameChoice = Literal["every", "still"]
STAGES = ("frames looked at", "frames taken")
LEAST_SECONDS = 120.0
"""Time limit of a segment of a video, on a busy server."""
CHILDREN = 2
"""Processes that read the videos."""
SEGMENT = 200
"""Frames that a child process looks at in one go."""
BATCH = 8
"""Frames that a child process returns in one go."""
LOSSLESS_BYTES = 400e6
"""Up to this size of all pixels and colours, frames are PNG; above, JPEG of quality 95, which moves
a target by 0.001 px (sample_data/README.md) and takes a fifth of the room."""


@dataclass(frozen=True)
class VideoSettings:
    """Which frames to take."""

    choice: FrameChoice = "still"
    """`every` n-th frame, or in each second the sharpest of the still ones (`stillest`)."""
    n: int = 30
    later_s: float | None = None
    """How much the clock of the secondary is ahead of the primary's, as `pair_times` takes it."""
    by_hand: bool = False
    """The cameras were started by hand: frames are taken of each video by itself, every n-th of
    `every`, else at most `DENSE` a second."""
    coloured: bool = False
    """Frames keep their colours, for balls that differ by them; else they are grey."""


@dataclass(frozen=True)
class VideoReport:
    """What was found and taken, in sentences."""

    sentences: tuple[str, ...]
    taken: int
    """Number of moments."""
    frames_missing: bool
    """Whether frames are missing within a video, by its time stamps."""
    heard: Mapping[str, float] = field(default_factory=dict)
    """What the sound says of cameras started by hand, as in `ByHand`."""


def extract(
    videos: Mapping[str, Path],
    settings: VideoSettings,
    keep: Callable[[str, bytes], object],
    begin: Callable[[str], None] = lambda _stage: None,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> VideoReport:
    """Take frames out of the videos of all cameras, of more than two only if they were started by
    hand; or of one.

    Args:
        videos: by camera.
        keep: called with the name and the content of each photograph, `primary/000031.png` and
            `secondary/000031.png` for recorded frame 31 of the primary.
        begin, progress: called with each stage of `STAGES`, and how much of it is done; what they
            raise ends the work.

    Raises:
        StereocalError: also if no frame can be decoded.
    """
    names, paths = [*videos], [*videos.values()]
    if len(names) > 2 and not settings.by_hand:
        raise StereocalError(
            f"Of the videos of {len(names)} cameras, frames are taken as of cameras that were "
            "started by hand only, whose motion tells which belong together: say so."
        )
    guard = Guard((read_times, score_frames, encoded_frames, read_rises), CHILDREN, LEAST_SECONDS)
    step_s, rises = None, list[FloatArray]()
    try:
        files, look = [(path, path.name) for path in paths], partial(progress, 0, 1)
        times: list[VideoTimes] = guard.read_all(read_times, files, look)
        seconds = [video.seconds for video in times]
        n = settings.n if settings.choice == "every" else None
        with suppress(StereocalError):  # no sound that can be read
            rises = guard.read_all(read_rises, files, look) if len(files) > 1 else []
        if settings.by_hand:
            pairs, step_s = by_themselves(seconds, n)
        elif len(seconds) == 1:
            pairs = of_one(*seconds)
        else:
            pairs = pair_times(seconds[0], seconds[1], settings.later_s)
        work = _Work(guard, names, paths, times, pairs, settings.coloured, begin, progress)
        if settings.by_hand or n is not None:
            chosen = every(pairs, 1 if settings.by_hand else settings.n)
        else:
            chosen = work.stillest()
        Limits.from_environment().check_count(len(names) * len(chosen), "The frames of the videos")
        lost = work.take(chosen, keep)
    finally:
        guard.close()
    if lost == len(chosen):
        of = "videos" if len(names) > 1 else "video"
        raise StereocalError(f"No frame of the {of} could be decoded.")
    sentences = describe_times(by_name := dict(zip(names, seconds, strict=True)), pairs)
    pairs_of = "pairs of " * (len(names) > 1)
    taken = f"{len(chosen) - lost:,} {pairs_of}frames were taken."
    if step_s is not None:
        counts = " and ".join(f"{count:,}" for count in (pairs.frames >= 0).sum(axis=0))
        taken = f"Of each by itself, a frame every {rounded(step_s)} s was taken: {counts}."
    sentences.append(taken)
    heard, by_sound = _heard(by_name, rises, settings, step_s)
    sentences += by_sound
    if lost:
        sentences.append(f"{lost} could not be decoded.")
    missing = any(gaps_of(video.seconds) for video in times)
    return VideoReport(tuple(sentences), len(chosen) - lost, missing, heard)


def with_frames(
    sources: Iterable[Path],
    store: Path,
    begin: Callable[[str], None] = lambda _stage: None,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> list[Path]:
    """The sources of one camera's photographs, with a folder of frames in the place of a video.

    Args:
        sources: photographs, folders, zips, and one video at most.
        store: where the folder is made.
        begin, progress: as of `extract`.
    """
    sources = list(sources)
    videos = [source for source in sources if source.suffix.lower() in SUFFIXES]
    if len(videos) > 1:
        raise StereocalError(
            f"{videos[0]} and {videos[1]}: photographs of one camera come from one video. A board "
            "in the videos of two cameras is found by `detect --videos`."
        )

    def write(name: str, content: bytes) -> None:
        write_atomically(store / name, content)

    for video in videos:
        extract({video.stem: video}, VideoSettings(), write, begin, progress)
    return [store / source.stem if source in videos else source for source in sources]


def _heard(
    times: Mapping[str, FloatArray],
    rises: Sequence[FloatArray],
    settings: VideoSettings,
    step_s: float | None,
) -> tuple[dict[str, float], list[str]]:
    """How many steps later each video was started by its sound, and what the sound says.

    Args:
        times: time stamps of each video, in seconds.
        rises: of the sound of each; empty if it cannot be read.
        step_s: of frames that are taken of each by itself.
    """
    (first, began), *others = times.items()
    heard, sentences = dict[str, float](), list[str]()
    for (name, seconds), rise in zip(others, rises[1:], strict=False):
        if (heard_s := heard_later(rises[0], rise)) is None:
            continue
        together = settings.by_hand or settings.later_s is None
        heard_s += seconds[0] - began[0] if together else settings.later_s or 0.0
        if step_s is not None:
            heard[name] = heard_s / step_s
            both = f"{first} and {name}" if len(times) > 2 else "they"
            sentences.append(f"By their sound, {both} began {abs(heard_s):.2f} s apart.")
        elif abs(heard_s) > HEARD_APART_S:
            sentences.append(
                f"By their sound, these frames are {abs(heard_s):.2f} s apart: if the cameras were "
                "started by hand, say so, and the motion tells which belong together."
            )
    return heard, sentences


@dataclass(frozen=True, eq=False)
class _Work:
    guard: Guard
    names: list[str]
    paths: list[Path]
    times: list[VideoTimes]
    pairs: "VideoPairs"
    coloured: bool
    begin: Callable[[str], None]
    progress: Callable[[int, int], None]

    def stillest(self) -> IntArray:
        """Look at all frames that are paired."""
        self.begin(STAGES[0])
        total = sum(len(video.seconds) for video in self.times)
        segments = [
            (which, seconds[max(start - 1, 0) : start + SEGMENT + 1])  # neighbours for the motion
            for which, seconds in enumerate(video.seconds for video in self.times)
            for start in range(0, len(seconds), SEGMENT)
        ]
        scores: list[list[FloatArray]] = [[] for _ in self.names]
        done = 0
        for start in range(0, len(segments), CHILDREN):
            some = segments[start : start + CHILDREN]
            calls = [self._call(which, *seconds[[0, -1]].tolist()) for which, seconds in some]
            look = partial(self.progress, min(done, total), total)
            every = self.guard.read_all(score_frames, calls, look)
            for (which, _), segment_scores in zip(some, every, strict=True):
                scores[which].append(segment_scores)
                done += len(segment_scores)
            self.progress(min(done, total), total)
        sides = [
            _at(np.concatenate(parts), video.seconds)[self.pairs.frames[:, k]]
            for k, (parts, video) in enumerate(zip(scores, self.times, strict=True))
        ]
        sharpness, motion = (np.column_stack([side[:, k] for side in sides]) for k in (0, 1))
        return stillest(self.pairs, self.times[0].seconds, sharpness, motion)

    def take(self, chosen: IntArray, keep: Callable[[str, bytes], object]) -> int:
        """Decode and keep the chosen pairs: how many cannot be decoded."""
        self.begin(STAGES[1])
        pixels = sum(video.width * video.height for video in self.times) * len(chosen)
        pixels *= 3 if self.coloured else 1
        lossless = pixels <= LOSSLESS_BYTES
        lost = 0
        for first in range(0, len(chosen), BATCH):
            batch = chosen[first : first + BATCH]
            look = partial(self.progress, first, len(chosen))
            encoded = self._encoded(self.pairs.frames[batch], lossless, look)
            rows = self.pairs.numbers[batch], self.pairs.frames[batch], encoded
            for number, there, sides in zip(*rows, strict=True):
                if None in sides[there >= 0].tolist():
                    lost += 1
                    continue
                for which, content in zip(self.names, sides, strict=True):
                    if content is None:
                        continue
                    suffix = ".png" if content.startswith(b"\x89PNG") else ".jpg"
                    keep(f"{which}/{number:06d}{suffix}", content)
            self.progress(first + len(batch), len(chosen))
        return lost

    def _encoded(
        self, frames: IntArray, lossless: bool, look: Callable[[], object]
    ) -> npt.NDArray[np.object_]:
        """The frames (n, c) of each camera as bytes; None where there is none."""
        encoded = np.full(frames.shape, None, dtype=object)
        wanted = [column[column >= 0] for column in frames.T]
        some = [which for which, column in enumerate(wanted) if len(column)]
        calls = [
            self._call(k, self.times[k].seconds[wanted[k]].tolist(), lossless, self.coloured)
            for k in some
        ]
        every = self.guard.read_all(encoded_frames, calls, look)
        for which, contents in zip(some, every, strict=True):
            encoded[frames[:, which] >= 0, which] = contents
        return encoded

    def _call(self, which: int, *arguments: Any) -> tuple[Path, str, *tuple[Any, ...]]:
        return self.paths[which], self.paths[which].name, *arguments


def _at(scores: FloatArray, seconds: FloatArray) -> FloatArray:
    """(n, 2): sharpness and motion at the time stamps; neither sharp nor still where missing."""
    values = np.column_stack([np.zeros(len(seconds)), np.full(len(seconds), np.inf)])
    if len(scores):
        row = np.clip(np.searchsorted(seconds, scores[:, 0] - 1e-6), 0, len(seconds) - 1)
        exact = np.abs(seconds[row] - scores[:, 0]) < 1e-6
        values[row[exact], 0] = scores[exact, 1]
        # Of two segments, that with both neighbours saw the larger motion.
        known = np.full(len(seconds), -np.inf)
        np.maximum.at(known, row[exact], scores[exact, 2])
        values[known >= 0, 1] = known[known >= 0]
    return values


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
