"""The errors of the methods, frame by frame: what is plotted, printed and said of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stereocal.calibration.methods import METHOD_NAMES, Method
from stereocal.figures.style import MOST_DRAWN, count
from stereocal.refined.outliers import (
    bar_frames,
    frame_reprojection_px,
    length_outliers,
    outlying_frames,
    reprojection_outliers,
)
from stereocal.refined.results import Calibration
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray
from stereocal.system.numbers import rounded

LOG_BEYOND = 30.0
"""Ratio of the largest error to the smallest median of a method above which the axis is
logarithmic."""
LOWEST_OF_MEDIAN = 0.01
"""Lower end of a logarithmic axis over that median, since single errors may be close to 0."""
MAXIMUM_LABELS = 12


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
        return np.asarray(every[np.isfinite(every)])

    @property
    def smallest_median(self) -> float:
        """The median of the best method; NaN if none is above 0."""
        medians = [median(values) for values in self.values.values()]
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
            return self.lowest / 1.3, 3 * float(self.known.max())
        return 0.0, 1.15 * float(self.known.max(initial=0.0)) or 1.0

    @property
    def lowest(self) -> float:
        """Lower end of what is drawn on a logarithmic axis."""
        positive = self.known[self.known > 0]
        return float(max(positive.min(), LOWEST_OF_MEDIAN * self.smallest_median))

    @property
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


def describe_frame_errors(calibration: Calibration) -> str:
    """The figure in words: median and largest errors of the methods, and outlying frames."""
    panels = frame_panels(calibration)
    parts = []
    for panel in panels:
        values = [
            f"{METHOD_NAMES[method]} {median_and_largest(errors)}"
            for method, errors in panel.values.items()
        ]
        parts.append(
            f"{panel.title.lower()} in {panel.unit}, median and largest: {', '.join(values)}"
        )
    frames, (_, left, without) = panels[0].frames, panels[0].counts
    outliers = outlying_frames(calibration)
    named = ", ".join(map(str, outliers[:MAXIMUM_LABELS]))
    more = " and more" if len(outliers) > MAXIMUM_LABELS else ""
    standing_out = f"{count(len(outliers), 'frame')} standing out{': ' if outliers else ''}"
    parts += [*missing(panels), f"{standing_out}{named}{more}"]
    without_words = f" and {without} left out" if without else ""
    return (
        f"Errors of {count(len(frames), 'frame')}, {left} of them held out{without_words}: "
        f"{'; '.join(parts)}."
    )


def frame_panels(calibration: Calibration) -> tuple[FramePanel, FramePanel]:
    """Reprojection errors and length errors of all sets."""
    frames, of_bars = calibration.dataset.correspondences.frames, bar_frames(calibration)
    px = {method: frame_reprojection_px(calibration, method) for method in calibration.errors}
    percents = {method: 100 * errors.length for method, errors in calibration.errors.items()}
    outlying = reprojection_outliers(calibration), length_outliers(calibration)
    of_frames, of_lengths = (_kinds(calibration, own) for own in (frames, of_bars))
    return (
        FramePanel("Reprojection error", "px", frames, of_frames, px, "2d", outlying[0]),
        FramePanel("Length error", "%", of_bars, of_lengths, percents, "3d", outlying[1]),
    )


def _kinds(calibration: Calibration, frames: IntArray) -> dict[FrameKind, BoolArray]:
    left, without = (
        np.isin(frames, own)
        for own in (calibration.held_out_frames, calibration.screening.left_out)
    )
    return dict(zip(KINDS, (~(left | without), left, without), strict=True))


def missing(panels: Sequence[FramePanel]) -> list[str]:
    """A note for each method and error with frames that have no value."""
    return [
        f"{METHOD_NAMES[method]}: {count(int(np.isnan(values).sum()), 'frame')} without "
        f"{panel.title.lower()} (point behind a camera)"
        for panel in panels
        for method, values in panel.values.items()
        if np.isnan(values).any()
    ]


def median(values: FloatArray) -> float:
    """Of the finite values; NaN without any."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")


def median_and_largest(values: FloatArray) -> str:
    """Of the finite values, in words."""
    known = values[np.isfinite(values)]
    if not len(known):
        return "none and none"
    return f"{rounded(np.median(known), 3)} and {rounded(known.max(), 3)}"
