"""Checks of a data set and of the first estimate: too few points, no spread, wrong scale."""

import numpy as np

from stereocal.calibration.essential import MINIMUM_PAIRS
from stereocal.errors import StereocalError
from stereocal.rig.camera import camera_in_words
from stereocal.rig.field_of_view import beyond_in_words
from stereocal.rig.geometry import Pose, triangulate_rays
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.system.array_types import BoolArray
from stereocal.system.numbers import count

SMALLEST_SPREAD = 0.01
"""Smallest extent of the points, as a fraction of the image diagonal; less fixes no angle."""

LARGEST_SCALE_ERROR = 1.5
"""Lens errors of several percent change lengths by as much, not by half."""

FEW_PAIRS = 8
MOST_COPIES = 3
"""Warnings about single copied images of a camera."""
SAME_POINTS = 0.2
"""Share of the points of two cameras that are exactly the same where one file was given twice."""
FEW_BARS = 5
"""Five angles need at least five lengths."""


def check_enough_points(dataset: Pair, rows: BoolArray | None = None) -> None:
    """Check that there are enough points and that they are spread over both images.

    Args:
        rows: mask (n,) of the rows to check; all if None.
    """
    table = dataset.correspondences
    count = len(table) if rows is None else int(np.count_nonzero(rows))
    if count < MINIMUM_PAIRS:
        raise StereocalError(
            f"There {'is 1 pair' if count == 1 else f'are {count} pairs'} of points; at least "
            f"{MINIMUM_PAIRS} are needed, and 40 or more (20 frames of the bar) are recommended."
        )
    for which, points, camera in (
        ("primary", table.primary, dataset.primary),
        ("secondary", table.secondary, dataset.secondary),
    ):
        chosen = points if rows is None else points[rows]
        extent = float(np.hypot(*np.ptp(chosen, axis=0)))
        if extent < SMALLEST_SPREAD * float(np.hypot(*camera.image_size)):
            raise StereocalError(
                f"All {count} points of the {which} camera lie within {extent:.1f} px: move the "
                "bar through the whole view and through the depth."
            )


def check_in_front(dataset: Pair, pose: Pose) -> None:
    """Check that all pairs are triangulated in front of both cameras."""
    points = triangulate_rays(pose.R, pose.T, dataset.rays)
    behind = np.flatnonzero(np.isnan(points[:, 0]))
    if len(behind):
        named = "; ".join(dataset.correspondences.name_of(row) for row in behind[:3])
        raise StereocalError(
            f"{len(behind)} of {len(points)} pairs do not meet in front of the cameras ({named}"
            f"{'; and more' if len(behind) > 3 else ''})."
        )


def scale_is_plausible(dataset: Pair, pose: Pose) -> bool:
    """Whether the bar reconstructed with the stated baseline has about its stated length.

    False, for instance, if one of them is in metres and the other in millimetres.
    """
    if not len(dataset.correspondences.bars):
        return True
    with np.errstate(divide="ignore"):  # both ends at one place
        ratio = float(np.median(dataset.bar_distances_m / dataset.reconstructed_lengths_m(pose)))
    return 1 / LARGEST_SCALE_ERROR < ratio < LARGEST_SCALE_ERROR


def warnings_about(dataset: Pair) -> list[str]:
    """Warnings about a data set that can be calibrated but has unusual values."""
    warnings = [note] if (note := beyond_in_words(dataset.recording.beyond_view)) else []
    pairs = len(dataset.correspondences)
    if pairs < FEW_PAIRS:
        warnings.append(
            f"{count(pairs, 'pair')} of points: these are very few, and errors of tens of percent "
            "are possible. Do not measure with this result; record 20 frames or more."
        )
    bars = len(dataset.correspondences.bars)
    if 0 < bars < FEW_BARS:
        warnings.append(
            f"Only {bars} frame{'s have' if bars > 1 else ' has'} both targets: the 3D method "
            f"needs at least {FEW_BARS} to fix the five angles."
        )
    for which, camera in (("primary", dataset.primary), ("secondary", dataset.secondary)):
        if camera.size_factor is not None:
            width, height = camera.image_size
            warnings.append(
                f"The {which} camera's principal point ({camera.K[0, 2]:.0f}, "
                f"{camera.K[1, 2]:.0f}) is far from the centre of its image of {width}x{height} "
                "px. Unless the image was cropped, K and the image size do not belong together."
            )
    return warnings


def warnings_about_copies(dataset: Pair) -> list[str]:
    """Warnings about frames in which one camera alone has exactly the points of another frame."""
    warnings: list[str] = []
    for which, same in dataset.correspondences.half_copies.items():
        warnings += [
            f"The {which} camera's points of frame {frame} are exactly those of frame {first}, the "
            "other camera's are not: was an image copied under another number?"
            for frame, first in [*same.items()][:MOST_COPIES]
        ]
    return warnings


def refuse_same_points(recording: Recording) -> None:
    """Raise an error if two cameras have the same points."""
    frames, images = recording.images()
    names = list(recording.cameras)
    for a in range(len(names)):
        for b in range(a + 1, len(names)):
            one, other = images[:, :, a], images[:, :, b]
            both = np.isfinite(one[..., 0]) & np.isfinite(other[..., 0])
            same = both & (one == other).all(axis=2)
            if same.sum() > max(SAME_POINTS * both.sum(), FEW_PAIRS):
                cameras = camera_in_words(names[a], names[b], begins=True)
                raise StereocalError(
                    f"{cameras} have exactly the same points, as in frame "
                    f"{frames[same.any(axis=1)][0]}: the points of one camera were given for both. "
                    "Give each camera its own."
                )
