"""Reconstructed 3D points, and measured lengths compared with a known length."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from stereocal.figures.space import VIEWS, SceneFrame, add_cameras, eye_of, frusta, set_scene
from stereocal.figures.style import DASHED, add_trace, blank, marker_of, sentence_only, thinned
from stereocal.matching.lengths import LengthCheck
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import PlacedCameras
from stereocal.system.array_types import BoolArray, FloatArray, IntArray
from stereocal.system.numbers import count, decimals_of, rounded

LEAST_PART = 0.2
"""Fraction of the size of a scene with its cameras: smaller points are seen without them."""
MAXIMUM_DRAWN = 10_000
"""Maximum number of points drawn, evenly thinned, since larger scenes rotate slowly."""
MAXIMUM_TRACKS = 500
MAXIMUM_MARKED = 1000
"""Maximum number of points of the chosen frame that are marked."""
MARK_COLOUR = "#CC79A7"
NTICKS = 6
Colour = Literal["frame", "error"]
TITLES: dict[Colour, str] = {"frame": "Frame", "error": "Error (px)"}
COLOURS = ((0.0, "#1F83C4"), (0.5, "#009E73"), (1.0, "#D55E00"))
FAR_OUT = 1.5
"""Points are not drawn beyond this multiple of the extent of the central 98 %, because a single
wrong pair at a distance of kilometres would shrink the others to a dot."""

HEADINGS: Mapping[str, str] = {
    "frame": "Frame",
    "u_primary": "u, primary (px)",
    "v_primary": "v, primary (px)",
    "u_secondary": "u, secondary (px)",
    "v_secondary": "v, secondary (px)",
    "error_px": "Error (px)",
    "runner_up_px": "Next best error (px)",
    "ambiguous": "Ambiguous",
    "within_threshold": "Within the threshold",
    "sigma_primary_px": "Noise, primary (px)",
    "sigma_secondary_px": "Noise, secondary (px)",
    "x": "x, right (m)",
    "y": "y, down (m)",
    "z": "z, depth (m)",
    "sigma_x": "Standard error of x (m)",
    "sigma_y": "Standard error of y (m)",
    "sigma_z": "Standard error of z (m)",
    "outside_volume": "Outside the volume of the bars",
    "views": "Cameras that see it",
}
"""Titles of the columns of pairs and points on a page, by their names in the files, which the files
keep; a column of the user keeps its own."""
IN_WORLD: Mapping[str, str] = {
    **HEADINGS,
    **{axis: f"{axis} (m)" for axis in "xyz"},
    "coordinates": "World frame",
}
"""Titles of the columns of points in a world frame."""


FORMATS: dict[str, str] = {
    **dict.fromkeys("xyz", "%.4g"),
    **dict.fromkeys(("error_px", "runner_up_px"), "%.3g"),
    **dict.fromkeys(("sigma_x", "sigma_y", "sigma_z"), "%.2g"),
}
"""Digits that a page shows of lengths, errors and standard errors; files have all."""


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Reconstructed points in the frame of a scene, and which of them are in view."""

    points: pd.DataFrame
    """Rows of `points.csv`."""
    scene: SceneFrame

    @cached_property
    def xyz(self) -> FloatArray:
        """(n, 3), metres."""
        return self.scene.points(self.points[["x", "y", "z"]].to_numpy(dtype=np.float64))

    @cached_property
    def finite(self) -> BoolArray:
        """(n,): which have a place."""
        return np.asarray(np.isfinite(self.xyz).all(axis=1))

    @cached_property
    def seen(self) -> BoolArray:
        """(n,): finite, and not far from the others."""
        if not self.finite.any():
            return self.finite
        low, high = np.percentile(self.xyz[self.finite], [1, 99], axis=0)
        room = FAR_OUT * max(float((high - low).max()), 1e-9)
        with np.errstate(invalid="ignore"):
            near = ((self.xyz >= low - room) & (self.xyz <= high + room)).all(axis=1)
        return np.asarray(self.finite & near)

    @cached_property
    def outside(self) -> BoolArray:
        """(n,): outside the volume of the bars, by their column; false without it."""
        if "outside_volume" not in self.points:
            return np.zeros(len(self.points), dtype=bool)
        return self.points["outside_volume"].to_numpy(dtype=bool)


def formats(table: pd.DataFrame) -> dict[str, str]:
    """The format of each column of pairs or points that is a measured number."""
    pixels = {name: "%.2f" for name in map(str, table) if name[:2] in ("u_", "v_")}
    return {name: digits for name, digits in (FORMATS | pixels).items() if name in table}


def plot_points(
    points: pd.DataFrame,
    colour: Colour,
    rig: PlacedCameras,
    view: str = VIEWS[0],
    tracks: Sequence[IntArray] = (),
    frame: int | None = None,
    world: Pose | None = None,
) -> go.Figure:
    """The points in the primary camera's frame or a world frame, with all cameras; equal axes,
    metres.

    Args:
        points: rows of `points.csv`.
        colour: the quantity shown as colour.
        view: one of `views_of` the cameras.
        tracks: rows that are connected by lines.
        frame: a frame to mark.
        world: `world_from_primary` of the points; None: they are in the primary's frame.
    """
    cloud = PointCloud(points, SceneFrame.of_world(world))
    seen, xyz = np.flatnonzero(cloud.seen), cloud.xyz
    shown = seen[thinned(len(seen), MAXIMUM_DRAWN)]
    if not len(shown):
        return sentence_only("No pair meets in front of both cameras: there is nothing to draw.")
    values = points["frame" if colour == "frame" else "error_px"].to_numpy(dtype=np.float64)
    # For errors, the scale ends at the 98th percentile.
    low, top = np.percentile(values[shown], [0, 98 if colour == "error" else 100]).tolist()
    scale = {
        "colorscale": [list(stop) for stop in COLOURS],
        "cmin": low,
        "cmax": top if top > low else low + 1.0,
    }
    figure = blank(560)
    figure.layout.uirevision, figure.layout.showlegend = view, False
    # All tracks in one trace, with gaps between them.
    if drawn := drawn_tracks([track[cloud.seen[track]] for track in tracks]):
        rows = np.concatenate([part for track in drawn for part in (track, track[-1:])])
        path = xyz[rows]
        path[np.cumsum([len(track) + 1 for track in drawn]) - 1] = np.nan
        line = {**scale, "color": values[rows], "width": 3}
        add_trace(figure, path, line=line, name=f"Tracks (n = {len(tracks):,})")
    bar = _colour_bar(colour, scale["cmax"] - scale["cmin"])
    _add_points(figure, cloud, shown, values, {**scale, "colorbar": bar})
    marked = xyz[cloud.seen & (points["frame"] == frame)][:MAXIMUM_MARKED]
    if len(marked):
        size = 8 if len(marked) <= 20 else 4
        marker = {"symbol": "diamond", "color": MARK_COLOUR, "size": size}
        add_trace(figure, marked, "name", marker=marker, name=f"Frame {frame}")
    # Depth from the primary camera, exceeded by 2 % of the points in view.
    in_primary = cloud.scene.from_primary.inverse().apply(xyz[seen])
    depth = float(np.percentile(in_primary[:, 2], 98))
    every = np.vstack([xyz[seen], *(path for _, _, path in frusta(rig, depth, cloud.scene))])
    every = every[np.isfinite(every).all(axis=1)]
    # Tracks far from the cameras would be a dot in a corner: they alone are then seen whole, and
    # names of cameras at the edge would be cut.
    near = np.ptp(xyz[seen], axis=0).max() > LEAST_PART * np.ptp(every, axis=0).max()
    add_cameras(figure, rig, depth, cloud.scene, named=bool(near))
    whole = every if near else xyz[seen]
    eye = eye_of(view, rig, np.median(xyz[seen], axis=0), cloud.scene, whole)
    set_scene(figure, eye, cloud.scene)
    return figure


def _colour_bar(colour: Colour, span: float) -> dict[str, Any]:
    whole_frames = {"tickformat": "d", "dtick": 1 if span < NTICKS else None}
    return {
        "title": {"text": TITLES[colour], "side": "top"},
        "thickness": 14,
        "len": 0.8,
        "tickfont": {"size": 13},
        "nticks": NTICKS,
        "orientation": "h",
        **{"x": 0.5, "xanchor": "center", "y": 0.0, "yanchor": "top"},
        **(whole_frames if colour == "frame" else {}),
    }


def _add_points(
    figure: go.Figure,
    cloud: PointCloud,
    rows: IntArray,
    values: FloatArray,
    scale: Mapping[str, Any],
) -> None:
    """The points inside and outside the volume of the bars, with one colour bar."""
    hover_values = cloud.points[["frame", "error_px", "x", "y", "z"]].to_numpy(dtype=np.float64)
    place = ", ".join(
        f"{axis} %{{customdata[{k}]:.4~r}} m{words}"
        for k, (axis, words) in enumerate(zip("xyz", cloud.scene.words, strict=True), start=2)
    )
    outside = cloud.outside[rows]
    kinds = (
        ("Points", rows[~outside], "circle"),
        ("Outside the volume of the bars", rows[outside], "circle-open"),
    )
    bar = True
    for name, some, symbol in kinds:
        if not len(some):
            continue
        own_marker = {"size": 4 if len(rows) <= 200 else 2, "color": values[some], "symbol": symbol}
        add_trace(
            figure,
            cloud.xyz[some],
            f"frame %{{customdata[0]:d}}, error %{{customdata[1]:.3~r}} px<br>{place}",
            marker={**scale, **own_marker, "showscale": bar},
            customdata=hover_values[some],
            name=f"{name} (n = {len(some):,})",
        )
        bar = False


def drawn_tracks(tracks: Sequence[IntArray]) -> list[IntArray]:
    """At most `MAXIMUM_TRACKS` tracks of about `MAXIMUM_DRAWN` points together."""
    drawn = [track for track in tracks if len(track) > 1]
    drawn = drawn[thinned(len(drawn), MAXIMUM_TRACKS)]
    step = -(-sum(len(track) for track in drawn) // MAXIMUM_DRAWN) or 1
    return [np.append(track[:-1:step], track[-1]) for track in drawn]


def describe_points(
    points: pd.DataFrame, tracks: Sequence[IntArray] = (), world: Pose | None = None
) -> str:
    """Extents of the points in view, and how many are not drawn."""
    cloud = PointCloud(points, SceneFrame())  # in the axes of the table
    shown = cloud.seen
    if not shown.any():
        return "No pair meets in front of both cameras."
    titles, ends = ("x", "y", "depth z" if world is None else "z"), cloud.xyz[shown]
    decimals = decimals_of(float(np.abs(ends).max()) / 100)  # four digits of the largest
    extents = ", ".join(
        f"{title} from {low:z.{decimals}f} to {high:z.{decimals}f} m"
        for title, low, high in zip(
            titles, ends.min(axis=0).tolist(), ends.max(axis=0).tolist(), strict=True
        )
    )
    text = (
        f"{count(int(shown.sum()), 'point')} of {count(points['frame'].nunique(), 'frame')}: "
        f"{extents}"
    )
    if outside := int((cloud.outside & shown).sum()):
        text += f"; {outside} of them outside the volume of the bars, with open symbols"
    if tracks:
        text += f"; lines connect them to {count(len(tracks), 'track')}"
        if len(tracks) > MAXIMUM_TRACKS:
            text += f", of which {len(drawn_tracks(tracks))}, evenly spread, are drawn"
    if shown.sum() > MAXIMUM_DRAWN:
        text += f"; at most {MAXIMUM_DRAWN} points, evenly spread, are drawn"
    if far := int((cloud.finite & ~shown).sum()):
        text += f"; {count(far, 'point')} far away from all others not drawn"
    if behind := int((~cloud.finite).sum()):
        text += f"; {count(behind, 'pair')} without a point (behind a camera)"
    return text + "."


def plot_lengths(check: LengthCheck) -> go.Figure:
    """The error of a known length, frame by frame."""
    figure = blank(320)
    add_trace(
        figure,
        np.column_stack([check.frames, 100 * check.errors]),
        "frame %{x}<br>%{customdata:.4~r} m, error %{y:.2f} %",
        marker=marker_of("3d", 9),
        customdata=check.lengths_m,
        name=f"Measured (n = {len(check.frames):,})",
        showlegend=True,
    )
    figure.add_hline(y=0, line=DASHED)
    figure.update_xaxes(title_text="Frame")
    figure.update_yaxes(title_text="Length error (%)")
    return figure


def describe_lengths(check: LengthCheck) -> str:
    """Extremes and median of the errors."""
    errors = 100 * check.errors
    return (
        f"Error of a known length of {rounded(check.known_m, 4)} m in "
        f"{count(len(errors), 'frame')}: from {errors.min():z.2f} to {errors.max():z.2f} %, median "
        f"{np.median(errors):z.2f} %; the dashed line is no error."
    )
