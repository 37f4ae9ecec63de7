"""The points of the Apply page: the project's own, or a file of each camera; their noise, the
threshold, and depths."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import cycle

import pandas as pd
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.errors import StereocalError
from stereocal.figures.matches import describe_pair_errors, plot_pair_errors
from stereocal.matching.application import Points, points_by_camera
from stereocal.matching.in_step import points_in_step
from stereocal.matching.matching import ANY_DEPTH, check_depths, nearest_errors
from stereocal.matching.names import AUTO, NO_NAMES, OFF, Sample, name_columns, stated_columns
from stereocal.matching.pairs import names_and_threshold, sample_frames
from stereocal.matching.point_noise import FEWEST_PAIRS, PointNoise
from stereocal.matching.settled import Stated, further_of
from stereocal.matching.threshold import ThresholdChoice
from stereocal.matching.trajectories import TRACK
from stereocal.projects.application import CLICKED_IN, Asked, ProjectApplication, slot_of
from stereocal.projects.clicks import ProjectClicks
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, camera_in_words
from stereocal.rig.parameters import RigParameters
from stereocal.rig.recording import Recording
from stereocal.system.latest import once_or_refused
from stereocal.system.names import named_after
from stereocal.system.numbers import count, rounded
from stereocal.ui import jobs
from stereocal.ui.fields import Field, Number, one_of, setting, yes_or_no
from stereocal.ui.figure import show_figure
from stereocal.ui.intake import take_new
from stereocal.ui.messages import button
from stereocal.ui.texts import escape_markdown
from stereocal.ui.wizard import ask_about_points

CLICKED = "Click them here"
FEWEST = 2
"""Cameras whose points are needed."""
COLUMNS = 3
KINDS = ["csv", "txt", "tsv", "xlsx", "parquet", "h5", "hdf5", "mat"]
HELP = (
    "A table frame,u,v with further columns (CSV, XLSX), or a file of Argus, easyWand, DLTdv, "
    "DeepLabCut (CSV), SLEAP (CSV or analysis HDF5), Tracktor, TrackMate, Caliscope or another "
    "program. Files of several cameras can be given here together, each named after its camera."
)


@dataclass(frozen=True)
class PointsForm:
    """The choice of points, and the uploaders."""

    store: ProjectApplication
    heights: Mapping[str, int | None]
    """The number of rows of each camera's images, if it is known."""
    data: Recording | None
    """Its own points can be chosen."""
    is_rig: bool
    """Whether there are three cameras or more."""

    @property
    def slots(self) -> dict[str, Asked]:
        """The slot of each camera's file."""
        return {name: slot_of(name) for name in self.heights}

    @property
    def _titles(self) -> tuple[str, str]:
        """What the page calls the project's own points, and files."""
        if self.is_rig:
            return "The object's own points", "A point file of each camera"
        return "The bar's own points", "Two point files"

    @property
    def _missing(self) -> list[str]:
        """The cameras without a file."""
        return [camera for camera, slot in self.slots.items() if not self.store.point_file(slot)]

    def tell_missing(self, points: Mapping[str, Points]) -> None:
        """Whose points are still missing."""
        missing, which = self._missing, "both cameras"
        if self.is_clicked or (len(points) >= FEWEST and (self.is_rig or len(missing) != 1)):
            return
        if self.is_rig:
            which = "two cameras at least"
        elif len(missing) == 1:
            which = f"the {missing[0]} camera"
        st.info(f"Still missing: the points of {which}.")

    @property
    def is_clicked(self) -> bool:
        """Whether the points are clicked on the page."""
        return bool(self._kind.value() == CLICKED)

    @property
    def _kind(self) -> Field:
        kinds, files = [*self._titles, CLICKED][self.data is None :], self._titles[1]
        usual = files if len(self.slots) - len(self._missing) >= FEWEST else kinds[0]
        key = "apply_points_of_rig" if self.is_rig else "apply_points"
        return setting(self.store.project, key, usual, one_of(kinds))

    def take(self) -> None:
        """An uploader for each camera, and the questions about its file, unless points are
        clicked."""
        if self.is_clicked:
            return
        columns = st.columns(min(len(self.slots), COLUMNS))
        in_use = "In use" if self._kind.value() == self._titles[1] else "Not in use"
        for (camera, slot), place in zip(self.slots.items(), cycle(columns), strict=False):
            with place:
                self._upload(slot, camera_in_words(camera), in_use)
        for number, (camera, slot) in enumerate(self.slots.items()):
            height, words = self.heights[camera], camera_in_words(camera)
            ask_about_points(self.store, slot, height, words, number)

    def _upload(self, slot: Asked, camera: str, in_use: str) -> None:
        if (file := self.store.point_file(slot)) is not None:
            st.caption(f"{in_use}: {escape_markdown(file.label)}, {count(file.rows, 'point')}")
            if file.answers is not None:
                button("Read it differently", f"again_{slot}", self.store.ask_again, slot)
        title, key = f"Points of {escape_markdown(camera)}", f"upload_points_{slot}"
        uploads = st.file_uploader(title, KINDS, accept_multiple_files=True, key=key, help=HELP)
        take_new(uploads, partial(self._offer, slot))

    def _offer(self, slot: Asked, files: Mapping[str, bytes]) -> None:
        """Take the file of one camera, or several files that are named after their cameras."""
        slots = dict.fromkeys(files, slot)
        if len(files) > 1:
            cameras = named_after([*files], [*self.slots])
            slots = {name: self.slots[camera] for name, camera in cameras.items()}
        with self.store.database.transaction():  # all or none
            for name, file_slot in slots.items():
                self.store.offer_points(file_slot, name, files[name])
        if len(self.slots) - len(self._missing) >= FEWEST:
            self._kind.set(self._titles[1])

    def choose(self) -> tuple[dict[str, Points], str]:
        """The points by camera, of those that have any; and how their names decide."""
        points = self._points(self._kind.menu("Points"))
        if self.is_clicked:
            return points, TRACK
        several = len(points) >= FEWEST
        return points, _ask_names(self.store, [*points.values()]) if several else AUTO

    def _points(self, kind: str) -> dict[str, Points]:
        if kind == CLICKED:
            clicks = ProjectClicks(self.store.project).clicks.of_cameras(self.slots)
            tables = clicks.tables(self.slots, to_match=True) if clicks.are_points else {}
            label = f"{CLICKED_IN} {{}} pictures"
            return {c: self.store.own_points(table, label.format(c)) for c, table in tables.items()}
        if self.data is not None and kind == self._titles[0]:
            aside = "The targets' names" if self.is_rig else "Targets A and B"
            st.caption(f"{aside} are left aside: the matching has to tell them apart.")
            by_camera = points_by_camera(self.data)
            labels = {c: f"{c} points" if c in CAMERAS else f"camera {c}" for c in self.slots}
            return {
                camera: self.store.own_points(by_camera[camera], f"{label} of {self.data.name}")
                for camera, label in labels.items()
                if camera in by_camera
            }
        stored = {camera: self.store.points(slot) for camera, slot in self.slots.items()}
        return {camera: points for camera, points in stored.items() if points is not None}


Depths = tuple[float, float]
THRESHOLD = (
    "Threshold: largest reprojection error of a pair, mean over both cameras. Empty: by the noise "
    "of your points."
)
OPTIONAL = Number(0.0, or_none=True)
SOURCES = {"stated": "as stated", "columns": "by their columns", "calibration": "as the targets"}


def threshold_field(project: Project) -> Field:
    """The threshold as stated (px); None where the points decide."""
    return setting(project, "apply_threshold", None, OPTIONAL)


def noise_field(project: Project, key: str) -> Field:
    """The noise as stated (px); None where the points decide."""
    return setting(project, key, None, Number(0.001, or_none=True))


def ask_noise(field: Field, usual: PointNoise | str, otherwise: str) -> float | None:
    """Draw the field; returns its value.

    Args:
        usual: what is taken where the field is empty, or words for it.
        otherwise: how that is found.
    """
    if not isinstance(usual, str):
        usual = f"{rounded(usual.sigma_px)}, {SOURCES.get(usual.source, usual.source)}"
    hint = f"One standard deviation of an image coordinate of your points. Empty: {otherwise}."
    title = "My points are known to (px)"
    noise: float | None = field.number_input(title, step=0.1, placeholder=usual, help=hint)
    return noise


@dataclass(frozen=True, eq=False)
class ThresholdForm:
    """What a threshold depends on."""

    store: ProjectApplication
    points: Mapping[str, Points]
    rig: RigParameters
    """To match with."""
    stated: Stated

    @property
    def key(self) -> str:
        """Identifies the points."""
        return " ".join(points.name for points in self.points.values())

    def choose(
        self, noise_at: DeltaGenerator, threshold_at: DeltaGenerator
    ) -> tuple[ThresholdChoice | None, float | None]:
        """The threshold, and the noise of the points as stated: fields that may be empty."""
        (usual, _), (choice, why_none) = (
            _chosen(self, replace(self.stated, threshold_px=px))
            for px in (None, self.stated.threshold_px)
        )
        noise = None if usual is None else usual.noise
        by = "for targets" if noise is None or noise.source == "calibration" else "by the points"
        placeholder = f"{rounded(usual.threshold_px, 3)}, {by}" if usual else "none"
        threshold_field(self.store.project).number_input(
            "below (px)", threshold_at, step=0.1, placeholder=placeholder, help=THRESHOLD
        )
        with noise_at:
            otherwise = "by their column sigma_px, or estimated from their epipolar errors"
            field = noise_field(self.store.project, "apply_sigma_px")
            sigma_px = ask_noise(field, noise or "", otherwise)
        if choice is None:
            st.warning(escape_markdown(why_none))
            st.info("Give a threshold in pixels.")
            return None, sigma_px
        st.caption(escape_markdown(choice.sentence()))
        if sigma_px is None and choice.noise and choice.noise.source == "stated":
            sigma_px = choice.noise.sigma_px
            st.caption(
                f"Points clicked by hand are taken to be known to {rounded(sigma_px)} px until "
                f"{FEWEST_PAIRS} pairs show their own noise."
            )
        return choice, sigma_px

    def show(self, choice: ThresholdChoice | None) -> None:
        """The errors of the best and second-best pairs, and the depth range."""
        form, figure = st.columns([2, 3], gap="large")
        with form:
            only, *ends = _depth_fields(self.store.project)
            hint = "Where it is known how far away the points are, fewer wrong pairs fit."
            st.toggle("Only points at some depths", **only.widget(), help=hint)
            if only.value():
                titles = ("Nearest (m)", "Farthest (m)")
                for title, field, column in zip(titles, ends, st.columns(2), strict=True):
                    field.number_input(title, column, format="%.6g")
        with figure:
            threshold = 0.0 if choice is None else choice.threshold_px
            sample = [NO_NAMES.samples(*pair)[0] for pair in _sampled(self)]
            nearest = jobs.compute(nearest_errors, self.rig, sample, self.stated.depths_m)
            words = describe_pair_errors(nearest, len(sample), threshold, choice)
            show_figure(plot_pair_errors(nearest, threshold), words, "pair_errors", caption=True)


def _chosen(form: ThresholdForm, stated: Stated) -> tuple[ThresholdChoice | None, str]:
    """The threshold, or None, and the reason."""

    def choice() -> ThresholdChoice:
        tables = [*_tables(form).values()]
        columns = list(stated_columns(stated.names, *map(further_of, tables)))
        distinct = [table[columns] for table in tables]
        return jobs.compute(names_and_threshold, form.rig, _sampled(form), distinct, stated)[-1]

    key = f"{form.key} threshold {form.rig.digest} {stated}"
    try:
        return once_or_refused("points", key, choice), ""
    except StereocalError as error:
        return None, str(error)


def _sampled(form: ThresholdForm) -> Sample:
    """A sample of the points of both cameras."""

    def sample() -> Sample:
        return sample_frames(*points_in_step(form.rig, _tables(form))[0].values())

    return once_or_refused("points", f"{form.key} sample {form.rig.digest}", sample)


def _tables(form: ThresholdForm) -> dict[str, pd.DataFrame]:
    points = form.points.items()
    return {camera: whole_table(file.name, file.label, form.store) for camera, file in points}


def _ask_names(store: ProjectApplication, points: Sequence[Points]) -> str:
    """Whether names decide, where all cameras have them; as of `pairs.match`."""
    field = setting(store.project, "apply_names", True, yes_or_no)
    tables = (whole_table(file.name, file.label, store) for file in points)
    columns = name_columns(*(list(map(str, table)) for table in tables))
    if not columns:
        return AUTO
    title = (
        f"Only points of one name belong together (column {escape_markdown(', '.join(columns))})"
    )
    hint = "The images check the names; what does not fit is reported below."
    st.toggle(title, **field.widget(), help=hint)
    return AUTO if field.value() else OFF


def whole_table(name: str, label: str, store: ProjectApplication) -> pd.DataFrame:
    """All points of a table, whose name is its digest."""

    def read() -> pd.DataFrame:
        with st.spinner("Reading the points."):
            return store.whole_table(name, label)

    return once_or_refused("points", f"{name} table {label}", read)


def chosen_depths(project: Project) -> Depths:
    """The depth range (m), as last set."""
    only, near, far = (field.value() for field in _depth_fields(project))
    if not only:
        return ANY_DEPTH
    return check_depths((near or 0.0, ANY_DEPTH[1] if far is None else far))


def _depth_fields(project: Project) -> list[Field]:
    only = setting(project, "apply_only_depths", False, yes_or_no)
    return [only, *(setting(project, f"apply_{end}", None, OPTIONAL) for end in ("near", "far"))]
