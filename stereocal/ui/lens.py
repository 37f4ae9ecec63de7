"""The Lenses page: board photographs, a video or a camera file, the calibration, its results."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path, PurePosixPath

import pandas as pd
import streamlit as st
from streamlit.runtime.uploaded_file_manager import UploadedFile

from stereocal.errors import StereocalError
from stereocal.figures import lens as figures
from stereocal.figures.rig_report import lens_table
from stereocal.formats.camera_file import write_camera, write_opencv_camera
from stereocal.formats.dropped import sort_files
from stereocal.frames.several_cameras import cameras_told, chapters_of
from stereocal.frames.video.extract import VideoSettings, extract
from stereocal.intrinsics import files, quality
from stereocal.intrinsics.boards import FoundBoard, find_boards
from stereocal.intrinsics.calibrate_lens import LensCalibration, calibrate_lens, digest_of_draws
from stereocal.intrinsics.lens_fit import LensSettings
from stereocal.intrinsics.proposed_board import proposed_board, split_of
from stereocal.projects.database import DamagedError
from stereocal.projects.files import StoredFile
from stereocal.projects.given import ProjectGiven
from stereocal.projects.lens import ProjectLens
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, CameraName
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.latest import once
from stereocal.system.made_from import Parts, changed
from stereocal.system.numbers import count
from stereocal.system.records import plain
from stereocal.system.settings import asked
from stereocal.system.split_photographs import FOLDERS, Split, split_photographs
from stereocal.system.taken import Taken
from stereocal.ui import intake, jobs
from stereocal.ui.downloads import offer
from stereocal.ui.fields import choose, setting, some_of
from stereocal.ui.figure import show_figure
from stereocal.ui.forms import ask, field_of
from stereocal.ui.holding import board_form, fields_of_board
from stereocal.ui.menu import PRESS_FIRST
from stereocal.ui.messages import (
    ErrorsShown,
    button,
    readable,
    refusing,
    set_refusal,
    show_each,
    show_refusal,
    show_stale,
    show_with_button,
    tell,
)
from stereocal.ui.print_downloads import board_to_print
from stereocal.ui.project import current_project, project_to_write
from stereocal.ui.start import has_sample_photographs, load_sample_boards
from stereocal.ui.texts import BOARDS, escape_markdown, escaped_table
from stereocal.ui.videos import start_taking

BOARD, FILE = "Photographs of a board", "A camera file"
STAGES = ("photographs searched", "draws calibrated")
JOB_KINDS: dict[CameraName, jobs.Kind] = {"primary": "lens_primary", "secondary": "lens_secondary"}
_ROUND = "boards_round"
VIEWS = {
    "Photograph by photograph": (
        figures.plot_view_errors,
        figures.describe_view_errors,
        "view_errors",
    ),
    "What the lens leaves": (
        figures.plot_residual_field,
        figures.describe_residual_field,
        "residual_field",
    ),
}
"""Figures of a lens: how they are drawn and described, and their keys."""
WITHOUT = "Without distortion"


def show_lenses(project: Project | None) -> None:
    """The lenses in use, and how a camera's is found or given."""
    cameras = zip(CAMERAS, project.cameras if project else (None, None), strict=True)
    labels = project.inputs.labels if project else {}
    named = {which: f"{which}: {labels[which]}" if which in labels else which for which in CAMERAS}
    _show_table(lens_table({named[which]: camera for which, camera in cameras}))
    which, how = _choose_camera(project)
    if how == FILE:
        _from_file(project, which)
        show_refusal()
        return
    with st.expander("How to take the photographs"):
        st.markdown(BOARDS)
    board_to_print(project)
    store = _from_photographs(which)
    show_refusal()
    if store is None:
        _tell_what_is_loaded(project, which)
    else:
        _show_lens(store)


def show_cameras_of_rig(project: Project) -> bool:
    """The lenses of a recording of several cameras, or of the files given for one; with a rig,
    those that it refined too. False if there are none."""
    cameras = readable(lambda: ProjectGiven(project).cameras) or {}
    if not (project.holds_recording or len(cameras) > len(CAMERAS)):
        return False
    _show_table(lens_table(cameras, project.rig))
    if project.rig is not None:
        st.caption("Refined: by the rig, with its standard errors. Apply and Check use these.")
    st.markdown(
        "To give another lens, give its camera file on the page Data. From photographs of a board, "
        "make it in a project of its own, and download its camera file there."
    )
    st.page_link("pages/data.py", label="Camera files on the Data page")
    return True


def _show_table(lenses: pd.DataFrame) -> None:
    st.table(escaped_table(lenses).set_index("Camera"))


def _tell_what_is_loaded(project: Project | None, which: CameraName) -> None:
    """What there is to do while there are no photographs of the board."""
    if project is not None and jobs.is_running(project, JOB_KINDS[which]):
        return
    cameras = project.cameras if project else (None, None)
    if all(cameras):
        words = "Both lenses are loaded. To calibrate one again, upload photographs of the board."
    elif cameras[CAMERAS.index(which)]:
        words = f"The {which} camera's lens is loaded; the other camera's is still missing."
    else:
        words = "Nothing to calibrate yet: upload photographs of the board."
    st.info(words)


def _choose_camera(project: Project | None) -> tuple[CameraName, str]:
    """Which camera, and where its lens comes from."""
    left, right = st.columns(2)
    choose_left = partial(choose, place=left, format_func=str.capitalize)
    which: CameraName = choose_left(project, "lens_camera", "Camera", CAMERAS)
    how: str = choose(project, "lens_how", "I have", (BOARD, FILE), place=right)
    stores = [] if project is None else [ProjectLens(project, camera) for camera in CAMERAS]
    # What is damaged is reported where they are shown.
    photographs = readable(lambda: [store.photographs for store in stores], warn=False)
    has_boards = photographs is None or any(photographs)
    if how == BOARD and has_sample_photographs() and not has_boards:
        st.button("Try with sample photographs", key="sample_boards", on_click=load_sample_boards)
    return which, how


def _from_file(project: Project | None, which: CameraName) -> None:
    """The uploader of a camera file."""
    if project is not None and which in project.inputs.labels:
        st.caption(f"In use: {escape_markdown(project.inputs.labels[which])}")
    upload = st.file_uploader(
        f"Camera file, {which}: stereocal's JSON, or OpenCV's YAML, XML or JSON",
        type=intake.CAMERA_KINDS,
        key=f"upload_lens_{which}",
    )
    intake.take_one(upload, lambda *file: intake.store_cameras({which: file}))


def _from_photographs(which: CameraName) -> ProjectLens | None:
    """The uploader, the forms and the calibration; None while there are no photographs."""

    def take(uploads: Sequence[UploadedFile]) -> None:
        camera_store = ProjectLens(project_to_write(), which)
        with st.spinner("Storing the photographs."):
            contents = ((upload.name, upload.getvalue()) for upload in uploads)
            dropped = sort_files(contents, camera_store.keep)
        _add(camera_store, dropped.photographs)
        if videos := dropped.of("video"):
            dropped.use(partial(_take_video, camera_store, videos))
        if dropped.problems or not (dropped.photographs or videos):
            none = "There is neither a photograph nor a video among these files."
            raise StereocalError(" ".join(dropped.problems) or none)

    title = f"Photographs of the board by the {which} camera, a zip of them, or a video"
    kinds, key = [*intake.PHOTOGRAPH_KINDS, *intake.VIDEO_KINDS], f"upload_boards_{which}"
    intake.emptied_uploader(title, kinds, key, take, counter=_ROUND)
    project = current_project()
    if project is None:
        return None
    store, key = ProjectLens(project, which), f"no_boards_{which}"
    cancelled = "Cancelled. What was there before is unchanged."
    try:
        photographs = store.photographs
        if photographs:
            words = f"Of the {which} camera: {count(len(photographs), 'photograph')}."
            show_with_button("markdown", words, "Remove them", key, _clear, store)
            files_key = repr([file.name for file in photographs.values()])
            split = once("images in a photograph", files_key, lambda: split_of(photographs))
            if split is not None:
                words = f"Each photograph shows two boards: it holds two images, {split}."
                label = "Split them between both cameras"
                show_with_button("warning", words, label, f"split_{which}", _split, store, split)
            with ErrorsShown():
                _act(store, board_form(project), _lens_form(project))
    except DamagedError as error:
        st.error(escape_markdown(str(error)))
        button("Remove them", key, _clear, store)
        return None
    jobs.show_job(project, JOB_KINDS[which], cancelled)
    return store if photographs else None


def _add(store: ProjectLens, new: Mapping[str, StoredFile]) -> None:
    """Add photographs, unless they are of several cameras: then it is asked."""
    present, which = store.photographs, store.which
    cameras = cameras_told(dict.fromkeys({**present, **new}, Taken()))
    if not cameras or not new:
        _add_to({store.which: new}, store.project)
        return
    listing = " and ".join(str(series) for series in cameras.values())
    error = StereocalError(f"These photographs are of {len(cameras)} cameras: {listing}.")
    again = refusing()(_add_to)
    ways = {f"All are of the {which} camera": partial(again, {which: new}, store.project)}
    if {*cameras} == {*CAMERAS}:
        first, second = (
            {name: file for name, file in new.items() if name in cameras[camera].names}
            for camera in CAMERAS
        )
        # Those that are there already tell which camera is called what.
        if {*present} & {*cameras[CAMERAS[1 - CAMERAS.index(which)]].names}:
            first, second = second, first
        both = dict(zip(CAMERAS, (first, second), strict=True))
        ways = {"Divide them between both": partial(again, both, store.project), **ways}
    set_refusal(error, ways)


def _add_to(new: Mapping[CameraName, Mapping[str, StoredFile]], project: Project) -> None:
    """Add photographs to those of their cameras."""
    for which, photographs in new.items():
        store = ProjectLens(project, which)
        store.add(photographs)
        if photographs:
            with st.spinner("Looking at the first photographs ..."):
                _propose_board(store)
    if len(new) > 1:
        counts = " and ".join(f"{len(photographs)} of the {w}" for w, photographs in new.items())
        tell(f"These photographs are added to both cameras: {counts}.", "info")


def _split(store: ProjectLens, split: Split) -> None:
    """Put the halves of all photographs in their place, those of each camera."""
    halves = split_photographs(store.photographs, split, store.keep)
    store.clear()
    of_each = {
        which: {name: file for name, file in halves.items() if name.startswith(f"{folder}/")}
        for which, folder in zip(CAMERAS, FOLDERS, strict=True)
    }
    _add_to(of_each, store.project)


def _take_video(store: ProjectLens, videos: Mapping[str, bytes]) -> None:
    """Begin to take photographs out of a video."""
    if len(chapters_of(videos)) > 1:
        raise StereocalError(f"These are {len(videos)} videos: give one at a time.")
    named = {PurePosixPath(name).stem: (name, content) for name, content in videos.items()}
    start_taking(store.project, JOB_KINDS[store.which], named, partial(_take_frames, store))


def _take_frames(store: ProjectLens, videos: Mapping[str, Path], job: jobs.Job) -> None:
    """The sharpest still frames of a video, or of its chapters, which become photographs in a
    folder of its name."""
    sentences, photographs = list[str](), dict[str, StoredFile]()

    def keep(frame: str, content: bytes) -> None:
        photographs[frame] = store.keep(frame, content)

    for folder, path in videos.items():
        photographs.clear()
        report = extract({folder: path}, VideoSettings(), keep, job.begin, job.progress)
        store.replace(folder, photographs)
        sentences += report.sentences
    _propose_board(store)
    job.note = " ".join(sentences)


def _propose_board(store: ProjectLens) -> None:
    """Fill in what is printed on the board, where the first photographs show it."""
    if "board_columns" not in store.project.settings:
        board = proposed_board(store.photographs)
        if board is not None:
            store.project.keep_settings(fields_of_board(board))


def _lens_form(project: Project) -> LensSettings:
    settings = asked(LensSettings)
    fields = {name: field_of(project, f"lens_{name}", spec) for name, spec in settings.items()}
    fixed = ("fix_k3", "zero_tangential") if fields["model"].value() == "fisheye" else ()
    with st.expander("Settings of the calibration"):
        places = (*st.columns(3), *st.columns(2), st.container())
        values = {
            name: ask(place, spec, fields[name], disabled=name in fixed)
            for place, (name, spec) in zip(places, settings.items(), strict=True)
        }
    return LensSettings(**values)


def _act(store: ProjectLens, pattern: BoardPattern, settings: LensSettings) -> None:
    """The photographs to leave out, and the press; returns what it begins."""
    search, lens = readable(lambda: store.search), readable(lambda: store.calibration)
    leave_out: list[str] = []
    ready = search is not None and search.pattern == pattern
    names = [*store.photographs] if search is None else [view.name for view in search.views]
    if ready:
        chosen = setting(store.project, f"leave_out_{store.which}", [], some_of(names))
        title = "Photographs to leave out"
        leave_out = st.multiselect(title, names, placeholder="none", **chosen.widget("default"))
    kind = JOB_KINDS[store.which]
    run = partial(_calibrate, store, pattern, settings, leave_out)
    work = jobs.PageWork(store.project, kind, STAGES, run)
    label = "Calibrate the lens" if ready else "Find the boards and calibrate the lens"
    if lens is not None and not jobs.is_running(store.project, kind):
        made_from = _parts(lens.search.pattern, [v.name for v in lens.search.views], lens.settings)
        used = [name for name in names if name not in leave_out]
        show_stale(changed(made_from, _parts(pattern, used, settings)))
    jobs.start_button(work, label, f"calibrate_{store.which}", primary=lens is None)


def _parts(pattern: BoardPattern, photographs: Sequence[str], settings: LensSettings) -> Parts:
    """What a lens is made from."""
    return {"board": [plain(pattern)], "photographs": [*photographs], **settings.parts}


def _calibrate(
    store: ProjectLens,
    pattern: BoardPattern,
    settings: LensSettings,
    leave_out: Sequence[str],
    job: jobs.Job,
) -> None:
    search = store.search
    if search is None or search.pattern != pattern:
        boards = job.found_before(FoundBoard)
        search = find_boards(store.photographs, pattern, job.executor, job.progress, boards)
        store.keep_search(search)
    job.begin(STAGES[1])
    lens = calibrate_lens(search.without(leave_out), settings, job.executor, job.progress)
    store.keep_calibration(lens)


def _clear(store: ProjectLens) -> None:
    # First: a running job needs the photographs.
    jobs.abandon(store.project, JOB_KINDS[store.which])
    store.clear()
    st.session_state[_ROUND] += 1


def _show_lens(store: ProjectLens) -> None:
    """The last finished lens of a camera."""
    # Reported above, where it can be calibrated again.
    lens = readable(lambda: store.calibration, warn=False)
    search = readable(lambda: store.search, warn=False)
    if search is not None and search.refused:
        with st.expander(f"{count(len(search.refused), 'photograph')} without a usable board"):
            for item in search.refused:
                st.markdown(f"- {escape_markdown(item.name)}: {escape_markdown(item.reason)}.")
    if lens is None:
        return
    st.header(f"The {store.which} camera's lens", divider="gray")
    show_each(st.warning, quality.advice(lens))
    st.success(escape_markdown(quality.lens_answer(lens)))
    note = partial(quality.note_on_model, lens.search, lens.settings)
    digest = digest_of_draws(lens.search, lens.settings)
    st.caption(escape_markdown(once("note on a lens", digest, note)))
    if text := quality.hint(lens):
        st.caption(text)
    _use_and_downloads(store, lens)
    _look_closer(store, lens)
    st.table(quality.lens_fit_table(lens))
    st.caption(
        "The median of the draws is the result. Its standard error comes from how much the results "
        "differ (delete-d jackknife); errors that all photographs share, such as a bent board, are "
        "not in it. The last column is one calibration with all photographs."
    )


def _look_closer(store: ProjectLens, lens: LensCalibration) -> None:
    """A choice of figures; only the chosen one is drawn."""
    draws = (figures.plot_draws, figures.describe_draws, "draws")
    views = {f"The {lens.settings.repeats} results": draws, **VIEWS}
    view = choose(store.project, "lens_view", "Look at", [*views, WITHOUT])
    if view == WITHOUT:
        _show_preview(store, lens)
    else:
        plot, describe, key = views[view]
        show_figure(plot(lens), describe(lens), key)


def _use_and_downloads(store: ProjectLens, lens: LensCalibration) -> None:
    use, ours, opencv = st.columns(3)
    used = store.is_used
    st.session_state[PRESS_FIRST] = not used
    label, icon = ("In use", "check") if used else ("Use", None)
    label, key, act = f"{label} for this project", f"use_lens_{store.which}", refusing()(store.use)
    button(label, key, act, place=use, first=True, disabled=used, icon=icon)
    name, content = f"{store.which}.json", write_camera(lens.camera, files.about(lens))
    key, hint = f"lens_json_{store.which}", "With the standard errors."
    offer("Download camera.json", content, name, key, place=ours, help=hint)
    name, content = f"{store.which}.yml", write_opencv_camera(lens.camera)
    key, hint = f"lens_yaml_{store.which}", "Without the standard errors."
    offer("Download OpenCV YAML", content, name, key, place=opencv, help=hint)


def _show_preview(store: ProjectLens, lens: LensCalibration) -> None:
    photographs = store.photographs
    names = [view.name for view in lens.search.views if view.name in photographs]
    if not names:
        st.info("The photographs of this lens have been removed.")
        return
    name = choose(store.project, f"preview_{store.which}", "Photograph", names, as_menu=True)
    view = next(view for view in lens.search.views if view.name == name)
    with ErrorsShown():
        marked, straight = quality.preview(photographs[name], lens.camera, view)
        left, right = st.columns(2)
        caption = "As photographed, with the corners that were found"
        left.image(marked, caption=caption, width="stretch")
        shift = quality.largest_shift_px(lens.camera)
        caption = f"Without the lens's distortion, which moves points by up to {shift:.1f} px"
        right.image(straight, caption=caption, width="stretch")
