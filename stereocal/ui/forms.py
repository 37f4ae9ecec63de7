"""The settings of the search and of the refined method, and their forms."""

from dataclasses import replace
from itertools import cycle
from typing import Any

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.calibration.methods import CalibrationSettings
from stereocal.evaluation.evaluate import EvaluationSettings
from stereocal.fit.in_words import describe_uncertainties
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, CameraName
from stereocal.rig.pair import Pair
from stereocal.system.settings import About, asked, descriptions
from stereocal.system.tables import LARGEST_WHOLE
from stereocal.ui.fields import AsRead, Field, Number, Values, one_of, setting, yes_or_no
from stereocal.ui.texts import REFINED_SET, escape_markdown

RATIOS = (0.01, 0.99)
"""Ends of the slider of the acceptance ratio."""
ASKED = asked(CalibrationSettings)
ASKED["acceptance"] = replace(ASKED["acceptance"], low=RATIOS[0], high=RATIOS[1])
ABOUT = descriptions(EvaluationSettings)
DELTAS = (1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1)
"""Positions of the slider of the first step, rad."""
OF_PAIR = {"all_frames": True, "frames_put_back": [], "time_offset": False, "time_drift": False}
"""Settings of a pair of a rig, which has left out what contradicts it, and brought its cameras into
step."""
_FRAMES = ("all_frames", "frames_put_back", "frames_left_out", "time_offset", "time_drift")
"""Shown with the frames left out and the time offset, not in the line of settings."""


def settings_form(project: Project, dataset: Pair) -> dict[str, Any]:
    """Show the form; the settings of the calibration."""
    frames = len(dataset.correspondences.frames)
    if frames > 1:
        title = "Frames to calibrate with (the others test the result)"
        hint = f"All {frames}, or fewer, drawn at random. Paper: 20 of 25."
        _frames_field(project, frames).slider(title, help=hint)
    fields, columns = _search_fields(project, bool(project.pair)), cycle(st.columns(3))
    for name, field in fields.items():
        if name != "time_drift" or fields["time_offset"].value():
            place = next(columns) if isinstance(field.fit, Number) else st.container()
            ask(place, ASKED[name], field)
    return form_values(project, dataset)


def form_values(project: Project, dataset: Pair) -> dict[str, Any]:
    """The settings of the calibration, also for pages that do not show the form."""
    frames = len(dataset.correspondences.frames)
    used = _frames_field(project, frames).value()
    return search_values(project) | {"calibration_frames": None if used == frames else used}


def _frames_field(project: Project, frames: int) -> Field:
    return setting(project, "calibration_frames", frames, Number(1, frames))


def field_of(project: Values, key: str, spec: About) -> Field:
    """The field of a described setting: a choice, a switch, or a number within its bounds."""
    kind = type(spec.default)
    if spec.choices:
        return setting(project, key, spec.default, one_of(spec.choices))
    if kind is bool:
        return setting(project, key, spec.default, yes_or_no)
    fit = Number(kind(spec.low), kind(min(spec.high, LARGEST_WHOLE)))
    return setting(project, key, spec.default, fit)


def _search_fields(project: Values, of_pair: bool = False) -> dict[str, Field]:
    return {
        name: field_of(project, name, spec)
        for name, spec in ASKED.items()
        if not isinstance(spec.default, tuple) and not (of_pair and name in OF_PAIR)
    }


def search_values(project: Project) -> dict[str, Any]:
    """The settings of the search, also for pages that do not show the form."""
    values = {key: field.value() for key, field in _search_fields(AsRead(project)).items()}
    values["time_drift"] = values["time_offset"] and values["time_drift"]
    inputs = project.inputs
    values |= {"frames_put_back": inputs.put_back, "frames_left_out": inputs.left_out}
    return values | (OF_PAIR if project.pair else {})


def search_form(project: Project) -> None:
    """The two settings of the search that the paper varies, as sliders."""
    fields, (left, right) = _search_fields(project), st.columns(2)
    delta, acceptance = ASKED["delta"], ASKED["acceptance"]
    widget, acceptance_widget = fields["delta"].widget(), fields["acceptance"].widget()
    steps = sorted({*DELTAS, fields["delta"].value()})
    left.select_slider(delta.title, steps, format_func="{:g}".format, help=delta.help, **widget)
    right.slider(acceptance.title, *RATIOS, step=0.01, help=acceptance.help, **acceptance_widget)


def ask(place: DeltaGenerator, spec: About, field: Field, disabled: bool = False) -> Any:
    """The widget of a described setting; its value."""
    if spec.choices:
        words = spec.choices.__getitem__
        return field.buttons(spec.title, place, format_func=words, help=spec.help)
    if isinstance(spec.default, bool):
        return place.toggle(spec.title, help=spec.help, disabled=disabled, **field.widget())
    options = {} if isinstance(spec.default, int) else {"format": "%.10g"}
    step = 1 if isinstance(spec.default, int) else spec.default / 10
    return field.number_input(spec.title, place, help=spec.help, step=step, **options)


def refine_form(project: Project, dataset: Pair) -> None:
    """The form of the refined method: uncertainties from the Data page, and the image noise.

    That of a pair of a rig is the rig's.
    """
    if project.pair:
        return
    st.markdown("**The refined set**")
    st.caption(REFINED_SET)
    st.caption(escape_markdown(describe_uncertainties(dataset)))
    st.page_link("pages/data.py", label="State it on the Data page")
    noise, free = _refined_fields(project)
    title, none = "Estimate the distortion of", "no camera: as its file says"
    hint = "k1, k2, p1 and p2, from the images of the bar. Needs bars out to the image borders."
    st.multiselect(title, CAMERAS, placeholder=none, help=hint, **free.widget("default"))
    noise.number_input("Noise of an image point, px", help="0: found from the images.")


def refine_settings(project: Project, dataset: Pair) -> RefineSettings:
    """The settings of the refined method, also for pages that do not show the form.

    They hold the uncertainties of the lengths, which a data set's digest does not cover. Those of a
    pair of a rig hold what the rig says.
    """
    if (of_rig := project.rig_settings) is not None:
        return of_rig
    search, (noise, free) = search_values(project), _refined_fields(project)
    return RefineSettings(
        baseline_sigma_m=dataset.baseline_sigma_m,
        distance_sigma_m=dataset.target_distance_sigma_m,
        sigma_px=noise.value() or None,
        free_distortion=tuple(free.value()),
        time_offset=search["time_offset"],
        time_drift=search["time_drift"],
    )


def _refined_fields(project: Project) -> tuple[Field, Field]:
    """The image noise, and the cameras whose distortion is free, in the order of `CAMERAS`."""
    noise = setting(project, "refine_sigma_px", 0.0, Number(0.0, 1e5))

    def in_order(value: Any) -> list[CameraName]:
        return [name for name in CAMERAS if name in value]

    return noise, setting(project, "free_distortion", [], in_order)


def describe_settings(settings: CalibrationSettings) -> str:
    """The settings of a search, in one line."""
    values = settings.to_json()
    return ", ".join(
        f"{spec.name} {f'{value:g}' if isinstance(value := values[name], float) else value}"
        for name, spec in ASKED.items()
        if name not in _FRAMES
    )
