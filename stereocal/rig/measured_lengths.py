"""Whether measured lengths can be those of cameras and a bar, in metres."""

import numpy as np

from stereocal.errors import refuse
from stereocal.system.numbers import rounded

LONGEST_PLAUSIBLE_M = 1000.0
"""A longer baseline or bar is taken for a number in millimetres."""
LARGEST_UNCERTAINTY, SMALLEST_UNCERTAINTY = 0.2, 1e-7
"""Limits for the uncertainty of a measured length, as fractions of it. A larger one is taken for a
number in another unit; with a smaller one the fit cannot be computed in double precision."""


def check_lengths(
    baseline_m: float,
    target_distance_m: float,
    baseline_sigma_m: float | None,
    target_distance_sigma_m: float | None,
) -> None:
    """Check the lengths of two cameras and their standard errors, in metres, as of `Pair`."""
    bar, free = "distance between the targets", baseline_sigma_m == np.inf
    refuse(
        (
            free and baseline_m > LONGEST_PLAUSIBLE_M,
            f"By a {bar} of {target_distance_m:g} m the cameras are {baseline_m:g} m apart: this "
            f"looks like millimetres. Give the distance in metres ({target_distance_m / 1000:g}).",
        )
    )
    check_length("baseline", baseline_m)
    check_length(bar, target_distance_m)
    if not free:
        check_uncertainty("baseline", baseline_sigma_m, baseline_m)
    check_uncertainty(bar, target_distance_sigma_m, target_distance_m)


def check_length(what: str, value: float) -> None:
    """Check a measured length in metres."""
    refuse(
        (
            not np.isfinite(value) or value <= 0,
            f"The {what} is {value:g} m: it must be a length above 0.",
        ),
        (
            value > LONGEST_PLAUSIBLE_M,
            f"The {what} is {value:g} m: this looks like millimetres. Give it in metres "
            f"({value / 1000:g}).",
        ),
    )


def check_uncertainty(what: str, sigma: float | None, length: float) -> None:
    """Check the stated standard error of a measured length, both in metres."""
    if sigma is None:
        return
    free = " A baseline that was not measured can be left free." if what == "baseline" else ""
    stated, finest = f"The uncertainty of the {what} is", SMALLEST_UNCERTAINTY * length
    refuse(
        (not (np.isfinite(sigma) and sigma > 0), f"{stated} {sigma}: it must be above 0."),
        (
            sigma > LARGEST_UNCERTAINTY * length,
            f"{stated} {sigma:g} m, more than {100 * LARGEST_UNCERTAINTY:g} % of its {length:g} m. "
            f"Is it in millimetres? Then it is {sigma / 1000:g} m: state it in metres.{free}",
        ),
        (
            sigma < finest,
            f"{stated} {sigma:g} m, for a length of {length:g} m: no such length is known to "
            f"better than {rounded(finest, 1)} m. State it in metres, as 0.002 for 2 mm.",
        ),
    )
