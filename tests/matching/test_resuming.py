"""Long work that was stopped goes on with what it had finished: nothing is computed twice, and the
result is that of work that was never stopped, to the last bit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
import pandas as pd
import pytest

from stereocal.matching import matching_files
from stereocal.matching.application import PAIRS, POINTS, Application, Points, apply_sets
from stereocal.matching.blocks import pack_block, unpack_block
from stereocal.rig.dataset import Dataset
from stereocal.rig.parameters import RigParameters
from stereocal.rig.volume import Volume
from tests import known_rig as rig

T = TypeVar("T")


class Counting(Executor):
    """Two threads, and how many tasks they were given."""

    def __init__(self) -> None:
        self.tasks = 0
        self._threads = ThreadPoolExecutor(2)

    def submit(self, function: Callable[..., T], /, *args: Any, **named: Any) -> Future[T]:
        self.tasks += 1
        return self._threads.submit(function, *args, **named)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._threads.shutdown(wait, cancel_futures=cancel_futures)


class Parts(Generic[T]):
    """Finished parts, packed, as a project keeps them."""

    def __init__(self, pack: Callable[[T], bytes | None], unpack: Callable[[bytes], T]) -> None:
        self._pack, self._unpack = pack, unpack
        self._kept: dict[str, bytes] = {}

    def __len__(self) -> int:
        return len(self._kept)

    def get(self, key: str) -> T | None:
        return self._unpack(self._kept[key]) if key in self._kept else None

    def keep(self, key: str, part: T) -> None:
        content = self._pack(part)
        if content is not None:
            self._kept[key] = content


class StopAt:
    """Progress that asks for a stop once so much is done."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.done = 0

    def progress(self, done: int, total: int) -> None:
        assert self.done <= done <= total
        self.done = done

    def cancelled(self) -> bool:
        return self.done >= self.limit


@pytest.fixture
def executor() -> Iterator[Counting]:
    with Counting() as counting:
        yield counting


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    return rig.dataset(14, 0.3)


def scattered(folder: Path) -> Application:
    """160 frames of 6 points each, in an order of their own in either camera, with a further column
    that needs quotes."""
    rng = np.random.default_rng(5)
    points = rng.uniform([-1.2, -1.0, 6.0], [1.2, 1.0, 10.0], (960, 3))
    primary, secondary = rig.images(points)
    frames = np.repeat(np.arange(160), 6)
    tables: list[Points] = []
    for which, pixels in (("p", primary), ("s", secondary)):
        table = pd.DataFrame({"frame": frames, "u": pixels[:, 0], "v": pixels[:, 1]})
        table["note"] = [f'"{i}", the {which}\n' for i in range(960)]
        table = table.sample(frac=1, random_state=len(tables)).sort_values("frame", kind="stable")
        path = folder / f"{which}.csv"
        table.to_csv(path, index=False)
        tables.append(Points(path.name, path.name, 960, 160))
    params = RigParameters(rig.PRIMARY, rig.SECONDARY, rig.RIG, "2d", 0.0, {}, {})
    volume = Volume((-0.2, 0.2), (-0.2, 0.2), (6.5, 9.0))
    measuring = replace(params, method="3d", volume=volume)
    return Application(tables[0], tables[1], params, measuring, 0.5)


def test_matching_and_measuring(
    executor: Counting, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    work = scattered(tmp_path)
    monkeypatch.setattr("stereocal.matching.parquet.BLOCK_ROWS", 80)
    folders = [tmp_path / name for name in ("plain", "whole", "stopped", "again")]
    for folder in folders:
        folder.mkdir()
    tables = tmp_path / "p.csv", tmp_path / "s.csv"
    plain = apply_sets(work, tables, folders[0])
    whole = apply_sets(work, tables, folders[1], executor=executor)
    every, executor.tasks = executor.tasks, 0
    parts = Parts(pack_block, unpack_block)
    stop = StopAt(240)  # all 160 frames are matched, and some of the pairs measured

    def begin(_: str) -> None:
        stop.done = 0

    stopped = apply_sets(
        work, tables, folders[2], begin, stop.progress, stop.cancelled, executor, parts
    )
    assert stopped is None
    assert list(folders[2].iterdir()) == [folders[2] / PAIRS]
    finished, executor.tasks = len(parts), 0
    assert 7 < finished < every  # all blocks of 25 frames were matched, and some were measured
    again = apply_sets(work, tables, folders[3], executor=executor, pieces=parts)
    assert executor.tasks == every - finished
    assert plain is not None and plain == whole == again
    outside = pd.read_csv(folders[0] / POINTS)["outside_volume"]
    assert f"{outside.sum()} of 960 points lie outside the volume" in " ".join(plain.sentences)
    for name in (PAIRS, POINTS):
        contents = {(folder / name).read_bytes() for folder in (*folders[:2], folders[3])}
        assert len(contents) == 1
    assert matching_files.BLOCK_FRAMES == 25
