"""The Check page: parameters and new images, the answer, and the repaired parameters."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.calibration.methods import METHOD_NAMES, Method
from stereocal.field.checking.check_words import notes, sentence
from stereocal.field.checking.findings import Recheck
from stereocal.field.checking.fits import Smallest
from stereocal.field.checking.new_images import NewImages
from stereocal.field.checking.prior import prior_of
from stereocal.field.checking.recheck import recheck
from stereocal.field.checking.repair import REPAIRED, Residuals, repaired_parameters, residuals_of
from stereocal.figures.check_residuals import describe_check, plot_check
from stereocal.formats.dataset_files import TABLE
from stereocal.formats.inputs import images_in
from stereocal.matching.application import PAIRS
from stereocal.matching.point_noise import PointNoise, noise_of_calibration
from stereocal.projects.application import PARAMETERS, USES, ProjectApplication, ProjectCheck
from stereocal.projects.project import Project
from stereocal.rig.parameters import RigParameters
from stereocal.ui import jobs
from stereocal.ui.apply_threshold import ask_noise, noise_field
from stereocal.ui.check_images import Seen, new_images
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Number, setting
from stereocal.ui.figure import show_figure
from stereocal.ui.intake import take_one
from stereocal.ui.menu import button_type
from stereocal.ui.messages import callback, show_refusal
from stereocal.ui.parameter_files import APPLY_SETS, Source
from stereocal.ui.texts import escape_markdown

TITLE = "New bars or matched points: photographs, videos, a zip, or a table"
VERDICTS = {"moved": st.warning, "same": st.success, "cannot tell": st.info}


@dataclass(frozen=True, eq=False)
class Chosen:
    """The inputs of a check, complete."""

    project: Project
    rig: RigParameters
    parameters: bytes | None
    """The parameter file as given; None for a set of the project."""
    images: NewImages
    digest: str
    """Of parameters and images, as given."""
    smallest: Smallest


def choose_inputs(project: Project) -> Chosen | None:
    """The parameters, and the place for new images; None if something is missing."""
    store, source = ProjectCheck(project), Source(project, "check_parameters")
    left, *sizes = st.columns([3, 2, 2])
    with left:
        found = _choose_parameters(source, store)
    smallest = ask_smallest(project, *sizes)
    rig = None if found is None else found[0]
    with st.expander("Parameters from a file", expanded=rig is None):
        if source.asks_for_files():
            take_parameters(store)
    result = ProjectApplication(project).result
    pairs = result[1].get(PAIRS) if result is not None else None
    matched = None if pairs is None else (f"{PAIRS} of Apply", pairs.read_bytes())
    given = new_images(_seen(store, rig), matched)
    show_refusal()
    if found is None:
        source.tell_missing("the parameters of the rig")
    if given is None:
        st.info(
            "Still missing: new bars (five are a good start), or matched points without lengths "
            "(50 are a good start)."
        )
    if found is None or given is None:
        return None
    (rig, parameters), (label, content) = found, given
    digest = hashlib.sha256(f"{rig.digest} {label} ".encode() + content).hexdigest()
    images = _images_of(digest, rig, label, content)
    if not images.bars:
        known = PointNoise(images.stated_px, "columns") if images.stated_px else None
        usual = known or noise_of_calibration(rig) or ""
        otherwise = (
            "by the columns that Apply writes, else as exact as the targets of the calibration"
        )
        stated = ask_noise(noise_field(project, "check_sigma_px"), usual, otherwise)
        images = images.stating(stated)
    return Chosen(project, rig, parameters, images, digest, smallest)


def take_parameters(store: ProjectCheck) -> None:
    """The uploader of a parameter file, or of a rig's."""
    title = "Parameters: parameters_refined.json, or rig.json"
    upload = st.file_uploader(title, type=["json"], key="upload_check_parameters")
    take_one(upload, store.keep_parameters)


def _seen(store: ProjectCheck, rig: RigParameters | None) -> Seen:
    """Who takes new images; before there are parameters, files only."""
    cameras = {} if rig is None else {name: own.camera for name, own in rig.placed.items()}
    length = None if rig is None else rig.inputs.get("target_distance_m")

    def keep(name: str, content: bytes) -> None:
        store.keep_images(name, content, rig)

    return Seen(store, cameras, length if isinstance(length, float) else None, keep, TABLE, TITLE)


def _choose_parameters(
    source: Source, store: ProjectCheck
) -> tuple[RigParameters, bytes | None] | None:
    """The parameters to check, and their file unless they are the project's."""
    if not source.is_project:
        given = store.file(PARAMETERS)
        used = escape_markdown(given.label) if given else "none yet"
        st.caption(f"Parameters  \nIn use: {used}")
        if given is None:
            return None
        content = given.read_bytes()
        return RigParameters.loads(content, given.label), content
    answer = source.answer()
    if answer is None:
        return None
    # Of one calibration, the refined set knows the rig best; if it moved, none holds.
    method: Method = "refined" if "refined" in answer.sets else "2d"
    st.caption(f"Parameters  \nIn use: this project's {METHOD_NAMES[method].lower()}")
    return answer.sets[method], None


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


def show_check(chosen: Chosen) -> None:
    """The answer as a sentence, the errors frame by frame, the repaired parameters."""
    found, residuals = _checked(chosen)
    VERDICTS[found.verdict](escape_markdown(sentence(found)))
    since = found.since if found.changed else None
    show_figure(plot_check(residuals, since), describe_check(residuals, since), "check_residuals")
    if found.offers_repair:
        given = chosen.parameters

        def repaired() -> str:
            sha256 = None if given is None else hashlib.sha256(given).hexdigest()
            return repaired_parameters(found, sha256).dumps()

        with st.container(horizontal=True):
            use = callback(partial(_use, chosen.project, repaired))
            label, used = "Use the repaired parameters", _are_in_use(chosen.project, repaired)
            st.button(label, type=button_type(not used), key="use_repaired", on_click=use)
            offer(f"{REPAIRED} · for both", repaired, REPAIRED, "download_repaired")
        apply = "In use: Apply matches and measures with the repaired parameters."
        until = "To match and to measure on the page Apply, until the rig is calibrated again."
        st.caption(apply if used else until)
    for note in notes(found):
        st.caption(escape_markdown(note))


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
    hash_funcs={Chosen: lambda one: (one.digest, one.images.stated_px, one.smallest)},
)
def _checked(chosen: Chosen) -> tuple[Recheck, Residuals]:
    found = jobs.compute(recheck, prior_of(chosen.rig), chosen.images, chosen.smallest)
    return found, residuals_of(found)


@st.cache_resource(show_spinner="Reading.", max_entries=16)
def _images_of(key: str, _rig: RigParameters, _label: str, _content: bytes) -> NewImages:
    assert key
    return images_in(_content, _label, _rig)
