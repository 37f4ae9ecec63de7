"""The threshold of the Apply page: stated, of the parameter set, or chosen from the points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pandas as pd
import streamlit as st

from stereocal.errors import StereocalError
from stereocal.figures import describe_pair_errors, plot_pair_errors
from stereocal.matching.application import Points, sample_frames
from stereocal.matching.in_step import shift_pixels
from stereocal.matching.matching import ANY_DEPTH, check_depths
from stereocal.matching.nearest import nearest_errors
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
from stereocal.ui.messages import callback
from stereocal.ui.texts import escape_markdown

Depths = tuple[float, float]
_THRESHOLD = "apply_threshold"
_ASKED = "apply_asked"


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

    def choose(self) -> float | None:
        """The threshold (px) in a field, which starts with that of the parameter set."""
        usual = self.rig.matching_threshold_px
        if usual is None and _THRESHOLD not in self.project.settings:
            chosen = self._choice()[0]
            usual = None if chosen is None else chosen.threshold_px
        field = self._field(usual)
        st.number_input(
            "below (px)", min_value=0.0, value=None, step=0.1, format="%.4g",
            placeholder="largest error of a pair",
            help="Threshold: largest reprojection error of a pair, mean over both cameras.",
            **field.widget(),
        )  # fmt: skip
        threshold: float | None = field.value()
        return threshold

    def report(self, threshold: float | None) -> None:
        """How the threshold was chosen, or why none could be if the user asked for it."""
        asked = st.session_state.get(_ASKED)
        if asked or self.rig.matching_threshold_px is None:
            found, sentence = self._choice()
            if found is None and (asked or threshold is None):
                st.warning(escape_markdown(sentence))
            elif found is not None and found.threshold_px == threshold:
                st.caption(escape_markdown(sentence))
        if threshold is None:
            st.info("Give a threshold in pixels.")

    def show(self, threshold: float | None) -> None:
        """The errors of the best and second-best pairs, and the depth range."""
        form, figure = st.columns([2, 3], gap="large")
        with form:
            if self.rig.matching_threshold_px is not None:
                st.caption(
                    f"The parameter set's own: {rounded(self.rig.matching_threshold_px, 3)} px."
                )
            st.button("Choose it from the points", key="apply_auto", on_click=self._take_choice)
            _show_depths(self.project)
        with figure:
            nearest = jobs.compute(nearest_errors, self.rig, self.sample(), self.depths)
            words = describe_pair_errors(nearest, threshold or 0.0, self._choice()[0])
            figure = plot_pair_errors(nearest, threshold or 0.0)
            show_figure(figure, words, "pair_errors", fold=False)

    def _field(self, usual: float | None) -> Field:
        return setting(self.project, _THRESHOLD, usual, number(0.0, or_none=True))

    @property
    def _take_choice(self) -> Callable[[], None]:
        @callback
        def take() -> None:
            st.session_state[_ASKED] = True
            if (found := self._choice()[0]) is not None:
                self._field(None).set(found.threshold_px)

        return take

    def _choice(self) -> tuple[ThresholdChoice | None, str]:
        """The threshold chosen from the points, or None, and the reason."""
        return _chosen(self.rig.dumps(), self.key, self.depths, self)


@st.cache_resource(show_spinner=False, max_entries=16)
def _chosen(
    key: str, points: str, depths: Depths, _form: ThresholdForm
) -> tuple[ThresholdChoice | None, str]:
    assert key and points
    try:
        choice = jobs.compute(choose_threshold, _form.rig, _form.sample(), depths)
        return choice, choice.sentence()
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
    """The depth range (m), as last set.

    Raises:
        StereocalError: it is invalid.
    """
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
        "Only points at some depths", **only.widget(),
        help="Where it is known how far away the points are, fewer wrong pairs fit.",
    )  # fmt: skip
    if only.value():
        for title, field, column in zip(
            ("Nearest (m)", "Farthest (m)"), ends, st.columns(2), strict=True
        ):
            column.number_input(
                title, min_value=0.0, value=None, format="%.6g", **field.widget()
            )  # fmt: skip


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
