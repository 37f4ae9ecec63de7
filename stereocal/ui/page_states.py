"""The state of each page, for the menu: done, out of date, or not done yet."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from stereocal.figures.style import count
from stereocal.network.rig_file import RIG
from stereocal.projects.application import IMAGES, ProjectApplication, ProjectCheck
from stereocal.projects.project import Project
from stereocal.projects.recording import RIG_FILES, ProjectRecording
from stereocal.ui.forms import form_values, search_values, settings_of, staleness
from stereocal.ui.refined import refine_settings

Mark = Literal["done", "stale", "missing"]
ICONS: Mapping[Mark, str] = {
    "done": ":material/check_circle:",
    "stale": ":material/sync_problem:",
    "missing": ":material/radio_button_unchecked:",
}
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class PageState:
    """How far a page is."""

    mark: Mark
    words: str

    @property
    def icon(self) -> str:
        """Its mark in the menu."""
        return ICONS[self.mark]


def page_states(project: Project | None) -> dict[str, PageState]:
    """The state of each page by the name of its file; empty without a project that can be read.

    Nothing is computed: on the sample, with all results, 3 ms.
    """
    if project is None:
        return {}
    try:
        with project.database.reading():
            return _states(project)
    except Exception:  # the pages themselves report what is wrong
        _LOG.debug("The states of the pages cannot be read.", exc_info=True)
        return {}


def _states(project: Project) -> dict[str, PageState]:
    recording = ProjectRecording(project.whole)
    if not recording.is_given:
        return _of_two(project)
    kept = recording.database.file(RIG_FILES, RIG)
    of_rig = (
        PageState("missing", "Not calibrated yet")
        if kept is None
        else PageState("done", "Calibrated together")
    )
    if project.pair is None:
        return {"data": PageState("done", "A recording of several cameras"), "rig": of_rig}
    return {**_of_two(project), "rig": of_rig}


def _of_two(project: Project) -> dict[str, PageState]:
    inputs, dataset = project.inputs, project.dataset
    lenses = [slot for slot in ("primary", "secondary") if slot not in inputs.files]
    found = {
        "cameras": PageState("missing", f"No lens of the {' and '.join(lenses)} camera yet")
        if lenses
        else PageState("done", "Both lenses are known")
    }
    if dataset is None:
        lacking = f"Missing: {', '.join(inputs.missing)}"
        data = ("data", "calibrate", "validate", "one_set")
        without = {name: PageState("missing", lacking) for name in data}
        return found | without | _applied(project) | _checked(project)
    frames = count(len(dataset.correspondences.frames), "frame")
    calibrate, validate = _calibrate(project), _validate(project)
    return {
        **found,
        "data": PageState("done", frames),
        "calibrate": calibrate,
        "validate": validate,
        # It shows the results of both.
        "one_set": next((each for each in (calibrate, validate) if each.mark != "done"), validate),
        **_applied(project, calibrate),
        **_checked(project),
    }


def _calibrate(project: Project) -> PageState:
    result, dataset = project.calibration, project.dataset
    assert dataset is not None
    if result is None:
        return PageState("missing", "Not calibrated yet")
    if staleness(result, dataset, form_values(project, dataset)):
        return PageState("stale", "The data or the settings have changed since this result")
    left_out = result.screening.left_out
    named = f", {count(len(left_out), 'frame')} left out" if left_out else ""
    return PageState("done", f"Calibrated{named}")


def _validate(project: Project) -> PageState:
    evaluation, dataset = project.evaluation, project.dataset
    assert dataset is not None
    if evaluation is None:
        return PageState("missing", "Not validated yet")
    made_with, kept = evaluation.settings, project.settings
    same = (
        dataset.sha256 in evaluation.sha256
        and made_with.calibration == settings_of(search_values(project))
        and made_with.splits == kept.get("validate_splits", made_with.splits)
        and made_with.runs == kept.get("validate_runs", made_with.runs)
        and made_with.calibration_frames
        == kept.get("validate_frames", made_with.calibration_frames)
        and (len(evaluation.sha256) > 1 or made_with.refined == refine_settings(project, dataset))
    )
    if not same:
        return PageState("stale", "The data or the settings have changed since this validation")
    return PageState("done", f"Validated, {count(made_with.runs, 'run')}")


def _applied(project: Project, calibrate: PageState | None = None) -> dict[str, PageState]:
    if ProjectApplication(project).result is None:
        return {"apply": PageState("missing", "No points matched yet")}
    given = project.settings.get("apply_sets") == "Parameter files"
    if calibrate is not None and calibrate.mark == "stale" and not given:
        return {"apply": PageState("stale", "The calibration is out of date")}
    return {"apply": PageState("done", "Points matched and measured")}


def _checked(project: Project) -> dict[str, PageState]:
    matched = ProjectApplication(project).result is not None
    if ProjectCheck(project).file(IMAGES) is None and not matched:
        return {"check": PageState("missing", "No new bars or points yet")}
    return {"check": PageState("done", "New images are given")}
