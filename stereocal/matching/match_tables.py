"""Match tables of points of two cameras or more, a block of frames at a time, and write them."""

from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path

import pandas as pd

from stereocal.errors import StereocalError
from stereocal.fit.rig_file import Parameters
from stereocal.matching.in_step import tables_in_step
from stereocal.matching.point_table import PointTable, open_table, together
from stereocal.matching.settled import Matching, Stated
from stereocal.matching.tables_by_camera import Frame, Report, TablesByCamera, without_partner
from stereocal.matching.views import views_of
from stereocal.rig.field_of_view import beyond_in_words
from stereocal.system.tasks import Progress, Task, run_tasks

LOST_COLUMNS = ("camera", "frame", "u", "v")
BLOCK_FRAMES, BLOCK_ROWS, AHEAD = 25, 2000, 6


def match_tables(
    rig: Parameters,
    tables: Mapping[str, PointTable],
    out: Path | None,
    stated: Stated | None = None,
    unmatched: Path | None = None,
    progress: Progress | None = None,
    executor: Executor | None = None,
    passed_on: list[pd.DataFrame] | None = None,
) -> Report:
    """Match tables (`frame,u,v` and further columns) and write pairs, or the tracks of a rig.

    Further columns are passed through; those of a rig with the name of their camera: `target_left`.

    Args:
        tables: by camera, `primary` and `secondary` with `RigParameters`.
        out: None: nothing is written, only passed on.
        unmatched: file for the points without a partner (`camera,frame,u,v` and further columns).
        progress: called with the number of frames done and the total; what it raises ends the
            work, and no file is written.
        executor: matches blocks of frames; None: the calling thread.
        passed_on: gets what is written, for those who measure it next.
    """
    unknown = [name for name in tables if name not in rig.placed]
    if unknown or len(tables) < 2:
        raise StereocalError(
            f"Give the points of two cameras at least; the rig has the cameras "
            f"{', '.join(rig.placed)}" + (f", not {unknown[0]!r}." if unknown else "."),
            option="NAME=FILE for each",
        )
    stated = stated or Stated()
    by_camera = TablesByCamera.checked(tables, rig, stated.names)
    in_step, timing = tables_in_step(rig, tables)
    if timing:
        by_camera = TablesByCamera.checked(in_step, rig, stated.names)
    matching = views_of(rig).settled(by_camera, stated)
    tasks = (
        Task(_match_block, (matching, block, unmatched is not None), len(block))
        for block in _blocks(by_camera.side_by_side())
    )
    matched = run_tasks(tasks, executor, len(by_camera.frames), progress, ahead=AHEAD)
    reported = list[pd.DataFrame]()
    with ExitStack() as stack:
        writer = stack.enter_context(open_table(out, matching.columns, passed_on))
        lost = None
        if unmatched is not None:
            further = dict.fromkeys(
                name for table in by_camera.tables.values() for name in table.further
            )
            lost = stack.enter_context(open_table(unmatched, [*LOST_COLUMNS, *further]))
        for _, (groups, lonely) in stack.enter_context(closing(matched)):
            writer.add(groups)
            if lost is not None and lonely is not None:
                lost.add(lonely)
            reported.append(groups[matching.reported])
    report = matching.report(together(reported), by_camera)
    first = filter(None, [*timing, beyond_in_words(by_camera.beyond)])
    return replace(report, notes=[*first, *report.notes])


def _blocks(frames: Iterator[Frame]) -> Iterator[list[Frame]]:
    """Blocks of frames that take about 0.1 s to match."""
    block: list[Frame] = []
    rows = 0
    for frame in frames:
        block.append(frame)
        rows += sum(map(len, frame[1]))
        if len(block) == BLOCK_FRAMES or rows >= BLOCK_ROWS:
            yield block
            block, rows = [], 0
    if block:
        yield block


def _match_block(
    matching: Matching, block: list[Frame], with_lonely: bool
) -> tuple[pd.DataFrame, pd.DataFrame | None]:
    """What belongs together in a block, and the points without a partner, if they are wanted."""
    groups, left = zip(*(matching.match_frame(*frame) for frame in block), strict=True)
    lonely = [
        without_partner(rows, matching.cameras, rows_left)
        for (_, rows), rows_left in zip(block, left, strict=True)
        if with_lonely
    ]
    return together(groups), together(lonely) if with_lonely else None
