"""The unit of lengths in files of other programs: stated, given by a person, or refused."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from stereocal.errors import StereocalError

Unit = Literal["m", "cm", "mm"]
UNITS: Mapping[Unit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Metres in one."""
POSSIBLE_M = (0.002, 100.0)
"""Distances of two cameras: those of a stereo laparoscope are 4 mm apart, and a bar that can be
carried is seen by both from 100 m at most."""
USUAL_M = (0.01, 10.0)
"""Where the metre is only custom: so narrow that no baseline of 1 cm to 10 m passes for
metres when it is written in millimetres, and none of 10 cm to 10 m when in centimetres."""


class UnitError(StereocalError):
    """Lengths whose unit nobody has said, or that are implausible in it."""

    def __init__(self, found: str, baseline: float) -> None:
        low, high = POSSIBLE_M
        fitting = [
            f"{unit} ({baseline * scale:g} m)"
            for unit, scale in UNITS.items()
            if low <= baseline * scale <= high
        ]
        choice = " or ".join(fitting) or "m, cm or mm; none of them is plausible"
        self.question = f"{found}: give the unit of its lengths, {choice}."
        super().__init__(f"{found}: give the unit of its lengths, --unit {choice}.")


def metres_per_unit(
    baseline: float, stated: Unit | None, given: Unit | None, usual: Unit | None, source: str
) -> float:
    """By what the lengths of a file are multiplied.

    Args:
        baseline: distance of the two cameras, in the file's unit.
        stated: the unit that the file names.
        given: the unit that a person names.
        usual: the unit of all files of this format, by its documentation.

    Raises:
        UnitError: nobody says the unit, or the baseline is none that two cameras can have.
        StereocalError: file and person contradict each other.
    """
    if given and stated and given != stated:
        raise StereocalError(
            f"{source}: the file says that its lengths are in {stated}; the unit given is {given}."
        )
    unit = given or stated or usual
    if unit is None:
        raise UnitError(
            f"{source}: the file does not say the unit of its baseline, {baseline:g}", baseline
        )
    low, high = POSSIBLE_M if given or stated else USUAL_M
    if not low <= baseline * UNITS[unit] <= high:
        raise UnitError(
            f"{source}: a baseline of {baseline:g} {unit} is not plausible ({low:g} to {high:g} m "
            "are)",
            baseline,
        )
    return UNITS[unit]
