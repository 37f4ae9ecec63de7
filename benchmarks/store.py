"""What can go wrong with a project's file, each tried; and what it costs to be sure.

python -m benchmarks.store [FOLDER]

The folder should be on the disk that will hold the projects. The full disk is a small tmpfs, which
needs the rights to mount one.
"""

import hashlib
import os
import random
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

from stereocal.errors import StereocalError
from stereocal.projects import database as database_module
from stereocal.projects.database import DiskFullError
from stereocal.projects.files import LARGEST
from stereocal.projects.home import copy_database, delete, recent_projects, remove, sweep
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from tests.pages.stored_projects import FULL, placed

MB = 1_000_000
LARGE = 900 * MB
PHOTOGRAPHS, SIZE = 50, 4 * MB
DISK = 96 * MB
DAMAGED = 200


def main() -> None:
    """Try all, and print."""
    with tempfile.TemporaryDirectory(dir=sys.argv[1] if len(sys.argv) > 1 else None) as folder:
        home = Path(folder)
        speed(home / "speed")
        large(home / "large")
        with_a_rollback_journal(home / "remote")
        full_disk(home / "full")
        damage(home / "damaged")
        backup(home / "backup")
    print(f"load {os.getloadavg()[0]:.1f}")


@contextmanager
def timed(what: str) -> Iterator[None]:
    """Print how long something takes."""
    begun = time.perf_counter()
    yield
    print(f"{what}: {time.perf_counter() - begun:.2f} s", flush=True)


def speed(home: Path) -> None:
    """Photographs in and out, settings, and a list of 500 projects."""
    store = ProjectPhotographs(Project.create(home))
    contents = [os.urandom(SIZE) for _ in range(PHOTOGRAPHS)]
    with timed(f"{PHOTOGRAPHS} photographs of {SIZE // MB} MB in"):
        store.add({f"{at}.png": store.keep("", content) for at, content in enumerate(contents)})
    with timed("and out"):
        assert [file.read_bytes() for file in store.photographs.values()] == contents
    with timed("200 settings kept"):
        for at in range(200):
            store.project.keep_settings({"delta": at})
    with timed("200 times all settings read"):
        for _ in range(200):
            _ = store.project.settings
    with timed("the photographs removed"):
        store.clear()
    print(f"which leaves a file of {store.database.path.stat().st_size} bytes")
    for _ in range(500):
        Project.create(home)
    with timed("the list of 501 projects"):
        assert len(recent_projects(home)) == 501
    with timed("a sweep of them"):
        sweep(home, 30.0)


def large(home: Path) -> None:
    """A value of 900 MB, and one that is too large."""
    database = Project.create(home).database
    path = home / "large.csv"
    with path.open("wb") as file:
        for _ in range(LARGE // SIZE):
            file.write(os.urandom(SIZE))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with timed(f"{LARGE // MB} MB in"):
        stored = database.keep_file(path, path.name)
        database.name_files("applied", {path.name: stored})
    with timed("and out"):
        stored.copy_to(home / "out.csv")
    more = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1000
    with (home / "out.csv").open("rb") as file:
        same = hashlib.file_digest(file, "sha256").hexdigest() == stored.sha256
    print(f"the same: {same}; {more} MB more memory", flush=True)
    with path.open("r+b") as file:
        file.truncate(LARGEST + 1)
    size = database.path.stat().st_size
    try:
        database.keep_file(path, path.name)
    except StereocalError as error:
        print(f"{error} The file grew by {database.path.stat().st_size - size} bytes.")


def with_a_rollback_journal(home: Path) -> None:
    """Where a write-ahead log fails: four threads, which all write and read."""
    with mock.patch.object(database_module, "journal_of", lambda _folder: "delete"):
        project = placed(FULL, home)
        together(project)
        assert project.database.rows("PRAGMA journal_mode") == [("delete",)]
    project = placed(FULL, home.with_name("local"))
    together(project)
    assert project.database.rows("PRAGMA journal_mode") == [("wal",)]


def together(project: Project) -> None:
    """Four threads, as tabs of one project."""
    database = project.database
    database.keep_values("count", {"x": 0})

    def work() -> None:
        for _ in range(50):
            with database.transaction():
                database.keep_values("count", {"x": database.values("count")["x"] + 1})
            assert project.inputs.files

    threads = [threading.Thread(target=work) for _ in range(4)]
    begun = time.perf_counter()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    count, seconds = database.values("count")["x"], time.perf_counter() - begun
    kept = database.rows("PRAGMA journal_mode")[0][0]
    print(f"journal {kept}: {count} of 200 acts of 4 tabs in {seconds:.2f} s", flush=True)


def full_disk(place: Path) -> None:
    """A disk that fills: what was accepted stays, and removing works and makes room."""
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={DISK}", "none", str(place)]
    if subprocess.run(mount, check=False, capture_output=True).returncode:
        print("full disk: not tried, since no tmpfs can be mounted here")
        return
    try:
        other = placed(FULL, place)
        store, kept = ProjectPhotographs(Project.create(place)), {}
        try:
            for at in range(1000):
                file = store.keep(f"{at}.png", os.urandom(MB))
                store.add({f"{at}.png": file})
                kept[f"{at}.png"] = file
        except DiskFullError as error:
            print(f"after {len(kept)} photographs of 1 MB: {error}")
        with (place / "filler").open("wb", buffering=0) as filler:
            try:
                while filler.write(bytes(4096)):
                    pass
            except OSError:
                print(f"then filled to {_free(place)} free bytes")
        assert store.photographs == kept and all(file.read_bytes() for file in kept.values())
        assert store.database.rows("PRAGMA integrity_check") == [("ok",)]
        assert other.calibration is not None
        _refused(lambda: other.keep_settings({"text": "x" * 100_000}))
        _refused(store.clear)
        remove(place, other.id)
        before = _free(place)
        delete(place, other.id)
        print(f"a project removed and deleted: {_free(place) - before} bytes more are free")
    finally:
        subprocess.run(["umount", str(place)], check=True)


def _refused(act: Callable[[], object]) -> None:
    try:
        act()
    except DiskFullError:
        return
    print("accepted on a full disk, which has more room than was thought")


def _free(folder: Path) -> int:
    found = os.statvfs(folder)
    return found.f_bavail * found.f_frsize


def damage(home: Path) -> None:
    """Bits changed at random places: a sentence or a value."""
    said: Counter[str] = Counter()
    for seed in range(DAMAGED):
        rng = random.Random(seed)
        project = placed(FULL, home / f"{seed}")
        path = project.database.path
        content = bytearray(path.read_bytes())
        for _ in range(1 + seed % 40):
            content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        path.write_bytes(bytes(content))
        recent_projects(home / f"{seed}")
        try:
            _ = project.inputs, project.calibration, project.evaluation
            for file in ProjectPhotographs(project).photographs.values():
                file.read_bytes()
            said["read whole"] += 1
        except StereocalError:
            said["a sentence"] += 1
        assert path.read_bytes() == bytes(content)
    print(f"{DAMAGED} damaged: {dict(said)}", flush=True)


def backup(home: Path) -> None:
    """Backups beside a tab that writes without pause."""
    project, over = placed(FULL, home), threading.Event()

    def write() -> None:
        while not over.is_set():
            with project.database.transaction():
                count = project.settings.get("a", 0) + 1
                project.keep_settings({"a": count})
                project.keep_settings({"b": count})

    thread = threading.Thread(target=write)
    thread.start()
    for at in range(20):
        copy_database(project.database, home / f"{at}.sqlite")
    over.set()
    thread.join()
    whole = 0
    for at in range(20):
        copy = Project(type(project.database)(home / f"{at}.sqlite"))
        settings = copy.settings
        assert copy.database.rows("PRAGMA integrity_check") == [("ok",)]
        whole += settings.get("a") == settings.get("b")
    print(f"{whole} of 20 backups are whole; {project.settings['a']} acts meanwhile", flush=True)


if __name__ == "__main__":
    main()
