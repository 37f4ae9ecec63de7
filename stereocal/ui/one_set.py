"""The page One set or two: verdict, what disagrees, trade-off, accuracy, the refined set."""

from concurrent.futures import Future
from dataclasses import replace

import streamlit as st

from stereocal.calibration.methods import Method
from stereocal.evaluation.evaluate import count_set
from stereocal.evaluation.summary import figures_of_set
from stereocal.figures import accuracy, lens, one_set, tables
from stereocal.projects.application import USES
from stereocal.projects.project import Project
from stereocal.refined.refine import RefinedResult
from stereocal.refined.stated_inputs import Input, undetectable_errors
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.dataset import Dataset
from stereocal.rig.rig import Rig
from stereocal.system.latest import Latest
from stereocal.system.numbers import count
from stereocal.ui import jobs, refined
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Number, choose, setting
from stereocal.ui.figure import show_figure
from stereocal.ui.forms import search_values, settings_of
from stereocal.ui.messages import end_here, fragment, readable
from stereocal.ui.parameter_files import PURPOSES
from stereocal.ui.prerequisites import project_with_data
from stereocal.ui.press import offer_again
from stereocal.ui.results import show_recommendation
from stereocal.ui.screening import is_long
from stereocal.ui.texts import ONE_SET, escape_markdown
from stereocal.verdict.in_words import digits, percent
from stereocal.verdict.tradeoff import costs_of
from stereocal.workflow import Answer, conclusions_of_seeds

_SEEDS: Latest[Future[str]] = Latest(500)
"""What other seeds give, by all that it depends on: a sentence each."""
MOST_NAMED = 12
"""Maximum number of left-out frames listed on the page."""


def show_page() -> None:
    """What the last calibration tells; before the first, what data and form give."""
    project, inputs, dataset = project_with_data("one_set")
    offer_again(project, inputs, dataset)
    with st.expander("What the refined set is, and what it may change"):
        st.markdown(ONE_SET)
        settings = refined.refine_form(project, dataset)
    calibration = readable(lambda: project.calibration)
    if calibration is None:
        answer = _not_calibrated_yet(project, dataset, settings)
    else:
        settings = refined.settings_of_result(project, calibration)
        answer = refined.answer_when_ready(project, calibration)
    if answer is None:
        refined.wait_for_answer(project)
        end_here()
    screening, result = answer.calibration.screening, answer.calibration.refined
    kept = screening.dataset
    if result is None or len(answer.calibration.held_out_frames):
        result = refined.refined_of(kept, settings)
    show_recommendation(answer)
    if outlook := answer.outlook:
        own, check = outlook.verdict.figures, outlook.check
        lines = [own, check.text if check and check.holds else "", outlook.advice]
        st.caption(escape_markdown("\n\n".join(filter(None, lines))))
    place = st.container()
    _show_download(project, answer, calibration is not None)
    st.header("What disagrees", divider="gray")
    _show_disagreement(answer.inputs)
    _show_frames_left_out(result, bool(screening.left_out))
    views = {
        "Matching against measuring": lambda: _show_trade_off(project, answer, result, settings),
        "How accurate, where": lambda: _show_accuracy(project, result, kept, settings),
        "Residuals by place": lambda: _show_misfit(kept, settings),
        "The refined set": lambda: _show_parameters(result),
    }
    views[choose(project, "one_set_view", "Look at", views)]()
    with place:  # last, because the trials take the processor from the rest of the page
        _show_seeds(answer)


def _not_calibrated_yet(
    project: Project, dataset: Dataset, settings: RefineSettings
) -> Answer | None:
    """What data and form give; None for a recording that is too long for that."""
    if is_long(dataset):
        st.info("For a recording this long, press Calibrate first.")
        st.page_link("pages/calibrate.py", label="Calibrate")
        return None
    search = settings_of(search_values(project))
    found = refined.calibrated(dataset, search)
    found = replace(found, refined=refined.refined_of(found.screening.dataset, settings))
    return refined.answer_for(found, settings, None)


def _show_disagreement(inputs: list[Input]) -> None:
    accused = [item for item in inputs if item.accused]
    for item in accused:
        st.warning(escape_markdown(item.advice))
    if unknown := undetectable_errors(inputs):
        st.info(escape_markdown(unknown))
        st.page_link("pages/data.py", label="State it on the Data page")
    elif inputs and not accused:
        st.success("Nothing that was typed or measured disagrees with the images.")
    if accused:
        words = one_set.describe_disagreement(inputs)
        show_figure(one_set.plot_disagreement(inputs), words, "disagreement")
    if inputs:
        with st.expander("Stated and estimated", expanded=not accused):
            st.table(one_set.disagreement_table(inputs))
            st.caption(
                "The estimate contains what was stated. The disagreement is with what the images "
                "and the other inputs say without it."
            )


def _show_seeds(answer: Answer) -> None:
    """Whether another seed would change which files to use, tried beside the page."""
    found, outlook = answer.calibration, answer.outlook
    if outlook is None:
        return
    tried = _SEEDS.once(
        refined.key_of(found), lambda: jobs.pool().submit(conclusions_of_seeds, found, outlook)
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


def _show_frames_left_out(result: RefinedResult, others: bool) -> None:
    """The frames that only the refined set left out; the recommendation names the `others`."""
    left_out = result.outlying_frames
    if not left_out:
        if not others:
            st.markdown(f"All {len(result.frames):,} frames fit; none was left out.")
        return
    named = [f"{frame} ({digits(100 * part, 2)} %)" for frame, part in left_out.items()]
    more = f" and {len(named) - MOST_NAMED} more, all named in the file" * (len(named) > MOST_NAMED)
    st.warning(
        f"Left out of the refined set, because they do not fit: {count(len(named), 'frame')} of "
        f"{len(result.frames):,}, in brackets their share of chi-square: "
        f"{', '.join(named[:MOST_NAMED])}{more}. Look at them on the Data page."
    )


@fragment
def _show_trade_off(
    project: Project, answer: Answer, result: RefinedResult, settings: RefineSettings
) -> None:
    calibration = answer.calibration
    dataset = calibration.screening.dataset
    curves = refined.curves_when_ready(project, dataset, settings)
    if curves is None:
        return
    sets: dict[Method, Rig] = {"refined": Rig(result.primary, result.secondary, result.pose)}
    for method, found in calibration.methods.items():
        sets[method] = Rig(dataset.primary, dataset.secondary, found.pose)
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
    own = chosen.parameters(dataset)
    seen = replace(dataset, primary=own.primary, secondary=own.secondary)
    fcp, median = figures_of_set(count_set(seen, own.pose))
    st.markdown(
        "At the slider's point, on the frames it was fitted to: overlap of correct and wrong pairs "
        f"(FCP) **{percent(fcp)} %**, 3D error (median) **{percent(median)} %**."
    )
    with st.expander("Its parameters"):
        st.table(tables.parameters_table(own))
    name = "parameters_refined_point.json"
    offer("Download the slider's point", own.dumps(), name, "download_point")


def _show_accuracy(
    project: Project, result: RefinedResult, dataset: Dataset, settings: RefineSettings
) -> None:
    kinds: dict[str, accuracy.Quantity] = {"a distance": "distance", "a point": "point"}
    quantity = kinds[choose(project, "accuracy_of", "Predicted error of", kinds)]
    maps = refined.maps_of(dataset, settings)
    words = accuracy.describe_accuracy(maps, quantity)
    show_figure(accuracy.plot_accuracy(maps, result, quantity), words, "accuracy")


def _show_misfit(dataset: Dataset, settings: RefineSettings) -> None:
    """Residuals over the images: whether a lens is wrong, or all is noise."""
    found = refined.misfit_for(dataset, settings)
    wide, narrow = (lens.plot_misfit(found, small) for small in (False, True))
    show_figure(wide, lens.describe_misfit(found), "misfit", narrow=narrow)


def _show_download(project: Project, answer: Answer, calibrated_now: bool) -> None:
    """`calibrated_now`: the answer is of the last calibration, and its threshold final."""
    name = "parameters_refined.json"
    with st.container(horizontal=True, vertical_alignment="center"):
        told = None if calibrated_now else "Calibrate first: the validation gives its threshold."
        offer(
            f"Download {name}",
            lambda: answer.sets["refined"].dumps(),
            name,
            "download_refined",
            disabled=not calibrated_now,
            help=told,
        )
        told = "On the Apply page. The recommendation holds until you choose."
        for use in USES:
            own = refined.refined_switch(project, use, answer)
            st.toggle(f"{PURPOSES[use]} the refined set", help=told, **own.widget())


def _show_parameters(result: RefinedResult) -> None:
    st.table(tables.refined_table(result))
    st.caption(
        f"Noise of an image point {digits(result.sigma_px.value)} px "
        f"({result.sigma_px.source}); scatter of the bar's length "
        f"{digits(1000 * result.scatter_m.value)} mm ({result.scatter_m.source})."
    )
