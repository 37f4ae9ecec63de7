"""Every long command gives the same files with threads, with processes and on a Dask cluster."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from stereocal.cli import main
from stereocal.system.executors import engine, tasks_at_once
from tests.further import further
from tests.photographs import lens
from tests.terminal import FIELD, ROOT, tables

PHOTOGRAPHS = ROOT / "sample_data" / "photographs"
pytestmark = [
    pytest.mark.filterwarnings("ignore::DeprecationWarning:(distributed|dask|tornado|zict).*"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore:Port .* is already in use:UserWarning"),
]


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """The address of a Dask cluster: a scheduler, and a process that does two tasks at once."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=True, dashboard_address=None
    ) as started:
        assert started.scheduler_address.startswith("tcp://")
        yield started.scheduler_address


@pytest.fixture(scope="module")
def commands(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """The words of each command but for --out, on little data."""
    given = tmp_path_factory.mktemp("given")
    found = tables(given)
    few = given / "few"
    for camera in ("primary", "secondary"):
        (few / camera).mkdir(parents=True)
        for path in sorted((PHOTOGRAPHS / camera).iterdir())[:2]:
            shutil.copy(path, few / camera)
    for name in ("dataset.json", "primary.json", "secondary.json"):
        shutil.copy(PHOTOGRAPHS / name, few)
    lens.write_boards(given / "boards", 5)
    parameters = ["--parameters", f"{found['parameters']}"]
    tables_of = found["primary"], found["secondary"]
    return {
        "evaluate": ["evaluate", f"{FIELD}", "--runs", "25", "--no-refined"],
        "detect": ["detect", f"{few}", "--doubtful"],
        "intrinsics": [
            *("intrinsics", f"{given / 'boards'}"),
            *["--board", "8x6", "--square", "0.03", "--subset", "4", "--repeats", "12"],
        ],
        "match": ["match", *map(str, tables_of), *parameters, "--threshold", "1"],
        "reconstruct": ["reconstruct", f"{found['pairs']}", *parameters],
    }


OUT = {"evaluate": "out", "detect": "table.csv", "intrinsics": "camera.yml"}
OUT |= {"match": "pairs.csv", "reconstruct": "points.csv"}


def one_of_all(usual: str) -> list[Any]:
    """One command, and in the whole soak all others."""
    return [usual, *further(*(name for name in OUT if name != usual))]


def written(name: str, words: list[str], folder: Path, *options: str) -> bytes:
    """What a command writes, but for the report, which tells when it was made."""
    out = folder / OUT[name]
    assert main([*words, "--out", str(out), *options]) == 0
    return (out / "summary.json" if name == "evaluate" else out).read_bytes()


@pytest.mark.parametrize("name", one_of_all("match"))
def test_processes(name: str, commands: dict[str, list[str]], tmp_path: Path) -> None:
    by_threads = written(name, commands[name], tmp_path / "threads")
    assert written(name, commands[name], tmp_path, "--workers", "2") == by_threads


@pytest.mark.parametrize("name", one_of_all("detect"))
def test_a_cluster(
    name: str, commands: dict[str, list[str]], scheduler: str, tmp_path: Path
) -> None:
    by_threads = written(name, commands[name], tmp_path / "threads")
    assert written(name, commands[name], tmp_path, "--scheduler", scheduler) == by_threads


def test_photographs_need_no_shared_disk(scheduler: str, tmp_path: Path) -> None:
    """A worker gets the content: the path names nothing on its computer."""
    from stereocal.system.photograph_files import for_worker

    path = tmp_path / "a.png"
    path.write_bytes(b"content")
    with engine(scheduler=scheduler) as executor:
        assert tasks_at_once(executor) == 2
        assert for_worker(path, executor) == b"content"
        assert for_worker(tmp_path / "none", executor) == tmp_path / "none"
