"""The chooser of columns: the first rows of a table, what each column is read as, and menus."""

import hashlib
from collections.abc import Callable, Sequence

import pandas as pd
import streamlit as st

from stereocal.formats.column_roles import (
    UNUSED,
    Role,
    Roles,
    column_titles,
    header_row,
    parse_roles,
    problem_of,
    roles_text,
)
from stereocal.formats.point_answers import header_of
from stereocal.formats.point_layouts import first_rows
from stereocal.ui.fields import Field, Fit, one_of, yes_or_no
from stereocal.ui.texts import escape_markdown

SHOWN_ROWS, IN_A_ROW, CELL = 4, 4, 12
WORDS = {
    "-": "not used",
    "frame": "frame or photograph",
    "camera": "name of the camera",
    "target": "name of the target",
    "x": "x in pixels",
    "y": "y in pixels",
}
Ask = Callable[[str, object, Fit], Field]
"""The field of an answer, by its name, its first value, and what fits it."""


def header_key(content: bytes, source: str) -> str:
    """A short name of the header of a table."""
    return hashlib.sha256(header_of(content, source).encode()).hexdigest()[:16]


def in_words(role: Role) -> str:
    """What a column holds, for a person."""
    named = f" of {role.target}" if role.target else ""
    named += f", camera {role.camera}" if role.camera else ""
    return role.kind + named if named else WORDS[role.kind]


def choose_columns(
    ask: Ask, content: bytes, source: str, proposed: str, for_bars: bool
) -> str | None:
    """Draw the chooser; returns the roles of the columns, None if they do not give points.

    Args:
        proposed: the roles that the header names.
        for_bars: two targets in two cameras are wanted.
    """
    rows, _ = first_rows(content, source)
    titles = column_titles(rows)
    roles = (parse_roles(proposed, source) + len(titles) * (UNUSED,))[: len(titles)]
    place = st.container()
    unclear = problem_of(roles, for_bars)
    by_hand = ask("choose", bool(unclear), yes_or_no)
    st.toggle("Choose what each column holds", **by_hand.widget())
    if by_hand.value():
        roles = _menus(ask, titles, roles)
    with place:
        _show(rows, titles, roles)
    if problem := problem_of(roles, for_bars):
        st.info(problem)
        return None
    return roles_text(roles)


def _menus(ask: Ask, titles: Sequence[str], proposed: Roles) -> Roles:
    """One menu for each column."""
    cameras = dict.fromkeys(role.camera for role in proposed if role.camera)
    targets = dict.fromkeys(role.target for role in proposed if role.target)
    options = [Role(kind) for kind in ("-", "frame", "camera", "target", "x", "y")]
    options += [
        Role(axis, camera, target)
        for camera in ("", *(cameras or ("1", "2")))
        for target in ("", *(targets or ("A", "B")))
        for axis in ("x", "y")
        if camera or target
    ]
    words = {str(role): in_words(role) for role in dict.fromkeys([*options, *proposed])}
    chosen = []
    for start in range(0, len(titles), IN_A_ROW):
        for k, column in enumerate(st.columns(IN_A_ROW), start):
            if k < len(titles):
                role_field = ask(f"role_{k}", str(proposed[k]), one_of(words))
                title = escape_markdown(titles[k])
                chosen.append(role_field.menu(title, column, format_func=words.__getitem__))
    return parse_roles(",".join(chosen), "")


def _show(rows: Sequence[Sequence[str]], titles: Sequence[str], roles: Roles) -> None:
    """The first rows, under what each column is read as."""
    above = header_row(rows)
    named = list(rows[above][: len(titles)]) == [*rows[above]] and titles[0] != "column 1"
    body = [
        [cell.strip()[:CELL] for cell in (*row, *(len(titles) - len(row)) * ("",))][: len(titles)]
        for row in rows[above + named : above + named + SHOWN_ROWS]
    ]
    table = pd.DataFrame([[in_words(role) for role in roles], *body])
    table.columns = pd.Index([f"{k}: {title}" for k, title in enumerate(titles, 1)])
    table.index = pd.Index(["Read as", *(f"row {k}" for k in range(1, len(body) + 1))])
    st.dataframe(table)
