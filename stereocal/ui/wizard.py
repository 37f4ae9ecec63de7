"""Questions about files of other programs, with a preview of their points."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import pandas as pd
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.formats import point_answers
from stereocal.formats.archives.gather import Heights, bars_of
from stereocal.formats.correspondences_csv import write_table
from stereocal.formats.exchange.options import (
    ORIGIN,
    QUESTIONS,
    Corner,
    ExchangeOptions,
    ImageSize,
    PixelOrigin,
)
from stereocal.formats.point_answers import Answers, can_choose_columns, layout_of
from stereocal.formats.point_files import PointLayout
from stereocal.projects.application import Asked, ProjectApplication
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, CameraName
from stereocal.ui.fields import Fit, Number, one_of, setting, yes_or_no
from stereocal.ui.messages import ErrorsShown, callback, refusing
from stereocal.ui.texts import escape_markdown, escaped_table

Use = Callable[[], None]
PREVIEW_ROWS = 5
COUNTED = -1
"""Instead of the frame's column; None means not chosen yet."""
COUNTED_TITLE = "none: the rows are counted"
STATED = "as the file says"


@dataclass(frozen=True)
class Questions:
    """The questions about one file."""

    project: Project
    key: str
    """Of the widgets, with {} for the name of a question."""
    program: str = ""
    """Each program has answers of its own."""
    tabs_own: bool = False
    short: Mapping[str, str] = field(default_factory=dict)
    """Names in the keys, where they are others."""

    def widget(self, name: str, usual: Any, fit: Fit) -> dict[str, Any]:
        """Key and callback of a widget, which starts with the last answer."""
        key = self.key.format(self.short.get(name, name))
        named = f"{key} of {self.program}" if self.program else key
        own = setting(self.project, key, usual, fit, name=named, tabs_own=self.tabs_own)
        return own.widget()

    def ask(self, place: DeltaGenerator, name: str, usual: Any = None) -> Any:
        """One of `QUESTIONS`.

        Args:
            usual: the first answer; None: that the file says it is an answer too.
        """
        asked = QUESTIONS[name]
        if not asked.choices:
            told = f"{asked.help[0].upper()}{asked.help[1:]}."
            own = self.widget(name, usual, Number(-math.inf))
            return place.number_input(asked.title, step=0.5, help=told, **own)
        answers = [*([None] if usual is None else []), *asked.choices]
        return place.selectbox(
            asked.title,
            answers,
            format_func=lambda answer: STATED if answer is None else asked.choices[answer],
            **self.widget(name, usual, one_of(answers)),
        )

    def origin(self, usual: PixelOrigin) -> PixelOrigin:
        """The pixel origin; how the height counts is asked only from the lower left."""
        corner, first_pixel, flip = st.columns(len(ORIGIN))
        chosen = self.ask(corner, "corner", usual.corner)
        first = self.ask(first_pixel, "first_pixel", float(usual.first_pixel))
        lower = chosen == "lower-left"
        return PixelOrigin(
            chosen, first, self.ask(flip, "flip", usual.flip) if lower else PixelOrigin().flip
        )


def ask_size(
    project: Project, key: str, of: str, known: ImageSize | None = None, tabs_own: bool = False
) -> ImageSize | None:
    """The size of an image, for files that do not state it; None if a side is empty.

    Args:
        of: whose image, for the title.
    """
    width, height = (
        setting(
            project, f"{key}_{side}", start, Number(1, or_none=True), tabs_own=tabs_own
        ).number_input(f"Image {side}{of} (px)", place, placeholder=STATED)
        for place, side, start in zip(
            st.columns(2), ("width", "height"), known or (None, None), strict=True
        )
    )
    return None if width is None or height is None else (width, height)


def ask_about(
    store: ProjectApplication,
    asked: Asked,
    form: Callable[[str, bytes], Use | None],
    title: str = "Use these points",
) -> None:
    """The questions about a file, if there is one, and buttons to use it or put it aside.

    Args:
        form: of its name and content; returns what uses it, None if it cannot be used yet.
    """
    found = store.asking(asked)
    if found is None:
        return
    use: Use | None = None

    def take() -> None:
        with refusing():
            if use is not None:
                use()

    with st.container(border=True):
        with ErrorsShown():
            use = form(*found)
        with st.container(horizontal=True):
            if use is not None:
                st.button(title, type="primary", key=f"use_{asked}", on_click=take)
            away = callback(partial(store.forget_question, asked))
            st.button("Put the file aside", key=f"aside_{asked}", on_click=away)


def ask_about_points(store: ProjectApplication, side: CameraName, image_height: int | None) -> None:
    """The questions about one camera's file, if there is one."""

    def form(label: str, content: bytes) -> Use | None:
        layout = layout_of(content, label)
        _say_layout(label, layout, f"{side} camera")
        asked = Questions(store.project, f"wizard_{side}_{{}}", layout.program)
        if not can_choose_columns(layout) and st.toggle(
            "It is another table: I choose its columns", **asked.widget("by_hand", False, yes_or_no)
        ):
            layout = point_answers.layout_by_hand(content, label)
            asked = Questions(store.project, f"wizard_{side}_hand_{{}}", layout.program)
        first = point_answers.first_answers(layout, CAMERAS.index(side), image_height)
        by_hand = can_choose_columns(layout)
        names = point_answers.column_names(content, layout, label) if by_hand else []
        answers = _point_form(asked, layout, side, first, names)
        if answers.columns is None and not layout.columns:
            st.info("Choose the columns: this file does not say which is which.")
        elif answers.corner == "lower-left" and answers.image_height is None:
            st.info("Give the image height: the points are counted from the lower left.")
        else:
            _show_preview(store.preview(side, answers, PREVIEW_ROWS).head(PREVIEW_ROWS))
            return partial(store.answer, side, answers)
        return None

    ask_about(store, side, form)


def ask_about_bars(store: ProjectApplication) -> None:
    """The questions about a file with both ends of the bar, if there is one."""

    def form(label: str, content: bytes) -> Use | None:
        layout = layout_of(content, label)
        _say_layout(label, layout, "bar")
        asked = Questions(store.project, "wizard_bars_{}", layout.program)
        options, heights = _bar_form(asked, layout)
        if options.corner == "lower-left" and None in heights:
            st.info("Give the image heights: the points are counted from the lower left.")
            return None
        rows = bars_of(content, label, options, heights).rows
        table = write_table(rows)
        head, *lines = (line.split(",") for line in table.decode().splitlines())
        _show_preview(pd.DataFrame(lines[:PREVIEW_ROWS], columns=head))
        st.caption(f"{len(rows)} pairs of points in {len(rows.frames)} frames.")

        def use() -> None:
            store.project.give({"correspondences": (label, table)})
            store.forget_question("bars")

        return use

    ask_about(store, "bars", form)


def _say_layout(label: str, layout: PointLayout, what: str) -> None:
    st.markdown(f"**{escape_markdown(label)}** ({what}) looks like {layout.program}.")
    for question in layout.questions:
        st.markdown(f"- {escape_markdown(question)}")


def _point_form(
    asked: Questions, layout: PointLayout, side: CameraName, first: Answers, names: list[str]
) -> Answers:
    """The answers about one camera's points; `names` are those of the columns to choose from."""
    answers = first
    if len(layout.cameras) > 1:
        one = asked.widget("camera", first.camera, one_of(layout.cameras))
        camera = st.selectbox(f"The {side} camera is", layout.cameras, **one)
        answers = dataclasses.replace(answers, camera=camera)
    columns = _columns(asked, names, first) if names else None
    origin = asked.origin(PixelOrigin(first.corner, first.first_pixel, first.flip))
    height = _height(asked, "image_height", "Image height (px)", first.image_height, origin.corner)
    per_unit, likelihood = 1.0, 0.0
    if layout.program == "TrackMate" or names:
        own = asked.widget("px_per_unit", first.px_per_unit, Number(1e-9))
        per_unit = st.number_input("Pixels per unit of the file", 1e-9, format="%.6g", **own)
    if any(each.likelihood is not None for each in layout.columns):
        own = asked.widget("least_likelihood", first.least_likelihood, Number(0.0, 1.0))
        likelihood = st.number_input("Least likelihood", 0.0, 1.0, step=0.05, **own)
    return dataclasses.replace(
        answers,
        **vars(origin),
        image_height=height,
        px_per_unit=per_unit,
        least_likelihood=likelihood,
        columns=columns,
    )


def _bar_form(asked: Questions, layout: PointLayout) -> tuple[ExchangeOptions, Heights]:
    chosen = []
    for title, name, options in (
        ("Primary camera", "camera_0", layout.cameras),
        ("Secondary camera", "camera_1", layout.cameras),
        ("Target A", "end_0", layout.points),
        ("Target B", "end_1", layout.points),
    ):
        one = asked.widget(name, options[int(name[-1])], one_of(options))
        chosen.append(st.selectbox(title, options, **one))
    primary, secondary, a, b = chosen
    origin = asked.origin(layout.origin)
    first, second = (
        _height(
            asked,
            f"height_{k}",
            f"Image height, {which} (px)",
            None if camera is None else camera.image_size[1],
            origin.corner,
        )
        for k, (which, camera) in enumerate(zip(CAMERAS, asked.project.cameras, strict=True))
    )
    stated = ExchangeOptions(cameras=(primary, secondary), ends=(a, b), **vars(origin))
    return stated, (first, second)


def _columns(
    asked: Questions, names: list[str], first: Answers
) -> tuple[int | None, int, int] | None:
    """The chosen columns; None until all three are chosen."""
    start: tuple[int | None, ...] = (None, None, None)
    if first.columns is not None:
        start = tuple(COUNTED if at is None else at for at in first.columns)
    chosen: list[int | None] = []
    for place, name, default in zip(st.columns(3), ("frame", "u", "v"), start, strict=True):
        options = [*([COUNTED] if name == "frame" else []), *range(len(names))]
        at = place.selectbox(
            f"Column of {name}",
            options,
            index=None,
            placeholder="choose",
            format_func=lambda at: COUNTED_TITLE if at == COUNTED else names[at],
            **asked.widget(name, default, one_of(options)),
        )
        chosen.append(at)
    frame, u, v = chosen
    if frame is None or u is None or v is None:
        return None
    return None if frame == COUNTED else frame, u, v


def _height(
    asked: Questions, name: str, title: str, known: int | None, corner: Corner
) -> int | None:
    """The image height, asked only if the file counts from the lower left."""
    if corner == "upper-left":
        return known
    own = asked.widget(name, known, Number(1, or_none=True))
    height: int | None = st.number_input(title, min_value=1, value=None, step=1, **own)
    return height


def _show_preview(table: pd.DataFrame) -> None:
    st.caption("The first rows as they will be read, counted from the upper left, first pixel 0:")
    st.table(escaped_table(table))
