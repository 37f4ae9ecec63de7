"""Taking in what a person gives: a sample, a zip, a folder, single files, two lengths."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import pandas as pd
import streamlit as st

from stereocal.errors import RefusedRowsError, RowProblem, StereocalError
from stereocal.formats.correspondences_csv import read_table, write_table
from stereocal.formats.dataset_files import (
    TABLE,
    find_description,
    pack_dataset,
    parse_dataset,
    read_dataset,
)
from stereocal.formats.zip_files import unzip
from stereocal.project import Project, Slot
from stereocal.ui.project import SAMPLE, new_project, project_to_write

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
TITLES: Mapping[Slot, str] = {
    "correspondences": "Table of points (CSV)",
    "primary": "Camera file, primary",
    "secondary": "Camera file, secondary",
}
_REFUSED = "refused"


class Upload(Protocol):
    """What Streamlit hands over of an uploaded file."""

    name: str
    file_id: str

    def getvalue(self) -> bytes:
        """The content."""


def load_sample() -> None:
    """Begin a project with the sample data set."""
    _give_dataset(new_project(), pack_dataset(read_dataset(SAMPLE)), "sample data")


def in_use(project: Project | None, slot: Slot) -> None:
    """Say which file holds a slot; the uploader forgets it."""
    label = project.inputs.labels.get(slot) if project else None
    if label:
        st.caption(f"In use: {escape_markdown(label)}")


def take_dataset(uploads: Sequence[Upload]) -> None:
    """A zip, or the files of a folder."""
    if not uploads or not is_new(*uploads):
        return
    files = {upload.name: upload.getvalue() for upload in uploads}
    name = uploads[0].name
    if len(uploads) == 1 and name.lower().endswith(".zip"):
        try:
            _try_dataset(unzip(files[name], name), name)
        except StereocalError as error:
            refuse(error)
    else:
        _try_dataset(files, "the folder")
    st.rerun()


def take_file(slot: Slot, upload: Upload | None) -> None:
    """One of the single files."""
    if upload is None or not is_new(upload):
        return
    _try_files({slot: (upload.name, upload.getvalue())})
    st.rerun()


def take_length(name: str, value_key: str, unit_key: str) -> None:
    """The baseline or the distance, when its field or unit has changed (a callback)."""
    value, unit = st.session_state.get(value_key), st.session_state.get(unit_key, "m")
    metres = None if value is None else float(value) * UNITS[unit]
    try:
        project = project_to_write()
        project.keep_settings({unit_key: unit})
        project.give({}, **{name: metres})
        settled()
    except StereocalError as error:
        refuse(error)


def show_refusal() -> None:
    """What was refused last and why, until something is accepted."""
    refused: _Refusal | None = st.session_state.get(_REFUSED)
    if refused is None:
        return
    st.error(f"{escape_markdown(refused.sentence)}\n\nWhat was loaded before is unchanged.")
    if refused.problems:
        rows = [(problem.line, problem.reason) for problem in refused.problems]
        st.dataframe(
            pd.DataFrame(rows, columns=["Line", "Refused because"]),
            hide_index=True,
            height=min(38 + 35 * len(rows), 250),
        )
    if refused.retry is not None and refused.left:
        label = f"Leave these rows out and use the other {refused.left}"
        st.button(label, on_click=refused.retry, key="use_rest")


@dataclass(frozen=True)
class _Refusal:
    sentence: str
    problems: Sequence[RowProblem]
    left: int
    """How many rows could be used."""
    retry: Callable[[], None] | None


def refuse(
    error: StereocalError,
    rest: tuple[bytes, int] = (b"", 0),
    retry: Callable[[], None] | None = None,
) -> None:
    problems = error.problems if isinstance(error, RefusedRowsError) else ()
    st.session_state[_REFUSED] = _Refusal(str(error), problems, rest[1], retry)


def settled() -> None:
    st.session_state.pop(_REFUSED, None)


def _rows_but(content: bytes, problems: Sequence[RowProblem]) -> tuple[bytes, int]:
    """A table without its refused rows, and how many are left."""
    rows = read_table(content, TABLE).correspondences
    left = rows.without_lines(problem.line for problem in problems)
    return write_table(left), len(left)


def _try_dataset(files: Mapping[str, bytes], source: str) -> None:
    """Take over a data set; if rows of it are refused, offer to go on without them."""
    try:
        _give_dataset(project_to_write(), files, source)
        settled()
    except RefusedRowsError as error:
        folder, _ = find_description(files, source)
        rest = _rows_but(files[folder + TABLE], error.problems)
        refuse(error, rest, lambda: _try_dataset({**files, folder + TABLE: rest[0]}, source))
    except StereocalError as error:
        refuse(error)


def _try_files(files: dict[Slot, tuple[str, bytes]]) -> None:
    """Take over files; if rows of the table are refused, offer to go on without them."""
    try:
        project_to_write().give(files)
        settled()
    except RefusedRowsError as error:
        table = files.get("correspondences") or project_to_write().table
        if table is None:
            refuse(error)
            return
        name, (rest, left) = table[0], _rows_but(table[1], error.problems)
        again: dict[Slot, tuple[str, bytes]] = {**files, "correspondences": (name, rest)}
        refuse(error, (rest, left), lambda: _try_files(again))
    except StereocalError as error:
        refuse(error)


def _give_dataset(project: Project, files: Mapping[str, bytes], source: str) -> None:
    """Put a whole data set into a project, or refuse it."""
    dataset = parse_dataset(files, source)
    folder, description = find_description(files, source)
    cameras: Mapping[str, str] = description["cameras"]
    given: dict[Slot, tuple[str, bytes]] = {
        "primary": (cameras["primary"], files[folder + cameras["primary"]]),
        "secondary": (cameras["secondary"], files[folder + cameras["secondary"]]),
        "correspondences": (TABLE, files[folder + TABLE]),
    }
    project.give(
        given,
        name=dataset.name,
        baseline_m=dataset.baseline_m,
        target_distance_m=dataset.target_distance_m,
    )


def is_new(*uploads: Upload) -> bool:
    """Whether these uploads have not been dealt with yet; a page is drawn many times."""
    seen: set[str] = st.session_state.setdefault("uploads_seen", set())
    new = {upload.file_id for upload in uploads} - seen
    seen |= new
    return bool(new)


def escape_markdown(text: str) -> str:
    """Text of a file, such as its name, that Streamlit must not take for markup."""
    return "".join(f"\\{sign}" if sign in "\\`*_{}[]<>#$~|:" else sign for sign in text)
