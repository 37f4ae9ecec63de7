"""Whether leaving out single frames and whole runs of frames give different figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from stereocal.calibration.methods import METHOD_NAMES, Method
from stereocal.errors import StereocalError
from stereocal.evaluation import evaluate
from stereocal.evaluation.summary import MethodSummary, summarise
from stereocal.rig.dataset import Dataset
from stereocal.verdict.in_words import interval, percent

RUNS, FEWEST = 40, 10
"""Of the other kind of splits: half a second with 400 frames."""
MOST_FRAMES = 40_000
"""Of all of them together; longer recordings are not compared."""
SMALLEST_RATIO = 1.1
"""Of two figures that are worth telling apart."""


def note_on_splits(
    dataset: Dataset,
    settings: evaluate.EvaluationSettings,
    summaries: Mapping[Method, MethodSummary],
) -> str:
    """Where the other kind of splits differs beyond both intervals and by a tenth; else empty.

    Args:
        dataset: that was evaluated with these settings; without runs nothing is computed.
        summaries: what was found.
    """
    runs = min(settings.runs, RUNS, MOST_FRAMES // len(dataset.correspondences.frames))
    if runs < FEWEST or evaluate.clusters_to_split(dataset) is None:
        return ""
    splits: evaluate.Splits = "frames" if settings.splits == "runs" else "runs"
    other = replace(settings, runs=runs, refined=None, splits=splits)
    try:
        tried = summarise([evaluate.evaluate_runs(dataset, other, 0, range(runs))])
    except StereocalError:  # a single run does not determine the pose
        return ""
    by_kind = {settings.splits: summaries, other.splits: tried}
    found = []
    for method in ("2d", "3d"):
        single, whole = (
            (own.reprojection.fcp, own.reconstruction.median)
            for own in (by_kind[kind][method] for kind in ("frames", "runs"))
        )
        found += [
            f"{METHOD_NAMES[method]} {what} {percent(a.value)} % ({interval(a)}) instead of "
            f"{percent(b.value)} % ({interval(b)})"
            for what, a, b in zip(("FCP", "median length error"), single, whole, strict=True)
            if (a.high < b.low or b.high < a.low)
            and max(a.value, b.value) > SMALLEST_RATIO * min(a.value, b.value)
        ]
    if not found:
        return ""
    return (
        "Frames that follow each other are alike. With single frames left out, figures differ from "
        f"those with whole runs left out: {'; '.join(found)}. Rely on the figures of whole runs."
    )
