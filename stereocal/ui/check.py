"""The Check page: parameters and new images, the answer, and the repaired parameters."""

import hashlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.calibration.methods import METHOD_NAMES, Method
from stereocal.field.checking import check_words
from stereocal.field.checking.findings import Recheck
from stereocal.field.checking.fits import Smallest
from stereocal.field.checking.new_images import NewImages
from stereocal.field.checking.prior import prior_of
from stereocal.field.checking.recheck import recheck
from stereocal.field.checking.repair import REPAIRED, Residuals, repaired_parameters, residuals_of
from stereocal.field.checking.rig_check import RigCheck, check_rig
from stereocal.figures.frame_errors import describe_check, plot_check
from stereocal.formats.dataset_files import TABLE
from stereocal.formats.inputs import images_in, recording_in
from stereocal.formats.recording_files import POINTS
from stereocal.matching.application import PAIRS
from stereocal.matching.point_noise import PointNoise, noise_of_calibration
from stereocal.network.pairs import pair_name
from stereocal.network.rig_file import RigFile, is_rig
from stereocal.projects.application import PARAMETERS, USES, ProjectApplication, ProjectCheck
from stereocal.projects.files import StoredFile
from stereocal.projects.project import Project
from stereocal.projects.recording import ProjectRecording
from stereocal.rig.parameters import RigParameters
from stereocal.rig.recording import Recording
from stereocal.ui import jobs
from stereocal.ui.apply_points import ask_noise, noise_field
from stereocal.ui.check_images import Seen, new_images
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Number, choose, setting
from stereocal.ui.figure import show_figure
from stereocal.ui.intake import take_one
from stereocal.ui.messages import button, end_here, show_refusal
from stereocal.ui.parameter_files import APPLY_SETS, Source
from stereocal.ui.texts import escape_markdown

Parameters = RigParameters | RigFile
OF_PAIR = "New bars or matched points: photographs, videos, a zip, or a table"
OF_RIG = "New bars: photographs of all cameras, a zip, or a table"
VERDICTS = {"moved": st.warning, "same": st.success, "cannot tell": st.info}


@dataclass(frozen=True, eq=False)
class CheckInputs:
    """The inputs of a check, complete."""

    project: Project
    rig: Parameters
    parameters: StoredFile | None
    """The parameter file as given; None for a set of the project."""
    images: NewImages | Recording
    """A recording is checked with a rig."""
    smallest: Smallest
    digest: str
    """Identifies parameters and images, as given, and what is stated of them."""


def choose_check_inputs(project: Project) -> CheckInputs | None:
    """The parameters, and the place for new images; None if something is missing."""
    store, given = ProjectCheck(project), ProjectCheck(project).file(PARAMETERS)
    recording, source = ProjectRecording(project), Source(project, "check_parameters")
    whole = project.pair is None and recording.is_given
    of_rig = whole or (project.pair is None and given is not None and is_rig(given.read_bytes()))
    left, *sizes = st.columns([3, 2, 2])
    own = not of_rig and source.is_project
    file = None if whole or own else given
    rig: Parameters | None = recording.rig
    used = "this project's rig"
    if whole and rig is None:
        st.info("The cameras are not calibrated yet.")
        st.page_link("pages/rig.py", label="Calibrate all on the page Rig")
        end_here()
    if not whole:
        rig, used = _own_set(source) if own else _set_in(file)
    left.caption(f"Parameters  \nIn use: {escape_markdown(used)}")
    smallest = ask_smallest(project, *sizes)
    if not whole:
        with st.expander("Parameters from a file", expanded=rig is None):
            if of_rig or source.asks_for_files():
                title = "Parameters: parameters_refined.json, or rig.json"
                upload = st.file_uploader(title, type=["json"], key="upload_check_parameters")
                take_one(upload, store.keep_parameters)
    result = None if of_rig else ProjectApplication(project).result
    pairs = result[1].get(PAIRS) if result is not None else None
    matched = None if pairs is None else (f"{PAIRS} of Apply", pairs.read_bytes())
    new = new_images(_seen(store, rig, of_rig), matched)
    show_refusal()
    if rig is None:
        source.tell_missing("the parameters of the rig")
    if new is None:
        bars = "that two cameras or more see (five are a good start)."
        points = "(five are a good start), or matched points without lengths (50 are a good start)."
        st.info(f"Still missing: new bars {bars if of_rig else points}")
    if rig is None or new is None:
        return None
    digest = hashlib.sha256(f"{rig.digest} {new[0]} ".encode() + new[1]).hexdigest()
    images = _images_of(digest, rig, *new)
    if isinstance(images, NewImages) and isinstance(rig, RigParameters) and not images.bars:
        known = PointNoise(images.stated_px, "columns") if images.stated_px else None
        usual = known or noise_of_calibration(rig) or ""
        otherwise = (
            "by the columns that Apply writes, else as exact as the targets of the calibration"
        )
        stated = ask_noise(noise_field(project, "check_sigma_px"), usual, otherwise)
        images, digest = images.stating(stated), f"{digest} {stated}"
    return CheckInputs(project, rig, file, images, smallest, digest)


def _set_in(given: StoredFile | None) -> tuple[Parameters | None, str]:
    """The parameters in a file, and what they are called."""
    if given is None:
        return None, "none yet"
    content = given.read_bytes()
    kind = RigFile if is_rig(content) else RigParameters
    return kind.loads(content, given.label), given.label


def _own_set(source: Source) -> tuple[Parameters | None, str]:
    """The same of the project's results."""
    answer = source.answer()
    if answer is None:
        return None, "none yet"
    # Of one calibration, the refined set knows the rig best; if it moved, none holds.
    method: Method = "refined" if "refined" in answer.sets else "2d"
    return answer.sets[method], f"this project's {METHOD_NAMES[method].lower()}"


def _seen(store: ProjectCheck, rig: Parameters | None, of_rig: bool) -> Seen:
    """Who takes new images; before there are parameters, files only."""
    cameras = {} if rig is None else {name: own.camera for name, own in rig.placed.items()}
    length: float | None = None
    if isinstance(rig, RigFile):
        length = rig.object.longest_m if rig.object else None
    elif rig is not None and isinstance(stated := rig.inputs.get("target_distance_m"), float):
        length = stated

    def keep(name: str, content: bytes) -> None:
        store.keep_images(name, content, rig)

    table, title = (POINTS, OF_RIG) if of_rig else (TABLE, OF_PAIR)
    return Seen(store, cameras, length, keep, table, title)


def ask_smallest(project: Project, left: DeltaGenerator, right: DeltaGenerator) -> Smallest:
    """The fields of the smallest movement that matters."""
    usual, told = Smallest(), "“Same” is reported only if such a {} would have been found."
    degrees = round(float(np.degrees(usual.turn_rad)), 6)
    turn = setting(project, "check_turn_deg", degrees, Number(0.001, 90.0)).number_input(
        "Turn that matters (°)", left, step=0.05, help=told.format("turn")
    )
    told = f"{told.format('change of the baseline')} Matched points alone do not show it."
    percent = 100 * usual.baseline
    change = setting(project, "check_baseline_percent", percent, Number(0.001, 50.0)).number_input(
        "Baseline change (%)", right, step=0.1, help=told
    )
    return Smallest(float(np.radians(turn)), change / 100)


def show_check(chosen: CheckInputs) -> None:
    """The answer as a sentence, the errors frame by frame, the repaired parameters."""
    found, residuals = _checked(chosen)
    if isinstance(found, RigCheck):
        VERDICTS[found.verdict](escape_markdown(found.sentence))
        _show_notes(found.notes)
        pairs = {pair_name(pair): own for pair, own in found.pairs.items()}
        changed = next((name for name, own in pairs.items() if own.changed), next(iter(pairs)))
        pair = choose(None, "check_pair", "Errors of the pair", pairs, changed)
        _show_residuals(pairs[pair], residuals[pair])
        return
    VERDICTS[found.verdict](escape_markdown(check_words.sentence(found)))
    _show_residuals(found, residuals[""])
    if found.offers_repair:
        given = chosen.parameters

        def repaired() -> str:
            sha256 = None if given is None else given.sha256
            return repaired_parameters(found, sha256).dumps()

        with st.container(horizontal=True):
            label, used = "Use the repaired parameters", _are_in_use(chosen.project, repaired)
            button(label, "use_repaired", _use, chosen.project, repaired, first=not used)
            offer(f"{REPAIRED} · for both", repaired, REPAIRED, "download_repaired")
        apply = "In use: Apply matches and measures with the repaired parameters."
        until = "To match and to measure on the page Apply, until the rig is calibrated again."
        st.caption(apply if used else until)
    _show_notes(check_words.notes(found))


def _show_notes(notes: Iterable[str]) -> None:
    for note in notes:
        st.caption(escape_markdown(note))


def _show_residuals(found: Recheck, residuals: Residuals) -> None:
    since = found.since if found.changed else None
    show_figure(plot_check(residuals, since), describe_check(residuals, since), "check_residuals")


def _use(project: Project, repaired: Callable[[], str]) -> None:
    """Have Apply match and measure with the repaired parameters."""
    store, content = ProjectApplication(project), repaired().encode()
    for use in USES:
        store.keep_set(use, REPAIRED, content)
    Source(project, APPLY_SETS).use_files()


def _are_in_use(project: Project, repaired: Callable[[], str]) -> bool:
    """By content: the repair of other images has the same name."""
    if Source(project, APPLY_SETS).is_project:
        return False
    given = {each and each[1].digest for each in map(ProjectApplication(project).set_of, USES)}
    return given == {RigParameters.loads(repaired(), REPAIRED).digest}


@st.cache_resource(
    show_spinner="Checking.",
    max_entries=16,
    hash_funcs={CheckInputs: lambda chosen: (chosen.digest, chosen.smallest)},
)
def _checked(chosen: CheckInputs) -> tuple[Recheck | RigCheck, dict[str, Residuals]]:
    """The answer, and the errors by pair; of two cameras the only pair has no name."""
    rig, images = chosen.rig, chosen.images
    if isinstance(rig, RigFile):
        assert isinstance(images, Recording)
        of_rig = jobs.compute(check_rig, rig, images, chosen.smallest)
        return of_rig, {pair_name(each): residuals_of(own) for each, own in of_rig.pairs.items()}
    assert isinstance(images, NewImages)
    found = jobs.compute(recheck, prior_of(rig), images, chosen.smallest)
    return found, {"": residuals_of(found)}


@st.cache_resource(show_spinner="Reading.", max_entries=16)
def _images_of(key: str, _rig: Parameters, _label: str, _content: bytes) -> NewImages | Recording:
    assert key
    if isinstance(_rig, RigFile):
        return recording_in(_content, _label, _rig)
    return images_in(_content, _label, _rig)
