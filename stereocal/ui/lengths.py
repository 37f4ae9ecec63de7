"""The measured lengths on the Data page: values and units, and a question about planned ones."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import cycle
from typing import Any

import numpy as np
import streamlit as st

from stereocal.fit.start.pairs import pair_name
from stereocal.projects.given import ProjectGiven
from stereocal.projects.inputs import LENGTHS, Length
from stereocal.projects.project import Project
from stereocal.rig import lengths_in_words as words
from stereocal.rig.measured_lengths import LONGEST_PLAUSIBLE_M, check_length
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.system.numbers import rounded
from stereocal.ui.fields import Field, Number, choose_from_menu, one_of, setting
from stereocal.ui.files_of_all import FilesOfAll
from stereocal.ui.holding import holds_board
from stereocal.ui.length_known import (
    OF_PRINTER,
    PRINTED,
    ask_known,
    ask_lenses_known,
    give_lengths,
    sigma_of,
)
from stereocal.ui.messages import button, readable, refusing
from stereocal.ui.photographs import has_photographs
from stereocal.ui.project import current_project, project_to_write
from stereocal.ui.texts import escape_markdown
from stereocal.workflow.rough_pose import rough_pose

KEPT_ANSWER = "lengths_in_metres"
"""Setting: the baseline and the bar that the user has said to be in metres."""

BOTH: tuple[Length, ...] = ("baseline_m", "target_distance_m")


def ask_lengths(project: Project | None, files: FilesOfAll | None) -> None:
    """The measured lengths and the lenses, and how well they are known.

    Args:
        files: of three cameras and more.
    """
    if files is not None:
        _ask_lengths_of_all(files)
        return
    left, right = st.columns(2)
    with left:
        _ask_length(project, "baseline_m", "Baseline: distance between the cameras")
        if project is not None:
            _offer_nominal_baseline(project)
        ask_known(project, "baseline_m", "± 1 %")
    with right:
        if project is not None and has_photographs(project) and holds_board(project):
            st.markdown("The squares of the board are the measured lengths.")
        elif described := _object_in_words(project):
            st.markdown(described)
        else:
            _ask_length(project, "target_distance_m", "Distance between targets A and B")
        ask_known(project, "target_distance_m", "± 0.1 %")
    if project is not None:
        ask_if_measured(project)
        ask_lenses_known(project)


def _ask_lengths_of_all(files: FilesOfAll) -> None:
    """The places of the targets along the bar; once the points are read with them, the rest."""
    _ask_places(files)
    recording = readable(lambda: files.gathered.recording, warn=False)
    if recording is None:
        return
    left, right = st.columns(2)
    with left:
        _ask_baselines(files.project, recording)
    with right:
        held_object = recording.object
        st.markdown(f"The {held_object.word} is {held_object.longest_m:.6g} m long.")
        assumed = "± 0.1 %" if held_object.sigma_m is None else "what the files state"
        ask_known(files.project, "target_distance_m", assumed, held_object.longest_m)


def _ask_places(files: FilesOfAll) -> None:
    """The places of the targets along the bar, from the first."""
    first, *others = readable(lambda: files.targets, warn=False) or [""]
    for target, column in zip(others, cycle(st.columns(2) if others else ()), strict=False):
        place = files.place(target)
        label = f"{escape_markdown(f'{first} to {target}')}, along the bar"
        unit, what = _unit(files.project, place.key), f"distance from {first} to {target}"
        with column:
            _length_field(label, what, place.key, unit, place.read, place.write)


def _ask_length(project: Project | None, name: Length, label: str) -> None:
    """A length of two cameras."""

    def read() -> float | None:
        present = project or current_project()  # the first number makes the project
        return getattr(present.inputs, name) if present else None

    def store(metres: float | None) -> None:
        project_to_write().give({}, **_with_sigma(project, name, metres))

    what = LENGTHS[name].removeprefix("the ")
    _length_field(label, what, f"{name}_value", _unit(project, name), read, store)


def _ask_baselines(project: Project, recording: Recording) -> None:
    """The distances of two cameras that were measured, and how well they are known."""

    def measured() -> Mapping[str, float]:
        of_files = {pair_name(pair): metres for pair, metres in recording.baselines_m.items()}
        return project.inputs.baselines_m or of_files

    baselines, names = measured(), [*map(pair_name, recording.pairs)]
    default = next(iter(baselines), None)
    title = "Measured distance of two cameras"
    hint = "Any of them, or none: the bars give the scale."
    pair = choose_from_menu(project, "baseline_of", title, names, default, help=hint)

    def read() -> float | None:
        return measured().get(pair)

    def store(metres: float | None) -> None:
        present = measured()
        if metres != present.get(pair):
            added = {} if metres is None else {pair: metres}
            rest = {name: length for name, length in present.items() if name != pair}
            project.give({}, baselines_m=rest | added)

    unit, what = _unit(project, "rig"), f"distance of the cameras {pair}"
    label = f"Cameras {escape_markdown(pair)}"
    is_typed = pair in project.inputs.baselines_m
    _length_field(label, what, f"baseline_{pair}", unit, read, store, is_typed)
    if baselines:
        per = words.METRES_PER[unit.value()]
        listed = (f"{name} {metres / per:.6g} {unit.value()}" for name, metres in baselines.items())
        st.caption(f"Measured: {escape_markdown(', '.join(listed))}")
        ask_known(project, "baseline_m", "± 1 %")


def _length_field(
    label: str,
    what: str,
    key: str,
    stored_unit: Field,
    read: Callable[[], float | None],
    store: Callable[[float | None], object],
    is_typed: bool = True,
) -> None:
    """A length, and its unit in a menu beside it.

    Args:
        what: it is, in messages.
        stored_unit: the unit in use.
        read, store: the length in metres; None: it is not stated.
        is_typed: whether a person has typed it, or may.
    """

    def shown() -> float | None:
        metres = read()
        return None if metres is None else _as_typed(metres / words.METRES_PER[stored_unit.value()])

    def take(number: float | None, unit: str) -> None:
        metres = None if number is None else _as_typed(number * words.METRES_PER[unit])
        ways = {}
        if unit != "mm" and metres is not None and metres > LONGEST_PLAUSIBLE_M:
            ways[f"It is {number:.10g} mm"] = partial(take, number, "mm")
        with refusing(ways):
            if metres is not None:
                check_length(what, metres)
            store(metres)
            project_to_write().keep_settings({stored_unit.name: unit})

    number = Field(
        key,
        key,
        shown,
        lambda value: take(value, stored_unit.value()),
        fit=Number(0.0, or_none=True),
    )
    # Keeps the number that was typed, in the new unit; that of a file is a length.
    write = (lambda chosen: take(number.shown(), chosen)) if is_typed else stored_unit.write
    unit = replace(stored_unit, write=write)
    left, right = st.columns([3, 1], vertical_alignment="bottom")
    number.number_input(label, left, format="%.10g", placeholder="measured length")
    unit.menu("Unit", right)


def _as_typed(number: float) -> float:
    """A number without what a change of its unit adds in its last digits."""
    return float(f"{number:.12g}")


def _with_sigma(project: Project | None, name: str, metres: float | None) -> dict[str, Any]:
    """A length to store, and with one as printed its standard deviation, which is a share of it."""
    values: dict[str, Any] = {name: metres}
    if project is not None and project.settings.get(f"{name}_known") == PRINTED:
        values[sigma_of(name)] = metres and OF_PRINTER * metres
    return values


def _unit(project: Project | None, name: str) -> Field:
    """The unit in which a length is shown; each tab may show it in its own."""
    return setting(project, f"{name}_unit", "m", one_of(words.METRES_PER), tabs_own=True)


def _offer_nominal_baseline(project: Project) -> None:
    """The baseline that the camera files state, until one is entered or left free."""
    inputs = project.inputs
    if inputs.baseline_m is not None or inputs.baseline_free:
        return
    nominal = readable(lambda: ProjectGiven(project).nominal_baseline)
    if nominal is None:
        return
    metres, sigma = nominal
    st.caption(
        f"The camera files state {rounded(metres, 4)} m. It is the other program's result, not a "
        "measurement: measure it, or use it as it is."
    )
    stated = {"baseline_m": metres, "baseline_sigma_m": sigma}
    label = f"Use {rounded(metres, 4)} m ± {rounded(100 * sigma / metres)} %"
    button(label, "use_nominal_baseline", give_lengths, {}, stated)


def _object_in_words(project: Project | None) -> str:
    """The object whose targets the table shows; empty for a bar of A and B."""
    dataset = readable(lambda: project.dataset) if project is not None else None
    rigid_object = None if dataset is None else dataset.correspondences.rigid_object
    if rigid_object is None:
        return ""
    return (
        f"An object with {len(rigid_object.names)} targets, up to {rigid_object.longest_m:.4g} m "
        "apart: their distances are the measured lengths."
    )


def ask_if_measured(project: Project) -> None:
    """Ask about planned lengths that nobody has measured yet."""
    inputs = project.inputs
    if not inputs.needs_measuring:
        return
    lengths = " and ".join(
        f"{LENGTHS[name]} ({getattr(inputs, name):.12g} m)" for name in inputs.needs_measuring
    )
    st.warning(
        f"**Planned, not yet measured:** {lengths}. Enter on the Data page what you measure: an "
        "error in a length becomes an error of every result."
    )
    button("Measured: they are as planned", "take_planned", project.take_planned)


def show_rig(project: Project, dataset: Pair) -> None:
    """The rig in words to check, and a question if its lengths may be in another unit."""
    pose = rough_pose(dataset)
    stated = [dataset.baseline_m, dataset.target_distance_m]
    files = project.inputs.files
    if files.get("primary") == files.get("secondary"):
        st.warning(
            "Both cameras have the same file. Two lenses are never alike, even of one model: give "
            "each camera its own."
        )
    typed = [name for name in _asked(dataset) if _unit(project, name).value() != "m"]
    question = words.question_about_units(dataset, pose, not typed)
    if not question or project.settings.get(KEPT_ANSWER) == stated:
        st.markdown(escape_markdown(words.rig_in_words(dataset, pose)))
        return
    st.warning(escape_markdown(question))
    with st.container(horizontal=True):
        answer = {KEPT_ANSWER: stated}
        if typed:
            button("They are right", "lengths_right", project.keep_settings, answer)
            metres = {name: _number(project, name) for name in typed}
            shown = " and ".join(f"{LENGTHS[name]} {m:.10g} m" for name, m in metres.items())
            button(f"In metres: {shown}", "in_metres", _take_in_metres, project, metres)
            return
        button("They are in metres", "in_metres", project.keep_settings, answer)
        both = _asked(dataset) == BOTH
        units = words.units_that_fit(dataset) if both else ()
        offers = [(f"They are in {unit}", f"in_{unit}", unit, BOTH) for unit in units]
        if both and dataset.target_distance_m > words.LONG_BAR_M:
            offers += [
                (f"Only A to B is in {unit}", f"bar_in_{unit}", unit, BOTH[1:])
                for unit in ("mm", "cm")
            ]
        for label, key, unit, names in offers:
            button(label, key, _take_unit, project, unit, names)


def _asked(dataset: Pair) -> tuple[Length, ...]:
    """The lengths that a person typed, of a baseline that is free or of a board none."""
    of_board = np.isfinite(dataset.correspondences.distance_m).any()
    return BOTH[int(dataset.baseline_is_free) : 1 if of_board else 2]


def _number(project: Project, name: str) -> float:
    """The number of a length in the unit of its field, as typed."""
    per = words.METRES_PER[_unit(project, name).value()]
    return _as_typed(getattr(project.inputs, name) / per)


def _take_in_metres(project: Project, metres: Mapping[str, float]) -> None:
    """Take the numbers that were typed as metres, and ask no more about the lengths they make."""
    values: dict[str, Any] = {}
    for name, length in metres.items():
        values |= _with_sigma(project, name, length)
    project.give({}, **values)
    for name in metres:
        _unit(project, name).set("m")
    if (dataset := project.dataset) is not None:
        lengths = [dataset.baseline_m, dataset.target_distance_m]
        project.keep_settings({KEPT_ANSWER: lengths})


def _take_unit(project: Project, unit: str, names: Sequence[str]) -> None:
    """These lengths, which were typed in metres, are in this unit."""
    values: dict[str, Any] = {}
    for name in names:
        metres = getattr(project.inputs, name) * words.METRES_PER[unit]
        values |= _with_sigma(project, name, metres)
    project.give({}, **values)
