"""What it costs to be sure: photographs in a project and as plain files, and a list of projects.

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

import numpy as np

from stereocal.projects.home import recent_projects
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.system.atomic_files import write_atomically

REPEATS = 5
PHOTOGRAPHS, SIZE = 200, 1_000_000
PROJECTS = 500


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

        def plain() -> None:
            for k, content in enumerate(contents):
                write_atomically(home / "plain" / f"{k}.jpg", content)

        measured(f"{PHOTOGRAPHS} photographs of {SIZE / 1e6:g} MB in a project", store)
        measured("the same as files, each flushed", plain)

        many = home / "many"
        for _ in range(PROJECTS):
            Project.create(many)
        measured(f"{PROJECTS} projects listed, as Start does", lambda: recent_projects(many))


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
