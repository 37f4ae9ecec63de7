"""The forms of the search: its settings, and its number of frames."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import streamlit as st

from stereocal.calibration.methods import CalibrationSettings
from stereocal.calibration.montecarlo import SearchSettings
from stereocal.projects.project import Project
from stereocal.rig.dataset import Dataset
from stereocal.ui.fields import Field, number, one_of, setting, yes_or_no


@dataclass(frozen=True)
class _Number:
    key: str
    title: str
    default: float
    lowest: float
    highest: float
    help: str
    format: str

    @property
    def bounds(self) -> tuple[float, float]:
        """Of the type of the value, as the widget requires."""
        kind = type(self.default)
        return kind(self.lowest), kind(self.highest)


PAPER = SearchSettings()
NUMBERS = (
    _Number(
        "delta",
        "First step Δ (rad)",
        PAPER.delta,
        1e-9,
        0.5,
        "How far an angle is moved at first. Paper: 0.001 rad.",
        "%.10g",
    ),
    _Number(
        "delta_min",
        "Smallest step Δ min (rad)",
        PAPER.delta_min,
        1e-12,
        0.5,
        "The search ends when the step is smaller. Paper: 0.000001 rad.",
        "%.10g",
    ),
    _Number(
        "acceptance",
        "Acceptance ratio",
        PAPER.acceptance,
        0.01,
        0.99,
        "The step shrinks when fewer moves than this part are accepted. Paper: 0.2.",
        "%.10g",
    ),
    _Number(
        "shrink",
        "Shrink factor",
        PAPER.shrink,
        0.01,
        0.99,
        "What the step is multiplied by when it shrinks. Paper: 0.75.",
        "%.10g",
    ),
    _Number(
        "minimum_moves",
        "Minimum moves",
        PAPER.minimum_moves,
        1,
        100_000,
        "Moves at one step before the ratio is looked at. Paper: 1, to the letter; 20 is steadier.",
        "%d",
    ),
    _Number(
        "seed",
        "Seed",
        PAPER.seed,
        0,
        2**31 - 1,
        "Source of the random numbers: the same seed gives the same files.",
        "%d",
    ),
)


SLIDERS = ("delta", "acceptance")
DELTAS = (1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1)
"""Positions of the slider of the first step, rad."""
SOLVERS = ("constrained", "linear")


def settings_form(project: Project, dataset: Dataset) -> dict[str, Any]:
    """Show the form, folded; the settings of the calibration."""
    frames = len(dataset.correspondences.frames)
    with st.expander("Settings"):
        if frames > 1:
            st.slider(
                "Frames to calibrate with (the others test the result)",
                1,
                frames,
                **_frames_field(project, frames).widget(),
                help=f"All {frames}, or fewer, drawn at random. Paper: 20 of 25.",
            )
        _numbers(project)
    return form_values(project, dataset)


def form_values(project: Project, dataset: Dataset) -> dict[str, Any]:
    """The settings of the calibration, also for pages that do not show the form."""
    frames = len(dataset.correspondences.frames)
    used = _frames_field(project, frames).value()
    return search_values(project) | {"calibration_frames": None if used == frames else used}


def _frames_field(project: Project, frames: int) -> Field:
    return setting(project, "calibration_frames", frames, number(1, frames))


def _search_fields(project: Project) -> dict[str, Field]:
    fields = {
        each.key: setting(project, each.key, each.default, number(*each.bounds)) for each in NUMBERS
    }
    return fields | {
        "essential": setting(project, "essential", SOLVERS[0], one_of(SOLVERS)),
        **{
            key: setting(project, key, False, yes_or_no)
            for key in ("all_frames", "time_offset", "time_drift")
        },
    }


def search_values(project: Project) -> dict[str, Any]:
    """The settings of the search, also for pages that do not show the form."""
    values = {key: field.value() for key, field in _search_fields(project).items()}
    values["time_drift"] = values["time_offset"] and values["time_drift"]
    inputs = project.inputs
    return values | {"frames_put_back": inputs.put_back, "frames_left_out": inputs.left_out}


def search_form(project: Project) -> None:
    """The two settings of the search that the paper varies as sliders, the others folded."""
    fields = _search_fields(project)
    left, right = st.columns(2)
    delta, acceptance = (each for each in NUMBERS if each.key in SLIDERS)
    steps = sorted({*DELTAS, fields["delta"].value()})
    left.select_slider(
        delta.title, steps, format_func="{:g}".format, help=delta.help, **fields["delta"].widget()
    )
    right.slider(
        acceptance.title,
        *acceptance.bounds,
        step=0.01,
        help=acceptance.help,
        **fields["acceptance"].widget(),
    )
    with st.expander("Other settings of the search"):
        _numbers(project, without=SLIDERS)


def _numbers(project: Project, without: Collection[str] = ()) -> None:
    fields = _search_fields(project)
    columns = st.columns(3)
    for at, each in enumerate(each for each in NUMBERS if each.key not in without):
        kind = type(each.default)
        columns[at % 3].number_input(
            each.title,
            *each.bounds,
            format=each.format,
            help=each.help,
            step=kind(1) if kind is int else each.default / 10,
            **fields[each.key].widget(),
        )
    st.segmented_control(
        "Solver of the essential matrix",
        SOLVERS,
        required=True,
        help="Constrained: the best essential matrix. Linear: the textbook's 8-point estimate "
        "alone, as the start of the searches.",
        **fields["essential"].widget(),
    )
    st.toggle(
        "Trust every frame, as the paper does",
        **fields["all_frames"].widget(),
        help="Otherwise frames that contradict the others are left out.",
    )
    st.toggle(
        "Find the time offset between the cameras",
        **fields["time_offset"].widget(),
        help="For cameras that are not quite in step: how many frames later the secondary takes "
        "its frames. Its points are shifted by that. Needs a bar that moves, in consecutive "
        "frames.",
    )
    if fields["time_offset"].value():
        st.toggle(
            "Find its drift too",
            **fields["time_drift"].widget(),
            help="For long recordings by cameras that each run by their own clock.",
        )


def settings_of(values: dict[str, Any]) -> CalibrationSettings:
    """The settings of a form's values.

    Raises:
        StereocalError: values that contradict each other.
    """
    return CalibrationSettings.from_json(values)
