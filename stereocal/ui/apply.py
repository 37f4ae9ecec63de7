"""The Apply page: which points, which parameter sets, which gates, and the work itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import streamlit as st

from stereocal.calibrate import Calibration
from stereocal.errors import StereocalError
from stereocal.figures import describe_pair_errors, plot_pair_errors
from stereocal.formats.other_files import is_hdf5
from stereocal.formats.parquet import PARQUET
from stereocal.formats.point_table import PointTable
from stereocal.guarded import server_guard
from stereocal.matching import ANY_DEPTH, check_depths, purpose_warning
from stereocal.parameters import RigParameters
from stereocal.points.application import (
    STAGES,
    Application,
    Outcome,
    Points,
    sample_frames,
    unlabelled,
)
from stereocal.points.blocks import pack_block, unpack_block
from stereocal.points.nearest import nearest_errors
from stereocal.points.pairs import POINT
from stereocal.points.threshold import FramePixels, choose_threshold
from stereocal.project import Project
from stereocal.store.application import SIDES, USES, ProjectApplication, Side, Use
from stereocal.ui import jobs
from stereocal.ui.given_sets import PURPOSES, given_set
from stereocal.ui.intake import check_uploads, escape_markdown, is_new, settled, taking
from stereocal.ui.parameter_files import sets_of
from stereocal.ui.project import keep_settings, keeper, remembered
from stereocal.ui.refined import refined_for
from stereocal.ui.results import show_figure
from stereocal.ui.told import callback, readable
from stereocal.ui.wizard import ask_about_points

OWN, FILES = "The bar's own points", "Two point files"
RESULTS, GIVEN = "This project's results", "Parameter files"
SET_TITLES = {"2d": "2D set", "3d": "3D set", "refined": "Refined set"}
INSTANT_S = 2.0
"""What is expected to take less is computed as the controls move."""
THRESHOLD, CHOSEN = "apply_threshold", "apply_chosen"


def choose_points(project: Project, store: ProjectApplication) -> tuple[Points, Points] | None:
    """The points of both cameras; None while one is missing.

    Raises:
        StereocalError: the project's own points cannot be used.
    """
    dataset = project.dataset
    kinds = [*([OWN] if dataset else []), FILES]
    _remember_choice(project, "apply_points", kinds)
    st.segmented_control(
        "Points",
        kinds,
        key="apply_points",
        required=True,
        on_change=keeper(project, "apply_points"),
    )
    if dataset is not None and st.session_state["apply_points"] == OWN:
        st.caption("Targets A and B are left aside: the matching has to tell them apart.")
        primary, secondary = (
            store.own_points(table, f"{which} points of {dataset.name}")
            for which, table in zip(SIDES, unlabelled(dataset.correspondences), strict=True)
        )
        return primary, secondary
    for side, column in zip(SIDES, st.columns(2), strict=True):
        with column:
            _take_points(store, side)
    given = store.set_of("matching")
    for side, camera in zip(SIDES, project.cameras, strict=True):
        if camera is None and given is not None:
            camera = given[1].primary if side == "primary" else given[1].secondary
        ask_about_points(store, side, None if camera is None else camera.image_size[1])
    first, second = (store.points(side) for side in SIDES)
    return None if first is None or second is None else (first, second)


def _take_points(store: ProjectApplication, side: Side) -> None:
    file = store.point_file(side)
    if file is not None:
        st.caption(
            f"In use: {escape_markdown(file.label)}, {file.rows} points in {file.frames} frames"
        )
        if file.answers is not None:
            again = callback(store.ask_again)
            st.button("Read it differently", key=f"again_{side}", on_click=again, args=(side,))
    upload = st.file_uploader(
        f"Points of the {side} camera", type=["csv", "txt", "tsv", "parquet", "h5", "hdf5", "mat"],
        key=f"upload_points_{side}",
        help="A table frame,u,v with further columns, or a file of Argus, easyWand, DLTdv, "
        "DeepLabCut (CSV), SLEAP (CSV or analysis HDF5), Tracktor, TrackMate or another program.",
    )  # fmt: skip
    if upload is not None and is_new(upload):
        with taking(upload):
            check_uploads([upload])
            with st.spinner("Reading."):
                content = upload.getvalue()
                if upload.name.lower().endswith(PARQUET):
                    server_guard().check_content("table", content, upload.name, PARQUET[0])
                elif is_hdf5(content):
                    server_guard().check_content("hdf5", content, upload.name)
                store.offer_points(side, upload.name, content)
            settled()
        st.rerun()


def choose_sets(
    project: Project, store: ProjectApplication
) -> tuple[RigParameters, RigParameters] | None:
    """The set to match with and the set to measure with; None while one is missing.

    Raises:
        StereocalError: the project's results cannot be read.
    """
    calibration = readable(lambda: project.calibration)
    kinds = [*([RESULTS] if calibration else []), GIVEN]
    _remember_choice(project, "apply_sets", kinds)
    st.segmented_control(
        "Parameters",
        kinds,
        key="apply_sets",
        required=True,
        on_change=keeper(project, "apply_sets"),
    )
    found: list[RigParameters | None] = []
    own = calibration is not None and st.session_state["apply_sets"] == RESULTS
    sets, instead = _own_sets(project, calibration) if own and calibration else ({}, [])
    for use, column in zip(USES, st.columns(2), strict=True):
        with column:
            found.append(
                _own_set(project, use, sets, instead) if own else given_set(project, store, use)
            )
            if found[-1] is not None:
                purpose = "matching" if use == "matching" else "reconstruction"
                if warning := purpose_warning(found[-1], purpose):
                    st.warning(escape_markdown(warning))
    matching, measuring = found
    return None if matching is None or measuring is None else (matching, measuring)


def _own_sets(
    project: Project, calibration: Calibration
) -> tuple[dict[str, RigParameters], list[str]]:
    """The sets by method, and of "2d" and "3d" those whose work the refined one is to do."""
    refined, instead = refined_for(project, calibration)
    return sets_of(calibration, readable(lambda: project.evaluation), refined), instead


def _own_set(
    project: Project, use: Use, sets: Mapping[str, RigParameters], instead: Sequence[str]
) -> RigParameters:
    title, default = PURPOSES[use]
    default = "refined" if default in instead else default
    key = f"apply_{use}"
    _remember_choice(project, key, list(sets), default)
    st.selectbox(
        title, list(sets), format_func=SET_TITLES.__getitem__, key=key,
        on_change=keeper(project, key),
    )  # fmt: skip
    return sets[st.session_state[key]]


def choose_gates(
    project: Project, points: tuple[Points, Points], rig: RigParameters
) -> tuple[float, tuple[float, float]] | None:
    """Threshold and depth range, beside the errors that they part; None without a threshold.

    Raises:
        StereocalError: the points cannot be read, or a depth range that cannot be.
    """
    form, figure = st.columns([2, 3], gap="large")
    with form:
        depths = _depths(project)
        sample = _sample(*((str(each.path), each.label) for each in points))
        if THRESHOLD not in st.session_state:
            _begin_threshold(project, rig, sample, depths)
        st.number_input(
            "Threshold (px)", min_value=0.0, value=None, step=0.1, format="%.4g", key=THRESHOLD,
            on_change=keeper(project, THRESHOLD), placeholder="largest error of a pair",
            help="Largest reprojection error of a pair, mean over both cameras.",
        )  # fmt: skip
        st.button(
            "Choose it from the points", key="apply_auto", on_click=_choose,
            args=(project, rig, sample, depths),
        )  # fmt: skip
        if chosen := st.session_state.get(CHOSEN):
            found, sentence = chosen
            (st.caption if found else st.warning)(escape_markdown(sentence))
        if rig.matching_threshold_px is not None:
            st.caption(f"The parameter set's own: {rig.matching_threshold_px:.3g} px.")
    threshold: float | None = st.session_state[THRESHOLD]
    if threshold is None:
        st.info("Give a threshold in pixels.")
        return None
    with figure:
        nearest = jobs.compute(nearest_errors, rig, sample, depths)
        show_figure(
            plot_pair_errors(nearest, threshold), describe_pair_errors(nearest, threshold),
            "pair_errors",
        )  # fmt: skip
    return threshold, depths


def _depths(project: Project) -> tuple[float, float]:
    remembered(project, {"apply_only_depths": False, "apply_near": None, "apply_far": None})
    st.toggle(
        "Only points at some depths", key="apply_only_depths",
        on_change=keeper(project, "apply_only_depths"),
        help="Where it is known how far away the points are, fewer wrong pairs fit.",
    )  # fmt: skip
    if not st.session_state["apply_only_depths"]:
        return ANY_DEPTH
    given: list[float | None] = []
    for key, title, column in zip(
        ("apply_near", "apply_far"), ("Nearest (m)", "Farthest (m)"), st.columns(2), strict=True
    ):
        given.append(
            column.number_input(
                title, min_value=0.0, value=None, key=key, format="%.6g",
                on_change=keeper(project, key),
            )
        )  # fmt: skip
    near, far = given
    return check_depths((near or 0.0, ANY_DEPTH[1] if far is None else far))


def _begin_threshold(
    project: Project, rig: RigParameters, sample: list[FramePixels], depths: tuple[float, float]
) -> None:
    """As kept, or the set's own, or else chosen from the points: as the command does."""
    value = project.settings.get(THRESHOLD, rig.matching_threshold_px)
    st.session_state[THRESHOLD] = value
    if value is None:
        _choose(project, rig, sample, depths)


@callback
def _choose(
    project: Project, rig: RigParameters, sample: list[FramePixels], depths: tuple[float, float]
) -> None:
    try:
        choice = jobs.compute(choose_threshold, rig, sample, depths)
        st.session_state[THRESHOLD] = choice.threshold_px
        keep_settings(project, {THRESHOLD: choice.threshold_px})
        st.session_state[CHOSEN] = (True, choice.sentence())
    except StereocalError as error:
        st.session_state[CHOSEN] = (False, str(error))


def _last(store: ProjectApplication) -> tuple[Outcome, Path] | None:
    """The last result; None where it is damaged, so that it is made anew."""
    try:
        return store.result
    except StereocalError:
        return None


def bring_up_to_date(project: Project, store: ProjectApplication, work: Application) -> None:
    """Compute at once what is short; offer a button for what is long, and show how it goes."""
    result = _last(store)
    job = jobs.Work(
        project, "apply", STAGES, {"application": work.digest}, lambda job: _run(store, work, job)
    )
    if result is not None and result[0].digest == work.digest:
        jobs.is_done(job)
    elif work.expected_seconds <= INSTANT_S:
        try:
            with st.spinner("Matching and measuring."):
                _run(store, work, jobs.on_page(project, STAGES))
        except StereocalError as error:
            st.error(escape_markdown(str(error)))
    elif not (jobs.is_running(project, "apply") or jobs.can_go_on(job)):
        st.button(
            f"Match and measure ({work.primary.rows} and {work.secondary.rows} points)",
            type="primary", key="apply_run", on_click=jobs.start, args=(job,),
        )  # fmt: skip
    last = "Cancelled. What is shown is the last finished result."
    jobs.show_job(project, "apply", last, job)


def _run(store: ProjectApplication, work: Application, job: jobs.Job) -> bool:
    return store.run(
        work, job.begin, job.progress, lambda: job.cancelled, job.executor,
        job.parts("blocks", pack_block, unpack_block),
    )  # fmt: skip


@st.cache_resource(show_spinner=False, max_entries=4)
def whole_table(path: str, label: str) -> pd.DataFrame:
    """All points of a table; its name holds the digest of its content."""
    table = PointTable(Path(path), POINT, label)
    return pd.concat(list(table.blocks()))[["frame", *POINT]]


@st.cache_resource(show_spinner=False, max_entries=8)
def _sample(primary: tuple[str, str], secondary: tuple[str, str]) -> list[FramePixels]:
    return sample_frames(whole_table(*primary), whole_table(*secondary))


def _remember_choice(project: Project, key: str, options: list[Any], default: Any = None) -> None:
    """As `remembered`, where what can be chosen may have changed since."""
    remembered(project, {key: options[0] if default is None else default})
    if st.session_state[key] not in options:
        st.session_state[key] = options[0]
