"""A file of a project damaged, and what the pages then say."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

from tests.pages.stored_projects import FULL, go, placed, session, told

DAMAGES: Mapping[str, Callable[[Path], object]] = {
    "cut in half": lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]),
    "emptied": lambda path: path.write_bytes(b""),
    "other bytes": lambda path: path.write_bytes(b"\x93\x00{]\xff" * 40),
    "other JSON": lambda path: path.write_text(json.dumps({"format": _format(path), "x": [1]})),
    "gone": lambda path: path.unlink(),
}
SHOWN_BY = {
    "project.json": "data",
    "calibration.json": "calibrate",
    "evaluation.npz": "validate",
    "photographs": "data",
    "lens": "cameras",
    "apply": "apply",
    "inputs": "data",
}
"""The page that shows a file or the files of a folder."""
MADE_ANEW = ("evaluation.npz", "apply/result.json")
"""What is quick to compute is computed anew, without a word."""


def _format(path: Path) -> object:
    try:
        return json.loads(path.read_bytes())["format"]
    except (ValueError, KeyError, TypeError):
        return None


def files_of_full(home: Path) -> list[str]:
    """The files of the full project; of photographs and boards one each."""
    folder = placed(FULL, home).folder
    found: dict[str, str] = {}
    for path in sorted(folder.rglob("*")):
        place = path.relative_to(folder)
        if path.is_file():
            photographs = "files" in place.parts and path.suffix == ".jpg"
            found[str(place.parent if photographs else place)] = place.as_posix()
    return list(found.values())


def look_after(home: Path, file: str, damage: str, pages: list[str]) -> dict[str, tuple[str, str]]:
    """Damage a file and look at pages: of each, what it says in red and in all."""
    project = placed(FULL, home)
    path = project.folder / file
    DAMAGES[damage](path)
    app, said = session(project), {}
    for page in pages:
        go(go(app, "start"), page)
        assert not app.exception, (file, damage, page, app.exception)
        said[page] = told(app, "error", "warning"), told(app)
        assert said[page][1], (file, damage, page)
    return said
