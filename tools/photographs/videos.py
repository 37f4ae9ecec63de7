"""Small videos: frame k shows its number as a bar of grey, or what is drawn for it; with sound."""

from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from stereocal.system.array_types import FloatArray
from stereocal.system.photograph import GreyImage

WIDTH, HEIGHT = 160, 96
TICKS = 90_000
"""Units of a time stamp in a second."""
HERTZ = 16_000


def picture(number: int) -> GreyImage:
    """A frame that shows its number in ten squares, with a fine pattern below."""
    image = np.full((HEIGHT, WIDTH), 40, dtype=np.uint8)
    for bit in range(10):
        image[:16, 16 * bit : 16 * bit + 16] = 220 if number >> bit & 1 else 30
    image[48:, ::4] = 200
    return image


def number_in(image: GreyImage) -> int:
    """The number that a frame shows."""
    return sum(
        1 << bit for bit in range(10) if image[4:12, 16 * bit + 4 : 16 * bit + 12].mean() > 120
    )


def write_video(
    path: Path,
    seconds: Sequence[float],
    draw: Callable[[int], GreyImage] = picture,
    numbers: Sequence[int] | None = None,
    preset: str = "medium",
    sound: FloatArray | None = None,
) -> Path:
    """A video with these time stamps; frame k shows `numbers[k]`, or k, in grey or colours.

    Args:
        sound: samples, `HERTZ` a second.
        preset: how much libx264 computes for a small file; `ultrafast` has no B-frames.
    """
    import av

    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("libx264", rate=30)
        if sound is not None:
            heard: Any = container.add_stream("aac", rate=HERTZ, layout="mono")
        stream.height, stream.width = draw(0).shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.options = {"crf": "12", "preset": preset}
        stream.time_base = stream.codec_context.time_base = Fraction(1, TICKS)
        stream.codec_context.gop_size = 12
        for k, time in enumerate(seconds):
            grey = draw(k if numbers is None else numbers[k])
            colours: Any = grey if grey.ndim == 3 else np.repeat(grey[:, :, None], 3, axis=2)
            frame = av.VideoFrame.from_ndarray(colours, "rgb24")
            frame = frame.reformat(format="yuv420p")
            frame.pts, frame.time_base = round(time * TICKS), Fraction(1, TICKS)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
        if sound is not None:
            samples = av.AudioFrame.from_ndarray(sound[None].astype(np.float32), "flt", "mono")
            samples.sample_rate = HERTZ
            container.mux([*heard.encode(samples), *heard.encode(None)])
    return path
