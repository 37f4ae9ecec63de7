"""Photographs from folders, zips and uploads: found, stored under safe names, memory flat."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereocal.system.photograph import read_photograph
from stereocal.system.photograph_files import photographs_in, unpack_photographs


def png(seed: int, width: int = 40, height: int = 30) -> bytes:
    image = np.random.default_rng(seed).integers(0, 256, (height, width)).astype(np.uint8)
    return bytes(cv2.imencode(".png", image)[1])


def zipped(files: Mapping[str, bytes], kind: int = zipfile.ZIP_DEFLATED) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", kind) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return out.getvalue()


FILES = {
    "rig/cam0/1.png": png(1),
    "rig/cam1/1.PNG": png(2),
    "rig/notes.txt": b"windy",
    "__MACOSX/rig/cam0/._1.png": b"\0\5\x16\7",
    "rig/.hidden.png": b"x",
}
FOUND = ["rig/cam0/1.png", "rig/cam1/1.PNG"]


def test_folder(tmp_path: Path) -> None:
    for name, content in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    found = photographs_in(tmp_path, tmp_path / "unused")
    assert sorted(found) == FOUND
    assert found[FOUND[0]] == tmp_path / FOUND[0]
    assert not (tmp_path / "unused").exists()


def test_zip(tmp_path: Path) -> None:
    (tmp_path / "a.zip").write_bytes(zipped(FILES))
    seen = []
    found = photographs_in(tmp_path / "a.zip", tmp_path / "in", lambda *at: seen.append(at))
    assert sorted(found) == FOUND
    assert seen == [(1, 2), (2, 2)]
    assert found[FOUND[1]].read_bytes() == FILES[FOUND[1]]
    assert read_photograph(found[FOUND[0]]).shape == (30, 40)


@pytest.mark.parametrize(
    "name", ["../out.png", "/tmp/out.png", "C:\\out.png", "a/../../out.png", "nul.png", "x" * 300]
)
def test_no_path_of_a_zip_is_written_to(name: str, tmp_path: Path) -> None:
    name = name if name.endswith(".png") else name + ".png"
    content = zipped({name: png(1)}, zipfile.ZIP_STORED)
    found = unpack_photographs(content, "a.zip", tmp_path / "deep" / "in")
    assert all(path.parent == tmp_path / "deep" / "in" for path in found.values())
    assert len(found) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["deep"]
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["in"]
