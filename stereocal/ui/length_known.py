"""How well a measured length is known, asked beside it, and a lens: a preset, or a typed standard
deviation."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.fit.in_words import lens_sigmas
from stereocal.fit.least_squares import unknowns
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, Camera, CameraName
from stereocal.ui.fields import Field, Number, one_of
from stereocal.ui.messages import refusing
from stereocal.ui.project import project_to_write

NOT_STATED, TYPED, OWN, FREE = "Not stated", "Typed", "own", "Not measured"
PRINTED = "Printer"
PRESETS_MM = {"Laser range finder": 2.0, "Tape": 5.0, "Total station": 1.0, "Caliper": 0.1}
OF_PRINTER = 0.003
"""Standard deviation of a printed length, a fraction: printers and paper stretch by so much."""
TITLES = {
    **{name: f"{name}: ± {mm:g} mm" for name, mm in PRESETS_MM.items()},
    PRINTED: f"As printed, not measured: ± {100 * OF_PRINTER:g} %",
    TYPED: "Typed, in mm",
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


def give_lengths(settings: Mapping[str, Any], values: Mapping[str, Any]) -> None:
    """Store inputs, and how they are stated."""
    with refusing():
        project = project_to_write()
        project.give({}, **values)
        project.keep_settings({**settings})


def ask_known(
    project: Project | None, name: str, assumed: str, length_m: float | None = None
) -> None:
    """The fields of a length's uncertainty: a preset, or a typed value.

    Args:
        name: `baseline_m` or `target_distance_m`.
        assumed: what holds where nothing is stated, in words.
        length_m: the length, where the inputs do not have it; None: as they have it.
    """
    if length_m is None and project is not None:
        length_m = getattr(project.inputs, name)
    key, baseline = f"{name}_known", name == "baseline_m"
    sigma = sigma_of(name)

    def mm() -> float | None:
        return scaled(getattr(project.inputs, sigma) if project else None, 1000)

    def read() -> str:
        if baseline and project is not None and project.inputs.baseline_free:
            return FREE
        chosen = project and project.settings.get(key)
        if (stated := mm()) is None:
            # Of a length that is not there yet, no share is known.
            waits = chosen == PRINTED and length_m is None
            return str(chosen) if chosen == TYPED or waits else NOT_STATED
        return str(chosen) if _preset_mm(length_m, str(chosen)) == stated else TYPED

    def choose(option: str) -> None:
        free = {"baseline_free": option == FREE} if FREE in (option, read()) else {}
        preset = _preset_mm(length_m, option)
        stated = {} if option == TYPED else {sigma: preset and preset / 1000}
        give_lengths({key: option}, {**stated, **free})

    def take(stated: float | None) -> None:
        give_lengths({key: TYPED}, {sigma: stated and stated / 1000})

    left, right = st.columns([3, 2], vertical_alignment="bottom")
    titles = {NOT_STATED: f"Not known: {assumed} assumed"} | TITLES
    del titles[PRINTED if baseline else FREE]
    hint = HELP.format(assumed=assumed) + HELP_ON_FREE * baseline
    field = Field(key, key, read, choose, fit=one_of(titles))
    named = titles.__getitem__
    if field.menu("How well is it known?", left, format_func=named, help=hint) == TYPED:
        ask_number("± mm", f"{name}_sigma_mm", mm, take, right, least=LEAST_MM)


def _preset_mm(length_m: float | None, option: str) -> float | None:
    """What an option says of a length; None if it says nothing."""
    if option != PRINTED:
        return PRESETS_MM.get(option)
    return scaled(length_m and OF_PRINTER * length_m, 1000)


def sigma_of(name: str) -> str:
    """The name of the standard deviation of a length."""
    return f"{name.removesuffix('_m')}_sigma_m"


def ask_number(
    title: str,
    key: str,
    read: Callable[[], float | None],
    take: Callable[[float | None], None],
    place: DeltaGenerator,
    least: float = 0.0,
    hint: str | None = None,
) -> None:
    field = Field(key, key, read, take, fit=Number(least, or_none=True))
    field.number_input(title, place, format="%.6g", placeholder="not stated", help=hint)


def scaled(value: float | None, scale: float) -> float | None:
    """A value in the unit of its field, to the six digits that are shown."""
    return None if value is None else float(f"{scale * value:.6g}")


def ask_lenses_known(project: Project) -> None:
    """The fields of each lens's uncertainty: from its file, typed, or not stated."""
    for which, camera, column in zip(CAMERAS, project.cameras, st.columns(2), strict=True):
        if camera is not None:
            with column:
                _lens_known(project, which, camera)


def _lens_known(project: Project, which: CameraName, camera: Camera) -> None:
    """How well a lens is known: a fraction of its focal length, and pixels of its centre."""
    key = f"lens_{which}_known"

    def stated() -> dict[CameraName, Any]:
        return dict(project.inputs.lens_known)

    def read() -> str:
        known = stated().get(which, camera.uncertainty and OWN)
        return OWN if known == OWN else (TYPED if known else NOT_STATED)

    def choose(option: str) -> None:
        stay = {lens: known for lens, known in stated().items() if lens != which}
        if option == TYPED:
            prior = camera.uncertainty and unknowns.lens_prior(camera, None)
            stay[which] = (prior.focal, prior.centre_px) if prior else (None, None)
        elif option == NOT_STATED and camera.uncertainty:
            stay[which] = None
        give_lengths({key: option}, {"lens_known": stay})

    titles = {OWN: f"Its own calibration: {lens_sigmas(camera)}"} if camera.uncertainty else {}
    titles |= {NOT_STATED: NOT_STATED, TYPED: "Typed"}
    assumed = f"± {100 * unknowns.DEFAULT_FOCAL:g} % and ± {unknowns.DEFAULT_CENTRE_PX:g} px"
    title, hint = f"How well is the {which} lens known?", HELP.format(assumed=assumed)
    known = Field(key, key, read, choose, fit=one_of(titles))
    if known.menu(title, format_func=titles.__getitem__, help=hint) != TYPED:
        return

    def number(index: int, scale: float) -> float | None:
        return scaled((stated().get(which) or (None, None))[index], scale)

    def take(index: int, scale: float, value: float | None) -> None:
        values = [*(stated().get(which) or (None, None))]
        values[index] = None if value is None else value / scale
        give_lengths({key: TYPED}, {"lens_known": {**stated(), which: tuple(values)}})

    counts = "0 holds it as it is given. It counts once both numbers are there."
    numbers = (("Focal length, ± %", "focal_percent", 100), ("Image centre, ± px", "centre_px", 1))
    for index, (place, (title, name, scale)) in enumerate(zip(st.columns(2), numbers, strict=True)):
        shown, store = partial(number, index, scale), partial(take, index, scale)
        ask_number(title, f"lens_{which}_{name}", shown, store, place, hint=counts)
