"""The Apply page: choice of points, parameter sets and threshold, and the computation."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.calibration.methods import METHOD_NAMES
from stereocal.matching.application import STAGES, Application, Points, unlabelled
from stereocal.matching.matching import ANY_DEPTH, purpose_warning
from stereocal.matching.names import AUTO
from stereocal.matching.pairs import Stated
from stereocal.projects.application import USES, Asked, ProjectApplication
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, CameraName
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import camera_in_words
from stereocal.system.numbers import count
from stereocal.ui import jobs
from stereocal.ui.apply_threshold import ThresholdForm, ask_names, chosen_depths
from stereocal.ui.fields import Field, one_of, setting
from stereocal.ui.intake import take_one
from stereocal.ui.messages import ErrorsShown, callback, readable, show_refusal
from stereocal.ui.parameter_files import APPLY_SETS, PURPOSES, Source, upload_set
from stereocal.ui.refined import set_in_use
from stereocal.ui.texts import escape_markdown
from stereocal.ui.wizard import ask_about_points
from stereocal.ui.world import choose_world
from stereocal.verdict.in_words import listed

OWN, FILES = "The bar's own points", "Two point files"
POINT_KINDS = ["csv", "txt", "tsv", "parquet", "h5", "hdf5", "mat"]
POINT_FILES = (
    "A table frame,u,v with further columns, or a file of Argus, easyWand, DLTdv, DeepLabCut "
    "(CSV), SLEAP (CSV or analysis HDF5), Tracktor, TrackMate or another program."
)
INSTANT_S = 2.0
"""Shorter computations run as the controls move."""


class Chosen(NamedTuple):
    """The inputs, complete but for the threshold."""

    work: Application | None
    """What is to be computed; None without a threshold or with invalid depths."""
    show_threshold: Callable[[], None] | None
    """Draws what the threshold depends on; None for a rig, which has none."""


def choose_inputs(project: Project, store: ProjectApplication) -> Chosen | None:
    """Uploaders of points, and the inputs in two rows; None if something is missing."""
    source = Source(project, APPLY_SETS)
    lacking = _take_points(project, store)
    points_at, noise_at = st.columns([2, 1])
    matching_at, threshold_at, measuring_at = st.columns(3)
    with points_at:
        points = _choose_points(project, store)
        names = AUTO if points is None else ask_names(store, points)
    sets = _choose_sets(source, store, (matching_at, measuring_at))
    form = threshold = depths = sigma_px = world = None
    if points is not None and sets is not None:
        with ErrorsShown():
            depths = chosen_depths(project)
        form = ThresholdForm(store, points, sets[0], depths or ANY_DEPTH, names)
        threshold, sigma_px = form.choose(noise_at, threshold_at)
        for warning in filter(None, map(purpose_warning, sets, ("matching", "reconstruction"))):
            st.warning(escape_markdown(warning))
    open_question = any(store.asking(use) for use in USES)
    with st.expander("Parameters from files", expanded=sets is None or open_question):
        if source.asks_for_files():
            for use, column in zip(USES, st.columns(2), strict=True):
                with column:
                    upload_set(project, store, use)
    if sets is not None:
        world = choose_world(project, store, sets[1])
    show_refusal()
    if lacking and (points is None or len(lacking) == 1):
        which = "both cameras" if len(lacking) == 2 else f"the {lacking[0]} camera"
        st.info(f"Still missing: the points of {which}.")
    if sets is None:
        source.tell_missing("a parameter file to match with, and one to measure with")
    if points is None or sets is None or form is None:
        return None
    work = None
    if threshold is not None and depths is not None:
        forced = threshold.threshold_px if threshold.is_forced else None
        stated = Stated(forced, depths, sigma_px, names)
        work = Application(dict(zip(CAMERAS, points, strict=True)), *sets, stated, world)
    return Chosen(work, partial(form.show, threshold))


def _points_kind(project: Project, store: ProjectApplication) -> Field:
    kinds = [*([OWN] if project.dataset else []), FILES]
    given = all(map(store.point_file, CAMERAS))
    return setting(project, "apply_points", FILES if given else kinds[0], one_of(kinds))


def _take_points(project: Project, store: ProjectApplication) -> list[CameraName]:
    """Uploaders of points, and questions about them; returns the cameras without a file."""

    def take(side: Asked, name: str, content: bytes) -> None:
        store.offer_points(side, name, content)
        if all(map(store.point_file, CAMERAS)):
            _points_kind(project, store).set(FILES)

    used = _points_kind(project, store).value() == FILES
    for side, column in zip(CAMERAS, st.columns(2), strict=True):
        with column:
            upload_points(store, side, camera_in_words(side), used, take)
    given = store.set_of("matching")
    for side, camera in zip(CAMERAS, project.cameras, strict=True):
        if camera is None and given is not None:
            camera = getattr(given[1], side)
        ask_about_points(store, side, None if camera is None else camera.image_size[1])
    return [side for side in CAMERAS if store.point_file(side) is None]


def upload_points(
    store: ProjectApplication,
    side: Asked,
    camera: str,
    used: bool,
    take: Callable[[Asked, str, bytes], object],
) -> None:
    """The uploader of one camera's points.

    Args:
        camera: in words.
        used: whether the page uses the files given.
    """
    if (file := store.point_file(side)) is not None:
        in_use = "In use" if used else "Not in use"
        st.caption(f"{in_use}: {escape_markdown(file.label)}, {count(file.rows, 'point')}")
        if file.answers is not None:
            again = callback(partial(store.ask_again, side))
            st.button("Read it differently", key=f"again_{side}", on_click=again)
    title, key = f"Points of {escape_markdown(camera)}", f"upload_points_{side}"
    upload = st.file_uploader(title, type=POINT_KINDS, key=key, help=POINT_FILES)
    take_one(upload, partial(take, side))


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


def _choose_sets(
    source: Source, store: ProjectApplication, places: tuple[DeltaGenerator, DeltaGenerator]
) -> tuple[RigParameters, RigParameters] | None:
    answer, found = source.answer(), []
    for use, place in zip(USES, places, strict=True):
        kept = None if source.is_project else store.set_of(use)
        if answer:
            chosen = set_in_use(source.project, use, answer)
            titles = {name: METHOD_NAMES[name] for name in answer.sets}
            titles[answer.recommendation.use[use]] += " · recommended"
            named = titles.__getitem__
            place.selectbox(PURPOSES[use], titles, format_func=named, **chosen.widget())
            found.append(answer.sets[chosen.value()])
        elif kept is not None:
            place.caption(f"{PURPOSES[use]}  \nIn use: {escape_markdown(kept[0])}")
            found.append(kept[1])
    return (found[0], found[1]) if len(found) == len(USES) else None


def bring_up_to_date(project: Project, store: ProjectApplication, work: Application) -> None:
    """Compute short work at once; for long work show a button and progress."""

    def run(job: jobs.Job) -> bool:
        return store.run(work, job.begin, job.progress, lambda: job.cancelled, job.executor)

    result = readable(lambda: store.result, told=False)  # if damaged, it is computed again
    current = result is not None and result[0].digest == work.digest
    job = jobs.Work(project, "apply", STAGES, run)
    label = f"Match and measure ({listed([f'{rows:,}' for rows in work.rows])} points)"
    short, doing = work.expected_seconds <= INSTANT_S, "Matching and measuring."
    last = "Cancelled. What is shown is the last finished result."
    stale = "" if result is None or current else result[0].changed_since(work)
    jobs.bring_up_to_date(job, current, short, doing, label, "apply_run", last, stale)
