"""The Check page of a rig of three cameras and more: which camera has moved?"""

import hashlib
from dataclasses import dataclass

import streamlit as st

from stereocal.field.checking.fits import Smallest
from stereocal.field.checking.repair import Residuals, residuals_of
from stereocal.field.checking.rig_check import RigCheck, check_rig
from stereocal.figures.check_residuals import describe_check, plot_check
from stereocal.formats.inputs import recording_in
from stereocal.formats.recording_files import POINTS
from stereocal.network.pairs import pair_name
from stereocal.network.rig_file import RigFile, is_rig
from stereocal.projects.application import PARAMETERS, ProjectCheck
from stereocal.projects.project import Project
from stereocal.projects.recording import ProjectRecording
from stereocal.rig.recording import Recording
from stereocal.ui import jobs
from stereocal.ui.check import VERDICTS, ask_smallest, take_parameters
from stereocal.ui.check_images import Given, Seen, new_images
from stereocal.ui.fields import choose
from stereocal.ui.figure import show_figure
from stereocal.ui.messages import show_refusal
from stereocal.ui.texts import escape_markdown

TITLE = "New bars: photographs of all cameras, a zip, or a table"


@dataclass(frozen=True, eq=False)
class Chosen:
    """The inputs of a check, complete."""

    rig: RigFile
    recording: Recording
    digest: str
    """Of both."""
    smallest: Smallest


def checks_rig(project: Project) -> bool:
    """Whether the page is of a rig: the project's, or one given as a file."""
    if project.pair is not None:
        return False
    given = ProjectCheck(project).file(PARAMETERS)
    return ProjectRecording(project).is_given or (given is not None and is_rig(given.read_bytes()))


def choose_inputs(project: Project) -> Chosen | None:
    """The rig, and the place for new images; None if something is missing."""
    store, recording = ProjectCheck(project), ProjectRecording(project)
    left, *sizes = st.columns([3, 2, 2])
    rig, given, label = recording.rig, store.file(PARAMETERS), "this project's rig"
    if not recording.is_given and given is not None:
        rig, label = RigFile.loads(given.read_bytes(), given.label), given.label
        with st.expander("Parameters from a file"):
            take_parameters(store)
    if rig is None:
        st.info("The cameras are not calibrated yet.")
        st.page_link("pages/rig.py", label="Calibrate all on the page Rig")
        return None
    left.caption(f"Parameters  \nIn use: {escape_markdown(label)}")
    smallest = ask_smallest(project, *sizes)
    new = new_images(_seen(store, rig))
    show_refusal()
    if new is None:
        st.info("Still missing: new bars that two cameras or more see (five are a good start).")
        return None
    digest = hashlib.sha256(f"{rig.digest} {new[0]} ".encode() + new[1]).hexdigest()
    return Chosen(rig, _recording(digest, rig, new), digest, smallest)


def _seen(store: ProjectCheck, rig: RigFile) -> Seen:
    own = rig.object
    length = None if own is None else own.longest_m

    def keep(name: str, content: bytes) -> None:
        store.keep_images(name, content, rig)

    return Seen(store, rig.cameras, length, keep, POINTS, TITLE)


def show_check(chosen: Chosen) -> None:
    """The answer as a sentence, what each pair says, and the errors of one of them."""
    found = _checked(chosen)
    VERDICTS[found.verdict](escape_markdown(found.sentence))
    for note in found.notes:
        st.caption(escape_markdown(note))
    pairs = {pair_name(pair): own for pair, own in found.pairs.items()}
    changed = next((name for name, own in pairs.items() if own.changed), next(iter(pairs)))
    pair = choose(None, "check_pair", "Errors of the pair", pairs, changed)
    since = pairs[pair].since if pairs[pair].changed else None
    residuals = _residuals(chosen, pair)
    show_figure(plot_check(residuals, since), describe_check(residuals, since), "check_residuals")


@st.cache_resource(
    show_spinner="Checking.",
    max_entries=16,
    hash_funcs={Chosen: lambda one: (one.digest, one.smallest)},
)
def _checked(chosen: Chosen) -> RigCheck:
    return jobs.compute(check_rig, chosen.rig, chosen.recording, chosen.smallest)


@st.cache_resource(
    show_spinner=False, max_entries=16, hash_funcs={Chosen: lambda one: (one.digest, one.smallest)}
)
def _residuals(chosen: Chosen, pair: str) -> Residuals:
    found = _checked(chosen).pairs
    return residuals_of(next(own for each, own in found.items() if pair_name(each) == pair))


@st.cache_resource(show_spinner="Reading.", max_entries=16)
def _recording(key: str, _rig: RigFile, _new: Given) -> Recording:
    assert key
    return recording_in(_new[1], _new[0], _rig)
