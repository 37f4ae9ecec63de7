"""The errors of the methods, frame by frame."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from stereocal.calibration.methods import Method
from stereocal.figures.style import (
    METHOD_COLOURS,
    METHOD_NAMES,
    METHOD_SYMBOLS,
    MOST_DRAWN,
    NEUTRAL,
    count,
    finish,
)
from stereocal.refined.outliers import (
    bar_frames,
    frame_reprojection_px,
    held_out,
    left_out,
    length_outliers,
    outlying_frames,
    reprojection_outliers,
)
from stereocal.refined.results import Calibration
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray
from stereocal.system.numbers import rounded

HEIGHT = 600
LOG_BEYOND = 30.0
"""Ratio of the largest error to the smallest median of a method above which the axis is
logarithmic."""
LOWEST_OF_MEDIAN = 0.01
"""Lower end of a logarithmic axis over that median, since single errors may be close to 0."""
MAXIMUM_LABELS = 12
LABEL_WIDTH, LABEL_HEIGHT = 0.09, 0.12
"""Size of a frame number, as fractions of a panel on a narrow screen."""
BESIDE = 0.2
"""Distance between the symbols of two methods, over that of two frames."""
SIZES: dict[Method, int] = {"essential": 9, "2d": 7, "3d": 8, "refined": 7}


@dataclass(frozen=True)
class FrameKind:
    """What some frames are for, and how their symbols show it."""

    words: str
    key: str = ""
    """In the legend."""
    is_open: bool = False
    is_dotted: bool = False

    @property
    def suffix(self) -> str:
        """Of Plotly's name of a symbol."""
        return "-open" * self.is_open + "-dot" * self.is_dotted


KINDS = (
    FrameKind("calibrated with"),
    FrameKind("held out", "Open: held out", True),
    FrameKind("left out", "Dotted: left out", True, True),
)


@dataclass(frozen=True, eq=False)
class FramePanel:
    """One kind of error: what is plotted, printed and said of it."""

    title: str
    unit: str
    frames: IntArray
    kinds: dict[FrameKind, BoolArray]
    """(n,) each: which frames are of the kind."""
    values: dict[Method, FloatArray]
    labelled: Method
    outliers: list[int]

    @property
    def counts(self) -> list[int]:
        """Frames of each kind."""
        return [int(of_kind.sum()) for of_kind in self.kinds.values()]

    @property
    def known(self) -> FloatArray:
        """All finite values of all methods."""
        every = np.concatenate(list(self.values.values()))
        known: FloatArray = every[np.isfinite(every)]
        return known

    @property
    def smallest_median(self) -> float:
        """The median of the best method; NaN if none is above 0."""
        medians = [_median(values) for values in self.values.values()]
        return min((m for m in medians if np.isfinite(m) and m > 0), default=np.nan)

    @property
    def is_log(self) -> bool:
        """Whether the axis is logarithmic."""
        largest = float(self.known.max(initial=0.0))
        return largest > LOG_BEYOND * self.smallest_median

    @property
    def ends(self) -> tuple[float, float]:
        """Of the axis of errors."""
        if self.is_log:
            return lowest_drawn(self) / 1.3, 3 * float(self.known.max())
        return 0.0, 1.15 * float(self.known.max(initial=0.0)) or 1.0


def plot_frame_errors(calibration: Calibration, chosen: int | None = None) -> go.Figure:
    """Reprojection and length error of every frame and method.

    Held-out frames are open symbols, frames left out are open with a dot.

    Args:
        chosen: a frame to mark.
    """
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.05)
    finish(figure, HEIGHT)
    panels = frame_panels(calibration)
    for row, panel in enumerate(panels, start=1):
        for method in panel.values:
            _add_method(figure, row, panel, method)
        _add_labels(figure, row, panel)
        figure.update_yaxes(
            row=row, col=1, title_text=f"{panel.title} ({panel.unit})", **_scale(panel)
        )
    _add_key(figure, panels[0])
    figure.update_xaxes(row=2, col=1, title_text=_frame_title(calibration, panels))
    if chosen is not None:
        figure.add_shape(
            type="line",
            x0=chosen,
            x1=chosen,
            xref="x2",
            y0=0,
            y1=1,
            yref="paper",
            layer="below",
            line={"color": NEUTRAL, "width": 1.5, "dash": "dot"},
        )
    return figure


def describe_frame_errors(calibration: Calibration) -> str:
    """The figure in words: median and largest errors of the methods, and outlying frames."""
    panels = frame_panels(calibration)
    parts = []
    for panel in panels:
        values = [
            f"{METHOD_NAMES[method]} {_number(_median(errors))} and {_number(_largest(errors))}"
            for method, errors in panel.values.items()
        ]
        parts.append(
            f"{panel.title.lower()} in {panel.unit}, median and largest: {', '.join(values)}"
        )
    frames, (_, left, without) = panels[0].frames, panels[0].counts
    outliers = outlying_frames(calibration)
    named = ", ".join(map(str, outliers[:MAXIMUM_LABELS]))
    more = " and more" if len(outliers) > MAXIMUM_LABELS else ""
    ending = [
        *_missing(panels),
        f"{count(len(outliers), 'frame')} standing out{': ' if outliers else ''}{named}{more}",
    ]
    return (
        f"Errors of {count(len(frames), 'frame')}, {left} of them held out"
        f"{f' and {without} left out' if without else ''}: "
        f"{'; '.join([*parts, *ending])}."
    )


def frame_panels(calibration: Calibration) -> tuple[FramePanel, FramePanel]:
    """Reprojection errors and length errors of all sets."""
    frames, of_bars = calibration.dataset.correspondences.frames, bar_frames(calibration)
    return (
        FramePanel(
            "Reprojection error",
            "px",
            frames,
            _kinds(calibration, frames),
            {method: frame_reprojection_px(calibration, method) for method in calibration.errors},
            "2d",
            reprojection_outliers(calibration),
        ),
        FramePanel(
            "Length error",
            "%",
            of_bars,
            _kinds(calibration, of_bars),
            {method: 100 * errors.length for method, errors in calibration.errors.items()},
            "3d",
            length_outliers(calibration),
        ),
    )


def _kinds(calibration: Calibration, frames: IntArray) -> dict[FrameKind, BoolArray]:
    left, without = held_out(calibration, frames), left_out(calibration, frames)
    return dict(zip(KINDS, (~(left | without), left, without), strict=True))


def _add_method(figure: go.Figure, row: int, panel: FramePanel, method: Method) -> None:
    """Draw a trace for each kind of frames."""
    drawn = drawn_frames(panel)
    for kind, of_kind in panel.kinds.items():
        chosen = of_kind & drawn
        if not chosen.any():
            continue
        figure.add_scatter(
            x=_beside(panel, method)[chosen],
            y=panel.values[method][chosen],
            mode="markers",
            customdata=panel.frames[chosen],
            marker={
                "color": METHOD_COLOURS[method],
                "symbol": METHOD_SYMBOLS[method] + kind.suffix,
                "size": SIZES[method] - (2 if len(panel.frames) > 100 else 0),
                "opacity": 0.85,
            },
            unselected={"marker": {"opacity": 0.85}},
            name=METHOD_NAMES[method],
            legendgroup=method,
            showlegend=row == 1 and not kind.key,
            hovertemplate=(
                f"{METHOD_NAMES[method]}, frame %{{customdata}} ({kind.words})<br>"
                f"{panel.title.lower()} %{{y:.3~r}} {panel.unit}<extra></extra>"
            ),
            row=row,
            col=1,
        )


def _beside(panel: FramePanel, method: Method) -> FloatArray:
    """(n,): where the symbols of a method stand on the axis of frames.

    Beside each other: the errors of the essential matrix and of the 2D set may agree to a pixel of
    the screen, and one symbol hid the other.
    """
    steps = np.diff(np.unique(panel.frames))
    step = float(steps.min()) if len(steps) else 1.0
    at = [*panel.values].index(method) - 0.5 * (len(panel.values) - 1)
    return np.asarray(panel.frames + BESIDE * step * at, dtype=np.float64)


def drawn_frames(panel: FramePanel) -> BoolArray:
    """(n,): the frames that are drawn: all, or of many the worst of each run of neighbours.

    Worst by any method, relative to its median, so that no large error is hidden.
    """
    n = len(panel.frames)
    if n <= MOST_DRAWN:
        return np.ones(n, dtype=np.bool_)
    medians = [max(_median(values), 1e-300) for values in panel.values.values()]
    relative = np.array(list(panel.values.values())) / np.array(medians)[:, None]
    worst = np.nan_to_num(relative, nan=np.inf).max(axis=0)
    of_run = np.arange(n) * MOST_DRAWN // n
    order = np.lexsort((-worst, of_run))
    drawn = np.zeros(n, dtype=np.bool_)
    drawn[order[np.flatnonzero(np.diff(of_run[order], prepend=-1))]] = True
    return drawn


def _add_labels(figure: go.Figure, row: int, panel: FramePanel) -> None:
    """Label the outlying frames above their highest symbol, worst first, without overlap."""
    at, heights = _labelled(panel)
    if not len(at):
        return
    figure.add_scatter(
        x=panel.frames[at],
        y=heights,
        mode="text",
        text=[f"<b>{frame}</b>" for frame in panel.frames[at]],
        textposition="top center",
        textfont={"size": 14},
        hoverinfo="skip",
        showlegend=False,
        cliponaxis=False,
        name="Outlying frames",
        row=row,
        col=1,
    )


def _labelled(panel: FramePanel) -> tuple[IntArray, FloatArray]:
    """Indices into `panel.frames` of the outlying frames to label, and the label heights."""
    at = np.flatnonzero(np.isin(panel.frames, panel.outliers))
    at = at[np.isfinite(panel.values[panel.labelled][at])]
    at = at[np.argsort(-panel.values[panel.labelled][at], kind="stable")]
    heights = np.nanmax([values[at] for values in panel.values.values()], axis=0)
    width = float(panel.frames.max() - panel.frames.min()) if len(at) else 0.0
    across = panel.frames[at] / max(width, 1.0)
    shown = np.log10(np.maximum(heights, 1e-300)) if panel.is_log else heights
    up = shown / _height_of_axis(panel)
    kept: list[int] = []
    for i in range(len(at)):
        crowded = any(
            abs(across[i] - across[k]) < LABEL_WIDTH and abs(up[i] - up[k]) < LABEL_HEIGHT
            for k in kept
        )
        if not crowded and len(kept) < MAXIMUM_LABELS:
            kept.append(i)
    return at[kept], heights[kept]


def _height_of_axis(panel: FramePanel) -> float:
    """The length of the axis, in decades if it is logarithmic."""
    if not len(panel.known):
        return 1.0
    if panel.is_log:
        return float(np.log10(panel.known.max() / lowest_drawn(panel)))
    return float(panel.known.max()) or 1.0


def _add_key(figure: go.Figure, panel: FramePanel) -> None:
    """Explain open and dotted symbols in the legend, if there are any."""
    for kind, n in zip(panel.kinds, panel.counts, strict=True):
        if not kind.key or not n:
            continue
        figure.add_scatter(
            x=[None],
            y=[None],
            mode="markers",
            hoverinfo="skip",
            marker={"color": NEUTRAL, "symbol": f"circle{kind.suffix}", "size": 9},
            name=f"{kind.key} (n = {n})",
            row=1,
            col=1,
        )


def _scale(panel: FramePanel) -> dict[str, object]:
    if not panel.is_log:
        return {"type": "linear", "range": list(panel.ends)}
    ends = np.log10(panel.ends).tolist()
    return {"type": "log", "exponentformat": "none", "range": ends, "dtick": 1}


def lowest_drawn(panel: FramePanel) -> float:
    """Lower end of a logarithmic axis."""
    positive = panel.known[panel.known > 0]
    return float(max(positive.min(), LOWEST_OF_MEDIAN * panel.smallest_median))


def _frame_title(calibration: Calibration, panels: tuple[FramePanel, ...]) -> str:
    """The title of the frame axis, with notes on values that are not drawn."""
    title = f"Frame (n = {len(calibration.dataset.correspondences.frames)})"
    notes = _missing(panels)
    most = max(len(panel.frames) for panel in panels)
    if most > MOST_DRAWN:
        notes.append(f"of each {-(-most // MOST_DRAWN)} neighbouring frames the worst is drawn")
    for panel in panels:
        if not len(panel.frames):
            notes.append("no frame has both targets, so there is no length")
        below = int((panel.known < lowest_drawn(panel)).sum()) if panel.is_log else 0
        if below:
            notes.append(
                f"{count(below, panel.title.lower())} below "
                f"{rounded(lowest_drawn(panel), 1)} {panel.unit} out of view"
            )
    lines = [line for note in notes for line in textwrap.wrap(note[0].upper() + note[1:], 44)]
    return "<br>".join([title, *lines])


def _missing(panels: tuple[FramePanel, ...]) -> list[str]:
    """A note for each method and error with frames that have no value."""
    return [
        f"{METHOD_NAMES[method]}: {count(int(np.isnan(values).sum()), 'frame')} without "
        f"{panel.title.lower()} (point behind a camera)"
        for panel in panels
        for method, values in panel.values.items()
        if np.isnan(values).any()
    ]


def _median(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")


def _largest(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.max()) if len(known) else float("nan")


def _number(value: float) -> str:
    return f"{rounded(value, 3)}" if np.isfinite(value) else "none"
