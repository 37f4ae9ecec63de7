"""Reconstructed 3D points, and measured lengths compared with a known length."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
    scene = Scene.of_world(world)
    xyz = scene.points(points[["x", "y", "z"]].to_numpy(dtype=np.float64))
    seen = in_view(xyz)
    shown = np.flatnonzero(seen)
    if not len(shown):
        return sentence_only("No pair meets in front of both cameras: there is nothing to draw.")
    target = np.median(xyz[shown], axis=0)
    depth = float(np.percentile(scene.from_primary.inverse().apply(xyz[shown])[:, 2], 98))
    frames = points["frame"].to_numpy(dtype=np.int64)
    of_frame = shown[frames[shown] == frame][:MAXIMUM_MARKED]
    shown = shown[:: -(-len(shown) // MAXIMUM_DRAWN)]
    values = points["frame" if colour == "frame" else "error_px"].to_numpy(dtype=np.float64)
    scale = {
        "colorscale": [list(stop) for stop in COLOURS],
        "cmin": float(values[shown].min()),
        "cmax": _top(values[shown], colour),
    }
    figure = finish(go.Figure(), HEIGHT)
    figure.layout.uirevision, figure.layout.showlegend = view, False
    _add_tracks(figure, xyz, values, [track[seen[track]] for track in tracks], scale)
    marker = {
        **scale,
        "size": 4 if len(shown) <= 200 else 2,
        "colorbar": {
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
        },
    }
    about = np.column_stack([frames, points["error_px"], points[["x", "y", "z"]]])
    x, y, z = ("", "", "") if scene.is_world else (" (right)", " (down)", " (depth)")
    outside = outside_volume(points)
    for some, symbol, name in (
        (shown[~outside[shown]], "circle", "Points"),
        (shown[outside[shown]], "circle-open", "Outside the volume of the bars"),
    ):
        if not len(some):
            continue
        figure.add_scatter3d(
            **upright(xyz[some]),
            mode="markers",
            marker={
                **marker,
                "color": values[some],
                "symbol": symbol,
                "showscale": not any(trace.mode == "markers" for trace in figure.data),
            },
            customdata=about[some],
            hovertemplate=(
                "frame %{customdata[0]:d}, error %{customdata[1]:.3f} px<br>"
                f"x %{{customdata[2]:.3f}} m{x}, y %{{customdata[3]:.3f}} m{y}, "
                f"z %{{customdata[4]:.3f}} m{z}<extra></extra>"
            ),
            name=f"{name} (n = {len(some)})",
        )
    if len(of_frame):
        figure.add_scatter3d(
            **upright(xyz[of_frame]),
            mode="markers",
            name=f"Frame {frame}",
            hoverinfo="name",
            marker={
                "symbol": "diamond",
                "color": MARK_COLOUR,
                "size": 8 if len(of_frame) <= 20 else 4,
            },
        )
    add_cameras(figure, rig, depth, scene)
    # Else tracks far from the cameras are a dot in a corner.
    set_scene(figure, eye_of(view, rig, target, scene, xyz[seen]), scene)
    return figure


def _add_tracks(
    figure: go.Figure,
    xyz: FloatArray,
    values: FloatArray,
    tracks: Sequence[IntArray],
    scale: Mapping[str, Any],
) -> None:
    """All tracks in one trace, with gaps between them; evenly thinned."""
    drawn = drawn_tracks(tracks)
    if not drawn:
        return
    rows = np.concatenate([part for track in drawn for part in (track, track[-1:])])
    path = xyz[rows]
    path[np.cumsum([len(track) + 1 for track in drawn]) - 1] = np.nan
    figure.add_scatter3d(
        **upright(path),
        mode="lines",
        line={**scale, "color": values[rows], "width": 3},
        hoverinfo="skip",
        name=f"Tracks (n = {len(tracks)})",
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
    xyz = points[["x", "y", "z"]].to_numpy(dtype=np.float64)
    finite = np.isfinite(xyz).all(axis=1)
    shown = in_view(xyz)
    if not shown.any():
        return "No pair meets in front of both cameras."
    x, y, z = (xyz[shown, k] for k in range(3))
    text = (
        f"{count(int(shown.sum()), 'point')} of {count(points['frame'].nunique(), 'frame')}: x "
        f"from {x.min():.2f} to {x.max():.2f} m, y from {y.min():.2f} to {y.max():.2f} m, "
        f"{'depth ' if world is None else ''}z from {z.min():.2f} to {z.max():.2f} m"
    )
    if outside := int((outside_volume(points) & shown).sum()):
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


def outside_volume(points: pd.DataFrame) -> BoolArray:
    """(n,): the column `outside_volume`; false without it."""
    if "outside_volume" not in points:
        return np.zeros(len(points), dtype=bool)
    return points["outside_volume"].to_numpy(dtype=bool)


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
        f"{count(len(errors), 'frame')}: from "
        f"{errors.min():z.2f} to {errors.max():z.2f} %, median {np.median(errors):z.2f} %; the "
        "dashed line is no error."
    )
