"""Questions about a point file of another program, with a preview of how it will be read."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import pandas as pd
import streamlit as st

from stereocal.errors import StereocalError
from stereocal.formats.correspondences_csv import write_table
from stereocal.formats.pixel_origin import CORNERS, FLIPS, Corner, Flip
from stereocal.formats.point_answers import (
    Answers,
    BarAnswers,
    bars_of,
    can_choose_columns,
    column_names,
    first_answers,
    layout_by_hand,
    layout_of,
)
from stereocal.formats.point_files import PointLayout
from stereocal.project import Project
from stereocal.store.application import Asked, ProjectApplication, Side
from stereocal.ui.intake import escape_markdown, refuse, settled
from stereocal.ui.parameter_files import CORNER_TITLES
from stereocal.ui.project import noted
from stereocal.ui.told import callback

PREVIEW_ROWS = 5
COUNTED = -1
"""In place of the frame's column; None is what nobody has chosen yet."""
COUNTED_TITLE = "none: the rows are counted"
FLIP_TITLES = {"h": "h − v (most programs)", "h-1": "h − 1 − v", "h+1": "h + 1 − v"}


def ask_about_points(store: ProjectApplication, side: Side, image_height: int | None) -> None:
    """The questions about one camera's file, if one waits for answers."""
    asked = store.asking(side)
    if asked is None:
        return
    label, content = asked
    with st.container(border=True):
        try:
            layout = layout_of(content, label)
            _say_layout(label, layout, f"{side} camera")
            form = proposed = _Form(store.project, f"wizard_{side}", layout)
            if not can_choose_columns(layout) and st.toggle(
                "It is another table: I choose its columns", key=form.begin("by_hand", False)
            ):
                by_hand = layout_by_hand(content, label)
                form = _Form(store.project, f"wizard_{side}_hand", by_hand)
                proposed.keep({"by_hand": True})
            answers = _point_form(form, side, content, label, image_height)
            form.keep(answers.to_json())
            if answers.columns is None and not form.layout.columns:
                st.info("Choose the columns: this file does not say which is which.")
                _aside(store, side)
                return
            if answers.corner == "lower-left" and answers.image_height is None:
                st.info("Give the image height: the points are counted from the lower left.")
                _aside(store, side)
                return
            preview = store.preview(side, answers, PREVIEW_ROWS)
            _show_preview(preview.head(PREVIEW_ROWS))
        except StereocalError as error:
            st.error(escape_markdown(str(error)))
            _aside(store, side)
            return
        _buttons(store, side, lambda: store.answer(side, answers))


def ask_about_bars(store: ProjectApplication) -> None:
    """The questions about a file with both ends of the bar, if one waits for answers."""
    asked = store.asking("bars")
    if asked is None:
        return
    label, content = asked
    with st.container(border=True):
        try:
            layout = layout_of(content, label)
            _say_layout(label, layout, "bar")
            form = _Form(store.project, "wizard_bars", layout)
            answers = _bar_form(form)
            form.keep(answers.to_json())
            if answers.corner == "lower-left" and None in answers.image_heights:
                st.info("Give the image heights: the points are counted from the lower left.")
                _aside(store, "bars")
                return
            rows = bars_of(content, answers, label)
        except StereocalError as error:
            st.error(escape_markdown(str(error)))
            _aside(store, "bars")
            return
        table = write_table(rows)
        preview = [line.split(",") for line in table.decode().splitlines()[: PREVIEW_ROWS + 1]]
        _show_preview(pd.DataFrame(preview[1:], columns=preview[0]))
        st.caption(f"{len(rows)} pairs of points in {len(rows.frames)} frames.")

        def use() -> None:
            with noted(store.project):
                store.project.give({"correspondences": (label, table)})
            store.forget_question("bars")

        _buttons(store, "bars", use)


class _Form:
    """Widgets whose values begin as they were answered last time, for the same program."""

    def __init__(self, project: Project, key: str, layout: PointLayout) -> None:
        self.project, self.key, self.layout = project, key, layout
        self.kept: dict[str, Any] = project.settings.get(key, {})
        if self.kept.get("program") != self.layout.program:
            self.kept = {}

    def begin(self, name: str, default: Any, allowed: Any = None) -> str:
        """Give a widget its first value; its key."""
        key = f"{self.key}_{name}"
        of_program = f"{self.key}_program"
        if st.session_state.get(of_program) != self.layout.program:
            for other in [each for each in st.session_state if str(each).startswith(self.key)]:
                del st.session_state[other]
            st.session_state[of_program] = self.layout.program
        value = self.kept.get(name, default)
        if key not in st.session_state:
            st.session_state[key] = default if allowed and value not in allowed else value
        elif allowed and st.session_state[key] not in allowed:
            st.session_state[key] = default
        return key

    def keep(self, answers: dict[str, Any]) -> None:
        """Keep the answers for the next file, and for after a refresh."""
        flat = {"program": self.layout.program, **answers}
        if answers.get("columns"):
            frame, u, v = answers["columns"]
            answers = {**answers, "columns": (COUNTED if frame is None else frame, u, v)}
        for name, parts in (
            ("columns", ("frame", "u", "v")),
            ("cameras", ("camera_0", "camera_1")),
            ("ends", ("end_0", "end_1")),
            ("image_heights", ("height_0", "height_1")),
        ):
            flat |= dict(zip(parts, answers.get(name) or (), strict=False))
        if flat != self.kept:
            self.project.keep_settings({self.key: flat})


def _say_layout(label: str, layout: PointLayout, what: str) -> None:
    st.markdown(f"**{escape_markdown(label)}** ({what}) looks like {layout.program}.")
    for question in layout.questions:
        st.markdown(f"- {escape_markdown(question)}")


def _point_form(
    form: _Form, side: Side, content: bytes, label: str, image_height: int | None
) -> Answers:
    layout = form.layout
    first = first_answers(layout, 0 if side == "primary" else 1, image_height)
    camera = first.camera
    if len(layout.cameras) > 1:
        key = form.begin("camera", first.camera, layout.cameras)
        camera = st.selectbox(f"The {side} camera is", layout.cameras, key=key)
    columns = _columns(form, content, label, first) if can_choose_columns(layout) else None
    corner, flip, first_pixel = _origin(form, first.corner)
    height = _height(form, "image_height", "Image height (px)", first.image_height, corner)
    per_unit, likelihood = 1.0, 0.0
    if layout.program == "TrackMate" or can_choose_columns(layout):
        key = form.begin("px_per_unit", first.px_per_unit)
        per_unit = st.number_input("Pixels per unit of the file", 1e-9, key=key, format="%.6g")
    if any(each.likelihood is not None for each in layout.columns):
        key = form.begin("least_likelihood", first.least_likelihood)
        likelihood = st.number_input("Least likelihood", 0.0, 1.0, step=0.05, key=key)
    return dataclasses.replace(
        first, camera=camera, corner=corner, flip=flip, first_pixel=first_pixel,
        image_height=height, px_per_unit=per_unit, least_likelihood=likelihood, columns=columns,
    )  # fmt: skip


def _bar_form(form: _Form) -> BarAnswers:
    layout, cameras = form.layout, form.project.cameras
    chosen: dict[str, str] = {}
    for title, name, options in (
        ("Primary camera", "camera_0", layout.cameras),
        ("Secondary camera", "camera_1", layout.cameras),
        ("Target A", "end_0", layout.points),
        ("Target B", "end_1", layout.points),
    ):
        key = form.begin(name, options[int(name[-1])], options)
        chosen[name] = st.selectbox(title, options, key=key)
    corner, flip, first_pixel = _origin(form, layout.origin.corner, layout.origin.first_pixel)
    heights = [
        _height(form, f"height_{k}", f"Image height, {which} (px)",
                None if camera is None else camera.image_size[1], corner)
        for k, (which, camera) in enumerate(zip(("primary", "secondary"), cameras, strict=True))
    ]  # fmt: skip
    return BarAnswers(
        (chosen["camera_0"], chosen["camera_1"]), (chosen["end_0"], chosen["end_1"]),
        corner, flip, first_pixel, (heights[0], heights[1]),
    )  # fmt: skip


def _columns(
    form: _Form, content: bytes, label: str, first: Answers
) -> tuple[int | None, int, int] | None:
    """The columns as chosen; None until all three are."""
    names = column_names(content, form.layout, label)
    start: tuple[int | None, ...] = (None, None, None)
    if first.columns is not None:
        start = tuple(COUNTED if at is None else at for at in first.columns)
    numbers = range(len(names))
    chosen: list[int | None] = []
    for column, (name, default) in zip(
        st.columns(3), zip(("frame", "u", "v"), start, strict=True), strict=True
    ):
        options = [COUNTED, *numbers] if name == "frame" else list(numbers)
        key = form.begin(name, default, options)
        chosen.append(
            column.selectbox(
                f"Column of {name}", options, index=None, key=key, placeholder="choose",
                format_func=lambda at: COUNTED_TITLE if at == COUNTED else names[at],
            )
        )  # fmt: skip
    frame, u, v = chosen
    if frame is None or u is None or v is None:
        return None
    return None if frame == COUNTED else frame, u, v


def _origin(
    form: _Form, corner: Corner, first_pixel: float | None = None
) -> tuple[Corner, Flip, float]:
    left, middle, right = st.columns(3)
    start = form.layout.origin.first_pixel if first_pixel is None else first_pixel
    chosen = left.selectbox(
        "Points are counted from the", CORNERS, format_func=CORNER_TITLES.__getitem__,
        key=form.begin("corner", corner, CORNERS),
    )  # fmt: skip
    pixel = middle.number_input(
        "The first pixel's centre is at", step=0.5, key=form.begin("first_pixel", start),
        help="0 here and in OpenCV, 1 in MATLAB and DLTdv, 0.5 in COLMAP.",
    )  # fmt: skip
    flip: Flip = "h"
    if chosen == "lower-left":
        flip = right.selectbox(
            "Height h counts as", FLIPS, format_func=FLIP_TITLES.__getitem__,
            key=form.begin("flip", form.layout.origin.flip, FLIPS),
        )  # fmt: skip
    return chosen, flip, pixel


def _height(form: _Form, name: str, title: str, known: int | None, corner: Corner) -> int | None:
    """The image height, which only a file that counts from the lower left needs."""
    if corner == "upper-left":
        return known
    key = form.begin(name, known)
    return st.number_input(title, min_value=1, value=None, step=1, key=key)


def _show_preview(table: pd.DataFrame) -> None:
    st.caption("The first rows as they will be read, counted from the upper left, first pixel 0:")
    st.table(table)


def _buttons(store: ProjectApplication, asked: Asked, use: Callable[[], None]) -> None:
    def take() -> None:
        try:
            use()
            settled()
        except StereocalError as error:
            refuse(error)

    left, right = st.columns(2)
    left.button("Use these points", type="primary", key=f"use_{asked}", on_click=take)
    with right:
        _aside(store, asked)


def _aside(store: ProjectApplication, asked: Asked) -> None:
    st.button(
        "Put the file aside",
        key=f"aside_{asked}",
        on_click=callback(store.forget_question),
        args=(asked,),
    )
