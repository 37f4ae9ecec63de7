"""The Apply page: choice of points, parameters and threshold, and the computation."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.calibration.methods import METHOD_NAMES
from stereocal.fit.rig_file import RIG, Parameters
from stereocal.matching.application import STAGES, Application
from stereocal.matching.clicks import BY_HAND, ClickMeasure
from stereocal.matching.matching import ANY_DEPTH, purpose_warning
from stereocal.matching.settled import Stated
from stereocal.projects.application import USES, ProjectApplication
from stereocal.projects.clicks import ProjectClicks
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import RigParameters
from stereocal.system.tasks import StoppedError
from stereocal.ui import jobs
from stereocal.ui.apply_points import (
    FEWEST,
    PointsForm,
    ThresholdForm,
    ask_noise,
    chosen_depths,
    noise_field,
    threshold_field,
)
from stereocal.ui.clicks import show_clicks
from stereocal.ui.messages import ErrorsShown, button, readable, show_each, show_refusal, show_stale
from stereocal.ui.parameter_files import APPLY_SETS, FILES, PURPOSES, Source, upload_set
from stereocal.ui.press import set_in_use
from stereocal.ui.rig import tell_not_calibrated
from stereocal.ui.texts import escape_markdown
from stereocal.ui.warm_up import WARM_UP
from stereocal.ui.world import choose_world
from stereocal.verdict.in_words import listed

INSTANT_S = 2.0
"""Shorter computations run as the controls move."""
UNASKED_S = 20.0
"""Shorter ones begin unasked, beside the page: three cameras take as many acts as two."""


class ApplyInputs(NamedTuple):
    """The inputs, complete but for the threshold."""

    work: Application | None
    """What is to be computed; None without a threshold or with invalid depths."""
    show_threshold: Callable[[], None] | None
    """Draws what the threshold depends on; None for a rig, which has none."""
    is_clicked: bool
    """Whether the points are clicked on the page, which shows their frames."""


def choose_apply_inputs(project: Project, store: ProjectApplication) -> ApplyInputs | None:
    """Uploaders of points, and the inputs; None if something is missing."""
    if project.is_rig or store.rig_given:
        return _choose_for_rig(project, store)
    return _choose_for_pair(project, store)


def _choose_for_pair(project: Project, store: ProjectApplication) -> ApplyInputs:
    """Points of two cameras; a set to match with, one to measure with, and a threshold."""
    source, matching_file = Source(project, APPLY_SETS), store.set_of("matching")
    heights: dict[str, int | None] = {}
    for which, camera in zip(CAMERAS, project.cameras, strict=True):
        known = camera or (getattr(matching_file[1], which) if matching_file else None)
        heights[which] = known and known.image_size[1]
    form = PointsForm(store, heights, project.recording, is_rig=False)
    form.take()
    points_at, noise_at = st.columns([2, 1])
    matching_at, threshold_at, measuring_at = st.columns(3)
    with points_at:
        points, names = form.choose()
    files, sets = _choose_sets(source, store, (matching_at, measuring_at))
    stated = replace(
        BY_HAND if form.is_clicked else Stated(),
        threshold_px=threshold_field(project).value(),
        sigma_px=noise_field(project, "apply_sigma_px").value(),
        names=names,
    )
    thresholds = threshold = depths = sigma_px = None
    if len(points) == len(CAMERAS) and sets is not None:
        with ErrorsShown():
            depths = chosen_depths(project)
        stated = replace(stated, depths_m=depths or ANY_DEPTH)
        thresholds = ThresholdForm(store, points, sets[0], stated)
        threshold, sigma_px = thresholds.choose(noise_at, threshold_at)
        purposes = map(purpose_warning, sets, ("matching", "reconstruction"))
        show_each(st.warning, filter(None, purposes))
    _upload_sets(source, store, expanded=sets is None)
    world = _click(form, sets, stated)
    form.tell_missing(points)
    if sets is None:
        source.tell_missing("a parameter file to match with, and one to measure with")
    work = None
    if sets is not None and threshold is not None and depths is not None:
        work = Application(points, *sets, files, replace(stated, sigma_px=sigma_px), world)
    show = None if thresholds is None else partial(thresholds.show, threshold)
    return ApplyInputs(work, show, form.is_clicked)


def _upload_sets(source: Source, store: ProjectApplication, expanded: bool) -> None:
    """The fold of files to match and to measure with; open where one asks a question."""
    open_question = any(store.asking(use) for use in USES)
    with st.expander("Parameters from files", expanded=expanded or open_question):
        if source.asks_for_files():
            for use, column in zip(USES, st.columns(2), strict=True):
                with column:
                    upload_set(source.project, store, use)


def _click(
    form: PointsForm, sets: tuple[Parameters, Parameters] | None, stated: Stated
) -> Pose | None:
    """The world frame, and the pictures if points are clicked."""
    project, store = form.store.project, form.store
    world = None if sets is None else choose_world(project, store, sets[1])
    show_refusal()
    if form.is_clicked and sets is not None:
        show_clicks(project, ClickMeasure(*sets, stated, world))
    return world


def _choose_sets(
    source: Source, store: ProjectApplication, places: tuple[DeltaGenerator, DeltaGenerator]
) -> tuple[list[str], tuple[RigParameters, RigParameters] | None]:
    """Names and contents of the files to match and to measure with."""
    answer, files, sets = source.answer(), list[str](), list[RigParameters]()
    for use, place in zip(USES, places, strict=True):
        stored = None if source.is_project else store.set_of(use)
        if answer:
            field = set_in_use(source.project, use, answer)
            titles = {name: METHOD_NAMES[name] for name in answer.sets}
            titles[answer.recommendation.use[use]] += " · recommended"
            named = titles.__getitem__
            field.menu(PURPOSES[use], place, format_func=named)
            method = field.value()
            files.append(FILES[method][0])
            sets.append(answer.sets[method])
        elif stored is not None:
            place.caption(f"{PURPOSES[use]}  \nIn use: {escape_markdown(stored[0])}")
            files.append(stored[0])
            sets.append(stored[1])
    return files, (sets[0], sets[1]) if len(sets) == len(USES) else None


def _choose_for_rig(project: Project, store: ProjectApplication) -> ApplyInputs | None:
    """Points of three cameras and more, and the rig that matches and measures them."""
    rig, label, file = project.rig, "the rig of this project", RIG
    if not project.is_rig and (stored_rig := store.rig_given) is not None:
        (label, rig), file = stored_rig, stored_rig[0]
        with st.container(horizontal=True, vertical_alignment="center"):
            st.caption(f"In use: {escape_markdown(label)}, a rig of {len(rig.names)} cameras")
            button("Use other parameters", "forget_rig", store.forget_rig)
    if rig is None:
        tell_not_calibrated()
        return None
    heights = {name: camera.image_size[1] for name, camera in rig.cameras.items()}
    form = PointsForm(store, heights, project.recording, is_rig=True)
    form.take()
    points_at, noise_at, rig_at = st.columns([2, 1, 1])
    with points_at:
        points, names = form.choose()
    with noise_at:
        otherwise = "estimated from their epipolar errors, else as exact as the targets"
        sigma_px = ask_noise(noise_field(project, "apply_sigma_px"), "by the points", otherwise)
    rig_at.caption(f"Match and measure with  \nIn use: {escape_markdown(label)}")
    stated = Stated(sigma_px=sigma_px, names=names)
    world = _click(form, (rig, rig), stated)
    form.tell_missing(points)
    if len(points) < FEWEST:
        return ApplyInputs(None, None, form.is_clicked)
    if form.is_clicked:
        clicks = ProjectClicks(project).clicks.of_cameras(rig.names)
        noise_px = ClickMeasure(rig, rig, stated).settled(clicks).sigma_px
        stated = replace(stated, sigma_px=noise_px)
    return ApplyInputs(Application(points, rig, rig, [file], stated, world), None, form.is_clicked)


def update_application(
    project: Project, store: ProjectApplication, work: Application, is_clicked: bool
) -> None:
    """Compute short work at once, longer work in a job, and long work when a button is pressed."""

    def run(job: jobs.Job) -> None:
        store.run(work, job.begin, job.progress, job.executor)

    # If damaged, it is computed again.
    result = readable(lambda: store.result_of(is_clicked), warn=False)
    stale = "" if result is None else result[0].changed_since(work)
    current, seconds = result is not None and not stale, work.expected_seconds
    unasked = INSTANT_S < seconds <= UNASKED_S
    job = jobs.PageWork(project, "apply", STAGES, run, work.made_from, follows=unasked)
    if not current and unasked:
        jobs.start(job)
    if not current and seconds <= INSTANT_S:
        with ErrorsShown(), st.spinner("Matching and measuring."), suppress(StoppedError):
            WARM_UP.over.wait()
            run(jobs.Job(job, jobs.pool()))
            stale = ""
    running = jobs.is_running(project, "apply")
    if not running:
        show_stale(stale)
    if not current and seconds > INSTANT_S and not running:
        label = f"Match and measure ({listed([f'{rows:,}' for rows in work.rows])} points)"
        jobs.start_button(job, label, "apply_run")
    cancelled = "Cancelled. What is shown is the last finished result."
    jobs.show_job(project, "apply", cancelled)
