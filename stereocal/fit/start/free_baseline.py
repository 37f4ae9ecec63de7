"""A baseline that was not measured: the lengths of the bars alone give the scale.

The refined method can solve for the baseline. The paper's three methods cannot: they hold it, so
they are given the value that the refined method finds, and that is reported.
"""

import numpy as np

from stereocal.errors import StereocalError
from stereocal.fit.start.first_poses import robust_start
from stereocal.rig.lengths_in_words import word_of
from stereocal.rig.pair import Pair
from stereocal.system.numbers import rounded

FEWEST_BARS = 5


def with_rough_baseline(dataset: Pair) -> Pair:
    """The data set with a free baseline set to one to start from; others unchanged."""
    if not dataset.baseline_is_free:
        return dataset
    bars = dataset.correspondences.bars
    if len(bars) < FEWEST_BARS:
        raise StereocalError(
            f"The baseline is free, so the lengths of the bars must give the scale; {len(bars)} "
            f"bars are too few, {FEWEST_BARS} are needed. Measure the baseline, or add frames."
        )
    # The start does not depend on the stated number: the same points give the same baseline.
    unit = dataset.changed(baseline_m=1.0)
    start = robust_start(unit, unit.rays)
    if start is None:
        raise StereocalError(
            "The baseline is free, but the points give no pose of the cameras to find it from: "
            "check that points, targets and camera files are not exchanged."
        )
    ratios = dataset.bar_distances_m / unit.reconstructed_lengths_m(start)
    if not np.isfinite(ratios).any():
        raise StereocalError(
            "The baseline is free, but no bar lies in front of both cameras: check that points "
            "and camera files are not exchanged."
        )
    return dataset.changed(baseline_m=float(np.nanmedian(ratios)))


def note_on_free_baseline(dataset: Pair) -> str:
    """What a free baseline means for the methods; empty if it was measured."""
    if not dataset.baseline_is_free:
        return ""
    held = word_of(dataset)
    return (
        "The baseline was not measured: the refined method found "
        f"{rounded(dataset.baseline_m, 4)} m from the lengths of the {held}s, which alone give "
        "the scale. "
        "The essential, 2D and 3D methods cannot solve for a baseline; they hold this value, and "
        f"an error of the {held}'s stated length scales all results."
    )
