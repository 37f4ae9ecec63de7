"""What a project holds and its key result, in a few words, for the list of projects."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from stereocal.calibration.methods import METHOD_NAMES, Method
from stereocal.formats.evaluation_files import validation_figures
from stereocal.projects.application import POINT_FILES
from stereocal.projects.photographs import (
    BOARDS_LABEL,
    FOUND_LABELS,
    TABLE_LABEL,
    ProjectPhotographs,
)
from stereocal.projects.project import Project
from stereocal.projects.recording import ProjectRecording
from stereocal.system.numbers import rounded
from stereocal.verdict.in_words import percent
from stereocal.verdict.recommendation import figures_of

PAPERS: tuple[Method, Method] = ("2d", "3d")


@dataclass(frozen=True)
class Card:
    """A project in two lines."""

    data: str
    result: str


def card_of(project: Project) -> Card:
    """The summary of a project."""
    recording = ProjectRecording(project)
    if recording.is_given:
        return _of_recording(recording)
    dataset = project.dataset
    if dataset is not None:
        data = f"{len(dataset.correspondences.frames)} frames"
    else:
        given = "correspondences" in project.inputs.files
        data = _photographs_of(project) or ("points, data incomplete" if given else "no points yet")
    return Card(data, _result_of(project))


def _of_recording(recording: ProjectRecording) -> Card:
    """Of three cameras and more."""
    data, rig = f"{recording.camera_count} cameras", recording.rig
    if rig is None:
        return Card(data, "not calibrated")
    figures = rig.about["figures"]
    length = figures["length_error_p95"]
    lengths = "" if length is None else f", 95 % of lengths within {percent(length)} %"
    noise = {name: own["noise_px"] for name, own in rig.about["pairs"].items() if "noise_px" in own}
    worst = max(noise, key=lambda name: float(noise[name]), default=None)
    last = "" if worst is None else f", worst pair {worst} with {rounded(noise[worst])} px"
    return Card(data, f"One rig: {rounded(figures['reprojection_px'])} px{lengths}{last}")


def title_of(project: Project) -> str:
    """The user's name for a project; without one, its data and the day of its first file."""
    with project.database.reading():
        inputs = project.inputs
        if inputs.name:
            return inputs.name
        name = Path(inputs.labels.get("correspondences", TABLE_LABEL)).stem
        if name in FOUND_LABELS:
            points = [file.label for file in project.database.files(POINT_FILES).values()]
            files = [*points, *inputs.labels.values(), *ProjectRecording(project).parts]
            own = (label for label in files if label not in FOUND_LABELS)
            name = _photographs_of(project) or next(own, "Nothing yet")
        ((first,),) = project.database.rows("SELECT min(stored) FROM file")
    begun = datetime.fromtimestamp(first or project.database.path.stat().st_mtime)
    return f"{name}, {begun.astimezone().strftime('%Y-%m-%d')}"


def _photographs_of(project: Project) -> str:
    photographs = len(ProjectPhotographs(project).photographs)
    held = "of a board" if BOARDS_LABEL in project.inputs.labels.values() else ""
    return f"{photographs} photographs {held}".rstrip() if photographs else ""


def _result_of(project: Project) -> str:
    """The errors of the sets to use, each at its own job, on held-out frames."""
    if project.calibration is None:
        return "not calibrated"
    evaluation = project.calibration_evaluation
    if evaluation is None:
        return "calibrated, not validated"
    held_out = validation_figures(evaluation.summaries, evaluation.settings)
    to_use = project.recommended or PAPERS
    match, measure = (figures_of(method, None, held_out) for method in to_use)
    lengths, wrong = (
        "unknown" if value is None else f"{percent(value)} %"
        for value in (measure.length_median.held_out, match.wrong_let_in.held_out)
    )
    names = " and ".join(dict.fromkeys(METHOD_NAMES[each.method] for each in (match, measure)))
    return f"{names}, held out: lengths {lengths}, wrong pairs {wrong}"
