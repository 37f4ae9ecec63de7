"""The search of photographs for a page: what is held, the button, and what it is a result of."""

from collections.abc import Callable, Mapping

import streamlit as st

from stereocal.detection.target import BAR, Target
from stereocal.frames.all_cameras import Found
from stereocal.frames.pairing import Pairing, pairs_of
from stereocal.intrinsics.photograph_search import PhotographSearch
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.made_from import Parts, as_digests, changed
from stereocal.system.records import plain
from stereocal.ui import jobs
from stereocal.ui.holding import ask_what_is_held, board_form, holds_board
from stereocal.ui.messages import ErrorsShown, show_stale

HeldTarget = Target | BoardPattern


def ask_held(
    store: ProjectPhotographs, pairing: Pairing, fold: bool
) -> tuple[HeldTarget | None, bool]:
    """What is held, and whether it can be searched for: of a board, its size must be stated.

    Args:
        fold: once it is said.
    """
    two = [*next(iter(pairing.moments.values()), CAMERAS)][:2]
    held: HeldTarget | None = ask_what_is_held(store, pairs_of(pairing.moments, *two), fold)
    is_stated = True
    if holds_board(store.project):
        with ErrorsShown():
            held = board_form(store.project, (9, 6), square_mm=None)
        is_stated = store.project.settings.get("board_square_mm") is not None
        if held is not None and not is_stated:
            st.info("Enter the side of a square as measured: all lengths follow from it.")
    return held, bool(pairing.moments) and held is not None and is_stated


def search_work(
    store: ProjectPhotographs,
    pairing: Pairing,
    cameras: Mapping[str, Camera | None],
    held: HeldTarget | None,
    keep: Callable[[Found, Parts], None],
    **more: float | None,
) -> jobs.PageWork:
    """The search, for a button.

    Args:
        cameras: as of `PhotographSearch`.
        keep: stores what was found, and what from.
        more: what else it is a result of, by its name in words.
    """
    search = PhotographSearch(pairing, store.photographs, cameras, held or BAR)
    files = {name: file.name for name, file in search.photographs.items()}
    by_hand, moments = pairing.by_hand, [*pairing.moments.items()]
    if by_hand is not None:  # the search finds the moments
        moments = [
            (k, {c: name}) for c, numbers in by_hand.counts.items() for name, k in numbers.items()
        ]
    parts = {
        "photographs or their frames": [
            {"frame": k, **{camera: files.get(name) for camera, name in names.items()}}
            for k, names in moments
        ],
        "lenses": {name: camera and camera.to_json() for name, camera in cameras.items()},
        "what you hold": None if held is None else [type(held).__name__, plain(held)],
        **more,
    }
    made_from = as_digests(parts)

    def run(job: jobs.Job) -> None:
        result = search.run(job.executor, job.begin, job.progress, job.found_before)
        keep(result, made_from)

    return jobs.PageWork(store.project, "photographs", search.stages, run, made_from)


def tell_changed(store: ProjectPhotographs, work: jobs.PageWork) -> None:
    """What has changed since the last search, unless one is running."""
    if not jobs.is_running(work.project, work.kind):
        show_stale(changed(store.found_in, work.made_from))


def press_search(work: jobs.PageWork, what: str, key: str, again: bool, ready: bool) -> None:
    """The button that begins a search in the photographs, and its progress."""
    label = f"Find the {what}{' again' * again}"
    jobs.start_button(work, label, key, primary=not again, disabled=not ready)
    cancelled = "Cancelled. What was found before is unchanged."
    jobs.show_job(work.project, work.kind, cancelled)
