"""Which set a project matches and measures with: the recommended one until the user chooses."""

from __future__ import annotations

from collections.abc import Mapping

from stereocal.calibration.methods import METHOD_NAMES, Method
from stereocal.projects.application import Use
from stereocal.projects.project import Project
from stereocal.ui.fields import Field, one_of, setting, yes_or_no
from stereocal.workflow import Answer

PAPERS: Mapping[Use, Method] = {"matching": "2d", "measuring": "3d"}


def set_in_use(project: Project, use: Use, answer: Answer) -> Field:
    """The set to match or to measure with, among those of a result."""
    return setting(project, f"apply_{use}", answer.recommendation.use[use], one_of([*answer.sets]))


def title_in_use(use: Use, answer: Answer, method: Method) -> str:
    """The name of a set in a menu."""
    recommended = answer.recommendation.use[use] == method
    return METHOD_NAMES[method] + " · recommended" * recommended


def refined_switch(project: Project, use: Use, answer: Answer) -> Field:
    """The same choice as `set_in_use`, as a switch between the refined set and the paper's."""
    chosen, papers = set_in_use(project, use, answer), PAPERS[use]
    name = f"refined_{papers}"
    return Field(
        name,
        name,
        lambda: chosen.value() == "refined",
        lambda on: chosen.set("refined" if on else papers),
        fit=yes_or_no,
    )
