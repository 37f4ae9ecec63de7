"""The uncertainties of lengths and lenses, which the user states on the Data page."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import partial
from typing import Any, cast

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.projects.project import Project
from stereocal.refined.unknowns import (
    DEFAULT_BASELINE,
    DEFAULT_CENTRE_PX,
    DEFAULT_DISTANCE,
    DEFAULT_FOCAL,
    lens_prior,
)
from stereocal.rig.camera import CAMERAS, Camera, CameraName
from stereocal.rig.dataset import Dataset
from stereocal.rig.lengths_in_words import as_held
from stereocal.system.numbers import rounded
from stereocal.ui.fields import Field
from stereocal.ui.intake import clear_refusal, refuse
from stereocal.ui.project import project_to_write

NOT_STATED, TYPED, OWN, FREE = "Not stated", "Typed", "own", "Not measured"
PRESETS_MM = {"Laser range finder": 2.0, "Tape": 5.0, "Total station": 1.0}
TITLES = {
    NOT_STATED: NOT_STATED,
    **{name: f"{name}: ± {mm:g} mm" for name, mm in PRESETS_MM.items()},
    FREE: "Not measured: left free",
}
LEAST_MM = 0.001
HELP = (
    "One standard deviation. With it, stereocal can tell which of the numbers that you gave "
    "disagrees with the images; where nothing is stated it assumes {assumed}, and cannot blame it."
)

HELP_ON_FREE = (
    " A baseline that nobody measured can be left free: then the lengths of the bars alone give "
    "the scale."
)


def length_uncertainty(project: Project | None, name: str, assumed: str) -> None:
    """The fields of a length's uncertainty: a preset, or a typed value.

    Args:
        name: `baseline_m` or `target_distance_m`.
        assumed: the default, in words.
    """
    length = _Length(project, name)
    left, right = st.columns([3, 2], vertical_alignment="bottom")
    chosen = left.selectbox(
        "How well is it known?",
        [NOT_STATED, *PRESETS_MM, TYPED, *([FREE] if name == "baseline_m" else [])],
        format_func=lambda option: TITLES.get(option, "Typed, in mm"),
        help=HELP.format(assumed=assumed) + (HELP_ON_FREE if name == "baseline_m" else ""),
        **length.choice.widget(),
    )
    if chosen == TYPED:
        right.number_input(
            "± mm",
            min_value=LEAST_MM,
            value=None,
            step=None,
            format="%.6g",
            placeholder="not stated",
            **length.number.widget(),
        )


def lens_uncertainties(project: Project | None) -> None:
    """The fields of each lens's uncertainty: from its file, typed, or not stated."""
    if project is None:
        return
    for which, camera, column in zip(CAMERAS, project.cameras, st.columns(2), strict=True):
        if camera is not None:
            with column:
                _lens_known(project, which, camera)


def describe_uncertainties(dataset: Dataset) -> str:
    """The stated and the assumed uncertainties, in words."""
    parts = [
        _of_length("baseline", dataset.baseline_sigma_m, DEFAULT_BASELINE * dataset.baseline_m),
        _of_length(
            "distance A–B",
            dataset.target_distance_sigma_m,
            DEFAULT_DISTANCE * dataset.target_distance_m,
        ),
    ]
    for which, camera in zip(CAMERAS, (dataset.primary, dataset.secondary), strict=True):
        stated = "" if camera.uncertainty else " (not stated, assumed)"
        parts.append(f"{which} lens {_of_lens(camera)}{stated}")
    return as_held(f"How well the inputs are known: {'; '.join(parts)}.", dataset)


def _of_length(what: str, sigma_m: float | None, assumed_m: float) -> str:
    if sigma_m == math.inf:
        return f"{what} not measured, found from the lengths of the bars"
    if sigma_m is None:
        return f"{what} ± {rounded(1000 * assumed_m, 3)} mm (not stated, assumed)"
    return f"{what} ± {rounded(1000 * sigma_m, 3)} mm"


def _of_lens(camera: Camera) -> str:
    prior = lens_prior(camera, None)
    return f"± {rounded(100 * prior.focal)} % and ± {rounded(prior.centre_px)} px"


@dataclass
class _Stated:
    """A stated uncertainty; the settings store how it is stated."""

    project: Project | None
    name: str
    choice: Field = field(init=False)

    def __post_init__(self) -> None:
        key = f"{self.name}_known"
        self.choice = Field(key, key, self._read, self._choose)

    def _chosen(self) -> Any:
        return self.project.settings.get(self.choice.name) if self.project else None

    def _read(self) -> str:
        raise NotImplementedError

    def _choose(self, option: str) -> None:
        raise NotImplementedError

    def _keep(self, option: str, **given: Any) -> None:
        try:
            self.project = project_to_write()
            self.project.give({}, **given)
            self.project.keep_settings({self.choice.name: option})
            clear_refusal()
        except StereocalError as error:
            refuse(error)


class _Length(_Stated):
    """The uncertainty of a length; the inputs store it in metres."""

    def __post_init__(self) -> None:
        super().__post_init__()
        key = f"{self.name}_sigma_mm"
        self.number = Field(key, key, self._read_mm, self._take_mm)

    @property
    def _sigma(self) -> str:
        return f"{self.name.removesuffix('_m')}_sigma_m"

    def _read_mm(self) -> float | None:
        sigma_m = getattr(self.project.inputs, self._sigma) if self.project else None
        return None if sigma_m is None else float(f"{1000 * sigma_m:.6g}")

    def _read(self) -> str:
        if self._is_free():
            return FREE
        chosen, mm = self._chosen(), self._read_mm()
        if mm is None:
            return TYPED if chosen == TYPED else NOT_STATED
        return str(chosen) if PRESETS_MM.get(chosen) == mm else TYPED

    def _choose(self, option: str) -> None:
        given: dict[str, Any] = {}
        if option != TYPED:
            given[self._sigma] = _metres(PRESETS_MM.get(option))
        if FREE in (option, self._read()):
            given["baseline_free"] = option == FREE
        self._keep(option, **given)

    def _is_free(self) -> bool:
        return (
            self.name == "baseline_m"
            and self.project is not None
            and self.project.inputs.baseline_free
        )

    def _take_mm(self, mm: float | None) -> None:
        self._keep(TYPED, **{self._sigma: _metres(mm)})


def _lens_known(project: Project, which: CameraName, camera: Camera) -> None:
    lens = _Lens(project, which, camera)
    own = f"Its own calibration: {_of_lens(camera)}"
    titles = {OWN: own, NOT_STATED: NOT_STATED, TYPED: "Typed"}
    assumed = f"± {100 * DEFAULT_FOCAL:g} % and ± {DEFAULT_CENTRE_PX:g} px"
    chosen = st.selectbox(
        f"How well is the {which} lens known?",
        [*([OWN] if camera.uncertainty else []), NOT_STATED, TYPED],
        format_func=titles.__getitem__,
        help=HELP.format(assumed=assumed),
        **lens.choice.widget(),
    )
    if chosen != TYPED:
        return
    for column, title, typed in zip(
        st.columns(2), ("Focal length, ± %", "Image centre, ± px"), lens.numbers, strict=True
    ):
        column.number_input(
            title,
            min_value=0.0,
            value=None,
            step=None,
            format="%.6g",
            placeholder="not stated",
            help="0 holds it as it is given. It counts once both numbers are there.",
            **typed.widget(),
        )


@dataclass
class _Lens(_Stated):
    """The uncertainty of a lens: a fraction of its focal length, and pixels of its centre."""

    camera: Camera

    def __post_init__(self) -> None:
        which = self.name
        self.name = f"lens_{which}"
        super().__post_init__()
        self.which = cast(CameraName, which)
        self.numbers = [
            Field(key, key, partial(self._read_number, at), partial(self._take, at))
            for at, key in enumerate((f"{self.name}_focal_percent", f"{self.name}_centre_px"))
        ]

    @property
    def _stated(self) -> dict[CameraName, tuple[float | None, float | None] | None]:
        return dict(self.project.inputs.lens_known) if self.project else {}

    def _read(self) -> str:
        if self.which in self._stated:
            return NOT_STATED if self._stated[self.which] is None else TYPED
        return OWN if self.camera.uncertainty else NOT_STATED

    def _choose(self, option: str) -> None:
        stated = self._stated
        if option == TYPED:
            known = self.camera.uncertainty and lens_prior(self.camera, None)
            stated[self.which] = (known.focal, known.centre_px) if known else (None, None)
        elif option == NOT_STATED and self.camera.uncertainty:
            stated[self.which] = None
        else:
            stated.pop(self.which, None)
        self._keep(option, lens_known=stated)

    def _read_number(self, at: int) -> float | None:
        value = (self._stated.get(self.which) or (None, None))[at]
        return None if value is None else float(f"{value * (100, 1)[at]:.6g}")

    def _take(self, at: int, value: float | None) -> None:
        numbers = list(self._stated.get(self.which) or (None, None))
        numbers[at] = None if value is None else float(value) / (100, 1)[at]
        self._keep(TYPED, lens_known={**self._stated, self.which: tuple(numbers)})


def _metres(mm: float | None) -> float | None:
    return None if mm is None else float(mm) / 1000
