"""The Check page: parameters and new images, the answer, and the repaired parameters."""

from dataclasses import replace

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.calibration.methods import METHOD_NAMES, Method
from stereocal.field.checking.fits import Smallest
from stereocal.field.checking.repair import REPAIRED
from stereocal.field.checking.to_check import CheckAnswer
from stereocal.figures.frame_errors import describe_check, plot_check
from stereocal.fit.rig_file import Parameters, read_parameters
from stereocal.fit.start.pairs import pair_name
from stereocal.matching.views import PAIRS
from stereocal.projects.application import PARAMETERS, USES, ProjectApplication, ProjectCheck
from stereocal.projects.files import StoredFile
from stereocal.projects.project import Project
from stereocal.rig.parameters import RigParameters
from stereocal.system.latest import once_or_refused
from stereocal.ui import jobs
from stereocal.ui.apply_points import ask_noise, noise_field
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Number, choose, setting
from stereocal.ui.figure import show_figure
from stereocal.ui.intake import take_one
from stereocal.ui.messages import button, end_here, show_each, show_refusal
from stereocal.ui.new_images import NewImagesForm
from stereocal.ui.parameter_files import APPLY_SETS, Source
from stereocal.ui.rig import tell_not_calibrated
from stereocal.ui.texts import escape_markdown

VERDICTS = {"moved": st.warning, "same": st.success, "cannot tell": st.info}


def show_page(project: Project) -> None:
    """The parameters, and the place for new images; and the answer, unless something is missing."""
    store, source = ProjectCheck(project), Source(project, "check_parameters")
    whole = project.is_rig
    file = None if whole or source.is_project else store.file(PARAMETERS)
    left, middle, right = st.columns([3, 2, 2])
    rig, name = _in_use(project, source, file)
    left.caption(f"Parameters  \nIn use: {escape_markdown(name)}")
    smallest = ask_smallest(project, middle, right)
    if not whole:
        with st.expander("Parameters from a file", expanded=rig is None):
            if source.asks_for_files():
                title = "Parameters: parameters_refined.json, or rig.json"
                upload = st.file_uploader(title, type=["json"], key="upload_check_parameters")
                take_one(upload, store.keep_parameters)
    form = NewImagesForm(store, rig)
    images = form.choose(_matched(project))
    show_refusal()
    if rig is None:
        source.tell_missing("the parameters of the rig")
    if images is None:
        form.tell_missing()
    if rig is None or images is None:
        return
    with st.spinner("Reading."):
        to_check, stated = store.to_check(rig, images), None
    if to_check.of_points_alone:
        field = noise_field(project, "check_sigma_px")
        otherwise = (
            "by the columns that Apply writes, else as exact as the targets of the calibration"
        )
        stated = ask_noise(field, to_check.usual_noise or "", otherwise)
    sha256 = None if file is None else file.sha256
    with st.spinner("Checking."):
        answer = once_or_refused(
            "check",
            f"{rig.digest} {name} {sha256} {images.sha256} {images.label} {stated} {smallest}",
            lambda: jobs.compute(to_check.stating(stated).check, smallest, name, sha256),
        )
    _show_answer(project, answer)


def _in_use(
    project: Project, source: Source, file: StoredFile | None
) -> tuple[Parameters | None, str]:
    """The parameters to check, of a rig, of the results or of a file, and what they are called."""
    if project.is_rig:
        if (rig := project.rig) is None:
            tell_not_calibrated()
            end_here()
        return rig, "this project's rig"
    if source.is_project:
        if (answer := source.answer()) is not None:
            # Of one calibration, the refined set knows the rig best; if it moved, none holds.
            method: Method = "refined" if "refined" in answer.sets else "2d"
            return answer.sets[method], f"this project's {METHOD_NAMES[method].lower()}"
    elif file is not None:
        return read_parameters(file.read_bytes(), file.label), file.label
    return None, "none yet"


def _matched(project: Project) -> StoredFile | None:
    """The pairs of the page Apply."""
    result = ProjectApplication(project).result
    pairs = None if result is None else result[1].get(PAIRS)
    return None if pairs is None else replace(pairs, about=f"{PAIRS} of Apply")


def ask_smallest(project: Project, left: DeltaGenerator, right: DeltaGenerator) -> Smallest:
    """The fields of the smallest movement that matters."""
    usual, hint = Smallest(), "“Same” is reported only if such a {} would have been found."
    degrees = setting(project, "check_turn_deg", round(usual.turn_deg, 6), Number(0.001, 90.0))
    turn = degrees.number_input("Turn that matters (°)", left, step=0.05, help=hint.format("turn"))
    hint = f"{hint.format('change of the baseline')} Matched points alone do not show it."
    percent = setting(project, "check_baseline_percent", 100 * usual.baseline, Number(0.001, 50.0))
    change = percent.number_input("Baseline change (%)", right, step=0.1, help=hint)
    return Smallest.of(turn, change / 100)


def _show_answer(project: Project, answer: CheckAnswer) -> None:
    """The answer as a sentence, the errors frame by frame, the repaired parameters."""
    VERDICTS[answer.verdict](escape_markdown(answer.sentence))
    show_each(st.caption, answer.notes)
    pairs = {pair_name(pair): errors for pair, errors in answer.residuals.items()}
    chosen = next((name for name, errors in pairs.items() if errors.changed), next(iter(pairs)))
    if len(pairs) > 1:
        chosen = choose(None, "check_pair", "Errors of the pair", pairs, chosen)
    show_figure(plot_check(pairs[chosen]), describe_check(pairs[chosen]), "check_residuals")
    if answer.repaired is not None:
        _offer_repaired(project, answer.repaired)


def _offer_repaired(project: Project, repaired: RigParameters) -> None:
    """Their download, and the press that has Apply match and measure with them."""
    store, source = ProjectApplication(project), Source(project, APPLY_SETS)
    # By content: the repair of other images has the same name.
    digests = {stored and stored[1].digest for stored in map(store.set_of, USES)}
    in_use = not source.is_project and digests == {repaired.digest}

    def use() -> None:
        for purpose in USES:
            store.keep_set(purpose, REPAIRED, repaired.dumps().encode())
        source.use_files()

    with st.container(horizontal=True):
        button("Use the repaired parameters", "use_repaired", use, first=not in_use)
        offer(f"{REPAIRED} · for both", repaired.dumps, REPAIRED, "download_repaired")
    apply = "In use: Apply matches and measures with the repaired parameters."
    until = "To match and to measure on the page Apply, until the rig is calibrated again."
    st.caption(apply if in_use else until)
