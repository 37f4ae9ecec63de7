"""Forms of the questions about files of other programs."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.formats.exchange.options import ORIGIN, QUESTIONS, ImageSize
from stereocal.formats.pixel_origin import PixelOrigin
from stereocal.projects.project import Project
from stereocal.ui.fields import Fit, Number, one_of, setting

STATED = "as the file says"
Widget = Callable[[str, Any, Fit], dict[str, Any]]
"""Key and callback of a widget, by name, default and check of a stored value."""


def ask(column: DeltaGenerator, name: str, widget: Widget, usual: Any = None) -> Any:
    """One of `QUESTIONS`.

    Args:
        usual: the first answer; None: that the file says it is an answer too.
    """
    asked = QUESTIONS[name]
    if not asked.choices:
        fit = Number(-math.inf)
        told = _sentence(asked.help)
        return column.number_input(asked.title, step=0.5, help=told, **widget(name, usual, fit))
    answers = [*([None] if usual is None else []), *asked.choices]
    return column.selectbox(
        asked.title,
        answers,
        format_func=lambda answer: STATED if answer is None else asked.choices[answer],
        **widget(name, usual, one_of(answers)),
    )


def ask_origin(widget: Widget, usual: PixelOrigin) -> PixelOrigin:
    """The questions about the pixel origin; how the height counts only from the lower left."""
    columns = st.columns(len(ORIGIN))
    corner = ask(columns[0], "corner", widget, usual.corner)
    first_pixel = ask(columns[1], "first_pixel", widget, float(usual.first_pixel))
    lower = corner == "lower-left"
    flip = ask(columns[2], "flip", widget, usual.flip) if lower else PixelOrigin().flip
    return PixelOrigin(corner, first_pixel, flip)


def ask_size(
    project: Project, key: str, of: str, known: ImageSize | None = None, tabs_own: bool = False
) -> ImageSize | None:
    """The size of an image, for files that do not state it; None if a side is empty.

    Args:
        of: whose image, for the title.
    """
    sides: list[int | None] = []
    for k, (column, side) in enumerate(zip(st.columns(2), ("width", "height"), strict=True)):
        start = None if known is None else known[k]
        field = setting(project, f"{key}_{side}", start, Number(1, or_none=True), tabs_own=tabs_own)
        sides.append(
            column.number_input(
                f"Image {side}{of} (px)",
                min_value=1,
                value=None,
                step=1,
                placeholder=STATED,
                **field.widget(),
            )
        )
    width, height = sides
    return None if width is None or height is None else (width, height)


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."
