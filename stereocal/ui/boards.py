"""A board in the photographs of both cameras, on the Data page."""

from __future__ import annotations

from dataclasses import asdict

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.frames.pairing import Pairing
from stereocal.intrinsics.calibrate_lens import LensSettings
from stereocal.intrinsics.files import pack_board, unpack_board
from stereocal.intrinsics.stereo_boards import (
    STAGES,
    StereoBoards,
    find_stereo_boards,
    lenses_of_boards,
    recording_of,
    size_in,
)
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.rig.board_pattern import BoardPattern
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.system.latest import Latest
from stereocal.ui import jobs
from stereocal.ui.intake import clear_refusal
from stereocal.ui.lens import board_form
from stereocal.ui.messages import readable
from stereocal.ui.texts import escape_markdown

USUAL = (9, 6)
OF_BOARDS = "lens from the boards"
"""Label of a lens that was made from the same photographs."""
_SIZES: Latest[tuple[int, int]] = Latest(20)


def boards_in(store: ProjectPhotographs) -> None:
    """What is printed on the board, the search for it, and what was found."""
    project, pairs = store.project, [row.pair for row in store.rows if row.use]
    size = _size(store)
    try:
        pattern = board_form(project, size or USUAL)
    except StereocalError as error:
        st.error(escape_markdown(str(error)))
        return
    if size is not None:
        st.caption(f"The first photographs show a chessboard of {size[0]} × {size[1]}.")
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
    found = store.boards_found
    st.button(
        "Find the boards again" if found else "Find the boards",
        key="find_boards",
        type="secondary" if found else "primary",
        disabled=jobs.is_running(project, "photographs") or not pairs,
        on_click=_start,
        args=(work,),
    )
    jobs.show_job(project, "photographs", "Cancelled. What was found before is unchanged.", work)
    if found and store.found_by != work.digest:
        st.warning(
            "The form, the photographs or the camera files have changed since the boards were "
            "found. Find them again."
        )
    if found:
        st.success(escape_markdown(found))


def _start(work: jobs.Work) -> None:
    clear_refusal()
    jobs.start(work)


def _size(store: ProjectPhotographs) -> tuple[int, int] | None:
    """Columns and rows of a chessboard in the first photographs; None if they show none."""
    files = store.photographs
    key = "".join(sorted(file.sha256 for file in files.values()))

    def find() -> tuple[int, int]:
        try:
            with st.spinner("Looking at the first photographs ..."):
                columns, rows = map(int, size_in(files).split("x"))
        except StereocalError:
            return 0, 0
        return columns, rows

    found = _SIZES.once(key, find)
    return found if found[0] else None


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
    cameras = given
    if cameras is None:
        job.begin(STAGES[2])
        lenses = lenses_of_boards(
            boards, LensSettings(), job.executor, job.progress, lambda: job.cancelled
        )
        if lenses is None:
            return False
        cameras = lenses[0].camera, lenses[1].camera
    data = recording_of(boards, cameras, store.project.inputs.name).pair(*CAMERAS)
    store.keep_boards(data, boards.sentence, None if given else OF_BOARDS, job.digest)
    return True
