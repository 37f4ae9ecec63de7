"""A photograph behind a figure."""

from __future__ import annotations

import base64
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

Photograph = npt.NDArray[np.uint8]
"""(height, width), grey."""
LARGEST = 1000
"""Longer side of what is drawn, px."""
QUALITY = 85


def photograph_behind(
    image: Photograph, box: tuple[float, float, float, float], number: str = ""
) -> list[dict[str, Any]]:
    """The part of a photograph that is in a box behind a panel, for `layout.images`; none outside.

    Args:
        box: left, top, right, bottom in pixels, the centre of the first pixel at (0, 0).
        number: of the panel's axes.
    """
    height, width = image.shape
    left, top = (max(int(np.floor(end + 0.5)), 0) for end in box[:2])
    right, bottom = min(int(np.ceil(box[2] + 0.5)), width), min(int(np.ceil(box[3] + 0.5)), height)
    part = image[top:bottom, left:right]
    if not part.size:
        return []
    shrink = LARGEST / max(part.shape)
    if shrink < 1:
        part = np.asarray(
            cv2.resize(part, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA), np.uint8
        )
    _, packed = cv2.imencode(".jpg", part, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    source = "data:image/jpeg;base64," + base64.b64encode(packed.tobytes()).decode()
    place = {"x": left - 0.5, "y": top - 0.5, "sizex": right - left, "sizey": bottom - top}
    axes = {"xref": f"x{number}", "yref": f"y{number}"}
    return [{"source": source, "sizing": "stretch", "layer": "below", **place, **axes}]
