"""The cameras of a rig from above, a line for each pair; and all of them in 3D."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import plotly.graph_objects as go

from stereocal.figures.space import outline_of, set_scene, upright
from stereocal.figures.style import FAINT, METHOD_COLOURS, NEUTRAL, finish
from stereocal.network.in_words import loops_sentence, rig_sentence
from stereocal.network.rig_file import RigFile
from stereocal.rig.compiled import FloatArray
from stereocal.system.numbers import rounded

HEIGHT = 420
THINNEST, THICKEST = 2.0, 12.0
MAGNIFIED = 0.25
"""Length of a camera's pyramid over the largest distance of two cameras."""


def plot_rig_graph(rig: RigFile) -> go.Figure:
    """The cameras from above; a pair's line is the thicker the more bars both see, and dotted if
    the pair could not be calibrated by itself."""
    centres = _centres(rig)
    pairs: Mapping[str, Any] = rig.about.get("pairs", {})
    most = max((own["bars"] for own in pairs.values()), default=1)
    figure = go.Figure()
    for name, own in pairs.items():
        if not {*own["cameras"]} <= {*centres}:
            continue
        one, other = (centres[camera] for camera in own["cameras"])
        line = one + np.linspace(0.0, 1.0, 9)[:, None] * (other - one)
        text = f"{name}: {own['bars']} bars{_third(rig, own['cameras'])}"
        sound = "failed" not in own
        figure.add_scatter(
            x=line[:, 0],
            y=line[:, 2],
            mode="lines+markers",
            # Only markers can be clicked.
            marker={"size": THICKEST, "opacity": 0.0},
            line={
                "width": THINNEST + (THICKEST - THINNEST) * own["bars"] / most,
                "color": METHOD_COLOURS["refined"] if sound else NEUTRAL,
                "dash": "solid" if sound else "dot",
            },
            opacity=0.75,
            customdata=[name] * 9,
            hovertemplate=f"{text}<extra></extra>",
            name=name,
            showlegend=False,
        )
    names = list(centres)
    figure.add_scatter(
        x=[centres[name][0] for name in names],
        y=[centres[name][2] for name in names],
        mode="markers+text",
        marker={"size": 16, "color": METHOD_COLOURS["2d"]},
        text=names,
        textposition="top center",
        textfont={"size": 15},
        hovertemplate="camera %{text}<extra></extra>",
        cliponaxis=False,
        showlegend=False,
    )
    finish(figure, HEIGHT)
    figure.update_layout(margin={"t": 40})
    figure.update_xaxes(title_text=f"x of camera {rig.names[0]}, m")
    figure.update_yaxes(title_text="depth z, m", scaleanchor="x", zerolinecolor=FAINT)
    return figure


def describe_rig_graph(rig: RigFile) -> str:
    """The figure in words."""
    pairs = [f"{name} {own['bars']} bars" for name, own in rig.about.get("pairs", {}).items()]
    return " ".join(
        filter(
            None,
            [
                rig_sentence(rig),
                loops_sentence(rig),
                f"Bars that two cameras see: {', '.join(pairs)}.",
            ],
        )
    )


def plot_cameras(rig: RigFile) -> go.Figure:
    """All cameras in 3D, as pyramids; equal axes, metres."""
    centres = _centres(rig)
    apart = [np.linalg.norm(a - b) for a in centres.values() for b in centres.values()]
    depth = MAGNIFIED * float(max(apart))
    figure = finish(go.Figure(), HEIGHT + 60)
    for name in centres:
        outline = outline_of(rig.cameras[name], rig.poses[name].inverse(), depth)
        figure.add_scatter3d(
            **upright(outline),
            mode="lines",
            line={"width": 4, "color": METHOD_COLOURS["2d"]},
            hovertemplate=f"camera {name}<extra></extra>",
            showlegend=False,
        )
    figure.add_scatter3d(
        **upright(np.array(list(centres.values()))),
        mode="markers+text",
        marker={"size": 4, "color": METHOD_COLOURS["2d"]},
        text=list(centres),
        hovertemplate="camera %{text}<extra></extra>",
        showlegend=False,
    )
    set_scene(figure)
    return figure


def _centres(rig: RigFile) -> dict[str, FloatArray]:
    """Of each camera, (3,), in the reference's frame."""
    return {name: pose.inverse().T for name, pose in rig.poses.items()}


def _third(rig: RigFile, pair: list[str]) -> str:
    """How far off points of a pair are in a third camera."""
    found = [
        f"<br>in {own['camera']}: {rounded(own['before'])} px before, {rounded(own['after'])} after"
        for own in rig.about.get("third_camera_px", [])
        if {*own["pair"]} == {*pair}
    ]
    return "".join(found[:4])
