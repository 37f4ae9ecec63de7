"""What is held: a bar with 2x2 targets, balls of two colours or tags, or a board; as the first
photographs show it, with its picture, until the user answers."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.detection.ball_colours import colour_at
from stereocal.detection.balls import find_balls
from stereocal.detection.target import BAR, BRIGHT, Balls, Bar2x2, Tags, Target, parse_target
from stereocal.errors import StereocalError
from stereocal.figures.style import TARGET_COLOURS, TARGET_SYMBOLS
from stereocal.frames.frame import Centre, CentrePair
from stereocal.frames.pairing import PhotographPair
from stereocal.intrinsics.held_object import HeldObject, Patterns, held_object, spread
from stereocal.intrinsics.proposed_board import ProposedBoard
from stereocal.projects.files import StoredFile
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import thumbnail
from stereocal.rig.rigid_object import DICTIONARIES, BoardPattern
from stereocal.system.array_types import FloatArray
from stereocal.system.latest import once
from stereocal.system.photograph import read_colours
from stereocal.ui.fields import Field, Number, choose, choose_from_menu, one_of, setting
from stereocal.ui.messages import button, callback, readable
from stereocal.ui.picker import Mark, Pick, pick, shown_image
from stereocal.ui.texts import escape_markdown

HELD, PROPOSAL = "held", "held_proposal"
"""Settings: what the user said, and what is proposed until then."""
CHESSBOARD, CHARUCO = "Chessboard", "ChArUco"
MARKER_PART = "board_marker_part"
UNDECIDED = "What you hold is not clear from the first photographs: choose it."


def _show_proposal(store: ProjectPhotographs, pairs: Sequence[PhotographPair]) -> None:
    """The proposal with its picture, until the user has said what is held.

    It is made when both cameras' photographs are there, and again when they change.
    """
    project = store.project
    # Targets that were found before anything was proposed say what is held.
    is_found = PROPOSAL not in project.settings and bool(store.frames or store.boards_found)
    if HELD in project.settings or len(pairs) < 2 or is_found:
        return
    _look(store, pairs)
    proposal = project.settings[PROPOSAL]
    if "kind" not in proposal:
        st.info(UNDECIDED)
        return
    with st.container(border=True):
        left, right = st.columns([2, 3], vertical_alignment="center")
        left.markdown(escape_markdown(proposal["sentence"]))
        left.caption("Yes, or choose below what you hold.")
        button("Yes, that is it", "held_yes", _kind(project).set, proposal["kind"], place=left)
        picture = readable(lambda: _picture(store, proposal))
        if picture is not None:
            alt = "Both photographs of a frame, with what was found in them"
            right.image(picture, width="stretch", alt=alt)


def ask_if_bar(project: Project) -> None:
    """The question after a search that found the board in few photographs."""
    with st.container(border=True):
        st.markdown("The board is in few of the photographs. Do you hold a bar with two targets?")
        button("Yes, a bar", "held_bar", _kind(project).set, "bar2x2")


def _look(store: ProjectPhotographs, pairs: Sequence[PhotographPair]) -> None:
    """Make the proposal, unless it was made from these photographs."""
    project, files, some_pairs = store.project, store.photographs, spread(pairs)
    names = [pair.primary for pair in some_pairs], [pair.secondary for pair in some_pairs]
    cameras = [{name: files[name] for name in side if name in files} for side in names]
    contents = [[file.name for file in camera.values()] for camera in cameras]
    digest = hashlib.sha256(repr(contents).encode()).hexdigest()
    proposal = project.settings.get(PROPOSAL)
    if isinstance(proposal, dict) and proposal.get("of") == digest:
        return

    def looked(name: str, make: Callable[[], Patterns]) -> Patterns:
        return once("patterns", files[name].name, make)

    with st.spinner("Looking at the first photographs ..."):
        held = once("what is held", f"{names} {digest}", lambda: held_object(cameras, looked))
    settings: dict[str, Any] = {PROPOSAL: {"of": digest}}
    if held is not None:
        settings = {PROPOSAL: {"of": digest, **_as_stored(held, some_pairs)}, **_values(held)}
    project.keep_settings(settings)
    st.rerun()  # what stands above depends on it


def _as_stored(held: HeldObject, pairs: Sequence[PhotographPair]) -> dict[str, Any]:
    """The proposal as it is stored: its kind, its sentence, and a frame to draw it in."""
    first, second = held.seen
    seen = [(p.primary in first) + (p.secondary in second) for p in pairs]
    best = pairs[int(np.argmax(seen))]
    names = best.primary, best.secondary
    marks = [p[n].tolist() if n in p else [] for p, n in zip(held.seen, names, strict=True)]
    stored = {"kind": held.kind, "sentence": held.sentence}
    return {**stored, "frame": best.frame, "names": names, "marks": marks}


def _values(held: HeldObject) -> dict[str, Any]:
    """The fields of what is held, by setting."""
    match held.what:
        case Balls(colours=colours):
            return {"held_balls": ",".join(colours)}
        case Tags(dictionary=dictionary, ids=(a, b)):
            return {"held_tags": f"{dictionary}:{a},{b}"}
        case ProposedBoard() as board:
            return fields_of_board(board)
    return {}


def fields_of_board(board: ProposedBoard) -> dict[str, Any]:
    """The fields of a board, by setting."""
    size = {"board_columns": board.columns, "board_rows": board.rows}
    if board.dictionary is None:
        return {"board_kind": CHESSBOARD, **size}
    markers = {"board_dictionary": board.dictionary, MARKER_PART: board.marker}
    return {"board_kind": CHARUCO, **size, **markers}


def _picture(store: ProjectPhotographs, proposal: dict[str, Any]) -> bytes:
    try:
        first, second = map(str, proposal["names"])
        points = [np.reshape(p, (-1, 2)).astype(np.float64) for p in proposal["marks"]]
    except (KeyError, TypeError, ValueError) as error:
        raise StereocalError("The proposal is damaged: give the photographs again.") from error
    of_bar = all(len(p) in (0, 2) for p in points)
    return thumbnail(store, (first, second), [_targets(p) if of_bar else p for p in points])


def _targets(points: FloatArray) -> CentrePair:
    if not len(points):
        return None, None
    a, b = points.tolist()
    return Centre(*a), Centre(*b)


KINDS = {"bar2x2": "Bar, 2x2", "balls": "Two balls", "board": "Board", "tags": "Tags"}
BOARD = "board"
SQUARE_MM = 30.0
"""Until the user enters the side of a square."""
USUAL_TAGS, TAGS_TITLE = "4X4_50:0,1", "Dictionary, and the numbers of A and B"
CALLED: dict[type, str] = {Bar2x2: "fitted corner", Balls: "ball", Tags: "tag"}
"""What a click moves a centre to."""


def _kind(project: Project | None) -> Field:
    """What is held; as proposed until the user says."""
    proposal = None if project is None else project.settings.get(PROPOSAL)
    usual = str(proposal.get("kind", "bar2x2")) if isinstance(proposal, dict) else "bar2x2"
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
    details = {"balls": _colours, "tags": held_tags}.get(kind)
    return kind if details is None else f"{kind}:{details(project).value()}"


def settle(project: Project) -> None:
    """Take what was looked for as the user's answer."""
    project.keep_settings({HELD: held_kind(project)})


def holds_board(project: Project) -> bool:
    """Whether a board is held."""
    return held_kind(project) == BOARD


def first_pairs(pairs: Sequence[PhotographPair]) -> list[PhotographPair]:
    """Three of the pairs: the first, one from the middle, the last."""
    return [pairs[index] for index in sorted({0, len(pairs) // 2, len(pairs) - 1})] if pairs else []


def held_target(project: Project) -> Target:
    """The target of the project; 2x2 targets if what was stated is incomplete."""
    try:
        return parse_target(held_text(project))
    except StereocalError:
        return BAR


def ask_what_is_held(
    store: ProjectPhotographs, pairs: Sequence[PhotographPair], fold: bool
) -> Target | None:
    """The proposal, and the controls.

    Args:
        pairs: the balls are picked in the first photograph.
        fold: the photograph is folded away, since the targets have been found.

    Returns:
        The target; None until it is stated, and for a board.
    """
    project = store.project
    if not store.found_in:
        _show_proposal(store, pairs)
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


def _ask_colours(store: ProjectPhotographs, pair: PhotographPair | None, fold: bool) -> None:
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
            image = readable(lambda: shown_image(True, file, pair.primary))
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
def _take(project: Project, file: StoredFile, click: Pick) -> None:
    """Use the colour at a click: of A, then of B, then anew."""
    field = _colours(project)
    colour = colour_at(read_colours(file, "the photograph"), (click.u, click.v))
    before = field.value()
    if colour == "white":
        field.set("white,white")
    else:
        field.set(f"{before},{colour}" if before and _unfinished(project) else colour)


def _found(store: ProjectPhotographs, file: StoredFile, name: str) -> list[Mark]:
    """The balls in the photograph, as marks, and a line about them."""
    target, camera = held_target(store.project), store.project.cameras[0]
    if not isinstance(target, Balls):
        return []
    key = repr((file.name, target, camera and camera.to_json()))
    balls = readable(
        lambda: once("balls", key, lambda: find_balls(read_colours(file, name), target, camera))
    )
    if balls is None:
        return []
    if balls.missing:
        st.warning(f"{balls.missing} Click both balls again, or in the middle of their lit side.")
    else:
        radii = " and ".join(f"{spot.radius_px:.0f}" for spot in balls.spots if spot)
        st.success(f"Both balls are found here, with radii of {radii} px.")
    return [
        Mark(letter, spot.u, spot.v, spot.radius_px, TARGET_COLOURS[letter], TARGET_SYMBOLS[letter])
        for letter, spot in zip("AB", balls.spots, strict=True)
        if spot
    ]


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
        setting(project, f"{prefix}_{name}", default, Number(3, 100)).number_input(
            f"Inner corners, {way} way", place, help=text
        )
        for place, way, name, default in zip(
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
    side_field = setting(project, "board_square_mm", square_mm, Number(*side, or_none=True))
    hint = "The lens does not depend on it; lengths do, where the board gives them."
    options = {"placeholder": "measured", "step": 1.0, "format": "%.10g"}
    side_mm = (
        side_field.number_input("Side of a square (mm)", square, help=hint, **options) or SQUARE_MM
    )
    if board == CHESSBOARD:
        return BoardPattern(columns, rows, 1e-3 * side_mm)
    left, right = st.columns(2)
    part = setting(project, MARKER_PART, 0.75, Number(0.01, 1.0)).value()
    key, title, usual = "board_dictionary", "Dictionary of the markers", "DICT_4X4_250"
    dictionary = choose_from_menu(project, key, title, DICTIONARIES, usual, place=left)
    side_field = setting(project, "board_marker_mm", float(f"{part * side_mm:.3g}"), Number(*side))
    marker_mm = side_field.number_input("Side of a marker (mm)", right, step=1.0, format="%.10g")
    return BoardPattern(columns, rows, 1e-3 * side_mm, dictionary, 1e-3 * marker_mm)
