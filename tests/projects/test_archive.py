"""A project as one zip: it opens elsewhere with all it had, and no zip leads out of its folder."""

import json
from pathlib import Path

from stereocal.cli import main
from stereocal.formats.inputs import read_input
from stereocal.projects.archive import pack_project, unpack_project
from stereocal.system.names import LONGEST
from stereocal.system.zip_files import pack_zip, unzip
from tests.projects.test_project import FIELD, filled
from tests.refused import refused


def test_the_command_line_opens_it(tmp_path: Path) -> None:
    project = filled(tmp_path)
    path = tmp_path / "project.zip"
    pack_project(project, path)
    assert read_input(path).sha256 == read_input(FIELD).sha256
    with refused(project.database.path, "zip"):
        read_input(project.database.path)
    assert main(["calibrate", str(path), "--out", str(tmp_path / "out"), "--runs", "0"]) == 0
    assert (tmp_path / "out" / "parameters_3d.json").is_file()


def test_names_in_an_untrusted_zip_are_cut_at_the_door(tmp_path: Path) -> None:
    """The list of projects escaped one of 20,000 characters for 3.4 s at each look."""
    path, long = tmp_path / "p.zip", 20_000 * "w"
    pack_project(filled(tmp_path / "here"), path)
    files = unzip(path, path.name)
    manifest = json.loads(files["project.json"])
    manifest["values"]["input"]["name"] = long
    for item in manifest["files"]:
        item["about"] = long + ".csv"
    packed = pack_zip({**files, "project.json": json.dumps(manifest).encode()})
    there = unpack_project(packed, path.name, tmp_path / "there")
    cut = there.inputs.name, *there.inputs.labels.values()
    assert len(cut) == 4 and {*map(len, cut)} == {LONGEST} and cut[1].endswith(".csv")
    there.rename(long)
    there.give({"primary": (long, files["inputs/primary.json"])})
    assert len(there.inputs.name) == len(there.inputs.labels["primary"]) == LONGEST
    manifest["files"][0]["name"] = long
    packed = pack_zip({**files, "project.json": json.dumps(manifest).encode()})
    with refused("project.json", "20,000", "1,000"):
        unpack_project(packed, path.name, tmp_path / "there")
