"""The unit of lengths in files of other programs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from stereocal.errors import StereocalError

Unit = Literal["m", "cm", "mm"]
UNITS: Mapping[Unit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Metres per unit."""
POSSIBLE_M = (0.002, 100.0)
"""Plausible baselines: stereo laparoscopes have 4 mm; the largest still allow a portable bar."""
USUAL_M = (0.01, 10.0)
"""Plausible baselines if metres are assumed: narrow, so that 1 cm to 10 m in mm, or 10 cm
to 10 m in cm, are not taken for metres."""


class UnitError(StereocalError):
    """Lengths of unknown unit, or implausible in the stated unit."""

    def __init__(self, found: str, baseline: float) -> None:
        low, high = POSSIBLE_M
        fitting = [
            f"{unit} ({baseline * scale:g} m)"
            for unit, scale in UNITS.items()
            if low <= baseline * scale <= high
        ]
        choice = " or ".join(fitting) or "m, cm or mm; none of them is plausible"
        self.question = f"{found}: state the unit of its lengths, {choice}."
        super().__init__(f"{found}: state the unit of its lengths, --unit {choice}.")


def metres_per_unit(
    baseline: float, stated: Unit | None, by_user: Unit | None, usual: Unit | None, source: str
) -> float:
    """Factor that converts the lengths of a file to metres.

    Args:
        baseline: distance of the two cameras, in the file's unit.
        stated: the unit stated in the file.
        by_user: the unit stated by the user.
        usual: the unit of all files of this format, by its documentation.

    Raises:
        UnitError: the unit is unknown, or the baseline is implausible.
        StereocalError: file and user contradict each other.
    """
    if by_user and stated and by_user != stated:
        raise StereocalError(
            f"{source}: the file's lengths are in {stated}, but the unit entered is {by_user}."
        )
    unit = by_user or stated or usual
    if unit is None:
        raise UnitError(
            f"{source}: the file does not say the unit of its baseline, {baseline:g}", baseline
        )
    low, high = POSSIBLE_M if by_user or stated else USUAL_M
    if not low <= baseline * UNITS[unit] <= high:
        raise UnitError(
            f"{source}: a baseline of {baseline:g} {unit} is not plausible (expected {low:g} to "
            f"{high:g} m)",
            baseline,
        )
    return UNITS[unit]
