"""The Cameras page: board photographs or a camera file in, boards found, the lens calibrated."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.formats.photograph import SUFFIXES
from stereocal.formats.photograph_files import unpack_photographs
from stereocal.intrinsics import LensSettings, calibrate_lens
from stereocal.lens.board_pattern import DICTIONARIES, BoardPattern
from stereocal.lens.boards import BoardSearch, find_boards
from stereocal.lens.files import pack_board, pack_draws, unpack_board, unpack_draws
from stereocal.project import Project
from stereocal.store.lens import WHICH, ProjectLens, Which
from stereocal.store.state import DamagedError
from stereocal.ui import jobs
from stereocal.ui.intake import (
    CAMERA_KINDS,
    Upload,
    check_uploads,
    escape_markdown,
    in_use,
    keep_uploads,
    refuse,
    settled,
    survived,
    take_file,
)
from stereocal.ui.project import current_project, keeper, project_to_write, remembered
from stereocal.ui.samples import has_sample_photographs, load_sample_boards
from stereocal.ui.told import callback, readable, tell

BOARD, FILE = "Photographs of a board", "A camera file"
CHESSBOARD, CHARUCO = "Chessboard", "ChArUco"
STAGES = ("photographs searched", "draws calibrated")
KINDS = [*sorted(suffix.removeprefix(".") for suffix in SUFFIXES), "zip"]
_ROUND = "boards_round"


def job_kind(which: Which) -> jobs.Kind:
    """The kind of a camera's jobs."""
    return "lens_primary" if which == "primary" else "lens_secondary"


def show_cameras_in_use(project: Project | None) -> None:
    """What the project has for each camera."""
    cameras = project.cameras if project else (None, None)
    labels = project.inputs.labels if project else {}
    for which, camera, column in zip(WHICH, cameras, st.columns(2), strict=True):
        with column.container(border=True, height="stretch"):
            st.markdown(f"**{which.capitalize()} camera**")
            if camera is None:
                st.markdown("No lens yet.")
                continue
            width, height = camera.image_size
            known = camera.uncertainty
            sigma = f" ± {known.fx:.2g}" if known else ""
            st.markdown(
                f"{escape_markdown(labels[which])}: fx {camera.K[0, 0]:.2f}{sigma} px, "
                f"image {width} × {height} px"
            )
    if project and all(cameras):
        st.page_link("pages/data.py", label="Go on to Data", icon=":material/arrow_forward:")


def choose_camera(project: Project | None) -> tuple[Which, str]:
    """Which camera, and where its lens comes from."""
    left, right = st.columns(2)
    which: Which = left.segmented_control(
        "Camera", WHICH, default="primary", key="lens_camera", required=True,
        format_func=str.capitalize,
    )  # fmt: skip
    how = right.segmented_control(
        "I have", [BOARD, FILE], default=BOARD, key="lens_how", required=True
    )
    if how == BOARD and has_sample_photographs() and not (project and _has_boards(project)):
        st.button("Try with sample photographs", key="sample_boards", on_click=load_sample_boards)
    return which, how


def from_file(project: Project | None, which: Which) -> None:
    """A camera file, as on the Data page."""
    in_use(project, which)
    upload = st.file_uploader(
        f"Camera file, {which}: stereocal's JSON, or OpenCV's YAML, XML or JSON",
        type=CAMERA_KINDS, key=f"upload_lens_{which}",
    )  # fmt: skip
    take_file(which, upload)


def from_photographs(project: Project | None, which: Which) -> ProjectLens | None:
    """The uploader, the board, the settings and the act; None while there are no photographs."""
    key = f"upload_boards_{which}_{st.session_state.setdefault(_ROUND, 0)}"
    uploads = st.file_uploader(
        f"Photographs of the board by the {which} camera, or a zip of them", type=KINDS,
        accept_multiple_files=True, key=key,
    )  # fmt: skip
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
        left.markdown(f"{len(photographs)} photographs of the {which} camera are here.")
        right.button("Remove them", on_click=_clear, args=(store, set(photographs)),
                     key=f"no_boards_{which}")  # fmt: skip
        pattern, settings = board_form(project), lens_form(project)
        work = _act(store, pattern, settings)
    except DamagedError as error:
        st.error(escape_markdown(str(error)))
        st.button("Remove them", on_click=_clear, args=(store, ()), key=f"no_boards_{which}")
        return None
    except StereocalError as error:
        st.error(escape_markdown(str(error)))
    last = "Cancelled. What is shown is the last finished lens."
    jobs.show_job(project, job_kind(which), last, work)
    return store


def take_boards(uploads: Sequence[Upload], which: Which) -> None:
    """Put uploads onto the disk, and let go of them in memory."""
    if not uploads:
        return
    store = ProjectLens(project_to_write(), which)
    found: dict[str, Path] = {}
    try:
        check_uploads(uploads)
        for upload in uploads:
            if upload.name.lower().endswith(".zip"):
                found |= unpack_photographs(upload.getvalue(), upload.name, store.files)
            else:
                found |= keep_uploads([upload], store.files)
        if not found:
            raise StereocalError("There is no photograph among these files.")
        settled()
    except StereocalError as error:
        refuse(error)
    if found := survived(found):
        store.add(found)
    # A new key empties the uploader, which else holds every file in memory while the page is open.
    st.session_state[_ROUND] += 1
    st.rerun()


def board_form(project: Project) -> BoardPattern:
    """What is printed on the board; the same for both cameras.

    Raises:
        StereocalError: a board that cannot be.
    """
    remembered(project, {
        "board_kind": CHESSBOARD, "board_columns": 18, "board_rows": 12, "board_square_mm": 30.0,
        "board_marker_mm": 22.5, "board_dictionary": "DICT_4X4_250",
    })  # fmt: skip
    kind, columns, rows, square = st.columns(4, vertical_alignment="bottom")
    kind.segmented_control(
        "Board", [CHESSBOARD, CHARUCO], key="board_kind", required=True,
        on_change=keeper(project, "board_kind"),
    )  # fmt: skip
    for column, name, title in (
        (columns, "board_columns", "Inner corners, one way"),
        (rows, "board_rows", "Inner corners, other way"),
    ):
        column.number_input(
            title, 3, 100, step=1, key=name, on_change=keeper(project, name),
            help="Where four squares meet: one less than squares. Paper: 18 and 12.",
        )  # fmt: skip
    square.number_input(
        "Side of a square (mm)", 0.1, 10_000.0, step=1.0, key="board_square_mm", format="%.10g",
        on_change=keeper(project, "board_square_mm"), help="The lens does not depend on it.",
    )  # fmt: skip
    dictionary, marker_m = None, None
    if st.session_state["board_kind"] == CHARUCO:
        left, right = st.columns(2)
        dictionary = left.selectbox(
            "Dictionary of the markers", DICTIONARIES, key="board_dictionary",
            on_change=keeper(project, "board_dictionary"),
        )  # fmt: skip
        marker_m = 1e-3 * right.number_input(
            "Side of a marker (mm)", 0.1, 10_000.0, step=1.0, key="board_marker_mm",
            format="%.10g", on_change=keeper(project, "board_marker_mm"),
        )  # fmt: skip
    state = st.session_state
    return BoardPattern(
        state["board_columns"], state["board_rows"], 1e-3 * state["board_square_mm"], dictionary,
        marker_m,
    )  # fmt: skip


def lens_form(project: Project) -> LensSettings:
    """How the lens is calibrated, in an expander.

    Raises:
        StereocalError: a number out of its range.
    """
    paper = LensSettings()
    defaults = {
        "lens_subset": paper.subset, "lens_repeats": paper.repeats, "lens_seed": paper.seed,
        "lens_fix_k3": paper.fix_k3, "lens_zero_tangential": paper.zero_tangential,
    }  # fmt: skip
    remembered(project, defaults)
    with st.expander("Settings of the calibration"):
        for column, (name, title, lowest, highest, text) in zip(st.columns(3), (
            ("lens_subset", "Photographs of a draw", 3, 1000,
             "Fewer than there are. Paper: 20 of 50."),
            ("lens_repeats", "Draws", 2, 1000, "The result is their median. Paper: 50."),
            ("lens_seed", "Seed", 0, 2**31 - 1,
             "Source of the random numbers: the same seed gives the same file."),
        ), strict=True):  # fmt: skip
            column.number_input(
                title, lowest, highest, step=1, key=name, help=text, on_change=keeper(project, name)
            )
        left, right = st.columns(2)
        left.checkbox(
            "Hold k3 at 0", key="lens_fix_k3", on_change=keeper(project, "lens_fix_k3"),
            help="Steadier for long lenses, which bend little. Paper: not held.",
        )  # fmt: skip
        right.checkbox(
            "Hold p1 and p2 at 0", key="lens_zero_tangential",
            on_change=keeper(project, "lens_zero_tangential"),
            help="If the lens surely stands square to the sensor. Paper: not held.",
        )  # fmt: skip
    subset, repeats, seed, fix_k3, zero_tangential = (st.session_state[key] for key in defaults)
    return LensSettings(subset, repeats, seed, fix_k3, zero_tangential)


def _act(store: ProjectLens, pattern: BoardPattern, settings: LensSettings) -> jobs.Work:
    search, lens = readable(lambda: store.search), readable(lambda: store.calibration)
    ready = search is not None and search.pattern == pattern
    leave_out: list[str] = []
    if ready and search is not None:
        leave_out = _choose_left_out(store, search)
    running = jobs.is_running(store.project, job_kind(store.which))
    current = (
        ready and search is not None and lens is not None and lens.settings == settings
        and [view.name for view in lens.search.views]
        == [view.name for view in search.without(leave_out).views]
    )  # fmt: skip
    work = _work(store, pattern, settings, leave_out)
    if current:
        jobs.is_done(work)
    label = "Calibrate the lens" if ready else "Find the boards and calibrate the lens"
    st.button(
        label, type="secondary" if current else "primary", key=f"calibrate_{store.which}",
        disabled=running, on_click=_start, args=(work,),
    )  # fmt: skip
    if lens is not None and not current and not running:
        st.warning(
            "The form or the photographs have changed since the lens was calibrated. It still "
            "shows what it was made with."
        )
    return work


def _choose_left_out(store: ProjectLens, search: BoardSearch) -> list[str]:
    key = f"leave_out_{store.which}"
    remembered(store.project, {key: []})
    names = [view.name for view in search.views]
    st.session_state[key] = [name for name in st.session_state[key] if name in names]
    chosen: list[str] = st.multiselect(
        "Photographs to leave out", names, key=key, on_change=keeper(store.project, key),
        placeholder="none",
    )  # fmt: skip
    return chosen


def _start(work: jobs.Work) -> None:
    settled()
    jobs.start(work)


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
        store.project, job_kind(store.which), STAGES, about,
        lambda job: _calibrate(store, pattern, settings, leave_out, job),
    )  # fmt: skip


def _calibrate(
    store: ProjectLens, pattern: BoardPattern, settings: LensSettings, leave_out: Sequence[str],
    job: jobs.Job,
) -> bool:  # fmt: skip
    def cancelled() -> bool:
        return job.cancelled

    search = store.search
    if search is None or search.pattern != pattern:
        boards = job.parts("boards", pack_board, unpack_board)
        search = find_boards(
            store.photographs, pattern, job.executor, job.progress, cancelled, boards
        )
        if search is None:
            return False
        store.keep_search(search)
    job.begin(STAGES[1])
    lens = calibrate_lens(
        search.without(leave_out), settings, job.executor, job.progress, cancelled,
        pieces=job.parts("draws", pack_draws, unpack_draws),
    )  # fmt: skip
    if lens is None:
        return False
    store.keep_calibration(lens)
    return True


@callback
def _clear(store: ProjectLens, seen: Collection[str]) -> None:
    with suppress(StereocalError):  # a list that is damaged is cleared as well
        if set(store.photographs) - set(seen):
            tell("Another tab has added photographs: look, and press again.")
            return
    jobs.discard(store.project, job_kind(store.which))  # before: it needs the photographs
    store.clear()
    st.session_state[_ROUND] += 1


def _has_boards(project: Project) -> bool:
    try:
        return any(ProjectLens(project, which).photographs for which in WHICH)
    except StereocalError:  # said where they are shown
        return True
