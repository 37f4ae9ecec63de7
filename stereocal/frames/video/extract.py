"""Take frames out of two videos, as photographs that pair by their names."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stereocal.frames.video.decoding import VideoTimes, encoded_frames, read_times, score_frames
from stereocal.frames.video.times import (
    Choice,
    VideoPairs,
    describe_times,
    every,
    gaps_of,
    pair_times,
    stillest,
)
from stereocal.rig.camera import CAMERAS
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.system.guarded import Guard
from stereocal.system.limits import Limits

STAGES = ("frames looked at", "frames taken")
LEAST_SECONDS = 120.0
"""Time limit of a segment of a video, on a busy server."""
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

    choice: Choice = "still"
    """`every` n-th frame, or in each second the sharpest of the still ones (`stillest`)."""
    n: int = 30
    later_s: float | None = None
    """As for `pair_times`."""
    coloured: bool = False
    """Frames keep their colours, for balls that differ by them; else they are grey."""


@dataclass(frozen=True)
class VideoReport:
    """What was found and taken, in sentences."""

    sentences: tuple[str, ...]
    taken: int
    """Number of pairs."""
    frames_missing: bool
    """Whether frames are missing within a video, by its time stamps."""


def extract(
    videos: tuple[Path, Path],
    settings: VideoSettings,
    keep: Callable[[str, bytes], object],
    begin: Callable[[str], None] = lambda _stage: None,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
    cancelled: Callable[[], bool] = lambda: False,
) -> VideoReport | None:
    """Take frames out of the videos of the primary and the secondary.

    Args:
        keep: called with the name and the content of each photograph, `primary/000031.png` and
            `secondary/000031.png` for recorded frame 31 of the primary.
        begin, progress: called with each stage of `STAGES`, and how much of it is done.
        cancelled: asked often.

    Returns:
        None if cancelled.
    """
    guard = Guard([read_times, score_frames, encoded_frames], least_seconds=LEAST_SECONDS)
    try:
        times: list[VideoTimes] = [guard.read(read_times, path, path.name) for path in videos]
        pairs = pair_times(times[0].seconds, times[1].seconds, settings.later_s)
        work = _Work(guard, videos, times, pairs, settings.coloured, begin, progress, cancelled)
        chosen = every(pairs, settings.n) if settings.choice == "every" else work.stillest()
        if chosen is None:
            return None
        Limits.from_environment().check_count(2 * len(chosen), "The frames of the videos")
        lost = work.take(chosen, keep)
    finally:
        guard.close()
    if lost is None:
        return None
    sentences = describe_times(times[0].seconds, times[1].seconds, pairs)
    sentences.append(f"{len(chosen) - lost} pairs of frames were taken.")
    if lost:
        sentences.append(f"{lost} could not be decoded.")
    missing = any(gaps_of(each.seconds) for each in times)
    return VideoReport(tuple(sentences), len(chosen) - lost, missing)


@dataclass(frozen=True, eq=False)
class _Work:
    guard: Guard
    videos: tuple[Path, Path]
    times: list[VideoTimes]
    pairs: VideoPairs
    coloured: bool
    begin: Callable[[str], None]
    progress: Callable[[int, int], None]
    cancelled: Callable[[], bool]

    def stillest(self) -> IntArray | None:
        """Look at all frames that are paired; None if cancelled."""
        self.begin(STAGES[0])
        total = sum(len(each.seconds) for each in self.times)
        segments = [
            (which, seconds[max(at - 1, 0) : at + SEGMENT + 1])  # neighbours for the motion
            for which, seconds in enumerate(each.seconds for each in self.times)
            for at in range(0, len(seconds), SEGMENT)
        ]
        scores: list[list[FloatArray]] = [[], []]
        done = 0
        with ThreadPoolExecutor(2) as threads:
            for which, found in threads.map(self._scores, segments):
                if self.cancelled():
                    threads.shutdown(cancel_futures=True)
                    return None
                scores[which].append(found)
                done += len(found)
                self.progress(min(done, total), total)
        sides = [
            _at(np.concatenate(own), each.seconds)[self.pairs.frames[:, k]]
            for k, (own, each) in enumerate(zip(scores, self.times, strict=True))
        ]
        sharpness, motion = (np.column_stack([side[:, k] for side in sides]) for k in (0, 1))
        return stillest(self.pairs, self.times[0].seconds, sharpness, motion)

    def take(self, chosen: IntArray, keep: Callable[[str, bytes], object]) -> int | None:
        """Decode and keep the chosen pairs.

        Returns:
            The number of pairs that cannot be decoded; None if cancelled.
        """
        self.begin(STAGES[1])
        pixels = sum(each.width * each.height for each in self.times) * len(chosen)
        pixels *= 3 if self.coloured else 1
        lossless = pixels <= LOSSLESS_BYTES
        lost = 0
        with ThreadPoolExecutor(2) as threads:
            for first in range(0, len(chosen), BATCH):
                if self.cancelled():
                    return None
                own = chosen[first : first + BATCH]
                both = list(threads.map(self._encoded, (0, 1), (own, own), (lossless, lossless)))
                for number, *sides in zip(self.pairs.numbers[own], *both, strict=True):
                    if None in sides:
                        lost += 1
                        continue
                    for which, content in zip(CAMERAS, sides, strict=True):
                        suffix = ".png" if content.startswith(b"\x89PNG") else ".jpg"
                        keep(f"{which}/{number:06d}{suffix}", content)
                self.progress(first + len(own), len(chosen))
        return lost

    def _scores(self, segment: tuple[int, FloatArray]) -> tuple[int, FloatArray]:
        which, seconds = segment
        if self.cancelled():
            return which, np.zeros((0, 3))
        path, ends = self.videos[which], (float(seconds[0]), float(seconds[-1]))
        return which, self.guard.read(score_frames, path, path.name, *ends)

    def _encoded(self, which: int, chosen: IntArray, lossless: bool) -> list[bytes | None]:
        path = self.videos[which]
        seconds = self.times[which].seconds[self.pairs.frames[chosen, which]].tolist()
        found: list[bytes | None] = self.guard.read(
            encoded_frames, path, path.name, seconds, lossless, self.coloured
        )
        return found


def _at(scores: FloatArray, seconds: FloatArray) -> FloatArray:
    """(n, 2): sharpness and motion at the time stamps; neither sharp nor still where missing."""
    found = np.column_stack([np.zeros(len(seconds)), np.full(len(seconds), np.inf)])
    if len(scores):
        at = np.clip(np.searchsorted(seconds, scores[:, 0] - 1e-6), 0, len(seconds) - 1)
        exact = np.abs(seconds[at] - scores[:, 0]) < 1e-6
        found[at[exact], 0] = scores[exact, 1]
        # Of two segments, that with both neighbours saw the larger motion.
        known = np.full(len(seconds), -np.inf)
        np.maximum.at(known, at[exact], scores[exact, 2])
        found[known >= 0, 1] = known[known >= 0]
    return found
