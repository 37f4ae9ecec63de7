"""What the first photographs show to be held, proposed with its picture until the user answers."""

import hashlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import streamlit as st

from stereocal.detection.target import Balls, Tags
from stereocal.errors import StereocalError
from stereocal.frames.frame import Centre, CentrePair
from stereocal.frames.pairing import Pair
from stereocal.intrinsics.held_object import HeldObject, held_object, spread
from stereocal.intrinsics.proposed_board import ProposedBoard
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import thumbnail
from stereocal.rig.compiled import FloatArray
from stereocal.ui.fields import Field
from stereocal.ui.messages import button, readable
from stereocal.ui.texts import escape_markdown

HELD, PROPOSAL = "held", "held_proposal"
"""Settings: what the user said, and what is proposed until then."""
CHESSBOARD, CHARUCO = "Chessboard", "ChArUco"
MARKER_PART = "board_marker_part"
UNDECIDED = "What you hold is not clear from the first photographs: choose it."


def proposed_kind(project: Project | None, usual: str) -> str:
    """The kind that is proposed."""
    said = None if project is None else project.settings.get(PROPOSAL)
    return str(said.get("kind", usual)) if isinstance(said, dict) else usual


def show_proposal(store: ProjectPhotographs, pairs: Sequence[Pair], kind: Field) -> None:
    """The proposal with its picture, until the user has said what is held.

    It is made when both cameras' photographs are there, and again when they change.

    Args:
        kind: the field of what is held, whose value is the proposed one until then.
    """
    project = store.project
    # Targets that were found before anything was proposed say what is held.
    is_found = PROPOSAL not in project.settings and bool(store.frames or store.boards_found)
    if HELD in project.settings or len(pairs) < 2 or is_found:
        return
    _look(store, pairs)
    said = project.settings[PROPOSAL]
    if "kind" not in said:
        st.info(UNDECIDED)
        return
    with st.container(border=True):
        left, right = st.columns([2, 3], vertical_alignment="center")
        left.markdown(escape_markdown(said["sentence"]))
        left.caption("Yes, or choose below what you hold.")
        button("Yes, that is it", "held_yes", kind.set, said["kind"], place=left)
        picture = readable(lambda: _picture(store, said))
        if picture is not None:
            alt = "Both photographs of a frame, with what was found in them"
            right.image(picture, width="stretch", alt=alt)


def ask_whether_bar(kind: Field) -> None:
    """The question after a search that found the board in few photographs."""
    with st.container(border=True):
        st.markdown("The board is in few of the photographs. Do you hold a bar with two targets?")
        button("Yes, a bar", "held_bar", kind.set, "bar2x2")


def _look(store: ProjectPhotographs, pairs: Sequence[Pair]) -> None:
    """Make the proposal, unless it was made from these photographs."""
    project, files, first = store.project, store.photographs, spread(pairs)
    names = [[getattr(pair, which) for pair in first] for which in ("primary", "secondary")]
    there = [[files[name] for name in own if name in files] for own in names]
    of = hashlib.sha256(repr([[file.name for file in own] for own in there]).encode()).hexdigest()
    said = project.settings.get(PROPOSAL)
    if isinstance(said, dict) and said.get("of") == of:
        return
    with st.spinner("Looking at the first photographs ..."):
        cameras = [{name: files[name] for name in own if name in files} for own in names]
        held = held_object(cameras)
    settings: dict[str, Any] = {PROPOSAL: {"of": of}}
    if held is not None:
        settings = {PROPOSAL: {"of": of, **_told(held, first)}, **_values(held)}
    project.keep_settings(settings)
    st.rerun()  # what stands above depends on it


def _told(held: HeldObject, pairs: Sequence[Pair]) -> dict[str, Any]:
    """The proposal as it is stored: its kind, its sentence, and a frame to draw it in."""
    first, second = held.seen
    seen = [(p.primary in first) + (p.secondary in second) for p in pairs]
    best = pairs[int(np.argmax(seen))]
    names = best.primary, best.secondary
    marks = [own[n].tolist() if n in own else [] for own, n in zip(held.seen, names, strict=True)]
    said = {"kind": held.kind, "sentence": held.sentence}
    return {**said, "frame": best.frame, "names": names, "marks": marks}


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


def _picture(store: ProjectPhotographs, said: dict[str, Any]) -> bytes:
    try:
        first, second = map(str, said["names"])
        points = [np.reshape(own, (-1, 2)).astype(np.float64) for own in said["marks"]]
    except (KeyError, TypeError, ValueError) as error:
        raise StereocalError("The proposal is damaged: give the photographs again.") from error
    of_bar = all(len(own) in (0, 2) for own in points)
    return thumbnail(store, (first, second), [_targets(own) if of_bar else own for own in points])


def _targets(points: FloatArray) -> CentrePair:
    if not len(points):
        return None, None
    a, b = points.tolist()
    return Centre(*a), Centre(*b)
