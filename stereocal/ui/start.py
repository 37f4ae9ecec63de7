"""What Start shows: the story of the real recording, and the sample data to begin with."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from typing import Literal

import streamlit as st

from stereocal.errors import disk_errors
from stereocal.figures import story as figures
from stereocal.formats.dataset_files import TABLE
from stereocal.formats.recording_files import POINTS
from stereocal.projects.application import ProjectApplication, slot_of
from stereocal.projects.lens import ProjectLens
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.recording import ProjectRecording
from stereocal.projects.server_settings import default_home
from stereocal.rig.camera import CAMERAS
from stereocal.system.photograph_files import is_photograph
from stereocal.system.resources import ROOT
from stereocal.ui.intake import give_dataset
from stereocal.ui.jobs import pool
from stereocal.ui.messages import refusing
from stereocal.ui.project import project_to_write, projects_in_creation

SAMPLES = ROOT / "sample_data"
RECORDING, FIELD, PHOTOGRAPHS, RIG = (
    SAMPLES / name for name in ("recording", "field", "photographs", "rig")
)
DESCRIPTION = ("dataset.json", "primary.json", "secondary.json")


def has_sample_photographs() -> bool:
    """Whether they are installed; they are optional, 11 MB."""
    return PHOTOGRAPHS.is_dir()


@st.cache_resource(show_spinner=False)
def _story() -> figures.Story:
    return figures.read_story(ROOT / "assets" / "story.json")


def show_story() -> None:
    """Three figures side by side, and what they say in words."""
    story = _story()
    bars = len(next(iter(story.sets.values())).length_errors)
    lengths = f"Length errors of the same {bars} real bars"
    shown = (
        ("story_lengths", lengths, figures.plot_story_lengths),
        ("two_rays", "Why: two rays miss each other", figures.plot_two_rays),
        ("story_lines", "A point and its epipolar lines", figures.plot_story_lines),
    )
    for place, (key, title, plot) in zip(st.columns([5, 4, 4], gap="medium"), shown, strict=True):
        place.markdown(f"**{title}**")
        place.plotly_chart(plot(story), key=key)
    with st.expander("In words"):
        st.caption(figures.describe_story_lengths(story))
        st.caption(figures.describe_two_rays(story))
        st.caption(figures.describe_story_lines(story))


def _sample(folder: Path, names: Sequence[str], source: str) -> Project:
    project = Project.create(default_home())
    bars = _bars() if folder == PHOTOGRAPHS else ()
    found = {name: ProjectPhotographs(project).keep(name, content) for name, content in bars}
    give_dataset(project, _files(folder, names), source, found)
    return project


def real_recording() -> Project:
    """A project with the real recording; its middle marker is the points to match and measure."""
    project = _sample(RECORDING, (*DESCRIPTION, TABLE), "real recording")
    store = ProjectApplication(project)
    for which in CAMERAS:
        name = f"points_{which}.csv"
        store.offer_points(which, name, (RECORDING / name).read_bytes())
    return project


def three_cameras() -> Project:
    """A project with the real recording of three cameras; the middle marker is the points to match
    and measure."""
    cameras = [path.name for path in sorted(RIG.glob("*.yaml"))]
    project = _sample(RIG, [DESCRIPTION[0], POINTS, *cameras], "three cameras")
    store = ProjectApplication(project)
    for camera in ProjectRecording(project).cameras:
        name = f"points_{camera}.csv"
        store.offer_points(slot_of(camera), name, (RIG / name).read_bytes())
    return project


def sample_points() -> Project:
    """A project with the simulated data set of points."""
    return _sample(FIELD, (*DESCRIPTION, TABLE), "sample data")


def sample_photographs() -> Project:
    """A project with photographs of the bar and of the boards, the lenses and the lengths."""
    project = _sample(PHOTOGRAPHS, DESCRIPTION, "sample photographs")
    _give_boards(project)
    return project


def sample_buttons() -> None:
    """Buttons that create a sample's project, which the next run of any page opens."""
    samples = {"recording": ("Open the real recording", real_recording)}
    if has_sample_photographs():
        samples["demo_photographs"] = ("Sample photographs", sample_photographs)
    samples["demo_rig"] = ("Three cameras", three_cameras)
    samples["demo"] = ("Simulated rig", sample_points)
    making = projects_in_creation()  # a click may end a callback at its next access to the session
    for key, (label, make) in samples.items():
        kind: Literal["primary", "secondary"] = "primary" if key == "recording" else "secondary"
        begin = partial(_begin, making, make)
        st.button(label, type=kind, key=key, on_click=begin)


def _begin(making: list[Future[Project]], make: Callable[[], Project]) -> None:
    making.append(pool().submit(make))


def load_sample_boards() -> None:
    """Add the sample's board photographs to the open project or a new one (a callback)."""
    with refusing():
        _give_boards(project_to_write())


def _files(folder: Path, names: Sequence[str]) -> dict[str, bytes]:
    with disk_errors(f"{folder} cannot be read"):
        return {name: (folder / name).read_bytes() for name in names}


def _give_boards(project: Project) -> None:
    for which in CAMERAS:
        store = ProjectLens(project, which)
        found = _photographs(f"boards_{which}")
        store.add({name: store.keep(name, content) for name, content in found})


def _bars() -> Iterator[tuple[str, bytes]]:
    for which in CAMERAS:
        for name, content in _photographs(which):
            yield f"{which}/{name}", content


def _photographs(folder: str) -> Iterator[tuple[str, bytes]]:
    for path in sorted((PHOTOGRAPHS / folder).iterdir()):
        if is_photograph(path.name):
            yield path.name, path.read_bytes()
