"""The colours of two balls that move before a background, for the user to accept."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.detection.ball_colours import LEAST_CHROMA, Colours, eight_bits
from stereocal.detection.balls import CERTAIN, find_balls
from stereocal.detection.sighting import Spot
from stereocal.detection.target import Balls

HUES = [
    f"#{red:02x}{green:02x}{blue:02x}"
    for red, green, blue in itertools.product((0, 128, 255), repeat=3)
    if 0 in (red, green, blue) and 255 in (red, green, blue)
]
"""12 pure colours, 30 degrees of hue apart; a rule takes in 25 to both sides."""
LARGE_PX = 1000
MOVED = 25
"""Grey levels by which a pixel differs from the background."""
AGREEING = 0.6
"""Least part of the photographs in which both balls are found with the colours proposed."""


def proposed_colours(cameras: Sequence[Sequence[npt.NDArray[Any]]]) -> Balls | None:
    """The colours of the two balls, the bar having moved between the photographs.

    Args:
        cameras: of each camera, which stood still, at least three photographs (h, w, 3), blue,
            green, red.

    Returns:
        None if no two colours are found in most of the photographs.
    """
    small = [[_small(image) for image in images] for images in cameras]
    every = [image for images in small for image in images]
    proposals = {target for images in small for target in _pairs(images)}
    right = {
        target: sum(_finds(image, target) for image in every)
        for target in sorted(proposals, key=lambda one: one.colours)
    }
    best = max(right, key=right.__getitem__, default=None)
    return best if best is not None and right[best] >= AGREEING * len(every) else None


def _small(image: npt.NDArray[Any]) -> Colours:
    small = eight_bits(image)
    while max(small.shape) > LARGE_PX:
        half = cv2.resize(small, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        small = np.asarray(half, np.uint8)
    return small


def _finds(image: Colours, target: Balls) -> bool:
    seen = find_balls(image, target)
    return not seen.missing and not any(spot.doubts for spot in seen.spots if spot)


def _pairs(images: Sequence[Colours]) -> Iterator[Balls]:
    """In each photograph, the colours of the two balls that stand out most."""
    if len(images) < 3 or len({image.shape for image in images}) > 1:
        return
    background = np.median(images, axis=0)
    for image in images:
        still = np.abs(image - background).max(axis=2) <= MOVED
        moving = image.copy()
        moving[still] = np.median(image)
        spots = [
            spot
            for hue in HUES
            for own in find_balls(moving, Balls((hue, hue))).candidates
            for spot in own
            if spot.score > CERTAIN
        ]
        spots.sort(key=lambda spot: -spot.score * spot.radius_px)
        for a, b in itertools.islice(itertools.combinations(spots, 2), 3):
            one, other = _colour(image, a), _colour(image, b)
            if one and other and np.hypot(a.u - b.u, a.v - b.v) > a.radius_px + b.radius_px:
                first, second = sorted((one, other))
                yield Balls((first, second))


def _colour(image: Colours, spot: Spot) -> str:
    """The colour of the lit side of a ball; empty for a grey."""
    rows, columns = np.ogrid[: image.shape[0], : image.shape[1]]
    inside = image[np.hypot(rows - spot.v, columns - spot.u) < 0.8 * spot.radius_px]
    chroma = np.ptp(inside, axis=1) if len(inside) else np.zeros(1)
    if chroma.max() < LEAST_CHROMA:
        return ""
    blue, green, red = np.median(inside[chroma >= np.median(chroma)], axis=0).astype(int)
    return f"#{red:02x}{green:02x}{blue:02x}"
