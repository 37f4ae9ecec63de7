"""What disagrees, and the looks of Calibrate at the refined set: accuracy, residuals, trade-off."""

from concurrent.futures import Future
from dataclasses import replace
from typing import get_args

import streamlit as st

from stereocal.calibration.methods import Method
from stereocal.evaluation.evaluate import count_set
from stereocal.evaluation.summary import figures_of_set
from stereocal.figures import accuracy, lens, one_set
from stereocal.projects.project import Project
from stereocal.refined.misfit import Misfit, misfit_of
from stereocal.refined.refine import RefinedResult
from stereocal.refined.results import Calibration
from stereocal.refined.stated_inputs import Input, undetectable_errors
from stereocal.refined.uncertainty import AccuracyMap, Plane, accuracy_map
from stereocal.rig.rig import Rig
from stereocal.system.latest import Latest
from stereocal.ui import jobs
from stereocal.ui.fields import Number, choose, setting
from stereocal.ui.figure import show_figure
from stereocal.ui.refined import BY_CONTENT, curves_when_ready, key_of
from stereocal.ui.texts import escape_markdown
from stereocal.verdict.in_words import percent
from stereocal.verdict.tradeoff import costs_of
from stereocal.workflow import Answer, conclusions_of_seeds

_SEEDS: Latest[Future[str]] = Latest(500)
"""What other seeds give, by all that it depends on: a sentence each."""
MAP_SIZE = 45
"""Points of an accuracy map along each side; both maps take 0.1 s."""


def show_disagreement(inputs: list[Input]) -> None:
    """The inputs that contradict the images, if any."""
    accused = [item for item in inputs if item.accused]
    for item in accused:
        st.warning(escape_markdown(item.advice))
    if accused:
        st.markdown("**What disagrees**")
        words = one_set.describe_disagreement(inputs)
        show_figure(one_set.plot_disagreement(inputs), words, "disagreement")


def show_inputs(_project: Project, _found: Calibration, answer: Answer | None) -> None:
    """What was stated, what comes out, and which errors would go unnoticed."""
    inputs = answer.inputs if answer else []
    if not inputs:
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


def show_accuracy(project: Project, found: Calibration, _answer: Answer | None) -> None:
    """Predicted errors by position."""
    if (result := _refined(found)) is None:
        return
    kinds: dict[str, accuracy.Quantity] = {"a distance": "distance", "a point": "point"}
    quantity = kinds[choose(project, "accuracy_of", "Predicted error of", kinds)]
    maps = _maps_of(found, result)
    words = accuracy.describe_accuracy(maps, quantity)
    show_figure(accuracy.plot_accuracy(maps, result, quantity), words, "accuracy")


def show_misfit(_project: Project, found: Calibration, _answer: Answer | None) -> None:
    """Residuals over the images: whether a lens is wrong, or all is noise."""
    if (result := _refined(found)) is None:
        return
    misfit = _misfit_of(found, result)
    wide, narrow = (lens.plot_misfit(misfit, small) for small in (False, True))
    show_figure(wide, lens.describe_misfit(misfit), "misfit", narrow=narrow)


def show_trade_off(project: Project, found: Calibration, answer: Answer | None) -> None:
    """The sets in matching and in measuring, and the curves of all that lies between."""
    if (result := _refined(found)) is None:
        return
    if answer is not None and (outlook := answer.outlook) is not None:
        check = outlook.check.text if outlook.check and outlook.check.holds else ""
        lines = filter(None, [outlook.verdict.figures, check, outlook.advice])
        st.caption(escape_markdown("\n\n".join(lines)))
    dataset = found.screening.dataset
    curves = curves_when_ready(project, dataset, result.settings)
    if curves is None:
        return
    sets: dict[Method, Rig] = {"refined": result.rig}
    for method, of_method in found.methods.items():
        sets[method] = Rig(dataset.primary, dataset.secondary, of_method.pose)
    costs = costs_of(dataset, sets)
    along = setting(project, "along", 50, Number(0, 100))
    left, right = st.columns(2)
    which = choose(
        project, "curve", "Curve", (one_set.FREED, one_set.FIXED), place=left, tabs_own=False
    )
    share = right.slider("From matching (0) to measuring (100)", 0, 100, **along.widget())
    points = curves.fixed if which == one_set.FIXED else curves.freed
    chosen = points[round(share / 100 * (len(points) - 1))]
    words = one_set.describe_trade_off(curves, costs)
    show_figure(one_set.plot_trade_off(curves, costs, chosen), words, "trade_off")
    rig = chosen.rig
    seen = replace(dataset, primary=rig.primary, secondary=rig.secondary)
    fcp, median = figures_of_set(count_set(seen, rig.pose))
    st.markdown(
        "At the slider's point, on the frames it was fitted to: overlap of correct and wrong pairs "
        f"(FCP) **{percent(fcp)} %**, 3D error (median) **{percent(median)} %**."
    )


def show_seeds(answer: Answer) -> None:
    """Whether another seed would change which files to use, tried beside the page."""
    found, outlook = answer.calibration, answer.outlook
    if outlook is None:
        return
    tried = _SEEDS.once(
        key_of(found), lambda: jobs.pool().submit(conclusions_of_seeds, found, outlook)
    )
    if not tried.done():
        _wait_for_seeds(tried)
    elif sentence := tried.result():
        st.info(escape_markdown(sentence))


@st.fragment(run_every=0.5)
def _wait_for_seeds(tried: Future[str]) -> None:
    if tried.done():
        st.rerun()
    st.caption("Trying other seeds of the search.")


def _refined(found: Calibration) -> RefinedResult | None:
    if found.refined is None:
        st.info("There is no refined set of these data.")
    return found.refined


@st.cache_resource(
    show_spinner="Predicting errors by position.", max_entries=16, hash_funcs=BY_CONTENT
)
def _maps_of(found: Calibration, _result: RefinedResult) -> list[AccuracyMap]:
    """From above and from the side."""
    assert found.refined is _result
    return [jobs.compute(accuracy_map, _result, MAP_SIZE, plane) for plane in get_args(Plane)]


@st.cache_resource(show_spinner="Looking at the residuals.", max_entries=16, hash_funcs=BY_CONTENT)
def _misfit_of(found: Calibration, _result: RefinedResult) -> Misfit:
    assert found.refined is _result
    return jobs.compute(misfit_of, _result)
