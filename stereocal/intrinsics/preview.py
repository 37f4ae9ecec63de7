"""Previews of a board photograph: with its corners marked, and undistorted."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.intrinsics.board_corners import eight_bits
from stereocal.intrinsics.boards import BoardView
from stereocal.rig.camera import Camera
from stereocal.system.photograph import FileContent, read_photograph

WIDTH = 900
ORANGE_BGR = (0, 159, 230)


def preview(path: FileContent, camera: Camera, view: BoardView | None) -> tuple[bytes, bytes]:
    """Two JPEG images: the photograph with the found corners marked, and undistorted (same K)."""
    grey = eight_bits(read_photograph(path))
    if camera.is_fisheye:
        undistorted = cv2.fisheye.undistortImage(grey, camera.K, camera.distortion, Knew=camera.K)
    else:
        undistorted = cv2.undistort(grey, camera.K, camera.distortion)
    scale = WIDTH / grey.shape[1]
    marked = cv2.cvtColor(_small(grey, scale), cv2.COLOR_GRAY2BGR)
    corners = np.empty((0, 2)) if view is None else view.corners
    for u, v in (corners + 0.5) * scale:
        cv2.circle(marked, (int(16 * u), int(16 * v)), 16 * 4, ORANGE_BGR, 1, cv2.LINE_AA, 4)
    return _jpeg(marked), _jpeg(_small(np.asarray(undistorted, dtype=np.uint8), scale))


def _small(image: npt.NDArray[np.uint8], scale: float) -> npt.NDArray[np.uint8]:
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=how), np.uint8)


def _jpeg(image: npt.NDArray[Any]) -> bytes:
    return bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 85])[1])
