"""Fields whose values the project keeps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import streamlit as st

from stereocal.calibrate import CalibrationSettings
from stereocal.dataset import Dataset
from stereocal.montecarlo import SearchSettings
from stereocal.project import Project
from stereocal.ui.intake import UNITS, take_length
from stereocal.ui.project import keeper, remembered


def length_field(project: Project | None, name: str, label: str) -> None:
    """A length with its unit. What the project holds is in metres."""
    value_key, unit_key = f"{name}_value", f"{name}_unit"
    metres = getattr(project.inputs, name) if project else None
    if unit_key not in st.session_state:
        kept = (project.settings if project else {}).get(unit_key)
        st.session_state[unit_key] = kept if kept in UNITS else "m"
    shown = st.session_state.get(value_key)
    unit = UNITS[st.session_state[unit_key]]
    if metres is not None and (shown is None or abs(shown * unit - metres) > 1e-12 * metres):
        refused = st.session_state.get("refused") is not None
        if shown is None or not refused:
            st.session_state[value_key] = float(f"{metres / unit:.12g}")
    field, choice = st.columns([3, 1], vertical_alignment="bottom")
    args = (name, value_key, unit_key)
    st.session_state.setdefault(value_key, None)
    st.session_state[f"{value_key}_drawn"] = (metres, st.session_state[value_key])
    field.number_input(
        label, min_value=0.0, value=None, step=None, format="%.10g", key=value_key,
        on_change=take_length, args=args, placeholder="measured length",
    )  # fmt: skip
    choice.selectbox("Unit", list(UNITS), key=unit_key, on_change=take_length, args=args)


@dataclass(frozen=True)
class _Number:
    key: str
    title: str
    default: float
    lowest: float
    highest: float
    help: str
    format: str


PAPER = SearchSettings()
NUMBERS = (
    _Number("delta", "First step Δ (rad)", PAPER.delta, 1e-9, 0.5,
            "How far an angle is moved at first. Paper: 0.001 rad.", "%.10g"),
    _Number("delta_min", "Smallest step Δ min (rad)", PAPER.delta_min, 1e-12, 0.5,
            "The search ends when the step is smaller. Paper: 0.000001 rad.", "%.10g"),
    _Number("acceptance", "Acceptance ratio", PAPER.acceptance, 0.01, 0.99,
            "The step shrinks when fewer moves than this part are accepted. Paper: 0.2.", "%.10g"),
    _Number("shrink", "Shrink factor", PAPER.shrink, 0.01, 0.99,
            "What the step is multiplied by when it shrinks. Paper: 0.75.", "%.10g"),
    _Number("minimum_moves", "Minimum moves", PAPER.minimum_moves, 1, 100_000,
            "Moves at one step before the ratio is looked at. Paper: 1, to the letter; 20 is "
            "steadier.", "%d"),
    _Number("seed", "Seed", PAPER.seed, 0, 2**31 - 1,
            "Source of the random numbers: the same seed gives the same files.", "%d"),
)  # fmt: skip


def settings_form(project: Project, dataset: Dataset) -> dict[str, Any]:
    """The settings of the calibration, as they stand in the form."""
    frames = len(dataset.correspondences.frames)
    remembered(project, {"calibration_frames": frames})
    st.session_state["calibration_frames"] = min(st.session_state["calibration_frames"], frames)
    if frames > 1:
        st.slider(
            "Frames to calibrate with (the others test the result)",
            1, frames, key="calibration_frames", on_change=keeper(project, "calibration_frames"),
            help=f"All {frames}, or fewer, drawn at random. Paper: 20 of 25.",
        )  # fmt: skip
    chosen = st.session_state["calibration_frames"]
    values = search_form(project)
    return values | {"calibration_frames": None if chosen == frames else chosen}


def search_defaults() -> dict[str, Any]:
    """The settings of the search that the form begins with."""
    return {number.key: number.default for number in NUMBERS} | {"essential": "constrained"}


def search_form(project: Project) -> dict[str, Any]:
    """The settings of the search and of the essential method, in an expander."""
    defaults = search_defaults()
    remembered(project, defaults)
    with st.expander("Settings of the search"):
        columns = st.columns(3)
        for at, number in enumerate(NUMBERS):
            kind = type(number.default)
            columns[at % 3].number_input(
                number.title, kind(number.lowest), kind(number.highest), key=number.key,
                format=number.format, help=number.help, on_change=keeper(project, number.key),
                step=kind(1) if kind is int else number.default / 10,
            )  # fmt: skip
        st.segmented_control(
            "Solver of the essential matrix", ["constrained", "linear"], key="essential",
            required=True, on_change=keeper(project, "essential"),
            help="Constrained: the best essential matrix. Linear: the textbook's 8-point estimate "
            "alone, as the start of the searches.",
        )  # fmt: skip
    return {key: st.session_state[key] for key in defaults}


def settings_of(values: dict[str, Any]) -> CalibrationSettings:
    """The settings that a form's values stand for.

    Raises:
        StereocalError: values that contradict each other.
    """
    return CalibrationSettings.from_json(values)
