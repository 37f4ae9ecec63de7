"""Reconstructed 3D points, and measured lengths compared with a known length."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from stereocal.figures.space import VIEWS, Scene, add_cameras, eye_of, set_scene, upright
from stereocal.figures.style import METHOD_COLOURS, NEUTRAL, count, finish, sentence_only
from stereocal.matching.lengths import LengthCheck
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.system.numbers import rounded

HEIGHT = 560
MAXIMUM_DRAWN = 10_000
"""Maximum number of points drawn, evenly thinned, since larger scenes rotate slowly."""
MAXIMUM_TRACKS = 500
MAXIMUM_MARKED = 1000
"""Maximum number of points of the chosen frame that are marked."""
MARK_COLOUR = "#CC79A7"
Colour = Literal["frame", "error"]
TITLES: dict[Colour, str] = {"frame": "Frame", "error": "Error (px)"}
COLOURS = ((0.0, "#1F83C4"), (0.5, "#009E73"), (1.0, "#D55E00"))
FAR_OUT = 1.5
"""Points are not drawn beyond this multiple of the extent of the central 98 %, because a single
wrong pair at a distance of kilometres would shrink the others to a dot."""


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Reconstructed points in the frame of a scene, and which of them are in view."""

    points: pd.DataFrame
    """Rows of `points.csv`."""
    scene: Scene
    tracks: Sequence[IntArray]
    """Rows that are connected by lines."""

    @cached_property
    def xyz(self) -> FloatArray:
        """(n, 3), metres."""
        return self.scene.points(self.points[["x", "y", "z"]].to_numpy(dtype=np.float64))

    @cached_property
    def seen(self) -> BoolArray:
        """(n,): finite, and not far from the others."""
        return in_view(self.xyz)

    @cached_property
    def outside(self) -> BoolArray:
        """(n,): outside the volume of the bars, by their column; false without it."""
        if "outside_volume" not in self.points:
            return np.zeros(len(self.points), dtype=bool)
        return self.points["outside_volume"].to_numpy(dtype=bool)

    @cached_property
    def shown(self) -> IntArray:
        """Rows that are drawn: those in view, evenly thinned."""
        rows = np.flatnonzero(self.seen)
        return rows[:: -(-len(rows) // MAXIMUM_DRAWN) or 1]

    @property
    def depth(self) -> float:
        """From the primary camera, exceeded by 2 % of the points in view; metres."""
        in_primary = self.scene.from_primary.inverse().apply(self.xyz[self.seen])
        return float(np.percentile(in_primary[:, 2], 98))


def plot_points(
    points: pd.DataFrame,
    colour: Colour,
    rig: Rig,
    view: str = VIEWS[0],
    tracks: Sequence[IntArray] = (),
    frame: int | None = None,
    world: Pose | None = None,
) -> go.Figure:
    """The points in the primary camera's frame or a world frame, with both cameras; equal axes,
    metres.

    Args:
        points: rows of `points.csv`.
        colour: the quantity shown as colour.
        rig: the cameras.
        view: one of `VIEWS`.
        tracks: rows that are connected by lines.
        frame: a frame to mark.
        world: `world_from_primary` of the points; None: they are in the primary's frame.
    """
    cloud = PointCloud(points, Scene.of_world(world), tracks)
    if not len(cloud.shown):
        return sentence_only("No pair meets in front of both cameras: there is nothing to draw.")
    values = points["frame" if colour == "frame" else "error_px"].to_numpy(dtype=np.float64)
    scale = {
        "colorscale": [list(stop) for stop in COLOURS],
        "cmin": float(values[cloud.shown].min()),
        "cmax": _top(values[cloud.shown], colour),
    }
    figure = finish(go.Figure(), HEIGHT)
    figure.layout.uirevision, figure.layout.showlegend = view, False
    _add_tracks(figure, cloud, values, scale)
    _add_points(figure, cloud, values, {**scale, "colorbar": _colour_bar(colour)})
    _mark_frame(figure, cloud, frame)
    add_cameras(figure, rig, cloud.depth, cloud.scene)
    seen = cloud.xyz[cloud.seen]
    # Else tracks far from the cameras are a dot in a corner.
    set_scene(figure, eye_of(view, rig, np.median(seen, axis=0), cloud.scene, seen), cloud.scene)
    return figure


def _colour_bar(colour: Colour) -> dict[str, Any]:
    return {
        "title": {"text": TITLES[colour], "side": "top"},
        "thickness": 14,
        "len": 0.8,
        "tickfont": {"size": 13},
        "nticks": 6,
        "orientation": "h",
        "x": 0.5,
        "xanchor": "center",
        "y": 0.0,
        "yanchor": "top",
        **({"tickformat": "d"} if colour == "frame" else {}),
    }


def _add_points(
    figure: go.Figure, cloud: PointCloud, values: FloatArray, scale: Mapping[str, Any]
) -> None:
    """The points inside and outside the volume of the bars, with one colour bar."""
    table, shown = cloud.points, cloud.shown
    about = np.column_stack([table["frame"], table["error_px"], table[["x", "y", "z"]]])
    x, y, z = ("", "", "") if cloud.scene.is_world else (" (right)", " (down)", " (depth)")
    outside = cloud.outside[shown]
    kinds = (
        (shown[~outside], "circle", "Points"),
        (shown[outside], "circle-open", "Outside the volume of the bars"),
    )
    for number, (some, symbol, name) in enumerate(kind for kind in kinds if len(kind[0])):
        figure.add_scatter3d(
            **upright(cloud.xyz[some]),
            mode="markers",
            marker={
                **scale,
                "size": 4 if len(shown) <= 200 else 2,
                "color": values[some],
                "symbol": symbol,
                "showscale": number == 0,
            },
            customdata=about[some],
            hovertemplate=(
                "frame %{customdata[0]:d}, error %{customdata[1]:.3f} px<br>x %{customdata[2]:.3f} "
                f"m{x}, y %{{customdata[3]:.3f}} m{y}, z %{{customdata[4]:.3f}} m{z}<extra></extra>"
            ),
            name=f"{name} (n = {len(some)})",
        )


def _mark_frame(figure: go.Figure, cloud: PointCloud, frame: int | None) -> None:
    rows = np.flatnonzero(cloud.seen & (cloud.points["frame"] == frame))[:MAXIMUM_MARKED]
    if len(rows):
        size = 8 if len(rows) <= 20 else 4
        figure.add_scatter3d(
            **upright(cloud.xyz[rows]),
            mode="markers",
            name=f"Frame {frame}",
            hoverinfo="name",
            marker={"symbol": "diamond", "color": MARK_COLOUR, "size": size},
        )


def _add_tracks(
    figure: go.Figure, cloud: PointCloud, values: FloatArray, scale: Mapping[str, Any]
) -> None:
    """All tracks in one trace, with gaps between them; evenly thinned."""
    drawn = drawn_tracks([track[cloud.seen[track]] for track in cloud.tracks])
    if not drawn:
        return
    rows = np.concatenate([part for track in drawn for part in (track, track[-1:])])
    path = cloud.xyz[rows]
    path[np.cumsum([len(track) + 1 for track in drawn]) - 1] = np.nan
    figure.add_scatter3d(
        **upright(path),
        mode="lines",
        line={**scale, "color": values[rows], "width": 3},
        hoverinfo="skip",
        name=f"Tracks (n = {len(cloud.tracks)})",
    )


def drawn_tracks(tracks: Sequence[IntArray]) -> list[IntArray]:
    """At most `MAXIMUM_TRACKS` tracks of about `MAXIMUM_DRAWN` points together."""
    some = [track for track in tracks if len(track) > 1]
    some = some[:: -(-len(some) // MAXIMUM_TRACKS) or 1]
    step = -(-sum(len(track) for track in some) // MAXIMUM_DRAWN) or 1
    return [np.append(track[:-1:step], track[-1]) for track in some]


def describe_points(
    points: pd.DataFrame, tracks: Sequence[IntArray] = (), world: Pose | None = None
) -> str:
    """The figure in words."""
    cloud = PointCloud(points, Scene(), tracks)  # in the axes of the table
    finite, shown = np.isfinite(cloud.xyz).all(axis=1), cloud.seen
    if not shown.any():
        return "No pair meets in front of both cameras."
    x, y, z = cloud.xyz[shown].T
    text = (
        f"{count(int(shown.sum()), 'point')} of {count(points['frame'].nunique(), 'frame')}: x "
        f"from {x.min():.2f} to {x.max():.2f} m, y from {y.min():.2f} to {y.max():.2f} m, "
        f"{'depth ' if world is None else ''}z from {z.min():.2f} to {z.max():.2f} m"
    )
    if outside := int((cloud.outside & shown).sum()):
        text += f"; {outside} of them outside the volume of the bars, with open symbols"
    if tracks:
        text += f"; lines connect them to {count(len(tracks), 'track')}"
        if len(tracks) > MAXIMUM_TRACKS:
            text += f", of which {len(drawn_tracks(tracks))}, evenly spread, are drawn"
    if shown.sum() > MAXIMUM_DRAWN:
        text += f"; at most {MAXIMUM_DRAWN} points, evenly spread, are drawn"
    if far := int((finite & ~shown).sum()):
        text += f"; {count(far, 'point')} far away from all others not drawn"
    if behind := int((~finite).sum()):
        text += f"; {count(behind, 'pair')} without a point (behind a camera)"
    return text + "."


def in_view(xyz: FloatArray) -> BoolArray:
    """(n,): whether points (n, 3) are finite and not far from the others."""
    finite: BoolArray = np.asarray(np.isfinite(xyz).all(axis=1))
    if not finite.any():
        return finite
    low, high = np.percentile(xyz[finite], [1, 99], axis=0)
    room = FAR_OUT * max(float((high - low).max()), 1e-9)
    with np.errstate(invalid="ignore"):
        near: BoolArray = ((xyz >= low - room) & (xyz <= high + room)).all(axis=1)
    return finite & near


def _top(values: FloatArray, colour: Colour) -> float:
    """The end of the colour scale; for errors, the 98th percentile."""
    top = float(np.percentile(values, 98)) if colour == "error" else float(values.max())
    return top if top > values.min() else float(values.min()) + 1.0


def plot_lengths(check: LengthCheck) -> go.Figure:
    """The error of a known length, frame by frame."""
    figure = finish(go.Figure(), 320)
    figure.add_scatter(
        x=check.frames,
        y=100 * check.errors,
        mode="markers",
        marker={"color": METHOD_COLOURS["3d"], "symbol": "triangle-up", "size": 9},
        customdata=check.lengths_m,
        name=f"Measured (n = {len(check.frames)})",
        showlegend=True,
        hovertemplate="frame %{x}<br>%{customdata:.4f} m, error %{y:.2f} %<extra></extra>",
    )
    figure.add_hline(y=0, line={"color": NEUTRAL, "width": 2, "dash": "dash"})
    figure.update_xaxes(title_text="Frame")
    figure.update_yaxes(title_text="Length error (%)")
    return figure


def describe_lengths(check: LengthCheck) -> str:
    """The figure in words."""
    errors = 100 * check.errors
    return (
        f"Error of a known length of {rounded(check.known_m, 4)} m in "
        f"{count(len(errors), 'frame')}: from {errors.min():z.2f} to {errors.max():z.2f} %, median "
        f"{np.median(errors):z.2f} %; the dashed line is no error."
    )
