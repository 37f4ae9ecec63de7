"""Who changes one project takes turns, in threads and processes; other projects go on."""

from __future__ import annotations

import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from stereocal.errors import StereocalError
from stereocal.project import Project
from stereocal.store import state
from stereocal.store.projects import remove
from stereocal.store.state import changing
from tests.projects.test_project import FIELD, filled

SLOW = 60
"""Seconds that nothing takes unless it hangs, on a busy machine either."""
WRITER = """
import sys
from pathlib import Path
from stereocal.project import Project
project = Project.open(Path(sys.argv[1]), sys.argv[2])
for k in range(40):
    project.keep_settings({f"{sys.argv[3]}{k}": k})
"""


def test_no_change_of_two_servers_and_four_threads_is_lost(tmp_path: Path) -> None:
    project = Project.create(tmp_path)
    servers = [
        subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path), project.id, name])
        for name in "ab"
    ]
    with ThreadPoolExecutor(4) as threads:
        for k in range(40):
            threads.submit(project.keep_settings, {f"t{k}": k})
    assert [server.wait() for server in servers] == [0, 0]
    assert len(project.settings) == 120


def test_a_project_that_is_busy_keeps_no_other_waiting(tmp_path: Path) -> None:
    busy, other = Project.create(tmp_path), Project.create(tmp_path)
    held, done = threading.Event(), threading.Event()

    def hold() -> None:
        with changing(busy.folder):
            held.set()
            done.wait(SLOW)

    holder = threading.Thread(target=hold)
    holder.start()
    assert held.wait(SLOW)
    other.keep_settings({"seed": 1})
    assert holder.is_alive()  # it has not waited until the busy one was let go of
    waiting = threading.Thread(target=busy.keep_settings, args=({"seed": 2},))
    waiting.start()
    waiting.join(0.2)
    assert waiting.is_alive() and busy.settings == {}
    done.set()
    waiting.join(SLOW)
    holder.join(SLOW)
    assert busy.settings == {"seed": 2}


def test_what_is_given_is_read_while_others_may_change_the_project(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = filled(tmp_path)
    times = 0
    check = Project._check_inputs

    def slowly(self: Project, *given: object) -> None:
        nonlocal times
        times += 1
        if times < 3:  # another tab, meanwhile
            thread = threading.Thread(
                target=Project(self.folder).give, args=({},), kwargs={"baseline_m": 4.5 + times}
            )
            monkeypatch.setattr(Project, "_check_inputs", check)
            thread.start()
            thread.join(SLOW)
            assert not thread.is_alive()
            monkeypatch.setattr(Project, "_check_inputs", slowly)
        check(self, *given)  # type: ignore[arg-type]

    monkeypatch.setattr(Project, "_check_inputs", slowly)
    table = (FIELD / "correspondences.csv").read_bytes()
    project.give({"correspondences": ("again.csv", table)}, target_distance_m=0.8)
    inputs = project.inputs
    assert times == 3
    assert (inputs.baseline_m, inputs.target_distance_m) == (6.5, 0.8)
    assert inputs.labels["correspondences"] == "again.csv"


def test_nothing_is_written_into_a_project_that_was_removed_meanwhile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = filled(tmp_path)
    look = state._refuse_removed
    looks = 0

    def then_removed(folder: Path) -> None:
        nonlocal looks
        look(folder)
        looks += 1
        if looks == 1:  # between the first look and the lock
            remove(tmp_path, project.id)

    monkeypatch.setattr(state, "_refuse_removed", then_removed)
    with pytest.raises(StereocalError):
        project.keep_settings({"seed": 1})
    assert not project.folder.exists()
