"""What can be wrong with a data set as a whole, found before anyone trusts a result."""

from __future__ import annotations

import numpy as np

from stereocal.compiled import BoolArray
from stereocal.dataset import Dataset
from stereocal.errors import StereocalError
from stereocal.essential import MINIMUM_PAIRS
from stereocal.geometry import Pose, triangulate_rays

SMALLEST_SPREAD = 0.01
"""Points within 1 % of the image's diagonal are in one place: they fix no angle."""

LARGEST_SCALE_ERROR = 1.5
"""Lens errors of several percent move lengths by as much, never by half."""

SURELY_EXCHANGED = 1.5
MAYBE_EXCHANGED = 1.15

BARS_TO_TELL = 10
"""Five angles fit the lengths of five bars, and five pairs, whatever the cameras."""

FEW_PAIRS = 8
FEW_BARS = 5
"""Five angles cannot be found from fewer lengths."""


def check_points(dataset: Dataset, rows: BoolArray | None = None) -> None:
    """Refuse too few points, and points all in one place; of all rows, or of some (n,).

    Raises:
        StereocalError: as said.
    """
    table = dataset.correspondences
    count = len(table) if rows is None else int(np.count_nonzero(rows))
    if count < MINIMUM_PAIRS:
        raise StereocalError(
            f"There {'is 1 pair' if count == 1 else f'are {count} pairs'} of points; at "
            f"least {MINIMUM_PAIRS} are needed, and 40 or more are wise (20 frames of the bar)."
        )
    for which, points, camera in (
        ("primary", table.primary, dataset.primary),
        ("secondary", table.secondary, dataset.secondary),
    ):
        chosen = points if rows is None else points[rows]
        extent = float(np.hypot(*np.ptp(chosen, axis=0)))
        if extent < SMALLEST_SPREAD * float(np.hypot(*camera.image_size)):
            raise StereocalError(
                f"All {count} points of the {which} camera lie in one place, within "
                f"{extent:.1f} px: move the bar through the whole view and through the depth."
            )


def check_in_front(dataset: Dataset, pose: Pose) -> None:
    """Refuse pairs that meet behind a camera: they are no pictures of one point.

    Raises:
        StereocalError: names the first three.
    """
    points = triangulate_rays(pose.R, pose.T, dataset.rays)
    behind = np.flatnonzero(np.isnan(points[:, 0]))
    if len(behind):
        named = "; ".join(dataset.correspondences.name_of(row) for row in behind[:3])
        raise StereocalError(
            f"{len(behind)} of {len(points)} pairs do not meet in front of the cameras ({named}"
            f"{'; and more' if len(behind) > 3 else ''}): look whether A and B are exchanged "
            "there, or leave these frames out."
        )


def check_scale(dataset: Dataset, pose: Pose) -> None:
    """Refuse a baseline and a distance that contradict each other, such as metres and millimetres.

    Raises:
        StereocalError: says which length the images expect.
    """
    if not len(dataset.correspondences.bars):
        return
    ratio = float(np.median(dataset.bar_distances_m / dataset.reconstructed_lengths_m(pose)))
    if 1 / LARGEST_SCALE_ERROR < ratio < LARGEST_SCALE_ERROR:
        return
    stated = float(np.median(dataset.bar_distances_m))
    if ratio > 1:
        verdict = "the distance is larger than the baseline allows"
        factor = ratio
        units = "The distance looks like {unit}, or the baseline is {factor} too small."
    else:
        verdict = "the distance is smaller than the baseline allows"
        factor = 1 / ratio
        units = "The baseline looks like {unit}, or the distance is {factor} too small."
    hint = "Measure both again."
    for size, unit in ((1000.0, "millimetres"), (100.0, "centimetres")):
        if size / 2 < factor < size * 2:
            hint = units.format(unit=unit, factor=f"{size:g} times") + " Give both in metres."
    raise StereocalError(
        f"The distance between the targets is given as {stated:g} m and the baseline as "
        f"{dataset.baseline_m:g} m, but with this baseline the images say a distance of "
        f"{stated / ratio:.3g} m: {verdict}. {hint}"
    )


def check_exchange(
    as_given: tuple[float, float], exchanged: tuple[float, float] | None
) -> list[str]:
    """Refuse camera files that are evidently exchanged; a warning where they may be.

    Args:
        as_given: least 2D and 3D cost found with the cameras as given.
        exchanged: the same with the two files exchanged; None if that is impossible.

    Two simulated cameras whose focal lengths differ by 1 % fit 4 to 6 times worse when exchanged,
    and at least 2.2 times with lenses off by 0.3 % and 10 px. Two real ones that differ by 0.7 %
    fit 1.02 (2D) and 1.2 times (3D) worse: enough for a warning, not for a refusal.

    Raises:
        StereocalError: exchanged, both costs together are more than 1.5 times better.
    """
    if exchanged is None:
        return []
    gain_2d, gain_3d = (
        given / max(other, 1e-300) for given, other in zip(as_given, exchanged, strict=True)
    )
    if gain_2d * gain_3d > SURELY_EXCHANGED**2 and min(gain_2d, gain_3d) > 1:
        raise StereocalError(
            "The two camera files seem to be exchanged: with the primary's file for the secondary "
            f"camera and the other way round, the points fit {gain_2d:.2g} times better in the "
            f"images and the bar lengths {gain_3d:.2g} times. Exchange the files."
        )
    if min(gain_2d, gain_3d) > 1 and max(gain_2d, gain_3d) > MAYBE_EXCHANGED:
        return [
            f"The points fit somewhat better ({max(gain_2d, gain_3d):.2g} times) with the two "
            "camera files exchanged. Make sure that each camera has its own file."
        ]
    return []


def warnings_about(dataset: Dataset) -> list[str]:
    """What is odd but allowed, a sentence each."""
    found = []
    pairs = len(dataset.correspondences)
    if pairs < FEW_PAIRS:
        found.append(
            f"{pairs} pairs of points are very few: errors of tens of percent are possible. Do not "
            "measure with this result; bring 20 frames or more."
        )
    bars = len(dataset.correspondences.bars)
    if 0 < bars < FEW_BARS:
        found.append(
            f"Only {bars} frame{'s have' if bars > 1 else ' has'} both targets: the 3D method "
            f"needs at least {FEW_BARS} to fix the five angles."
        )
    same_K = np.array_equal(dataset.primary.K, dataset.secondary.K)
    if same_K and np.array_equal(dataset.primary.distortion, dataset.secondary.distortion):
        found.append("Both cameras have exactly the same lens. Was one camera file given twice?")
    return found
