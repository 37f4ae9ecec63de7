"""Does the world frame tell the truth? Simulated studies of `field.world`.

    nice python -m benchmarks.world [STUDY ...] [--trials N]

Each rig is calibrated with 25 frames (`refined_rigs`: 0.2 px, lenses and lengths misjudged as
stated), and its refined file is used. The cameras stand within 20 degrees of level and upright.

- plumb: the vertical of four plumb lines at 4 m, 0.3 px; and whether the stated limits hold;
- plumb_known: the same with the rig known exactly: what the lines themselves give;
- gravity: throws at 100 frames per second, 0.3 px, drag from none to that of a light ball;
- survey: axes of eight surveyed points, 5 mm;
- mirrored: surveys with two axes exchanged or one sign wrong, of 4 to 10 points off one plane;
- ground: mirrored surveys of 3 to 6 points on the ground;
- sound: sound surveys, to be accepted.
"""

from collections.abc import Callable, Iterator

import numpy as np

from benchmarks.studies import Asked, exact_interval, run_studies
from stereocal.field.world.find import find_world
from stereocal.field.world.frame import WorldSettings
from tests.rigs.worlds import (
    CLICK_PX,
    GRAVITY,
    Place,
    known_places,
    mirrored,
    off_vertical,
    places,
    plumb_lines,
    refusal,
    surveyed,
    thrown,
)


def print_plumb(asked: Asked, of: Callable[[int, int], Iterator[Place]] = places) -> None:
    """Errors of the vertical, and how often its limit holds."""
    errors, limits = [], []
    for place in of(asked.trials, 1):
        found = find_world(place.rig, plumb_lines(place), WorldSettings(sigma_px=CLICK_PX))
        errors.append(off_vertical(place, found.pose, 4.0))
        limits.append(found.uncertainty["vertical_deg"])
    _print_errors(errors, limits)


def print_plumb_known(asked: Asked) -> None:
    """The same with an exact rig."""
    print_plumb(asked, known_places)


def _print_errors(errors: list[float], limits: list[float]) -> None:
    within = np.array(errors) <= np.array(limits)
    print(
        f"  vertical off by {np.median(errors):.3f} degrees (median), "
        f"{np.percentile(errors, 95):.3f} (95 %), {max(errors):.3f} (largest); within 0.1 degrees "
        f"{exact_interval(int(np.sum(np.array(errors) < 0.1)), len(errors))}\n"
        f"  stated 95 % limit {np.median(limits):.3f} (median), held by "
        f"{exact_interval(int(within.sum()), len(errors))}"
    )


def print_gravity(asked: Asked) -> None:
    """How often the interval of |g| holds 9.81."""
    errors, limits, held, halves, agree, seen = [], [], 0, [], 0, 0
    for place in places(asked.trials, 2):
        found = find_world(place.rig, thrown(place))
        gravity = found.about["gravity"]
        interval = gravity["m_per_s2"]
        held += interval["low"] <= GRAVITY <= interval["high"]
        halves.append(0.5 * (interval["high"] - interval["low"]))
        agree += gravity["agrees"]
        seen += gravity["drag_per_m"]["low"] > 0
        errors.append(off_vertical(place, found.pose, 7.0))
        limits.append(found.uncertainty["vertical_deg"])
    print(f"  95 % intervals of g hold {GRAVITY}: {exact_interval(held, asked.trials)}")
    print(f"  half an interval {np.median(halves):.3f} m/s^2 (median); drag seen in {seen}")
    print(f"  said to agree: {exact_interval(agree, asked.trials)}")
    _print_errors(errors, limits)


def print_survey(asked: Asked) -> None:
    """Errors of the vertical of surveyed points."""
    errors, limits = [], []
    for place in places(asked.trials, 3):
        found = find_world(place.rig, surveyed(place, 8))
        errors.append(off_vertical(place, found.pose, 7.0))
        limits.append(found.uncertainty["vertical_deg"])
    _print_errors(errors, limits)


def print_mirrored(asked: Asked) -> None:
    """Mirrored surveys refused, of points off one plane."""
    refused = sum(
        refusal(place, mirrored(surveyed(place, int(place.rng.integers(4, 11))), place.rng))
        is not None
        for place in places(asked.trials, 4)
    )
    print(f"  refused {refused} of {asked.trials}")


def print_ground(asked: Asked) -> None:
    """Mirrored surveys refused, of points on the ground; z wrong in sign is 0 there."""
    refused, of = 0, 0
    for place in places(asked.trials, 5):
        survey = surveyed(place, int(place.rng.integers(3, 7)), on_ground=True)
        bad = mirrored(survey, place.rng)
        if np.allclose(bad.world_m[:, :2], survey.world_m[:, :2]):
            continue
        of += 1
        refused += refusal(place, bad) is not None
    print(f"  refused {refused} of {of}")


def print_sound(asked: Asked) -> None:
    """Sound surveys accepted."""
    whys: list[str] = []
    for place in places(asked.trials, 6):
        count = int(place.rng.integers(3, 11))
        why = refusal(place, surveyed(place, count, on_ground=count < 6))
        whys += [why] if why else []
    print(f"  refused {len(whys)} of {asked.trials}", *sorted(set(whys))[:3], sep="\n  ")


STUDIES = {
    "plumb": (print_plumb, 400),
    "plumb_known": (print_plumb_known, 400),
    "gravity": (print_gravity, 1000),
    "survey": (print_survey, 400),
    "mirrored": (print_mirrored, 1000),
    "ground": (print_ground, 1000),
    "sound": (print_sound, 400),
}


if __name__ == "__main__":
    run_studies(STUDIES, __doc__)
