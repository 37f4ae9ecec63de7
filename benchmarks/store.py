"""What it costs to be sure: photographs that are flushed to the disk, and a list of 500 projects.

python -m benchmarks.store [FOLDER]

Wall time and CPU time, the median of 5 and the range; the folder should be on the disk that will
hold the projects.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import numpy as np

from stereocal.projects.home import changed_at, folders_in, recent_projects
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project

REPEATS = 5
PHOTOGRAPHS, SIZE = 200, 1_000_000
PROJECTS, FILES = 500, 100


def main() -> None:
    """Measure both and print them."""
    with tempfile.TemporaryDirectory(dir=sys.argv[1] if len(sys.argv) > 1 else None) as folder:
        home = Path(folder)
        contents = [np.random.default_rng(k).bytes(SIZE) for k in range(PHOTOGRAPHS)]

        def store() -> None:
            own = ProjectPhotographs(Project.create(home))
            names = [f"{k}.jpg" for k in range(PHOTOGRAPHS)]
            own.add({
                name: own.keep(name, content)
                for name, content in zip(names, contents, strict=True)
            })  # fmt: skip

        measured(f"{PHOTOGRAPHS} photographs of {SIZE / 1e6:g} MB, each flushed", store)
        with mock.patch("os.fsync", lambda _: None):
            measured("the same, nothing flushed", store)

        many = home / "many"
        for _ in range(PROJECTS):
            files = Project.create(many).folder / "photographs" / "files"
            files.mkdir(parents=True)
            for k in range(FILES):
                (files / f"{k}.jpg").touch()
        measured(f"{PROJECTS} projects of {FILES} photographs listed", lambda: listed(many))
        measured("the same, every file looked at", lambda: all_files(many))


def listed(home: Path) -> None:
    """As the Start page does it."""
    assert len(recent_projects(home)) == 10


def all_files(home: Path) -> None:
    """As it was: the newest of all files of every project."""
    for folder in folders_in(home / "projects"):
        newest = max(path.stat().st_mtime for path in folder.rglob("*"))
        assert newest >= changed_at(folder)


def measured(what: str, act: Callable[[], object]) -> None:
    """Print how long something takes."""
    walls, times = [], []
    for _ in range(REPEATS):
        wall, cpu = time.perf_counter(), time.process_time()
        act()
        walls.append(time.perf_counter() - wall)
        times.append(time.process_time() - cpu)
    load = os.getloadavg()[0]
    print(
        f"{what}: wall {np.median(walls):.3f} s ({min(walls):.3f} to {max(walls):.3f}), CPU "
        f"{np.median(times):.3f} s, load {load:.1f}",
        flush=True,
    )


if __name__ == "__main__":
    main()
