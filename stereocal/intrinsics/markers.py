"""ArUco and AprilTag markers of any usual dictionary in a photograph.

OpenCV compares every dark quadrangle with all markers of a dictionary, and that takes a hundred
times as long as it takes to find the quadrangles: 0.5 s for each dictionary before a chessboard.
Which dictionaries may be there is therefore decided first, by the bits of the quadrangles; OpenCV
reads only these.
"""

from functools import cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.intrinsics.board_corners import LARGE_PX, halved
from stereocal.system.array_types import BoolArray, FloatArray, IntArray

DICTIONARIES = ("4X4_250", "5X5_250", "6X6_250", "7X7_250", "APRILTAG_36h11")
"""Those in which markers are looked for; smaller ones are parts of these. Those of 1000 take four
times as long and have the same first 250 markers."""
CELL_PX = 4
"""Side of a bit in which a quadrangle is read, as OpenCV does."""
LEAST_SPREAD = 5.0
"""Grey levels; a quadrangle with less is of one colour."""
WHITE_BORDER, CORRECTED, SPARE = 0.35, 0.6, 1
"""OpenCV's limits: bits of the border that may be white, over those of the marker; wrong bits over
those that the dictionary corrects. And how many more may be wrong here."""
Markers = dict[str, tuple[IntArray, FloatArray]]
"""By dictionary: the numbers (n,) and corners (n, 4, 2) px of the markers."""
Grey = npt.NDArray[np.uint8]


def markers_in(grey: Grey) -> Markers:
    """The markers in a photograph, at half the size of a large one."""
    scale, markers = 1.0, dict[str, tuple[IntArray, FloatArray]]()
    if max(grey.shape) > LARGE_PX:
        grey, scale = halved(grey), 2.0
    seen = _quadrangles(grey)
    for name in DICTIONARIES:
        if not _may_be(name, grey, seen):
            continue
        corners, numbers, _ = cv2.aruco.ArucoDetector(_printed(name)).detectMarkers(grey)
        if numbers is not None:
            four = np.array(corners, dtype=np.float64).reshape(-1, 4, 2)
            ids = np.asarray(numbers, dtype=np.int64).ravel()
            markers[name] = ids, scale * four + 0.5 * (scale - 1.0)
    return markers


@cache
def _printed(name: str) -> Any:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))


@cache
def _words(name: str) -> npt.NDArray[np.float32]:
    """(4 n, bits): 1 and -1 for the white and the black bits of each marker in its four turns."""
    printed = _printed(name)
    bits = np.array(
        [
            cv2.aruco.Dictionary.getBitsFromByteList(marker[None], printed.markerSize)
            for marker in printed.bytesList
        ],
        dtype=np.float32,
    )
    turned = [np.rot90(bits, turn, axes=(1, 2)).reshape(len(bits), -1) for turn in range(4)]
    return np.asarray(2.0 * np.concatenate(turned) - 1.0, dtype=np.float32)


def _quadrangles(grey: Grey) -> list[FloatArray]:
    """The corners (4, 2) px of all that may be a marker, also of those that nearly coincide."""
    every = cv2.aruco.DetectorParameters()
    every.minMarkerDistanceRate = every.minGroupDistance = 0.0
    one = cv2.aruco.Dictionary(_printed(DICTIONARIES[0]).bytesList[:1], 4, 0)
    read, _, others = cv2.aruco.ArucoDetector(one, every).detectMarkers(grey)
    return [np.asarray(four, dtype=np.float64).reshape(4, 2) for four in (*read, *others)]


def _may_be(name: str, grey: Grey, seen: list[FloatArray]) -> bool:
    """Whether the bits of a quadrangle are nearly those of a marker of a dictionary."""
    printed = _printed(name)
    bits = [inner for four in seen if (inner := _bits(grey, four, printed.markerSize)) is not None]
    if not bits:
        return False
    agreeing = _words(name) @ (2.0 * np.array(bits, dtype=np.float32) - 1.0).T
    wrong = 0.5 * (printed.markerSize**2 - float(agreeing.max()))
    return bool(wrong <= CORRECTED * printed.maxCorrectionBits + SPARE)


def _bits(grey: Grey, four: FloatArray, size: int) -> BoolArray | None:
    """(size²,): which bits within a quadrangle are white; None without a black border."""
    cells = size + 2
    end = cells * CELL_PX - 1.0
    square = np.array([[0.0, 0.0], [end, 0.0], [end, end], [0.0, end]], dtype=np.float32)
    to_square = cv2.getPerspectiveTransform(four.astype(np.float32), square)
    sides = (cells * CELL_PX, cells * CELL_PX)
    part = cv2.warpPerspective(grey, to_square, sides, flags=cv2.INTER_NEAREST)
    half = CELL_PX // 2
    if part[half:-half, half:-half].std() < LEAST_SPREAD:
        return None
    _, white = cv2.threshold(part, 0, 1, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    counts = white.reshape(cells, CELL_PX, cells, CELL_PX).sum(axis=(1, 3))
    bits = counts > CELL_PX**2 // 2
    inner = bits[1:-1, 1:-1]
    if bits.sum() - inner.sum() > WHITE_BORDER * size**2 + SPARE:
        return None
    return np.asarray(inner.ravel())
