"""The state of each page, for the menu: done, out of date, or not done yet."""

import logging
from collections.abc import Mapping
from typing import Literal, NamedTuple

from stereocal.calibration.essential import MINIMUM_PAIRS
from stereocal.projects.application import IMAGES, ProjectApplication, ProjectCheck
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from stereocal.rig.pair import Pair
from stereocal.system.numbers import count
from stereocal.ui.press import changed_since
from stereocal.ui.rig import pair_field
from stereocal.ui.validation import chosen_data, current_validation

Mark = Literal["done", "stale", "missing"]
ICONS: Mapping[Mark, str] = {
    "done": ":material/check_circle:",
    "stale": ":material/sync_problem:",
    "missing": ":material/radio_button_unchecked:",
}
_LOG = logging.getLogger(__name__)


class PageState(NamedTuple):
    """How far a page is."""

    mark: Mark
    words: str

    @property
    def icon(self) -> str:
        """Its mark in the menu."""
        return ICONS[self.mark]


NOT_VALIDATED = PageState("missing", "Not validated yet")


def page_states(project: Project | None) -> dict[str, PageState]:
    """The state of each page by the name of its file; empty without a project that can be read.

    Nothing is computed: on the sample, with all results, 3 ms.
    """
    if project is None:
        return {}
    try:
        with project.database.reading():
            return _of_several(project) if project.is_rig else _of_two(project)
    except Exception:  # the pages themselves report what is wrong
        _LOG.debug("The states of the pages cannot be read.", exc_info=True)
        return {}


def _done_if(done: object, yes: str, no: str) -> PageState:
    return PageState("done", yes) if done else PageState("missing", no)


def _of_several(project: Project) -> dict[str, PageState]:
    cameras, validate = f"{project.camera_count} cameras", NOT_VALIDATED
    if project.inputs.windows:
        validate = PageState("missing", "Only for cameras in air")
    elif (rig := project.rig) is not None:
        pair = project.of_pair(pair_field(project, rig).value())
        if (dataset := pair.dataset) is not None:
            validate = _validate(pair, dataset)
    return {
        "cameras": PageState("done", f"The lenses of {cameras} are known"),
        "data": PageState("done", f"A recording of {cameras}"),
        "calibrate": _calibrate(project),
        "validate": validate,
        **_of_use(project),
    }


def _of_use(project: Project) -> dict[str, PageState]:
    applied = ProjectApplication(project).result
    has_images = ProjectCheck(project).file(IMAGES) or (applied and not project.is_rig)
    return {
        "apply": _done_if(applied, "Points matched and measured", "No points matched yet"),
        "check": _done_if(has_images, "New images are given", "No new bars or points yet"),
    }


def _of_two(project: Project) -> dict[str, PageState]:
    inputs, dataset = project.inputs, project.dataset
    lenses = [slot for slot in CAMERAS if slot not in inputs.files]
    lacking = f"No lens of the {' and '.join(lenses)} camera yet"
    states = {"cameras": _done_if(not lenses, "Both lenses are known", lacking), **_of_use(project)}
    if dataset is None:
        missing = PageState("missing", f"Missing: {', '.join(inputs.missing)}")
        return states | dict.fromkeys(("data", "calibrate", "validate"), missing)
    points = dataset.correspondences
    data = PageState("done", count(len(points.frames), "frame"))
    if len(points) < MINIMUM_PAIRS:
        pairs = count(len(points), "pair")
        data = PageState("missing", f"{pairs}, at least {MINIMUM_PAIRS} needed")
    calibrate = _calibrate(project)
    uses_results = project.settings.get("apply_sets") != "Parameter files"
    if states["apply"].mark == "done" and uses_results and calibrate.mark == "stale":
        states["apply"] = calibrate
    return {**states, "data": data, "calibrate": calibrate, "validate": _validate(project, dataset)}


def _calibrate(project: Project) -> PageState:
    calibration = None if project.is_rig else project.calibration
    if calibration is None and not (project.is_rig and project.rig):
        return PageState("missing", "Not calibrated yet")
    if changed := changed_since(project):
        return PageState("stale", f"Changed since: {changed}")
    if calibration is None:
        return PageState("done", "Calibrated together")
    left_out = calibration.screening.left_out
    named = f", {count(len(left_out), 'frame')} left out" if left_out else ""
    return PageState("done", f"Calibrated{named}")


def _validate(project: Project, dataset: Pair) -> PageState:
    if not (project.evaluation or project.calibration_evaluation):
        return NOT_VALIDATED
    validation = current_validation(project, chosen_data(project, dataset))
    if validation is None:
        return PageState("stale", "The data or the settings have changed since")
    return PageState("done", f"Validated, {count(validation.settings.runs, 'run')}")
