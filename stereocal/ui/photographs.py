"""Photographs on the Data page: their pairs, and the search for targets or for boards in them."""

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial

import streamlit as st

from stereocal.detection.target import BAR, Sighting, Target
from stereocal.errors import StereocalError
from stereocal.frames.pairing import Pair, Pairing
from stereocal.frames.search import STAGES, detect_frames
from stereocal.intrinsics import stereo_boards
from stereocal.intrinsics.boards import FoundBoard
from stereocal.projects.given import ProjectGiven
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import board_corners, thumbnail
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.field_of_view import beyond_in_words
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.array_types import FloatArray
from stereocal.ui import holding, jobs
from stereocal.ui.holding import ask_if_bar, board_form, first_pairs, settle
from stereocal.ui.messages import ErrorsShown, button, readable, show_stale
from stereocal.ui.pairing import ROUND, clear, show_pairing
from stereocal.ui.print_downloads import print_what_is_held
from stereocal.ui.review import badge, on_a_sheet, show_frames
from stereocal.ui.texts import escape_markdown
from stereocal.ui.videos import show_frames_taken


def has_photographs(project: Project) -> bool:
    """Whether the project has photographs."""
    # What is damaged is reported where they are shown.
    return readable(lambda: ProjectPhotographs(project).photographs, told=False) != {}


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
    searched, before = store.photographs, job.found_before(Sighting)
    about = pairing.moments, searched, {"primary": primary, "secondary": secondary}, target
    found = detect_frames(*about, job.executor, job.begin, job.progress, earlier=before)
    store.project.keep_settings({holding.FOUND: held})
    holding.settle(store.project)
    store.settle(pairing, found.motion)
    store.keep_found(found.frames[CAMERAS], searched)


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
        "cameras": [camera.to_json() for camera in given.values()],
    }
    run = partial(_find_boards, store, pairing, pattern, given)
    stages = *stereo_boards.stages_of(CAMERAS), stereo_boards.LENSES_STAGE
    work = jobs.PageWork(project, "photographs", stages, run, jobs.job_digest(about))
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
            with column:
                _show_pair(store, pair, first, second)
    st.caption(
        "Corners of this board are dots, the first one is ringed; none are drawn if it is "
        "another board."
    )


def _show_pair(store: ProjectPhotographs, pair: Pair, *corners: FloatArray) -> None:
    alt = f"Both photographs of frame {pair.frame} with the corners of the board"
    st.image(thumbnail(store, (pair.primary, pair.secondary), corners), width="stretch", alt=alt)


def _show_found(store: ProjectPhotographs, pairs: Sequence[Pair]) -> None:
    """All pairs with the corners in use, doubtful ones first."""
    dataset = readable(lambda: store.project.dataset)
    if dataset is None:
        return
    rows, doubtful = dataset.correspondences, store.doubtful_boards

    def show(pair: Pair) -> None:
        own = rows.frame == pair.frame
        _show_pair(store, pair, rows.primary[own], rows.secondary[own])
        state = "found" if pair.frame not in doubtful else "doubtful" if own.any() else "refused"
        st.markdown(f"{badge(state)} **Frame {pair.frame}**")
        st.caption(escape_markdown(doubtful.get(pair.frame, "")))

    on_a_sheet(store.project, sorted(pairs, key=lambda pair: pair.frame not in doubtful), show)


def _lenses_given(store: ProjectPhotographs) -> dict[str, Camera]:
    """The cameras of the project if it has both from elsewhere; else empty."""
    first, second = readable(lambda: store.project.cameras) or (None, None)
    labels = {store.project.inputs.labels.get(which) for which in CAMERAS}
    if first is None or second is None or labels == {OF_BOARDS}:
        return {}
    return {"primary": first, "secondary": second}


def _find_boards(
    store: ProjectPhotographs,
    pairing: Pairing,
    pattern: BoardPattern,
    given: dict[str, Camera],
    job: jobs.Job,
) -> None:
    """Find the boards and the lenses, and store them."""
    about = pairing.moments, store.photographs, given or dict.fromkeys(CAMERAS), pattern
    control = job.executor, job.begin, job.progress, job.found_before(FoundBoard)
    boards = stereo_boards.find_stereo_boards(*about, *control, pairing.alone)
    cameras, loose = given, dict[int, str]()
    if not given:
        job.begin(stereo_boards.LENSES_STAGE)
        lenses = stereo_boards.lenses_of_boards(boards, None, job.executor, job.progress)
        cameras = {which: lens.camera for which, lens in lenses.items()}
        outlying = {name for lens in lenses.values() for name in lens.outlying}
        loose = {
            frame: f"The corners in {view.name} fit the lens less than half as well as usual."
            for frame, views in boards.seen.items()
            for view in views.values()
            if view.name in outlying
        }
    found = stereo_boards.recording_of(boards, cameras, store.project.inputs.name)
    data = found.recording.pair(*CAMERAS)
    label = None if given else OF_BOARDS
    sentence = f"{boards.sentence} {beyond_in_words(data.beyond_view)}".rstrip()
    store.settle(pairing, boards.motion)
    store.keep_boards(data, sentence, {**loose, **boards.doubtful}, label, job.work.digest)
    settle(store.project)
