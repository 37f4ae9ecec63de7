"""The measured lengths on the Data page, each with its unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import streamlit as st

from stereocal.errors import StereocalError
from stereocal.projects.inputs import LENGTHS
from stereocal.projects.project import Project
from stereocal.refined.refine import robust_start
from stereocal.rig.dataset import LONGEST_PLAUSIBLE_M, Dataset
from stereocal.rig.lengths_in_words import (
    LONG_BAR_M,
    METRES_PER,
    question_about_units,
    rig_in_words,
    units_that_fit,
)
from stereocal.ui.fields import Field, one_of, setting
from stereocal.ui.intake import clear_refusal, refuse
from stereocal.ui.messages import callback, readable
from stereocal.ui.project import project_to_write
from stereocal.ui.texts import escape_markdown

KEPT_ANSWER = "lengths_in_metres"
"""Setting: the baseline and the bar that the user has said to be in metres."""

BOTH = ("baseline_m", "target_distance_m")
PAIRS = 500
"""Pairs of points from which the depths are estimated."""


def length_field(project: Project | None, name: str, label: str) -> None:
    """A length with its unit; the project stores metres."""
    length = _Length(project, name)
    field, choice = st.columns([3, 1], vertical_alignment="bottom")
    field.number_input(
        label,
        min_value=0.0,
        value=None,
        step=None,
        format="%.10g",
        placeholder="measured length",
        **length.number.widget(),
    )
    choice.selectbox("Unit", list(METRES_PER), **length.unit.widget())


def object_in_words(project: Project | None) -> str:
    """The object whose targets the table shows; empty for a bar of A and B."""
    dataset = readable(lambda: project.dataset) if project is not None else None
    own = None if dataset is None else dataset.correspondences.rigid_object
    if own is None:
        return ""
    return (
        f"An object with {len(own.names)} targets, up to {own.distances.max():.4g} m apart: their "
        "distances are the measured lengths."
    )


def ask_if_measured(project: Project) -> None:
    """Ask about planned lengths that nobody has measured yet."""
    inputs = project.inputs
    if not inputs.needs_measuring:
        return
    lengths = " and ".join(
        f"{LENGTHS[name]} ({getattr(inputs, name):.12g} m)" for name in inputs.needs_measuring
    )
    st.warning(
        f"**Planned, not yet measured:** {lengths}. Enter on the Data page what you measure: an "
        "error in a length becomes an error of every result."
    )
    st.button(
        "Measured: they are as planned", key="take_planned", on_click=callback(project.take_planned)
    )


def show_rig(project: Project, dataset: Dataset) -> None:
    """The rig in words to check, and a question if its lengths may be in another unit."""
    step = len(dataset.correspondences) // PAIRS + 1
    pose = robust_start(dataset, np.ascontiguousarray(dataset.rays[:, ::step]))
    question = question_about_units(dataset, pose)
    stated = [dataset.baseline_m, dataset.target_distance_m]
    files = project.inputs.files
    if files.get("primary") == files.get("secondary"):
        st.warning(
            "Both cameras have the same file. Two lenses are never alike, even of one model: give "
            "each camera its own."
        )
    if not question or project.settings.get(KEPT_ANSWER) == stated:
        st.markdown(escape_markdown(rig_in_words(dataset, pose)))
        return
    st.warning(escape_markdown(question))
    with st.container(horizontal=True):
        st.button(
            "They are in metres",
            key="in_metres",
            on_click=callback(project.keep_settings),
            args=({KEPT_ANSWER: stated},),
        )
        own = dataset.baseline_is_free or np.isfinite(dataset.correspondences.distance_m).any()
        units = () if own else units_that_fit(dataset)
        for unit in units:
            _offer(f"They are in {unit}", f"in_{unit}", project, unit, BOTH)
        if not own and dataset.target_distance_m > LONG_BAR_M:
            for unit in ("mm", "cm"):
                _offer(f"Only A to B is in {unit}", f"bar_in_{unit}", project, unit, BOTH[1:])


def _offer(label: str, key: str, project: Project, unit: str, names: Sequence[str]) -> None:
    st.button(label, key=key, on_click=callback(take_unit), args=(project, unit, names))


def take_unit(project: Project, unit: str, names: Sequence[str] = BOTH) -> None:
    """These lengths are in this unit; their uncertainties are as stated.

    Raises:
        StereocalError: a length or its uncertainty would be impossible; nothing is changed.
    """
    lengths = {name: getattr(project.inputs, name) * METRES_PER[unit] for name in names}
    project.give({}, **lengths)


class _Length:
    """The two fields of a length: the number and its unit."""

    def __init__(self, project: Project | None, name: str) -> None:
        self.project, self.name = project, name
        # Each tab may show the length in its own unit.
        kept = setting(project, f"{name}_unit", "m", one_of(list(METRES_PER)), tabs_own=True)
        self.unit = replace(kept, write=self._take_unit)
        key = f"{name}_value"
        self.number = Field(key, key, self._read, self._take_number)

    def _read(self) -> float | None:
        metres = getattr(self.project.inputs, self.name) if self.project else None
        return None if metres is None else float(f"{metres / METRES_PER[self.unit.value()]:.12g}")

    def _take_number(self, number: float | None) -> None:
        self._take(number, self.unit.value())

    def _take_unit(self, unit: str) -> None:
        """Keep the number that the field shows, in the new unit."""
        self._take(self.number.shown(), unit)

    def _take(self, number: float | None, unit: str) -> None:
        metres = None if number is None else float(number) * METRES_PER[unit]
        try:
            self.project = project_to_write()
            self.project.keep_settings({self.unit.key: unit})
            given: dict[str, Any] = {self.name: metres}
            self.project.give({}, **given)
            clear_refusal()
        except StereocalError as error:
            long = number is not None and metres is not None and metres > LONGEST_PLAUSIBLE_M
            other = partial(self._take, number, "mm")
            refuse(error, ways={f"It is {number:.10g} mm": other} if long and unit != "mm" else {})
