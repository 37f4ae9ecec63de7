"""Files of other programs and ours: parameters to download, and their upload on the Apply page; the
questions about a file with both cameras or with a whole data set."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import pandas as pd
import streamlit as st

from stereocal.calibration.methods import METHOD_NAMES, Method
from stereocal.formats.archives.archive import THROW, Archive
from stereocal.formats.archives.gather import gather
from stereocal.formats.camera_file import FourCoefficientsError, ImageSizeError, write_camera
from stereocal.formats.correspondences_csv import write_table
from stereocal.formats.exchange.exchange import (
    FORMATS,
    READABLE,
    export_files,
    export_notes,
    import_files,
    names_in_files,
)
from stereocal.formats.exchange.options import (
    USUAL_ORIGIN,
    ExchangeOptions,
    OriginError,
    PixelOrigin,
    UnitError,
)
from stereocal.projects.application import ProjectApplication, Use
from stereocal.projects.given import ProjectGiven
from stereocal.projects.inputs import Slot
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from stereocal.rig.parameters import RigParameters
from stereocal.system.latest import read_once
from stereocal.system.numbers import rounded
from stereocal.system.zip_files import pack_zip, unzip
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Field, choose, choose_from_menu, one_of, setting
from stereocal.ui.intake import take_new
from stereocal.ui.messages import ErrorsShown, readable, show_each
from stereocal.ui.press import PAPER_SET_FOR, answer_when_ready, offer_again, wait_for_answer
from stereocal.ui.texts import escape_markdown, escaped_table
from stereocal.ui.wizard import STATED, Questions, ask_about, ask_size
from stereocal.workflow.answer import PairAnswer

FILES: dict[Method, tuple[str, str]] = {
    "2d": ("parameters_2d.json", "to match"),
    "3d": ("parameters_3d.json", "to measure"),
    "refined": ("parameters_refined.json", "for both"),
}
"""Name and purpose of each file, the paper's two first."""
PURPOSES: Mapping[Use, str] = {"matching": "Match with", "measuring": "Measure with"}
APPLY_SETS = "apply_sets"
"""Where the page Apply keeps its choice of the two."""
_title = {name: entry.title for name, entry in READABLE.items()}.__getitem__
RESULTS, GIVEN = "This project's results", "Parameter files"
KINDS = [
    *("json", "zip", "yml", "yaml", "xml", "toml", "m", "csv", "txt", "ini", "conf", "mat"),
    *("cameramodel", "npz"),
]


@dataclass(frozen=True)
class Source:
    """Where a page takes its parameters from: the project's results, if it has any, or files."""

    project: Project
    key: str
    """The key of the setting."""

    @cached_property
    def _has_results(self) -> bool:
        return readable(lambda: self.project.calibration) is not None

    @property
    def _field(self) -> Field:
        kinds = [RESULTS, GIVEN] if self._has_results else [GIVEN]
        return setting(self.project, self.key, kinds[0], one_of(kinds))

    @property
    def is_project(self) -> bool:
        """Whether it is the project's results."""
        return bool(self._field.value() == RESULTS)

    def use_files(self) -> None:
        """Choose files."""
        self._field.set(GIVEN)

    def answer(self) -> PairAnswer | None:
        """The project's results; None if files are chosen, or while the results are computed."""
        project, dataset = self.project, self.project.dataset
        if not self.is_project:
            return None
        if dataset is not None:
            offer_again(project)
        return answer_when_ready(project)

    def asks_for_files(self) -> bool:
        """Draw the choice; whether the uploaders are to be drawn."""
        if self._has_results:
            self._field.buttons("Parameters")
        return not self.is_project

    def tell_missing(self, files: str) -> None:
        """Say which files are missing, or show that the results are being computed."""
        if self.is_project:
            wait_for_answer(self.project)
            return
        st.info(f"Still missing: {files}.")
        st.page_link("pages/calibrate.py", label="Or calibrate on the Calibrate page")


def parameter_downloads(answer: PairAnswer | None) -> None:
    """A download button for each file; those to use stand out. None: buttons without files yet."""
    for method, (name, purpose) in FILES.items():
        label, key = f"{name} · {purpose}", f"download_{method}"
        if answer is None:
            offer(label, None, name, key)
        elif method in answer.sets:
            to_use = method in answer.recommendation.use.values()
            offer(label, answer.sets[method].dumps, name, key, primary=to_use)


def other_formats(project: Project, answer: PairAnswer) -> None:
    """A file in the format of another program."""
    left, right = st.columns(2)
    sets, usual = answer.sets, answer.recommendation.match.method
    named = METHOD_NAMES.__getitem__
    menu = partial(choose, project, as_menu=True)
    method: Method = menu("format_file", "File", sets, usual, place=left, format_func=named)
    chosen: str = menu("format", "Format", FORMATS, place=right, format_func=_title)
    with ErrorsShown():
        options = ExchangeOptions()
        if chosen == "dlt":
            questions = Questions(project, f"dlt_{{}}_{method}", short={"first_pixel": "first"})
            options = replace(options, **vars(questions.origin(PixelOrigin())))
        files = export_files(sets[method], chosen, options)
        name, content = packed(files, FILES[method][0], chosen)
        show_each(st.caption, export_notes(sets[method], chosen))
        offer(f"Download {name}", content, name, "download_format")


def packed(files: dict[str, bytes], file_name: str, chosen: str) -> tuple[str, bytes]:
    """Name and content of a download: a single file as it is, several as a zip."""
    stem = file_name.rsplit(".", 1)[0]
    if len(files) == 1:
        ((name, content),) = files.items()
        return f"{stem}_{name}", content
    return f"{stem}_{chosen}.zip", pack_zip(files)


def upload_set(project: Project, store: ProjectApplication, use: Use) -> None:
    """Uploader of a parameter file, and the questions about one of another program."""
    uploads = st.file_uploader(
        f"{PURPOSES[use]}: {FILES[PAPER_SET_FOR[use]][0]}",
        type=KINDS,
        key=f"upload_set_{use}",
        accept_multiple_files=True,
        help="Or parameters_refined.json, which serves both; or rig.json of three cameras and "
        "more; or the files of another program, all of them at once or as a zip.",
    )
    take_new(uploads, lambda files: store.offer_set(use, files))

    def form(label: str, content: bytes) -> Mapping[str, Callable[[], None]]:
        st.markdown(f"**{escape_markdown(label)}**: parameters of another program.")
        short = {"lens_model": "lens"}
        questions = Questions(project, f"set_{{}}_{use}", tabs_own=True, short=short)
        program = questions.field("format", None, one_of(READABLE))
        name: str | None = program.menu(
            "Which program?", index=None, placeholder="choose", format_func=_title
        )
        if name is None:
            return {}
        try:
            options = _options(questions, name, read_once(_names_in, content, label, name))
            rig = _read(questions, use, content, label, name, options)
        except (FourCoefficientsError, ImageSizeError, OriginError, UnitError) as error:
            st.info(escape_markdown(error.question))
            return {}
        st.caption(f"The cameras are {rounded(rig.pose.baseline, 4)} m apart.")
        show_each(st.caption, rig.inputs.get("notes", ()))
        return {"Use these parameters": lambda: store.keep_set(use, label, rig.dumps().encode())}

    ask_about(store, use, form)


def _imported(content: bytes, label: str, name: str, options: ExchangeOptions) -> RigParameters:
    return import_files(unzip(content, label), name, options, label)


def _names_in(content: bytes, label: str, name: str) -> tuple[str, ...]:
    return names_in_files(unzip(content, label), name)


def _read(
    questions: Questions, use: Use, content: bytes, label: str, name: str, options: ExchangeOptions
) -> RigParameters:
    """The parameters in files; image sizes are asked for if the files do not state them."""
    try:
        return read_once(_imported, content, label, name, options)
    except ImageSizeError:
        ask = partial(ask_size, questions.project, tabs_own=True)
        first, second = (
            ask(f"set_size_{use}_{which}", f", {which}", camera.image_size if camera else None)
            for which, camera in zip(CAMERAS, questions.project.cameras, strict=True)
        )
        options = replace(options, image_sizes=(first, second))
        return read_once(_imported, content, label, name, options)


def _options(questions: Questions, name: str, names: tuple[str, ...]) -> ExchangeOptions:
    left, right = st.columns(2)
    unit, lens_model = questions.ask(left, "unit"), questions.ask(right, "lens_model")
    options = ExchangeOptions(unit=unit, lens_model=lens_model)
    if name == "dlt":
        origin = questions.ask(left, "corner"), questions.ask(right, "first_pixel", 0.0)
        lower = origin[0] == "lower-left"
        how = questions.ask(left, "flip", USUAL_ORIGIN.flip) if lower else None
        options = replace(options, corner=origin[0], first_pixel=origin[1], flip=how)
    if name == "ros" and len(names) == 2:
        words: dict[int | None, str] = {None: f"{STATED}: that without a baseline"}
        words |= enumerate(names)
        primary = questions.field("primary", None, one_of(words)).menu(
            "The primary camera is", format_func=words.__getitem__, placeholder=words[None]
        )
        return options if primary is None else replace(options, cameras=(primary, 1 - primary))
    if len(names) < 3:
        return options
    chosen = [
        questions.field(which, default, one_of(names)).menu(f"The {which} camera is", place)
        for place, which, default in zip(st.columns(2), CAMERAS, names, strict=False)
    ]
    return replace(options, cameras=(names.index(chosen[0]), names.index(chosen[1])))


CAMERA_TITLES = ("Primary camera", "Secondary camera")


def ask_about_archive(project: Project) -> None:
    """What an archive holds and the questions about it, if there is one."""
    store = ProjectApplication(project)

    def form(label: str, content: bytes) -> Mapping[str, Callable[[], None]]:
        st.markdown(f"**{escape_markdown(label)}** is a file of another program.")
        baseline_known = project.inputs.baseline_m is not None
        names = ProjectGiven(project).cameras_in(label, content)
        cameras = _cameras(project, names) if len(names) > 2 else None
        with st.expander("Correct or complete what the file says"):
            questions, (left, right) = Questions(project, "archive_{}"), st.columns(2)
            unit, lens_model = questions.ask(left, "unit"), questions.ask(right, "lens_model")
            size = ask_size(project, "archive", "")
        options = ExchangeOptions((size, size), cameras, unit, lens_model)
        archive = read_once(_gathered, content, label, options, baseline_known)
        _show(archive, baseline_known)
        return {"Use what was found": partial(_use, store, label, archive)}

    ask_about(store, "archive", form)


def _gathered(content: bytes, label: str, options: ExchangeOptions, has_baseline: bool) -> Archive:
    return gather({label: content}, options, baseline_known=has_baseline)


def _cameras(project: Project, names: tuple[str, ...]) -> tuple[int, int]:
    """The indices of the chosen primary and secondary."""
    st.caption(f"It has {len(names)} cameras: choose two.")
    chosen = [
        choose_from_menu(project, f"archive_camera_{k}", title, names, names[k], place=place)
        for k, (place, title) in enumerate(zip(st.columns(2), CAMERA_TITLES, strict=True))
    ]
    first, second = (names.index(name) for name in chosen)
    return first, second


def _show(archive: Archive, baseline_known: bool) -> None:
    rows = [(item.what, item.taken, item.origin) for item in archive.taken]
    table = pd.DataFrame(rows, columns=["What", "Found", "From"])
    st.table(escaped_table(table).set_index("What"))
    show_each(st.caption, archive.remarks)
    if archive.baseline_m is not None:
        st.caption(
            "The baseline is the other program's result, not a measurement: replace it and its "
            "uncertainty by the measured ones, or state below that it was not measured."
        )
    elif archive.correspondences is not None and not baseline_known:
        st.caption("It has no baseline: enter the measured one below, or say that there is none.")
    if archive.throw is not None:
        content = archive.throw.to_csv(index=False)
        offer("The thrown object, for a world frame", content, THROW, "throw")


def _use(store: ProjectApplication, label: str, archive: Archive) -> None:
    """Store what was found; a length that the user has entered stays."""
    files: dict[Slot, tuple[str, bytes]] = {}
    if archive.primary is not None and archive.secondary is not None:
        files["primary"] = (f"{label}, primary", write_camera(archive.primary))
        files["secondary"] = (f"{label}, secondary", write_camera(archive.secondary))
    if archive.correspondences is not None:
        files["correspondences"] = (label, write_table(archive.correspondences))
    inputs, values = store.project.inputs, dict[str, Any]()
    if archive.baseline_m is not None and inputs.baseline_m is None:
        values |= {"baseline_m": archive.baseline_m, "baseline_sigma_m": archive.baseline_sigma_m}
    if archive.target_distance_m is not None and inputs.target_distance_m is None:
        values["target_distance_m"] = archive.target_distance_m
    store.project.give(files, **values)
    store.forget_question("archive")
