"""Why two sets, on the real recording: length errors, epipolar lines, and two rays that miss.

`python -m tools.story` computes the figures' numbers; they are read from a file, so that the
Start page opens at once.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go

from stereocal.calibration.methods import PAPER_SETS, Method
from stereocal.figures import style
from stereocal.figures.style import METHOD_COLOURS, METHOD_NAMES, NEUTRAL, add_trace, blank
from stereocal.rig.camera import CAMERAS
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import rounded

HEIGHT = 264
BEST = 0.98
"""Part of the bars and pairs that the means take: some detections of the recording are wrong."""
ROWS: Mapping[Method, str] = {
    "essential": "One set, by the book (essential matrix)",
    "3d": "Two sets (the 3D set measures)",
    "refined": "One refined set",
}
SHOWN_PERCENT = (-2.0, 4.0)
"""Length errors outside are not drawn, but counted."""
SMALL: Mapping[str, Any] = {"showarrow": False, "font": {"size": 13}}
DASHES = ("solid", "dash", "solid", "dot")
REACH_PX = 12.0
"""Half the side of the picture of epipolar lines."""


@dataclass(frozen=True)
class HeldOutSet:
    """One parameter set on the held-out frames."""

    length_errors: tuple[float, ...]
    """(D^R - D) / D of each bar."""
    reprojection_px: float
    """Mean reprojection error of the best 98 % of the pairs."""
    line_px: tuple[tuple[float, float], tuple[float, float]]
    """Epipolar line of the example in the secondary image: the point nearest to the measured one,
    relative to it, and the unit direction."""
    gap_m: float
    """Distance between the example's two rays."""

    @property
    def length_error(self) -> float:
        """Mean of |D^R - D| / D over the best 98 % of the bars."""
        return best_mean(np.abs(self.length_errors))

    @property
    def line_distance_px(self) -> float:
        """Distance of the epipolar line from the example's point."""
        return float(np.hypot(*self.line_px[0]))


@dataclass(frozen=True)
class Story:
    """The sets fitted to half of a recording, tested on the other half."""

    fitted: int
    """Number of frames that the sets were fitted to."""
    frame: int
    """The example: a held-out frame."""
    target: str
    sets: Mapping[Method, HeldOutSet]

    def to_json(self) -> str:
        return json.dumps(asdict(self), separators=(",", ":")) + "\n"


def read_story(path: Path) -> Story:
    """The numbers as written by `Story.to_json`."""
    content = json.loads(path.read_text(encoding="utf-8"))
    return Story(**content | {"sets": {key: HeldOutSet(**s) for key, s in content["sets"].items()}})


def best_mean(errors: FloatArray) -> float:
    """Mean of the smallest 98 % of the errors; NaN, behind a camera, counts as largest."""
    return float(np.sort(errors)[: int(BEST * len(errors))].mean())


def plot_story_lengths(story: Story) -> go.Figure:
    """The length error of each held-out bar, a row for each set, on one axis in percent."""
    figure = blank(HEIGHT)
    for row, (method, name) in enumerate(ROWS.items()):
        figures = story.sets[method]
        # Scattered about the row by the golden ratio, in the order of the frames.
        scatter = 0.5 * (np.arange(len(figures.length_errors)) * 0.6180339887 % 1.0) - 0.42
        dots = np.column_stack([100 * np.array(figures.length_errors), scatter - row])
        marker = style.marker_of(method, 5, opacity=0.7)
        add_trace(figure, dots, "%{x:.2f} %", marker=marker, name=name, showlegend=False)
        text = f"{name}: <b>{rounded(100 * figures.length_error)} %</b>"
        left = {"x": 0, "xref": "paper", "xanchor": "left", "yanchor": "bottom"}
        figure.add_annotation(text=text, y=0.13 - row, **left, **SMALL)
        _line(figure, np.array([[0.0, -row - 0.45], [0.0, -row + 0.11]]), width=1.5)
    best = f"Bold: mean size, best {100 * BEST:g} % of the bars"
    title = f"Length error of held-out bars (%)<br>{best}"
    figure.update_xaxes(range=SHOWN_PERCENT, showgrid=False, title_text=title)
    figure.update_yaxes(visible=False, range=[-2.5, 0.6])
    return figure


def describe_story_lengths(story: Story) -> str:
    """The mean length errors of the sets."""
    parts = [
        f"{name[0].lower()}{name[1:]} {rounded(100 * story.sets[method].length_error)} %"
        for method, name in ROWS.items()
    ]
    errors = np.array([story.sets[method].length_errors for method in ROWS])
    low, high = np.array(SHOWN_PERCENT) / 100
    outside = int((~((low <= errors) & (errors <= high))).any(axis=0).sum())
    return (
        f"A real recording: sets fitted to the {story.fitted} even frames, and tested on the "
        f"{errors.shape[1]} odd ones. Mean length error of the best 98 % of these bars (a few "
        f"detections are wrong): {', '.join(parts)}. Each dot is a bar; {outside} bars have an "
        f"error outside {SHOWN_PERCENT[0]:g} to {SHOWN_PERCENT[1]:g} % and are not drawn."
    )


def plot_story_lines(story: Story) -> go.Figure:
    """The epipolar line of one held-out point with each set, about its measured partner."""
    figure, names = blank(HEIGHT), []
    for (method, figures), dash in zip(story.sets.items(), DASHES, strict=True):
        start, along = np.array(figures.line_px)
        name = f"{METHOD_NAMES[method]}: {rounded(figures.line_distance_px)} px"
        names.append(f'<span style="color:{METHOD_COLOURS[method]}">■</span> {name}')
        ends = start + np.outer([-4 * REACH_PX, 4 * REACH_PX], along)
        _line(figure, ends, METHOD_COLOURS[method], 3, dash, name)
    cross = {"symbol": "cross-thin", "size": 16, "color": NEUTRAL}
    cross["line"] = {"width": 3, "color": NEUTRAL}
    add_trace(
        figure, np.zeros((1, 2)), "name", name="Measured point", showlegend=False, marker=cross
    )
    # The lines rise to the right: there is room for their names below.
    corner = {"x": 0.99, "y": 0.01, "xref": "paper", "yref": "paper", "align": "left"}
    corner |= {"xanchor": "right", "yanchor": "bottom", **SMALL}
    figure.add_annotation(text="<br>".join(names), **corner)
    common = {"constrain": "domain", "dtick": 4}
    title = "Pixels from the measured point"
    figure.update_xaxes(range=[-REACH_PX, REACH_PX], title_text=title, **common)
    figure.update_yaxes(range=[REACH_PX, -REACH_PX], scaleanchor="x", **common)
    return figure


def describe_story_lines(story: Story) -> str:
    """The distances of the lines, and the mean reprojection errors of the sets."""

    def of_sets(figure: str) -> str:
        values = {method: getattr(figures, figure) for method, figures in story.sets.items()}
        return ", ".join(f"{METHOD_NAMES[name]} {rounded(px)} px" for name, px in values.items())

    away, means = of_sets("line_distance_px"), of_sets("reprojection_px")
    return (
        f"Target {story.target} of the held-out frame {story.frame} in the secondary image. Its "
        f"epipolar line, on which the point of the primary image must lie, misses it by: "
        f"{away}. Mean reprojection error of the best 98 % of all held-out pairs: {means}."
    )


ON_RAYS = np.array([[4.1, 5.6], [5.9, 5.1]])
"""Where the drawn rays are nearest to each other."""
IMAGE_AT = 0.4
"""Fraction of the way from the camera to that place."""


def plot_two_rays(story: Story) -> go.Figure:
    """A drawing, not to scale: two rays that miss, the gap, its middle, and its images."""
    figure, middle = blank(HEIGHT), ON_RAYS.mean(axis=0)
    cameras = np.array([[1.0, 0.7], [9.0, 0.7]])
    for camera, on_ray, name in zip(cameras, ON_RAYS, CAMERAS, strict=True):
        seen, back = (camera + IMAGE_AT * (to - camera) for to in (on_ray, middle))
        across = (back - seen) / np.linalg.norm(back - seen)
        plane = np.array([seen - 0.9 * across, back + 0.9 * across])
        _line(figure, np.array([camera, camera + 1.06 * (on_ray - camera)]))
        _line(figure, np.array([camera, middle]), width=1.5, dash="dot")
        _line(figure, plane)
        _line(figure, np.array([seen, back]), METHOD_COLOURS["2d"], 6)
        below = {"x": camera[0], "y": camera[1] - 0.25, "yanchor": "top", "showarrow": False}
        figure.add_annotation(text=name, **below)
    _line(figure, ON_RAYS, METHOD_COLOURS["3d"], 4)
    square = {"symbol": "square", "color": NEUTRAL, "size": 14}
    disc = {"symbol": "circle", "color": METHOD_COLOURS["3d"], "size": 10}
    for points, marker in ((cameras, square), (middle[None], disc)):
        add_trace(figure, points, marker=marker, showlegend=False)
    two, three = _gaps_mm(story)
    gap = f"gap {two} mm with the 2D set,<br>{three} mm with the 3D set;"
    figure.add_annotation(x=5.0, y=7.2, text=f"{gap}<br>its middle is the 3D point", **SMALL)
    figure.add_annotation(x=5.0, y=2.6, text="reprojection<br>error", **SMALL)
    figure.update_xaxes(visible=False, range=[-0.2, 10.2], fixedrange=True)
    figure.update_yaxes(visible=False, range=[-0.2, 8.0], fixedrange=True)
    return figure


def describe_two_rays(story: Story) -> str:
    """What the drawing shows, with the gaps of the example."""
    two, three = _gaps_mm(story)
    return (
        "The rays of the two image points miss each other, because images are noisy and lenses a "
        "little wrong. The reconstructed point is the middle of the gap, and its images are the "
        "reprojection error away from the measured points. The 2D set makes that error small, so "
        "that it finds which points belong together; the 3D set makes the distances between the "
        f"middles right, and widens the gap for it: {two} mm with the 2D set and {three} mm with "
        f"the 3D set, for target {story.target} of frame {story.frame}."
    )


def _gaps_mm(story: Story) -> list[str]:
    return [rounded(1000 * story.sets[name].gap_m) for name in PAPER_SETS]


def _line(
    figure: go.Figure,
    ends: FloatArray,
    colour: str = NEUTRAL,
    width: float = 2,
    dash: str = "solid",
    name: str | None = None,
) -> None:
    line, hover = style.line_of(colour, width, dash), "name" if name else ""
    add_trace(figure, ends, hover, line=line, name=name, showlegend=False)
