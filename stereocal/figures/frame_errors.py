"""Errors frame by frame, plotted, printed and said: of the methods; and of new images, with the old
and the repaired parameters."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import plotly.graph_objects as go

from stereocal.calibration.methods import METHOD_NAMES, Method
from stereocal.field.checking.repair import Residuals
from stereocal.figures import style
from stereocal.figures.style import MOST_DRAWN, add_trace
from stereocal.fit.results import Calibration
from stereocal.fit.screening import outliers
from stereocal.system.array_types import BoolArray, FloatArray, IntArray
from stereocal.system.numbers import count, rounded

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
    suffix: str = ""
    """Ending of Plotly's name of a symbol."""


KINDS = (
    FrameKind("calibrated with"),
    FrameKind("held out", "Open: held out", "-open"),
    FrameKind("left out", "Dotted: left out", "-open-dot"),
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

    @cached_property
    def known(self) -> FloatArray:
        """All finite values of all methods."""
        return finite(np.concatenate(list(self.values.values())))

    @cached_property
    def smallest_median(self) -> float:
        """The median of the best method; NaN if none is above 0."""
        medians = [median(values) for values in self.values.values()]
        return min((m for m in medians if m > 0), default=np.nan)

    @property
    def is_log(self) -> bool:
        """Whether the axis is logarithmic."""
        return float(self.known.max(initial=0.0)) > LOG_BEYOND * self.smallest_median

    @property
    def ends(self) -> tuple[float, float]:
        """The ends of the axis of errors."""
        if self.is_log:
            return self.lowest / 1.3, 3 * float(self.known.max())
        return 0.0, 1.15 * float(self.known.max(initial=0.0)) or 1.0

    @property
    def lowest(self) -> float:
        """Lower end of what is drawn on a logarithmic axis."""
        positive = self.known[self.known > 0]
        return float(max(positive.min(), LOWEST_OF_MEDIAN * self.smallest_median))

    @cached_property
    def drawn(self) -> BoolArray:
        """(n,): the frames that are drawn: all, or of many the worst of each run of neighbours.

        Worst by any method, relative to its median, so that no large error is hidden.
        """
        n = len(self.frames)
        if n <= MOST_DRAWN:
            return np.ones(n, dtype=np.bool_)
        medians = [max(median(values), 1e-300) for values in self.values.values()]
        relative = np.array(list(self.values.values())) / np.array(medians)[:, None]
        worst = np.nan_to_num(relative, nan=np.inf).max(axis=0)
        of_run = np.arange(n) * MOST_DRAWN // n
        order = np.lexsort((-worst, of_run))
        drawn = np.zeros(n, dtype=np.bool_)
        drawn[order[np.flatnonzero(np.diff(of_run[order], prepend=-1))]] = True
        return drawn


def frame_panels(calibration: Calibration) -> tuple[FramePanel, FramePanel]:
    """Reprojection errors and length errors of all sets."""

    def kinds(frames: IntArray) -> dict[FrameKind, BoolArray]:
        held_out = np.isin(frames, calibration.held_out_frames)
        left_out = np.isin(frames, calibration.screening.left_out)
        return dict(zip(KINDS, (~(held_out | left_out), held_out, left_out), strict=True))

    frames, of_bars = calibration.dataset.correspondences.frames, outliers.bar_frames(calibration)
    px = {name: outliers.frame_reprojection_px(calibration, name) for name in calibration.errors}
    percents = {method: 100 * errors.length for method, errors in calibration.errors.items()}
    far, long = outliers.reprojection_outliers(calibration), outliers.length_outliers(calibration)
    return (
        FramePanel("Reprojection error", "px", frames, kinds(frames), px, "2d", far),
        FramePanel("Length error", "%", of_bars, kinds(of_bars), percents, "3d", long),
    )


def finite(values: FloatArray) -> FloatArray:
    """Those of the values that are finite."""
    return np.asarray(values[np.isfinite(values)])


def median(values: FloatArray) -> float:
    """The median of the finite values; NaN without any."""
    return float(np.median(known)) if len(known := finite(values)) else float("nan")


def median_and_largest(values: FloatArray) -> str:
    """Median and maximum of the finite values, in words."""
    if not len(known := finite(values)):
        return "none and none"
    return f"{rounded(np.median(known), 3)} and {rounded(known.max(), 3)}"


def describe_frame_errors(calibration: Calibration) -> str:
    """Median and largest errors of the methods, and outlying frames."""
    panels, parts = frame_panels(calibration), []
    for panel in panels:
        values = [
            f"{METHOD_NAMES[method]} {median_and_largest(errors)}"
            for method, errors in panel.values.items()
        ]
        title = f"{panel.title.lower()} in {panel.unit}, median and largest"
        parts.append(f"{title}: {', '.join(values)}")
    _, held_out, left_out = panels[0].counts
    outlying = outliers.outlying_frames(calibration)
    named = ", ".join(map(str, outlying[:MAXIMUM_LABELS]))
    more = " and more" if len(outlying) > MAXIMUM_LABELS else ""
    standing_out = f"{count(len(outlying), 'frame')} standing out{': ' if outlying else ''}"
    parts += [*_missing(panels), f"{standing_out}{named}{more}"]
    without_words = f" and {left_out} left out" if left_out else ""
    return (
        f"Errors of {count(len(panels[0].frames), 'frame')}, {held_out} of them held out"
        f"{without_words}: {'; '.join(parts)}."
    )


def _missing(panels: Sequence[FramePanel]) -> list[str]:
    """A note for each method and error with frames that have no value."""
    return [
        f"{METHOD_NAMES[method]}: {count(int(np.isnan(values).sum()), 'frame')} without "
        f"{panel.title.lower()} (point behind a camera)"
        for panel in panels
        for method, values in panel.values.items()
        if np.isnan(values).any()
    ]


def plot_frame_errors(calibration: Calibration, chosen: int | None = None) -> go.Figure:
    """Reprojection and length error of every frame and method.

    Held-out frames are open symbols, frames left out are open with a dot.

    Args:
        chosen: a frame to mark.
    """
    figure = style.blank(600, 2, shared_xaxes=True, vertical_spacing=0.05)
    panels = frame_panels(calibration)
    for row, panel in enumerate(panels, start=1):
        for method in panel.values:
            _add_method(figure, row, panel, method)
        _add_labels(figure, row, panel)
        scale: dict[str, Any] = {"type": "linear", "range": panel.ends}
        if panel.is_log:
            log = {"type": "log", "exponentformat": "none", "dtick": 1}
            scale = {**log, "range": np.log10(panel.ends)}
        figure.update_yaxes(row=row, col=1, title_text=f"{panel.title} ({panel.unit})", **scale)
    # Open and dotted symbols in the legend, if there are any.
    for kind, n in zip(KINDS, panels[0].counts, strict=True):
        if kind.key and n:
            marker = {"color": style.NEUTRAL, "symbol": f"circle{kind.suffix}", "size": 9}
            name = f"{kind.key} (n = {n:,})"
            add_trace(figure, style.NOWHERE, marker=marker, name=name, row=1, col=1)
    figure.update_xaxes(row=2, col=1, title_text=_frame_title(panels))
    if chosen is not None:
        ends = {"xref": "x2", "y0": 0, "y1": 1, "yref": "paper", "layer": "below"}
        line = style.line_of(width=1.5, dash="dot")
        figure.add_shape(type="line", x0=chosen, x1=chosen, line=line, **ends)
    return figure


def _add_method(figure: go.Figure, row: int, panel: FramePanel, method: Method) -> None:
    """Draw a trace for each kind of frames.

    The symbols of the methods stand beside each other: the errors of the essential matrix and of
    the 2D set may agree to a pixel of the screen, and one symbol hid the other.
    """
    steps = np.diff(np.unique(panel.frames))
    step = [*panel.values].index(method) - 0.5 * (len(panel.values) - 1)
    beside = BESIDE * (steps.min() if len(steps) else 1) * step
    points = np.column_stack([panel.frames + beside, panel.values[method]])
    size, name = SIZES[method] - (2 if len(panel.frames) > 100 else 0), METHOD_NAMES[method]
    for kind, of_kind in panel.kinds.items():
        chosen, symbol = of_kind & panel.drawn, style.METHOD_SYMBOLS[method] + kind.suffix
        if not chosen.any():
            continue
        add_trace(
            figure,
            points[chosen],
            f"{name}, frame %{{customdata}} ({kind.words})<br>"
            f"{panel.title.lower()} %{{y:.3~r}} {panel.unit}",
            customdata=panel.frames[chosen],
            marker=style.marker_of(method, size, symbol=symbol, opacity=0.85),
            unselected={"marker": {"opacity": 0.85}},
            name=name,
            legendgroup=method,
            showlegend=row == 1 and not kind.key,
            row=row,
            col=1,
        )


def _add_labels(figure: go.Figure, row: int, panel: FramePanel) -> None:
    """Label the outlying frames above their highest symbol, worst first, without overlap."""
    values = panel.values[panel.labelled]
    rows = np.flatnonzero(np.isin(panel.frames, panel.outliers) & np.isfinite(values))
    if not len(rows):
        return
    rows = rows[np.argsort(-values[rows], kind="stable")]
    heights = np.nanmax([errors[rows] for errors in panel.values.values()], axis=0)
    across = panel.frames[rows] / max(float(np.ptp(panel.frames)), 1.0)
    up, top = heights, panel.known.max() or 1.0
    if panel.is_log:  # in decades
        up, top = np.log10(np.maximum(heights, 1e-300)), np.log10(panel.known.max() / panel.lowest)
    places = np.column_stack([across / LABEL_WIDTH, up / top / LABEL_HEIGHT])
    kept: list[int] = []
    for i, place in enumerate(places):
        free = (np.abs(place - places[kept]) >= 1.0).any(axis=1).all()
        if free and len(kept) < MAXIMUM_LABELS:
            kept.append(i)
    add_trace(
        figure,
        np.column_stack([panel.frames[rows], heights])[kept],
        text=[f"<b>{frame}</b>" for frame in panel.frames[rows[kept]]],
        textposition="top center",
        textfont={"size": 14},
        showlegend=False,
        cliponaxis=False,
        name="Outlying frames",
        row=row,
        col=1,
    )


def _frame_title(panels: tuple[FramePanel, FramePanel]) -> str:
    """The title of the frame axis, with notes on values that are not drawn."""
    notes = _missing(panels)
    most = max(len(panel.frames) for panel in panels)  # a frame may have several known distances
    if most > MOST_DRAWN:
        notes.append(f"of each {-(-most // MOST_DRAWN)} neighbouring frames the worst is drawn")
    for panel in panels:
        if not len(panel.frames):
            notes.append("no frame has both targets, so there is no length")
        if panel.is_log and (below := int((panel.known < panel.lowest).sum())):
            least = f"{rounded(panel.lowest, 1)} {panel.unit}"
            notes.append(f"{count(below, panel.title.lower())} below {least} out of view")
    lines = [line for note in notes for line in textwrap.wrap(note[0].upper() + note[1:], 44)]
    return "<br>".join([f"Frame (n = {len(panels[0].frames):,})", *lines])


MANY_FRAMES, FEW_FRAMES = 100, 8
"""With more, symbols are smaller; with fewer, Plotly would put ticks between them."""
BEFORE, AFTER = "Old parameters", "Repaired parameters"
MARKS = {BEFORE: (style.WRONG_COLOUR, "circle-open"), AFTER: (style.CORRECT_COLOUR, "diamond")}


def plot_check(residuals: Residuals) -> go.Figure:
    """Reprojection error and, with bars, length error of each frame, before and after the repair.

    The frames that may be the first after the movement are marked; the repaired parameters do not
    hold for earlier ones.
    """
    panels, since = _panels(residuals), residuals.since
    grid = {"shared_xaxes": True, "vertical_spacing": 0.06}
    figure = style.blank(340 if len(panels) == 1 else 520, len(panels), **grid)
    size = 9 if len(residuals.frames) <= MANY_FRAMES else 6
    for row, ((title, unit), series) in enumerate(panels.items(), start=1):
        place = {"row": row, "col": 1}
        for name, errors in series.items():
            colour, symbol = MARKS[name]
            style.add_trace(
                figure,
                np.column_stack([residuals.frames, errors]),
                f"frame %{{x}}: %{{y:.3~r}} {unit}<extra>{name}</extra>",
                name=name,
                cliponaxis=False,
                marker={"color": colour, "symbol": symbol, "size": size, "line": {"width": 1.5}},
                legendgroup=name,
                showlegend=row == 1,
                **place,
            )
        every = np.concatenate(list(series.values()))
        known = every[np.isfinite(every) & (every > 0)]
        is_log = len(known) and known.max() > LOG_BEYOND * np.median(known)
        scale = {"type": "log", "dtick": 1} if is_log else {"rangemode": "tozero"}
        title_of = {"text": f"{title} ({unit})", "standoff": 8}  # beside the longest label
        figure.update_yaxes(title=title_of, **place, **scale)
    if since is not None:
        band = {"line_width": 0, "fillcolor": style.NEUTRAL, "opacity": 0.25, "layer": "below"}
        figure.add_vrect(x0=since.low - 0.5, x1=since.high + 0.5, row="all", col=1, **band)
    few = int(np.ptp(residuals.frames)) < FEW_FRAMES
    figure.update_xaxes(tickformat="d", dtick=1 if few else None)
    figure.update_xaxes(title_text="Frame", row=len(panels), col=1)
    return figure


def describe_check(residuals: Residuals) -> str:
    """The figure in words."""
    parts, since = [], residuals.since
    for (title, unit), series in _panels(residuals).items():
        values = [
            f"{median_and_largest(errors)} {unit} with the {name.lower()}"
            for name, errors in series.items()
        ]
        parts.append(f"{title}, median and largest: {', '.join(values)}")
    later = "" if since is None else f" The repaired parameters hold from frame {since.low} on."
    return f"{style.count(len(residuals.frames), 'frame')}. {'. '.join(parts)}.{later}"


def _panels(residuals: Residuals) -> dict[tuple[str, str], dict[str, FloatArray]]:
    """The errors (n,) by the name of the parameters, for each title and unit."""
    reprojection, length, since = {}, {}, residuals.since
    for name, errors in ((BEFORE, residuals.before), (AFTER, residuals.after)):
        if errors is None:
            continue
        first = since.low if since and name == AFTER else -np.inf
        shown = np.where(residuals.frames >= first, 1.0, np.nan)
        reprojection[name] = shown * errors.reprojection_px
        if errors.length is not None:
            length[name] = shown * 100 * errors.length
    panels = {("Reprojection error", "px"): reprojection, ("Length error", "%"): length}
    return {title: series for title, series in panels.items() if series}
