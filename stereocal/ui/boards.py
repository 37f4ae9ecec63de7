"""A board in the photographs of both cameras, on the Data page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.errors import StereocalError
from stereocal.frames.pairing import Pair, Pairing
from stereocal.intrinsics.calibrate_lens import LensSettings
from stereocal.intrinsics.files import pack_board, unpack_board
from stereocal.intrinsics.stereo_boards import (
    STAGES,
    StereoBoards,
    find_stereo_boards,
    lenses_of_boards,
    recording_of,
)
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.review import board_corners, board_thumbnail
from stereocal.rig.board_pattern import BoardPattern
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.compiled import FloatArray
from stereocal.ui import jobs
from stereocal.ui.contact_sheet import badge, on_a_sheet
from stereocal.ui.holding import first_pairs
from stereocal.ui.lens import board_form
from stereocal.ui.messages import readable
from stereocal.ui.texts import escape_markdown

USUAL = (9, 6)
OF_BOARDS = "lens from the boards"
"""Label of a lens that was made from the same photographs."""


def boards_in(store: ProjectPhotographs) -> None:
    """What is printed on the board, the search for it, and what was found."""
    project, pairs = store.project, [row.pair for row in store.rows if row.use]
    try:
        pattern = board_form(project, USUAL, square_mm=None)
    except StereocalError as error:
        st.error(escape_markdown(str(error)))
        return
    entered = project.settings.get("board_square_mm") is not None
    found = store.boards_found
    if not found:
        _show_first(store, pairs, pattern)
    if not entered:
        st.info("Enter the side of a square as measured: all lengths follow from it.")
    given = _lenses_given(store)
    st.markdown(
        "The lenses are those of the camera files."
        if given
        else "The lenses come from the same photographs."
    )
    pairing = Pairing(tuple(pairs), (), (), store.proposal.sentence, ambiguous=False)
    files = {name: path.name for name, path in store.photographs.items()}
    about = {
        "pairs": [
            [pair.frame, files.get(pair.primary), files.get(pair.secondary)] for pair in pairs
        ],
        "board": asdict(pattern),
        "cameras": [camera.to_json() for camera in given or ()],
    }
    work = jobs.Work(
        project,
        "photographs",
        STAGES,
        about,
        lambda job: _find(store, pairing, pattern, given, job),
    )
    label = "Find the boards again" if found else "Find the boards"
    jobs.start_button(
        work, label, "find_boards", primary=not found, disabled=not pairs or not entered
    )
    jobs.show_job(project, "photographs", "Cancelled. What was found before is unchanged.", work)
    if found and store.found_by != work.digest:
        st.warning(
            "The form, the photographs or the camera files have changed since the boards were "
            "found. Find them again."
        )
    if found:
        st.success(escape_markdown(found))
        _show_found(store, pairs)


def _show_first(store: ProjectPhotographs, pairs: Sequence[Pair], pattern: BoardPattern) -> None:
    """Some of the photographs with the corners of this board, for a yes."""
    files = store.photographs
    with st.spinner("Looking at the first photographs ..."):
        for pair, column in zip(first_pairs(pairs), st.columns(3), strict=False):
            first, second = (
                board_corners(files[name], pattern) for name in (pair.primary, pair.secondary)
            )
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
    place.image(board_thumbnail(store, pair, corners), width="stretch", alt=alt)


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
) -> bool:
    """Find the boards and the lenses, and store them; False if cancelled."""
    boards: StereoBoards | None = find_stereo_boards(
        store.photographs,
        pattern,
        job.executor,
        job.begin,
        job.progress,
        lambda: job.cancelled,
        job.checkpoints("boards", pack_board, unpack_board),
        pairing,
    )
    if boards is None:
        return False
    cameras, loose = given, dict[int, str]()
    if cameras is None:
        job.begin(STAGES[2])
        lenses = lenses_of_boards(
            boards, LensSettings(), job.executor, job.progress, lambda: job.cancelled
        )
        if lenses is None:
            return False
        cameras = lenses[0].camera, lenses[1].camera
        outlying = {*lenses[0].outlying, *lenses[1].outlying}
        loose = {
            seen.frame: f"The corners in {view.name} fit the lens less than half as well as usual."
            for seen in boards.common
            for view in seen.views
            if view.name in outlying
        }
    data = recording_of(boards, cameras, store.project.inputs.name).pair(*CAMERAS)
    label = None if given else OF_BOARDS
    store.keep_boards(data, boards.sentence, {**loose, **boards.doubtful}, label, job.digest)
    return True
