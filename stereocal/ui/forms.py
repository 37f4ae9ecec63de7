"""The settings of the search: their forms, and which of them have changed."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import cycle
from typing import Any

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.calibration.methods import CalibrationSettings
from stereocal.evaluation.evaluate import EvaluationSettings
from stereocal.projects.project import Project
from stereocal.rig.dataset import Dataset
from stereocal.system.settings import About, asked, descriptions
from stereocal.ui.fields import Field, Number, one_of, setting, yes_or_no

RATIOS = (0.01, 0.99)
"""Ends of the slider of the acceptance ratio."""
ASKED = asked(CalibrationSettings)
ASKED["acceptance"] = replace(ASKED["acceptance"], low=RATIOS[0], high=RATIOS[1])
ABOUT = descriptions(EvaluationSettings)
LARGEST_WHOLE = 2**53 - 1
"""In a browser."""
DELTAS = (1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1)
"""Positions of the slider of the first step, rad."""
_FRAMES = ("all_frames", "frames_put_back", "frames_left_out", "time_offset", "time_drift")
"""Shown with the frames left out and the time offset, not in the line of settings."""


def settings_form(project: Project, dataset: Dataset) -> dict[str, Any]:
    """Show the form; the settings of the calibration."""
    frames = len(dataset.correspondences.frames)
    if frames > 1:
        title = "Frames to calibrate with (the others test the result)"
        told = f"All {frames}, or fewer, drawn at random. Paper: 20 of 25."
        _frames_field(project, frames).slider(title, help=told)
    fields, columns = _search_fields(project), cycle(st.columns(3))
    for name, field in fields.items():
        if name != "time_drift" or fields["time_offset"].value():
            place = next(columns) if isinstance(field.fit, Number) else st.container()
            ask(place, ASKED[name], field)
    return form_values(project, dataset)


def form_values(project: Project, dataset: Dataset) -> dict[str, Any]:
    """The settings of the calibration, also for pages that do not show the form."""
    frames = len(dataset.correspondences.frames)
    used = _frames_field(project, frames).value()
    return search_values(project) | {"calibration_frames": None if used == frames else used}


def _frames_field(project: Project, frames: int) -> Field:
    return setting(project, "calibration_frames", frames, Number(1, frames))


def field_of(project: Project, key: str, about: About) -> Field:
    """The field of a described setting: a choice, a switch, or a number within its bounds."""
    kind = type(about.default)
    if about.choices:
        return setting(project, key, about.default, one_of(about.choices))
    if kind is bool:
        return setting(project, key, about.default, yes_or_no)
    fit = Number(kind(about.low), kind(min(about.high, LARGEST_WHOLE)))
    return setting(project, key, about.default, fit)


def _search_fields(project: Project) -> dict[str, Field]:
    return {
        name: field_of(project, name, about)
        for name, about in ASKED.items()
        if not isinstance(about.default, tuple)
    }


def search_values(project: Project) -> dict[str, Any]:
    """The settings of the search, also for pages that do not show the form."""
    values = {key: field.value() for key, field in _search_fields(project).items()}
    values["time_drift"] = values["time_offset"] and values["time_drift"]
    inputs = project.inputs
    return values | {"frames_put_back": inputs.put_back, "frames_left_out": inputs.left_out}


def search_form(project: Project) -> None:
    """The two settings of the search that the paper varies, as sliders."""
    fields, (left, right) = _search_fields(project), st.columns(2)
    delta, acceptance = ASKED["delta"], ASKED["acceptance"]
    own, ratio = fields["delta"].widget(), fields["acceptance"].widget()
    steps = sorted({*DELTAS, fields["delta"].value()})
    left.select_slider(delta.title, steps, format_func="{:g}".format, help=delta.help, **own)
    right.slider(acceptance.title, *RATIOS, step=0.01, help=acceptance.help, **ratio)
    st.page_link("pages/calibrate.py", label="Other settings of the search")


def ask(place: DeltaGenerator, about: About, own: Field, disabled: bool = False) -> Any:
    """The widget of a described setting; its value."""
    if about.choices:
        words = about.choices.__getitem__
        return own.buttons(about.title, place, format_func=words, help=about.help)
    if isinstance(about.default, bool):
        return place.toggle(about.title, help=about.help, disabled=disabled, **own.widget())
    shown = {} if isinstance(about.default, int) else {"format": "%.10g"}
    step = 1 if isinstance(about.default, int) else about.default / 10
    return own.number_input(about.title, place, help=about.help, step=step, **shown)


def changed_settings(then: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """The settings of `now` that were others, with both values where these are short."""
    return [
        f"{ABOUT[key].name} ({_in_words(then[key])}, now {_in_words(value)})"
        if value is None or isinstance(value, (int, float, str))
        else ABOUT[key].name
        for key, value in now.items()
        if then[key] != value
    ]


def _in_words(value: Any) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    if value is None:
        return "all"
    return f"{value:g}" if isinstance(value, float) else f"{value}"


def describe_settings(settings: CalibrationSettings) -> str:
    """The settings of a search, in one line."""
    values = settings.to_json()
    return ", ".join(
        f"{about.name} {f'{value:g}' if isinstance(value := values[name], float) else value}"
        for name, about in ASKED.items()
        if name not in _FRAMES
    )
