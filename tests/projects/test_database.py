"""A project's file: whole acts, full disks, other journals, large values, damage, kills."""

import random
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import pytest

from stereocal.errors import StereocalError
from stereocal.projects import database as database_module
from stereocal.projects import files
from stereocal.projects.database import DiskFullError
from stereocal.projects.files import Store
from stereocal.projects.home import copy_database, recent_projects
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from tests.further import further
from tests.pages.stored_projects import FULL, placed
from tests.refused import refused


@pytest.fixture
def database(tmp_path: Path) -> Store:
    return Project.create(tmp_path).database


class ClickedAwayError(BaseException):
    """As Streamlit ends a script in the middle."""


def test_an_act_is_there_whole_or_not_at_all(database: Store) -> None:
    with pytest.raises(ClickedAwayError), database.transaction():
        database.keep_values("clicks", {"x": 1})
        assert database.values("clicks") == {"x": 1}
        raise ClickedAwayError
    assert database.values("clicks") == {}
    with database.transaction():
        database.keep_values("clicks", {"x": 2})
        with pytest.raises(ValueError, match="part"), database.transaction():
            database.keep_values("clicks", {"x": 3, "y": 3})
            raise ValueError("part")
        database.keep_values("clicks", {"z": 4})
    assert database.values("clicks") == {"x": 2, "z": 4}


def test_tabs_wait_for_each_other_and_the_last_write_holds(database: Store) -> None:
    database.keep_values("clicks", {"count": 0})

    def add() -> None:
        for _ in range(15):
            with database.transaction():
                database.keep_values("clicks", {"count": database.values("clicks")["count"] + 1})

    with ThreadPoolExecutor(4) as threads:
        for each in [threads.submit(add) for _ in range(4)]:
            each.result()
    assert database.values("clicks") == {"count": 60}


def test_a_reader_sees_one_state_while_another_writes(database: Store) -> None:
    database.keep_values("clicks", {"x": 1})
    with database.reading() as db:
        thread = threading.Thread(target=lambda: database.keep_values("clicks", {"x": 2}))
        thread.start()
        thread.join()
        assert db.execute("SELECT json FROM value").fetchall() == [("1",)]
    assert database.values("clicks") == {"x": 2}


def test_a_run_of_a_page_sees_what_others_write_and_locks_nobody_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for journal in ("wal", "delete"):
        monkeypatch.setattr(database_module, "journal_of", lambda _folder, it=journal: it)
        project = Project.create(tmp_path / journal)
        with ThreadPoolExecutor(1) as other, database_module.kept_open():
            for number in range(3):
                other.submit(project.database.keep_values, "clicks", {"x": number}).result()
                assert project.database.values("clicks") == {"x": number}
                with project.database.transaction():
                    project.database.keep_values("setting", {"x": number})
                assert other.submit(project.database.values, "setting").result() == {"x": number}
            assert placed(FULL, tmp_path / journal).dataset is not None
        kept = {path.suffix for path in project.database.path.parent.iterdir()}
        assert kept == {files.SUFFIX}  # closed: without this, a log would stand beside it


def test_without_a_write_ahead_log_a_rollback_journal_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    carried = placed(FULL, tmp_path / "local")
    monkeypatch.setattr(database_module, "journal_of", lambda _folder: "delete")
    project = placed(FULL, tmp_path / "remote")
    target = tmp_path / "remote" / "projects" / carried.database.path.name
    carried.database.path.rename(target)
    for one in (project, Project(Store(target))):
        test_tabs_wait_for_each_other_and_the_last_write_holds(one.database)
        assert one.dataset is not None
        with closing(sqlite3.connect(one.database.path)) as db:
            assert db.execute("PRAGMA journal_mode").fetchone() == ("delete",)


def test_a_folder_without_shared_memory_is_recognised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert database_module.journal_of(tmp_path) == "wal"
    folder = tmp_path / "remote"
    (folder / f"{database_module.WAITING}name-shm").mkdir(parents=True)
    monkeypatch.setattr(database_module, "secrets", SimpleNamespace(token_hex=lambda _: "name"))
    assert database_module.journal_of(folder) == "delete"


def test_a_large_value_goes_in_and_out_piece_by_piece(
    database: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "PIECE", 700)
    content = random.Random(1).randbytes(12_345)
    (tmp_path / "large").write_bytes(content)
    for given in (content, tmp_path / "large"):
        stored = database.keep_file(given, "large.csv")
        assert stored.read_bytes() == content
        assert stored.copy_to(tmp_path / "out").read_bytes() == content
        with database.freeing() as db:
            db.execute("DELETE FROM file")


def test_what_is_too_large_is_refused_before_anything_is_written(
    database: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "LARGEST", 1000)
    before = database.path.read_bytes()
    with refused("a.png", "0.001 MB"):
        database.keep_file(bytes(1001), "a.png")
    assert database.path.read_bytes() == before


def test_a_full_disk_says_so_and_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = ProjectPhotographs(Project.create(tmp_path))
    plain = database_module.connect

    def small(path: Path) -> sqlite3.Connection:
        db = plain(path)
        db.execute("PRAGMA max_page_count = 100")
        return db

    monkeypatch.setattr(database_module, "connect", small)
    kept = {}
    with pytest.raises(DiskFullError):
        for number in range(100):
            name = f"left{number}.png"
            file = store.keep(name, random.Random(number).randbytes(50_000))
            store.add({name: file})
            kept[name] = file
    assert 3 < len(kept) < 10 and store.photographs == kept
    assert all(file.read_bytes() for file in kept.values())
    store.clear()
    store.add({"again.png": store.keep("again.png", bytes(100_000))})
    assert store.database.path.stat().st_size < 200_000


def test_a_click_in_the_middle_of_an_upload_loses_nothing(tmp_path: Path) -> None:
    store = ProjectPhotographs(Project.create(tmp_path))
    contents = {f"left{number}.png": bytes([number]) * 5000 for number in range(6)}
    for name in list(contents)[:3]:
        store.keep(name, contents[name])  # the click comes before they are added
    assert store.photographs == {}
    store.add({name: store.keep(name, content) for name, content in contents.items()})
    assert {name: file.read_bytes() for name, file in store.photographs.items()} == contents
    assert store.database.rows("SELECT count(*) FROM file") == [(6,)]


def test_a_backup_while_it_is_open_is_whole(tmp_path: Path) -> None:
    project = placed(FULL, tmp_path)
    with project.database.transaction():
        project.database.keep_values("setting", {"half": True})
        thread = threading.Thread(
            target=lambda: copy_database(project.database, tmp_path / "backup.sqlite")
        )
        thread.start()
        thread.join()
    backup = Project(Store(tmp_path / "backup.sqlite"))
    assert "half" not in backup.settings and backup.inputs == project.inputs
    assert backup.calibration is not None and len(ProjectPhotographs(backup).photographs) == 12


@pytest.mark.parametrize("seed", [0, 8, 16, 24])
def test_damage_is_reported_and_the_file_stays_as_it_is(seed: int, tmp_path: Path) -> None:
    project = placed(FULL, tmp_path)
    path = project.database.path
    rng, damaged = random.Random(seed), bytearray(path.read_bytes())
    for _ in range(1 + seed):
        damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
    path.write_bytes(before := bytes(damaged))
    assert len(recent_projects(tmp_path)) <= 1
    try:
        project.database.rows("PRAGMA integrity_check")
        _ = project.inputs, project.calibration, project.evaluation
        _ = [file.read_bytes() for file in ProjectPhotographs(project).photographs.values()]
    except StereocalError as error:
        assert "damaged" in str(error) or "again" in str(error) or "newer" in str(error)
    assert path.read_bytes() == before


WRITER = """
import sys, os
from pathlib import Path
from stereocal.projects.files import Store
from stereocal.projects.one_server import take_projects

database = Store(Path(sys.argv[1]))
take_projects(database.path.parents[1])
for number in range(100_000):
    with database.transaction():
        file = database.keep_file(os.urandom(100_000), "a")
        database.name_files("bar", {f"{number}": file})
        database.keep_values("clicks", {"count": number + 1})
    print(number + 1, flush=True)
"""


@pytest.mark.parametrize("kills", [2, *further(12)])
def test_killed_at_random_moments_nothing_acknowledged_is_lost(kills: int, database: Store) -> None:
    rng, said = random.Random(5), 0
    for _ in range(kills):
        with database.transaction() as db:
            db.execute("DELETE FROM named")
        with subprocess.Popen(
            [sys.executable, "-c", WRITER, str(database.path)], stdout=subprocess.PIPE, text=True
        ) as process:
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(rng.uniform(0.0, 0.2))
            process.send_signal(signal.SIGKILL)
            said = max([1, *(int(line) for line in process.stdout.read().split("\n")[:-1] if line)])
        count = database.values("clicks")["count"]
        assert said <= count <= said + 1
        assert len(database.files("bar")) == count
        assert database.rows("PRAGMA integrity_check") == [("ok",)]
