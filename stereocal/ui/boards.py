"""A board in the photographs of both cameras, on the Data page."""

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.frames.pairing import Pair, Pairing
from stereocal.intrinsics import stereo_boards
from stereocal.intrinsics.boards import FoundBoard
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import board_corners, thumbnail
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.field_of_view import beyond_in_words
from stereocal.rig.rigid_object import BoardPattern
from stereocal.ui import jobs
from stereocal.ui.holding import ask_if_bar, board_form, first_pairs, settle
from stereocal.ui.messages import ErrorsShown, readable, show_stale
from stereocal.ui.review import badge, on_a_sheet
from stereocal.ui.texts import escape_markdown

OF_BOARDS = "lens from the boards"
"""Label of a lens that was made from the same photographs."""
MOST_REFUSED = 0.5
"""Share of frames without a usable board; with more, it may be no board that is held."""


def press_search(work: jobs.PageWork, what: str, key: str, found: bool, ready: bool) -> None:
    """The button that begins a search in the photographs, and its progress."""
    again = " again" * found
    jobs.start_button(work, f"Find the {what}{again}", key, primary=not found, disabled=not ready)
    cancelled = "Cancelled. What was found before is unchanged."
    jobs.show_job(work.project, work.kind, cancelled)


def held_board(project: Project) -> tuple[BoardPattern | None, bool]:
    """The form of the board, None if no board is like that, and whether its size is entered."""
    pattern = None
    with ErrorsShown():
        pattern = board_form(project, (9, 6), square_mm=None)
    entered = project.settings.get("board_square_mm") is not None
    if pattern is not None and not entered:
        st.info("Enter the side of a square as measured: all lengths follow from it.")
    return pattern, entered


def boards_in(store: ProjectPhotographs) -> None:
    """What is printed on the board, the search for it, and what was found."""
    project, pairing = store.project, store.pairing
    pairs = pairing.pairs
    pattern, entered = held_board(project)
    if pattern is None:
        return
    found = store.boards_found
    if not found:
        _show_first(store, pairs, pattern)
    given = _lenses_given(store)
    where = "are those of the camera files" if given else "come from the same photographs"
    st.markdown(f"The lenses {where}.")
    files = {name: path.name for name, path in store.photographs.items()}
    listed = [[p.frame, files.get(p.primary), files.get(p.secondary)] for p in pairs]
    if pairing.by_hand:  # the search finds the pairs
        every = pairing.by_hand.counts.values()
        listed = [[own[name], files.get(name)] for own in every for name in own]
    about = {
        "pairs": listed,
        "board": asdict(pattern),
        "cameras": [camera.to_json() for camera in given or ()],
    }
    run = partial(_find, store, pairing, pattern, given)
    work = jobs.PageWork(project, "photographs", stereo_boards.STAGES, run, jobs.job_digest(about))
    press_search(work, "boards", "find_boards", bool(found), bool(pairs) and entered)
    refused = len(store.doubtful_boards) > MOST_REFUSED * len(pairs)
    last = jobs.job_of(project, "photographs")
    if refused if found else last is not None and last.state == "failed":
        ask_if_bar(project)
    if not found:
        return
    if store.found_by != work.digest:
        show_stale("form, photographs or camera files")
    st.success(escape_markdown(found))
    _show_found(store, pairs)


def _show_first(store: ProjectPhotographs, pairs: Sequence[Pair], pattern: BoardPattern) -> None:
    """Some of the photographs with the corners of this board, for a yes."""
    files = store.photographs
    with st.spinner("Looking at the first photographs ..."):
        for pair, column in zip(first_pairs(pairs), st.columns(3), strict=False):
            first = board_corners(files[pair.primary], pattern)
            second = board_corners(files[pair.secondary], pattern)
            _show_pair(store, pair, (first, second), column)
    st.caption(
        "Corners of this board are dots, the first one is ringed; none are drawn if it is "
        "another board."
    )


def _show_pair(
    store: ProjectPhotographs,
    pair: Pair,
    corners: tuple[FloatArray, FloatArray],
    place: DeltaGenerator,
) -> None:
    alt = f"Both photographs of frame {pair.frame} with the corners of the board"
    place.image(thumbnail(store, (pair.primary, pair.secondary), corners), width="stretch", alt=alt)


def _show_found(store: ProjectPhotographs, pairs: Sequence[Pair]) -> None:
    """All pairs with the corners in use, doubtful ones first."""
    dataset = readable(lambda: store.project.dataset)
    if dataset is None:
        return
    rows, doubtful = dataset.correspondences, store.doubtful_boards

    def show(pair: Pair) -> None:
        own = rows.frame == pair.frame
        _show_pair(store, pair, (rows.primary[own], rows.secondary[own]), st.container())
        state = "found" if pair.frame not in doubtful else "doubtful" if own.any() else "refused"
        st.markdown(f"{badge(state)} **Frame {pair.frame}**")
        st.caption(escape_markdown(doubtful.get(pair.frame, "")))

    on_a_sheet(store.project, sorted(pairs, key=lambda pair: pair.frame not in doubtful), show)


def _lenses_given(store: ProjectPhotographs) -> tuple[Camera, Camera] | None:
    """The cameras of the project if it has both from elsewhere."""
    first, second = readable(lambda: store.project.cameras) or (None, None)
    labels = {store.project.inputs.labels.get(which) for which in CAMERAS}
    if first is None or second is None or labels == {OF_BOARDS}:
        return None
    return first, second


def _find(
    store: ProjectPhotographs,
    pairing: Pairing,
    pattern: BoardPattern,
    given: tuple[Camera, Camera] | None,
    job: jobs.Job,
) -> None:
    """Find the boards and the lenses, and store them."""
    earlier = job.found_before(FoundBoard)
    boards = stereo_boards.find_stereo_boards(
        store.photographs, pattern, job.executor, job.begin, job.progress, earlier, pairing, given
    )
    cameras, loose = given, dict[int, str]()
    if cameras is None:
        job.begin(stereo_boards.STAGES[2])
        lenses = stereo_boards.lenses_of_boards(boards, None, job.executor, job.progress)
        cameras = lenses[0].camera, lenses[1].camera
        outlying = {*lenses[0].outlying, *lenses[1].outlying}
        loose = {
            seen.frame: f"The corners in {view.name} fit the lens less than half as well as usual."
            for seen in boards.common
            for view in seen.views
            if view.name in outlying
        }
    data = stereo_boards.recording_of(boards, cameras, store.project.inputs.name).pair(*CAMERAS)
    label = None if given else OF_BOARDS
    sentence = f"{boards.sentence} {beyond_in_words(data.beyond_view)}".rstrip()
    store.settle(boards.pairing)
    store.keep_boards(data, sentence, {**loose, **boards.doubtful}, label, job.work.digest)
    settle(store.project)
