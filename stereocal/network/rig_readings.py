"""Other readings of what was given of a rig.

Those of a camera's points and file are the readings of a pair of it, carried over to the recording:
a mistake is described once. What only a rig can have is added: any two cameras exchanged, one file
for several cameras, all cameras alike.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np

from stereocal.calibration.readings import (
    Claim,
    Reading,
    orders_of_words,
    readings_of_cameras,
    readings_of_points,
    same_lens,
    scaled,
)
from stereocal.calibration.wrong_inputs import essential_fit, scaled_readings
from stereocal.errors import StereocalError
from stereocal.network.pairs import shared_bars
from stereocal.refined.best_reading import centred_readings, is_near
from stereocal.rig.camera import CAMERAS, Camera, CameraName
from stereocal.rig.compiled import IntArray
from stereocal.rig.dataset import Dataset
from stereocal.rig.recording import CameraPair, Recording

MOST_SHIFT = 3
"""Frames by which the numbers of a camera may be off."""
SHIFT_GAIN = 4.0
"""A camera that is late by a part of a frame fits somewhat better a whole frame off."""
FEWEST_OF_PART, CUTS = 10, 8
"""Frames before a camera moved and after it, and cuts that are tried at first."""
OWN: tuple[CameraName, ...] = (CAMERAS[1],)
"""Of a pair, whose readings are those of a camera of the rig."""
ESTIMATED_HANDICAP = 1.3
"""Of readings that estimate a value."""


@dataclass(frozen=True)
class RigReading(Claim):
    """A claim about cameras of a rig, and the corrected recording."""

    cameras: tuple[str, ...]
    """Which it changes."""
    corrected: Callable[[], Recording]
    handicap: float = 1.0
    """How many times less noise it must leave than others to be the better one."""
    least_gain: float = 0.0
    """How many times less noise it must leave than what was given."""
    is_movement: bool = False
    """Whether no input is wrong, but a camera moved."""

    @property
    def is_estimated(self) -> bool:
        """Whether it puts a fitted value in the place of a stated one."""
        return self.handicap == ESTIMATED_HANDICAP


def readings_of_rig(recording: Recording, about: Sequence[str]) -> Iterator[RigReading]:
    """All readings that are worth a fit.

    Args:
        about: the cameras that they are to concern.
    """
    yield from _of_all(recording)
    for name in about:
        yield from _of_camera(recording, name)
        yield RigReading(
            f"The images of camera {name} seem to be turned by half a turn",
            "Turn them back, or give the camera file of the turned images.",
            (name,),
            partial(seen_otherwise, recording, (name,), (True, True)),
        )


def readings_of_frames(recording: Recording, about: Sequence[str]) -> Iterator[RigReading]:
    """Frames of a camera that are counted apart, or in the order of words."""
    frames = np.unique(recording.frame)
    for name in about:
        for late in range(-MOST_SHIFT, MOST_SHIFT + 1):
            if late:
                yield _counted_apart(recording, name, late)
        for order in orders_of_words(frames):
            yield RigReading(
                f"The frames of camera {name} seem to be in the order of words (1, 10, 11, ... 2)",
                "Sort its files by their numbers, or write these with zeros before: 01, 02, ...",
                (name,),
                partial(_reordered, recording, name, frames, np.array(order)),
            )


def readings_of_movement(recording: Recording, about: Sequence[str]) -> Iterator[RigReading]:
    """A camera that moved: from a frame on it is another one, with the same lens."""
    for name in about:
        if (pair := best_pair(recording, name)) is None:
            continue
        dataset = recording.pair(*pair)
        if (when := _best_cut(dataset)) is not None:
            after = f"{name} from frame {when} on"
            yield RigReading(
                f"The camera {name} seems to have moved at about frame {when}",
                "Calibrate with the frames before it, or after it, alone.",
                (name, after),
                partial(_as_two_cameras, recording, name, after, when),
                is_movement=True,
            )


def _best_cut(dataset: Dataset) -> int | None:
    """The frame at which the pairs of two cameras are best divided, so that each part fits by
    itself; None for few frames."""
    frames = dataset.correspondences.frames
    if len(frames) < 2 * FEWEST_OF_PART:
        return None

    def px(cut: int) -> float:
        parts = frames[:cut], frames[cut:]
        return sum(len(part) * essential_fit(dataset.of_frames(part)).px for part in parts)

    first, last = FEWEST_OF_PART, len(frames) - FEWEST_OF_PART
    step = max((last - first) // CUTS, 1)
    best = min(range(first, last + 1, step), key=px)
    while step > 1:
        step //= 2
        best = min(
            (cut for cut in (best - step, best, best + step) if first <= cut <= last), key=px
        )
    return int(frames[best])


def _as_two_cameras(recording: Recording, name: str, after: str, when: int) -> Recording:
    """The recording with a camera as two, before a frame and from it on."""
    cameras = {**recording.cameras, after: recording.cameras[name]}
    moved = (recording.camera == [*recording.cameras].index(name)) & (recording.frame >= when)
    camera = np.where(moved, len(recording.cameras), recording.camera)
    return replace(recording, cameras=cameras, camera=camera)


def _reordered(recording: Recording, name: str, frames: IntArray, of_frames: IntArray) -> Recording:
    """The recording with a camera's points of other frames in the place of each."""
    own = recording.camera == [*recording.cameras].index(name)
    order = np.argsort(of_frames)
    moved = frames[order][np.searchsorted(of_frames[order], recording.frame)]
    return replace(recording, frame=np.where(own, moved, recording.frame))


def best_pair(recording: Recording, name: str) -> CameraPair | None:
    """The pair of a camera, as the second one, with which it shares most bars; None without any."""
    pair = next((pair for pair in shared_bars(recording) if name in pair), None)
    return None if pair is None else (pair[pair[0] == name], name)


def _of_camera(recording: Recording, name: str) -> Iterator[RigReading]:
    """Those of a pair of it."""
    if (pair := best_pair(recording, name)) is None:
        return
    dataset = recording.pair(*pair)
    yield from carried_over(recording, pair, readings_of_cameras(dataset))
    yield from carried_over(recording, pair, readings_of_points(dataset))
    for estimated in (centred_readings(dataset, [OWN]), scaled_readings(dataset, [OWN])):
        yield from carried_over(recording, pair, estimated, ESTIMATED_HANDICAP)


def carried_over(
    recording: Recording, pair: CameraPair, readings: Iterable[Reading], handicap: float = 1.0
) -> Iterator[RigReading]:
    """Readings of a pair that change its second camera alone, as readings of the rig."""
    name = pair[1]
    for reading in readings:
        if reading.cameras != OWN:
            continue
        with suppress(StereocalError):
            after = reading.corrected()
            if is_near(after):
                yield RigReading(
                    _named(reading.claim, name),
                    _named(reading.remedy, name),
                    (name,),
                    partial(_with_camera_of, recording, name, after),
                    handicap,
                )


def exchanged_files(
    recording: Recording, about: Sequence[str], cameras: Mapping[str, Camera]
) -> Iterator[RigReading]:
    """Any two cameras with the file, or with the points, of each other.

    Args:
        cameras: of the rig, of which the recording may have some.
    """
    for a, b in combinations(cameras, 2):
        one, other = cameras[a], cameras[b]
        if same_lens(one, other) or not {a, b} & {*about}:
            continue
        files = {
            a: replace(other, image_size=one.image_size),
            b: replace(one, image_size=other.image_size),
        }
        here = {name: file for name, file in files.items() if name in recording.cameras}
        yield RigReading(
            f"The camera files of {a} and {b}, or their points, seem to be exchanged",
            "Exchange them.",
            tuple(here),
            partial(with_lenses, recording, here),
        )


def seen_otherwise(
    recording: Recording, cameras: Sequence[str], turned: tuple[bool, bool]
) -> Recording:
    """The recording with u, v or both of some cameras counted from the other side."""
    points = recording.points.copy()
    for number, (name, camera) in enumerate(recording.cameras.items()):
        own = recording.camera == number
        if name in cameras:
            across = np.array(camera.image_size) - 1.0 - points[own]
            points[own] = np.where(turned, across, points[own])
    return replace(recording, points=points)


def with_lenses(recording: Recording, lenses: dict[str, Camera]) -> Recording:
    """The recording with other camera files."""
    return replace(recording, cameras={**recording.cameras, **lenses})


def _of_all(recording: Recording) -> Iterator[RigReading]:
    """What may be alike of all cameras."""
    names, cameras = tuple(recording.cameras), recording.cameras
    yield RigReading(
        "The distortion coefficients of all cameras seem to have the wrong sign",
        "Export the lenses in OpenCV's convention, or change the signs.",
        names,
        partial(
            with_lenses,
            recording,
            {name: replace(own, distortion=-own.distortion) for name, own in cameras.items()},
        ),
    )
    for turned, how in (
        ((True, False), "mirrored: u is counted from the right"),
        ((False, True), "counted from below"),
    ):
        yield RigReading(
            f"The images of all cameras seem to be {how}",
            "Give the images, or their points, as the cameras recorded them.",
            names,
            partial(seen_otherwise, recording, names, turned),
        )
    pair = next(iter(shared_bars(recording)))
    dataset = recording.pair(*pair)
    for reading in scaled_readings(dataset, [CAMERAS]):
        with suppress(StereocalError):
            after = reading.corrected()
            factors = [
                getattr(after, role).K[0, 0] / getattr(dataset, role).K[0, 0] for role in CAMERAS
            ]
            if not is_near(after):
                continue
            with_centre = after.primary.K[0, 2] != dataset.primary.K[0, 2]
            lenses = {name: scaled(own, factors[0], with_centre) for name, own in cameras.items()}
            what = "images of another size" if with_centre else "lenses of another focal length"
            yield RigReading(
                f"The points of all cameras seem to be measured in {what}: {factors[0]:.3g} times "
                "that of the camera files",
                "Give the points in pixels of the images that the lenses were calibrated for, or "
                "the files of these images.",
                names,
                partial(with_lenses, recording, lenses),
                ESTIMATED_HANDICAP,
            )


def _counted_apart(recording: Recording, name: str, late: int) -> RigReading:
    own, first = recording.camera == [*recording.cameras].index(name), int(recording.frame.min())
    return RigReading(
        f"The frames of camera {name} seem to be counted {abs(late)} apart from those of the "
        f"others: its frame {first + max(late, 0)} is of the same moment as their frame "
        f"{first + max(-late, 0)}",
        "Correct the numbers: this camera has an image less, or one more, at its start.",
        (name,),
        partial(replace, recording, frame=recording.frame - late * own),
        least_gain=SHIFT_GAIN,
    )


def _with_camera_of(recording: Recording, name: str, after: Dataset) -> Recording:
    """The recording with the lens and the points of the second camera of a pair's data."""
    rows, number = after.correspondences, [*recording.cameras].index(name)
    rest = recording.camera != number
    names = list(recording.object.names)
    target = np.array([names.index(each) for each in rows.names], dtype=np.int64)[rows.target]
    return replace(
        recording,
        cameras={**recording.cameras, name: after.secondary},
        frame=np.concatenate([recording.frame[rest], rows.frame]),
        camera=np.concatenate([recording.camera[rest], np.full(len(rows), number)]),
        target=np.concatenate([recording.target[rest], target]),
        points=np.vstack([recording.points[rest], rows.secondary]),
        sigma_px=np.concatenate([recording.sigma_px[rest], rows.sigma_secondary_px]),
    )


def _named(text: str, name: str) -> str:
    """What is said of the second camera of a pair, with its name in the rig."""
    text = text.replace("The secondary camera's", f"The camera {name}'s")
    for words in ("one of the cameras", "one camera"):
        text = text.replace(words, f"camera {name}")
    return text.split(" Which camera it is")[0]
