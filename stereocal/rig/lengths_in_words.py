"""The rig in words that a person can check, and the question whether its lengths are in metres.

A rig whose lengths are all in another unit is consistent: no residual shows it.
"""

import re
from collections.abc import Mapping

import numpy as np

from stereocal.rig.geometry import Pose, triangulate_rays
from stereocal.rig.pair import Pair
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import rounded

METRES_PER: Mapping[str, float] = {
    "m": 1.0,
    "cm": 0.01,
    "mm": 0.001,
    "inches": 0.0254,
    "feet": 0.3048,
}
"""Metres per unit in which lengths are measured."""
LONG_M, LONG_BAR_M, LONG_BOARD_M = 50.0, 20.0, 1.5
"""A longer baseline or depth, a longer bar, and a board with longer diagonals (A0 paper has 1.46 m)
are asked about: rare, but not impossible."""
PLAUSIBLE_BASELINE_M = (0.02, LONG_M)
"""The baselines in metres for which a unit is offered."""
LARGEST_RATIO = 10.0
"""Bar over baseline: above, no unit of both makes them fit."""
TAILS = (2.0, 98.0)
"""Percentiles of the depths; single wrong pairs give any depth."""
BESIDE = 0.3
"""A share of the baseline: cameras that are less beside each other are above or behind each
other."""
LEVEL = 0.03
"""A share of the distance of two cameras: a smaller difference in height is not said."""
FLAT_M = 1e-6


def rig_in_words(dataset: Pair, pose: Pose | None) -> str:
    """Such as `The cameras are 4.5 m apart; a bar of 0.90 m was seen from 8.2 to 25 m away.`, and
    on which side the secondary stands where points on a line cannot tell a world from its mirror
    image.

    Args:
        pose: of any calibration; without one, the depths and the side are left out.
    """
    lengths = _lengths_in_words(dataset, pose)
    held = dataset.correspondences.rigid_object
    if pose is None or not (held is None or are_on_a_line(held.points)):
        return lengths
    centre = pose.inverse().T
    if abs(centre[0]) < BESIDE * pose.baseline:
        return lengths
    return f"{lengths} {side_in_words('the secondary camera', 'the primary', centre)}"


def side_in_words(name: str, first: str, centre: FloatArray) -> str:
    """On which side of the first camera another one is, and how much higher, to be checked.

    Args:
        centre: (3,), of the other camera in the first one's frame, in metres.
    """
    x, down, _ = centre.tolist()
    is_level = abs(down) < LEVEL * np.linalg.norm(centre)
    height = f", and {rounded(abs(down))} m {'lower' if down > 0.0 else 'higher'}"
    return (
        f"Check: {name} is on the {'right' if x > 0.0 else 'left'} of {first}"
        f"{'' if is_level else height}. If that is wrong, the images are mirrored or upside down."
    )


def are_on_a_line(points_m: FloatArray) -> bool:
    """Whether points (n, 3) of an object are."""
    return bool(np.linalg.matrix_rank(points_m - points_m[0], tol=FLAT_M) < 2)


def _lengths_in_words(dataset: Pair, pose: Pose | None) -> str:
    held = word_of(dataset)
    how = f", found from the {held}s" if dataset.baseline_is_free else ""
    apart = f"The cameras are {_metres(dataset.baseline_m)} m apart{how}"
    bar, depths = _metres(_bar_m(dataset)), _depths_m(dataset, pose)
    if depths is None:
        return f"{apart}; the {held} is {bar} m long."
    near, far = map(_metres, depths)
    article = "an" if held == "object" else "a"
    seen = f"{apart}; {article} {held} of {bar} m was seen from {near} to {far} m away."
    # Said once, so that all that is told of bars can be read.
    return f"{seen} Each counts as two bars, its diagonals." if held == "board" else seen


def word_of(dataset: Pair) -> str:
    """What was moved before the cameras: a bar, a board or another object."""
    rigid_object = dataset.correspondences.rigid_object
    return "bar" if rigid_object is None else rigid_object.word


def as_held(sentence: str, dataset: Pair) -> str:
    """A sentence about bars, of boards where a board was held."""
    held = word_of(dataset)
    return re.sub(r"\bbar(?=s?\b)", held, sentence) if held == "board" else sentence


def question_about_units(dataset: Pair, pose: Pose | None, others: bool = True) -> str:
    """The question whether lengths that are unusually long are in metres; empty if none is.

    Args:
        pose: as in `rig_in_words`.
        others: whether to say what they would be in other units: not where the user chose one.
    """
    depths, bar = _depths_m(dataset, pose), _bar_m(dataset)
    farthest = depths[1] if depths else 0.0
    beyond = farthest and bar > farthest  # a bar does not fit in front of what is nearer
    longest = LONG_BOARD_M if word_of(dataset) == "board" else LONG_BAR_M
    if max(dataset.baseline_m, farthest) <= LONG_M and bar <= longest and not beyond:
        return ""
    rig = _lengths_in_words(dataset, pose)
    if not others:
        return f"{rig} Are these lengths right?"
    fitting = [
        f"{_metres(dataset.baseline_m * per)} and {_metres(bar * per)} m if they are in {unit}"
        for unit, per in units_that_fit(dataset).items()
    ]
    or_else = f" The two lengths would be {', '.join(fitting)}." if fitting else ""
    return f"{rig} Are these lengths in metres?{or_else}"


def units_that_fit(dataset: Pair) -> dict[str, float]:
    """The other units in which baseline and bar would be usual, with their metres."""
    low, high = PLAUSIBLE_BASELINE_M
    return {
        unit: per
        for unit, per in METRES_PER.items()
        if unit != "m"
        and _bar_m(dataset) <= LARGEST_RATIO * dataset.baseline_m
        and low <= dataset.baseline_m * per <= high
        and _bar_m(dataset) * per <= LONG_BAR_M
    }


def _bar_m(dataset: Pair) -> float:
    lengths = dataset.bar_distances_m
    return float(np.median(lengths)) if len(lengths) else dataset.target_distance_m


def _depths_m(dataset: Pair, pose: Pose | None) -> tuple[float, float] | None:
    """The depths of nearly all points from the primary camera; None if there are none."""
    if pose is None:
        return None
    z = triangulate_rays(pose.R, pose.T, dataset.rays)[:, 2]
    z = z[np.isfinite(z)]
    if not len(z):
        return None
    near, far = np.percentile(z, TAILS)
    return float(near), float(far)


def _metres(value: float) -> str:
    """Three digits, without an exponent."""
    return np.format_float_positional(value, 3, fractional=False, trim="-")
