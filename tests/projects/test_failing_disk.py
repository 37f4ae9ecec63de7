"""Every action on projects, struck at every single thing that it does to the disk.

Once the disk is full there, and once the server dies there. What was accepted before is always
there, whole; and the action can be done afterwards.
"""

from __future__ import annotations

import errno
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

from stereocal.errors import StereocalError
from stereocal.formats.correspondences_csv import write_table
from stereocal.frames.frame import correspondences_of
from stereocal.project import Project
from stereocal.store.folders import is_id
from stereocal.store.left_over import remove_left_over
from stereocal.store.photographs import ProjectPhotographs
from tests.failing_disk import CRASHED, EVERY_CALL, count_calls, die_at, fail_at
from tests.store_actions import (
    AT_ONCE,
    IN_STEPS,
    PREPARED,
    check_whole,
    kept,
    left_over,
    placed_full,
)

ACTIONS = [*AT_ONCE, *PREPARED]
EVERY, MOST = 5, 10
"""Of the points at which an action is struck, the suite takes each fifth, ten at most, from a first
one that differs from action to action; `python -m benchmarks.failing_disk` takes all."""


@dataclass
class Struck:
    """How often an action was struck, and what came of it."""

    calls: int = 0
    refused: int = 0
    """Times that the action said it could not be done."""
    done_all_the_same: int = 0
    undone: int = 0
    """Times that the home held what it held before."""


class Bench:
    """A home with a full project, put back for every try."""

    def __init__(self, folder: Path, name: str) -> None:
        self.pristine = folder / "pristine"
        project = placed_full(self.pristine)
        self.id = project.id
        self.home = folder / "home"
        prepare = {**PREPARED, **IN_STEPS}.get(name)
        self.act = AT_ONCE[name] if prepare is None else prepare(project)
        self.before = kept(self.pristine)
        self.calls = self._counted()
        self.after = kept(self.home)

    def _counted(self) -> list[str]:
        self.act(self.fresh())  # once before, so that nothing is compiled while calls are counted
        project = self.fresh()
        return count_calls(self.home, lambda: self.act(project))

    def fresh(self) -> Project:
        shutil.rmtree(self.home, ignore_errors=True)
        shutil.copytree(self.pristine, self.home, copy_function=shutil.copy2)
        return Project(self.home / "projects" / self.id)

    def check(self, name: str, at: int) -> bool:
        """Whether the home is as before; else it is as after, or on the way in a sound order."""
        where = f"{name}, {at} of {len(self.calls)}: {self.calls[at - 1]}"
        for folder in self.home.glob("*/*"):
            if is_id(folder.name):
                check_whole(folder)
        own = Project(self.home / "projects" / self.id)
        if (own.folder / "photographs").is_dir():
            ProjectPhotographs(own).settle()
        now = kept(self.home)
        if now != self.before and now != self.after:
            self._check_between(now, where)
        return now == self.before

    def _check_between(self, now: list[dict[str, str]], where: str) -> None:
        """Each file is as before or as after: none is in between."""
        allowed: dict[str, set[str | None]] = {}
        for state in (*self.before, *self.after):
            for file, digest in state.items():
                allowed.setdefault(file, set()).add(digest)
        for state in now:
            for file, digest in state.items():
                assert digest in allowed[file], (where, file)


def strike_all(
    folder: Path, name: str, points: Callable[[int], range]
) -> tuple[Struck, Struck, Struck]:
    """An action on a disk that is full at a point, and by a server that dies there.

    Returns:
        What came of the full disk, of the one that can only be read, and of the deaths.
    """
    bench = Bench(folder, name)
    full, read_only, died = Struck(), Struck(), Struck()
    for at in points(len(bench.calls)):
        project = bench.fresh()
        full.calls += 1
        try:
            fail_at(bench.home, at, lambda project=project: bench.act(project))  # type: ignore[misc]
            full.done_all_the_same += 1
        except StereocalError as error:
            full.refused += 1
            assert "No space left on device" in str(error), error
        full.undone += bench.check(name, at)
        if not bench.calls[at - 1].startswith(("unlink", "rmdir")):
            assert not left_over(bench.home), (name, at, bench.calls[at - 1])
        again(bench, name, at)

        project = bench.fresh()
        died.calls += 1
        status = die_at(bench.home, at, lambda project=project: bench.act(project))  # type: ignore[misc]
        assert status == CRASHED, (name, at, status)
        died.undone += bench.check(name, at)
        again(bench, name, at)
        remove_left_over(bench.home, 1e12)
        assert not left_over(bench.home), (name, at)

    project = bench.fresh()
    read_only.calls += 1
    try:
        fail_at(bench.home, EVERY_CALL, lambda: bench.act(project), errno.EROFS)
    except StereocalError as error:
        read_only.refused += 1
        assert "Read-only file system" in str(error)
    read_only.undone += bench.check(name, 1)
    return full, read_only, died


@contextmanager
def quick_folder() -> Iterator[Path]:
    """In memory, where there is such a place: the calls are what counts, not the disk."""
    memory = Path("/dev/shm")
    where = memory if memory.is_dir() else None
    with tempfile.TemporaryDirectory(dir=where) as folder:
        yield Path(folder)


def again(bench: Bench, name: str, at: int) -> None:
    """What was not done can be done now, with the same outcome."""
    if kept(bench.home) == bench.before:
        bench.act(Project(bench.home / "projects" / bench.id))
        assert kept(bench.home) == bench.after, (name, at, bench.calls[at - 1])


@pytest.mark.parametrize("name", ACTIONS)
def test_nothing_is_lost_and_nothing_is_half(name: str) -> None:
    first = 1 + ACTIONS.index(name) % EVERY
    with quick_folder() as folder:
        full, read_only, died = strike_all(
            folder, name, lambda n: range(first, n + 1, max(EVERY, n // MOST))
        )
    assert full.calls == died.calls
    assert read_only.calls == read_only.refused == read_only.undone == 1
    assert full.refused + full.done_all_the_same == full.calls


def seen(project: Project) -> tuple[object, ...]:
    """A data set as the pages show it: whose lengths, photographs, targets and table."""
    store, inputs = ProjectPhotographs(project), project.inputs
    lengths = inputs.name, inputs.baseline_m, inputs.target_distance_m
    frames = [frame.frame for frame in store.frames or []]
    return *lengths, tuple(sorted(store.photographs)), tuple(frames), project.table is not None


def test_a_data_set_with_photographs_is_there_as_a_whole_or_not_at_all() -> None:
    with quick_folder() as folder:
        bench = Bench(folder, "ProjectPhotographs.give")
        before = seen(bench.fresh())
        project = bench.fresh()
        bench.act(project)
        after = seen(project)
        assert after == ("Another", 3.0, 0.5, ("left8.jpg", "right8.jpg"), (), False)
        assert all(old != new for old, new in zip(before, after, strict=True))
        met = []
        for call, project in struck(bench):
            met.append(seen(project))
            assert met[-1] in (before, after), call
            # What comes next goes on from there, and does not turn it back.
            project.give({}, target_distance_m=0.75)
            ProjectPhotographs(project).settle()
            changed = list(met[-1])
            changed[2] = 0.75
            assert seen(project) == tuple(changed), call
        assert before in met and after in met


@pytest.mark.parametrize("name", ["add, in place of another", "keep_found, of others"])
def test_what_was_found_in_a_photograph_is_never_another_ones(name: str) -> None:
    name = f"ProjectPhotographs.{name}"
    with quick_folder() as folder:
        bench = Bench(folder, name)
        old, new = (
            ProjectPhotographs(Project(home / "projects" / bench.id))
            for home in (bench.pristine, bench.home)
        )
        files, found = [old.photographs, new.photographs], [old.frames, new.frames]
        for call, project in struck(bench):
            store = ProjectPhotographs(project)
            names = {photograph: path.name for photograph, path in store.photographs.items()}
            whole = [
                (frames or [])
                for those, frames in zip(files, found, strict=True)
                if names == {photograph: path.name for photograph, path in those.items()}
            ]
            known = [frame for frames in whole for frame in frames]
            assert all(frame in known for frame in store.frames or []), call
            store.settle()
            table = project.table
            assert table is not None and store.frames is not None
            assert table[1] == write_table(correspondences_of(store.frames)), call


def struck(bench: Bench) -> Iterator[tuple[str, Project]]:
    """The project after a death, and after a full disk, at each call; which call that was."""
    for at, call in enumerate(bench.calls, start=1):
        for strike in (die_at, lambda *args: refused(fail_at, *args)):
            project = bench.fresh()
            strike(bench.home, at, lambda project=project: bench.act(project))  # type: ignore[misc]
            yield f"{at}, {call}", project


def refused(act: Callable[..., object], *args: object) -> None:
    """Do what may be refused."""
    with suppress(StereocalError):
        act(*args)
