"""Downloads to print: the board, the targets or tags of the bar, and the field sheet."""

from collections.abc import Callable
from functools import partial
from typing import Any

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.detection.target import Tags, parse_target
from stereocal.errors import StereocalError
from stereocal.field.planning.bars import bar_places
from stereocal.field.planning.plan import Plan
from stereocal.field.printing.paper import PAPERS, Sheet, paper_named
from stereocal.field.printing.print_target import (
    DETECTED_PX,
    GOOD_PX,
    describe_target,
    planned_target,
)
from stereocal.field.printing.prints import fitted, print_board, print_tags, print_targets
from stereocal.field.printing.sheet import field_sheet
from stereocal.projects.project import Project
from stereocal.rig.rigid_object import BoardPattern
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Number, choose, setting
from stereocal.ui.holding import BOARD, KINDS, TAGS_TITLE, corner_fields, held_kind, held_tags
from stereocal.ui.messages import ErrorsShown
from stereocal.ui.texts import escape_markdown

AT_TRUE_SCALE = 'Print at 100 % ("actual size"): the sheet has a scale of 100 mm to check it by.'
SIDE_MM = Number(5.0, 1000.0)
LENGTH: dict[str, Any] = {"step": 5.0, "format": "%.10g"}


def board_to_print(project: Project | None) -> None:
    """A fold with a chessboard as large as the paper allows."""
    with st.expander("Print a chessboard"):
        _board(project)


def print_what_is_held(project: Project | None, focal_px: float | None) -> None:
    """A fold with the targets of the bar, a board, or tags.

    Args:
        focal_px: the smaller focal length of the two cameras; None if it is not known.
    """
    with st.expander("Print"):
        kinds = [kind for kind in KINDS if kind != "balls"]
        held = held_kind(project)
        usual = held if held in kinds else kinds[0]
        kind = choose(project, "print_what", "What", kinds, usual, format_func=KINDS.__getitem__)
        if kind == BOARD:
            _board(project)
        elif kind == "tags":
            _tags(project)
        else:
            _bar(project, focal_px)


def _board(project: Project | None) -> None:
    paper, *places = st.columns(3)
    named = _paper(project, paper, "board")
    columns, rows = corner_fields(project, places, "print")
    with ErrorsShown(st.info):
        board = fitted(BoardPattern(columns, rows, 0.01), paper_named(named))
        words = (
            f"Squares of **{1e3 * board.square_m:.0f} mm**, the largest on {named}. The board "
            "should fill half of the image or more at the distance of your recordings: take larger "
            "paper where it does not."
        )
        _sheet(lambda: print_board(board, paper_named(named)), "board", words)


def _bar(project: Project | None, focal_px: float | None) -> None:
    left, right = st.columns(2)
    named = _paper(project, left, "targets")
    field = setting(project, "print_side_mm", 180.0, SIDE_MM)
    side_mm = field.number_input("Side of a target (mm)", right, **LENGTH)
    words = describe_target(1e-3 * side_mm, focal_px) if focal_px else ""
    _sheet(lambda: print_targets(1e-3 * side_mm, paper_named(named)), "target", words)


def _tags(project: Project | None) -> None:
    paper, side, tags = st.columns(3)
    named = _paper(project, paper, "tags")
    field = setting(project, "print_tag_mm", 80.0, SIDE_MM)
    side_mm = field.number_input("Side of a black square (mm)", side, **LENGTH)
    text = tags.text_input(TAGS_TITLE, **held_tags(project, "print_tags").widget())

    def sheet() -> Sheet:
        target = parse_target(f"tags:{text}")
        assert isinstance(target, Tags)
        return print_tags(target, 1e-3 * side_mm, paper_named(named))

    _sheet(sheet, "tags")


def planned_targets_to_print(project: Project | None, plan: Plan) -> None:
    """A fold with the two targets, of the size that the plan needs."""
    with st.expander("Print the targets"):
        left, right = st.columns(2)
        named = _paper(project, left, "targets")
        title = "Width in the image at the far end (px)"
        hint = "50 px are located well, also tilted; 20 px are the least."
        field = setting(project, "print_px", GOOD_PX, Number(*DETECTED_PX))
        least_px = field.number_input(title, right, **LENGTH, help=hint)
        size = planned_target(plan, least_px)
        _sheet(lambda: print_targets(size.side_m, paper_named(named)), "target", size.sentence)


def _sheet(make: Callable[[], Sheet], what: str, words: str = "") -> None:
    """Buttons for the sheet in each format, or why it cannot be printed."""
    try:
        sheet = make()
    except StereocalError as error:
        st.info(escape_markdown(f"{words} {error}".strip()))
        return
    st.markdown(f"{words} {AT_TRUE_SCALE}")
    with st.container(horizontal=True):
        for suffix, content in (("pdf", sheet.pdf), ("svg", sheet.svg)):
            name = f"{what}.{suffix}"
            offer(name, content, name, f"download_{what}_{suffix}")


def field_sheet_to_print(plan: Plan) -> None:
    """The button for the plan on one page."""
    try:
        bar_places(plan)
    except StereocalError as error:
        st.caption(f"No field sheet: {error}")
        return
    make, name = partial(field_sheet, plan), "field_sheet.pdf"
    offer("Field sheet (PDF)", make, name, "download_field_sheet")


def _paper(project: Project | None, place: DeltaGenerator, what: str) -> str:
    key = f"print_paper_{what}"
    named: str = choose(project, key, "Paper", PAPERS, place=place, tabs_own=False, as_menu=True)
    return named
