"""Points that a fisheye images farther from its axis than it is used: left out, and counted."""

from collections.abc import Iterable, Mapping

import numpy as np

from stereocal.errors import StereocalError
from stereocal.rig.camera import CAMERAS, Camera, camera_in_words, one_file_in_words
from stereocal.rig.fisheye import LARGEST_ANGLE
from stereocal.system.array_types import BoolArray, FloatArray
from stereocal.system.numbers import count

DEGREES = round(float(np.degrees(LARGEST_ANGLE)))
MOST_BEYOND = 0.5
"""Share of a camera's points beyond which its file is taken to be wrong. A fisheye of 180 degrees
sees a third of a half-sphere's area beyond 75 degrees, and bars are carried in the middle."""


def beyond_view(
    camera: Camera, pixels: FloatArray, name: str, cameras: Iterable[Camera] = ()
) -> BoolArray:
    """(n,): whether pixels (n, 2) are farther from the axis of a fisheye than can be used.

    Args:
        cameras: all, of which two may have one file.

    Raises:
        StereocalError: more than half of them are.
    """
    if not (camera.is_fisheye and len(pixels)):
        return np.zeros(len(pixels), dtype=np.bool_)
    beyond = ~camera.uses(camera.undistort(pixels))
    if beyond.mean() > MOST_BEYOND:
        raise StereocalError(
            f"{one_file_in_words(cameras)}The fisheye of {camera_in_words(name)} images "
            f"{beyond.sum()} of {len(beyond)} points more than {DEGREES} degrees from its axis, "
            f"the most that can be used (a field of view of {2 * DEGREES}): check its camera file."
        )
    return beyond


def count_beyond(camera: Camera, pixels: FloatArray) -> int:
    """How many of pixels (n, 2) are farther from the axis of a fisheye than can be used."""
    seen = pixels[np.isfinite(pixels).all(axis=1)]
    if not camera.is_fisheye:
        return 0
    return int(np.count_nonzero(~camera.uses(camera.undistort(seen))))


def beyond_either(
    cameras: tuple[Camera, Camera], pixels: tuple[FloatArray, FloatArray]
) -> tuple[BoolArray, dict[str, int]]:
    """(n,): which points, in pixels (n, 2) of each, are beyond the view of the primary or the
    secondary camera, and how many by its name.

    Raises:
        StereocalError: as `beyond_view`.
    """
    three = zip(CAMERAS, cameras, pixels, strict=True)
    beyond = {name: beyond_view(camera, points, name, cameras) for name, camera, points in three}
    lost: BoolArray = np.any([*beyond.values()], axis=0)
    return lost, {name: int(is_beyond.sum()) for name, is_beyond in beyond.items()}


def beyond_in_words(beyond: Mapping[str, int]) -> str:
    """What was left out, by the camera's name; empty if nothing was."""
    parts = [f"{count(n, 'point')} of {camera_in_words(name)}" for name, n in beyond.items() if n]
    if not parts:
        return ""
    return (
        f"Left out: {' and '.join(parts)}, more than {DEGREES} degrees from the axis of the "
        f"fisheye. It is used to a field of view of {2 * DEGREES} degrees."
    )
