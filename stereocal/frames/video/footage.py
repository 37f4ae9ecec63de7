"""Pictures of several cameras, frame by frame: decoded when looked at, and stored nowhere."""

import atexit
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.detection.intensity import eight_bits
from stereocal.errors import StereocalError
from stereocal.frames.video.decoding import encoded_frames, read_times
from stereocal.frames.video.extract import LEAST_SECONDS
from stereocal.frames.video.time_stamps import pair_times
from stereocal.system.guarded import Guard
from stereocal.system.latest import Latest
from stereocal.system.photograph import PhotographFile, read_colours

AHEAD = 6
"""Frames of a video that are decoded together: stepping on needs no new search of the file."""
KEPT, GREY_KEPT = 60, 8
JPEG_QUALITY = 92
_GUARD = Guard([read_times, encoded_frames], least_seconds=LEAST_SECONDS)
"""The guard of all videos; its processes start with the first."""
atexit.register(_GUARD.close)


Pictures = Mapping[tuple[str, int], bytes]
"""Pictures by camera and frame, as JPEG."""


@dataclass(eq=False)
class Footage:
    """Pictures of the cameras by the numbers of their frames."""

    labels: Mapping[str, str]
    """What the pictures of each camera are called."""
    numbers: list[int]
    """The numbers of the frames that all have, ascending."""
    decode: Callable[[str, int], Pictures]
    """The picture of a frame, and others that were decoded with it."""
    _pictures: Latest[bytes] = field(default_factory=lambda: Latest(KEPT))
    _grey: Latest[npt.NDArray[np.uint8]] = field(default_factory=lambda: Latest(GREY_KEPT))

    def picture(self, camera: str, number: int) -> bytes:
        """The picture of a frame as JPEG, in colours if it has any."""
        kept = self._pictures.get(f"{camera} {number}")
        if kept is None:
            pictures = self.decode(camera, number)
            for (which, frame_number), content in pictures.items():
                self._pictures.keep(f"{which} {frame_number}", content)
            kept = pictures.get((camera, number), b"")
        if not kept:
            raise StereocalError(f"{self.labels[camera]}: frame {number} cannot be decoded.")
        return kept

    def grey(self, camera: str, number: int) -> npt.NDArray[np.uint8]:
        """(h, w): the picture in 8 bits of grey."""

        def decoded() -> npt.NDArray[np.uint8]:
            content = np.frombuffer(self.picture(camera, number), np.uint8)
            return np.asarray(cv2.imdecode(content, cv2.IMREAD_GRAYSCALE), np.uint8)

        return self._grey.once(f"{camera} {number}", decoded)


def of_videos(
    paths: Mapping[str, Path],
    labels: Mapping[str, str],
    later_frames: Mapping[str, float] = MappingProxyType({}),
) -> Footage:
    """The frames of videos that belong together; numbers count those of the first from 1.

    Args:
        later_frames: by how many frames of the first each other video was started later.
    """
    read = _GUARD.read_all(read_times, [(path, labels[camera]) for camera, path in paths.items()])
    times = {camera: video.seconds for camera, video in zip(paths, read, strict=True)}
    first, *others = paths
    step_s, pairs = float(np.median(np.diff(times[first]))), {}
    for camera in others:
        later_s = times[camera][0] - times[first][0] - later_frames.get(camera, 0.0) * step_s
        pairs[camera] = pair_times(times[first], times[camera], later_s)
    partners = {camera: dict(paired.frames.tolist()) for camera, paired in pairs.items()}
    counted = pairs[others[0]]
    numbered = dict(zip(counted.frames[:, 0].tolist(), counted.numbers.tolist(), strict=True))
    common = [
        frame for frame in numbered if all(frame in partner_of for partner_of in partners.values())
    ]
    if not common:
        raise StereocalError("The videos have no frames of the same moment.")
    numbers = [numbered[frame] for frame in common]
    frames = {
        first: common,
        **{e: [partner_of[frame] for frame in common] for e, partner_of in partners.items()},
    }

    def decode(_: str, number: int) -> Pictures:
        start = numbers.index(number)
        rows = slice(start, start + AHEAD)
        calls = [
            (path, labels[camera], times[camera][frames[camera][rows]].tolist(), False, True)
            for camera, path in paths.items()
        ]
        return {
            (camera, frame_number): content or b""
            for camera, contents in zip(paths, _GUARD.read_all(encoded_frames, calls), strict=True)
            for frame_number, content in zip(numbers[rows], contents, strict=True)
        }

    return Footage(labels, numbers, decode)


def of_photographs(
    files: Mapping[int, Mapping[str, PhotographFile]], labels: Mapping[str, str]
) -> Footage:
    """Photographs by frame and camera; frames that a camera has none of are left out."""

    def decode(camera: str, number: int) -> Pictures:
        image = eight_bits(read_colours(files[number][camera], f"{labels[camera]}, {number}"))
        content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
        return {(camera, number): content.tobytes()}

    whole = sorted(number for number, by_camera in files.items() if {*labels} <= {*by_camera})
    return Footage(labels, whole, decode)
