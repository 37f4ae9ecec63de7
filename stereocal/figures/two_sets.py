"""Why two sets: one frame seen with each parameter set, in both images and in space.

A set that matches well has epipolar lines that pass through the points, and rays that nearly meet.
A set that measures well gives the bar its length. No set of the paper does both.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import plotly.graph_objects as go

from stereocal.calibration.methods import METHOD_NAMES, PAPER_SETS, Method
from stereocal.errors import StereocalError
from stereocal.figures import style
from stereocal.figures.space import SCENE_AXIS
from stereocal.fit.results import Calibration
from stereocal.fit.screening.outliers import bar_frames, frame_reprojection_px
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.fisheye import LARGEST_ANGLE
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import rounded
from stereocal.verdict.in_words import percent

ON_LINE = 200
"""Points of a drawn epipolar line, which distortion bends."""
HEIGHT = 480
DOMAINS = (((0.0, 1.0), (0.478, 1.0)), ((0.0, 0.47), (0.0, 0.378)), ((0.53, 1.0), (0.0, 0.378)))
"""Parts of the width and height for each panel: the image, and a close-up of each target."""
SMALLEST_WINDOW_PX, SMALLEST_WINDOW_M = 3.0, 1e-4


@dataclass(frozen=True, eq=False)
class FrameView:
    """One frame seen with one set."""

    method: Method
    rig: Rig
    dataset: Pair
    frame: int

    @cached_property
    def rows(self) -> IntArray:
        """(n,): the rows of the frame's targets, 1 or 2; of an object those farthest apart."""
        rows = self.dataset.correspondences
        if rows.rigid_object is None:
            return np.flatnonzero(rows.frame == self.frame)
        part = rows.parts[0]
        return np.flatnonzero(part == part[rows.frame == self.frame].min())

    @cached_property
    def letters(self) -> list[str]:
        """(n,): the targets' names."""
        rows = self.dataset.correspondences
        return [rows.names[target] for target in rows.target[self.rows]]

    @cached_property
    def pixels(self) -> tuple[FloatArray, FloatArray]:
        """(n, 2) for each camera: the targets in the images as recorded."""
        rows = self.dataset.correspondences
        return rows.primary[self.rows], rows.secondary[self.rows]

    @property
    def cameras(self) -> tuple[Camera, Camera]:
        """The primary and the secondary camera of the set."""
        return self.rig.primary, self.rig.secondary

    @cached_property
    def rays(self) -> list[FloatArray]:
        """(n, 2) for each camera: undistorted, normalised."""
        return [lens.undistort(px) for lens, px in zip(self.cameras, self.pixels, strict=True)]

    @cached_property
    def distances_px(self) -> FloatArray:
        """(n, 2): distance of the points from the epipolar lines, in pixels as of `Camera`."""
        return self.rig.epipolar_distances(*self.pixels)

    @cached_property
    def nearest_m(self) -> FloatArray:
        """(n, 2, 3): the ends of the shortest segment between the rays, in the primary's frame."""
        primary_from_secondary = self.rig.pose.inverse()
        centre = primary_from_secondary.T
        points_m = []
        for first, second in zip(*self.rays, strict=True):
            d = np.append(first, 1.0)
            e = primary_from_secondary.R @ np.append(second, 1.0)
            # Least squares of s d - (centre + r e).
            (s, r), *_ = np.linalg.lstsq(np.column_stack([d, -e]), centre, rcond=None)
            points_m.append([s * d, centre + r * e])
        return np.array(points_m)

    @cached_property
    def gaps_m(self) -> FloatArray:
        """(n,): the shortest distance between the two rays of each target."""
        return np.asarray(np.linalg.norm(np.diff(self.nearest_m, axis=1)[:, 0], axis=1))

    @cached_property
    def length_m(self) -> float | None:
        """The bar's length; None with one target."""
        middle = self.nearest_m.mean(axis=1)
        return float(np.linalg.norm(middle[0] - middle[1])) if len(middle) == 2 else None

    @cached_property
    def stated_m(self) -> float | None:
        """The measured length of the bar; None with one target."""
        rows = self.dataset.correspondences
        bars = np.flatnonzero(rows.frame[rows.bars[:, 0]] == self.frame)
        return float(self.dataset.bar_distances_m[bars[0]]) if len(bars) else None

    def line(self, camera: int, target: int) -> FloatArray:
        """(m, 2): the epipolar line of a target's partner in the image as recorded, in pixels.

        A curve; NaN where it leaves the image of a fisheye, to which it may come back.
        """
        E = self.rig.pose.essential
        partner = np.append(self.rays[1 - camera][target], 1.0)
        a, b, c = E @ partner if camera == 1 else partner @ E
        lens = self.cameras[camera]
        width, height = lens.image_size
        corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], float)
        if lens.is_fisheye:  # its image is far from a rectangle on the plane z = 1
            border = np.tan(LARGEST_ANGLE) * np.array([[-1.0, -1.0], [1.0, 1.0]])
        else:
            border = lens.undistort(corners * (1 - 1e-3) + 5e-4 * np.array([width, height]))
        foot = -c * np.array([a, b]) / (a * a + b * b)
        along = np.array([-b, a]) / np.hypot(a, b)
        reach, away = (border - foot) @ along, np.hypot(1.0, np.linalg.norm(foot))
        low, high = np.arctan([reach.min() / away, reach.max() / away])
        steps = away * np.tan(np.linspace(low, high, ON_LINE))  # evenly in angle
        steps = np.union1d(steps, (self.rays[camera][target] - foot) @ along)
        points = foot + steps[:, None] * along
        inside = ((points >= border.min(axis=0)) & (points <= border.max(axis=0))).all(axis=1)
        pixels = lens.distort(points[inside & lens.uses(points)])
        if lens.is_fisheye:
            pixels[~((pixels >= 0) & (pixels <= corners[2])).all(axis=1)] = np.nan
        return pixels


Views = Mapping[Method, FrameView]
"""A frame with each set."""


def frame_views(calibration: Calibration, frame: int) -> dict[Method, FrameView]:
    """A frame with the paper's two sets, and with the refined one if there is one."""
    dataset = calibration.dataset
    if frame not in dataset.correspondences.frames:
        raise StereocalError(f"There is no frame {frame}.")
    rigs: dict[Method, Rig] = {
        method: Rig(dataset.primary, dataset.secondary, calibration.methods[method].pose)
        for method in PAPER_SETS
    }
    if (refined := calibration.refined) is not None:
        rigs["refined"] = Rig(refined.primary, refined.secondary, refined.pose)
    return {method: FrameView(method, rig, dataset, frame) for method, rig in rigs.items()}


def telling_frame(calibration: Calibration) -> int:
    """The frame that shows best why there are two sets.

    There the reprojection error is smaller with the 2D set and the length error with the 3D set, by
    the largest parts of their maxima.
    """
    frames = bar_frames(calibration)
    every = calibration.dataset.correspondences.frames
    if not len(frames):
        return int(every[0])
    of_bars = np.searchsorted(every, frames)
    px = [frame_reprojection_px(calibration, method)[of_bars] for method in PAPER_SETS]
    length = [calibration.errors[method].length for method in PAPER_SETS]
    gain = sum(
        values / max(float(np.nanmax(np.abs(values), initial=0.0)), 1e-300)
        for values in (px[1] - px[0], length[0] - length[1])
    )
    used = np.isin(frames, calibration.frames) & np.isfinite(gain)
    return int(frames[np.argmax(np.where(used, gain, -np.inf))])


def plot_image(
    views: Views, method: Method, camera: int, photograph: style.Photograph | None = None
) -> go.Figure:
    """One image with the targets and their epipolar lines; below, close-ups of the targets.

    The close-ups have the same size with every set.
    """
    view = views[method]
    farthest = (float(view.distances_px.max()) for view in views.values())
    half = 1.4 * max(SMALLEST_WINDOW_PX, *farthest)
    width, height = view.cameras[camera].image_size
    boxes = [(-0.5, -0.5, width - 0.5, height - 0.5)]
    boxes += [(u - half, v - half, u + half, v + half) for u, v in view.pixels[camera]]
    # As plain dictionaries: subplots and updates of Plotly take four times as long.
    traces: list[dict[str, Any]] = []
    layout: dict[str, Any] = {**style.LAYOUT, "height": HEIGHT, "showlegend": False, "images": []}
    layout["margin"] = {**style.LAYOUT["margin"], "r": 16}
    for k, (box, (across, down)) in enumerate(zip(boxes, DOMAINS, strict=False)):
        number, ticks = "" if k == 0 else f"{k + 1}", "outside" if k == 0 else ""
        if photograph is not None:
            layout["images"] += style.photograph_behind(photograph, box, number)
        axes = {"xaxis": f"x{number}", "yaxis": f"y{number}"}
        traces += [{**axes, **trace} for trace in _lines(view, camera, is_whole=k == 0)]
        title = "" if k == 0 else f"{view.letters[k - 1]} ± {rounded(half)} px"
        left, top, right, bottom = box
        common = {"showgrid": False, "nticks": 4, "constrain": "domain", "mirror": True}
        common |= {"showticklabels": k == 0, "ticks": ticks}
        x = {"domain": across, "anchor": f"y{number}", "range": [left, right]}
        y = {"domain": down, "anchor": f"x{number}", "range": [bottom, top]}
        layout[f"xaxis{number}"] = style.axis_of(title, **common, **x)
        if k:  # no labels of ticks hold it off the frame
            layout[f"xaxis{number}"]["title"]["standoff"] = 16
        layout[f"yaxis{number}"] = style.axis_of(**common, **y, scaleanchor=f"x{number}")
    return go.Figure(traces, layout)


def _lines(view: FrameView, camera: int, is_whole: bool) -> list[dict[str, Any]]:
    """The targets of an image with their epipolar lines; in the whole image, those at its edge and
    their letters are not cut."""
    traces: list[dict[str, Any]] = []
    line = style.line_of(style.METHOD_COLOURS[view.method], 2 if is_whole else 3)
    for target, letter in enumerate(view.letters):
        name = f"epipolar line of {letter}"
        traces.append(style.scatter(view.line(camera, target), "name", line=line, name=name))
        drawn_as = letter if letter in style.TARGET_COLOURS else "AB"[target]
        marker = {
            "color": style.TARGET_COLOURS[drawn_as],
            "size": 9,
            "symbol": style.TARGET_SYMBOLS[drawn_as],
            "line": {"color": "white", "width": 1},
        }
        hover = (
            f"{letter} (%{{x:.2f}}, %{{y:.2f}})<br>"
            f"{view.distances_px[target, camera]:.2f} px from its line"
        )
        text = {"text": [letter], "textposition": "top right", "textfont": {"size": 16}}
        pixel = view.pixels[camera][[target]]
        traces.append(style.scatter(pixel, hover, marker=marker, cliponaxis=not is_whole, **text))
    return traces


def plot_gap(views: Views, method: Method) -> go.Figure:
    """The two rays of one target where they pass each other, in mm; equal axes.

    The target with the widest gap; the size of the view is the same with every set.
    """
    view, target = views[method], _widest(views)
    ends = view.nearest_m[target]
    middle = ends.mean(axis=0)
    reach = 1.5 * max(SMALLEST_WINDOW_M, *(float(view.gaps_m[target]) for view in views.values()))
    centres = np.zeros(3), view.rig.pose.inverse().T
    figure = style.blank(HEIGHT)
    for name, centre, end, dash in zip(CAMERAS, centres, ends, ("solid", "dash"), strict=True):
        along = (end - centre) / np.linalg.norm(end - centre)
        path = 1000 * (end + np.array([[-reach], [reach]]) * along - middle)
        line = style.line_of(width=5, dash=dash)
        style.add_trace(figure, path, "name", line=line, name=f"ray of the {name}")
    colour, gap = style.METHOD_COLOURS[method], f"gap {rounded(1000 * view.gaps_m[target])} mm"
    look = {"line": style.line_of(colour, 9), "marker": {"color": colour, "size": 4}}
    style.add_trace(figure, 1000 * (ends - middle), "name", name=gap, **look)
    axis = {**SCENE_AXIS, "range": [-1000 * reach, 1000 * reach], "nticks": 4}
    titles = {"xaxis": "x (mm)", "yaxis": "z (mm)", "zaxis": "−y (mm)"}
    figure.layout.scene = {
        "aspectmode": "cube",
        "bgcolor": style.TRANSPARENT,
        "camera": {"eye": {"x": 0.9, "y": -1.5, "z": 0.9}},
        **{name: {**axis, "title": {"text": title}} for name, title in titles.items()},
    }
    return figure


def _widest(views: Views) -> int:
    return int(np.argmax(np.max([view.gaps_m for view in views.values()], axis=0)))


def describe_gap(views: Views, method: Method) -> str:
    """The bar and the gap of one set."""
    view, target = views[method], _widest(views)
    gap = f"The rays of {view.letters[target]} pass {rounded(1000 * view.gaps_m[target])} mm apart"
    if view.length_m is None or view.stated_m is None:
        return f"{gap}."
    return f"{gap}; the bar is {view.length_m:.4f} m long (measured: {view.stated_m:.4f} m)."


def describe_image(views: Views, method: Method, camera: int) -> str:
    """How far the points of an image are from their lines."""
    distances = views[method].distances_px[:, camera]
    parts = " and ".join(
        f"{letter} {rounded(px)} px"
        for letter, px in zip(views[method].letters, distances, strict=True)
    )
    return f"Distance from the epipolar line: {parts}."


def describe_two_sets(views: Views) -> str:
    """All sets in one sentence with numbers."""
    parts: list[str] = []
    for method, view in views.items():
        name = "the refined set" if method == "refined" else f"the {METHOD_NAMES[method]}"
        px, bar = rounded(float(view.distances_px.mean())), ""
        if view.length_m is not None and view.stated_m is not None:
            error = view.length_m / view.stated_m - 1.0
            bar = f"{percent(abs(error))} % too {'long' if error > 0 else 'short'}"
            bar = "as long as measured" if abs(error) < 5e-6 else bar
        if not parts:
            parts.append(f"With {name} the epipolar lines pass {px} px from the points")
            parts[0] += f" and the bar is {bar}" if bar else ""
        else:
            parts.append(f"with {name} {px} px" + (f" and {bar}" if bar else ""))
    return f"{'; '.join(parts)}."
