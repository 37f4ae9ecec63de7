"""The refined method on the screen: its form, and its results, computed once for the same data."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import streamlit as st

from stereocal.calibrate import Calibration, CalibrationSettings, calibrate
from stereocal.dataset import Dataset
from stereocal.errors import StereocalError
from stereocal.project import Project
from stereocal.refine import RefinedResult, refine
from stereocal.refined.disagreement import Input, what_disagrees
from stereocal.refined.tradeoff import TradeOff, trade_off
from stereocal.refined.uncertainty import AccuracyMap, accuracy_map
from stereocal.refined.unknowns import (
    DEFAULT_BASELINE,
    DEFAULT_DISTANCE,
    FIXED_LENS,
    LensPrior,
    RefineSettings,
    lens_prior,
)
from stereocal.ui import jobs
from stereocal.ui.fields import Field, number, one_of, setting

FREE, HELD = "Free, within their uncertainty", "Held as given"


def defaults(dataset: Dataset) -> dict[str, Any]:
    """What the form says until somebody changes it."""
    lenses = [lens_prior(camera, None) for camera in (dataset.primary, dataset.secondary)]
    baseline = dataset.baseline_sigma_m or DEFAULT_BASELINE * dataset.baseline_m
    distance = dataset.target_distance_sigma_m or DEFAULT_DISTANCE * dataset.target_distance_m
    return {
        "refine_lenses": FREE,
        "refine_focal_percent": round(max(100 * lens.focal for lens in lenses), 4),
        "refine_centre_px": round(max(lens.centre_px for lens in lenses), 3),
        "refine_baseline_mm": round(1000 * baseline, 3),
        "refine_distance_mm": round(1000 * distance, 4),
        "refine_sigma_px": 0.0,
    }


def refine_form(project: Project, dataset: Dataset) -> RefineSettings:
    """How well everything is known, in an expander."""
    fields = _fields(project, dataset)
    with st.expander("How well the inputs are known"):
        st.segmented_control(
            "Lenses", [FREE, HELD], required=True, **fields["refine_lenses"].widget()
        )
        columns = st.columns(2)
        for at, (key, title, text) in enumerate(
            (
                ("refine_baseline_mm", "Baseline, ± mm", "0 holds it as measured."),
                ("refine_distance_mm", "Distance A–B, ± mm", "0 holds it as measured."),
                ("refine_focal_percent", "Focal lengths, ± %", "How far a lens may be off."),
                ("refine_centre_px", "Image centres, ± px", "How far a lens may be off."),
                ("refine_sigma_px", "Noise of an image point, px", "0: found from the images."),
            )
        ):
            columns[at % 2].number_input(
                title, 0.0, 1e5, help=text, format="%.4g", **fields[key].widget()
            )
    return refine_settings(project, dataset)


def _fields(project: Project, dataset: Dataset) -> dict[str, Field]:
    return {
        key: setting(
            project, key, usual,
            one_of((FREE, HELD)) if isinstance(usual, str) else number(0.0, 1e5),
        )
        for key, usual in defaults(dataset).items()
    }  # fmt: skip


def refine_settings(project: Project, dataset: Dataset) -> RefineSettings:
    """The settings of the form, also on pages that do not show it."""
    values = {key: field.value() for key, field in _fields(project, dataset).items()}
    return settings_of(values, dataset)


def settings_of(values: Mapping[str, Any], dataset: Dataset) -> RefineSettings:
    """The settings that the form's values stand for.

    A lens keeps what its own calibration says of it until somebody types something else.

    Raises:
        StereocalError: a negative number.
    """
    typed = LensPrior(values["refine_focal_percent"] / 100, values["refine_centre_px"])
    keys = ("refine_focal_percent", "refine_centre_px")
    untouched = all(values[key] == defaults(dataset)[key] for key in keys)
    lens = None if untouched else typed
    lens = lens if values["refine_lenses"] == FREE else FIXED_LENS
    return RefineSettings(
        primary=lens,
        secondary=lens,
        baseline_sigma_m=values["refine_baseline_mm"] / 1000,
        distance_sigma_m=values["refine_distance_mm"] / 1000,
        sigma_px=values["refine_sigma_px"] or None,
    )


def refined_of(dataset: Dataset, settings: RefineSettings) -> RefinedResult:
    """The refined set. Raises as `refine`."""
    return _refined(_key(dataset, settings), dataset, settings)


def refined_for(
    project: Project, calibration: Calibration
) -> tuple[RefinedResult | None, list[str]]:
    """The refined set of a calibration's frames, and which purposes it is to serve.

    None where it cannot be found: the paper's sets do not depend on it.
    """
    dataset = calibration.screening.dataset
    if len(calibration.held_out_frames):
        dataset = dataset.of_frames(calibration.frames)
    try:
        refined = refined_of(dataset, refine_settings(project, dataset))
    except StereocalError:
        return None, []
    kept = project.settings
    return refined, [purpose for purpose in ("2d", "3d") if kept.get(f"refined_{purpose}")]


def calibrated(dataset: Dataset, settings: CalibrationSettings) -> Calibration:
    """The paper's sets, where nobody has calibrated these data yet. Raises as `calibrate`."""
    return _calibrated(_key(dataset, settings), dataset, settings)


def inputs_of(dataset: Dataset, settings: RefineSettings) -> list[Input]:
    """What disagrees. Raises as `refine`."""
    return _inputs(_key(dataset, settings), dataset, settings)


def map_of(dataset: Dataset, settings: RefineSettings) -> AccuracyMap:
    """How accurate the rig is, by place. Raises as `refine`."""
    return _map(_key(dataset, settings), dataset, settings)


def curves_of(dataset: Dataset, settings: RefineSettings) -> TradeOff:
    """The trade-off. Raises as `trade_off`."""
    return _curves(_key(dataset, settings), dataset, settings)


def _key(dataset: Dataset, settings: RefineSettings | CalibrationSettings) -> str:
    """All that a result tells: the digest is of the numbers, and a project with the same numbers
    must not be shown somebody else's name and notes.
    """
    words = [dataset.sha256, dataset.name, dataset.notes, settings.to_json()]
    return json.dumps(words, sort_keys=True)


# Kept by digest: Streamlit would otherwise look at a sample of large arrays only.


@st.cache_resource(show_spinner="Refining.", max_entries=16)
def _refined(key: str, _dataset: Dataset, _settings: RefineSettings) -> RefinedResult:
    assert key
    return jobs.compute(refine, _dataset, _settings)


@st.cache_resource(show_spinner="Calibrating.", max_entries=16)
def _calibrated(key: str, _dataset: Dataset, _settings: CalibrationSettings) -> Calibration:
    assert key
    return jobs.compute(calibrate, _dataset, _settings)


@st.cache_resource(show_spinner="Looking for inputs that disagree.", max_entries=16)
def _inputs(key: str, _dataset: Dataset, _settings: RefineSettings) -> list[Input]:
    return jobs.compute(what_disagrees, _refined(key, _dataset, _settings))


@st.cache_resource(show_spinner="Predicting errors by place.", max_entries=16)
def _map(key: str, _dataset: Dataset, _settings: RefineSettings) -> AccuracyMap:
    return jobs.compute(accuracy_map, _refined(key, _dataset, _settings))


@st.cache_resource(show_spinner="Tracing the trade-off.", max_entries=16)
def _curves(key: str, _dataset: Dataset, _settings: RefineSettings) -> TradeOff:
    assert key
    found = jobs.compute(trade_off, _dataset, _settings)
    assert found is not None  # nobody cancels here
    return found
