"""What a project holds and its key result, in a few words, for the list of projects."""

from __future__ import annotations

from dataclasses import dataclass

from stereocal.calibration.methods import Method
from stereocal.formats.evaluation_files import validation_figures
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.verdict.in_words import percent
from stereocal.verdict.recommendation import figures_of

PAPER: tuple[Method, Method] = ("2d", "3d")


@dataclass(frozen=True)
class Card:
    """A project in two lines."""

    data: str
    result: str


def card_of(project: Project) -> Card:
    """The summary of a project.

    Raises:
        StereocalError: it cannot be read.
    """
    return Card(_data_of(project), _result_of(project))


def _data_of(project: Project) -> str:
    dataset = project.dataset
    if dataset is not None:
        return f"{len(dataset.correspondences.frames)} frames"
    photographs = len(ProjectPhotographs(project).photographs)
    return f"{photographs} photographs" if photographs else "no points yet"


def _result_of(project: Project) -> str:
    """The errors of each of the paper's two sets at its own job, on held-out frames."""
    if project.calibration is None:
        return "not calibrated"
    evaluation = project.calibration_evaluation
    if evaluation is None:
        return "calibrated, not validated"
    held_out = validation_figures(evaluation.summaries, evaluation.settings)
    match, measure = (figures_of(method, None, held_out) for method in PAPER)
    lengths, wrong = measure.length_median.held_out, match.wrong_let_in.held_out
    return f"held out: lengths {_percent(lengths)}, wrong pairs {_percent(wrong)}"


def _percent(value: float | None) -> str:
    return "unknown" if value is None else f"{percent(value)} %"
