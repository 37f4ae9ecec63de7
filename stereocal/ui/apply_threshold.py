"""The threshold of the Apply page: by the noise of the points, or stated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pandas as pd
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.errors import StereocalError
from stereocal.figures.pair_errors import describe_pair_errors, plot_pair_errors
from stereocal.matching.application import Points, digest_of, sample_frames
from stereocal.matching.in_step import shift_pixels
from stereocal.matching.matching import ANY_DEPTH, check_depths, nearest_errors
from stereocal.matching.pairs import POINT
from stereocal.matching.point_table import PointTable
from stereocal.matching.threshold import FramePixels, ThresholdChoice, choose_threshold
from stereocal.projects.application import ProjectApplication
from stereocal.projects.project import Project
from stereocal.rig.parameters import RigParameters
from stereocal.system.numbers import rounded
from stereocal.ui import jobs
from stereocal.ui.fields import Field, number, setting, yes_or_no
from stereocal.ui.figure import show_figure
from stereocal.ui.point_noise import ask_noise, noise_field
from stereocal.ui.texts import escape_markdown

Depths = tuple[float, float]


@dataclass(frozen=True)
class ThresholdForm:
    """What a threshold depends on, and the depth range."""

    project: Project
    rig: RigParameters
    key: str
    """Of the sample."""
    sample: Callable[[], list[FramePixels]]
    """A sample of the points of both cameras."""
    depths: Depths

    def choose(
        self, noise_at: DeltaGenerator, threshold_at: DeltaGenerator
    ) -> tuple[ThresholdChoice | None, float | None]:
        """The threshold, and the noise of the points as stated, each in a field that is empty where
        the points decide.
        """
        stated, sigma = self._fields
        found, _ = self._choice(stated.value(), sigma.value())
        usual, _ = self._choice(None, sigma.value())
        noise = None if usual is None else usual.noise
        by = "for targets" if noise is None or noise.source == "calibration" else "by the points"
        threshold_at.number_input(
            "below (px)",
            min_value=0.0,
            value=None,
            step=0.1,
            format="%.4g",
            placeholder=f"{rounded(usual.threshold_px, 3)}, {by}" if usual else "none",
            help="Threshold: largest reprojection error of a pair, mean over both cameras. Empty: "
            "by the noise of your points.",
            **stated.widget(),
        )
        otherwise = "by their column sigma_px, or estimated from their epipolar errors"
        with noise_at:
            return found, ask_noise(sigma, noise or "", otherwise)

    def report(self, found: ThresholdChoice | None) -> None:
        """The noise of the points, and the threshold with what it does."""
        if found is not None:
            st.caption(escape_markdown(found.sentence()))
            return
        st.warning(escape_markdown(self._choice(*(field.value() for field in self._fields))[1]))
        st.info("Give a threshold in pixels.")

    def show(self, found: ThresholdChoice | None) -> None:
        """The errors of the best and second-best pairs, and the depth range."""
        form, figure = st.columns([2, 3], gap="large")
        with form:
            if self.rig.matching_threshold_px is not None:
                own = rounded(self.rig.matching_threshold_px, 3)
                st.caption(f"For points like the targets: {own} px.")
            _show_depths(self.project)
        with figure:
            threshold = 0.0 if found is None else found.threshold_px
            nearest = jobs.compute(nearest_errors, self.rig, self.sample(), self.depths)
            words = describe_pair_errors(nearest, threshold, found)
            show_figure(plot_pair_errors(nearest, threshold), words, "pair_errors", fold=False)

    @property
    def _fields(self) -> tuple[Field, Field]:
        """Threshold and noise."""
        return (
            setting(self.project, "apply_threshold", None, number(0.0, or_none=True)),
            noise_field(self.project, "apply_sigma_px"),
        )

    def _choice(
        self, threshold: float | None, sigma_px: float | None
    ) -> tuple[ThresholdChoice | None, str]:
        """The threshold, or None, and the reason."""
        return _chosen(digest_of(self.rig), self.key, self.depths, threshold, sigma_px, self)


@st.cache_resource(show_spinner=False, max_entries=16)
def _chosen(
    key: str,
    points: str,
    depths: Depths,
    threshold: float | None,
    sigma_px: float | None,
    _form: ThresholdForm,
) -> tuple[ThresholdChoice | None, str]:
    assert key and points
    try:
        sample = _form.sample()
        return jobs.compute(choose_threshold, _form.rig, sample, depths, sigma_px, threshold), ""
    except StereocalError as error:
        return None, str(error)


def threshold_form(
    store: ProjectApplication, points: tuple[Points, Points], rig: RigParameters, depths: Depths
) -> ThresholdForm:
    """The form for points and a parameter set to match with."""
    key = " ".join(each.name for each in points)
    late = f"{key} {rig.time_offset}"
    return ThresholdForm(
        store.project, rig, key, lambda: _sampled(late, store, points, rig), depths
    )


def chosen_depths(project: Project) -> Depths:
    """The depth range (m), as last set."""
    only, near, far = (field.value() for field in _depth_fields(project))
    if not only:
        return ANY_DEPTH
    return check_depths((near or 0.0, ANY_DEPTH[1] if far is None else far))


def _depth_fields(project: Project) -> tuple[Field, Field, Field]:
    near, far = (
        setting(project, key, None, number(0.0, or_none=True))
        for key in ("apply_near", "apply_far")
    )
    return setting(project, "apply_only_depths", False, yes_or_no), near, far


def _show_depths(project: Project) -> None:
    only, *ends = _depth_fields(project)
    st.toggle(
        "Only points at some depths",
        **only.widget(),
        help="Where it is known how far away the points are, fewer wrong pairs fit.",
    )
    if only.value():
        for title, field, column in zip(
            ("Nearest (m)", "Farthest (m)"), ends, st.columns(2), strict=True
        ):
            column.number_input(title, min_value=0.0, value=None, format="%.6g", **field.widget())


def whole_table(store: ProjectApplication, name: str, label: str) -> pd.DataFrame:
    """All points of a table, cached by name, which holds its digest."""
    return _table(name, label, store)


@st.cache_resource(show_spinner="Reading the points.", max_entries=4)
def _table(name: str, label: str, _store: ProjectApplication) -> pd.DataFrame:
    with _store.opened(name) as path:
        return pd.concat(list(PointTable(path, POINT, label).blocks()))


@st.cache_resource(show_spinner=False, max_entries=8)
def _sampled(
    key: str, _store: ProjectApplication, _points: tuple[Points, Points], _rig: RigParameters
) -> list[FramePixels]:
    assert key
    first, second = (whole_table(_store, each.name, each.label) for each in _points)
    return sample_frames(first, shift_pixels(_rig, second, POINT))
