"""The Check page: parameters and new images (a data set, a table, photographs or videos of any
cameras), the answer, and the repaired parameters."""

import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import PurePosixPath

import numpy as np
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.calibration.methods import METHOD_NAMES, Method
from stereocal.field.checking import check_words
from stereocal.field.checking.findings import Recheck
from stereocal.field.checking.fits import Smallest
from stereocal.field.checking.repair import REPAIRED, Residuals, repaired_parameters
from stereocal.field.checking.rig_check import RigCheck
from stereocal.field.checking.to_check import ToCheck
from stereocal.figures.frame_errors import describe_check, plot_check
from stereocal.fit.rig_file import Parameters, is_rig, read_parameters
from stereocal.fit.start.pairs import pair_name
from stereocal.formats.dataset_description import POINTS, TABLE
from stereocal.formats.dataset_files import pack_recording
from stereocal.formats.dropped import Dropped
from stereocal.frames.all_cameras import Found
from stereocal.matching.point_table import PARQUET
from stereocal.matching.views import PAIRS
from stereocal.projects.application import (
    IMAGES,
    PARAMETERS,
    USES,
    ProjectApplication,
    ProjectCheck,
)
from stereocal.projects.files import StoredFile
from stereocal.projects.given import ProjectGiven
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.rig.camera import Camera
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rigid_object import RigidObject
from stereocal.system.numbers import count
from stereocal.system.zip_files import pack_zip
from stereocal.ui import jobs
from stereocal.ui.apply_points import ask_noise, noise_field
from stereocal.ui.door import ask_whose, ask_whose_video, place_videos
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Number, choose, one_of, setting
from stereocal.ui.figure import show_figure
from stereocal.ui.holding import holds_board
from stereocal.ui.intake import drop_zone, take_one
from stereocal.ui.messages import button, end_here, readable, show_refusal
from stereocal.ui.parameter_files import APPLY_SETS, Source
from stereocal.ui.search import ask_held, press_search, search_work
from stereocal.ui.texts import escape_markdown
from stereocal.ui.videos import show_frames_taken, take_videos, video_settings
from stereocal.workflow.given import to_check

OF_PAIR = "New bars or matched points: photographs, videos, a zip, or a table"
OF_RIG = "New bars: photographs of all cameras, a zip, or a table"
VERDICTS = {"moved": st.warning, "same": st.success, "cannot tell": st.info}


def show_page(project: Project) -> None:
    """The parameters, and the place for new images; and the answer, unless something is missing."""
    store, given = ProjectCheck(project), ProjectCheck(project).file(PARAMETERS)
    source, whole = Source(project, "check_parameters"), project.is_rig
    of_rig = whole or (given is not None and is_rig(given.read_bytes()))
    left, *sizes = st.columns([3, 2, 2])
    own = not of_rig and source.is_project
    file = None if whole or own else given
    rig: Parameters | None = project.rig
    used = "this project's rig"
    if whole and rig is None:
        st.info("The cameras are not calibrated yet.")
        st.page_link("pages/calibrate.py", label="Calibrate them on the page Calibrate")
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
    new = new_images(Seen(store, rig, of_rig), matched)
    show_refusal()
    if rig is None:
        source.tell_missing("the parameters of the rig")
    if new is None:
        bars = "that two cameras or more see (five are a good start)."
        points = "(five are a good start), or matched points without lengths (50 are a good start)."
        st.info(f"Still missing: new bars {bars if of_rig else points}")
    if rig is None or new is None:
        return
    digest = hashlib.sha256(f"{rig.digest} {new[0]} ".encode() + new[1]).hexdigest()
    asked = _given(digest, rig, *new)
    if asked.of_points_alone:
        otherwise = (
            "by the columns that Apply writes, else as exact as the targets of the calibration"
        )
        field = noise_field(project, "check_sigma_px")
        stated = ask_noise(field, asked.usual_noise or "", otherwise)
        asked, digest = asked.stating(stated), f"{digest} {stated}"
    answer = _checked(digest, smallest, asked)
    _show_answer(project, *answer, None if file is None else file.sha256)


def _set_in(given: StoredFile | None) -> tuple[Parameters | None, str]:
    """The parameters in a file, and what they are called."""
    if given is None:
        return None, "none yet"
    return read_parameters(given.read_bytes(), given.label), given.label


def _own_set(source: Source) -> tuple[Parameters | None, str]:
    """The same of the project's results."""
    answer = source.answer()
    if answer is None:
        return None, "none yet"
    # Of one calibration, the refined set knows the rig best; if it moved, none holds.
    method: Method = "refined" if "refined" in answer.sets else "2d"
    return answer.sets[method], f"this project's {METHOD_NAMES[method].lower()}"


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


def _show_answer(
    project: Project,
    found: Recheck | RigCheck,
    residuals: Mapping[str, Residuals],
    sha256: str | None,
) -> None:
    """The answer as a sentence, the errors frame by frame, the repaired parameters.

    Args:
        sha256: of the parameter file as given; None for a set of the project.
    """
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

        def repaired() -> str:
            return repaired_parameters(found, sha256).dumps()

        with st.container(horizontal=True):
            label, used = "Use the repaired parameters", _are_in_use(project, repaired)
            button(label, "use_repaired", _use_repaired, project, repaired, first=not used)
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


def _use_repaired(project: Project, repaired: Callable[[], str]) -> None:
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


@st.cache_resource(show_spinner="Checking.", max_entries=16)
def _checked(
    key: str, smallest: Smallest, _given: ToCheck
) -> tuple[Recheck | RigCheck, Mapping[str, Residuals]]:
    assert key
    return jobs.compute(_given.check, smallest)


@st.cache_resource(show_spinner="Reading.", max_entries=16)
def _given(key: str, _rig: Parameters, _label: str, _content: bytes) -> ToCheck:
    assert key
    return to_check(_content, _label, _rig)


MATCHED, FILE = "The pairs of Apply", "A file"
CAN_BE_GIVEN = """
- **Photographs** of the bar or the board by all cameras, or a **video** of each of two.
- A **data set**: a zip or a folder with `dataset.json`.
- A **table** of bars like `{}`, or of matched points of two cameras alone, like `pairs.csv` of
  Apply.

Five bars or 50 points are a good start.
"""
FOUND_BY = "check_found_by"
OF_HELD = ("held", "board_")
"""What the names of settings begin with that say what is held."""
Given = tuple[str, bytes]


@dataclass(frozen=True, eq=False)
class Seen:
    """Who takes new images; before there are parameters, files only."""

    check: ProjectCheck
    rig: Parameters | None
    of_rig: bool

    @property
    def cameras(self) -> dict[str, Camera]:
        """By name."""
        placed = {} if self.rig is None else self.rig.placed
        return {name: own.camera for name, own in placed.items()}

    @property
    def length_m(self) -> float | None:
        """The bar that they were calibrated with, if it is known."""
        return None if self.rig is None else self.rig.length_m

    @property
    def photographs(self) -> ProjectPhotographs:
        """The new photographs."""
        return ProjectPhotographs(self.check.of_images)


def new_images(seen: Seen, matched: Given | None = None) -> Given | None:
    """The place for new images, and the name and content of those in use; None if there are none.

    Args:
        matched: pairs of Apply, which serve too.
    """
    project, given = seen.check.project, seen.check.file(IMAGES)
    kinds = [*([MATCHED] if matched else []), *([FILE] if given else [])]
    usual = FILE if given else MATCHED
    kind = setting(project, "check_images", usual, one_of(kinds or [FILE]))
    zone, whose = st.container(), st.container()
    with st.expander("What can I give?"):
        table, title = (POINTS, OF_RIG) if seen.of_rig else (TABLE, OF_PAIR)
        st.markdown(CAN_BE_GIVEN.format(table))
        own = seen.photographs.project
        use_videos = partial(take_videos, settings=video_settings(own), project=own)
    with zone:

        def take(given: Dropped[StoredFile]) -> None:
            given.use(partial(_take, seen, use_videos, given))

        drop_zone(title, "upload_check_images", seen.photographs.keep, take, tables=PARQUET)
    with whose:
        ask_whose(ProjectGiven(own))
        ask_whose_video(use_videos)
        show_frames_taken(own)
        _search(seen)
    if len(kinds) > 1:
        kind.menu("Check")
    if matched is not None and kind.value() == MATCHED:
        st.caption(f"In use: {escape_markdown(matched[0])}")
        return matched
    if given is None:
        return None
    st.caption(f"In use: {escape_markdown(given.label)}")
    return given.label, given.read_bytes()


def _take(seen: Seen, use_videos: Callable[..., None], given: Dropped[StoredFile]) -> None:
    """Use what was given: photographs and videos to be searched, or a file as it is."""
    own = ProjectGiven(seen.photographs.project)
    tables, data_set = given.of("table"), bool(given.of("data set"))
    has_points = any(PurePosixPath(name).suffix.lower() == ".csv" for name in given.files)
    if data_set and (has_points or not given.photographs):
        _use(seen, given.source, pack_zip(given.files))
    elif given.photographs:
        own.name_cameras(seen.cameras)
        own.add_photographs(given.photographs)
        _as_in_the_data(seen.check.project, own.project)
    elif videos := given.of("video"):
        place_videos(videos, use_videos)
    elif tables:
        name, content = next(iter(tables.items()))
        _use(seen, name, content)
    else:
        given.problems += [f"{name}: this is no new image." for name in given.files]


def _use(seen: Seen, name: str, content: bytes) -> None:
    seen.check.keep_images(name, content, seen.rig)
    setting(seen.check.project, "check_images", FILE, one_of([MATCHED, FILE])).set(FILE)


def _search(seen: Seen) -> None:
    """What is held in the new photographs, and the press that looks for it."""
    store = seen.photographs
    project, files = store.project, readable(lambda: store.photographs) or {}
    if not files:
        return
    if not seen.cameras:
        st.info("The photographs are searched once there are parameters, which have the lenses.")
        return
    with st.container(border=True):
        pairing = readable(lambda: store.paired([*seen.cameras]))
        moments = pairing.moments if pairing else {}
        with st.container(horizontal=True, vertical_alignment="center"):
            st.markdown(f"{count(len(files), 'photograph')}, {count(len(moments), 'frame')}.")
            button("Remove the photographs", "check_clear", store.clear)
        if pairing is None:
            return
        held, ready = ask_held(store, pairing, fold=True)
        length_m = None
        if not holds_board(project):
            length = setting(project, "length_m", seen.length_m, Number(0.0, or_none=True))
            label = "Distance between targets A and B (m)"
            length_m = length.number_input(label, format="%.10g") or None
            ready = ready and length_m is not None
        keep = partial(_keep, seen, length_m)
        work = search_work(store, pairing, seen.cameras, held, keep, length_m=length_m)
        found = project.settings.get(FOUND_BY)
        if found is not None and found != work.digest:
            st.warning("The photographs or what is held have changed. Find the targets again.")
        press_search(work, "targets", "find_new", found is not None, ready)


def _as_in_the_data(whole: Project, project: Project) -> None:
    """Until something else is said, what was held for the calibration is held again."""
    if "held" in project.settings or "held" not in whole.settings:
        return
    same = {name: each for name, each in whole.settings.items() if name.startswith(OF_HELD)}
    project.keep_settings(same)


def _keep(seen: Seen, length_m: float | None, found: Found, digest: str) -> None:
    """Use the targets that were found as the new images."""
    store, recording = seen.photographs, found.recording
    frames = len({*recording.frame.tolist()})
    label = f"targets found in {frames} frames of {len(store.photographs)} photographs"
    own = recording.object if length_m is None else RigidObject.bar(length_m)
    recording = replace(recording, object=own, name=label)
    seen.check.keep_images(label, pack_zip(pack_recording(recording)), seen.rig)
    store.project.keep_settings({FOUND_BY: digest})
