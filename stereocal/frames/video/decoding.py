"""Read a video with PyAV (`pip install "stereocal[video]"`): time stamps, sharpness, frames.

These functions run in child processes (`system.guarded`), since they run native code on untrusted
files. Times are in seconds, as the file states them.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from stereocal.errors import StereocalError
from stereocal.system.array_types import FloatArray
from stereocal.system.limits import Limits
from stereocal.system.photograph import GreyImage

SUFFIXES = (".mp4", ".avi", ".mov", ".mkv")
OPTIONS = {
    "format_whitelist": "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi",
    "protocol_whitelist": "file",
}
"""Playlists and other formats that open further files or addresses are not read."""
MOST_FRAMES = 2_000_000
WIDTH_FOR_SHARPNESS, WIDTH_FOR_MOTION = 960, 240
"""Pixels to which frames are reduced before they are compared."""
JPEG_QUALITY = 95
APART_S = 2.0


@dataclass(frozen=True, eq=False)
class VideoTimes:
    """The frames of a video, without their pixels."""

    seconds: FloatArray
    """(n,): time stamps, ascending."""
    width: int
    height: int


def read_times(path: Path) -> VideoTimes:
    """The time stamps of all frames; nothing is decoded."""
    with opened(path) as (container, stream):
        stamps: list[float] = []
        for packet in container.demux(stream):
            if packet.size == 0 or packet.is_discard:  # a dropped frame of an AVI; the end
                continue
            stamp = packet.dts if packet.pts is None else packet.pts
            if stamp is None:
                raise StereocalError(
                    f"{path.name}: its frames have no time stamps; convert it to MP4 or MKV."
                )
            stamps.append(float(stamp * stream.time_base))
            if len(stamps) > MOST_FRAMES:
                raise StereocalError(f"{path.name}: it has more than {MOST_FRAMES} frames.")
        seconds = np.unique(np.array(stamps))
        if len(seconds) < 2:
            raise StereocalError(f"{path.name}: it has {len(seconds)} frames, two are needed.")
        return VideoTimes(seconds, stream.codec_context.width, stream.codec_context.height)


def score_frames(path: Path, first: float, last: float) -> FloatArray:
    """(n, 3): time, sharpness and motion of the frames between two times, in seconds.

    Sharpness is the variance of the Laplacian; motion the larger mean difference of grey values
    from the frame before and the frame after.
    """
    times, sharpness, small = [], [], []
    with opened(path) as (container, stream):
        for time, image in _frames(container, stream, first, last):
            times.append(time)
            reduced = _reduced(image, WIDTH_FOR_SHARPNESS)
            sharpness.append(float(cv2.Laplacian(reduced, cv2.CV_64F).var()))
            small.append(_reduced(reduced, WIDTH_FOR_MOTION).astype(np.float32))
    steps = [float(np.abs(a - b).mean()) for a, b in pairwise(small)]
    if not steps:
        return np.zeros((0, 3))
    motion = np.maximum([*steps[:1], *steps], [*steps, *steps[-1:]])
    return np.column_stack([times, sharpness, motion])


def encoded_frames(
    path: Path, seconds: Sequence[float], lossless: bool, coloured: bool = False
) -> list[bytes | None]:
    """The frames at these ascending time stamps as PNG, or JPEG if not `lossless`, grey or not.

    None for a frame that cannot be decoded.
    """
    encoded: list[bytes | None] = [None] * len(seconds)
    with opened(path) as (container, stream):
        # Over larger steps, the file is searched again.
        steps = np.flatnonzero(np.diff(np.asarray(seconds)) > APART_S) + 1
        for start, stop in pairwise([0, *steps.tolist(), len(seconds)]):
            wanted = np.array(seconds[start:stop])
            for time, image in _frames(container, stream, wanted[0], wanted[-1], coloured):
                k = int(np.abs(wanted - time).argmin())
                if abs(wanted[k] - time) < 1e-6:
                    encoded[start + k] = _encoded(image, lossless)
    return encoded


@contextmanager
def opened(path: Path) -> Iterator[tuple[Any, Any]]:
    """The file and its first video stream."""
    try:
        import av
    except ImportError as error:
        raise StereocalError(
            f"{path.name}: to read videos, the package av is needed, which is not installed: pip "
            'install "stereocal[video]", or give photographs.'
        ) from error
    try:
        with av.open(str(path), options=OPTIONS) as container:
            if not container.streams.video:
                raise StereocalError(f"{path.name}: there is no video in the file.")
            stream = container.streams.video[0]
            width, height = stream.codec_context.width, stream.codec_context.height
            if width < 1 or height < 1:
                raise StereocalError(f"{path.name}: its images have no size.")
            Limits.from_environment().check_pixels(width, height, path.name)
            yield container, stream
    except (av.FFmpegError, OSError, ValueError, OverflowError) as error:
        if isinstance(error, StereocalError):
            raise
        raise StereocalError(
            f"{path.name}: this video is damaged or of a kind that is not read (MP4, MOV, MKV or "
            "AVI): copy it again, or convert it."
        ) from error


def _frames(
    container: Any, stream: Any, first: float, last: float, coloured: bool = False
) -> Iterator[tuple[float, GreyImage]]:
    """Time and grey values, or blue, green and red, of the frames from `first` to `last`."""
    stream.codec_context.flush_buffers()
    container.seek(int(first / float(stream.time_base)), stream=stream, backward=True)
    form = "gray16le" if stream.codec_context.format.components[0].bits > 8 else "gray"
    form = "bgr24" if coloured else form
    for frame in container.decode(stream):
        stamp = frame.dts if frame.pts is None else frame.pts
        if stamp is None:
            continue
        time = float(stamp * stream.time_base)
        if time > last + 1e-9:
            return
        if time >= first - 1e-9:
            yield time, frame.to_ndarray(format=form)


def _reduced(image: GreyImage, width: int) -> Any:
    if image.shape[1] <= width:
        return image
    height = max(image.shape[0] * width // image.shape[1], 1)
    return cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)


def _encoded(image: GreyImage, lossless: bool) -> bytes:
    suffix = ".png" if lossless or image.dtype != np.uint8 else ".jpg"
    how = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY] if suffix == ".jpg" else []
    done, content = cv2.imencode(suffix, image, how)
    if not done:
        raise StereocalError("A frame of the video cannot be stored as an image.")
    return content.tobytes()
