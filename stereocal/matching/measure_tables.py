"""Reconstruct whole tables of pairs, or of tracks, into tables of 3D points."""

from collections.abc import Iterable
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from stereocal.errors import RowProblem
from stereocal.fit.rig_file import Parameters
from stereocal.matching.point_noise import PointNoise, check_sigma
from stereocal.matching.point_table import PAIR_SIGMAS, PointTable, open_table
from stereocal.matching.reconstruction import Noise, name_of_world
from stereocal.matching.settled import ERROR_DECIMALS
from stereocal.matching.tables_by_camera import Report
from stereocal.matching.trajectories import (
    COORDINATES,
    OUTSIDE_VOLUME,
    POINT_COLUMNS,
    SIGMA_COLUMNS,
    with_track,
)
from stereocal.matching.views import SAMPLE_PAIRS, Views, cameras_of, views_of
from stereocal.rig.field_of_view import beyond_in_words, count_beyond
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import PlacedCameras
from stereocal.system.array_types import FloatArray
from stereocal.system.tasks import Progress, Task, run_tasks

AHEAD = 2
"""Blocks in memory: each may have 100,000 rows."""
MOST_WITH_TRACK = 1_000_000
"""Rows of a table that is held whole, which its trajectories need; longer ones get no `track`."""


def measure_tables(
    rig: Parameters,
    table: PointTable,
    out: Path | None,
    world: Pose | None = None,
    sigma_px: float | None = None,
    progress: Progress | None = None,
    executor: Executor | None = None,
    passed_on: list[pd.DataFrame] | None = None,
) -> Report:
    """Reconstruct the points of a table of pairs, or of the tracks of a rig, and write them.

    Args:
        table: of pairs, or of tracks; pairs are measured a block at a time.
        world: `world_from_primary`, of a rig `world_from_reference`.
        sigma_px: standard deviation of a pixel coordinate; None: as `Views.noise_of` finds it.
        progress: called with the number of rows done and the total; what it raises ends the work,
            and no file is written.
        executor: measures blocks; None: the calling thread.
        out: None: nothing is written, only passed on.
        passed_on: gets what is written.
    """
    check_sigma(sigma_px)
    views, sample, beyond = views_of(rig), list[pd.DataFrame](), dict.fromkeys(rig.placed, 0)
    table, timing = views.in_step(table)

    def look(block: pd.DataFrame) -> list[RowProblem]:
        sample.append(block.iloc[:: max(len(block) // SAMPLE_PAIRS, 1)])
        for which, (camera, _) in rig.placed.items():
            pixels = block[[f"u_{which}", f"v_{which}"]].to_numpy(dtype=np.float64)
            beyond[which] += count_beyond(camera, pixels)
        return points_outside_images(rig, block)

    rows = table.check(look).rows
    blocks: Iterable[pd.DataFrame] = table.blocks()
    if views.AT_ONCE:
        blocks = sample = [pd.concat(list(blocks))]
    noise = views.noise_of(pd.concat(sample), sigma_px)
    tasks = (Task(_measured, (views, world, noise, block), len(block)) for block in blocks)
    measured = run_tasks(tasks, executor, rows, progress, ahead=AHEAD)
    errors, outside, waiting = list[FloatArray](), 0, list[pd.DataFrame]()
    with open_table(out, passed_on=passed_on) as writer, closing(measured):
        for _, points in measured:
            (waiting.append if rows <= MOST_WITH_TRACK else writer.add)(points)
            errors.append(points["error_px"].to_numpy(dtype=np.float64))
            if OUTSIDE_VOLUME in points:
                outside += int((points[OUTSIDE_VOLUME] & points["error_px"].notna()).sum())
        if waiting:
            writer.add(with_track(pd.concat(waiting, ignore_index=True)))
    report = views.report(np.concatenate(errors), outside, noise)
    return replace(report, notes=[*filter(None, [timing, *report.notes, beyond_in_words(beyond)])])


def _measured(
    views: Views, world: Pose | None, noise: PointNoise | None, block: pd.DataFrame
) -> pd.DataFrame:
    """The table of points of what belongs together, which is in step."""
    pixels = views.pixels(block)
    sigmas: Noise = None if noise is None else noise.sigma_px
    if noise is not None and noise.source == "columns":
        stated = block[list(PAIR_SIGMAS)].to_numpy(dtype=np.float64)
        sigmas = np.where(np.isfinite(stated), stated, noise.sigma_px)
    points = views.fit(pixels, sigmas).in_frame(world, views.rig.volume, noise is not None)
    columns: dict[str, Any] = {"frame": block["frame"].to_numpy()}
    columns |= dict(zip("xyz", points.xyz.T, strict=True))
    columns["error_px"] = points.error_px.round(ERROR_DECIMALS)
    if points.sigma_m is not None:
        columns |= dict(zip(SIGMA_COLUMNS, points.sigma_m.T, strict=True))
    columns |= dict.fromkeys(views.COUNTED, cameras_of(pixels))
    if points.outside_volume is not None:
        columns[OUTSIDE_VOLUME] = points.outside_volume
    if world is not None:
        columns[COORDINATES] = np.full(len(block), name_of_world(world))
    passed = views.passed(block)
    taken = {*POINT_COLUMNS, *SIGMA_COLUMNS, OUTSIDE_VOLUME, COORDINATES, *views.COUNTED}
    for name in passed:
        columns[f"{name}_{views.SOURCE}" if name in taken else str(name)] = passed[name].array
    return pd.DataFrame(columns)


def points_outside_images(rig: PlacedCameras, block: pd.DataFrame) -> list[RowProblem]:
    """The rows of a block of pairs, or of tracks, with a point outside its image."""
    problems = []
    for which, (camera, _) in rig.placed.items():
        pixels = block[[f"u_{which}", f"v_{which}"]].to_numpy(dtype=np.float64)
        problems += [
            RowProblem(
                int(block.index[row]), f"the {which} {what}: are these parameters of other images?"
            )
            for row, what in camera.outside(pixels)
        ]
    return sorted(problems, key=lambda problem: problem.line)
