"""A project as one zip, which opens on another computer and on the command line."""

from __future__ import annotations

import re
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from stereocal.errors import StereocalError
from stereocal.formats.dataset_files import read_dataset
from stereocal.formats.lens_model import LensModel
from stereocal.project import Project
from stereocal.rig.dataset import Dataset
from stereocal.store.folders import UNCHANGING, new_project_folder
from stereocal.store.jobs import JOBS
from stereocal.store.room import check_whole
from stereocal.store.state import PROJECT_FILE, changing
from stereocal.system.atomic_files import write_in_parts
from stereocal.system.zip_files import OpenZip, open_zip

MADE_AGAIN = ("thumbnails", JOBS)
"""Folders whose files are made again when they are needed, or belong to the server's work."""
PLAIN = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,99}")
"""What the parts of a path in a project are made of: nothing that leads out of it."""
DEEPEST = 4


def pack_project(project: Project, target: Path) -> None:
    """Write a project with all its inputs and results as a zip.

    Photographs are packed already and are stored as they are. The file appears whole or not at all.

    Raises:
        StereocalError: the file cannot be written, or the project's folder not be read.
    """
    with (
        write_in_parts(target) as waiting,
        zipfile.ZipFile(waiting, "w", strict_timestamps=False) as archive,
    ):
        later = []
        with _still(project.folder):
            for path in sorted(project.folder.rglob("*")):
                place = path.relative_to(project.folder)
                if path.is_file() and _belongs(place):
                    if path.parent.name in UNCHANGING:
                        later.append((path, place))
                    else:
                        _pack(archive, path, place)
        for path, place in later:
            _pack(archive, path, place)


def _pack(archive: zipfile.ZipFile, path: Path, place: Path) -> None:
    packed = "files" in place.parts or path.suffix in (".npz", ".zip")
    how = zipfile.ZIP_STORED if packed else zipfile.ZIP_DEFLATED
    archive.write(path, place.as_posix(), how)


@contextmanager
def _still(folder: Path) -> Iterator[None]:
    """Nobody changes the project inside; where nothing can be written, nobody does anyway."""
    with ExitStack() as stack:
        with suppress(StereocalError):
            stack.enter_context(changing(folder))
        yield


def unpack_project(
    source: Path | bytes, name: str, home: Path, look_through: Callable[[Path], None] | None = None
) -> Project:
    """The project of such a zip, under a new id below `home`.

    Args:
        look_through: called with the unpacked folder before anything in it is read; what it raises
            refuses the project.

    Raises:
        StereocalError: not a zip, no project in it, or one that cannot be opened; nothing is left.
    """

    def fill(folder: Path) -> None:
        with open_zip(source, name) as opened:
            check_whole(sum(map(opened.size, opened.names)))
            _unpack(opened, name, folder)
        if look_through is not None:
            look_through(folder)
        project = Project(folder)
        project.dataset_of(project.inputs)

    return Project(new_project_folder(home, fill))


def read_input(path: Path, lens_model: LensModel | None = None) -> Dataset:
    """The data set of a folder or zip: one with `dataset.json`, or a project.

    Args:
        lens_model: as for `read_dataset`; in a project, a person has said it.

    Raises:
        StereocalError: neither, or one that cannot be used; says what to do.
    """
    if path.is_dir() and (path / PROJECT_FILE).is_file():
        return _complete(Project(path), path.name)
    if path.is_file() and zipfile.is_zipfile(path):
        with open_zip(path, path.name) as opened:
            holds_project = PROJECT_FILE in opened.names
        if holds_project:
            with tempfile.TemporaryDirectory() as home:
                return _complete(unpack_project(path, path.name, Path(home)), path.name)
    return read_dataset(path, lens_model)


def _complete(project: Project, name: str) -> Dataset:
    inputs = project.inputs
    dataset = project.dataset_of(inputs)
    if dataset is None:
        raise StereocalError(
            f"{name}: the project has not everything yet; missing: {', '.join(inputs.missing)}."
        )
    return dataset


def _unpack(opened: OpenZip, name: str, folder: Path) -> None:
    """Write the files of a zip below a folder, each under a name that cannot lead out of it."""
    if PROJECT_FILE not in opened.names:
        raise StereocalError(f"{name}: there is no stereocal project in this zip.")
    for member in opened.names:
        place = Path(member)
        if not _belongs(place) or "\\" in member:
            raise StereocalError(f"{name}: {member!r} is no file of a project.")
        target = folder / place
        target.parent.mkdir(parents=True, exist_ok=True)
        with target.open("wb") as file:
            for piece in opened.pieces(member):
                file.write(piece)


def _belongs(place: Path) -> bool:
    """Whether a path within a project is one that a project has, and that is worth carrying."""
    return (
        not place.is_absolute()
        and len(place.parts) <= DEEPEST
        and all(PLAIN.fullmatch(part) for part in place.parts)
        and not set(place.parts) & set(MADE_AGAIN)
    )
