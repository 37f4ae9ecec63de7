"""Questions about files of other programs, with a preview of their points."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import PurePath
from typing import Any

import pandas as pd
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.fit.timing.to_calibrate import in_step
from stereocal.formats import point_answers
from stereocal.formats.archives.archive import points_taken
from stereocal.formats.archives.gather import Bars, Heights, bars_of
from stereocal.formats.column_roles import counts_own
from stereocal.formats.correspondences_csv import write_table
from stereocal.formats.exchange.options import (
    ORIGIN,
    QUESTIONS,
    Corner,
    ExchangeOptions,
    Frames,
    ImageSize,
    PixelOrigin,
)
from stereocal.formats.point_answers import Answers, layout_as_stated, layout_by_hand, layout_of
from stereocal.formats.point_files import PointLayout, points_of_all
from stereocal.formats.point_layouts import OURS
from stereocal.matching.point_table import OWN_FRAME
from stereocal.projects.application import Asked, ProjectApplication
from stereocal.projects.given import ProjectGiven
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.recording import Recording
from stereocal.system.csv_text import csv_text
from stereocal.system.numbers import count
from stereocal.ui.columns import choose_columns, header_key
from stereocal.ui.fields import Field, Fit, Number, one_of, setting, yes_or_no
from stereocal.ui.in_step import ask_if_in_step
from stereocal.ui.messages import ErrorsShown, button, readable, refusing
from stereocal.ui.texts import escape_markdown, escaped_table

Use = Callable[[], None]
USE_POINTS = "Use these points"
PREVIEW_ROWS, PREVIEW_CELL = 5, 10
STATED = "as the file says"
IN_WORDS = {"u": "x", "v": "y"}
IN_WORDS |= {
    f"{axis}_{camera}": f"{camera} camera, {word}"
    for axis, word in IN_WORDS.items()
    for camera in CAMERAS
}
"""The columns of a preview, where their names are those of files."""


@dataclass(frozen=True)
class Questions:
    """The questions about one file."""

    project: Project
    key: str
    """Key of the widgets, with {} for the name of a question."""
    program: str = ""
    """Each program has answers of its own."""
    tabs_own: bool = False
    short: Mapping[str, str] = field(default_factory=dict)
    """Names in the keys, where they are others."""

    def field(self, name: str, usual: Any, fit: Fit) -> Field:
        """The field of an answer, which starts with the last one."""
        key = self.key.format(self.short.get(name, name))
        named = f"{key} of {self.program}" if self.program else key
        return setting(self.project, key, usual, fit, name=named, tabs_own=self.tabs_own)

    def ask(self, place: DeltaGenerator, name: str, usual: Any = None) -> Any:
        """One of `QUESTIONS`.

        Args:
            usual: the first answer; None: that the file says it is an answer too.
        """
        question = QUESTIONS[name]
        if not question.choices:
            hint = f"{question.help[0].upper()}{question.help[1:]}."
            number = self.field(name, usual, Number(*question.between))
            return number.number_input(question.title, place, step=0.5, help=hint)
        stated = {None: STATED} if usual is None else {}
        words: dict[Any, str] = {**stated, **question.choices}
        return self.field(name, usual, one_of(words)).menu(
            question.title, place, format_func=words.__getitem__, placeholder=STATED
        )

    def origin(self, usual: PixelOrigin) -> PixelOrigin:
        """The pixel origin; how the height counts is asked only from the lower left."""
        corner, first_pixel, flip = st.columns(len(ORIGIN))
        chosen = self.ask(corner, "corner", usual.corner)
        number = self.ask(first_pixel, "first_pixel", float(usual.first_pixel))
        lower = chosen == "lower-left"
        return PixelOrigin(
            chosen, number, self.ask(flip, "flip", usual.flip) if lower else PixelOrigin().flip
        )


def ask_size(
    project: Project, key: str, whose: str, stated: ImageSize | None = None, tabs_own: bool = False
) -> ImageSize | None:
    """The size of an image, for files that do not state it; None if a side is empty.

    Args:
        whose: image it is, for the title.
    """
    width, height = (
        setting(
            project, f"{key}_{side}", start, Number(1, or_none=True), tabs_own=tabs_own
        ).number_input(f"Image {side}{whose} (px)", place, placeholder=STATED)
        for place, side, start in zip(
            st.columns(2), ("width", "height"), stated or (None, None), strict=True
        )
    )
    return None if width is None or height is None else (width, height)


def ask_about(
    store: ProjectApplication, slot: Asked, form: Callable[[str, bytes], Mapping[str, Use]]
) -> None:
    """The questions about a file, if there is one, and buttons to use it or put it aside.

    Args:
        form: of its name and content; returns what uses it, by the button's label; empty if it
            cannot be used yet.
    """
    file = store.asking(slot)
    if file is None:
        return
    uses: Mapping[str, Use] = {}
    with st.container(border=True):
        with ErrorsShown():
            uses = form(*file)
        with st.container(horizontal=True):
            for number, (label, act) in enumerate(uses.items()):
                key = f"use_{slot}{f'_{number}' * bool(number)}"
                button(label, key, refusing()(act), first=not number)
            button("Put the file aside", f"aside_{slot}", store.forget_question, slot)


def ask_about_points(
    store: ProjectApplication, side: Asked, image_height: int | None, camera: str, number: int
) -> None:
    """The questions about one camera's file, if there is one.

    Args:
        camera: in words.
        number: of the camera in a file of several, as a first proposal.
    """

    def form(label: str, content: bytes) -> Mapping[str, Use]:
        layout, questions = _laid_out(store.project, f"wizard_{side}", label, content, camera)
        if layout is None:
            return {}
        proposed = point_answers.first_answers(layout, number, image_height)
        answers = _point_form(questions, layout, camera, proposed)
        if answers.corner == "lower-left" and answers.image_height is None:
            st.info("Give the image height: the points are counted from the lower left.")
            return {}
        _show_preview(store.preview(side, answers, PREVIEW_ROWS).head(PREVIEW_ROWS))
        return {USE_POINTS: partial(store.answer, side, answers)}

    ask_about(store, side, form)


def ask_about_bars(store: ProjectApplication) -> None:
    """The questions about a file with both ends of the bar, if there is one."""

    def form(label: str, content: bytes) -> Mapping[str, Use]:
        project, of_bar = store.project, "points of the bar"
        layout, questions = _laid_out(project, "wizard_bars", label, content, of_bar, True)
        if layout is None:
            return {}
        options, heights = _bar_form(questions, layout)
        if len(layout.cameras) > 2:
            _offer_all(store, label, content, layout, options, heights)
        if options.corner == "lower-left" and None in heights:
            st.info("Give the image heights: the points are counted from the lower left.")
            return {}
        bars = bars_of(content, label, options, heights)
        if bars.counted is None:
            bars.refuse_unseen(label)
        if bars.own is None:
            _show_pairs(bars)
        else:
            st.caption(points_taken(bars.rows, "", bars.own).taken.capitalize() + ".")

        def use(frames: Frames) -> None:
            given, more = bars.rows, dict[str, Any]()
            if frames == "own" and (lenses := _lenses(project)) is not None:
                own = bars_of(content, label, replace(options, frames="own"), heights)
                pair = in_step(_counted(own, lenses, True)).pair(*CAMERAS)
                given, notes = pair.correspondences, [*pair.recording.step_notes]
                more = {"start_frame": pair.start_frame, "step_notes": notes}
            store.project.give({"correspondences": (label, write_table(given))}, **more)
            store.forget_question("bars")

        if bars.counted is None:
            return {USE_POINTS: partial(use, "common")}
        lenses = _lenses(project)
        counted = None if lenses is None else _counted(bars, lenses, False)
        answers = ask_if_in_step(counted, bars.own_frames)
        return {words or USE_POINTS: partial(use, frames) for words, frames in answers.items()}

    ask_about(store, "bars", form)


def _show_pairs(bars: Bars) -> None:
    rows = bars.rows
    head, *lines = (line.split(",") for line in write_table(rows).decode().splitlines())
    short = [[cell[:PREVIEW_CELL] for cell in line] for line in lines[:PREVIEW_ROWS]]
    _show_preview(pd.DataFrame(short, columns=head))
    st.caption(f"{count(len(rows), 'pair')} of points in {count(len(rows.frames), 'frame')}.")


def _lenses(project: Project) -> tuple[Camera, Camera] | None:
    """Both cameras of a project; None while one is missing."""
    primary, secondary = readable(lambda: project.cameras, warn=False) or (None, None)
    return None if primary is None or secondary is None else (primary, secondary)


def _counted(bars: Bars, lenses: tuple[Camera, Camera], own: bool) -> Recording:
    """All points of each camera, whose scale does not matter, by the frames as they are counted."""
    assert bars.counted is not None
    empty = Recording.of_two("", *lenses, None, 1.0)
    return replace(bars.counted.put_into(empty), own_frames=own)


def _offer_all(
    store: ProjectApplication,
    label: str,
    content: bytes,
    layout: PointLayout,
    options: ExchangeOptions,
    heights: Heights,
) -> None:
    """A button to take the points of all cameras, for a rig."""

    def take() -> None:
        as_stated = replace(layout, origin=options.origin(layout.origin))
        points = points_of_all(content, as_stated, heights[0], label)
        if counts_own(layout):
            points = points.rename(columns={"frame": OWN_FRAME})
        packed = csv_text(points).encode()
        ProjectGiven(store.project).more_cameras({f"{PurePath(label).stem}.csv": packed})
        store.forget_question("bars")

    count = len(layout.cameras)
    button(f"Take all {count} cameras", "use_all_cameras", take)


def _laid_out(
    project: Project, key: str, label: str, content: bytes, whose: str, for_bars: bool = False
) -> tuple[PointLayout | None, Questions]:
    """The layout of a file as it is recognised, or with columns that are chosen, and its questions.

    Args:
        whose: points these are, for the title.
    """
    layout = layout_of(content, label)
    if for_bars and layout.program == OURS:  # of one camera, by its header
        layout = layout_by_hand(content, label)
    program = header_key(content, label) if layout.roles is not None else layout.program
    questions = Questions(project, f"{key}_{{}}", program)
    name = f"**{escape_markdown(label)}** ({escape_markdown(whose)})"
    if layout.roles is None:
        st.markdown(f"{name} looks like {layout.program}.")
        for question in layout.questions:
            st.markdown(f"- {escape_markdown(question)}")
        title = "It is another table: I choose its columns"
        if not st.toggle(title, **questions.field("by_hand", False, yes_or_no).widget()):
            return layout, questions
        layout = layout_by_hand(content, label)
        questions = Questions(project, f"{key}_hand_{{}}", header_key(content, label))
    else:
        st.markdown(f"{name}: what do its columns hold?")
    roles = choose_columns(questions.field, content, label, layout.roles or "", for_bars)
    chosen = None if roles is None else layout_as_stated(content, label, roles, for_bars)
    return chosen, questions


def _point_form(questions: Questions, layout: PointLayout, whose: str, usual: Answers) -> Answers:
    """The answers about one camera's points."""
    camera, per_unit, likelihood = usual.camera, 1.0, 0.0
    if len(layout.cameras) > 1:
        camera_field = questions.field("camera", camera, one_of(layout.cameras))
        camera = camera_field.menu(f"{whose[0].upper()}{whose[1:]} is")
    origin = questions.origin(PixelOrigin(usual.corner, usual.first_pixel, usual.flip))
    height = _height(questions, "image_height", "", usual.image_height, origin.corner)
    if layout.program == "TrackMate" or layout.roles is not None:
        field = questions.field("px_per_unit", usual.px_per_unit, Number(1e-9))
        per_unit = field.number_input("Pixels per unit of the file", format="%.6g")
    if any(column.likelihood is not None for column in layout.columns):
        field = questions.field("least_likelihood", usual.least_likelihood, Number(0.0, 1.0))
        likelihood = field.number_input("Least likelihood", step=0.05)
    return Answers(
        camera,
        **vars(origin),
        image_height=height,
        px_per_unit=per_unit,
        least_likelihood=likelihood,
        roles=layout.roles,
    )


def _bar_form(questions: Questions, layout: PointLayout) -> tuple[ExchangeOptions, Heights]:
    chosen = []
    for name, options, titles in (
        ("camera", layout.cameras, ("Primary camera", "Secondary camera")),
        ("end", layout.points, ("Target A", "Target B")),
    ):
        for k, (title, place) in enumerate(zip(titles, st.columns(2), strict=True)):
            field = questions.field(f"{name}_{k}", options[k], one_of(options))
            chosen.append(field.menu(title, place))
    primary, secondary, a, b = chosen
    origin, heights = questions.origin(layout.origin), list[int | None]()
    for k, (which, camera) in enumerate(zip(CAMERAS, questions.project.cameras, strict=True)):
        height = camera.image_size[1] if camera else None
        heights.append(_height(questions, f"height_{k}", f", {which}", height, origin.corner))
    stated = ExchangeOptions(
        # By index: a camera may be called by the number of another.
        cameras=(layout.cameras.index(primary), layout.cameras.index(secondary)),
        ends=(a, b),
        roles=layout.roles,
        **vars(origin),
    )
    return stated, (heights[0], heights[1])


def _height(
    questions: Questions, name: str, whose: str, stated: int | None, corner: Corner
) -> int | None:
    """The image height, asked only if the file counts from the lower left."""
    if corner == "upper-left":
        return stated
    field = questions.field(name, stated, Number(1, or_none=True))
    height: int | None = field.number_input(f"Image height{whose} (px)")
    return height


def _show_preview(table: pd.DataFrame) -> None:
    st.caption(
        "The first rows as they will be read, in pixels counted from the upper left, first pixel 0:"
    )
    st.table(escaped_table(table.rename(columns=IN_WORDS)))
