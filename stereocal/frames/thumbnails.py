"""Thumbnails of a frame: the targets and their surroundings in both photographs."""

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.detection.intensity import eight_bits
from stereocal.frames.frame import CentrePair
from stereocal.system.array_types import FloatArray
from stereocal.system.photograph import GreyImage

WIDTH, HEIGHT = 240, 180
"""Size of one photograph's tile, px."""
COLOURS = ((115, 158, 0), (167, 121, 204))
"""Targets A and B, as in all figures (Okabe-Ito green and pink), BGR."""
Tile = npt.NDArray[np.uint8]


def tile(image: GreyImage | None, centres: CentrePair) -> Tile:
    """(180, 240, 3): the photograph around its targets, each marked with a cross and a letter.

    Without targets the whole photograph; without a photograph plain grey.
    """
    if image is None:
        return np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
    left, top, right, bottom = box_around(centres, image.shape)
    part = image[top:bottom, left:right]
    scale = min(WIDTH / part.shape[1], HEIGHT / part.shape[0])
    size = max(1, round(part.shape[1] * scale)), max(1, round(part.shape[0] * scale))
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_NEAREST
    drawn = cv2.cvtColor(eight_bits(cv2.resize(part, size, interpolation=how)), cv2.COLOR_GRAY2BGR)
    for letter, colour, centre in zip("AB", COLOURS, centres, strict=True):
        if centre:
            # Pixel centres are at integers.
            corner = ((centre.u, left), (centre.v, top))
            x, y = (round((coordinate - first + 0.5) * scale - 0.5) for coordinate, first in corner)
            for ink, width in (((0, 0, 0), 4), (colour, 2)):  # an outline, visible on white too
                cv2.drawMarker(drawn, (x, y), ink, cv2.MARKER_CROSS, 15, width)
                font = cv2.FONT_HERSHEY_SIMPLEX
                cv2.putText(drawn, letter, (x + 9, y - 7), font, 0.55, ink, width, cv2.LINE_AA)
    whole = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    y, x = (HEIGHT - drawn.shape[0]) // 2, (WIDTH - drawn.shape[1]) // 2
    whole[y : y + drawn.shape[0], x : x + drawn.shape[1]] = drawn
    return whole


def board_tile(image: GreyImage | None, corners: FloatArray) -> Tile:
    """(180, 240, 3): the whole photograph, with the corners (n, 2) of a board as dots, the first
    one ringed."""
    drawn = tile(image, (None, None))
    if image is None:
        return drawn
    scale = min(WIDTH / image.shape[1], HEIGHT / image.shape[0])
    margin = np.array([WIDTH, HEIGHT]) - scale * np.array(image.shape[::-1])
    for number, corner in enumerate((corners + 0.5) * scale + 0.5 * margin):
        where, colour = tuple(np.round(16 * corner).astype(int).tolist()), COLOURS[number == 0]
        cv2.circle(drawn, where, 24, colour, -1, cv2.LINE_AA, 4)
        if number == 0:
            cv2.circle(drawn, where, 80, colour, 1, cv2.LINE_AA, 4)
    return drawn


def side_by_side(primary: Tile, secondary: Tile) -> bytes:
    """Both tiles as one JPEG, the primary on the left."""
    gap = np.full((HEIGHT, 4, 3), 128, np.uint8)
    done, content = cv2.imencode(".jpg", np.hstack([primary, gap, secondary]))
    assert done  # an 8-bit array of a fixed size
    return bytes(content)


def box_around(centres: CentrePair, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of the part of an image to show, in whole pixels.

    The aspect ratio is a tile's where possible, the margin half the distance of the targets.
    """
    height, width = shape[:2]
    points = np.array([(c.u, c.v) for c in centres if c and np.isfinite([c.u, c.v]).all()])
    if not len(points):
        return 0, 0, width, height
    low, high = points.min(axis=0), points.max(axis=0)
    margin = max(0.5 * float(np.linalg.norm(high - low)), 60.0)
    reach = (high - low) / 2 + margin
    reach = np.maximum(reach, reach[::-1] * np.array([WIDTH / HEIGHT, HEIGHT / WIDTH]))
    # Shift the box into the image, as far as the image is large enough.
    middle = np.clip((low + high) / 2, reach, np.maximum((width, height) - reach, reach))
    left, top = np.clip(middle - reach, 0, (width - 1, height - 1)).astype(int)
    right, bottom = np.clip(middle + reach + 1, (left + 1, top + 1), (width, height)).astype(int)
    return int(left), int(top), int(right), int(bottom)
