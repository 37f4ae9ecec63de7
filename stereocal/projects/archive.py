"""Export and import of a project as a zip of plain files.

project.json                          what the files are, lengths, settings, corrections
dataset.json, correspondences.csv ... the data set as used; the command line opens it
parameters_2d.json ...                the last result's parameter files, as the page offers them
reproduce.json                        what `reproduce` needs to compute them again
inputs/, photographs/, results/ ...   all uploaded files, and all results
pairs/1/inputs/ ...                   the same of each pair of a rig that was opened
"""

import json
import re
import tempfile
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from itertools import chain, count
from pathlib import Path, PurePosixPath
from typing import Any

from stereocal.errors import StereocalError, damaged
from stereocal.formats.dataset_files import pack_dataset
from stereocal.formats.inputs import MANIFEST
from stereocal.projects.application import APPLIED, ASKING, CHECK, POINT_FILES, SETS, TABLES, WORLD
from stereocal.projects.files import PAIR, Store, StoredFile, new_database
from stereocal.projects.photographs import BAR
from stereocal.projects.project import CALIBRATED, FURTHER, INPUT, SETTING, VALUES, Project
from stereocal.projects.recording import PARTS, RECORDING, REPLACED, RIG_FILES, ProjectRecording
from stereocal.projects.server_settings import check_quota
from stereocal.rig.camera import CAMERAS
from stereocal.system.atomic_files import write_in_parts
from stereocal.system.json_text import read_json
from stereocal.system.zip_files import OpenZip, open_zip

MANIFEST_FORMAT = "stereocal-project/1"
BOARDS = tuple(f"boards_{which}" for which in CAMERAS)
APPLY = (POINT_FILES, TABLES, ASKING, SETS, APPLIED, WORLD, CHECK)
NAMED = {INPUT: "inputs", CALIBRATED: "calibrated", FURTHER: "datasets", BAR: "photographs"}
SAME = (*BOARDS, *APPLY, RECORDING, RIG_FILES, PARTS, REPLACED)
FOLDERS = NAMED | dict(zip(SAME, SAME, strict=True))
"""Where the files of each part are in the zip."""
RESULTS = {
    "calibration": "calibration.json",
    "evaluation": "evaluation.npz",
    "frames": "frames.json",
    "calibration_evaluation": "calibration_evaluation.npz",
    "recommended": "recommended.json",
    APPLIED: "applied.json",
    **{boards: f"{boards}.npz" for boards in BOARDS},
    **{f"lens_{which}": f"lens_{which}.npz" for which in CAMERAS},
}
OF_BAR = ("pairs", "found_by", "boards_found", "boards_doubtful")
PACKED = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".zip", ".npz", ".parquet", ".h5", ".mat")
UNSAFE = re.compile(r"[^A-Za-z0-9._-]|^\.+")


def pack_project(project: Project, target: Path, result: Mapping[str, bytes] | None = None) -> None:
    """Write a project with all its inputs and results as a zip, atomically.

    Args:
        result: the files of the last result by name, as for a paper's archive; None: none.
    """
    database = project.database
    with (
        write_in_parts(target) as waiting,
        zipfile.ZipFile(waiting, "w", zipfile.ZIP_DEFLATED, strict_timestamps=False) as archive,
        database.reading() as db,
    ):
        manifest: dict[str, Any] = {"format": MANIFEST_FORMAT, "values": {}, "files": []}
        pairs: dict[str, dict[str, Any]] = {}
        taken: set[str] = set()

        def place(scoped: str) -> tuple[str, dict[str, Any], str]:
            """Part, manifest and folder of what the project itself or a pair has."""
            scope, _, part = scoped.rpartition("/")
            if not scope:
                return part, manifest, ""
            named = {"name": scope.removeprefix(PAIR), "folder": f"pairs/{len(pairs) + 1}/"}
            own = pairs.setdefault(scope, {**named, "values": {}, "files": []})
            return part, own, own["folder"]

        for scoped, name, text in database.rows("SELECT part, name, json FROM value"):
            part, own, _ = place(scoped)
            own["values"].setdefault(part, {})[name] = json.loads(text)
        edits = database.rows("SELECT json FROM edit ORDER BY number")
        manifest["edits"] = [json.loads(text) for (text,) in edits]
        query = "SELECT part, name, sha256, about FROM named ORDER BY rowid"
        for scoped, name, sha256, text in database.rows(query):
            part, own, folder = place(scoped)
            about = json.loads(text)
            label = about["suffix"] if part == TABLES else about
            path = _unused(folder + FOLDERS[part], name, label, taken)
            own["files"].append({"part": part, "name": name, "about": about, "path": path})
            info = zipfile.ZipInfo(path)
            packed = path.lower().endswith(PACKED)
            info.compress_type = zipfile.ZIP_STORED if packed else zipfile.ZIP_DEFLATED
            with archive.open(info, "w", force_zip64=True) as file:
                file.writelines(StoredFile(sha256, database).pieces())
        for scoped, content in db.execute("SELECT kind, content FROM result"):  # one in memory
            kind, _, folder = place(scoped)
            archive.writestr(f"{folder}results/{RESULTS[kind]}", content)
        whole = manifest | ({"pairs": list(pairs.values())} if pairs else {})
        archive.writestr(MANIFEST, json.dumps(whole, indent=1))
        with suppress(StereocalError):  # damaged data are left out
            for name, content in _readable_files(project, result or {}).items():
                archive.writestr(name, content)


def _readable_files(project: Project, result: Mapping[str, bytes]) -> dict[str, bytes]:
    """The data set and the last result, in the formats of the command line.

    If the data have changed since, they do not give the result again: it has no `reproduce.json`.
    """
    dataset = project.dataset
    data = {} if dataset is None else pack_dataset(dataset)
    if any(result.get(name) != content for name, content in data.items()):
        result = {name: each for name, each in result.items() if name.startswith("parameters_")}
    return {**result, **data}


def _unused(folder: str, name: str, label: str, taken: set[str]) -> str:
    """A safe and unique path for a file, close to its name."""
    suffix = PurePosixPath(f"_{label}").suffix if "." not in name and label else ""
    plain = "/".join(UNSAFE.sub("_", each) or "_" for each in f"{name}{suffix}".split("/"))
    numbered = (f"{folder}/{number}_{plain}" for number in count(2))
    path = next(each for each in chain([f"{folder}/{plain}"], numbered) if each not in taken)
    taken.add(path)
    return path


def unpack_project(source: Path | bytes, name: str, home: Path) -> Project:
    """Import a zip of `pack_project` as a new project below `home`.

    Raises:
        StereocalError: not a zip, no project in it, or an invalid one; nothing is imported.
    """

    def fill(database: Store) -> None:
        with open_zip(source, name) as opened:
            check_quota(sum(map(opened.size, opened.names)))
            _fill(Project(database), opened, name)

    return Project(new_database(home, fill))


def _fill(project: Project, opened: OpenZip, source: str) -> None:
    manifest, database = _manifest(opened, source), project.database
    told = f"{MANIFEST} is damaged."
    with damaged(told, source=source, keep=True), database.transaction() as db:
        pairs = [(each, database.of_pair(each["name"])) for each in manifest.get("pairs", [])]
        for own, store in ((manifest, database), *pairs):
            for part, names in ((INPUT, VALUES), (BAR, OF_BAR), (SETTING, None)):
                values = dict(own["values"].get(part, {}))
                kept = {key: values[key] for key in (names or values) if key in values}
                store.keep_values(part, kept)
            for item in own["files"]:
                part, name, path = (str(item[key]) for key in ("part", "name", "path"))
                if part not in FOLDERS:
                    raise ValueError(part)
                stored = replace(_unpacked(opened, path, store), about=item["about"])
                store.name_files(part, {name: stored})
            for kind, file_name in RESULTS.items():
                path = f"{own.get('folder', '')}results/{file_name}"
                if path in opened.names:
                    store.keep_result(kind, opened.read(path))
            _ = Project(store).dataset
        edits = [(json.dumps(dict(edit)),) for edit in manifest["edits"]]
        db.executemany("INSERT INTO edit (json) VALUES (?)", edits)
        recording = ProjectRecording(project)
        _ = recording.read(), recording.rig


def _manifest(opened: OpenZip, source: str) -> dict[str, Any]:
    if MANIFEST not in opened.names:
        raise StereocalError("there is no stereocal project in this zip.", source)
    manifest = read_json(opened.read(MANIFEST), f"{source}: {MANIFEST}")
    found = manifest.get("format") if isinstance(manifest, dict) else None
    if found != MANIFEST_FORMAT:
        raise StereocalError(
            f"the project was written by another version of stereocal ({found}); update stereocal "
            "to open it.",
            source,
        )
    with damaged(f"{MANIFEST} is damaged.", source=source):
        # Neither NaN nor lone surrogates, which no page can show.
        json.dumps(manifest, ensure_ascii=False, allow_nan=False).encode()
    return dict(manifest)


def _unpacked(opened: OpenZip, member: str, store: Store) -> StoredFile:
    """A stored member; by a temporary file, so that a large one is not held in memory."""
    if member not in opened.names:
        raise StereocalError(f"{member} is not in the zip.")
    with tempfile.TemporaryDirectory(prefix="stereocal-") as folder:
        path = Path(folder) / "file"
        with path.open("wb") as file:
            file.writelines(opened.pieces(member))
        return store.keep_file(path, member)
