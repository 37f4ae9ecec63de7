"""What was read, at the end of the Data page, and how cameras started by hand were brought into
step."""

from functools import partial

import pandas as pd
import streamlit as st

from stereocal.calibration.essential import MINIMUM_PAIRS
from stereocal.figures.coverage import describe_coverage, plot_coverage
from stereocal.figures.started_by_hand import describe_offsets, plot_offsets
from stereocal.figures.tables import contents_table
from stereocal.fit.timing.started_by_hand import bring_into_step
from stereocal.formats.dataset_files import pack_dataset, pack_recording
from stereocal.frames.all_cameras import by_folder
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.system.latest import once
from stereocal.system.numbers import count
from stereocal.ui import jobs
from stereocal.ui.figure import is_narrow, show_figure
from stereocal.ui.files_of_all import FilesOfAll, offer_to_use
from stereocal.ui.lengths import show_rig
from stereocal.ui.messages import ErrorsShown, end_here, readable, show_each
from stereocal.ui.photographs import has_photographs
from stereocal.ui.prerequisites import is_asked
from stereocal.ui.results import COVERAGE, dataset_download, open_clicked_frame
from stereocal.ui.texts import escape_markdown, escaped_table, markdown_list

FEW_FRAMES = 20
RECOMMENDED = f"{FEW_FRAMES} frames of the bar or more are recommended"


def show_what_was_read(project: Project | None, files: FilesOfAll | None) -> None:
    """The points, and the press that uses those of three cameras and more; ends the page without.

    Args:
        files: of three cameras and more.
    """
    if files is not None:
        _show_all_cameras(files)
    else:
        _show_two_cameras(project)


def _show_all_cameras(files: FilesOfAll) -> None:
    """The points camera by camera, and the press."""
    project = files.project
    photographs = by_folder(ProjectPhotographs(project).photographs, files.cameras)
    has_images = any(photographs.values()) or jobs.is_running(project, "video")
    if has_images and len(files.cameras) > 2 and not files.tables:
        return  # the table is still to be made from them
    if (gathered := readable(lambda: files.gathered)) is None:
        return
    st.header("What was read", divider="gray")
    rows, recording = [], gathered.recording
    for k, (name, camera) in enumerate(recording.cameras.items()):
        frames, (width, height) = recording.frame[recording.camera == k], camera.image_size
        rows.append((name, f"{width}x{height}", f"{len(frames):,}", f"{len({*frames.tolist()}):,}"))
    table = pd.DataFrame(rows, columns=["Camera", "Image, px", "Points", "Frames"])
    st.table(escaped_table(table).set_index("Camera"))
    if not recording.own_frames:
        st.caption(escape_markdown(recording.describe_pairs()))
    show_each(st.warning, gathered.remarks)
    offer_to_use(files)
    stated = project.recording
    if stated is not None and (not files.contents or project.is_given(gathered.files)):
        dataset_download(partial(pack_recording, stated))


def _show_two_cameras(project: Project | None) -> None:
    """The rig in words, where its points are, and what they are."""
    if project is None or not (
        project.inputs.files or has_photographs(project) or is_asked(project)
    ):
        st.info(
            "Nothing is loaded yet. Give files above, or try the sample data on the Start page."
        )
        st.page_link("pages/start.py", label="Back to Start")
        end_here()
    with ErrorsShown(end=True):
        dataset = project.dataset
    if dataset is None:
        end_here()
    st.header("What was read", divider="gray")
    _say_how_many(len(dataset.correspondences), len(dataset.correspondences.frames))
    if not dataset.recording.has_windows:  # the rig in words is of lenses in air
        show_rig(project, dataset)
    narrow, clicked = is_narrow(), partial(open_clicked_frame, project)
    key = f"{dataset.sha256} {narrow}"
    figure = once("coverage figure", key, lambda: plot_coverage(dataset, narrow))
    words = describe_coverage(dataset)
    show_figure(figure, words, COVERAGE, on_select=clicked, selection_mode="points")
    st.caption("A click on a point opens its frame.")
    st.table(contents_table(dataset))
    dataset_download(partial(pack_dataset, dataset))


def _say_how_many(pairs: int, frames: int) -> None:
    """How many points there are; green if they are enough, yellow if they are not."""
    amount = f"{count(pairs, 'pair')} of points in {count(frames, 'frame')}"
    if pairs < MINIMUM_PAIRS:
        st.warning(f"{amount}: at least {MINIMUM_PAIRS} pairs are needed, {RECOMMENDED}.")
    elif frames < FEW_FRAMES:
        few = "The fewer the frames, the less certain the results: record more if you can"
        st.warning(f"Complete: {amount}. {few}, {RECOMMENDED}.")
    else:
        st.success(f"Complete: {amount}.")


def show_in_step(project: Project | None) -> None:
    """What was found, and on demand the figure of each pair; nothing of cameras in step."""
    recording = None if project is None else readable(lambda: project.recording, warn=False)
    if recording is None and project is not None and project.inputs.step_notes:
        st.success(escape_markdown(" ".join(project.inputs.step_notes)))
    if recording is None or not (recording.step_notes or any(recording.start_frames.values())):
        return
    starts, notes = recording.start_frames, recording.step_notes
    counted = recording.counted_from({name: -start for name, start in starts.items()})
    with st.container(key="started_by_hand"):
        st.subheader("The cameras were started by hand")
        listed = notes or [f"{name} was started at frame {k}." for name, k in starts.items()]
        st.markdown(markdown_list(listed))
        if not st.toggle("Show the error at each offset", key="show_offsets"):
            return
        with st.spinner("Trying all offsets ..."):
            offsets = readable(lambda: bring_into_step(counted))
        for pair, pair_offsets in ({} if offsets is None else offsets.pairs).items():
            st.caption(escape_markdown(" and ".join(pair)))
            show_figure(
                plot_offsets(pair_offsets),
                describe_offsets(pair_offsets),
                f"offsets_{'_'.join(pair)}",
            )
