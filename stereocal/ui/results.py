"""The Calibrate page: the result with its downloads, and closer looks at it, one at a time."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.calibration.methods import METHOD_NAMES, Method
from stereocal.errors import StereocalError
from stereocal.figures import two_sets
from stereocal.figures.frame_errors import describe_frame_errors, plot_frame_errors
from stereocal.figures.rig import describe_rig, plot_rig
from stereocal.figures.space import VIEWS
from stereocal.figures.tables import angles_table, errors_table, forecast_table, refined_table
from stereocal.figures.traces import describe_traces, plot_traces
from stereocal.figures.two_sets import FrameView, frame_views
from stereocal.fit.results import Calibration
from stereocal.paper_kit.kit import paper_kit
from stereocal.projects.application import ProjectApplication
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from stereocal.rig.lengths_in_words import as_held, word_of
from stereocal.system.numbers import count
from stereocal.system.zip_files import pack_zip
from stereocal.ui import frames, refined_looks
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Field, choose, one_of, setting
from stereocal.ui.figure import clicked_in, is_narrow, scroll_to, scrolled_part, show_figure
from stereocal.ui.forms import describe_settings
from stereocal.ui.messages import button, callback, fragment, readable, show_each
from stereocal.ui.navigation import go_to
from stereocal.ui.parameter_files import FILES, other_formats, parameter_downloads
from stereocal.ui.press import ResultState, result_state
from stereocal.ui.review import look_closely
from stereocal.ui.rig import show_graph, show_tiles
from stereocal.ui.texts import escape_markdown
from stereocal.verdict.file_figures import Figure
from stereocal.verdict.in_words import digits, in_percent, interval, percent
from stereocal.verdict.recommendation import frames_to_come
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.pair_run import PairRun

TILES = (
    *("Wrong pairs accepted", "95 % of lengths within"),
    *("Threshold", "Mean reprojection error"),
)
FRAMES, ACCURACY, STATED = "Errors by frame", "How accurate, where", "Stated and estimated"
IN_SIGHT = (FRAMES, ACCURACY, STATED)
"""The looks that most people want; the others are under *More*."""
CAMERAS_LOOK = "All cameras"
Look = Callable[[Project, PairRun, PairAnswer | None], None]
CHART, OPENED = "frames", "opened_frame"
COVERAGE = "coverage"
"""Key of the figure of the Data page."""


def show_result(project: Project, run: PairRun, answer: PairAnswer | None) -> None:
    """Recommendation, tiles, downloads, the rig, and one closer look at a time.

    Args:
        answer: the run with its files; None while they are computed.
    """
    calibration = run.calibration
    if timing := calibration.screening.time_note:
        st.info(escape_markdown(timing))
    show_each(st.warning, calibration.warnings[:1])
    frames.offer_to_bring_into_step(project, calibration)
    if answer:
        show_recommendation(answer)
    else:
        st.info("The errors below are of the new result.\n\nForecast and validation follow.")
    frames.show_left_out(project, calibration, partial(_look_at_frame, project, calibration))
    if answer:
        refined_looks.show_disagreement(answer.run.inputs)
    waiting = ("…", "being computed  \n…")
    show_tiles({title: _tile(title, answer) if answer else waiting for title in TILES})
    _show_rest(calibration, answer)
    with st.container(horizontal=True):
        parameter_downloads(answer)
        _offer_kit(project, answer)
        if answer is not None:
            with st.popover("Other formats"):
                other_formats(project, answer)
    if project.pair is None:  # a rig shows all its cameras
        _show_rig(project, calibration, answer)
    _show_closer_looks(project, run, answer, result_state(project))


def show_recommendation(answer: PairAnswer) -> None:
    """What to use; green if it may be relied on, and no input contradicts the images; yellow if
    held-out frames contradict the forecast."""
    recommendation = answer.recommendation
    if recommendation.caution:
        st.error(escape_markdown(f"Do not rely on this result: {recommendation.caution}"))
    dataset = answer.run.calibration.dataset
    first, *others = (escape_markdown(as_held(s, dataset)) for s in recommendation.brief)
    calibration = answer.run.calibration
    accused = calibration.focal_changes or any(item.accused for item in answer.run.inputs)
    sound = recommendation.forecast_holds and not recommendation.caution and not accused
    doubted = recommendation.verdict is not None and not recommendation.forecast_holds
    show = st.warning if doubted else st.success if sound else st.info
    show("\n\n".join([f"**{first}**", *others]))


def _show_rest(calibration: Calibration, answer: PairAnswer | None) -> None:
    """Further warnings, and what the recommendation says beyond its box and the tiles."""
    sentences = list[str]()
    if answer is not None:
        recommendation = answer.recommendation
        sentences = [
            as_held(s, calibration.dataset)
            for s in recommendation.sentences
            if s not in recommendation.brief
        ]
    further = calibration.warnings[1:]
    more = count(len(further), "more note") if further else ""
    if sentences or more:
        with st.expander(f"In words{more and ', and '}{more}"):
            show_each(st.warning, further)
            st.markdown("\n\n".join(map(escape_markdown, sentences)))


def _tile(title: str, answer: PairAnswer) -> tuple[str, str]:
    calibration, match = answer.run.calibration, answer.recommendation.match
    if title == TILES[0]:
        return _expected(match.wrong_let_in, answer, f" of {match.wrong_pairs:,} wrong pairs")
    if title == TILES[1]:
        measure = answer.recommendation.measure
        value_in_words, words = _expected(measure.metric_p95, answer)
        scatter = measure.length_p95.best(answer.recommendation.forecast_holds)
        held = word_of(calibration.dataset)
        alone = "" if scatter is None else f"  \nrelative to the {held}: {in_percent(scatter)}"
        return value_in_words, f"{words}{alone}"
    if title == TILES[3]:
        errors = calibration.errors[match.method]
        frames_used = count(len(calibration.frames), "frame")
        return f"{digits(errors.mean_reprojection_px, 2)} px", f"of the {frames_used} used here"
    value, frames = match.threshold_px, len(calibration.dataset.correspondences.frames)
    source = "from frames held out here" if answer.validation else "forecast"
    left_out = f"{len(calibration.screening.left_out):,} of {frames:,} frames left out"
    where_from = f"of {FILES[match.method][0]}, {source}  \n{left_out}"
    return "unknown" if value is None else f"{digits(value, 2)} px", where_from


def _expected(figure: Figure, answer: PairAnswer, counted: str = "") -> tuple[str, str]:
    """A figure and its words: the forecast first if it holds, and beneath it the other."""
    ahead, held_out = figure.forecast, figure.held_out
    tested = "not yet" if held_out is None else f"{percent(held_out)} %{counted}"
    if held_out == 0.0 and counted:
        tested = f"none{counted}"
    if ahead is not None and (answer.recommendation.forecast_holds or held_out is None):
        future = frames_to_come(answer.run.calibration, answer.run.forecast)
        words = f"forecast for {future} ({interval(ahead)} %)  \nheld out here: {tested}"
        return f"{percent(ahead.value)} %", words
    if held_out is None:
        return "unknown", "no forecast, no held-out frames"
    if ahead is None:
        return f"{percent(held_out)} %", "held out here"
    forecast = f"forecast, which does not hold: {percent(ahead.value)} %"
    if ahead.value > held_out:
        return f"{percent(ahead.value)} %", f"{forecast}  \nheld out here: {tested}"
    return f"{percent(held_out)} %", f"held out here  \n{forecast}"


def _offer_kit(project: Project, answer: PairAnswer | None) -> None:
    applied = readable(lambda: ProjectApplication(project).result)

    def make() -> bytes:
        assert answer is not None
        return paper_kit(answer, None if applied is None else applied[0])

    label, icon = "Paper kit · methods, table, data set, parameters", ":material/article:"
    offer(label, make if answer else None, "paper_kit.zip", "download_kit", icon=icon)


def dataset_download(pack: Callable[[], Mapping[str, bytes]]) -> None:
    """Download of the data set, whose files `pack` makes, as a zip, which can be uploaded again."""
    label, name = "Download this data set", "dataset.zip"
    offer(label, lambda: pack_zip(pack()), name, "download_dataset")


@fragment
def _show_rig(project: Project, calibration: Calibration, answer: PairAnswer | None) -> None:
    methods = ["2d", "3d", *(["refined"] if calibration.refined else [])]
    st.subheader("The rig in 3D")
    left, right = st.columns(2)
    usual = answer.recommendation.measure.method if answer else "3d"
    name = "rig_method" if answer else "rig_method_before"  # so that the answer's set is shown
    named = METHOD_NAMES.__getitem__
    method = choose(project, name, "Set", methods, usual, place=left, format_func=named)
    view = choose(project, "rig_view", "Seen from", VIEWS, place=right)
    figure = plot_rig(calibration, method, view, is_narrow())
    show_figure(figure, describe_rig(calibration, method), "rig")


def looks_of(project: Project) -> dict[str, Look]:
    """The closer looks; of a rig also that at all its cameras."""
    return LOOKS | ({CAMERAS_LOOK: _show_cameras} if project.pair else {})


def _view(project: Project) -> Field:
    return setting(project, "view", FRAMES, one_of(looks_of(project)), tabs_own=True)


@callback
def _look_at_frame(project: Project, calibration: Calibration, frame: int) -> None:
    """Open a frame (a callback)."""
    _view(project).set(FRAMES)
    scroll_to(OPENED)
    frames.frame_field(project, calibration).set(frame)


@callback
def open_clicked_frame(project: Project) -> None:
    """Open the frame of a point of the figure of the Data page: its photographs, or its errors."""
    frame, calibration = clicked_in(COVERAGE), project.calibration
    if frame is None:
        return
    if frames.photographed(project):
        look_closely(ProjectPhotographs(project), frame)
    elif calibration is not None:
        _look_at_frame(project, calibration, frame)
        go_to("calibrate")
    else:
        raise StereocalError(f"Frame {frame}: its errors are shown once you have calibrated.")


@fragment
def _show_closer_looks(
    project: Project, run: PairRun, answer: PairAnswer | None, drawn: ResultState
) -> None:
    """A choice of views; only the chosen one is computed.

    Args:
        drawn: of what the page was drawn; a press in here, which draws this part alone, changes it.
    """
    if result_state(project) != drawn:
        st.rerun()
    field, looks = _view(project), looks_of(project)
    view = field.value()
    in_sight = [*IN_SIGHT, *([] if view in IN_SIGHT else [view])]
    # Each in a row of its own: beside each other they leave a screen of 420 px.
    st.segmented_control("Look at", in_sight, required=True, **field.widget("default"))
    with st.popover("More"):
        for name in looks:
            if name not in in_sight:
                button(name, f"look_{name}", field.set, name)
    looks[view](project, run, answer)


def _show_frames(project: Project, run: PairRun, answer: PairAnswer | None) -> None:
    calibration = run.calibration
    field = frames.frame_field(project, calibration)

    @callback
    def clicked() -> None:
        if (frame := clicked_in(CHART)) is not None:
            field.set(frame)

    st.caption("Click on a point to open its frame below.")
    figure = plot_frame_errors(calibration, field.value())
    words = describe_frame_errors(calibration)
    show_figure(figure, words, CHART, on_select=clicked, selection_mode="points")
    with scrolled_part(OPENED):
        frame = frames.choose_frame(project, calibration)
        views = frame_views(calibration, frame)
        words = f"{frames.state_of(calibration, frame)} {_in_words(calibration, views)}"
        st.markdown(escape_markdown(words))
        method = answer.recommendation.match.method if answer else "2d"
        _show_images(project, calibration, frame, views, method, st.columns(2))


def _in_words(calibration: Calibration, views: dict[Method, FrameView]) -> str:
    return as_held(two_sets.describe_two_sets(views), calibration.dataset)


def _show_images(
    project: Project,
    calibration: Calibration,
    frame: int,
    views: dict[Method, FrameView],
    method: Method,
    columns: Sequence[DeltaGenerator],
) -> None:
    photographs = frames.photographs_of(project, frame)
    names = calibration.dataset.names
    for camera, (side, name, column) in enumerate(zip(CAMERAS, names, columns, strict=True)):
        with column:
            title = f"Camera {name}" if project.pair else name.capitalize()
            st.markdown(f"**{escape_markdown(title)}**")
            figure = two_sets.plot_image(views, method, camera, photographs[camera])
            words = two_sets.describe_image(views, method, camera)
            show_figure(figure, words, f"image_{side}", caption=True)


def _show_two_sets(project: Project, run: PairRun, _answer: PairAnswer | None) -> None:
    calibration = run.calibration
    frame = frames.choose_frame(project, calibration)
    views = frame_views(calibration, frame)
    named = METHOD_NAMES.__getitem__
    method = choose(project, "two_sets_method", "Set", views, format_func=named)
    st.markdown(f"**{escape_markdown(_in_words(calibration, views))}**")
    *images, space = st.columns(3)
    _show_images(project, calibration, frame, views, method, images)
    with space:
        st.markdown("**In space, where the rays pass each other**")
        words = two_sets.describe_gap(views, method)
        show_figure(two_sets.plot_gap(views, method), words, "gap", caption=True)


def _show_parameters(_project: Project, run: PairRun, answer: PairAnswer | None) -> None:
    refined_looks.show_inputs(answer)
    calibration = run.calibration
    if answer is not None and answer.run.forecast is not None:
        st.table(forecast_table(answer.forecast_entries, answer.thresholds_px))
    else:
        st.table(errors_table(calibration))
    st.table(angles_table(calibration))
    if calibration.refined is not None:
        st.table(refined_table(calibration.refined))
        noise, scatter = calibration.refined.sigma_px, calibration.refined.scatter_m
        st.caption(
            f"Noise of an image point {digits(noise.value)} px ({noise.source}); scatter of the "
            f"bar's length {digits(1000 * scatter.value)} mm ({scatter.source})."
        )
    made_with = describe_settings(calibration.settings)
    st.caption(f"Made with: {made_with}, {len(calibration.frames):,} calibration frames.")


def _show_searches(_project: Project, run: PairRun, _answer: PairAnswer | None) -> None:
    calibration = run.calibration
    show_figure(plot_traces(calibration), describe_traces(calibration), "traces")


def _show_cameras(project: Project, _run: PairRun, _answer: PairAnswer | None) -> None:
    if project.rig is not None:
        show_graph(project, project.rig)


LOOKS: dict[str, Look] = {
    FRAMES: _show_frames,
    "Why two sets": _show_two_sets,
    ACCURACY: refined_looks.show_accuracy,
    "Residuals by place": refined_looks.show_misfit,
    STATED: _show_parameters,
    "Searches": _show_searches,
}
