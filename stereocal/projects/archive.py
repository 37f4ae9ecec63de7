"""Export and import of a project as a zip of plain files.

project.json                          what the files are, lengths, settings, corrections
dataset.json, correspondences.csv ... the data set as used; the command line opens it
parameters_2d.json ...                the last result's parameter files, as the page offers them
inputs/, photographs/, results/ ...   all uploaded files, and all results
pairs/1/results/ ...                  the results of each pair of a rig that was looked at
"""

import json
import re
import tempfile
import time
import zipfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from itertools import chain, count
from pathlib import Path, PurePosixPath
from typing import Any

from stereocal.errors import StereocalError, damaged
from stereocal.formats.dataset_files import pack_dataset
from stereocal.formats.inputs import MANIFEST
from stereocal.projects.clicks import ProjectClicks
from stereocal.projects.contents import (
    ANY,
    CONTENTS,
    INPUT,
    PAGES,
    SCOPE,
    TABLES,
    Held,
    Table,
    edition,
    held,
    travels,
)
from stereocal.projects.files import Store, StoredFile, new_database
from stereocal.projects.pairs_of_before import pairs_of_before
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.server_settings import check_quota
from stereocal.system.atomic_files import write_in_parts
from stereocal.system.json_text import read_json
from stereocal.system.limits import Limits
from stereocal.system.names import check_path, label_of
from stereocal.system.zip_files import OpenZip, open_zip

MANIFEST_FORMAT = "stereocal-project/1"
FILES = (
    "SELECT part, name, sha256, about, stored FROM named JOIN file USING (sha256) "
    "ORDER BY named.rowid"
)
PACKED = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".zip", ".npz", ".parquet", ".h5", ".mat")
UNSAFE = re.compile(r"[^A-Za-z0-9._-]|^\.+")


def pack_project(project: Project, target: Path, result: Mapping[str, bytes] | None = None) -> None:
    """Write a project with all its inputs and results as a zip, atomically.

    Args:
        result: the parameter files of the last result by name; None: none.
    """
    database = project.database
    with (
        write_in_parts(target) as waiting,
        zipfile.ZipFile(waiting, "w", zipfile.ZIP_DEFLATED, strict_timestamps=False) as archive,
        database.reading() as db,
    ):
        manifest, used = _Manifest(), set[str]()
        for scoped, name, text in database.rows("SELECT part, name, json FROM value"):
            part, section = manifest.place(scoped)
            if _packed("value", part, name):
                section["values"].setdefault(part, {})[name] = json.loads(text)
        edits = database.rows("SELECT json FROM edit ORDER BY number") if _packed("edit") else []
        manifest.whole["edits"] = [json.loads(text) for (text,) in edits]
        for scoped, name, sha256, text, stored in database.rows(FILES):
            part, section = manifest.place(scoped)
            if (entry := _packed("named", part)) is not None:
                about = json.loads(text)
                label = about["suffix"] if part == TABLES else about
                path = _unused(section.get("folder", "") + entry.place, name, label, used)
                item = {"part": part, "name": name, "about": about, "path": path}
                section["files"].append(item | ({"stored": stored} if _packed("file") else {}))
                _write(archive, path, StoredFile(sha256, database))
        for scoped, content in db.execute("SELECT kind, content FROM result"):  # one in memory
            kind, section = manifest.place(scoped)
            if (entry := _packed("result", kind)) is not None:
                archive.writestr(f"{section.get('folder', '')}results/{entry.place}", content)
        text = json.dumps(manifest.whole, indent=1)
        read_json(text, "The project could not be opened from its zip again")
        archive.writestr(MANIFEST, text)
        with suppress(StereocalError):  # damaged data are left out
            # The data set and the last result, in the formats of the command line.
            dataset = project.dataset
            readable = {} if dataset is None else pack_dataset(dataset)
            for name, content in ({**(result or {}), **readable}).items():
                archive.writestr(name, content)


class _Manifest:
    """What project.json says of a project, and of each pair and page with a scope of its own."""

    def __init__(self) -> None:
        stated = {"format": MANIFEST_FORMAT, "edition": edition()}
        self.whole: dict[str, Any] = {**stated, "values": {}, "files": [], "edits": []}
        self._scopes: dict[str, dict[str, Any]] = {"": self.whole}

    def place(self, scoped: str) -> tuple[str, dict[str, Any]]:
        """The part that a scoped one is, and what is said of its scope."""
        scope, _, part = scoped.rpartition("/")
        if scope not in self._scopes:
            section = {"name": scope.removeprefix(SCOPE), "folder": f"pairs/{len(self._scopes)}/"}
            self._scopes[scope] = {**section, "values": {}, "files": []}
            self.whole.setdefault("pairs", []).append(self._scopes[scope])
        return part, self._scopes[scope]


def _write(archive: zipfile.ZipFile, path: str, stored: StoredFile) -> None:
    info = zipfile.ZipInfo(path)
    packed = path.lower().endswith(PACKED)
    info.compress_type = zipfile.ZIP_STORED if packed else zipfile.ZIP_DEFLATED
    with archive.open(info, "w", force_zip64=True) as file:
        file.writelines(stored.pieces())


def _packed(table: Table, part: str = "", name: str = ANY) -> Held | None:
    """How something is packed; None if it stays."""
    if (entry := held(table, part, name)) is None:
        raise StereocalError(
            f"This version of stereocal does not know what a later one stored here ({part} "
            f"{name[:40]}), and it would be lost: pack the project with that version."
        )
    return None if entry.stays else entry


def _unused(folder: str, name: str, label: str, used: set[str]) -> str:
    """A safe and unique path for a file, close to its name."""
    suffix = PurePosixPath(f"_{label}").suffix if "." not in name and label else ""
    plain = "/".join(UNSAFE.sub("_", part) or "_" for part in f"{name}{suffix}".split("/"))
    numbered = (f"{folder}/{number}_{plain}" for number in count(2))
    path = next(path for path in chain([f"{folder}/{plain}"], numbered) if path not in used)
    used.add(path)
    return path


def unpack_project(
    source: Path | bytes, name: str, home: Path, tell: Callable[[str], object] = lambda _: None
) -> Project:
    """Import a zip of `pack_project` as a new project below `home`.

    Args:
        tell: is given what a zip of another version lacks, and what of it is left out.

    Raises:
        StereocalError: not a zip, no project in it, or an invalid one; nothing is imported.
    """

    def fill(database: Store) -> None:
        with open_zip(source, name) as opened:
            check_quota(sum(map(opened.size, opened.names)))
            _fill(Project(database), opened, name, tell)

    return Project(new_database(home, fill))


def _fill(project: Project, opened: OpenZip, source: str, tell: Callable[[str], object]) -> None:
    manifest, database = _manifest(opened, source), project.database
    message = f"{MANIFEST} is damaged."
    with (
        tempfile.TemporaryDirectory(prefix="stereocal-") as folder,
        damaged(message, source=source, keep=True),
        database.transaction() as db,
    ):
        of_pairs = manifest.get("pairs", [])
        files = sum(len(section["files"]) for section in (manifest, *of_pairs))
        Limits.from_environment().check_count(files, f"{source}: {MANIFEST}")
        members, scopes = _Members(opened, Path(folder) / "file"), {""}
        unknown = _restore(manifest, database, members)
        if travels("edit"):
            edits = [(json.dumps(dict(edit)),) for edit in manifest["edits"]]
            db.executemany("INSERT INTO edit (json) VALUES (?)", edits)
        _ = project.recording, project.rig
        for section in of_pairs:
            store = _scoped(project, section["name"])
            if store.scope in scopes:
                raise ValueError(store.scope)
            scopes.add(store.scope)
            unknown += _restore(section, store, members)
        pairs_of_before(db)
        packed = int(manifest.get("edition", 1))
    newer = [entry.words for entry in CONTENTS.values() if entry.since > packed and not entry.stays]
    if newer:
        lacking = ", ".join(dict.fromkeys(newer))
        tell(f"{source} was packed by an earlier version of stereocal, and lacks: {lacking}.")
    if unknown:
        some = ", ".join(name[:40] for name in unknown[:3]) + ", ..." * (len(unknown) > 3)
        tell(f"{source} has what this version of stereocal does not know; left out: {some}.")


class _Members:
    """The files of a project's zip. Each belongs to one name: reading a large one for each of many
    names would take hours.

    Args:
        path: of a temporary file.
    """

    def __init__(self, opened: OpenZip, path: Path) -> None:
        self._opened, self._path, self._left = opened, path, {*opened.names}

    def _take(self, path: str) -> str:
        if path not in self._left:
            why = "twice" if path in self._opened.names else "but is not in the zip"
            raise StereocalError(f"{path} is in {MANIFEST} {why}.")
        self._left.remove(path)
        return path

    def read(self, path: str) -> bytes | None:
        """Its content; None if it is not there."""
        return self._opened.read(self._take(path)) if path in self._left else None

    def store(self, path: str, store: Store) -> StoredFile:
        """Store it; by the temporary file, so that a large one is not held in memory."""
        with self._path.open("wb") as file:
            file.writelines(self._opened.pieces(self._take(path)))
        return store.keep_file(self._path, path)


def _scoped(project: Project, name: str) -> Store:
    """The store of a pair of the rig, of a page, or of a page of a pair, by its name in the zip."""
    pair_name, _, page = name.rpartition("/")
    pair = pair_name if page in PAGES else name
    store = project.database
    if pair:
        store = project.of_pair(pair).results
    return store.of_page(page) if page in PAGES else store


def _restore(section: Mapping[str, Any], store: Store, members: _Members) -> list[str]:
    """Store what the project itself, a pair or a page has in a zip, and check it by reading it.

    Returns:
        What is not on the list of `contents`.
    """
    unknown, named = list[str](), set[tuple[str, str]]()
    for part, values in section["values"].items():
        unknown += [f"{part} {name}" for name in values if held("value", part, name) is None]
        kept = {name: value for name, value in values.items() if travels("value", part, name)}
        if part == INPUT and isinstance(kept.get("name"), str):
            kept["name"] = label_of(kept["name"])
        store.keep_values(part, kept)
    for item in section["files"]:
        part, name, path = (str(item[key]) for key in ("part", "name", "path"))
        if not travels("named", part):
            unknown += [] if held("named", part) else [f"{part} {name}"]
            continue
        if (part, name) in named:
            raise ValueError(name)
        named.add((part, name))
        check_path(name, MANIFEST)
        stored = replace(members.store(path, store), about=_about(item["about"]))
        store.name_files(part, {name: stored})
        _keep_day(store, stored, item.get("stored"))
    for table, kind, _ in CONTENTS:
        if table == "result" and (entry := held(table, kind)) and not entry.stays:
            content = members.read(f"{section.get('folder', '')}results/{entry.place}")
            if content is not None:
                store.keep_result(kind, content)
    scoped = Project(store)
    _ = scoped.dataset, ProjectClicks(scoped).acts
    ProjectPhotographs(scoped).check()
    return unknown


def _keep_day(store: Store, file: StoredFile, day: float | None) -> None:
    """Store when a file was given, in seconds since 1970: the title of a project may say it."""
    if day is None or not travels("file"):
        return
    if not day >= 0:
        raise ValueError(day)
    with store.transaction() as db:
        row = [min(day, time.time()), file.sha256]
        db.execute("UPDATE file SET stored = ? WHERE sha256 = ?", row)


def _about(about: Any) -> Any:
    """What is stored with a file's name, its label as it can be shown."""
    if isinstance(about, dict) and isinstance(about.get("label"), str):
        return {**about, "label": label_of(about["label"])}
    return label_of(about) if isinstance(about, str) else about


def _manifest(opened: OpenZip, source: str) -> dict[str, Any]:
    if MANIFEST not in opened.names:
        raise StereocalError("there is no stereocal project in this zip.", source)
    manifest = read_json(opened.read(MANIFEST), f"{source}: {MANIFEST}")
    form = manifest.get("format") if isinstance(manifest, dict) else None
    if form != MANIFEST_FORMAT:
        raise StereocalError(
            f"the project was written by another version of stereocal ({form}); update stereocal "
            "to open it.",
            source,
        )
    with damaged(f"{MANIFEST} is damaged.", source=source):
        # Neither NaN nor lone surrogates, which no page can show.
        json.dumps(manifest, ensure_ascii=False, allow_nan=False).encode()
    return dict(manifest)
