"""The Lenses page: upload of board photographs or a camera file, and the lens calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.figures.style import count
from stereocal.intrinsics.boards import find_boards
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
from stereocal.system.records import pack
from stereocal.ui import intake, jobs
from stereocal.ui.fields import (
    Number,
    choose,
    choose_from_menu,
    one_of,
    setting,
    some_of,
    yes_or_no,
)
from stereocal.ui.forms import bounds_of, number_input
from stereocal.ui.messages import ErrorsShown, callback, readable
from stereocal.ui.project import current_project, project_to_write
from stereocal.ui.start import has_sample_photographs, load_sample_boards
from stereocal.ui.texts import escape_markdown

BOARD, FILE = "Photographs of a board", "A camera file"
CHESSBOARD, CHARUCO = "Chessboard", "ChArUco"
SQUARE_MM = 30.0
"""Until the user enters the side of a square."""
STAGES = ("photographs searched", "draws calibrated")
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
    intake.in_use(project, which)
    upload = st.file_uploader(
        f"Camera file, {which}: stereocal's JSON, or OpenCV's YAML, XML or JSON",
        type=intake.CAMERA_KINDS,
        key=f"upload_lens_{which}",
    )
    intake.take_one(upload, partial(intake.store_camera, which))


def from_photographs(which: CameraName) -> ProjectLens | None:
    """The uploader, the forms and the calibration; None while there are no photographs."""
    intake.emptied_uploader(
        f"Photographs of the board by the {which} camera, or a zip of them",
        intake.PHOTOGRAPH_KINDS,
        f"upload_boards_{which}",
        partial(_take_boards, which),
        counter=_ROUND,
    )
    project, work = current_project(), None
    if project is None:
        return None
    store, key = ProjectLens(project, which), f"no_boards_{which}"
    clear = callback(partial(_clear, store))
    try:
        photographs = store.photographs
        if not photographs:
            return None
        left, right = st.columns([3, 1], vertical_alignment="center")
        left.markdown(f"Of the {which} camera: {count(len(photographs), 'photograph')}.")
        right.button("Remove them", on_click=clear, key=key)
        with ErrorsShown():
            work = _act(store, board_form(project), lens_form(project))
    except DamagedError as error:
        st.error(escape_markdown(str(error)))
        st.button("Remove them", on_click=clear, key=key)
        return None
    last = "Cancelled. What is shown is the last finished lens."
    jobs.show_job(project, job_kind(which), last, work)
    return store


def _take_boards(which: CameraName, uploads: Sequence[intake.Upload]) -> None:
    store = ProjectLens(project_to_write(), which)
    intake.take_photographs(intake.photographs_of(uploads), store)


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
    kinds, side = (CHESSBOARD, CHARUCO), (0.1, 10_000.0)
    kind, *places, square = st.columns(4, vertical_alignment="bottom")
    board = choose(project, "board_kind", "Board", kinds, place=kind, tabs_own=False)
    corners = "Where four squares meet: one less than squares. Paper: 18 and 12."
    names = (("one", "board_columns"), ("other", "board_rows"))
    columns, rows = (
        setting(project, name, usual, Number(3, 100)).number_input(
            f"Inner corners, {way} way", place, help=corners
        )
        for place, (way, name), usual in zip(places, names, size, strict=True)
    )
    entered = setting(
        project, "board_square_mm", square_mm, Number(*side, or_none=True)
    ).number_input(
        "Side of a square (mm)",
        square,
        placeholder="measured",
        step=1.0,
        format="%.10g",
        help="The lens does not depend on it; lengths do, where the board gives them.",
    )
    side_mm = entered or SQUARE_MM
    if board == CHESSBOARD:
        return BoardPattern(columns, rows, 1e-3 * side_mm)
    left, right = st.columns(2)
    part = setting(project, _MARKER_PART, 0.75, Number(0.01, 1.0)).value()
    title, first = "Dictionary of the markers", "DICT_4X4_250"
    dictionary = choose_from_menu(
        project, "board_dictionary", title, DICTIONARIES, first, place=left
    )
    own = setting(project, "board_marker_mm", float(f"{part * side_mm:.3g}"), Number(*side))
    marker_mm = own.number_input("Side of a marker (mm)", right, step=1.0, format="%.10g")
    return BoardPattern(columns, rows, 1e-3 * side_mm, dictionary, 1e-3 * marker_mm)


def lens_form(project: Project) -> LensSettings:
    """The form of the calibration's settings, in an expander."""
    values: dict[str, Any] = {}
    model = setting(project, "lens_model", LENS_MODELS[0], one_of(LENS_MODELS)).value()
    with st.expander("Settings of the calibration"):
        numbers, switches = iter(st.columns(3)), iter(st.columns(2))
        for name, about in descriptions(LensSettings).items():
            own = partial(setting, project, f"lens_{name}", about.default)
            if isinstance(about.default, bool):
                values[name] = next(switches).checkbox(
                    about.title,
                    help=about.help,
                    disabled=model == "fisheye",
                    **own(yes_or_no).widget(),
                )
            elif about.choices:
                values[name] = st.radio(
                    about.title,
                    about.choices,
                    format_func=str.capitalize,
                    help=about.help,
                    horizontal=True,
                    **own(one_of(about.choices)).widget(),
                )
            else:
                bounded = own(Number(*bounds_of(about)))
                values[name] = number_input(next(numbers), about, bounded)
    return LensSettings(**values)


def _act(store: ProjectLens, pattern: BoardPattern, settings: LensSettings) -> jobs.Work:
    """The photographs to leave out, and the press; returns what it begins."""
    search, lens = readable(lambda: store.search), readable(lambda: store.calibration)
    leave_out: list[str] = []
    ready = search is not None and search.pattern == pattern
    current = False
    if search is not None and ready:
        names = [view.name for view in search.views]
        chosen = setting(store.project, f"leave_out_{store.which}", [], some_of(names)).widget()
        title = "Photographs to leave out"
        leave_out = st.multiselect(title, names, placeholder="none", **chosen)
        left = [view.name for view in search.without(leave_out).views]
        current = (
            lens is not None
            and lens.settings == settings
            and left == [view.name for view in lens.search.views]
        )
    kind = job_kind(store.which)
    about = {
        "photographs": {name: path.name for name, path in store.photographs.items()},
        "leave_out": list(leave_out),
        "pattern": asdict(pattern),
        "settings": asdict(settings),
    }
    run = partial(_calibrate, store, pattern, settings, leave_out)
    work = jobs.Work(store.project, kind, STAGES, about, run)
    if current:
        jobs.discard_finished(work)
    label = "Calibrate the lens" if ready else "Find the boards and calibrate the lens"
    jobs.start_button(work, label, f"calibrate_{store.which}", primary=not current)
    if lens is not None and not current and not jobs.is_running(store.project, kind):
        st.warning(
            "The form or the photographs have changed since the lens was calibrated. It still "
            "shows what it was made with."
        )
    return work


def _calibrate(
    store: ProjectLens,
    pattern: BoardPattern,
    settings: LensSettings,
    leave_out: Sequence[str],
    job: jobs.Job,
) -> bool:
    control = job.executor, job.progress, lambda: job.cancelled
    search = store.search
    if search is None or search.pattern != pattern:
        boards = job.checkpoints("boards", pack_board, unpack_board)
        search = find_boards(store.photographs, pattern, *control, boards)
        if search is None:
            return False
        store.keep_search(search)
    job.begin(STAGES[1])
    draws = job.checkpoints("draws", pack, unpack_draws)
    lens = calibrate_lens(search.without(leave_out), settings, *control, pieces=draws)
    if lens is None:
        return False
    store.keep_calibration(lens)
    return True


def _clear(store: ProjectLens) -> None:
    jobs.discard(store.project, job_kind(store.which))  # first: a running job needs the photographs
    store.clear()
    st.session_state[_ROUND] += 1


def _has_boards(project: Project) -> bool:
    try:
        return any(ProjectLens(project, which).photographs for which in CAMERAS)
    except StereocalError:  # reported where they are shown
        return True
