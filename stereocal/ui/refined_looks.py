"""What disagrees, and the looks of Calibrate at the refined set: accuracy, residuals, inputs."""

import streamlit as st

from stereocal.figures import accuracy, lens, one_set
from stereocal.fit.errors.stated_inputs import Input, undetectable_errors
from stereocal.projects.project import Project
from stereocal.ui.fields import choose
from stereocal.ui.figure import is_narrow, show_figure
from stereocal.ui.press import make
from stereocal.ui.texts import escape_markdown
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.pair_run import PairRun


def show_disagreement(inputs: list[Input]) -> None:
    """The inputs that contradict the images, if any."""
    accused = [item for item in inputs if item.accused]
    for item in accused:
        st.warning(escape_markdown(item.advice))
    if accused:
        st.markdown("**What disagrees**")
        words = one_set.describe_disagreement(inputs)
        show_figure(one_set.plot_disagreement(inputs), words, "disagreement")


def show_inputs(answer: PairAnswer | None) -> None:
    """What was stated, what comes out, which errors would go unnoticed, and what would help."""
    inputs = answer.run.inputs if answer else []
    if answer is None or not inputs:
        st.info("Without a forecast, nothing that was typed or measured can be tested.")
        return
    if unknown := undetectable_errors(inputs):
        st.info(escape_markdown(unknown))
        st.page_link("pages/data.py", label="State it on the Data page")
    elif not any(item.accused for item in inputs):
        st.success("Nothing that was typed or measured disagrees with the images.")
    st.table(one_set.disagreement_table(inputs))
    st.caption(
        "The estimate contains what was stated. The disagreement is with what the images "
        "and the other inputs say without it."
    )
    if (forecast := answer.run.forecast) is not None:
        make(answer.run, "advice")
        check = forecast.check.text if forecast.check and forecast.check.holds else ""
        lines = filter(None, [forecast.verdict.figures, check, answer.run.advice])
        st.caption(escape_markdown("\n\n".join(lines)))


def show_accuracy(project: Project, run: PairRun, _answer: PairAnswer | None) -> None:
    """Predicted errors by position."""
    if not _has_refined(run):
        return
    kinds: dict[str, accuracy.Quantity] = {"a distance": "distance", "a point": "point"}
    quantity = kinds[choose(project, "accuracy_of", "Predicted error of", kinds)]
    with st.spinner("Predicting errors by position."):
        make(run, "maps")
    words, result = accuracy.describe_accuracy(run.maps, quantity), run.calibration.refined
    assert result is not None
    show_figure(accuracy.plot_accuracy(run.maps, result, quantity), words, "accuracy")


def show_misfit(_project: Project, run: PairRun, _answer: PairAnswer | None) -> None:
    """Residuals over the images: whether a lens is wrong, or all is noise."""
    if not _has_refined(run):
        return
    with st.spinner("Looking at the residuals."):
        make(run, "misfit")
    figure = lens.plot_misfit(run.misfit, is_narrow())
    show_figure(figure, lens.describe_misfit(run.misfit), "misfit")


def _has_refined(run: PairRun) -> bool:
    if run.calibration.refined is None:
        st.info("There is no refined set of these data.")
    return run.calibration.refined is not None
