"""A photograph behind a figure."""

from __future__ import annotations

import base64

import cv2
import numpy as np
import numpy.typing as npt
import plotly.graph_objects as go

Photograph = npt.NDArray[np.uint8]
"""(height, width), grey."""
LARGEST = 1000
"""Longer side of what is drawn, px."""
QUALITY = 85


def add_photograph(
    figure: go.Figure,
    image: Photograph,
    box: tuple[float, float, float, float],
    row: int,
    column: int,
) -> None:
    """Draw the part of a photograph that is in a box behind a panel.

    Args:
        box: left, top, right, bottom in pixels, the centre of the first pixel at (0, 0).
    """
    height, width = image.shape
    left, top = max(int(np.floor(box[0] + 0.5)), 0), max(int(np.floor(box[1] + 0.5)), 0)
    right, bottom = min(int(np.ceil(box[2] + 0.5)), width), min(int(np.ceil(box[3] + 0.5)), height)
    part = image[top:bottom, left:right]
    if not part.size:
        return
    shrink = LARGEST / max(part.shape)
    if shrink < 1:
        part = np.asarray(
            cv2.resize(part, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA), np.uint8
        )
    _, packed = cv2.imencode(".jpg", part, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    source = "data:image/jpeg;base64," + base64.b64encode(packed.tobytes()).decode()
    figure.add_layout_image(
        source=source, x=left - 0.5, y=top - 0.5, sizex=right - left, sizey=bottom - top,
        sizing="stretch", layer="below", row=row, col=column,
    )  # fmt: skip
