"""What Start shows: the story of the real recording, and the sample data to begin with."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import Literal

import plotly.graph_objects as go
import streamlit as st

from stereocal.errors import StereocalError, disk_errors
from stereocal.figures import story as figures
from stereocal.formats.dataset_description import POINTS, TABLE
from stereocal.projects.application import ProjectApplication, slot_of
from stereocal.projects.files import StoredFile
from stereocal.projects.given import ProjectGiven
from stereocal.projects.home import find_projects
from stereocal.projects.lens import ProjectLens
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.server_settings import ServerSettings, default_home
from stereocal.rig.camera import CAMERAS
from stereocal.system.photograph_files import is_photograph
from stereocal.system.resources import ROOT
from stereocal.ui.figure import show_figure
from stereocal.ui.intake import give_dataset
from stereocal.ui.jobs import pool
from stereocal.ui.messages import refusing
from stereocal.ui.project import forget_project, project_to_write, projects_in_creation

SAMPLES = ROOT / "sample_data"
RECORDING, FIELD, PHOTOGRAPHS, RIG = (
    SAMPLES / name for name in ("recording", "field", "photographs", "rig")
)
DESCRIPTION = ("dataset.json", "primary.json", "secondary.json")
SAMPLE = "sample"
"""Setting of a project that was made of a sample: key of its button, and digest of what it held."""
LARGE = """<style>
.st-key-begin button, .st-key-recording button { min-height: 4.5rem; }
.st-key-begin button p, .st-key-recording button p { font-size: 1.2rem; }
</style>"""


def has_sample_photographs() -> bool:
    """Whether they are installed; they are optional, 11 MB."""
    return PHOTOGRAPHS.is_dir()


@cache
def _story() -> tuple[int, dict[str, tuple[go.Figure, str]]]:
    """How many bars the story is about; its figures, and the same in words, by key."""
    story = figures.read_story(ROOT / "assets" / "story.json")
    parts = {
        "story_lengths": (figures.plot_story_lengths, figures.describe_story_lengths),
        "two_rays": (figures.plot_two_rays, figures.describe_two_rays),
        "story_lines": (figures.plot_story_lines, figures.describe_story_lines),
    }
    drawn = {key: (plot(story), describe(story)) for key, (plot, describe) in parts.items()}
    return len(next(iter(story.sets.values())).length_errors), drawn


def show_story() -> None:
    """What one set and two do to the same real bars, and why, folded."""
    bars, parts = _story()
    st.markdown(f"**Length errors of the same {bars} real bars**")
    show_figure(*parts["story_lengths"], "story_lengths")
    with st.expander("Why"):
        for place, key in zip(st.columns(2), ("two_rays", "story_lines"), strict=True):
            with place:
                show_figure(*parts[key], key, caption=True)


def _sample(folder: Path, names: Sequence[str], source: str) -> Project:
    project = Project.create(default_home())
    store, photographs = ProjectPhotographs(project), dict[str, StoredFile]()
    for which in CAMERAS if folder == PHOTOGRAPHS else ():
        for name, content in _photographs(which):
            photographs[f"{which}/{name}"] = store.keep(f"{which}/{name}", content)
    with disk_errors(f"{folder} cannot be read"):
        files = {name: (folder / name).read_bytes() for name in names}
    give_dataset(project, files, source, photographs)
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
    for camera in ProjectGiven(project).cameras:
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


def begin_buttons() -> None:
    """The two ways to begin, large: with one's own data, or with the real recording."""
    st.html(LARGE)
    own_data, sample = st.columns(2)
    with own_data:
        if st.button("Start with my own data", key="begin", type="primary", width="stretch"):
            forget_project()
            st.switch_page("pages/data.py")
    with sample:
        _sample_button("recording", "Try it: open the real recording", real_recording, True)


def other_beginnings() -> None:
    """The other samples and the plan, a line each; all samples open on any page."""
    samples = [
        ("demo_photographs", "Sample photographs", sample_photographs, "of a bar and of boards"),
        ("demo_rig", "Three cameras", three_cameras, "a real recording by more than two"),
        ("demo", "Simulated rig", sample_points, "25 bars, as in the paper"),
    ]
    for key, label, make, caption in samples[0 if has_sample_photographs() else 1 :]:
        with st.container(horizontal=True, vertical_alignment="center"):
            _sample_button(key, label, make)
            st.caption(caption)
    with st.container(horizontal=True, vertical_alignment="center"):
        if st.button("Plan a field day", key="begin_plan"):
            forget_project()
            st.switch_page("pages/plan.py")
        st.caption("before you record")


def _sample_button(key: str, label: str, make: Callable[[], Project], large: bool = False) -> None:
    """A button that opens a sample's project; a click may end the run of the page."""
    making, opening = projects_in_creation(), partial(_opened_or_made, key, make)
    width: Literal["stretch", "content"] = "stretch" if large else "content"
    st.button(label, key=key, on_click=lambda: making.append(pool().submit(opening)), width=width)


def _opened_or_made(key: str, make: Callable[[], Project]) -> Project:
    """The project of a sample that is there, if nobody has changed what it holds; else a new one.

    On a shared server it may be another person's, and is made again.
    """
    if not ServerSettings.from_environment().shared:
        for project_id in find_projects(default_home()):
            with suppress(StereocalError, OSError):
                opened = Project.open(default_home(), project_id)
                if opened.settings.get(SAMPLE) == [key, opened.given_digest]:
                    return opened
    project = make()
    project.keep_settings({SAMPLE: [key, project.given_digest]})
    return project


def load_sample_boards() -> None:
    """Add the sample's board photographs to the open project or a new one (a callback)."""
    with refusing():
        _give_boards(project_to_write())


def _give_boards(project: Project) -> None:
    for which in CAMERAS:
        store = ProjectLens(project, which)
        photographs = _photographs(f"boards_{which}")
        store.add({name: store.keep(name, content) for name, content in photographs})


def _photographs(folder: str) -> Iterator[tuple[str, bytes]]:
    for path in sorted((PHOTOGRAPHS / folder).iterdir()):
        if is_photograph(path.name):
            yield path.name, path.read_bytes()
