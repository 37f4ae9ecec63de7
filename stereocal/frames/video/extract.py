"""Take frames out of videos: of two those that belong together by their `time_stamps`, as
photographs that pair by their names; of one, or of cameras started by hand, each by itself."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from stereocal.errors import StereocalError
from stereocal.frames.several_cameras import chapters_of
from stereocal.frames.video.decoding import (
    SUFFIXES,
    VideoTimes,
    encoded_frames,
    read_times,
    score_frames,
)
from stereocal.frames.video.sound import heard_later, read_rises
from stereocal.frames.video.time_stamps import (
    VideoPairs,
    by_themselves,
    describe_times,
    every,
    gaps_of,
    of_one,
    pair_times,
    stillest,
)
from stereocal.rig.camera import CAMERAS
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.atomic_files import write_atomically
from stereocal.system.guarded import Guard
from stereocal.system.limits import Limits
from stereocal.system.numbers import rounded
from stereocal.system.split_photographs import Split, keeping_halves, split_by_shape

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
    `every`, else at most `time_stamps.DENSE` a second."""
    coloured: bool = False
    """Frames keep their colours, for balls that differ by them; else they are grey."""
    split: Split | Literal["by shape"] | None = None
    """Of one video whose frames hold the images of two cameras: how these lie."""


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
    apart: str = ""
    """That of the sentences which says that the frames are apart by their sound."""


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
            `secondary/000031.png` for recorded frame 31 of the primary, also of one that is split.
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
    try:
        files, look = [(path, path.name) for path in paths], partial(progress, 0, 1)
        times: list[VideoTimes] = guard.read_all(read_times, files, look)
        if settings.split is not None:
            keep = keeping_halves(_split_of(paths[0], times[0], settings), CAMERAS, keep)
        rises = list[FloatArray]()
        with suppress(StereocalError):  # no sound that can be read
            rises = guard.read_all(read_rises, files, look) if len(files) > 1 else []
        seconds = {name: video.seconds for name, video in zip(names, times, strict=True)}
        pairs, step_s = _paired([*seconds.values()], settings)
        work = _Work(guard, names, paths, times, pairs, settings.coloured, begin, progress)
        if settings.by_hand:
            chosen = every(pairs, 1)
        else:
            chosen = work.stillest() if settings.choice == "still" else every(pairs, settings.n)
        Limits.from_environment().check_count(len(names) * len(chosen), "The frames of the videos")
        lost = work.take(chosen, keep)
    finally:
        guard.close()
    taken = len(chosen) - lost
    if not taken:
        raise StereocalError(f"No frame of the video{'s' * (len(names) > 1)} could be decoded.")
    heard, by_sound = _heard(seconds, rises, settings, step_s)
    sentences = [
        *describe_times(seconds, pairs),
        _taken_in_words(pairs, taken, step_s),
        *by_sound,
        *([f"{lost} could not be decoded."] if lost else []),
    ]
    missing = any(gaps_of(video.seconds) for video in times)
    apart = "" if settings.by_hand else " ".join(by_sound)
    return VideoReport(tuple(sentences), taken, missing, heard, apart)


def _split_of(path: Path, video: VideoTimes, settings: VideoSettings) -> Split:
    """How the images of two cameras lie in the frames of a video."""
    by_shape = split_by_shape((video.width, video.height))
    split = by_shape if settings.split == "by shape" else settings.split
    if split is None:
        raise StereocalError(
            f"{path.name}: its frames of {video.width}x{video.height} px are not as long as those "
            "of two cameras side by side: give the video of each camera."
        )
    return split


def _paired(
    seconds: Sequence[FloatArray], settings: VideoSettings
) -> tuple[VideoPairs, float | None]:
    """The frames that belong together by the time stamps of each video, in seconds; and the step in
    seconds of frames that are taken of each video by itself."""
    if settings.by_hand:
        return by_themselves(seconds, settings.n if settings.choice == "every" else None)
    if len(seconds) == 1:
        return of_one(*seconds), None
    return pair_times(seconds[0], seconds[1], settings.later_s), None


def _taken_in_words(pairs: VideoPairs, taken: int, step_s: float | None) -> str:
    if step_s is not None:
        counts = " and ".join(f"{count:,}" for count in (pairs.frames >= 0).sum(axis=0))
        return f"Of each by itself, a frame every {rounded(step_s)} s was taken: {counts}."
    return f"{taken:,} {'pairs of ' * (pairs.frames.shape[1] > 1)}frames were taken."


def with_frames(
    sources: Iterable[Path],
    store: Path,
    begin: Callable[[str], None] = lambda _stage: None,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> list[Path]:
    """The sources of one camera's photographs, with a folder of frames in the place of a video.

    Args:
        sources: photographs, folders, zips, and one video at most, or the chapters of one.
        store: where the folder is made.
        begin, progress: as of `extract`.
    """
    sources = list(sources)
    videos = [source for source in sources if source.suffix.lower() in SUFFIXES]
    if len(chapters_of(map(str, videos))) > 1:
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
    pairs: VideoPairs
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
