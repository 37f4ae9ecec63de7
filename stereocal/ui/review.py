"""Review of the frames: a contact sheet, or one frame to correct."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TypeVar

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.figures.style import TARGET_COLOURS, TARGET_SYMBOLS
from stereocal.formats.correspondences_csv import write_table
from stereocal.frames import review as reviewing
from stereocal.frames.frame import STATES, Frame, correspondences_of, describe_frames, name_in
from stereocal.frames.reasons import shared_reasons
from stereocal.frames.review import Review, is_undecided
from stereocal.projects.files import StoredFile
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import change_review, read_review, thumbnail
from stereocal.rig.camera import CAMERAS
from stereocal.rig.correspondences import TARGETS
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Field, Number, choose, one_of, setting, yes_or_no
from stereocal.ui.figure import scroll_to, scrolled_part
from stereocal.ui.holding import CALLED, held_target, is_coloured
from stereocal.ui.messages import button, callback, readable, refusing
from stereocal.ui.picker import KEYS, Mark, Pick, pick, read_image, shown_image
from stereocal.ui.texts import escape_markdown, markdown_list

ALL, ONE = "All frames", "One frame"
ONE_FRAME = "one_frame"
NEAREST = "Nearest"
WANTED = (NEAREST, *TARGETS)
"""The targets that a click can be set to move."""
_OUTCOME = "review_said"
SHEET = -1
"""Stands for a frame's number where several were changed at once."""
Item = TypeVar("Item")
ON_A_SHEET = 12
"""Frames on one contact sheet."""
COLUMNS = 3
BADGES = {
    "found": (":material/check:", "green"),
    "doubtful": (":material/question_mark:", "orange"),
    "refused": (":material/close:", "red"),
}
Change = Callable[[Review], tuple[Review, str]]
"""An edit, and what it did as a sentence."""


def _view(store: ProjectPhotographs) -> Field:
    return setting(store.project, "frames_view", ALL, one_of((ALL, ONE)))


def _frame(store: ProjectPhotographs, numbers: Sequence[int] = ()) -> Field:
    """The frame shown; without `numbers` it is not checked."""
    default, fit = (numbers[0], one_of(numbers)) if numbers else (0, int)
    return setting(store.project, "review_frame", default, fit, name="frame", tabs_own=True)


def _of_clicks(store: ProjectPhotographs) -> tuple[Field, Field]:
    """The target that a click moves, and whether the click itself is kept."""
    field = partial(setting, store.project, tabs_own=True)
    return field("review_target", NEAREST, one_of(WANTED)), field("review_raw", False, yes_or_no)


def _called(store: ProjectPhotographs) -> str:
    """The word for what a click is moved to, by the kind of target."""
    return CALLED[type(held_target(store.project))]


def show_frames(store: ProjectPhotographs, frames: Sequence[Frame], running: bool) -> None:
    """Show all frames or one, as chosen on the page, and offer their points as a file."""
    table = readable(lambda: write_table(correspondences_of(frames)))
    if _view(store).buttons("Look at") == ONE and frames:
        with scrolled_part(ONE_FRAME):
            _show_one(store, running)
    else:
        show_contact_sheet(store, frames, running)
    if table is None:  # `readable` has put the reason on the page
        return
    offer(
        "Download correspondences.csv",
        table,
        "correspondences.csv",
        "download_correspondences",
        help="The column source says of each row: detected, corrected (moved by a person to a "
        "fitted corner) or manual (a raw click).",
    )


def _show_one(store: ProjectPhotographs, running: bool) -> None:
    review = read_review(store)
    frame, (target, raw) = _choose_frame(store, review), _of_clicks(store)
    st.markdown(f"{badge(frame.state)} {reviewing.describe_use(frame)}")
    # A container, even an empty one, keeps the position of what follows: otherwise the browser
    # would rebuild the photographs.
    with st.container():
        if frame.reason:
            st.markdown(escape_markdown(frame.reason))
    _decide(store, review, frame, running)
    left, right = st.columns(2, vertical_alignment="bottom")
    target.buttons("A click moves target", left)
    right.toggle(
        "Keep the raw click",
        **raw.widget(),
        help="The centre goes exactly where you click, also with the shift key held. Otherwise it "
        f"goes to the {_called(store)} near the click.",
    )
    if not _show_outcome(frame.frame):
        where = "to where you click" if raw.value() else f"to the {_called(store)} there"
        st.info(f"Click near the middle of a target: it moves {where}.")
    for camera, column in enumerate(st.columns(2)):
        with column:
            _show_photograph(store, frame, camera, running)
    st.caption(f"{KEYS} Zoomed far in, the white circle is one sigma, the standard error.")
    st.table(reviewing.centres_table(frame))
    st.markdown(reviewing.describe_residuals(review.frames, frame, store.project.cameras))


def _show_outcome(number: int) -> bool:
    """What was done last, if it was done to this frame; whether it was."""
    outcome: tuple[int, str, bool] | None = st.session_state.get(_OUTCOME)
    if outcome is None or outcome[0] != number or not outcome[1]:
        return False
    (st.warning if outcome[2] else st.success)(escape_markdown(outcome[1]))
    return True


def _choose_frame(store: ProjectPhotographs, review: Review) -> Frame:
    """The frame shown, with buttons for others."""
    numbers = sorted(frame.frame for frame in review.frames)
    field = _frame(store, numbers)
    number: int = field.value()
    next_label = f"Next to decide ({sum(map(is_undecided, review.frames))} left)"
    before, after = (reviewing.beside(review.frames, number, way) for way in (-1, 1))
    doubtful = reviewing.next_doubtful(review.frames, number)
    chosen, buttons = st.columns([1, 3], vertical_alignment="bottom")
    field.menu("Frame", chosen)
    ways = (("Previous", "p", before), ("Next", "n", after), (next_label, "d", doubtful))
    with buttons.container(horizontal=True):
        for label, key, to in ways:
            stays = to in (None, number)
            button(label, f"review_{key}", _go_to, store, to, shortcut=key, disabled=stays)
    return review.frame(number)


def _decide(store: ProjectPhotographs, review: Review, frame: Frame, running: bool) -> None:
    """Buttons to use the frame, leave it out, or undo."""

    def choose(use: bool, now: Review) -> tuple[Review, str]:
        report = "It is used." if use else "It is left out."
        return reviewing.use_frame(now, frame.frame, use), report

    use, leave_out = (
        partial(edit, store, frame.frame, partial(choose, to)) for to in (True, False)
    )
    undecided = is_undecided(frame)
    may_use = bool(frame.targets_in_both) and (undecided or not frame.use)
    back, undo, may_leave = partial(take_back, store), review.acts, frame.use or undecided
    with st.container(horizontal=True):
        for label, key, act, may, icon in (
            ("Use this frame", "t", use, may_use, "check"),
            ("Leave it out", "x", leave_out, may_leave, "close"),
            (f"Undo ({undo})", "u", back, undo > 0, "undo"),
        ):
            disabled = running or not may
            button(label, f"review_{key}", act, icon=icon, shortcut=key, disabled=disabled)


def _show_photograph(store: ProjectPhotographs, frame: Frame, camera: int, running: bool) -> None:
    name = CAMERAS[camera]
    st.markdown(f"**{name.capitalize()}** · {escape_markdown(frame.files[camera])}")
    try:
        file = _file_of(store, frame, camera)
        coloured = is_coloured(held_target(store.project))
        image = shown_image(coloured, file, frame.files[camera])
    except StereocalError as error:
        st.warning(escape_markdown(str(error)))
        return
    marks = [
        Mark(
            letter,
            centre.u,
            centre.v,
            centre.sigma_px,
            TARGET_COLOURS[letter],
            TARGET_SYMBOLS[letter],
        )
        for letter, centre in zip(TARGETS, frame.centres[camera], strict=True)
        if centre
    ]
    pick(
        image,
        marks,
        f"Photograph of the {name} camera, frame {frame.frame}.",
        f"pick_{name}",
        running,
        partial(take_pick, store, frame.frame, camera),
    )

    def swap(now: Review) -> tuple[Review, str]:
        swapped = reviewing.swap(now, frame.frame, camera)
        return swapped, f"A and B are exchanged in the {name} photograph."

    off, act = running or not any(frame.centres[camera]), partial(edit, store, frame.frame, swap)
    button("Swap A and B", f"swap_{name}", act, icon="swap_horiz", disabled=off)


def _file_of(store: ProjectPhotographs, frame: Frame, camera: int) -> StoredFile:
    file = store.photographs.get(frame.files[camera])
    if file is None:
        raise StereocalError(f"{name_in(camera, frame)}: there is no such photograph.")
    return file


def take_pick(store: ProjectPhotographs, number: int, camera: int, click: Pick) -> None:
    """Move or set a target where the user clicked (a callback).

    Clicks in a photograph that is no longer shown are ignored.
    """
    wanted, raw = (field.value() for field in _of_clicks(store))
    raw = raw or click.raw

    def change(now: Review) -> tuple[Review, str]:
        frame = now.frame(number)
        file = _file_of(store, frame, camera)
        if file.name != click.id:
            return now, ""
        held = held_target(store.project)
        image = read_image(is_coloured(held), file, frame.files[camera])
        lens = store.project.cameras[camera]
        centre = reviewing.centre_at(image, (click.u, click.v), raw, held, lens)
        if wanted in TARGETS:
            target = TARGETS.index(wanted)
        else:
            target = reviewing.target_meant(frame, camera, centre)
        what = "where you clicked" if raw else f"at the {_called(store)}"
        sigma = "" if centre.sigma_px is None else f", sigma {centre.sigma_px:.3f} px"
        after = reviewing.place_target(now, number, camera, target, centre)
        decide = f" {reviewing.DECIDE}" if is_undecided(after.frame(number)) else ""
        return after, (
            f"{TARGETS[target]} in the {CAMERAS[camera]} photograph is now {what}, "
            f"({centre.u:.2f}, {centre.v:.2f}){sigma}.{decide}"
        )

    edit(store, number, change)


def edit(store: ProjectPhotographs, number: int, change: Change) -> None:
    """Apply an edit and report the outcome (a callback)."""
    report = ""

    def changed(now: Review) -> Review:
        nonlocal report
        after, report = change(now)
        return after

    refused = False
    try:
        change_review(store, changed)
    except StereocalError as error:
        report, refused = str(error), True
    st.session_state[_OUTCOME] = (number, report, refused)


@callback
def take_back(store: ProjectPhotographs) -> None:
    """Undo the latest edit, and show its frame (a callback)."""
    if edits := read_review(store).edits:
        number = edits[-1].after.frame
        _go_to(store, number)
        number = number if _view(store).value() == ONE else SHEET
        edit(store, number, lambda now: (reviewing.undo(now), "The last change is undone."))


@callback
def look_closely(store: ProjectPhotographs, number: int) -> None:
    """Show one frame (a callback)."""
    _view(store).set(ONE)
    scroll_to(ONE_FRAME)
    _go_to(store, number)


@callback
def _go_to(store: ProjectPhotographs, number: int) -> None:
    _frame(store).set(number)
    st.session_state.pop(_OUTCOME, None)


def show_contact_sheet(store: ProjectPhotographs, frames: Sequence[Frame], running: bool) -> None:
    """The frames, twelve on a sheet; each can be used, left out, or opened."""
    st.info(describe_frames(frames))
    _show_outcome(SHEET)
    review = read_review(store)
    doubtful = [f for f in frames if is_undecided(f) and len(f.targets_in_both) == 2]
    with st.container(horizontal=True):
        if doubtful:
            label = "Use all doubtful ones that lie on their epipolar lines"
            button(label, "use_agreeing", _use_agreeing, store, icon="done_all", disabled=running)
        if review.acts:
            label = f"Undo ({review.acts})"
            button(label, "sheet_undo", take_back, store, icon="undo", disabled=running)
    groups: dict[str, list[Frame]] = {
        "All": list(frames),
        "To decide": [frame for frame in frames if is_undecided(frame)],
        **{state.capitalize(): [f for f in frames if f.state == state] for state in STATES},
    }
    groups = {name: group for name, group in groups.items() if group or name == "All"}
    counted = {name: f"{name} ({len(group)})" for name, group in groups.items()}
    usual = "To decide" if "To decide" in groups else "All"
    named = counted.__getitem__
    chosen = choose(store.project, "sheet_kind", "Show", groups, usual, format_func=named)
    reasons = say_what_is_shared({frame.frame: frame.reason for frame in groups[chosen]})
    on_a_sheet(store.project, groups[chosen], partial(_show_frame, store, running, reasons))
    st.caption(
        "Each picture: the primary camera on the left, the secondary on the right; A green, B "
        "pink. Sigma is the standard error of a centre."
    )


def _use_agreeing(store: ProjectPhotographs) -> None:
    """Use the doubtful frames that agree with the others (a callback)."""
    first, second = store.project.cameras
    if first is None or second is None:
        raise StereocalError("Both camera files are needed to compare the frames.")
    edit(store, SHEET, lambda now: reviewing.use_agreeing(now, (first, second)))


def say_what_is_shared(reasons: Mapping[int, str]) -> dict[int, str]:
    """Say once why several frames are doubtful or refused; what is left to say of each."""
    shared, rest = shared_reasons(reasons)
    if shared:
        st.markdown(markdown_list(shared))
    return rest


def on_a_sheet(
    project: Project, items: Sequence[Item], show: Callable[[Item], None], key: str = "sheet"
) -> None:
    """Twelve of the items, in columns, and which twelve."""
    sheets = -(-len(items) // ON_A_SHEET)
    sheet = 1
    if sheets > 1:
        field = setting(project, key, 1, Number(1, sheets), tabs_own=True)
        sheet = field.number_input(f"Sheet (of {sheets})", width=200)
    on_it = items[(sheet - 1) * ON_A_SHEET : sheet * ON_A_SHEET]
    for start in range(0, len(on_it), COLUMNS):
        for item, column in zip(on_it[start:], st.columns(COLUMNS), strict=False):
            with column:
                show(item)


def badge(state: str) -> str:
    """The sign of a state, in Markdown."""
    icon, colour = BADGES[state]
    return f":{colour}-badge[{icon} {state}]"


def _show_frame(
    store: ProjectPhotographs, running: bool, reasons: Mapping[int, str], frame: Frame
) -> None:
    alt = f"Both photographs of frame {frame.frame} about the targets found"
    st.image(thumbnail(store, frame.files, frame.centres), width="stretch", alt=alt)
    sigmas = [c.sigma_px for pair in frame.centres for c in pair if c and c.sigma_px is not None]
    checked = "corrected" if frame.corrected else "reviewed" if frame.reviewed else ""
    reviewed = f" · {checked}" if checked else ""
    sigma = f" · sigma ≤ {max(sigmas):.3f} px" if sigmas else ""
    st.markdown(f"{badge(frame.state)} **Frame {frame.frame}**{sigma}{reviewed}")
    if reason := reasons.get(frame.frame):
        st.caption(escape_markdown(reason))
    key = f"use_frame_{frame.frame}"

    @refusing()
    def choose_use() -> None:
        use = bool(st.session_state[key])
        change_review(store, lambda review: reviewing.use_frame(review, frame.frame, use))

    st.session_state[key] = frame.use
    with st.container(horizontal=True, vertical_alignment="center"):
        may = not running and bool(frame.targets_in_both)
        st.checkbox("Use this frame", key=key, disabled=not may, on_change=choose_use)
        key, look = f"look_{frame.frame}", partial(look_closely, store)
        button("Look closely", key, look, frame.frame, icon="zoom_in", type="tertiary")
