"""What is held: a bar with 2x2 targets, balls of two colours or tags, or a board."""

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.detection.ball_colours import colour_at
from stereocal.detection.balls import find_balls
from stereocal.detection.target import (
    BAR,
    BRIGHT,
    Balls,
    Bar2x2,
    Sighting,
    Tags,
    Target,
    parse_target,
)
from stereocal.errors import StereocalError
from stereocal.figures.style import TARGET_COLOURS, TARGET_SYMBOLS
from stereocal.frames.pairing import Pair
from stereocal.projects.files import StoredFile
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.rig.camera import Camera
from stereocal.rig.rigid_object import DICTIONARIES, BoardPattern
from stereocal.system.photograph import read_colours
from stereocal.ui.fields import Field, Number, choose, choose_from_menu, one_of, setting
from stereocal.ui.messages import callback, readable
from stereocal.ui.picker import Mark, Pick, pick, shown_image
from stereocal.ui.proposal import (
    CHARUCO,
    CHESSBOARD,
    HELD,
    MARKER_PART,
    ask_whether_bar,
    proposed_kind,
    show_proposal,
)
from stereocal.ui.texts import escape_markdown

KINDS = {"bar2x2": "Bar, 2x2", "balls": "Two balls", "board": "Board", "tags": "Tags"}
BOARD = "board"
SQUARE_MM = 30.0
"""Until the user enters the side of a square."""
FOUND = "held_found"
USUAL_TAGS, TAGS_TITLE = "4X4_50:0,1", "Dictionary, and the numbers of A and B"
CALLED: dict[type, str] = {Bar2x2: "fitted corner", Balls: "ball", Tags: "tag"}
"""What a click moves a centre to."""


def _kind(project: Project | None) -> Field:
    usual = proposed_kind(project, "bar2x2")
    return setting(project, HELD, usual, one_of(KINDS))


def _colours(project: Project) -> Field:
    """The colours of A and B; while the user clicks, of A only."""
    return setting(project, "held_balls", "", _text)


def held_tags(project: Project | None, key: str = "held_tags") -> Field:
    """Dictionary and numbers of the tags, in a widget with this key."""
    return setting(project, key, USUAL_TAGS, _text, name="held_tags")


def held_kind(project: Project | None) -> str:
    """What is held, one of `KINDS`."""
    return str(_kind(project).value())


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(value)
    return value


def held_text(project: Project) -> str:
    """The target as `parse_target` reads it."""
    kind = held_kind(project)
    rest = {"balls": _colours, "tags": held_tags}.get(kind)
    return kind if rest is None else f"{kind}:{rest(project).value()}"


def settle(project: Project) -> None:
    """Take what was looked for as the user's answer."""
    project.keep_settings({HELD: held_kind(project)})


def ask_if_bar(project: Project) -> None:
    """The question after a search that found the board in few photographs."""
    ask_whether_bar(_kind(project))


def holds_board(project: Project) -> bool:
    """Whether a board is held."""
    return held_kind(project) == BOARD


def first_pairs(pairs: Sequence[Pair]) -> list[Pair]:
    """Three of the pairs: the first, one from the middle, the last."""
    return [pairs[at] for at in sorted({0, len(pairs) // 2, len(pairs) - 1})] if pairs else []


def held_target(project: Project) -> Target:
    """The target of the project; 2x2 targets if what was stated is incomplete."""
    try:
        return parse_target(held_text(project))
    except StereocalError:
        return BAR


def ask_what_is_held(store: ProjectPhotographs, pairs: Sequence[Pair], fold: bool) -> Target | None:
    """The proposal, and the controls.

    Args:
        pairs: the balls are picked in the first photograph.
        fold: the photograph is folded away, since the targets have been found.

    Returns:
        The target; None until it is stated, and for a board.
    """
    project = store.project
    if FOUND not in project.settings:
        show_proposal(store, pairs, _kind(project))
    kind = _kind(project).buttons("What do you hold?", format_func=KINDS.__getitem__)
    if kind == BOARD:
        return None
    if kind == "bar2x2":
        return BAR
    if kind == "tags":
        st.text_input(
            TAGS_TITLE,
            help="As `4X4_50:3,7`, or `APRILTAG_36h11:0,1`; the names are OpenCV's.",
            **held_tags(project).widget(),
        )
    else:
        _ask_colours(store, pairs[0] if pairs else None, fold)
        if _unfinished(project):
            return None
    try:
        return parse_target(held_text(project))
    except StereocalError as error:
        st.error(escape_markdown(str(error)))
        return None


def _unfinished(project: Project) -> bool:
    colours: str = _colours(project).value()
    return "," not in colours and colours != BRIGHT


def _ask_colours(store: ProjectPhotographs, pair: Pair | None, fold: bool) -> None:
    """A photograph to click the balls in, and their colours to type."""
    project, field = store.project, _colours(store.project)
    if unfinished := _unfinished(project):
        which = "B, the other ball" if field.value() else "A, then ball B"
        st.info(f"Click ball {which}, on the lit side.")
    if pair is not None and (file := store.photographs.get(pair.primary)) is not None:
        label = "Photograph to pick the colours of the balls in."
        folded = fold and not unfinished
        with st.expander("Pick the colours again") if folded else st.container():
            marks = [] if unfinished else _found(store, file, pair.primary)
            image = readable(lambda: shown_image(file.name, True, file, pair.primary))
            if image is not None:
                image = replace(image, id=f"colours-{image.id}")  # a view of its own
                pick(image, marks, label, "pick_colour", False, partial(_take, project, file))
    st.text_input(
        "Colours of A and B",
        placeholder="red,yellow",
        help="Clicks fill this in. Names or `#c0392b,#f1c40f`; `bright` for two lamps, "
        "`white,white` for balls of one colour, which are told apart by the other frames.",
        **field.widget(),
    )


@callback
def _take(project: Project, file: StoredFile, at: Pick) -> None:
    """Use the colour at a click: of A, then of B, then anew."""
    field = _colours(project)
    own = colour_at(read_colours(file, "the photograph"), (at.u, at.v))
    before = field.value()
    if own == "white":
        field.set("white,white")
    else:
        field.set(f"{before},{own}" if before and _unfinished(project) else own)


def _found(store: ProjectPhotographs, file: StoredFile, name: str) -> list[Mark]:
    """The balls in the photograph, as marks, and a line about them."""
    target, camera = held_target(store.project), store.project.cameras[0]
    if not isinstance(target, Balls):
        return []
    lens = "" if camera is None else json.dumps(camera.to_json())
    seen = readable(lambda: _sighting(file.name, held_text(store.project), lens, file, name))
    if seen is None:
        return []
    if seen.missing:
        st.warning(f"{seen.missing} Click both balls again, or in the middle of their lit side.")
    else:
        radii = " and ".join(f"{spot.radius_px:.0f}" for spot in seen.spots if spot)
        st.success(f"Both balls are found here, with radii of {radii} px.")
    return [
        Mark(letter, at.u, at.v, at.radius_px, TARGET_COLOURS[letter], TARGET_SYMBOLS[letter])
        for letter, at in zip("AB", seen.spots, strict=True)
        if at
    ]


@st.cache_data(show_spinner=False, max_entries=8)
def _sighting(digest: str, text: str, lens: str, _file: StoredFile, _name: str) -> Sighting:
    assert _file.name == digest  # the content, for the cache
    target = parse_target(text)
    assert isinstance(target, Balls)
    camera = Camera.from_json(json.loads(lens), "the lens") if lens else None
    return find_balls(read_colours(_file, _name), target, camera)


def is_coloured(target: Target) -> bool:
    """Whether its photographs are read in colours."""
    return isinstance(target, Balls)


def corner_fields(
    project: Project | None,
    places: Sequence[DeltaGenerator],
    prefix: str,
    usual: Sequence[int] = (18, 12),
    text: str | None = None,
) -> tuple[int, int]:
    """The fields of a board's inner corners, its columns and rows; `text` is their help."""
    columns, rows = (
        setting(project, f"{prefix}_{name}", first, Number(3, 100)).number_input(
            f"Inner corners, {way} way", place, help=text
        )
        for place, way, name, first in zip(
            places, ("one", "other"), ("columns", "rows"), usual, strict=True
        )
    )
    return columns, rows


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
    columns, rows = corner_fields(project, places, "board", size, corners)
    own = setting(project, "board_square_mm", square_mm, Number(*side, or_none=True))
    about = "The lens does not depend on it; lengths do, where the board gives them."
    shown = {"placeholder": "measured", "step": 1.0, "format": "%.10g"}
    side_mm = own.number_input("Side of a square (mm)", square, help=about, **shown) or SQUARE_MM
    if board == CHESSBOARD:
        return BoardPattern(columns, rows, 1e-3 * side_mm)
    left, right = st.columns(2)
    part = setting(project, MARKER_PART, 0.75, Number(0.01, 1.0)).value()
    title, first = "Dictionary of the markers", "DICT_4X4_250"
    dictionary = choose_from_menu(
        project, "board_dictionary", title, DICTIONARIES, first, place=left
    )
    own = setting(project, "board_marker_mm", float(f"{part * side_mm:.3g}"), Number(*side))
    marker_mm = own.number_input("Side of a marker (mm)", right, step=1.0, format="%.10g")
    return BoardPattern(columns, rows, 1e-3 * side_mm, dictionary, 1e-3 * marker_mm)
