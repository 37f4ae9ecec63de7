"""Match two tables of points frame by frame and write the table of pairs."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from heapq import merge
from itertools import groupby, repeat
from pathlib import Path

import numpy as np
import pandas as pd

from stereocal.errors import RowProblem, StereocalError
from stereocal.matching.in_step import bring_into_step
from stereocal.matching.matching import ANY_DEPTH, check_depths, purpose_warning
from stereocal.matching.names import (
    AUTO,
    WITHIN,
    Names,
    Sample,
    TwoCameras,
    choose_named_threshold,
    choose_names,
    stated_columns,
    texts,
)
from stereocal.matching.pairs import POINT, further_names, match_frame, pixels_of
from stereocal.matching.point_noise import PointNoise
from stereocal.matching.point_table import Contents, PointTable, open_table, together
from stereocal.matching.threshold import ThresholdChoice, sample_of
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.parameters import RigParameters
from stereocal.system.numbers import count, rounded
from stereocal.system.tasks import Progress, StoppedError, Task, run_tasks

LOST_COLUMNS = ("camera", "frame", "u", "v")
OTHER_IMAGES = 0.2
"""With a larger fraction of points outside the image, the parameters are of other images."""
FEW_MATCHED, MANY_LOST, USUAL_LOST = 0.1, 0.1, 0.05
MANY_POINTS = 100
BLOCK_FRAMES, BLOCK_ROWS, AHEAD = 25, 2000, 6
Frame = tuple[int, pd.DataFrame, pd.DataFrame]
"""Number, and rows of the primary and of the secondary camera."""
Frames = list[Frame]


@dataclass(frozen=True)
class MatchReport:
    """The result of a matching in numbers."""

    chosen: ThresholdChoice
    frames: int
    pairs: int
    ambiguous: int
    unmatched_primary: int
    unmatched_secondary: int
    notes: list[str] = field(default_factory=list)
    names: Names = field(default_factory=Names)

    def sentence(self) -> str:
        by = ""
        if self.names.columns:
            by = f", of points of one name ({self.names.in_words}),"
        return (
            f"{count(self.pairs, 'pair')} in {count(self.frames, 'frame')}{by} at a threshold of "
            f"{rounded(self.chosen.threshold_px, 3)} px; {self.ambiguous} of them ambiguous "
            "(another partner is within the threshold as well); without partner: "
            f"{count(self.unmatched_primary, 'point')} of the primary, "
            f"{self.unmatched_secondary} of the secondary."
        )


def match_tables(
    rig: RigParameters,
    primary: PointTable,
    secondary: PointTable,
    out: Path,
    threshold_px: float | None = None,
    depths_m: tuple[float, float] = ANY_DEPTH,
    unmatched: Path | None = None,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
    executor: Executor | None = None,
    sigma_px: float | None = None,
    names: str = AUTO,
) -> MatchReport | None:
    """Match two tables (`frame,u,v` and further columns) and write the pairs; None if cancelled.

    Args:
        threshold_px, sigma_px: as of `threshold.choose_threshold`.
        depths_m: nearest and farthest depth in the primary's frame.
        unmatched: file for the points without a partner (`camera,frame,u,v` and further columns).
        progress: called with the number of frames done and the total.
        executor: matches blocks of frames; None: the calling thread.
        names: as of `pairs.match`.
    """
    secondary, timing = bring_into_step(secondary, POINT, rig)
    tables = (primary, secondary)
    columns = stated_columns(names, primary.further, secondary.further)
    contents = [
        check_points(table, getattr(rig, which), which, columns)
        for table, which in zip(tables, CAMERAS, strict=True)
    ]
    check_depths(depths_m)
    notes = [*filter(None, [timing]), *_notes(rig, tables, contents)]
    sample = _sample(tables, contents)
    distinct = contents[0].distinct, contents[1].distinct
    known, note = choose_names([TwoCameras(rig, sample)], distinct, columns, names != AUTO)
    notes += [note] if note else []
    chosen = choose_named_threshold(rig, sample, known, depths_m, sigma_px, threshold_px)
    renamed = further_names(primary.further, secondary.further)
    total = len(np.union1d(contents[0].frames, contents[1].frames))
    tasks = (
        Task(
            _match_block,
            (rig, block, chosen.threshold_px, depths_m, renamed, chosen.noise, known),
            len(block),
        )
        for block in _blocks(_side_by_side(primary, secondary))
    )
    matched = run_tasks(tasks, executor, total, progress, cancelled, ahead=AHEAD)
    counts, doubtful = np.zeros(4, dtype=np.int64), Counter[str]()
    try:
        with ExitStack() as stack:
            pairs = stack.enter_context(open_table(out))
            lost = None
            if unmatched is not None:
                further = dict.fromkeys([*primary.further, *secondary.further])
                lost = stack.enter_context(open_table(unmatched, [*LOST_COLUMNS, *further]))
            for _, (found, numbers, lonely) in stack.enter_context(closing(matched)):
                pairs.add(found)
                if known.columns:
                    off = found[~found[WITHIN]].rename(
                        columns={v: k for k, v in renamed[0].items()}
                    )
                    for name in texts(off, known.columns):
                        doubtful[name] = doubtful.get(name, 0) + 1
                if lost is not None:
                    lost.add(lonely)
                counts += numbers
    except StoppedError:
        return None
    count, ambiguous, left_primary, left_secondary = counts.tolist()
    shares = chosen.shares
    loses_many = chosen.is_forced and shares is not None and shares.lost > MANY_LOST
    if loses_many or count < FEW_MATCHED * min(each.rows for each in contents):
        few, noise = f"Few partners within {rounded(chosen.threshold_px, 3)} px.", chosen.noise
        seen = chosen.is_forced and noise is not None and noise.source == "estimated"
        notes.append(
            f"{few} Your points scatter by {noise.in_words}: have the threshold chosen from them."
            if noise is not None and seen
            else f"{few} Make sure that points, parameters and the two cameras (primary, secondary)"
            " belong together; if your points are less exact than the targets, state their noise."
        )
    notes += _on_names(chosen, count, doubtful)
    common = len(np.intersect1d(contents[0].frames, contents[1].frames))
    left = left_primary, left_secondary
    return MatchReport(chosen, common, count, ambiguous, *left, notes, known)


def check_points(
    table: PointTable, camera: Camera, which: str, columns: Sequence[str] = ()
) -> Contents:
    """Read a table once and check its points; `columns` as of `PointTable.check`."""
    size = np.array(camera.image_size)
    image = f"{size[0]}x{size[1]} px"

    def refuse(block: pd.DataFrame) -> list[RowProblem]:
        pixels = pixels_of(block)
        off = np.flatnonzero(((pixels < -0.5) | (pixels > size - 0.5)).any(axis=1))
        if len(off) > OTHER_IMAGES * len(block):
            u, v = pixels.max(axis=0)
            raise StereocalError(
                f"{table.label}: the points of the {which} camera reach ({u:.0f}, {v:.0f}) px, but "
                f"the parameters are of images of {image}: they are of another camera, or the "
                "images were scaled or cropped."
            )
        again = np.flatnonzero(block.duplicated(["frame", *POINT]).to_numpy())
        lines, frames = block.index.to_numpy(), block["frame"].to_numpy()
        outside = f"is outside the {image} image of the {which} camera"
        problems = [
            RowProblem(int(lines[row]), f"frame {frames[row]}{colon} the point {point} {what}")
            for rows, colon, what in ((off, ":", outside), (again, " has", "twice"))
            for row, point in ((row, f"({pixels[row, 0]:g}, {pixels[row, 1]:g})") for row in rows)
        ]
        return sorted(problems, key=lambda problem: problem.line)

    return table.check(refuse, columns)


def _blocks(frames: Iterator[Frame]) -> Iterator[Frames]:
    """Blocks of frames that take about 0.1 s to match."""
    block: list[Frame] = []
    rows = 0
    for frame in frames:
        block.append(frame)
        rows += len(frame[1]) + len(frame[2])
        if len(block) == BLOCK_FRAMES or rows >= BLOCK_ROWS:
            yield block
            block, rows = [], 0
    if block:
        yield block


def _match_block(
    rig: RigParameters,
    block: Frames,
    threshold: float,
    depths_m: tuple[float, float],
    names: Sequence[Mapping[str, str]],
    noise: PointNoise | None,
    known: Names,
) -> tuple[pd.DataFrame, list[int], pd.DataFrame]:
    """The pairs of a block; numbers of pairs, ambiguous pairs, and unmatched points of each camera;
    the unmatched points.
    """
    found, lonely = zip(
        *(match_frame(rig, *frame, threshold, depths_m, names, noise, known) for frame in block),
        strict=True,
    )
    _, first, second = zip(*block, strict=True)
    pairs, ambiguous = sum(map(len, found)), sum(int(table["ambiguous"].sum()) for table in found)
    numbers = [pairs, ambiguous, *(sum(map(len, side)) - pairs for side in (first, second))]
    return together(found), numbers, together(lonely)


def _side_by_side(primary: PointTable, secondary: PointTable) -> Iterator[Frame]:
    """Each frame of either table in order, with its rows in both (an empty table if missing)."""

    tables = (primary, secondary)
    empty = [
        pd.DataFrame({name: [] for name in ("frame", *POINT, *table.sigmas, *table.further)})
        for table in tables
    ]
    numbered = (zip(repeat(k), table.frames(), strict=False) for k, table in enumerate(tables))
    for frame, sides in groupby(merge(*numbered, key=_frame_of), key=_frame_of):
        own = {k: rows for k, (_, rows) in sides}
        yield frame, own.get(0, empty[0]), own.get(1, empty[1])


def _frame_of(side: tuple[int, tuple[int, pd.DataFrame]]) -> int:
    return side[1][0]


def _sample(tables: tuple[PointTable, PointTable], contents: list[Contents]) -> Sample:
    """Some of the frames that both tables have."""
    common = np.intersect1d(contents[0].frames, contents[1].frames)
    if not len(common):
        a, b = (f"{each.frames[0]} to {each.frames[-1]}" for each in contents)
        raise StereocalError(
            f"The two tables have no frame in common: {tables[0].label} has frames {a}, "
            f"{tables[1].label} has frames {b}. Use the same frame numbers in both."
        )
    wanted = sample_of(common.tolist(), contents[0].rows / len(contents[0].frames))
    return [(one, two) for frame, one, two in _side_by_side(*tables) if frame in wanted]


def _on_names(chosen: ThresholdChoice, pairs: int, doubtful: Counter[str]) -> list[str]:
    """A note on names whose points do not fit together, where that is more than noise."""
    expected = USUAL_LOST if chosen.shares is None else chosen.shares.lost
    count = doubtful.total()
    if count <= 3 + 3 * expected * pairs:
        return []
    named = ", ".join(f"{name} {times} times" for name, times in doubtful.most_common(3))
    return [
        f"{count} of {pairs} pairs of one name have errors above the threshold (column {WITHIN}; "
        f"{named}): these names may be of different points, or exchanged in a camera."
    ]


def _notes(
    rig: RigParameters, tables: tuple[PointTable, PointTable], contents: list[Contents]
) -> list[str]:
    """Warnings, a sentence each."""
    notes = [*filter(None, [purpose_warning(rig, "matching")])]
    for table, own, other, which in zip(tables, contents, contents[::-1], CAMERAS, strict=True):
        alone = np.setdiff1d(own.frames, other.frames)
        if len(alone):
            shown = ", ".join(str(frame) for frame in alone[:3])
            notes.append(
                f"{count(len(alone), 'frame', 'are')} in {table.label} only ({shown}"
                f"{', ...' if len(alone) > 3 else ''}): points there have no partner."
            )
        if own.left_out:
            notes.append(f"{table.label}: {count(own.left_out, 'row')} without a point left out.")
        width, height = getattr(rig, which).image_size
        if own.rows >= MANY_POINTS and own.largest[0] < width / 2 and own.largest[1] < height / 2:
            notes.append(
                f"All points of {table.label} lie in the upper left quarter of the {which} "
                f"camera's {width}x{height} px: were the images scaled down?"
            )
    return notes
