"""What a person has given to a project: files and measured lengths."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal

from stereocal.errors import can_be_shown

Slot = Literal["primary", "secondary", "correspondences"]


@dataclass(frozen=True)
class Inputs:
    """What a person has given so far; None where nothing was."""

    name: str = ""
    baseline_m: float | None = None
    target_distance_m: float | None = None
    baseline_sigma_m: float | None = None
    """As a data set states it; None where it states none."""
    target_distance_sigma_m: float | None = None
    files: Mapping[str, str] = field(default_factory=dict)
    """Slot to the file's name below `inputs/`."""
    labels: Mapping[str, str] = field(default_factory=dict)
    """Slot to the name that the person's file had."""
    exchanged: list[int] = field(default_factory=list)
    """Frames of the table whose targets a person has exchanged in the secondary image."""

    @property
    def missing(self) -> list[str]:
        """What is still needed, in words."""
        named = {
            "correspondences": "the table of points",
            "primary": "the primary camera's file",
            "secondary": "the secondary camera's file",
        }
        lacking = [words for slot, words in named.items() if slot not in self.files]
        lacking += ["the baseline"] * (self.baseline_m is None)
        lacking += ["the distance between the targets"] * (self.target_distance_m is None)
        return lacking


def checked_inputs(data: Mapping[str, Any]) -> Inputs:
    """The inputs that a file says.

    Raises:
        TypeError: something is not what it should be.
    """
    inputs = Inputs(**data)
    check_inputs(inputs)
    return inputs


def check_inputs(inputs: Inputs) -> None:
    """Make sure of what a file says.

    Raises:
        TypeError: something is not what it should be.
    """
    for mapping in (inputs.files, inputs.labels):
        if not isinstance(mapping, dict) or not all(map(can_be_shown, mapping.values())):
            raise TypeError(mapping)
    if not can_be_shown(inputs.name) or set(inputs.files) - set(inputs.labels):
        raise TypeError(inputs)
    if not all(isinstance(frame, int) for frame in inputs.exchanged):
        raise TypeError(inputs.exchanged)
    for each in fields(Inputs):
        value = getattr(inputs, each.name)
        if not each.name.endswith("_m") or value is None:
            continue
        if not isinstance(value, float | int) or abs(value) > sys.float_info.max:
            raise TypeError(each.name)
