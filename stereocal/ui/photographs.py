"""Photographs on the Data page: how they belong together, and the search for what is held."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.formats.dataset_description import POINTS
from stereocal.formats.dataset_files import pack_recording
from stereocal.formats.points_csv import write_points
from stereocal.frames.all_cameras import Found, by_folder
from stereocal.frames.frame import Frame
from stereocal.frames.pairing import Pairing, PhotographPair
from stereocal.frames.reasons import without_names
from stereocal.projects.files import StoredFile
from stereocal.projects.given import ProjectGiven
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import board_corners, thumbnail
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.array_types import FloatArray
from stereocal.system.made_from import Parts
from stereocal.system.numbers import count
from stereocal.ui import holding, jobs
from stereocal.ui.files_of_all import FilesOfAll
from stereocal.ui.holding import ask_if_bar, first_pairs, held_target
from stereocal.ui.messages import ErrorsShown, button, readable, show_with_button
from stereocal.ui.pairing import ROUND, clear, show_pairing
from stereocal.ui.print_downloads import print_what_is_held
from stereocal.ui.review import badge, on_a_sheet, say_what_is_shared, show_frames
from stereocal.ui.search import HeldTarget, ask_held, press_search, search_work, tell_changed
from stereocal.ui.texts import escape_markdown, markdown_list
from stereocal.ui.videos import show_frames_taken


def has_photographs(project: Project) -> bool:
    """Whether the project has photographs."""
    # What is damaged is reported where they are shown.
    return readable(lambda: ProjectPhotographs(project).photographs, warn=False) != {}


def show_photographs(project: Project | None, files: FilesOfAll | None) -> None:
    """How they belong together, and what was found in them.

    Args:
        files: of three cameras and more.
    """
    st.session_state.setdefault(ROUND, 0)
    if project is None or not (
        files or has_photographs(project) or "correspondences" in project.inputs.files
    ):
        cameras = readable(lambda: project.cameras) if project else None
        focal = [float(min(camera.K[0, 0], camera.K[1, 1])) for camera in cameras or () if camera]
        print_what_is_held(project, min(focal) if len(focal) == 2 else None)
    if project is None:
        return
    show_frames_taken(project)
    store = ProjectPhotographs(project)
    try:
        if not store.photographs:
            return
        if files is not None:
            _find_in_all(store, files.cameras)
            return
        if ProjectGiven(project).is_undivided:
            return
        show_pairing(store, partial(_search_again, store))
    except StereocalError as error:
        st.error(escape_markdown(str(error)))
        button("Remove all photographs", "no_photographs", clear, store)
        return
    with ErrorsShown():
        _find_targets(store)


def _find_targets(store: ProjectPhotographs) -> None:
    """The search for what is held, and its results."""
    pairing, frames = store.pairing(), readable(lambda: store.frames)
    held, ready = ask_held(store, pairing, frames is not None)
    if isinstance(held, BoardPattern):
        _boards(store, pairing, held, ready)
    elif not holding.holds_board(store.project):
        _targets(store, pairing, held, frames, ready)


def _targets(
    store: ProjectPhotographs,
    pairing: Pairing,
    target: HeldTarget | None,
    frames: list[Frame] | None,
    ready: bool,
) -> None:
    """The search for the targets of a bar, and the review of what was found."""
    project, cameras = store.project, _cameras_of(store)
    if lacking := [name for name, camera in cameras.items() if not camera]:
        st.info(
            f"Give the camera file of the {' and the '.join(lacking)} camera too: lenses are needed"
            " to tell A from B."
        )
    work = _targets_work(store, pairing, target)
    running = jobs.is_running(project, work.kind)
    press_search(work, "targets", "find_targets", frames is not None, ready and not lacking)
    if frames is None:
        return
    tell_changed(store, work)
    # Those of wrong pairs all say the same.
    if any(frame.use for frame in frames) or not readable(lambda: store.slips, warn=False):
        show_frames(store, frames, running)


def _cameras_of(store: ProjectPhotographs) -> dict[str, Camera | None]:
    return dict(zip(CAMERAS, store.project.cameras, strict=True))


def _targets_work(
    store: ProjectPhotographs, pairing: Pairing, target: HeldTarget | None
) -> jobs.PageWork:
    keep = partial(_keep_frames, store, store.photographs)
    return search_work(store, pairing, _cameras_of(store), target, keep)


def _search_again(store: ProjectPhotographs) -> None:
    """Tell the targets of a bar apart again: photographs that were searched are not again."""
    work = _targets_work(store, store.pairing(), held_target(store.project))
    jobs.wait_shortly(jobs.start(work))


def _keep_frames(
    store: ProjectPhotographs, searched: Mapping[str, StoredFile], result: Found, made_from: Parts
) -> None:
    """Store the targets that were found, to be reviewed."""
    holding.settle(store.project)
    store.settle(result.pairing)
    store.keep_found(result.frames, searched, made_from)


OF_BOARDS = "lens from the boards"
"""Label of a lens that was made from the same photographs."""
MOST_REFUSED = 0.5
"""Share of frames without a usable board; with more, it may be no board that is held."""


def _boards(
    store: ProjectPhotographs, pairing: Pairing, pattern: BoardPattern, ready: bool
) -> None:
    """The search for a board, and what was found."""
    project, pairs, sentence = store.project, pairing.pairs, store.boards_found
    if not sentence:
        _show_first(store, pairs, pattern)
    lenses = _lenses_given(store)
    where = "are those of the camera files" if lenses else "come from the same photographs"
    st.markdown(f"The lenses {where}.")
    keep = partial(_keep_boards, store, None if lenses else OF_BOARDS)
    work = search_work(store, pairing, lenses or dict.fromkeys(CAMERAS), pattern, keep)
    press_search(work, "boards", "find_boards", bool(sentence), ready)
    refused = len(store.doubtful_boards) > MOST_REFUSED * len(pairs)
    last_job = jobs.job_of(project, work.kind)
    if refused if sentence else last_job is not None and last_job.state == "failed":
        ask_if_bar(project)
    if not sentence:
        return
    tell_changed(store, work)
    st.success(escape_markdown(sentence))
    _show_found(store, pairs)


def _keep_boards(
    store: ProjectPhotographs, lenses: str | None, result: Found, made_from: Parts
) -> None:
    """Store the boards that were found, and their lenses."""
    data, sentence = result.recording.pair(*CAMERAS), f"{result.sentence} {result.beyond}".rstrip()
    store.settle(result.pairing)
    store.keep_boards(data, sentence, result.doubtful, lenses, made_from)
    holding.settle(store.project)


def _show_first(
    store: ProjectPhotographs, pairs: Sequence[PhotographPair], pattern: BoardPattern
) -> None:
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


def _show_pair(store: ProjectPhotographs, pair: PhotographPair, *corners: FloatArray) -> None:
    alt = f"Both photographs of frame {pair.frame} with the corners of the board"
    st.image(thumbnail(store, (pair.primary, pair.secondary), corners), width="stretch", alt=alt)


def _show_found(store: ProjectPhotographs, pairs: Sequence[PhotographPair]) -> None:
    """All pairs with the corners in use, doubtful ones first."""
    dataset = readable(lambda: store.project.dataset)
    if dataset is None:
        return
    rows, doubtful = dataset.correspondences, store.doubtful_boards
    reasons = say_what_is_shared(
        {
            pair.frame: without_names(doubtful[pair.frame], (pair.primary, pair.secondary))
            for pair in pairs
            if pair.frame in doubtful
        }
    )

    def show(pair: PhotographPair) -> None:
        here = rows.frame == pair.frame
        _show_pair(store, pair, rows.primary[here], rows.secondary[here])
        state = "found" if pair.frame not in doubtful else "doubtful" if here.any() else "refused"
        st.markdown(f"{badge(state)} **Frame {pair.frame}**")
        why = doubtful.get(pair.frame, "")
        named = [name for name in (pair.primary, pair.secondary) if f"{name}: " in why]
        if caption := reasons.get(pair.frame) or " and ".join(named):
            st.caption(escape_markdown(caption))

    on_a_sheet(store.project, sorted(pairs, key=lambda pair: pair.frame not in doubtful), show)


def _lenses_given(store: ProjectPhotographs) -> dict[str, Camera]:
    """The cameras of the project if it has both from elsewhere; else empty."""
    first, second = readable(lambda: store.project.cameras) or (None, None)
    labels = {store.project.inputs.labels.get(which) for which in CAMERAS}
    if first is None or second is None or labels == {OF_BOARDS}:
        return {}
    return {"primary": first, "secondary": second}


UNUSED, TOLD = "several_unused", "several_told"


def _find_in_all(store: ProjectPhotographs, cameras: Mapping[str, Camera]) -> None:
    """How many photographs there are of each of three cameras and more, and the search."""
    folders = by_folder(store.photographs, cameras)
    counts = ", ".join(f"{camera} {len(names) or 'none'}" for camera, names in folders.items())
    if len(cameras) < 3 or not any(folders.values()):
        return
    words, remove = f"Photographs: {counts}.", "Remove all photographs"
    show_with_button("markdown", words, remove, "several_clear", clear, store)
    pairing = readable(lambda: store.pairing([*cameras]), warn=all(folders.values()))
    if pairing is not None:
        _search_all(store, cameras, pairing)


def _search_all(store: ProjectPhotographs, cameras: Mapping[str, Camera], pairing: Pairing) -> None:
    """What is held, the press, and what was not found."""
    project = store.project
    is_searched = bool(store.found_in)
    held, ready = ask_held(store, pairing, is_searched)
    work = search_work(store, pairing, cameras, held, partial(_keep_all, store))
    press_search(work, "targets", "find_in_all_cameras", is_searched, ready)
    if not is_searched:
        if pairing.sentence:
            st.caption(pairing.sentence)
        return
    tell_changed(store, work)
    unused = project.settings.get(UNUSED) or []
    sentence = project.settings.get(TOLD) or f"{count(len(pairing.moments), 'frame')}."
    st.caption(f"{escape_markdown(str(sentence))} Photographs not used: {len(unused):,}.")
    if unused:
        with st.expander("Photographs that are not used"):
            st.markdown(markdown_list(unused))


def _keep_all(store: ProjectPhotographs, result: Found, made_from: Parts) -> None:
    """Store the table of the targets that were found, of boards the whole recording."""
    project = store.project
    if result.recording.object.board is not None:
        whole = replace(result.recording, name=project.inputs.name or "Rig")
        project.give_recording(whole, pack_recording(whole), same_lengths=True)
        jobs.drop_pairs(project)
    else:
        ProjectGiven(project).add_parts({POINTS: write_points(result.recording)})
    store.keep_found_in(made_from)
    project.keep_settings({UNUSED: [*result.unused], TOLD: result.pairing.sentence})
    holding.settle(project)
