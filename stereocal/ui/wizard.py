"""Questions about a point file of another program, with a preview of its points."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import pandas as pd
import streamlit as st

from stereocal.errors import StereocalError
from stereocal.formats.archives.gather import Heights, bars_of
from stereocal.formats.correspondences_csv import write_table
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.pixel_origin import Corner, PixelOrigin
from stereocal.formats.point_answers import (
    Answers,
    can_choose_columns,
    column_names,
    first_answers,
    layout_by_hand,
    layout_of,
)
from stereocal.formats.point_files import PointLayout
from stereocal.projects.application import Asked, ProjectApplication
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, CameraName
from stereocal.rig.dataset import Correspondences
from stereocal.ui.fields import Fit, Number, one_of, setting, yes_or_no
from stereocal.ui.foreign import ask_origin
from stereocal.ui.intake import clear_refusal, escape_markdown, refuse
from stereocal.ui.messages import callback
from stereocal.ui.texts import escaped_table

PREVIEW_ROWS = 5
COUNTED = -1
"""Instead of the frame's column; None means not chosen yet."""
COUNTED_TITLE = "none: the rows are counted"


def ask_about_points(store: ProjectApplication, side: CameraName, image_height: int | None) -> None:
    """The questions about one camera's file, if there is one."""
    asked = store.asking(side)
    if asked is None:
        return
    label, content = asked
    use = None
    with st.container(border=True):
        try:
            layout = layout_of(content, label)
            _say_layout(label, layout, f"{side} camera")
            form = _Form(store.project, f"wizard_{side}", layout)
            if not can_choose_columns(layout) and st.toggle(
                "It is another table: I choose its columns",
                **form.field("by_hand", False, yes_or_no),
            ):
                by_hand = layout_by_hand(content, label)
                form = _Form(store.project, f"wizard_{side}_hand", by_hand)
            answers = _point_form(form, side, content, label, image_height)
            if answers.columns is None and not form.layout.columns:
                st.info("Choose the columns: this file does not say which is which.")
            elif answers.corner == "lower-left" and answers.image_height is None:
                st.info("Give the image height: the points are counted from the lower left.")
            else:
                _show_preview(store.preview(side, answers, PREVIEW_ROWS).head(PREVIEW_ROWS))
                use = partial(store.answer, side, answers)
        except StereocalError as error:
            st.error(escape_markdown(str(error)))
        ask_buttons(store, side, use)


def ask_about_bars(store: ProjectApplication) -> None:
    """The questions about a file with both ends of the bar, if there is one."""
    asked = store.asking("bars")
    if asked is None:
        return
    label, content = asked
    use = None
    with st.container(border=True):
        try:
            layout = layout_of(content, label)
            _say_layout(label, layout, "bar")
            form = _Form(store.project, "wizard_bars", layout)
            options, heights = _bar_form(form)
            if options.corner == "lower-left" and None in heights:
                st.info("Give the image heights: the points are counted from the lower left.")
            else:
                use = _bars_shown(store, label, bars_of(content, label, options, heights).rows)
        except StereocalError as error:
            st.error(escape_markdown(str(error)))
        ask_buttons(store, "bars", use)


def _bars_shown(store: ProjectApplication, label: str, rows: Correspondences) -> Callable[[], None]:
    """Show the first rows; returns what uses them."""
    table = write_table(rows)
    preview = [line.split(",") for line in table.decode().splitlines()[: PREVIEW_ROWS + 1]]
    _show_preview(pd.DataFrame(preview[1:], columns=preview[0]))
    st.caption(f"{len(rows)} pairs of points in {len(rows.frames)} frames.")

    def use() -> None:
        store.project.give({"correspondences": (label, table)})
        store.forget_question("bars")

    return use


@dataclass(frozen=True)
class _Form:
    """The fields of the questions about a file; answers are stored per program."""

    project: Project
    key: str
    layout: PointLayout

    def field(self, name: str, usual: Any, fit: Fit) -> dict[str, Any]:
        """Key and callback of a widget, which starts with the last answer."""
        key = f"{self.key}_{name}"
        return setting(
            self.project, key, usual, fit, name=f"{key} of {self.layout.program}"
        ).widget()


def _say_layout(label: str, layout: PointLayout, what: str) -> None:
    st.markdown(f"**{escape_markdown(label)}** ({what}) looks like {layout.program}.")
    for question in layout.questions:
        st.markdown(f"- {escape_markdown(question)}")


def _point_form(
    form: _Form, side: CameraName, content: bytes, label: str, image_height: int | None
) -> Answers:
    layout = form.layout
    first = first_answers(layout, 0 if side == "primary" else 1, image_height)
    camera = first.camera
    if len(layout.cameras) > 1:
        one = form.field("camera", first.camera, one_of(layout.cameras))
        camera = st.selectbox(f"The {side} camera is", layout.cameras, **one)
    columns = _columns(form, content, label, first) if can_choose_columns(layout) else None
    origin = ask_origin(form.field, PixelOrigin(first.corner, first.first_pixel, first.flip))
    height = _height(form, "image_height", "Image height (px)", first.image_height, origin.corner)
    per_unit, likelihood = 1.0, 0.0
    if layout.program == "TrackMate" or can_choose_columns(layout):
        per_unit = st.number_input(
            "Pixels per unit of the file",
            1e-9,
            format="%.6g",
            **form.field("px_per_unit", first.px_per_unit, Number(1e-9)),
        )
    if any(each.likelihood is not None for each in layout.columns):
        likelihood = st.number_input(
            "Least likelihood",
            0.0,
            1.0,
            step=0.05,
            **form.field("least_likelihood", first.least_likelihood, Number(0.0, 1.0)),
        )
    return dataclasses.replace(
        first,
        camera=camera,
        corner=origin.corner,
        flip=origin.flip,
        first_pixel=origin.first_pixel,
        image_height=height,
        px_per_unit=per_unit,
        least_likelihood=likelihood,
        columns=columns,
    )


def _bar_form(form: _Form) -> tuple[ExchangeOptions, Heights]:
    layout, cameras = form.layout, form.project.cameras
    chosen: dict[str, str] = {}
    for title, name, options in (
        ("Primary camera", "camera_0", layout.cameras),
        ("Secondary camera", "camera_1", layout.cameras),
        ("Target A", "end_0", layout.points),
        ("Target B", "end_1", layout.points),
    ):
        one = form.field(name, options[int(name[-1])], one_of(options))
        chosen[name] = st.selectbox(title, options, **one)
    origin = ask_origin(form.field, layout.origin)
    heights = [
        _height(
            form,
            f"height_{k}",
            f"Image height, {which} (px)",
            None if camera is None else camera.image_size[1],
            origin.corner,
        )
        for k, (which, camera) in enumerate(zip(CAMERAS, cameras, strict=True))
    ]
    stated = ExchangeOptions(
        cameras=(chosen["camera_0"], chosen["camera_1"]),
        ends=(chosen["end_0"], chosen["end_1"]),
        corner=origin.corner,
        flip=origin.flip,
        first_pixel=origin.first_pixel,
    )
    return stated, (heights[0], heights[1])


def _columns(
    form: _Form, content: bytes, label: str, first: Answers
) -> tuple[int | None, int, int] | None:
    """The chosen columns; None until all three are chosen."""
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
        chosen.append(
            column.selectbox(
                f"Column of {name}",
                options,
                index=None,
                placeholder="choose",
                format_func=lambda at: COUNTED_TITLE if at == COUNTED else names[at],
                **form.field(name, default, one_of(options)),
            )
        )
    frame, u, v = chosen
    if frame is None or u is None or v is None:
        return None
    return None if frame == COUNTED else frame, u, v


def _height(form: _Form, name: str, title: str, known: int | None, corner: Corner) -> int | None:
    """The image height, asked only if the file counts from the lower left."""
    if corner == "upper-left":
        return known
    field = form.field(name, known, Number(1, or_none=True))
    height: int | None = st.number_input(title, min_value=1, value=None, step=1, **field)
    return height


def _show_preview(table: pd.DataFrame) -> None:
    st.caption("The first rows as they will be read, counted from the upper left, first pixel 0:")
    st.table(escaped_table(table))


def ask_buttons(
    store: ProjectApplication,
    asked: Asked,
    use: Callable[[], None] | None,
    title: str = "Use these points",
) -> None:
    """The buttons that use a file with open questions, or put it aside.

    Args:
        use: None if it cannot be used yet.
    """

    def take() -> None:
        try:
            if use is not None:
                use()
            clear_refusal()
        except StereocalError as error:
            refuse(error)

    with st.container(horizontal=True):
        if use is not None:
            st.button(title, type="primary", key=f"use_{asked}", on_click=take)
        st.button(
            "Put the file aside",
            key=f"aside_{asked}",
            on_click=callback(store.forget_question),
            args=(asked,),
        )
