"""Photographs on the Data page: pairs, search for the targets."""

from functools import partial

import streamlit as st

from stereocal.detection.target import BAR, Sighting, Target
from stereocal.errors import StereocalError
from stereocal.frames.pairing import Pairing
from stereocal.frames.search import STAGES, detect_frames
from stereocal.projects.given import ProjectGiven
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from stereocal.ui import holding, jobs
from stereocal.ui.boards import boards_in, press_search
from stereocal.ui.messages import ErrorsShown, button, readable, show_stale
from stereocal.ui.pairing import ROUND, clear, show_pairing
from stereocal.ui.print_downloads import print_what_is_held
from stereocal.ui.review import show_frames
from stereocal.ui.texts import escape_markdown
from stereocal.ui.videos import show_frames_taken


def has_photographs(project: Project) -> bool:
    """Whether the project has photographs."""
    try:
        return bool(ProjectPhotographs(project).photographs)
    except StereocalError:  # reported where they are shown
        return True


def show_photographs(project: Project | None) -> None:
    """The pairs, and the targets found."""
    st.session_state.setdefault(ROUND, 0)
    cameras = readable(lambda: project.cameras) if project else None
    focal = [float(min(one.K[0, 0], one.K[1, 1])) for one in cameras or () if one]
    print_what_is_held(project, min(focal) if len(focal) == 2 else None)
    if project is None:
        return
    show_frames_taken(project)
    store = ProjectPhotographs(project)
    try:
        if not store.photographs or ProjectGiven(project).is_undivided:
            return
        show_pairing(store)
    except StereocalError as error:
        st.error(escape_markdown(str(error)))
        button("Remove all photographs", "no_photographs", clear, store)
        return
    with ErrorsShown():
        _find_targets(store)


def _find_targets(store: ProjectPhotographs) -> None:
    """The search for targets, and its results."""
    project, rows = store.project, [row for row in store.rows if row.use]
    running = jobs.is_running(project, "photographs")
    frames = readable(lambda: store.frames)
    lacking = [name for name, camera in zip(CAMERAS, project.cameras, strict=True) if not camera]
    pairing = store.pairing
    pairs = pairing.pairs
    target = holding.ask_what_is_held(store, pairs, frames is not None)
    if holding.holds_board(project):
        boards_in(store)
        return
    if lacking:
        st.info(
            f"Give the camera file of the {' and the '.join(lacking)} camera too: lenses are needed"
            " to tell A from B."
        )
    run = partial(_find, store, pairing, target or BAR, holding.held_text(project))
    work = jobs.PageWork(project, "photographs", STAGES, run)
    ready = bool(rows) and not lacking and target is not None
    press_search(work, "targets", "find_targets", frames is not None, ready)
    if frames is None:
        return
    if {(f.frame, f.files) for f in frames} != {
        (row.pair.frame, (row.pair.primary, row.pair.secondary)) for row in rows
    }:
        show_stale("pairs or photographs")
    elif project.settings.get(holding.FOUND, "bar2x2") != holding.held_text(project):
        show_stale("what you hold")
    show_frames(store, frames, running)


def _find(
    store: ProjectPhotographs, pairing: Pairing, target: Target, held: str, job: jobs.Job
) -> None:
    primary, secondary = store.project.cameras
    if primary is None or secondary is None:
        raise StereocalError("A camera file was removed from the project; give it again.")
    searched = store.photographs
    found, pairing = detect_frames(
        pairing,
        searched,
        (primary, secondary),
        job.executor,
        job.begin,
        job.progress,
        earlier=job.found_before(Sighting),
        target=target,
    )
    store.project.keep_settings({holding.FOUND: held})
    holding.settle(store.project)
    store.settle(pairing)
    store.keep_found(found, searched)
