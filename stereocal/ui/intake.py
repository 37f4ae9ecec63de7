"""What the pages store of uploads: data sets, tables, camera files; and uploads taken once."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from types import MappingProxyType
from typing import Literal

import streamlit as st
from streamlit.delta_generator import DeltaGenerator
from streamlit.runtime.memory_uploaded_file_manager import MemoryUploadedFileManager
from streamlit.runtime.scriptrunner import get_script_run_ctx
from streamlit.runtime.uploaded_file_manager import UploadedFile as Upload

from stereocal.errors import RefusedRowsError, naming
from stereocal.fit.readings.outside import causes_named
from stereocal.fit.timing.to_calibrate import in_step, pair_to_calibrate
from stereocal.formats.camera_file import ImageSizeError, read_camera, write_camera
from stereocal.formats.correspondences_csv import Table, read_table, write_table
from stereocal.formats.dataset_description import TABLE, find_description
from stereocal.formats.dataset_files import parse_recording
from stereocal.formats.dropped import Dropped, sort_files
from stereocal.formats.exchange.options import ImageSize
from stereocal.formats.recognition import CAMERA_SUFFIXES
from stereocal.frames.video.decoding import SUFFIXES as VIDEO_SUFFIXES
from stereocal.projects.files import StoredFile
from stereocal.projects.inputs import Slot, stated_in
from stereocal.projects.packed import NAMES, as_read, packed_files
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, LensModel
from stereocal.rig.pair import Pair
from stereocal.system.limits import Limits
from stereocal.system.names import check_path
from stereocal.system.photograph import SUFFIXES
from stereocal.system.photograph_files import of_the_bar
from stereocal.ui import jobs
from stereocal.ui.messages import ask_about_lens, ask_if_fisheye, refusing, set_refusal
from stereocal.ui.project import project_to_write
from stereocal.ui.texts import markdown_list

PHOTOGRAPH_KINDS = [*sorted(suffix.removeprefix(".") for suffix in SUFFIXES), "zip"]
VIDEO_KINDS = [suffix.removeprefix(".") for suffix in VIDEO_SUFFIXES]
CAMERA_KINDS = [suffix.removeprefix(".") for suffix in CAMERA_SUFFIXES]
_SEEN = "uploads_seen"
Keep = Callable[[str, bytes], StoredFile]
"""Stores a photograph, by name and content."""
SHOWN = 8
_SAID = "dropped"
StoredPhotographs = Mapping[str, StoredFile]
"""Stored ones, by name."""


def check_uploads(uploads: Sequence[Upload]) -> None:
    """Check number and sizes of uploads before any is read.

    Raises:
        StereocalError: a limit is exceeded; names the setting that changes it.
    """
    limits = Limits.from_environment()
    limits.check_count(len(uploads), "The upload")
    limits.check_together(sum(upload.size for upload in uploads), "The upload")
    for upload in uploads:
        check_path(upload.name, "The upload")
        # Zips are checked by their list of contents.
        if not upload.name.lower().endswith(".zip"):
            limits.check_size(upload.size, upload.name)


def store_cameras(files: Mapping[Slot, tuple[str, bytes]]) -> None:
    """Store camera files; what they do not say of their lenses is asked, once for all."""

    def take(model: LensModel | None, size: ImageSize | None) -> None:
        stored = dict(files)
        for slot, (name, content) in files.items():
            try:
                camera = read_camera(content, name, model)
                is_asked = model == "fisheye"
            except ImageSizeError:
                camera = read_camera(content, name, model, size)
                is_asked = True
            # The stored file must state what was asked.
            stored[slot] = name, as_read(write_camera(camera) if is_asked else content, camera)
        store_files(stored)

    ask_about_lens(take)


def _offer_rest(error: RefusedRowsError, table: bytes, use: Callable[[bytes], None]) -> None:
    """Refuse rows of a table, and offer to leave them out."""
    rows = read_table(table, TABLE).correspondences
    other_rows = rows.without_lines(problem.line for problem in error.problems)
    label = f"Leave these rows out and use the other {len(other_rows)}"
    without = refusing()(lambda: use(write_table(other_rows)))
    set_refusal(error, {label: without} if len(other_rows) else None)


def store_dataset(dropped: Dropped[StoredFile]) -> None:
    """Store a data set and its photographs; what may be a fisheye's is asked, and if rows are
    refused, it is offered to leave them out."""

    def take(files: Mapping[str, bytes], videos: bool, lens_model: LensModel | None) -> None:
        project, source = project_to_write(), dropped.source
        try:
            give_dataset(project, files, source, dropped.photographs, lens_model, videos)
        except RefusedRowsError as error:
            name = find_description(files, source).folder + TABLE
            if name not in files:  # a recording has another table
                raise
            _offer_rest(
                error, files[name], lambda rest: take({**files, name: rest}, False, lens_model)
            )

    ask_if_fisheye(partial(take, dropped.files, bool(dropped.of("video"))))


def store_files(files: Mapping[Slot, tuple[str, bytes]]) -> None:
    """Store files; if rows of the table are refused, offer to leave them out."""
    project = project_to_write()
    try:
        project.give(files)
    except RefusedRowsError as error:
        table = files.get("correspondences") or project.table
        if table is None:  # another tab has just removed it
            raise
        name, content = table
        _offer_rest(
            error, content, lambda rest: store_files({**files, "correspondences": (name, rest)})
        )


def give_dataset(
    project: Project,
    files: Mapping[str, bytes],
    source: str,
    photographs: StoredPhotographs = MappingProxyType({}),
    lens_model: LensModel | None = None,
    has_videos: bool = False,
) -> None:
    """Replace a project's data by a whole data set.

    Args:
        photographs: those that are stored already.
        has_videos: whether its points are to be found in videos.

    Raises:
        StereocalError: it is invalid; the project is unchanged.
    """
    description, bar_photographs = find_description(files, source), of_the_bar(photographs)
    folder = description.folder
    has_photographs = bool(bar_photographs) or has_videos
    with_points = description.is_recording or folder + TABLE in files or not has_photographs
    with causes_named():
        recording = parse_recording(files, source, lens_model=lens_model, with_points=with_points)
    # A fisheye's file states that it is one.
    stated = dict(files)
    for camera, lens in recording.cameras.items():
        if lens.is_fisheye:
            stated[folder + description.entries["cameras"][camera]] = write_camera(lens)
    if len(recording.cameras) > 2:
        with naming(source):
            recording = in_step(recording)
        inside = {name: content for name, content in stated.items() if name.startswith(folder)}
        project.give_recording(recording, inside)
        jobs.abandon(project, "rig")
        jobs.drop_pairs(project)
        return
    with naming(source):
        survey = pair_to_calibrate(recording) if with_points else recording.pair(*CAMERAS)
    if description.is_recording:
        give_pair(project, survey, photographs=bar_photographs)
        return
    slot_files: dict[Slot, tuple[str, bytes]] = {}
    if with_points:
        table = as_read(files[folder + TABLE], Table(survey.correspondences, []))
        slot_files["correspondences"] = TABLE, table
    for which in CAMERAS:
        name: str = description.entries["cameras"][which]
        slot_files[which] = name, as_read(stated[folder + name], recording.cameras[which])
    give_pair(project, survey, slot_files, bar_photographs)


def give_pair(
    project: Project,
    dataset: Pair,
    files: Mapping[Slot, tuple[str, bytes]] | None = None,
    photographs: StoredPhotographs = MappingProxyType({}),
) -> None:
    """Replace a project's data by a data set.

    Args:
        files: of the data set, where it was read from some.
        photographs: its photographs, which are stored already.
    """
    if files is None:
        files = {slot: (NAMES[slot], content) for slot, content in packed_files(dataset).items()}
    stays = ProjectPhotographs(project).give(files, photographs, **stated_in(dataset))
    if not stays:  # a running search is for the previous data set
        jobs.abandon(project, "photographs")


def is_new(*uploads: Upload) -> bool:
    """Whether any of these uploads has not been processed yet."""
    return not st.session_state.get(_SEEN, set()).issuperset(upload.file_id for upload in uploads)


def take_uploads(
    uploads: Sequence[Upload | None], take: Callable[[list[Upload]], object], counter: str = ""
) -> None:
    """Have a page take uploads that are not processed yet, and draw it again.

    Args:
        counter: of the uploader, which a new key empties: else it keeps every file in memory.
    """
    fresh = [upload for upload in uploads if upload is not None and is_new(upload)]
    if not fresh:
        return
    with taking(*fresh):
        check_uploads(fresh)
        take(fresh)
    if counter:
        st.session_state[counter] += 1
    st.rerun()


def emptied_uploader(
    label: str,
    kinds: Sequence[str] | None,
    key: str,
    take: Callable[[list[Upload]], object],
    *,
    counter: str = "",
    many: Literal[True, "directory"] = True,
) -> None:
    """An uploader of several files, or of a folder, that is emptied when they are taken."""
    counter = counter or key
    key = f"{key}_{st.session_state.setdefault(counter, 0)}"
    uploads = st.file_uploader(label, kinds, accept_multiple_files=many, key=key)
    take_uploads(uploads, take, counter)


def drop_zone(
    label: str,
    key: str,
    keep: Keep,
    take: Callable[[Dropped[StoredFile]], None],
    *,
    row: DeltaGenerator | None = None,
    below: DeltaGenerator | None = None,
    tables: tuple[str, ...] = (),
    in_use: bool = False,
) -> None:
    """The uploader of files of any kind, one of a folder, and what the last files were.

    Args:
        keep: stores a photograph.
        take: uses what was given; it may add to its `problems`.
        row, below: where the uploader of a folder, and what the last files were, stand; None: here.
        tables: as of `sort_files`.
        in_use: whether the page says what is in use: then what was recognised is not said too.
    """

    def used(uploads: Sequence[Upload]) -> None:
        st.session_state.pop(_SAID, None)
        with st.spinner("Reading the files."):
            dropped = sort_files(((file.name, file.getvalue()) for file in uploads), keep, tables)
        take(dropped)
        st.session_state[_SAID] = key, dropped.in_words, dropped.problems

    emptied_uploader(label, None, key, used)
    with (row or st).popover("Give a whole folder"):
        folder_label = "A folder, with all folders in it"
        emptied_uploader(folder_label, None, f"{key}_folder", used, many="directory")
    with below or st.container():
        _show_last(key, in_use)


def _show_last(key: str, in_use: bool) -> None:
    """What the last files were, and those that cannot be used."""
    shown_key, recognised, problems = st.session_state.get(_SAID, ("", "", []))
    if shown_key != key:
        return
    if recognised and not in_use:
        (st.info if problems else st.success)(f"Recognised: {recognised}.")
    if problems:
        st.warning(markdown_list(problems[:SHOWN]))
        if len(problems) > SHOWN:
            with st.expander(f"And {len(problems) - SHOWN} more"):
                st.markdown(markdown_list(problems[SHOWN:]))


def take_new(
    uploads: Upload | Sequence[Upload] | None, take: Callable[[dict[str, bytes]], object]
) -> None:
    """Have a page take the contents of small new uploads, by name; as `take_uploads`."""

    def read(fresh: Sequence[Upload]) -> None:
        with st.spinner("Reading."):
            take({upload.name: upload.getvalue() for upload in fresh})

    take_uploads(uploads if isinstance(uploads, Sequence) else [uploads], read)


def take_one(upload: Upload | None, take: Callable[[str, bytes], object]) -> None:
    """Have a page take the name and the content of one new upload."""
    take_new(upload, lambda files: [take(*file) for file in files.items()])


@contextmanager
def taking(*uploads: Upload) -> Iterator[None]:
    """Process uploads inside; then they are no longer new. A StereocalError is the refusal.

    A click ends the script by a BaseException at any access to the session or the page: then the
    uploads stay new, and the next run processes them. Streamlit would keep the memory of processed
    ones for the session.
    """
    seen: set[str] = st.session_state.setdefault(_SEEN, set())
    processed = {upload.file_id for upload in uploads}
    try:
        with refusing():
            yield
    except Exception:
        seen |= processed
        raise
    # The set first: a click can end the script only at the next access to the session.
    seen |= processed
    run = get_script_run_ctx()
    if run is not None and isinstance(run.uploaded_file_mgr, MemoryUploadedFileManager):
        for file_id in processed:
            run.uploaded_file_mgr.remove_file(run.session_id, file_id)
    # Opening another project has emptied the session.
    st.session_state[_SEEN] = seen
