"""The Apply page: choice of points, parameter sets and threshold, and the computation."""

from __future__ import annotations

from dataclasses import dataclass

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.calibration.methods import METHOD_NAMES
from stereocal.matching.application import STAGES, Application, Points, unlabelled
from stereocal.matching.matching import ANY_DEPTH, purpose_warning
from stereocal.matching.threshold import ThresholdChoice
from stereocal.projects.application import USES, ProjectApplication, Use
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, CameraName
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import RigParameters
from stereocal.ui import jobs
from stereocal.ui.apply_threshold import Depths, ThresholdForm, chosen_depths
from stereocal.ui.fields import Field, one_of, setting
from stereocal.ui.intake import show_refusal, take_one
from stereocal.ui.messages import ErrorsShown, callback, readable
from stereocal.ui.parameter_files import PURPOSES, upload_set
from stereocal.ui.refined import answer_when_ready, set_in_use, wait_for_answer
from stereocal.ui.texts import escape_markdown
from stereocal.ui.wizard import ask_about_points
from stereocal.ui.world import choose_world
from stereocal.workflow import Answer

OWN, FILES = "The bar's own points", "Two point files"
RESULTS, GIVEN = "This project's results", "Parameter files"
INSTANT_S = 2.0
"""Shorter computations run as the controls move."""


@dataclass(frozen=True, eq=False)
class Chosen:
    """The inputs, complete but for the threshold."""

    points: tuple[Points, Points]
    sets: tuple[RigParameters, RigParameters]
    """To match and to measure with."""
    threshold: ThresholdChoice | None
    """None: none can be chosen."""
    depths_m: Depths | None
    """None: they are invalid."""
    form: ThresholdForm
    world: Pose | None = None
    """`world_from_primary` of the points; None: they are in the primary's frame."""
    sigma_px: float | None = None
    """Noise of the points, if it is stated."""

    @property
    def work(self) -> Application | None:
        """What is to be computed; None without a threshold or with invalid depths."""
        if self.threshold is None or self.depths_m is None:
            return None
        stated = self.threshold.threshold_px if self.threshold.is_forced else None
        return Application(
            *self.points, *self.sets, stated, self.depths_m, self.world, self.sigma_px
        )


def choose_inputs(project: Project, store: ProjectApplication) -> Chosen | None:
    """Uploaders of points, and the inputs in two rows; None if something is missing."""
    lacking = _take_point_files(project, store)
    points_at, noise_at = st.columns([2, 1])
    matching_at, threshold_at, measuring_at = st.columns(3)
    with points_at:
        points = _choose_points(project, store)
    sets = _choose_sets(project, store, (matching_at, measuring_at))
    form = threshold = depths = sigma_px = None
    if points is not None and sets is not None:
        with ErrorsShown():
            depths = chosen_depths(project)
        form = ThresholdForm(store, points, sets[0], depths or ANY_DEPTH)
        threshold, sigma_px = form.choose(noise_at, threshold_at)
        for rig, purpose in zip(sets, ("matching", "reconstruction"), strict=True):
            if warning := purpose_warning(rig, purpose):
                st.warning(escape_markdown(warning))
    _take_sets(project, store, sets is None)
    world = None if sets is None else choose_world(project, store, sets[1])
    show_refusal()
    if lacking and (points is None or len(lacking) == 1):
        which = "both cameras" if len(lacking) == 2 else f"the {lacking[0]} camera"
        st.info(f"Still missing: the points of {which}.")
    if sets is None and sets_kind(project).value() == RESULTS:
        wait_for_answer(project)
    elif sets is None:
        st.info("Still missing: a parameter file to match with, and one to measure with.")
        st.page_link("pages/calibrate.py", label="Or calibrate on the Calibrate page")
    if points is None or sets is None or form is None:
        return None
    return Chosen(points, sets, threshold, depths, form, world, sigma_px)


def _points_kind(project: Project, store: ProjectApplication) -> Field:
    kinds = [*([OWN] if project.dataset else []), FILES]
    given = all(store.point_file(side) for side in CAMERAS)
    return setting(project, "apply_points", FILES if given else kinds[0], one_of(kinds))


def _choose_points(project: Project, store: ProjectApplication) -> tuple[Points, Points] | None:
    dataset, kind = project.dataset, _points_kind(project, store)
    if dataset is not None:
        st.selectbox("Points", [OWN, FILES], **kind.widget())
    if dataset is not None and kind.value() == OWN:
        st.caption("Targets A and B are left aside: the matching has to tell them apart.")
        primary, secondary = (
            store.own_points(table, f"{which} points of {dataset.name}")
            for which, table in zip(CAMERAS, unlabelled(dataset.correspondences), strict=True)
        )
        return primary, secondary
    first, second = (store.points(side) for side in CAMERAS)
    return None if first is None or second is None else (first, second)


def sets_kind(project: Project, key: str = "apply_sets") -> Field:
    """Whether parameters are the project's results, if it has any, or files."""
    kinds = [*([RESULTS] if readable(lambda: project.calibration) else []), GIVEN]
    return setting(project, key, kinds[0], one_of(kinds))


def _choose_sets(
    project: Project, store: ProjectApplication, places: tuple[DeltaGenerator, DeltaGenerator]
) -> tuple[RigParameters, RigParameters] | None:
    calibration = readable(lambda: project.calibration)
    answer = None
    if calibration is not None and sets_kind(project).value() == RESULTS:
        answer = answer_when_ready(project, calibration)
        if answer is None:
            return None
    found = []
    for use, place in zip(USES, places, strict=True):
        kept = store.set_of(use)
        with place:
            if answer:
                found.append(_own_set(project, use, answer))
            elif kept is not None:
                st.caption(f"{PURPOSES[use]}  \nIn use: {escape_markdown(kept[0])}")
                found.append(kept[1])
    return (found[0], found[1]) if len(found) == len(USES) else None


def _own_set(project: Project, use: Use, answer: Answer) -> RigParameters:
    chosen, recommended = set_in_use(project, use, answer), answer.recommendation.use[use]
    st.selectbox(
        PURPOSES[use],
        list(answer.sets),
        format_func=lambda method: (
            METHOD_NAMES[method] + " · recommended" * (method == recommended)
        ),
        **chosen.widget(),
    )
    return answer.sets[chosen.value()]


def _take_point_files(project: Project, store: ProjectApplication) -> list[CameraName]:
    """Uploaders of points, and questions about them; returns the cameras without a file."""
    for side, column in zip(CAMERAS, st.columns(2), strict=True):
        with column:
            _take_points(project, store, side)
    given = store.set_of("matching")
    for side, camera in zip(CAMERAS, project.cameras, strict=True):
        if camera is None and given is not None:
            camera = given[1].primary if side == "primary" else given[1].secondary
        ask_about_points(store, side, None if camera is None else camera.image_size[1])
    return [side for side in CAMERAS if store.point_file(side) is None]


def _take_sets(project: Project, store: ProjectApplication, missing: bool) -> None:
    """Uploaders and questions; folded if nothing is missing and no question is open."""
    asked = any(store.asking(use) for use in USES)
    with st.expander("Parameters from files", expanded=missing or asked):
        kind = sets_kind(project)
        if readable(lambda: project.calibration):
            st.segmented_control("Parameters", [RESULTS, GIVEN], required=True, **kind.widget())
        if kind.value() == GIVEN:
            for use, column in zip(USES, st.columns(2), strict=True):
                with column:
                    upload_set(project, store, use)


def _take_points(project: Project, store: ProjectApplication, side: CameraName) -> None:
    file = store.point_file(side)
    if file is not None:
        used = "In use" if _points_kind(project, store).value() == FILES else "Not in use"
        st.caption(f"{used}: {escape_markdown(file.label)}, {file.rows:,} points")
    if file is not None and file.answers is not None:
        again = callback(store.ask_again)
        st.button("Read it differently", key=f"again_{side}", on_click=again, args=(side,))
    upload = st.file_uploader(
        f"Points of the {side} camera",
        type=["csv", "txt", "tsv", "parquet", "h5", "hdf5", "mat"],
        key=f"upload_points_{side}",
        help="A table frame,u,v with further columns, or a file of Argus, easyWand, DLTdv, "
        "DeepLabCut (CSV), SLEAP (CSV or analysis HDF5), Tracktor, TrackMate or another program.",
    )

    def take(name: str, content: bytes) -> None:
        store.offer_points(side, name, content)
        if all(store.point_file(each) for each in CAMERAS):
            _points_kind(project, store).set(FILES)

    take_one(upload, take)


def bring_up_to_date(project: Project, store: ProjectApplication, work: Application) -> None:
    """Compute short work at once; for long work show a button and progress."""
    result = readable(lambda: store.result, told=False)  # if damaged, it is computed again
    job = jobs.Work(
        project, "apply", STAGES, {"application": work.digest}, lambda job: _run(store, work, job)
    )
    if result is not None and result[0].digest == work.digest:
        jobs.discard_finished(job)
    elif work.expected_seconds <= INSTANT_S:
        with ErrorsShown(), st.spinner("Matching and measuring."):
            _run(store, work, jobs.on_page(STAGES))
    elif not (jobs.is_running(project, "apply") or jobs.can_go_on(job)):
        rows = f"{work.primary.rows:,} and {work.secondary.rows:,} points"
        jobs.start_button(job, f"Match and measure ({rows})", "apply_run")
    last = "Cancelled. What is shown is the last finished result."
    jobs.show_job(project, "apply", last, job)


def _run(store: ProjectApplication, work: Application, job: jobs.Job) -> bool:
    return store.run(work, job.begin, job.progress, lambda: job.cancelled, job.executor)
