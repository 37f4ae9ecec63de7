"""Files of a project that nothing names any more, as photographs that were removed.

Files are named by their content and are never changed, so what no list names is free to go. It
goes at once where somebody removes it (`forget_files`), and else when the server sweeps
(`free_unused`). As long as a job runs or waits to be resumed, nothing goes: it may need it.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from stereocal.errors import DAMAGED, StereocalError
from stereocal.store.folders import UNCHANGING
from stereocal.store.jobs import JOBS, find
from stereocal.store.state import PROJECT_FILE, changing

LIST = "photographs.json"
OURS = "/1"
"""How the formats of all lists end; of another version nobody knows what a list names."""
NAMING = {
    "inputs": ("project.json", "calibration.json"),
    "photographs/files": ("photographs/photographs.json",),
    "lens/primary/files": ("lens/primary/photographs.json",),
    "lens/secondary/files": ("lens/secondary/photographs.json",),
    "apply/files": ("apply/apply.json", "apply/result.json"),
}
"""Folders of files, and the lists that name those that are needed."""


def free_unused(project: Path, before: float) -> int:
    """Delete the files that no list names and that were stored before this time.

    Where a list cannot be read, nobody knows what it names, and all of its files stay.

    Args:
        before: seconds since 1970: what is being stored is named only when all of it is there.

    Returns:
        How many bytes were freed.
    """
    freed = 0
    with suppress(StereocalError, OSError), changing(project):
        if not is_busy(project):
            for path in _unused(project):
                if path.stat().st_mtime < before:
                    freed += path.stat().st_size
                    path.unlink()
    return freed


def forget_files(project: Path, files: Collection[Path]) -> None:
    """Delete files that a person has just removed, if nothing else names them.

    What cannot be deleted stays for the sweep.
    """
    with suppress(StereocalError, OSError), changing(project):
        if not is_busy(project):
            for path in set(files) & set(_unused(project)):
                path.unlink(missing_ok=True)


def is_busy(project: Path) -> bool:
    """Whether a job runs, or was interrupted and can be resumed."""
    kinds = [path.parent.name for path in (project / JOBS).glob("*/job.json")]
    found = [find(project, kind) for kind in kinds]
    return any(one is not None and one[0] != "failed" for one in found)


def _unused(project: Path) -> Iterator[Path]:
    try:
        tuple(_names(project / PROJECT_FILE))
    except DAMAGED:  # or of a newer version, whose lists may name files elsewhere
        return
    for folder, lists in NAMING.items():
        try:
            needed = {name for each in lists for name in _names(project / each)}
        except DAMAGED:
            continue
        assert Path(folder).name in UNCHANGING
        if (project / folder).is_dir():
            for path in (project / folder).iterdir():
                if path.name not in needed and not path.name.startswith(".") and path.is_file():
                    yield path


def _names(path: Path) -> Iterator[str]:
    """Every text in a JSON file: a file's name is one of them."""
    try:
        content = json.loads(path.read_bytes())
    except FileNotFoundError:
        if path.name == LIST:  # it was lost, or the first upload is under way
            raise
        return
    if not isinstance(content, dict):
        raise TypeError(path)
    if not str(content.get("format", OURS)).endswith(OURS):
        raise ValueError(path)
    yield from _texts(content)


def _texts(content: Any) -> Iterator[str]:
    if isinstance(content, str):
        yield content
    elif isinstance(content, dict):
        for item in content.values():
            yield from _texts(item)
    elif isinstance(content, list):
        for item in content:
            yield from _texts(item)
