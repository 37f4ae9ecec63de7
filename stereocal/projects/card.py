"""What a project holds and its key result, in a few words, for the list of projects."""

from __future__ import annotations

from dataclasses import dataclass

from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project


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
    """The mean errors of each of the paper's two sets at its own job, on all frames kept."""
    found = project.calibration
    if found is None:
        return "not calibrated"
    length = 100 * found.errors["3d"].mean_length
    return f"lengths {length:.2g} %, pairs {found.errors['2d'].mean_reprojection_px:.2g} px"
