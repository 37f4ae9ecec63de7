"""The Check page: parameters and new images, the answer, and the repaired parameters."""

import hashlib
from dataclasses import dataclass

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
from stereocal.formats.inputs import images_in
from stereocal.matching.application import PAIRS, digest_of
from stereocal.matching.point_noise import PointNoise, noise_of_calibration
from stereocal.projects.application import IMAGES, PARAMETERS, ProjectApplication, ProjectCheck
from stereocal.projects.project import Project
from stereocal.rig.parameters import RigParameters
from stereocal.ui import jobs
from stereocal.ui.apply_threshold import ask_noise, noise_field
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Field, Number, one_of, setting
from stereocal.ui.figure import show_figure
from stereocal.ui.intake import take_one
from stereocal.ui.messages import show_refusal
from stereocal.ui.parameter_files import Source
from stereocal.ui.texts import escape_markdown

MATCHED, FILE = "The pairs of Apply", "A file"
TITLE = "New bars or matched points"
KINDS = ["zip", "csv", "txt", "tsv", "parquet"]
HELP = (
    "A data set as a zip with dataset.json; or a table of bars like correspondences.csv; or "
    "matched points alone, like pairs.csv of Apply. Five bars or 50 points are a good start."
)
VERDICTS = {"moved": st.warning, "same": st.success, "cannot tell": st.info}


@dataclass(frozen=True, eq=False)
class Chosen:
    """The inputs of a check, complete."""

    rig: RigParameters
    parameters: bytes | None
    """The parameter file as given; None for a set of the project."""
    images: NewImages
    digest: str
    """Of parameters and images, as given."""
    smallest: Smallest


def choose_inputs(project: Project) -> Chosen | None:
    """The inputs in one row, with uploaders for files; None if something is missing."""
    store, source = ProjectCheck(project), Source(project, "check_parameters")
    left, middle, *sizes = st.columns([3, 3, 2, 2])
    with left:
        found = _choose_parameters(source, store)
    with middle:
        kind, given = _choose_images(project, store)
        noise = st.container()
    smallest = _smallest(project, *sizes)
    rig = None if found is None else found[0]
    with st.expander("Parameters and new images from files", expanded=rig is None or not given):
        if source.asks_for_files():
            upload = st.file_uploader(
                "Parameters: parameters_refined.json", type=["json"], key="upload_check_parameters"
            )
            take_one(upload, store.keep_parameters)
        if kind.value() == FILE:
            upload = st.file_uploader(TITLE, type=KINDS, key="upload_check_images", help=HELP)
            take_one(upload, lambda name, content: store.keep_images(name, content, rig))
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
    digest = hashlib.sha256(f"{digest_of(rig)} {label} ".encode() + content).hexdigest()
    images = _images_of(digest, rig, label, content)
    if not images.bars:
        known = PointNoise(images.stated_px, "columns") if images.stated_px else None
        usual = known or noise_of_calibration(rig) or ""
        otherwise = (
            "by the columns that Apply writes, else as exact as the targets of the calibration"
        )
        with noise:
            stated = ask_noise(noise_field(project, "check_sigma_px"), usual, otherwise)
        images = images.stating(stated)
    return Chosen(rig, parameters, images, digest, smallest)


def _choose_images(project: Project, store: ProjectCheck) -> tuple[Field, tuple[str, bytes] | None]:
    """The choice, and name and content of the new images; None if there are none."""
    result = ProjectApplication(project).result
    kinds = [MATCHED, FILE] if result else [FILE]
    usual = FILE if store.file(IMAGES) else kinds[0]
    kind = setting(project, "check_images", usual, one_of(kinds))
    if result is not None:
        st.selectbox(TITLE, kinds, **kind.widget())
    if result is not None and kind.value() == MATCHED:
        return kind, (f"{PAIRS} of Apply", result[1][PAIRS].read_bytes())
    return kind, _file_in_use("" if result else TITLE, store, IMAGES)


def _file_in_use(title: str, store: ProjectCheck, name: str) -> tuple[str, bytes] | None:
    given = store.file(name)
    used = f"In use: {escape_markdown(given.label) if given else 'none yet'}"
    st.caption(f"{title}  \n{used}" if title else used)
    return None if given is None else (given.label, given.read_bytes())


def _choose_parameters(
    source: Source, store: ProjectCheck
) -> tuple[RigParameters, bytes | None] | None:
    """The parameters to check, and their file unless they are the project's."""
    if not source.is_project:
        given = _file_in_use("Parameters", store, PARAMETERS)
        return None if given is None else (RigParameters.loads(given[1], given[0]), given[1])
    answer = source.answer()
    if answer is None:
        return None
    # Of one calibration, the refined set knows the rig best; if it moved, none holds.
    method: Method = "refined" if "refined" in answer.sets else "2d"
    st.caption(f"Parameters  \nIn use: this project's {METHOD_NAMES[method].lower()}")
    return answer.sets[method], None


def _smallest(project: Project, left: DeltaGenerator, right: DeltaGenerator) -> Smallest:
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

        offer(f"{REPAIRED} · for both", repaired, REPAIRED, "download_repaired", primary=True)
        st.caption(
            "To match and to measure, until the rig is calibrated again. On the Apply page, give "
            "it as a parameter file."
        )
    for note in notes(found):
        st.caption(escape_markdown(note))


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
