"""The Apply page: choice of points, parameter sets and threshold, and the computation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import pandas as pd
import streamlit as st

from stereocal.calibration.methods import Method
from stereocal.errors import StereocalError
from stereocal.figures import describe_pair_errors, plot_pair_errors
from stereocal.formats.other_files import is_hdf5
from stereocal.matching.application import (
    STAGES,
    Application,
    Outcome,
    Points,
    sample_frames,
    unlabelled,
)
from stereocal.matching.blocks import pack_block, unpack_block
from stereocal.matching.matching import ANY_DEPTH, check_depths, purpose_warning
from stereocal.matching.nearest import nearest_errors
from stereocal.matching.pairs import POINT
from stereocal.matching.parquet import PARQUET
from stereocal.matching.point_table import PointTable
from stereocal.matching.threshold import FramePixels, choose_threshold
from stereocal.projects.application import USES, ProjectApplication, Use
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, CameraName
from stereocal.rig.parameters import RigParameters
from stereocal.ui import jobs
from stereocal.ui.decoding import server_guard
from stereocal.ui.fields import Field, number, one_of, setting, yes_or_no
from stereocal.ui.figure import show_figure
from stereocal.ui.intake import check_uploads, clear_refusal, escape_markdown, is_new, taking
from stereocal.ui.messages import callback, readable
from stereocal.ui.parameter_upload import PURPOSES, uploaded_set
from stereocal.ui.refined import answer_of, replaced_by_refined
from stereocal.ui.wizard import ask_about_points

OWN, FILES = "The bar's own points", "Two point files"
RESULTS, GIVEN = "This project's results", "Parameter files"
SET_TITLES = {"2d": "2D set", "3d": "3D set", "refined": "Refined set"}
INSTANT_S = 2.0
"""Shorter computations run as the controls move."""
THRESHOLD = "apply_threshold"
_ASKED = "apply_asked"


def choose_points(project: Project, store: ProjectApplication) -> tuple[Points, Points] | None:
    """The points of both cameras; None while one is missing.

    Raises:
        StereocalError: the project's own points cannot be used.
    """
    dataset = project.dataset
    kinds = [*([OWN] if dataset else []), FILES]
    chosen = setting(project, "apply_points", kinds[0], one_of(kinds))
    st.segmented_control("Points", kinds, required=True, **chosen.widget())
    if dataset is not None and chosen.value() == OWN:
        st.caption("Targets A and B are left aside: the matching has to tell them apart.")
        primary, secondary = (
            store.own_points(table, f"{which} points of {dataset.name}")
            for which, table in zip(CAMERAS, unlabelled(dataset.correspondences), strict=True)
        )
        return primary, secondary
    for side, column in zip(CAMERAS, st.columns(2), strict=True):
        with column:
            _take_points(store, side)
    given = store.set_of("matching")
    for side, camera in zip(CAMERAS, project.cameras, strict=True):
        if camera is None and given is not None:
            camera = given[1].primary if side == "primary" else given[1].secondary
        ask_about_points(store, side, None if camera is None else camera.image_size[1])
    first, second = (store.points(side) for side in CAMERAS)
    return None if first is None or second is None else (first, second)


def _take_points(store: ProjectApplication, side: CameraName) -> None:
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
            clear_refusal()
        st.rerun()


def choose_sets(
    project: Project, store: ProjectApplication
) -> tuple[RigParameters, RigParameters] | None:
    """The sets to match and to measure with; None while one is missing.

    Raises:
        StereocalError: the project's results cannot be read.
    """
    calibration = readable(lambda: project.calibration)
    kinds = [*([RESULTS] if calibration else []), GIVEN]
    chosen = setting(project, "apply_sets", kinds[0], one_of(kinds))
    st.segmented_control("Parameters", kinds, required=True, **chosen.widget())
    found: list[RigParameters | None] = []
    own = calibration is not None and chosen.value() == RESULTS
    sets = answer_of(project, calibration).sets if own and calibration else {}
    instead = replaced_by_refined(project)
    for use, column in zip(USES, st.columns(2), strict=True):
        with column:
            found.append(
                _own_set(project, use, sets, instead) if own else uploaded_set(project, store, use)
            )
            if found[-1] is not None:
                purpose = "matching" if use == "matching" else "reconstruction"
                if warning := purpose_warning(found[-1], purpose):
                    st.warning(escape_markdown(warning))
    matching, measuring = found
    return None if matching is None or measuring is None else (matching, measuring)


def _own_set(
    project: Project, use: Use, sets: Mapping[Method, RigParameters], instead: Sequence[Method]
) -> RigParameters:
    title, default = PURPOSES[use]
    default = "refined" if default in instead and "refined" in sets else default
    chosen = setting(project, f"apply_{use}", default, one_of(list(sets)))
    st.selectbox(title, list(sets), format_func=SET_TITLES.__getitem__, **chosen.widget())
    return sets[chosen.value()]


def choose_threshold_and_depths(
    store: ProjectApplication, points: tuple[Points, Points], rig: RigParameters
) -> tuple[float, tuple[float, float]] | None:
    """Threshold (px) and depth range (m), with a plot of the errors; None without a threshold.

    Raises:
        StereocalError: the points cannot be read, or the depth range is invalid.
    """
    project = store.project
    form, figure = st.columns([2, 3], gap="large")
    with form:
        depths = _depths(project)
        sample = _sample(store, points)
        usual = rig.matching_threshold_px
        if usual is None and THRESHOLD not in project.settings:
            usual = _choice(rig, sample, depths)[0]
        field = _threshold(project, usual)
        st.number_input(
            "Threshold (px)", min_value=0.0, value=None, step=0.1, format="%.4g",
            placeholder="largest error of a pair",
            help="Largest reprojection error of a pair, mean over both cameras.",
            **field.widget(),
        )  # fmt: skip
        st.button(
            "Choose it from the points", key="apply_auto", on_click=_choose,
            args=(project, rig, sample, depths),
        )  # fmt: skip
        threshold: float | None = field.value()
        _say_choice(rig, sample, depths, threshold)
        if rig.matching_threshold_px is not None:
            st.caption(f"The parameter set's own: {rig.matching_threshold_px:.3g} px.")
    if threshold is None:
        st.info("Give a threshold in pixels.")
        return None
    with figure:
        nearest = jobs.compute(nearest_errors, rig, sample.frames, depths)
        show_figure(
            plot_pair_errors(nearest, threshold), describe_pair_errors(nearest, threshold),
            "pair_errors",
        )  # fmt: skip
    return threshold, depths


def _depths(project: Project) -> tuple[float, float]:
    only = setting(project, "apply_only_depths", False, yes_or_no)
    st.toggle(
        "Only points at some depths", **only.widget(),
        help="Where it is known how far away the points are, fewer wrong pairs fit.",
    )  # fmt: skip
    if not only.value():
        return ANY_DEPTH
    given: list[float | None] = []
    for key, title, column in zip(
        ("apply_near", "apply_far"), ("Nearest (m)", "Farthest (m)"), st.columns(2), strict=True
    ):
        given.append(
            column.number_input(
                title, min_value=0.0, value=None, format="%.6g",
                **setting(project, key, None, number(0.0, or_none=True)).widget(),
            )
        )  # fmt: skip
    near, far = given
    return check_depths((near or 0.0, ANY_DEPTH[1] if far is None else far))


def _threshold(project: Project, usual: float | None) -> Field:
    """The stored threshold, or else the usual one."""
    return setting(project, THRESHOLD, usual, number(0.0, or_none=True))


@callback
def _choose(
    project: Project, rig: RigParameters, sample: Sample, depths: tuple[float, float]
) -> None:
    found, _ = _choice(rig, sample, depths)
    st.session_state[_ASKED] = True
    if found is not None:
        _threshold(project, None).set(found)


def _say_choice(
    rig: RigParameters, sample: Sample, depths: tuple[float, float], threshold: float | None
) -> None:
    """How the threshold was chosen, or why none could be if the user asked for it."""
    asked = st.session_state.get(_ASKED)
    if not asked and rig.matching_threshold_px is not None:
        return
    found, sentence = _choice(rig, sample, depths)
    if found is None and (asked or threshold is None):
        st.warning(escape_markdown(sentence))
    elif found is not None and found == threshold:
        st.caption(escape_markdown(sentence))


def _choice(
    rig: RigParameters, sample: Sample, depths: tuple[float, float]
) -> tuple[float | None, str]:
    """The threshold chosen from the points, or None, and the reason."""
    return _chosen(rig.dumps(), sample.key, depths, rig, sample.frames)


@st.cache_resource(show_spinner=False, max_entries=16)
def _chosen(
    key: str, points: str, depths: tuple[float, float], _rig: RigParameters,
    _sample: list[FramePixels],
) -> tuple[float | None, str]:  # fmt: skip
    assert key and points
    try:
        choice = jobs.compute(choose_threshold, _rig, _sample, depths)
        return choice.threshold_px, choice.sentence()
    except StereocalError as error:
        return None, str(error)


def _last(store: ProjectApplication) -> Outcome | None:
    """The last result; None if damaged, so that it is computed again."""
    try:
        return None if store.result is None else store.result[0]
    except StereocalError:
        return None


def bring_up_to_date(project: Project, store: ProjectApplication, work: Application) -> None:
    """Compute short work at once; for long work show a button and progress."""
    result = _last(store)
    job = jobs.Work(
        project, "apply", STAGES, {"application": work.digest}, lambda job: _run(store, work, job)
    )
    if result is not None and result.digest == work.digest:
        jobs.discard_finished(job)
    elif work.expected_seconds <= INSTANT_S:
        try:
            with st.spinner("Matching and measuring."):
                _run(store, work, jobs.on_page(STAGES))
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
        job.checkpoints("blocks", pack_block, unpack_block),
    )  # fmt: skip


@dataclass(frozen=True)
class Sample:
    """A sample of the points of both cameras, with a key of these points."""

    key: str
    frames: list[FramePixels]


def whole_table(store: ProjectApplication, name: str, label: str) -> pd.DataFrame:
    """All points of a table, cached by name, which holds its digest."""
    return _table(name, label, store)


@st.cache_resource(show_spinner=False, max_entries=4)
def _table(name: str, label: str, _store: ProjectApplication) -> pd.DataFrame:
    with _store.opened(name) as path:
        return pd.concat(list(PointTable(path, POINT, label).blocks()))[["frame", *POINT]]


def _sample(store: ProjectApplication, points: tuple[Points, Points]) -> Sample:
    first, second = points
    key = f"{first.name} {second.name}"
    return Sample(key, _sampled(key, store, points))


@st.cache_resource(show_spinner=False, max_entries=8)
def _sampled(
    key: str, _store: ProjectApplication, _points: tuple[Points, Points]
) -> list[FramePixels]:
    assert key
    first, second = (whole_table(_store, each.name, each.label) for each in _points)
    return sample_frames(first, second)
