"""New images that are crops of those of the parameters: all points are counted from another corner.

A turn of a camera moves its points by nearly the same in the middle of the images, but not in their
corners: of a turn by 2 degrees, 3 % more at 30 degrees from the axis.
"""

from collections.abc import Iterator
from contextlib import suppress

import numpy as np
from scipy.optimize import least_squares

from stereocal.errors import StereocalError
from stereocal.field.checking.new_images import NewImages
from stereocal.rig.camera import CAMERAS
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray

SMALLEST_PX = 4.0
"""That are cut off: lenses shift by less."""
LENGTH_SPREAD = 0.01
"""Relative error of a length that weighs as much as an error of a pixel."""
LARGE = 1e3
"""Misfit of a bar behind a camera."""


def uncropped(images: NewImages, rig: Rig) -> Iterator[NewImages]:
    """The images of bars as they would be if those of one camera, or of both alike, had been
    cropped, with what was cut off noted; none where that is next to nothing."""
    rows = images.dataset.correspondences
    pixels = rows.primary, rows.secondary

    def misfits(cut_px: FloatArray, is_cropped: tuple[bool, bool]) -> FloatArray:
        primary, secondary = (px + cut_px * of for px, of in zip(pixels, is_cropped, strict=True))
        ends = rig.reconstruct(primary, secondary)[rows.bars]
        lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / images.dataset.bar_distances_m
        off_px = rig.epipolar_errors(primary, secondary)
        off = np.append(off_px, (lengths - 1.0) / LENGTH_SPREAD)
        return np.asarray(np.nan_to_num(off, nan=LARGE))

    for is_cropped in ((True, False), (False, True), (True, True)):
        cut_px = least_squares(misfits, np.zeros(2), loss="soft_l1", args=(is_cropped,)).x
        if np.linalg.norm(cut_px) > SMALLEST_PX:
            names = [name for name, is_it in zip(CAMERAS, is_cropped, strict=True) if is_it]
            with suppress(StereocalError):  # points outside the whole images
                yield images.uncropped(names, cut_px)
