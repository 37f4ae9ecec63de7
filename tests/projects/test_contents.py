"""All that a project holds travels, in a zip and in copies; what stays is listed."""

import json
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from stereocal.errors import StereocalError
from stereocal.projects.archive import pack_project, unpack_project
from stereocal.projects.clicks import ProjectClicks
from stereocal.projects.contents import ANY, CONTENTS, PAGES, Key
from stereocal.projects.files import Store
from stereocal.projects.home import copy_database, duplicate
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.system import json_text
from stereocal.system.zip_files import OpenZip, pack_zip, unzip
from tests.pages.stored_projects import FULL
from tests.projects.whole_project import differing, rows_of, whole_project
from tests.refused import refused

STAY = {key for key, each in CONTENTS.items() if each.stays}
TRAVEL = [key for key in CONTENTS if key not in STAY]
NAME: Key = ("value", "input", "name")
NEEDED: set[Key] = {
    ("value", "input", "baseline_m"),
    ("named", "bar", ANY),
    ("named", "recording", ANY),
}
"""The plan, pairs of photographs and pairs of cameras name what is then not there."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Project:
    return whole_project(tmp_path_factory.mktemp("whole"))


@pytest.fixture(scope="module")
def members(whole: Project) -> dict[str, bytes]:
    """The files of its zip."""
    path = whole.database.path.parents[1] / "whole.zip"
    pack_project(whole, path)
    return unzip(path, path.name)


def changed(members: dict[str, bytes], change: Callable[[Any], object]) -> bytes:
    """The zip with another project.json."""
    manifest = json.loads(members["project.json"])
    change(manifest)
    return pack_zip({**members, "project.json": json.dumps(manifest).encode()})


def of_bar(manifest: Any, **values: Any) -> None:
    manifest["values"]["bar"].update(values)


def test_whole_project_has_every_entry_of_the_list_and_every_scope(whole: Project) -> None:
    assert rows_of(whole).keys() == CONTENTS.keys()
    parts = "SELECT part FROM value UNION SELECT kind FROM result"
    scopes = {part.rpartition("/")[0] for (part,) in whole.database.rows(parts)}
    own = whole.database, whole.database.of_pair("1-2"), *map(whole.database.of_page, PAGES)
    assert scopes == {store.scope.rstrip("/") for store in own}


def test_all_rows_come_along(whole: Project, members: dict[str, bytes], tmp_path: Path) -> None:
    told: list[str] = []
    opened = unpack_project(pack_zip(members), "whole.zip", tmp_path, told.append)
    assert differing(rows_of(whole), rows_of(opened)) == STAY and not told
    assert not ProjectClicks(opened).clicks.every
    ProjectClicks(opened).undo()
    assert [each.track for each in ProjectClicks(opened).clicks.every.values()] == ["head"]
    assert opened.of_pair("1-2").recommended == ("2d", "3d")
    # What was decided on pairs can be undone as before.
    photographs = ProjectPhotographs(opened)
    assert [row.use for row in photographs.rows] == [False, *5 * [True]]
    photographs.undo_choice()
    choice = photographs.choice
    assert (choice.way, choice.exchanged, len(choice.without)) == ("order", True, 1)
    photographs.undo_choice()
    assert not photographs.choice.exchanged and not photographs.can_undo_choice


def test_copies_have_all_rows(whole: Project, tmp_path: Path) -> None:
    home, before = whole.database.path.parents[1], rows_of(whole)
    copy = duplicate(home, whole.id)
    assert differing(before, rows_of(copy)) == {NAME} | STAY
    (tmp_path / "projects").mkdir()
    moved = tmp_path / "projects" / whole.database.path.name
    copy_database(whole.database, moved)
    assert differing(before, rows_of(Project(Store(moved)))) == set()


@pytest.mark.parametrize("key", TRAVEL, ids=" ".join)
def test_what_is_taken_out_of_the_list_is_missed(
    key: Key, whole: Project, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The comparison above can fail for each entry."""
    monkeypatch.setitem(CONTENTS, key, replace(CONTENTS[key], stays="for this test"))
    pack_project(whole, tmp_path / "p.zip")
    try:
        opened = unpack_project(tmp_path / "p.zip", "p.zip", tmp_path)
    except StereocalError:  # the rest needs it
        assert key in NEEDED
    else:
        assert differing(rows_of(whole), rows_of(opened)) == {key} | STAY
    copy = duplicate(whole.database.path.parents[1], whole.id)
    assert differing(rows_of(whole), rows_of(copy)) == {NAME, key} | STAY
    monkeypatch.delitem(CONTENTS, key)
    with refused(f"({key[1]} {key[2].rstrip('*')}"):
        pack_project(whole, tmp_path / "q.zip")


def test_a_new_entry_has_the_next_number() -> None:
    """So that zips of before are said to lack it, but for inputs that need not be stated."""
    since = [each.since for each in CONTENTS.values()]
    assert {number: since.count(number) for number in since} == {1: 52, 2: 1}


@pytest.mark.parametrize(
    "write",
    [
        lambda store: store.keep_values("bar", {"new": 1}),
        lambda store: store.keep_values("new", {"name": 1}),
        lambda store: store.keep_result("new", b""),
        lambda store: store.name_files("new", {}),
        lambda store: store.of_page("new"),
    ],
)
def test_nothing_else_can_be_stored(write: Callable[[Store], object], tmp_path: Path) -> None:
    project = Project.create(tmp_path)
    with pytest.raises(AssertionError):
        write(project.database)


def test_a_zip_of_an_earlier_version_has_what_it_has_and_says_what_it_lacks(
    whole: Project, members: dict[str, bytes], tmp_path: Path
) -> None:
    def as_before(manifest: Any) -> None:
        del manifest["edition"]
        for own in (manifest, *manifest["pairs"]):
            for item in own["files"]:
                del item["stored"]

    told: list[str] = []
    before = changed({**members, "reproduce.json": b"{}"}, as_before)
    opened = unpack_project(before, "p.zip", tmp_path, told.append)
    days: Key = ("file", "", ANY)
    assert differing(rows_of(whole), rows_of(opened)) == STAY | {days}
    assert len(told) == 1 and CONTENTS[days].words in told[0]
    unpack_project(FULL, FULL.name, tmp_path, told.append)
    assert len(told) == 2 and FULL.name in told[1]


def test_what_another_version_has_beside_is_left_out_and_said(
    whole: Project, members: dict[str, bytes], tmp_path: Path
) -> None:
    def beside(manifest: Any) -> None:
        of_bar(manifest, moon=1)
        manifest["values"]["tides"] = {"high": 1}
        manifest["files"].append({"part": "charts", "name": "a", "about": "", "path": "b"})

    told: list[str] = []
    opened = unpack_project(changed(members, beside), "p.zip", tmp_path, told.append)
    assert differing(rows_of(whole), rows_of(opened)) == STAY
    assert len(told) == 1 and all(each in told[0] for each in ("bar moon", "tides high", "charts"))


def test_a_zip_that_would_not_open_is_not_made(
    whole: Project, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(json_text, "MOST_VALUES", 100)
    with refused("100 values"):
        pack_project(whole, tmp_path / "p.zip")
    assert not list(tmp_path.iterdir())


def file_again(manifest: Any) -> None:
    photograph = next(item for item in manifest["files"] if item["part"] == "bar")
    manifest["files"].append({**photograph, "path": "results/evaluation.npz"})


def scope_again(manifest: Any) -> None:
    manifest["pairs"].append({**manifest["pairs"][0], "files": []})


ACT = {"placed": [{"frame": 1, "camera": "a", "track": "b", "u": 1.0, "v": 2.0}]}
PAIR = {"pair": {"frame": 1, "primary": "no such", "secondary": "photograph"}, "use": True}
FORGED: dict[str, Callable[[Any], object]] = {
    "a click that is none": lambda m: m["values"].update(clicks={"000000001": {"placed": [1]}}),
    "a name of a click": lambda m: m["values"].update(clicks={"head": ACT}),
    "a frame of a click": lambda m: m["values"].update(
        clicks={"000000001": {"placed": [{**ACT["placed"][0], "frame": 10**30}]}}
    ),
    "a place of a click": lambda m: m["values"].update(
        clicks={"000000001": {"placed": [{**ACT["placed"][0], "u": 1e308}]}}
    ),
    "a way to pair": lambda m: of_bar(m, pairing=[{"choice": {"way": "dice"}}]),
    "a decision": lambda m: of_bar(m, pairing="exchanged"),
    "frames later of no camera": lambda m: of_bar(m, pairing=[{"choice": {"later": {}}}]),
    "frames later": lambda m: of_bar(
        m, pairing=[{"choice": {"later": {"primary": 0, "secondary": 10**30}}}]
    ),
    "photographs of a pair": lambda m: of_bar(m, pairs=[PAIR]),
    "photographs of a pair before": lambda m: of_bar(m, pairing=[{"rows": [PAIR]}, {}], pairs=[]),
    "doubtful boards": lambda m: of_bar(m, boards_doubtful=[1]),
    "values": lambda m: m["values"].update(bar=1),
    "a day": lambda m: m["files"][0].update(stored=-1),
    "a day in words": lambda m: m["files"][0].update(stored="Monday"),
    "an edition": lambda m: m.update(edition="last"),
    "a file twice": file_again,
    "a pair": lambda m: m["pairs"][0].update(name="1-4"),
    "a page": lambda m: m["pairs"][0].update(name="start"),
    "no pair": lambda m: m["pairs"][0].update(name=""),
    "a pair twice": scope_again,
}


@pytest.mark.parametrize("what", FORGED)
def test_what_nobody_can_have_stored_is_refused(
    what: str, members: dict[str, bytes], tmp_path: Path
) -> None:
    with pytest.raises(StereocalError):
        unpack_project(changed(members, FORGED[what]), "p.zip", tmp_path)
    assert not list((tmp_path / "projects").iterdir())


@pytest.mark.parametrize("most", [100, 20_000])
def test_a_file_that_is_named_many_times_is_read_once_at_most(
    most: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """10 kB, of which each name would cost 10 MB of reading."""
    monkeypatch.setenv("STEREOCAL_MOST_FILES", str(most))
    one = {"part": "bar", "about": None, "path": "photographs/a.png"}
    files = [{**one, "name": str(number)} for number in range(5_000)]
    manifest = {"format": "stereocal-project/1", "values": {}, "files": files, "edits": []}
    members = {"project.json": json.dumps(manifest).encode(), one["path"]: bytes(10_000_000)}
    path = tmp_path / "p.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, content in members.items():
            archive.writestr(name or "", content)
    read: list[str] = []
    pieces = OpenZip.pieces

    def counted(self: OpenZip, name: str) -> Iterator[bytes]:
        assert name not in read
        read.append(name)
        return pieces(self, name)

    monkeypatch.setattr(OpenZip, "pieces", counted)
    with refused(*(["a.png", "project.json"] if most > 5_000 else [5000, 100, "MOST_FILES"])):
        unpack_project(path, path.name, tmp_path)
    assert path.stat().st_size < 40_000 and read
    assert not list((tmp_path / "projects").iterdir())
