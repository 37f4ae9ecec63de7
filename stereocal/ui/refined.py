"""The refined method: its form, its results, cached by data set and settings, and which set to use.

Answers about long recordings are computed in jobs, because no draw of a page may wait for them.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import streamlit as st

from stereocal.calibration.methods import CalibrationSettings, Method
from stereocal.errors import StereocalError
from stereocal.formats.evaluation_files import Evaluation
from stereocal.projects.application import Use
from stereocal.projects.project import Project
from stereocal.projects.recording import REFINED
from stereocal.refined.refine import RefinedResult, refine, settings_for
from stereocal.refined.results import Calibration
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.camera import CAMERAS, CameraName
from stereocal.rig.dataset import Dataset
from stereocal.system.latest import Latest
from stereocal.ui import jobs
from stereocal.ui.fields import Field, Number, one_of, setting
from stereocal.ui.forms import search_values
from stereocal.ui.lengths import describe_uncertainties
from stereocal.ui.messages import readable
from stereocal.ui.screening import is_long
from stereocal.ui.texts import REFINED_SET, escape_markdown
from stereocal.verdict.forecast import Outlook, outlook_of
from stereocal.verdict.tradeoff import TradeOff, trade_off
from stereocal.workflow import Answer, answer

MOST_ANSWERS = 32
"""More than people at work at once; one takes 12 to 18 MB."""
ANSWER_STEPS = ("refined", "forecast")
PAPERS: Mapping[Use, Method] = {"matching": "2d", "measuring": "3d"}


def key_of(*about: object) -> str:
    """Identifies what a kept result was made of: equal for equal content.

    Includes name and notes of a data set: another project with equal numbers must not show them.
    """
    content = [BY_CONTENT[type(one)](one) if type(one) in BY_CONTENT else one for one in about]
    return json.dumps(content, sort_keys=True)


def _of_calibration(found: Calibration) -> list[Any]:
    poses = [[*own.pose.angles, own.pose.baseline] for own in found.methods.values()]
    refined = found.refined and [found.refined.settings.to_json(), found.refined.q.tolist()]
    about = found.dataset.identity, found.settings.to_json(), found.frames.tolist()
    return [*about, poses, refined]


BY_CONTENT: dict[str | type, Callable[[Any], Any]] = {
    Dataset: lambda dataset: dataset.identity,
    RefineSettings: RefineSettings.to_json,
    CalibrationSettings: CalibrationSettings.to_json,
    Calibration: _of_calibration,
    Evaluation: lambda evaluation: evaluation.settings.to_json(),
}
"""What tells inputs of kept results apart: Streamlit would hash only a sample of large arrays."""


@st.cache_resource(show_spinner="Forecasting.", max_entries=MOST_ANSWERS, hash_funcs=BY_CONTENT)
def outlook_for(calibration: Calibration) -> Outlook | None:
    """What the files of a calibration with its refined set will do; None if that is unknown."""
    return jobs.compute(outlook_of, calibration)


def refine_form(project: Project, dataset: Dataset) -> None:
    """The form of the refined method: uncertainties from the Data page, and the image noise."""
    st.markdown("**The refined set**")
    if project.settings.get(REFINED) is not None:
        st.caption("The refined set is the rig's: its lenses, lengths and noise are set there.")
        return
    st.caption(REFINED_SET)
    st.caption(escape_markdown(describe_uncertainties(dataset)))
    st.page_link("pages/data.py", label="State it on the Data page")
    noise, free = _fields(project)
    title, none = "Estimate the distortion of", "no camera: as its file says"
    told = "k1, k2, p1 and p2, from the images of the bar. Needs bars out to the image borders."
    st.multiselect(title, CAMERAS, placeholder=none, help=told, **free.widget())
    noise.number_input("Noise of an image point, px", help="0: found from the images.")


def refine_settings(project: Project, dataset: Dataset) -> RefineSettings:
    """The settings of the refined method, also for pages that do not show the form.

    They hold the uncertainties of the lengths, which a data set's digest does not cover. Those of a
    pair of a rig hold what the rig says.
    """
    of_rig = project.settings.get(REFINED)
    if of_rig is not None:
        return RefineSettings.from_json(of_rig)
    search, (noise, free) = search_values(project), _fields(project)
    return RefineSettings(
        baseline_sigma_m=dataset.baseline_sigma_m,
        distance_sigma_m=dataset.target_distance_sigma_m,
        sigma_px=noise.value() or None,
        free_distortion=tuple(free.value()),
        time_offset=search["time_offset"],
        time_drift=search["time_drift"],
    )


def settings_of_result(project: Project, calibration: Calibration) -> RefineSettings:
    """The settings of the refined set of a result: those it was made with, whatever changed."""
    if calibration.refined is not None:
        return calibration.refined.settings
    return refine_settings(project, calibration.dataset)


def _fields(project: Project) -> tuple[Field, Field]:
    """The image noise, and the cameras whose distortion is free, in the order of `CAMERAS`."""
    noise = setting(project, "refine_sigma_px", 0.0, Number(0.0, 1e5))

    def in_order(value: Any) -> list[CameraName]:
        return [name for name in CAMERAS if name in value]

    return noise, setting(project, "free_distortion", [], in_order)


@st.cache_resource(show_spinner="Refining.", max_entries=16, hash_funcs=BY_CONTENT)
def refined_of(dataset: Dataset, settings: RefineSettings) -> RefinedResult:
    """The refined set. Raises as `refine`."""
    return jobs.compute(refine, dataset, settings)


def refined_for(calibration: Calibration, settings: RefineSettings) -> RefinedResult | None:
    """The refined set of a calibration's frames, stored or computed; None if it has none."""
    stored, dataset = calibration.refined, calibration.fitted
    if stored is not None and stored.settings == settings_for(dataset, settings):
        return stored
    try:
        return refined_of(dataset, settings)
    except StereocalError:
        return None


def answer_of(project: Project, calibration: Calibration) -> Answer | None:
    """What the last result of a project tells; None while a job validates it."""
    make = answer_maker(project, calibration)
    with st.spinner("Forecasting."):
        return None if make is None else make()


def answer_maker(project: Project, calibration: Calibration) -> partial[Answer] | None:
    """As `answer_of`, for a download: without a page when it is called.

    The validation gives the threshold: what is shown or downloaded before would be of another one.
    """
    if jobs.is_running(project, "calibration"):
        return None
    settings = settings_of_result(project, calibration)
    evaluation = readable(lambda: project.calibration_evaluation)
    return partial(answer_for, calibration, settings, evaluation)


def wait_for_answer(project: Project) -> bool:
    """Show the job that validates the last result; False if none runs."""
    if not jobs.is_running(project, "calibration"):
        return False
    st.info("The calibration is being validated: its files come with their thresholds.")
    jobs.show_job(project, "calibration", "Cancelled: the result has no validation.")
    return True


def answer_for(
    calibration: Calibration,
    settings: RefineSettings,
    evaluation: Evaluation | None,
    step: Callable[[str], None] = lambda _: None,
) -> Answer:
    """What a stored calibration and its validation tell, with the refined set of its frames.

    Args:
        step: called with the name of each of `ANSWER_STEPS` when it starts.
    """

    def make() -> Answer:
        step("refined")
        whole = replace(calibration, refined=refined_for(calibration, settings))
        step("forecast")
        outlook = None if whole.refined is None else outlook_for(whole)
        return jobs.compute(answer, whole, outlook, evaluation)

    # A result knows the settings with what they leave open filled in.
    filled = settings_for(calibration.fitted, settings)
    found: Answer = _made().once(key_of(calibration, filled, evaluation), make)
    return found


def answer_when_ready(project: Project, calibration: Calibration) -> Answer | None:
    """What the stored result tells: at once, or for a long recording from a job, which is shown.

    Returns:
        None while the job runs, or if it did not come to its end.
    """
    make = answer_maker(project, calibration) if is_long(calibration.dataset) else None
    if make is None:
        return answer_of(project, calibration)

    def run(job: jobs.Job) -> bool:
        def step(name: str) -> None:
            job.progress(ANSWER_STEPS.index(name), len(ANSWER_STEPS))

        found = make(step=step)
        # For a look of Calibrate, which shows it: 9 s for 20,000 frames.
        return found.outlook is None or bool(found.outlook.advice)

    made: Answer | None = _when_made(project, "answer", "steps", key_of(*make.args), run)
    return made


def _when_made(
    project: Project,
    kind: jobs.Kind,
    counted: str,
    key: str,
    run: Callable[[jobs.Job], bool | None],
) -> Any:
    """What is made already; else its job is started, unless it has failed or was cancelled."""
    found = _made().get(key)
    if found is not None:
        return found
    work = jobs.Work(project, kind, (counted,), run)
    last = jobs.job_of(work.project, work.kind)
    ended = last is not None and last.state in ("failed", "cancelled")
    if not ended:  # what was made is kept in memory: after a restart it is made again
        jobs.start(work)
    jobs.show_job(work.project, work.kind, "Cancelled.")
    if ended:
        jobs.start_button(work, "Compute it", f"again_{work.kind}", primary=False)
    return None


@st.cache_resource(show_spinner=False)
def _made() -> Latest[Any]:
    """The last answers and trade-offs, by all that they depend on; jobs make them too."""
    return Latest(2 * MOST_ANSWERS)


def curves_when_ready(
    project: Project, dataset: Dataset, settings: RefineSettings
) -> TradeOff | None:
    """The trade-off: at once, or for a long recording from a job, as in `answer_when_ready`."""
    key = key_of(dataset, settings)
    found: TradeOff | None

    def trace(**how: Any) -> TradeOff:
        return jobs.compute(trade_off, dataset, settings, **how)

    if not is_long(dataset):
        with st.spinner("Tracing the trade-off."):
            found = _made().once(key, trace)
        return found

    def run(job: jobs.Job) -> None:
        _made().keep(key, trace(progress=job.progress))

    found = _when_made(project, "trade_off", "fits", key, run)
    return found


def set_in_use(project: Project, use: Use, answer: Answer) -> Field:
    """The set of a result to match or to measure with: as recommended until the user chooses."""
    return setting(project, f"apply_{use}", answer.recommendation.use[use], one_of([*answer.sets]))
