"""The result on the Calibrate page: recommendation, figures, downloads, and closer looks."""

from __future__ import annotations

from functools import partial

import streamlit as st

from stereocal.calibration.methods import METHOD_NAMES
from stereocal.figures.rig import describe_rig, plot_rig
from stereocal.figures.space import VIEWS
from stereocal.formats.dataset_files import pack_dataset
from stereocal.matching.application import Outcome
from stereocal.projects.application import ProjectApplication
from stereocal.projects.project import Project
from stereocal.refined.results import Calibration
from stereocal.rig.dataset import Dataset
from stereocal.rig.lengths_in_words import as_held, word_of
from stereocal.system.zip_files import pack_zip
from stereocal.ui.closer_looks import look_at_frame, show_closer_looks
from stereocal.ui.downloads import offer
from stereocal.ui.fields import choose
from stereocal.ui.figure import show_figure
from stereocal.ui.messages import fragment, readable
from stereocal.ui.parameter_files import FILES, hold_downloads, parameter_downloads
from stereocal.ui.screening import offer_to_bring_into_step, show_left_out
from stereocal.ui.texts import escape_markdown
from stereocal.verdict.in_words import digits, interval, percent
from stereocal.verdict.recommendation import Figure
from stereocal.workflow import Answer

KIT = "Paper kit · methods, figures, table, archive"
TILES = ("Wrong pairs let in", "Length error, median", "Threshold")


def show_result(project: Project, result: Calibration, answer: Answer | None) -> None:
    """Recommendation, tiles, downloads, the rig, and one closer look at a time.

    Args:
        answer: None while it is being computed.
    """
    found = answer.calibration if answer else result
    if timing := found.screening.time_note:
        st.info(escape_markdown(timing))
    for warning in found.warnings:
        st.warning(escape_markdown(warning))
    offer_to_bring_into_step(project, found)
    if answer:
        for item in filter(lambda item: item.accused, answer.inputs):
            st.warning(escape_markdown(item.advice))
        show_recommendation(answer)
    else:
        st.info("The errors below are of the new result.\n\nForecast and validation follow.")
    show_left_out(project, found, partial(look_at_frame, project, found))
    if answer:
        show_tiles(answer)
        parameter_downloads(answer)
        applied = readable(lambda: ProjectApplication(project).result)
        make = partial(_paper_kit, answer, None if applied is None else applied[0])
        offer(KIT, make, "paper_kit.zip", "download_kit", icon=":material/article:")
    else:
        _hold_places()
    _show_rig(project, found, answer)
    show_closer_looks(project, found, answer)


def show_recommendation(answer: Answer) -> None:
    """What to use; green if it may be relied on, and no input contradicts the images."""
    recommendation = answer.recommendation
    if recommendation.caution:
        st.error(escape_markdown(f"Do not rely on this result: {recommendation.caution}"))
    dataset = answer.calibration.dataset
    first, *others = (escape_markdown(as_held(s, dataset)) for s in recommendation.sentences)
    accused = any(item.accused for item in answer.inputs)
    sound = recommendation.forecast_holds and not recommendation.caution and not accused
    (st.success if sound else st.info)("\n\n".join([f"**{first}**", *others]))


def show_tiles(answer: Answer) -> None:
    """Wrong pairs let in, length error, and threshold: forecast and held out."""
    found, screening = answer.recommendation, answer.calibration.screening
    match = found.match
    wrong, lengths, threshold = st.columns(3)
    held = word_of(answer.calibration.dataset)
    with wrong:
        counted = f" of {match.wrong_pairs:,} wrong pairs"
        _tile(TILES[0], match.wrong_let_in, found.forecast_holds, held, counted)
    with lengths:
        _tile(TILES[1], found.measure.length_median, found.forecast_holds, held)
    with threshold, st.container(border=True):
        value = match.threshold_px
        st.metric(TILES[2], "unknown" if value is None else f"{digits(value, 2)} px")
        source = "from held-out frames" if answer.validation else "forecast"
        frames = len(answer.calibration.dataset.correspondences.frames)
        st.caption(
            f"of {FILES[match.method][0]}, {source}  \n"
            f"{len(screening.left_out)} of {frames} frames left out"
        )


def _hold_places() -> None:
    """Empty tiles, so that nothing below moves when they are filled."""
    for title, column in zip(TILES, st.columns(3), strict=True):
        with column, st.container(border=True):
            st.metric(title, "…")
            st.caption("being computed  \n…")
    hold_downloads()
    st.button(KIT, disabled=True, icon=":material/article:", key="no_download_kit")


def _paper_kit(answer: Answer, applied: Outcome | None) -> bytes:
    from stereocal.paper_kit.kit import paper_kit  # Matplotlib: 0.4 s

    return paper_kit(answer, applied)


def _tile(title: str, figure: Figure, forecast_holds: bool, held: str, counted: str = "") -> None:
    """One figure, the forecast first if it holds, and beneath it the other."""
    ahead, held_out = figure.forecast, figure.held_out
    tested = "not yet" if held_out is None else f"{percent(held_out)} %{counted}"
    if held_out == 0.0 and counted:
        tested = f"none{counted}"
    with st.container(border=True):
        if ahead is not None and (forecast_holds or held_out is None):
            st.metric(title, f"{percent(ahead.value)} %")
            st.caption(f"expected for similar {held}s ({interval(ahead)} %)  \nheld out: {tested}")
        elif held_out is not None:
            st.metric(title, f"{percent(held_out)} %")
            doubted = (
                f"  \nforecast, which does not hold: {percent(ahead.value)} %" if ahead else ""
            )
            st.caption(f"on held-out frames{doubted}")
        else:
            st.metric(title, "unknown")
            st.caption("no forecast, no held-out frames")


def dataset_download(dataset: Dataset) -> None:
    """Download of the data set as a zip, which can be uploaded again."""
    label, name = "Download this data set", "dataset.zip"
    offer(label, lambda: pack_zip(pack_dataset(dataset)), name, "download_dataset")


@fragment
def _show_rig(project: Project, found: Calibration, answer: Answer | None) -> None:
    methods = [name for name in found.methods if name != "essential"]
    methods += ["refined"] if found.refined else []
    st.subheader("The rig in 3D")
    left, right = st.columns(2)
    usual = answer.recommendation.measure.method if answer else "3d"
    name = "rig_method" if answer else "rig_method_before"  # so that the answer's set is shown
    method = choose(
        project, name, "Set", methods, usual, place=left, format_func=METHOD_NAMES.__getitem__
    )
    view = choose(project, "rig_view", "Seen from", VIEWS, place=right)
    wide, narrow = (plot_rig(found, method, view, small) for small in (False, True))
    show_figure(wide, describe_rig(found, method), "rig", narrow=narrow)
