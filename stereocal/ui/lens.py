"""The Lenses page: upload of board photographs or a camera file, and the lens calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.figures.style import count
from stereocal.intrinsics.boards import BoardSearch, find_boards
from stereocal.intrinsics.calibrate_lens import LensSettings, calibrate_lens
from stereocal.intrinsics.files import pack_board, unpack_board, unpack_draws
from stereocal.intrinsics.proposed_board import ProposedBoard
from stereocal.projects.database import DamagedError
from stereocal.projects.lens import ProjectLens
from stereocal.projects.project import Project
from stereocal.rig.board_pattern import DICTIONARIES, BoardPattern
from stereocal.rig.camera import CAMERAS, LENS_MODELS, CameraName
from stereocal.system.described import descriptions
from stereocal.system.numbers import rounded
from stereocal.system.photograph import SUFFIXES
from stereocal.system.records import pack
from stereocal.ui import jobs
from stereocal.ui.fields import Number, choose, one_of, setting, some_of, yes_or_no
from stereocal.ui.forms import bounds_of, number_input
from stereocal.ui.intake import (
    CAMERA_KINDS,
    Upload,
    clear_refusal,
    escape_markdown,
    in_use,
    photographs_of,
    take_file,
    take_photographs,
)
from stereocal.ui.messages import callback, readable
from stereocal.ui.project import current_project, project_to_write
from stereocal.ui.samples import has_sample_photographs, load_sample_boards
from stereocal.ui.uploads import free_memory

BOARD, FILE = "Photographs of a board", "A camera file"
CHESSBOARD, CHARUCO = "Chessboard", "ChArUco"
SQUARE_MM = 30.0
"""Until the user enters the side of a square."""
STAGES = ("photographs searched", "draws calibrated")
KINDS = [*sorted(suffix.removeprefix(".") for suffix in SUFFIXES), "zip"]
_ROUND, _MARKER_PART = "boards_round", "board_marker_part"


def job_kind(which: CameraName) -> jobs.Kind:
    """The kind of a camera's jobs."""
    return "lens_primary" if which == "primary" else "lens_secondary"


def show_cameras_in_use(project: Project | None) -> None:
    """Show the project's lens of each camera."""
    cameras = project.cameras if project else (None, None)
    labels = project.inputs.labels if project else {}
    for which, camera, column in zip(CAMERAS, cameras, st.columns(2), strict=True):
        with column.container(border=True, height="stretch"):
            st.markdown(f"**{which.capitalize()} camera**")
            if camera is None:
                st.markdown("No lens yet.")
                continue
            width, height = camera.image_size
            known = camera.uncertainty
            sigma = f" ± {rounded(known.fx)}" if known else ""
            st.markdown(
                f"{escape_markdown(labels[which])}: fx {camera.K[0, 0]:.2f}{sigma} px, "
                f"image {width} × {height} px"
            )


def choose_camera(project: Project | None) -> tuple[CameraName, str]:
    """Which camera, and where its lens comes from."""
    left, right = st.columns(2)
    which: CameraName = choose(
        project, "lens_camera", "Camera", CAMERAS, place=left, format_func=str.capitalize
    )
    how: str = choose(project, "lens_how", "I have", (BOARD, FILE), place=right)
    if how == BOARD and has_sample_photographs() and not (project and _has_boards(project)):
        st.button("Try with sample photographs", key="sample_boards", on_click=load_sample_boards)
    return which, how


def from_file(project: Project | None, which: CameraName) -> None:
    """The uploader of a camera file."""
    in_use(project, which)
    upload = st.file_uploader(
        f"Camera file, {which}: stereocal's JSON, or OpenCV's YAML, XML or JSON",
        type=CAMERA_KINDS,
        key=f"upload_lens_{which}",
    )
    take_file(which, upload)


def from_photographs(project: Project | None, which: CameraName) -> ProjectLens | None:
    """The uploader, the forms and the calibration; None while there are no photographs."""
    key = f"upload_boards_{which}_{st.session_state.setdefault(_ROUND, 0)}"
    uploads = st.file_uploader(
        f"Photographs of the board by the {which} camera, or a zip of them",
        type=KINDS,
        accept_multiple_files=True,
        key=key,
    )
    take_boards(uploads, which)
    project = current_project()
    if project is None:
        return None
    store, work = ProjectLens(project, which), None
    try:
        photographs = store.photographs
        if not photographs:
            return None
        left, right = st.columns([3, 1], vertical_alignment="center")
        left.markdown(f"Of the {which} camera: {count(len(photographs), 'photograph')}.")
        right.button("Remove them", on_click=_clear, args=(store,), key=f"no_boards_{which}")
        pattern, settings = board_form(project), lens_form(project)
        work = _act(store, pattern, settings)
    except DamagedError as error:
        st.error(escape_markdown(str(error)))
        st.button("Remove them", on_click=_clear, args=(store,), key=f"no_boards_{which}")
        return None
    except StereocalError as error:
        st.error(escape_markdown(str(error)))
    last = "Cancelled. What is shown is the last finished lens."
    jobs.show_job(project, job_kind(which), last, work)
    return store


def take_boards(uploads: Sequence[Upload], which: CameraName) -> None:
    """Store uploads, and free their memory."""
    if not uploads:
        return
    store = ProjectLens(project_to_write(), which)
    clear_refusal()
    take_photographs(photographs_of(uploads), store)
    # A new key empties the uploader, which otherwise keeps every file in memory.
    free_memory(uploads)
    st.session_state[_ROUND] += 1
    st.rerun()


def board_settings(board: ProposedBoard) -> dict[str, Any]:
    """The values of the form for a board, but for the side of its squares."""
    marked = {"board_dictionary": board.dictionary, _MARKER_PART: board.marker}
    return {
        "board_kind": CHARUCO if board.dictionary else CHESSBOARD,
        "board_columns": board.columns,
        "board_rows": board.rows,
        **(marked if board.dictionary else {}),
    }


def board_form(
    project: Project, size: tuple[int, int] = (18, 12), square_mm: float | None = SQUARE_MM
) -> BoardPattern:
    """The form of the printed board, the same for both cameras.

    Args:
        size: the usual columns and rows.
        square_mm: of the form before the user enters one; None leaves the field empty.

    Raises:
        StereocalError: no board is like that.
    """
    kinds, corners, side = (CHESSBOARD, CHARUCO), (3, 100), (0.1, 10_000.0)
    kind, *places, square = st.columns(4, vertical_alignment="bottom")
    board = choose(project, "board_kind", "Board", kinds, place=kind, tabs_own=False)
    columns, rows = (
        place.number_input(
            f"Inner corners, {way} way",
            *corners,
            step=1,
            help="Where four squares meet: one less than squares. Paper: 18 and 12.",
            **setting(project, name, usual, Number(*corners)).widget(),
        )
        for place, way, name, usual in zip(
            places, ("one", "other"), ("board_columns", "board_rows"), size, strict=True
        )
    )
    entered = square.number_input(
        "Side of a square (mm)",
        *side,
        value=None,
        placeholder="measured",
        step=1.0,
        format="%.10g",
        help="The lens does not depend on it; lengths do, where the board gives them.",
        **setting(project, "board_square_mm", square_mm, Number(*side, or_none=True)).widget(),
    )
    side_mm = entered or SQUARE_MM
    dictionary, marker_m = None, None
    if board == CHARUCO:
        left, right = st.columns(2)
        part = setting(project, _MARKER_PART, 0.75, Number(0.01, 1.0)).value()
        marker_mm = float(f"{part * side_mm:.3g}")
        dictionary = choose(
            project,
            "board_dictionary",
            "Dictionary of the markers",
            DICTIONARIES,
            "DICT_4X4_250",
            place=left,
            tabs_own=False,
            as_menu=True,
        )
        marker_m = 1e-3 * right.number_input(
            "Side of a marker (mm)",
            *side,
            step=1.0,
            format="%.10g",
            **setting(project, "board_marker_mm", marker_mm, Number(*side)).widget(),
        )
    return BoardPattern(columns, rows, 1e-3 * side_mm, dictionary, marker_m)


def lens_form(project: Project) -> LensSettings:
    """The form of the calibration's settings, in an expander."""
    values: dict[str, Any] = {}
    model = setting(project, "lens_model", LENS_MODELS[0], one_of(LENS_MODELS)).value()
    with st.expander("Settings of the calibration"):
        numbers, switches = st.columns(3), st.columns(2)
        for name, about in descriptions(LensSettings).items():
            if isinstance(about.default, bool):
                own = setting(project, f"lens_{name}", about.default, yes_or_no)
                place = switches[len(values) - len(numbers)]
                values[name] = place.checkbox(
                    about.title, help=about.help, disabled=model == "fisheye", **own.widget()
                )
            elif about.choices:
                own = setting(project, f"lens_{name}", about.default, one_of(about.choices))
                values[name] = st.radio(
                    about.title,
                    about.choices,
                    format_func=str.capitalize,
                    help=about.help,
                    horizontal=True,
                    **own.widget(),
                )
            else:
                bounds = bounds_of(about)
                own = setting(project, f"lens_{name}", about.default, Number(*bounds))
                values[name] = number_input(numbers[len(values)], about, own)
    return LensSettings(**values)


def _act(store: ProjectLens, pattern: BoardPattern, settings: LensSettings) -> jobs.Work:
    search, lens = readable(lambda: store.search), readable(lambda: store.calibration)
    ready = search is not None and search.pattern == pattern
    leave_out: list[str] = []
    if ready and search is not None:
        leave_out = _choose_left_out(store, search)
    running = jobs.is_running(store.project, job_kind(store.which))
    current = (
        ready
        and search is not None
        and lens is not None
        and lens.settings == settings
        and [view.name for view in lens.search.views]
        == [view.name for view in search.without(leave_out).views]
    )
    work = _work(store, pattern, settings, leave_out)
    if current:
        jobs.discard_finished(work)
    label = "Calibrate the lens" if ready else "Find the boards and calibrate the lens"
    jobs.start_button(work, label, f"calibrate_{store.which}", primary=not current)
    if lens is not None and not current and not running:
        st.warning(
            "The form or the photographs have changed since the lens was calibrated. It still "
            "shows what it was made with."
        )
    return work


def _choose_left_out(store: ProjectLens, search: BoardSearch) -> list[str]:
    names = [view.name for view in search.views]
    left_out = setting(store.project, f"leave_out_{store.which}", [], some_of(names))
    chosen: list[str] = st.multiselect(
        "Photographs to leave out", names, placeholder="none", **left_out.widget()
    )
    return chosen


def _work(
    store: ProjectLens, pattern: BoardPattern, settings: LensSettings, leave_out: Sequence[str]
) -> jobs.Work:
    about = {
        "photographs": {name: path.name for name, path in store.photographs.items()},
        "leave_out": list(leave_out),
        "pattern": asdict(pattern),
        "settings": asdict(settings),
    }
    return jobs.Work(
        store.project,
        job_kind(store.which),
        STAGES,
        about,
        lambda job: _calibrate(store, pattern, settings, leave_out, job),
    )


def _calibrate(
    store: ProjectLens,
    pattern: BoardPattern,
    settings: LensSettings,
    leave_out: Sequence[str],
    job: jobs.Job,
) -> bool:
    def cancelled() -> bool:
        return job.cancelled

    search = store.search
    if search is None or search.pattern != pattern:
        boards = job.checkpoints("boards", pack_board, unpack_board)
        search = find_boards(
            store.photographs, pattern, job.executor, job.progress, cancelled, boards
        )
        if search is None:
            return False
        store.keep_search(search)
    job.begin(STAGES[1])
    lens = calibrate_lens(
        search.without(leave_out),
        settings,
        job.executor,
        job.progress,
        cancelled,
        pieces=job.checkpoints("draws", pack, unpack_draws),
    )
    if lens is None:
        return False
    store.keep_calibration(lens)
    return True


@callback
def _clear(store: ProjectLens) -> None:
    jobs.discard(store.project, job_kind(store.which))  # first: a running job needs the photographs
    store.clear()
    st.session_state[_ROUND] += 1


def _has_boards(project: Project) -> bool:
    try:
        return any(ProjectLens(project, which).photographs for which in CAMERAS)
    except StereocalError:  # reported where they are shown
        return True
