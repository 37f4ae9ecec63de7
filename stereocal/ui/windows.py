"""The question on the Data page whether the cameras look through windows, and into what."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.projects.given import ProjectGiven
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from stereocal.rig.window import GLASS, LARGEST_INDEX, THICKNESS_M, WATER, StatedWindow
from stereocal.ui.fields import Field, Number, one_of
from stereocal.ui.length_known import ask_number, give_lengths, scaled
from stereocal.ui.messages import readable
from stereocal.ui.texts import escape_markdown

QUESTION = "Filmed through glass or into water?"
NO, ONE, EACH = "No", "One window for all cameras", "One for each camera"
AS_STATED = "As the data set states"
LEAST_INDEX, LEAST_M = 1.001, 0.001
OTHER = "Other"
Index = Literal["medium", "glass"]
INDICES: Mapping[Index, Mapping[str, float]] = {
    "glass": {"Glass (1.52)": GLASS, "Acrylic (1.49)": 1.49},
    "medium": {"Fresh water (1.333)": WATER, "Sea water (1.340)": 1.34},
}
TITLES: Mapping[Index, str] = {"glass": "Window made of", "medium": "Behind the window"}
HELP = (
    "Glass or acrylic between the cameras and the water refracts their rays. The thickness is 0 mm "
    "where a camera looks into the water from above. Lenses that were calibrated in the water, by "
    "a board, are used as they are with *No*: in simulations lengths were then 0.8 % off at the "
    "distances of the board, and 1.6 % nearer to the glass. With the window, and lenses calibrated "
    "in air, it was 0.2 %."
)
DISTANCE_HELP = (
    "Measured from the front of the lens, square to the glass. Leave it empty to have it found."
)


def ask_windows(project: Project | None) -> None:
    """Whether the cameras look through windows, and their measures."""
    if project is None or not (project.holds_recording or not ProjectGiven(project).is_of_rig):
        return  # the cameras are not known yet
    recording = readable(lambda: project.recording, warn=False)
    if recording is not None and any(it.window for it in recording.cameras.values()):
        st.caption("The camera files state the window of a camera.")
        return
    names = CAMERAS if recording is None else tuple(recording.cameras)
    asked = readable(lambda: _Asked(project, names, project.windows))
    if asked is None:
        return
    key, fits = "window_kind", (NO, ONE, EACH, *([AS_STATED] if asked.kind == AS_STATED else []))
    kind = Field(key, key, lambda: asked.kind, asked.choose, fit=one_of(fits))
    if kind.menu(QUESTION, help=HELP, width=320) != NO:
        asked.ask()


@dataclass(frozen=True)
class _Asked:
    """The windows as stated."""

    project: Project
    names: tuple[str, ...]
    windows: tuple[StatedWindow, ...]

    @property
    def groups(self) -> dict[str, list[tuple[str, ...]]]:
        return {NO: [], ONE: [self.names], EACH: [(name,) for name in self.names]}

    @property
    def kind(self) -> str:
        """The answer to the question."""
        stated = [window.cameras for window in self.windows]
        return next((kind for kind, groups in self.groups.items() if groups == stated), AS_STATED)

    def choose(self, kind: str) -> None:
        """Store another answer; what was stated of the first window is that of all."""
        first, *_ = (*self.windows, StatedWindow(self.names, THICKNESS_M))
        alike = replace(
            first, distance_m=None, normal=None, distance_sigma_m=None, normal_sigma_deg=None
        )
        if kind != AS_STATED:
            self._store([replace(alike, cameras=cameras) for cameras in self.groups[kind]])

    def ask(self) -> None:
        """The fields of what is measured."""
        thickness, glass, medium, *rest = st.columns(3 + (len(self.windows) == 1))
        first = self.windows[0]
        millimetres = Field(
            *2 * ("window_thickness_mm",),
            lambda: scaled(first.thickness_m, 1000),
            lambda value: self._change(thickness_m=value / 1000),
            fit=Number(0.0, 1000.0),
        )
        millimetres.number_input("Thickness, mm", thickness, format="%.6g")
        self._ask_index("glass", glass)
        self._ask_index("medium", medium)
        for number, place in enumerate(rest or st.columns(len(self.windows))):
            self._ask_distance(number, place)

    def _ask_index(self, which: Index, place: DeltaGenerator) -> None:
        """A material of known index, or its index."""
        key, known = f"window_{which}", INDICES[which]
        index: float = getattr(self.windows[0], which)
        named = {value: title for title, value in known.items()}

        def read() -> str:
            typed = self.project.settings.get(key) == OTHER
            return OTHER if typed else named.get(index, OTHER)

        def choose(title: str) -> None:
            self._change({key: title}, **{which: known.get(title, index)})

        field = Field(key, key, read, choose, fit=one_of((*known, OTHER)))
        if field.menu(TITLES[which], place) == OTHER:
            take = partial(self._take_index, which)
            typed = Field(
                *2 * (f"{key}_index",), lambda: index, take, fit=Number(LEAST_INDEX, LARGEST_INDEX)
            )
            typed.number_input("Index of refraction", place, format="%.6g", step=0.001)

    def _take_index(self, which: Index, value: float) -> None:
        self._change({f"window_{which}": OTHER}, **{which: value})

    def _ask_distance(self, number: int, place: DeltaGenerator) -> None:
        window = self.windows[number]
        camera = window.cameras[0]

        def take(metres: float | None) -> None:
            sigma = None if metres is None else window.distance_sigma_m
            changed = replace(window, distance_m=metres, distance_sigma_m=sigma)
            before, after = self.windows[:number], self.windows[number + 1 :]
            self._store([*before, changed, *after])

        title, key = f"From {escape_markdown(camera)} to the glass, m", f"window_distance_{camera}"
        ask_number(title, key, lambda: window.distance_m, take, place, LEAST_M, DISTANCE_HELP)

    def _change(self, settings: Mapping[str, str] | None = None, /, **values: float) -> None:
        """Store something else of all windows, and how it was chosen."""
        changed = [replace(window, **values) for window in self.windows]  # type: ignore[arg-type]
        self._store(changed, settings)

    def _store(
        self, windows: list[StatedWindow], settings: Mapping[str, str] | None = None
    ) -> None:
        give_lengths(settings or {}, {"windows": [window.to_json() for window in windows]})
