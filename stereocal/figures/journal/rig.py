"""The rig and the bars from above and from the side, for print."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from stereocal.calibration.methods import Method
from stereocal.figures.journal.page import PAGE_MM, SMALL, sheet, write_left
from stereocal.figures.rig import scene_of
from stereocal.figures.space import frusta
from stereocal.figures.style import METHOD_COLOURS, NEUTRAL
from stereocal.refined.results import Calibration
from stereocal.rig.camera import CAMERAS
from stereocal.rig.compiled import FloatArray

DEPTH = "Depth z (m)"
VIEWS = (("From above", 0, -1.0, "Left, −x (m)"), ("From the side", 1, -1.0, "Up, −y (m)"))
"""Title, coordinate of the vertical axis, its sign, and its label. Depth runs to the right."""
AXIS_MM, NAME_MM, BORDER_MM, REST_MM, MOST_MM = 13.0, 13.0, 4.0, 23.0, 200.0
LABEL_POINTS = 6.0


def draw_rig(calibration: Calibration, method: Method, width_mm: float) -> Figure:
    """Cameras, baseline and reconstructed bars; equal axes, metres."""
    scene = scene_of(calibration, method)
    outlines = [path for _, _, path in frusta(scene.rig, scene.depth)]
    bars = scene.bars[scene.drawn]
    everything = np.concatenate([*outlines, bars.reshape(-1, 3)])
    low, high = np.nanmin(everything, axis=0), np.nanmax(everything, axis=0)
    wide = width_mm >= PAGE_MM
    columns = 2 if wide else 1
    per_metre = (width_mm / columns - AXIS_MM - NAME_MM - 1) / max(float(high[2] - low[2]), 1e-9)
    heights = [per_metre * float(high[at] - low[at]) + REST_MM for _, at, _, _ in VIEWS]
    figure = sheet(width_mm, min(max(heights) if wide else sum(heights), MOST_MM))
    shape = {"width_ratios": [1, 1]} if wide else {"height_ratios": heights}
    grid = figure.subplots(3 - columns, columns, squeeze=False, gridspec_kw=shape).ravel()
    for axes, (title, at, sign, label) in zip(grid, VIEWS, strict=True):
        _draw_rig(axes, outlines, at, sign)
        axes.add_collection(
            LineCollection(
                _flat(bars, at, sign).tolist(),
                colors=METHOD_COLOURS[method],
                linewidths=0.5,
                alpha=0.7,
            )
        )
        axes.set_aspect("equal", adjustable="box", anchor="NW")
        ends = sorted((sign * low[at], sign * high[at]))
        axes.set(
            xlabel=DEPTH,
            ylabel=label,
            xlim=(low[2] - NAME_MM / per_metre, high[2] + 1 / per_metre),
            ylim=(ends[0] - BORDER_MM / per_metre, ends[1] + BORDER_MM / per_metre),
        )
        write_left(axes, f"{title}; baseline {scene.rig.pose.baseline:.3f} m" if at == 0 else title)
    return figure


def _draw_rig(axes: Axes, outlines: list[FloatArray], at: int, sign: float) -> None:
    """Both cameras, with their names in the view from above, and the baseline."""
    ends = _flat(np.array([outlines[0][0], outlines[1][0]]), at, sign)
    axes.plot(*ends.T, color=NEUTRAL, linestyle="--", linewidth=0.6)
    for name, outline in zip(CAMERAS, outlines, strict=True):
        flat = _flat(outline, at, sign)
        axes.plot(*flat.T, color="black", linewidth=0.6)
        if at:
            continue
        # Behind the camera.
        away = flat[0] - np.nanmean(flat, axis=0)
        offset = LABEL_POINTS * away / max(float(np.linalg.norm(away)), 1e-9)
        axes.annotate(
            name,
            tuple(flat[0]),
            tuple(offset),
            textcoords="offset points",
            fontsize=SMALL,
            ha="center" if abs(away[0]) < abs(away[1]) else "right" if away[0] < 0 else "left",
            va="center",
        )


def _flat(points: FloatArray, at: int, sign: float) -> FloatArray:
    """(..., 2): depth and one other coordinate of points (..., 3)."""
    return np.stack([points[..., 2], sign * points[..., at]], axis=-1)
