"""Uploads: data sets as zips or folders, single files, photographs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager

import streamlit as st

from stereocal.errors import RefusedRowsError, RowProblem, StereocalError
from stereocal.formats.camera_file import read_camera, write_camera
from stereocal.formats.correspondences_csv import Table, read_table, write_table
from stereocal.formats.dataset_files import TABLE, Survey, pack_pair, parse_dataset, parse_survey
from stereocal.formats.description import find_description
from stereocal.formats.exchange.exchange import format_of, read_camera_pair
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.lens_model import FourCoefficientsError
from stereocal.formats.sleap_h5 import point_text
from stereocal.projects.files import StoredFile
from stereocal.projects.inputs import Slot
from stereocal.projects.lens import ProjectLens
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.recording import ProjectRecording
from stereocal.rig.camera import CAMERAS, Camera, LensModel
from stereocal.rig.dataset import Dataset
from stereocal.system.limits import Limits
from stereocal.system.photograph_files import is_photograph, of_the_bar, zipped_photographs
from stereocal.system.zip_files import unzip
from stereocal.ui import jobs
from stereocal.ui.fields import Field, one_of, setting
from stereocal.ui.project import current_project, project_to_write
from stereocal.ui.refusal import ask_lens
from stereocal.ui.refusal import clear_refusal as clear_refusal
from stereocal.ui.refusal import refuse as refuse
from stereocal.ui.refusal import show_refusal as show_refusal
from stereocal.ui.texts import escape_markdown as escape_markdown
from stereocal.ui.uploads import Upload as Upload
from stereocal.ui.uploads import free_memory

TITLES: Mapping[Slot, str] = {
    "correspondences": "Table of points (CSV)",
    "primary": "Camera file, primary",
    "secondary": "Camera file, secondary",
}
PHOTOGRAPHS = "Photographs"
SINGLE_FILES, SEVERAL = "Single files", "Three cameras and more"
GIVEN_AS = (PHOTOGRAPHS, SINGLE_FILES, "A zip", "A folder", SEVERAL)
CAMERA_KINDS = ["json", "yaml", "yml", "xml", "toml", "m", "mat", "ini", "conf"]
"""Suffixes of camera files; the last two are rejected with advice."""
_SEEN = "uploads_seen"
Contents = Iterable[tuple[str, bytes]]
"""Photographs, name and content, read one at a time."""


def given_as(project: Project | None, usual: str) -> Field:
    """How the data are uploaded on the Data page."""
    return setting(project, "data_how", usual, one_of(GIVEN_AS), tabs_own=True)


def in_use(project: Project | None, slot: Slot) -> None:
    """Show the file in use, which the uploader does not."""
    label = project.inputs.labels.get(slot) if project else None
    if label:
        st.caption(f"In use: {escape_markdown(label)}")


def check_uploads(uploads: Sequence[Upload]) -> None:
    """Check number and sizes of uploads before any is read.

    Raises:
        StereocalError: a limit is exceeded; names the setting that changes it.
    """
    limits = Limits.from_environment()
    limits.check_count(len(uploads), "The upload")
    limits.check_together(sum(upload.size for upload in uploads), "The upload")
    for upload in uploads:
        # Zips are checked by their list of contents.
        if not upload.name.lower().endswith(".zip"):
            limits.check_size(upload.size, upload.name)


def take_dataset(uploads: Sequence[Upload]) -> None:
    """Store a data set: a zip, or the files of a folder."""
    if not uploads or not is_new(*uploads):
        return
    name = uploads[0].name
    with taking(*uploads):
        check_uploads(uploads)
        if len(uploads) == 1 and name.lower().endswith(".zip"):
            content = uploads[0].getvalue()
            texts = unzip(content, name, lambda member: not is_photograph(member))
            _try_dataset(texts, name, lambda: zipped_photographs(content, name))
        else:
            others = [file for file in uploads if not is_photograph(file.name)]
            texts = {file.name: file.getvalue() for file in others}
            _try_dataset(texts, "the folder", lambda: uploaded(uploads))
    project = current_project()
    if project is not None and ProjectRecording(project).is_given:
        st.switch_page("pages/rig.py")
    st.rerun()


def uploaded(uploads: Sequence[Upload], prefix: str = "") -> Contents:
    """The photographs among the uploads, name and content.

    Args:
        prefix: of their names: the folder of a camera.
    """
    for upload in uploads:
        if is_photograph(upload.name):
            yield prefix + upload.name, upload.getvalue()


def photographs_of(uploads: Sequence[Upload], prefix: str = "") -> Contents:
    """The photographs of uploads, including those in zips."""
    check_uploads(uploads)
    for upload in uploads:
        if not upload.name.lower().endswith(".zip"):
            yield from uploaded([upload], prefix)
            continue
        empty = True
        for name, content in zipped_photographs(upload.getvalue(), upload.name):
            yield prefix + name, content
            empty = False
        if empty:
            raise StereocalError(f"{upload.name}: there is no photograph in it.")


def take_photographs(photographs: Contents, store: ProjectPhotographs | ProjectLens) -> None:
    """Store photographs one by one and add them; report invalid ones on the page."""
    found: dict[str, StoredFile] = {}
    # No Streamlit calls in here: a click could end the script halfway.
    with st.spinner("Storing the photographs."):
        try:
            for name, content in photographs:
                found[name] = store.keep(name, content)
            if not found:
                raise StereocalError("There is no photograph among these files.")
        except StereocalError as error:
            refuse(error)
        if found:
            store.add(found)


def take_file(slot: Slot, upload: Upload | None) -> None:
    """Store a table or a camera file."""

    def take(name: str, content: bytes) -> None:
        if slot != "correspondences":
            store_camera(slot, name, content)
        else:
            _try_files({slot: (name, point_text(content, name))})

    take_one(upload, take)


def store_camera(slot: Slot, name: str, content: bytes) -> None:
    """Store a camera file; if it may be a fisheye's, ask."""

    try:
        if format_of(name, content) == "ros":
            content = write_camera(read_camera_pair({name: content}, ExchangeOptions()).primary)
        camera = read_camera(content, name)
    except FourCoefficientsError as error:
        ask_lens(error, lambda model: _try_camera_as(slot, name, content, model))
    else:
        _try_files({slot: (name, content)}, {slot: camera})


def _try_camera_as(slot: Slot, name: str, content: bytes, model: LensModel) -> None:
    """Store a camera file that does not state its lens model."""
    camera = read_camera(content, name, model)
    if camera.is_fisheye:  # the stored file must state it
        content = write_camera(camera)
    _try_files({slot: (name, content)}, {slot: camera})


def _rows_but(content: bytes, problems: Sequence[RowProblem]) -> tuple[bytes, int]:
    """A table without its refused rows, and the number of rows left."""
    rows = read_table(content, TABLE).correspondences
    left = rows.without_lines(problem.line for problem in problems)
    return write_table(left), len(left)


def _try_dataset(
    files: Mapping[str, bytes],
    source: str,
    photographs: Callable[[], Contents],
    lens_model: LensModel | None = None,
) -> None:
    """Store a data set; if rows are refused, offer to leave them out."""
    try:
        project = project_to_write()
        with_photographs = give_dataset(project, files, source, photographs, lens_model)
        if with_photographs:
            given_as(project, PHOTOGRAPHS).set(PHOTOGRAPHS)
        clear_refusal()
    except RefusedRowsError as error:
        folder = find_description(files, source).folder
        rest = _rows_but(files[folder + TABLE], error.problems)
        without = {**files, folder + TABLE: rest[0]}
        refuse(error, rest[1], lambda: _try_dataset(without, source, photographs, lens_model))
    except FourCoefficientsError as error:
        ask_lens(error, lambda model: _try_dataset(files, source, photographs, model))
    except StereocalError as error:
        refuse(error)


def _try_files(
    files: dict[Slot, tuple[str, bytes]], read: Mapping[Slot, Camera | Table] | None = None
) -> None:
    """Store files; if rows of the table are refused, offer to leave them out."""
    try:
        project = project_to_write()
        project.give(files, read=read)
        clear_refusal()
    except RefusedRowsError as error:
        table = files.get("correspondences") or project_to_write().table
        if table is None:
            refuse(error)
            return
        name, (rest, left) = table[0], _rows_but(table[1], error.problems)
        again: dict[Slot, tuple[str, bytes]] = {**files, "correspondences": (name, rest)}
        refuse(error, left, lambda: _try_files(again))
    except StereocalError as error:
        refuse(error)


def give_dataset(
    project: Project,
    files: Mapping[str, bytes],
    source: str,
    photographs: Callable[[], Contents] = lambda: (),
    lens_model: LensModel | None = None,
) -> bool:
    """Replace a project's data by a whole data set.

    Returns:
        Whether it has photographs.

    Raises:
        StereocalError: it is invalid; the project is unchanged.
    """
    store = ProjectPhotographs(project)
    description = find_description(files, source)
    folder = description.folder
    if description.is_recording:
        if len(description.entries.get("cameras") or ()) > 2:
            own = {name: content for name, content in files.items() if name.startswith(folder)}
            ProjectRecording(project).give(own, source)
            return False
        files = pack_pair(parse_dataset(files, source, lens_model=lens_model))
        description = find_description(files, source)
        folder = description.folder
    found = of_the_bar({name: store.keep(name, content) for name, content in photographs()})
    slots: dict[Slot, str] = {"primary": "", "secondary": ""}
    read: dict[Slot, Camera | Table] = {}
    survey: Survey | Dataset
    if found and folder + TABLE not in files:
        survey = parse_survey(files, source, lens_model)
    else:
        survey = parse_dataset(files, source, lens_model=lens_model)
        slots["correspondences"] = TABLE
        read["correspondences"] = Table(survey.correspondences, [])
    read |= {"primary": survey.primary, "secondary": survey.secondary}
    free = survey.baseline_sigma_m == math.inf
    slots |= {
        slot: description.entries["cameras"][slot] for slot in slots if slot != "correspondences"
    }
    for which in CAMERAS:
        camera: Camera = getattr(survey, which)
        if camera.is_fisheye:  # the stored file must state it
            files = {**files, folder + slots[which]: write_camera(camera)}
    kept = store.give(
        {slot: (name, files[folder + name]) for slot, name in slots.items()},
        found,
        read,
        name=survey.name,
        baseline_m=survey.baseline_m,
        target_distance_m=survey.target_distance_m,
        baseline_sigma_m=None if free else survey.baseline_sigma_m,
        baseline_free=free,
        target_distance_sigma_m=survey.target_distance_sigma_m,
    )
    if not kept:  # a running search is for the previous data set
        jobs.abandon(project, "photographs")
    return bool(found)


def is_new(*uploads: Upload) -> bool:
    """Whether any of these uploads has not been processed yet."""
    seen: set[str] = st.session_state.get(_SEEN, set())
    return not seen.issuperset(upload.file_id for upload in uploads)


def take_new(
    uploads: Upload | Sequence[Upload] | None, take: Callable[[dict[str, bytes]], object]
) -> None:
    """Have a page take uploads that are not processed yet, by name, and draw it again."""
    given = uploads if isinstance(uploads, Sequence) else [uploads]
    fresh = [upload for upload in given if upload is not None and is_new(upload)]
    if not fresh:
        return
    with taking(*fresh), st.spinner("Reading."):
        check_uploads(fresh)
        clear_refusal()
        take({upload.name: upload.getvalue() for upload in fresh})
    st.rerun()


def take_one(upload: Upload | None, take: Callable[[str, bytes], object]) -> None:
    """As `take_new`, of one file: its name and content."""
    take_new(upload, lambda files: [take(*file) for file in files.items()])


@contextmanager
def taking(*uploads: Upload) -> Iterator[None]:
    """Process uploads inside; then they are no longer new. A StereocalError is shown.

    A click ends the script by a BaseException at any access to the session or the page: then the
    uploads stay new, and the next run processes them.
    """
    seen: set[str] = st.session_state.setdefault(_SEEN, set())
    processed = {upload.file_id for upload in uploads}
    try:
        try:
            yield
        except StereocalError as error:
            refuse(error)
    except Exception:
        seen |= processed
        raise
    # The set first: a click can end the script only at the next access to the session.
    seen |= processed
    free_memory(uploads)
    # Opening another project has emptied the session.
    st.session_state[_SEEN] = seen
