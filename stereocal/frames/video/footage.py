"""Pictures of two cameras, frame by frame: decoded when they are looked at, and stored nowhere."""

import atexit
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.detection.intensity import eight_bits
from stereocal.errors import StereocalError
from stereocal.frames.video.decoding import VideoTimes, encoded_frames, read_times
from stereocal.frames.video.extract import LEAST_SECONDS, VideoPairs, pair_times
from stereocal.rig.camera import CAMERAS, CameraName
from stereocal.system.guarded import Guard
from stereocal.system.latest import Latest
from stereocal.system.photograph import PhotographFile, read_colours

AHEAD = 6
"""Frames of a video that are decoded together: stepping on needs no new search of the file."""
KEPT, GREY_KEPT = 60, 8
JPEG_QUALITY = 92
_GUARD = Guard([read_times, encoded_frames], least_seconds=LEAST_SECONDS)
"""Of all videos; its processes start with the first."""
atexit.register(_GUARD.close)


@dataclass(eq=False)
class Footage:
    """Pictures of both cameras by the numbers of their frames."""

    labels: Mapping[CameraName, str]
    """What the pictures of each camera are called."""
    numbers: list[int]
    """Of the frames that both have, ascending."""
    decode: Callable[[CameraName, int], Mapping[tuple[CameraName, int], bytes]]
    """The picture of a frame, and others that were decoded with it, as JPEG."""
    _pictures: Latest[bytes] = field(default_factory=lambda: Latest(KEPT))
    _grey: Latest[npt.NDArray[np.uint8]] = field(default_factory=lambda: Latest(GREY_KEPT))

    def picture(self, camera: CameraName, number: int) -> bytes:
        """The picture of a frame as JPEG, in colours if it has any."""
        kept = self._pictures.get(f"{camera} {number}")
        if kept is None:
            found = self.decode(camera, number)
            for (which, each), content in found.items():
                self._pictures.keep(f"{which} {each}", content)
            kept = found.get((camera, number), b"")
        if not kept:
            raise StereocalError(f"{self.labels[camera]}: frame {number} cannot be decoded.")
        return kept

    def grey(self, camera: CameraName, number: int) -> npt.NDArray[np.uint8]:
        """(h, w): the picture in 8 bits of grey."""

        def decoded() -> npt.NDArray[np.uint8]:
            content = np.frombuffer(self.picture(camera, number), np.uint8)
            return np.asarray(cv2.imdecode(content, cv2.IMREAD_GRAYSCALE), np.uint8)

        return self._grey.once(f"{camera} {number}", decoded)


def of_videos(
    paths: Mapping[CameraName, Path], labels: Mapping[CameraName, str], later_frames: float = 0.0
) -> Footage:
    """The frames of two videos that belong together; numbers count those of the primary from 1.

    Args:
        later_frames: by how many frames of the primary the secondary's video was started later.
    """
    times: dict[CameraName, VideoTimes] = {
        each: _GUARD.read(read_times, paths[each], labels[each]) for each in CAMERAS
    }
    first, second = (times[each].seconds for each in CAMERAS)
    later_s = second[0] - first[0] - later_frames * float(np.median(np.diff(first)))
    pairs = pair_times(first, second, later_s)
    numbers = [int(number) for number in pairs.numbers]

    def decode(_: CameraName, number: int) -> Mapping[tuple[CameraName, int], bytes]:
        first = numbers.index(number)
        rows = slice(first, first + AHEAD)
        found: dict[tuple[CameraName, int], bytes] = {}
        with ThreadPoolExecutor(2) as threads:
            both = threads.map(lambda each: _decoded(each, rows, paths, times, pairs), CAMERAS)
            for camera, own in zip(CAMERAS, both, strict=True):
                keys = ((camera, number) for number in numbers[rows])
                found |= dict(zip(keys, (content or b"" for content in own), strict=True))
        return found

    return Footage(labels, numbers, decode)


def _decoded(
    camera: CameraName,
    rows: slice,
    paths: Mapping[CameraName, Path],
    times: Mapping[CameraName, VideoTimes],
    pairs: VideoPairs,
) -> list[bytes | None]:
    at = pairs.frames[rows, CAMERAS.index(camera)]
    seconds = times[camera].seconds[at].tolist()
    path = paths[camera]
    found: list[bytes | None] = _GUARD.read(encoded_frames, path, path.name, seconds, False, True)
    return found


def of_photographs(
    files: Mapping[int, Mapping[CameraName, PhotographFile]], labels: Mapping[CameraName, str]
) -> Footage:
    """Photographs of both cameras, by frame."""

    def decode(camera: CameraName, number: int) -> Mapping[tuple[CameraName, int], bytes]:
        image = eight_bits(read_colours(files[number][camera], f"{labels[camera]}, {number}"))
        content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
        return {(camera, number): content.tobytes()}

    return Footage(labels, sorted(files), decode)
