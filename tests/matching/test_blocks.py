"""Blocks matched and measured by several threads give the same files as one after the other."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from stereocal.matching import match_tables
from stereocal.matching.application import POINTS, Application, Points, apply_sets
from stereocal.matching.point_table import PointTable
from stereocal.matching.settled import Stated
from stereocal.matching.views import PAIRS
from stereocal.rig.camera import CAMERAS
from stereocal.rig.parameters import RigParameters
from stereocal.rig.volume import Volume
from stereocal.system.tasks import StoppedError
from tests.matching.test_point_noise import seen
from tests.rigs import known_rig as rig


class StopAt:
    """Progress that stops the work once so much is done."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.done = 0

    def progress(self, done: int, total: int) -> None:
        assert self.done <= done <= total
        self.done = done
        if done >= self.limit:
            raise StoppedError


def scattered(folder: Path) -> Application:
    """60 frames of 6 points each, in an order of their own in either camera, with a further column
    that needs quotes."""
    points: dict[str, Points] = {}
    for which, table in zip(CAMERAS, seen(0.0, 60, 6, missing=0.0), strict=True):
        table["note"] = [f'"{i}", the {which}\n' for i in range(360)]
        table.to_csv(folder / f"{which}.csv", index=False)
        points[which] = Points(f"{which}.csv", f"{which}.csv", 360, 60)
    params = RigParameters(rig.PRIMARY, rig.SECONDARY, rig.RIG, "2d", 0.0, {}, {})
    volume = Volume((-0.2, 0.2), (-0.2, 0.2), (6.5, 9.0))
    measuring = replace(params, method="3d", volume=volume)
    return Application(points, params, measuring, ("2d.json", "3d.json"), Stated(0.5))


def test_matching_and_measuring(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    work = scattered(tmp_path)
    monkeypatch.setattr("stereocal.matching.point_table.BLOCK_ROWS", 80)
    folders = [tmp_path / name for name in ("plain", "whole", "stopped")]
    for folder in folders:
        folder.mkdir()
    tables: dict[str, PointTable] = {
        which: PointTable(tmp_path / f"{which}.csv") for which in CAMERAS
    }
    plain = apply_sets(work, tables, folders[0])
    stop = StopAt(90)  # all 60 frames are matched, and some of the pairs measured

    def begin(_: str) -> None:
        stop.done = 0

    with ThreadPoolExecutor(2) as threads:
        whole = apply_sets(work, tables, folders[1], executor=threads)
        with pytest.raises(StoppedError):
            apply_sets(work, tables, folders[2], begin, stop.progress, threads)
    assert list(folders[2].iterdir()) == [folders[2] / PAIRS]
    assert plain == whole
    outside = pd.read_csv(folders[0] / POINTS)["outside_volume"]
    assert f"{outside.sum()} of 360 points lie outside the volume" in " ".join(plain.sentences)
    for name in (PAIRS, POINTS):
        assert len({(folder / name).read_bytes() for folder in folders[:2]}) == 1
    assert match_tables.BLOCK_FRAMES == 25
