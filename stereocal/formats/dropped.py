"""Files that are given together, sorted by what each is; those in a zip as if they lay in a folder.

dropped = sort_files(contents, keep)      # keep(name, content) stores a photograph
dropped.photographs, dropped.of("camera"), dropped.problems
"""

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Generic, TypeVar

from stereocal.errors import StereocalError
from stereocal.formats.dataset_description import DESCRIPTION
from stereocal.formats.recognition import Kind, recognise
from stereocal.frames.which_camera import which_camera
from stereocal.rig.camera import CAMERAS
from stereocal.system.limits import Limits
from stereocal.system.numbers import plural
from stereocal.system.photograph import photograph_size
from stereocal.system.photograph_files import is_hidden
from stereocal.system.zip_files import open_zip

F = TypeVar("F")
FileContents = Iterable[tuple[str, bytes]]
"""Files, name and content, read one at a time."""
AGAIN = "other"
"""Folder of files whose names have been given already, with other contents."""
CAMERA_KINDS: tuple[Kind, ...] = ("camera", "cameras", "rig")


@dataclass(eq=False)
class Dropped(Generic[F]):
    """What was given, by kind."""

    photographs: dict[str, F] = field(default_factory=dict)
    sizes: dict[str, tuple[int, int]] = field(default_factory=dict)
    """Sizes of the photographs, in pixels."""
    files: dict[str, bytes] = field(default_factory=dict)
    """The contents of all others that can be used, with their folders."""
    kinds: dict[str, Kind] = field(default_factory=dict)
    source: str = ""
    """The name of the only file that was given, for messages; else words."""
    problems: list[str] = field(default_factory=list)
    """A sentence for each file that nobody can use, and for each photograph of another size."""

    def of(self, kind: Kind) -> dict[str, bytes]:
        """The files of a kind, without their folders where the names stay different."""
        chosen = {name: self.files[name] for name in self.kinds if self.kinds[name] == kind}
        short = {PurePosixPath(name).name: content for name, content in chosen.items()}
        return short if len(short) == len(chosen) else chosen

    def use(self, act: Callable[[], object]) -> None:
        """Use what was given; a refusal is one of the problems."""
        try:
            act()
        except StereocalError as error:
            self.problems.append(str(error))

    @property
    def in_words(self) -> str:
        """What was taken: `50 photographs, 2 camera files`; empty if nothing."""
        kinds = [*self.kinds.values()]
        counts = {
            "photograph": len(self.photographs),
            "video": kinds.count("video"),
            "camera file": sum(map(kinds.count, CAMERA_KINDS)),
            "table": kinds.count("table"),
            "data set": kinds.count("data set"),
        }
        return ", ".join(f"{n} {plural(n, what)}" for what, n in counts.items() if n)


def sort_files(
    contents: FileContents, keep: Callable[[str, bytes], F], tables: tuple[str, ...] = ()
) -> Dropped[F]:
    """Sort files by what they are.

    Args:
        keep: stores a photograph, of which one at a time is in memory.
        tables: endings of further files that are tables.
    """
    dropped, digests = Dropped[F](), dict[str, bytes]()
    for name, content in contents:
        digest = hashlib.sha256(content).digest()
        if digests.setdefault(name, digest) != digest:
            # Of the other camera, whose files have the same names.
            name = f"{AGAIN}/{name}"
        dropped.source = "the files" if dropped.source else name
        if tables and name.lower().endswith(tables):
            dropped.kinds[name], dropped.files[name] = "table", content
        elif not is_hidden(name):
            _sort(dropped, name.replace("\\", "/"), content, keep, in_zip=False)
    dropped.problems += differing_sizes(dropped.sizes)
    return dropped


def _sort(
    dropped: Dropped[F], name: str, content: bytes, keep: Callable[[str, bytes], F], in_zip: bool
) -> None:
    try:
        recognised = recognise(name, content)
        if recognised.kind is None:
            raise StereocalError(recognised.problem, name)
        if recognised.kind == "photograph":
            dropped.sizes[name] = photograph_size(content, name)
            dropped.photographs[name] = keep(name, content)
        elif recognised.kind != "zip":
            dropped.kinds[name], dropped.files[name] = recognised.kind, content
        elif in_zip:
            raise StereocalError("a zip inside a zip: unpack it, and give its files.", name)
        else:
            for member, inside in _unpacked(name, content):
                _sort(dropped, member, inside, keep, in_zip=True)
                size = sum(map(len, dropped.files.values()))
                Limits.from_environment().check_size(size, f"{name}: the files inside, together")
    except StereocalError as error:
        dropped.problems.append(str(error))


def _unpacked(name: str, content: bytes) -> Iterator[tuple[str, bytes]]:
    """The files of a zip; those of a flat one as in a folder with its name, which may tell the
    camera."""
    with open_zip(content, name) as opened:
        names = [member for member in opened.names if not is_hidden(member)]
        flat = not any("/" in member for member in names) and DESCRIPTION not in names
        folder = f"{PurePosixPath(name).stem}/" if flat else ""
        for member in names:
            yield folder + member.replace("\\", "/"), opened.read(member)


def differing_sizes(sizes: Mapping[str, tuple[int, int]]) -> list[str]:
    """Sentences on photographs that are not as large as the others of their camera."""
    sides = which_camera(sizes)
    lots = [[name for name in sides.known if sides.known[name] == side] for side in CAMERAS]
    lots += [[*series.names] for series in sides.open]
    sentences = []
    for lot in lots:
        side_sizes = [sizes[name] for name in lot]
        usual = max(side_sizes, key=side_sizes.count, default=None)
        if usual is None or 2 * side_sizes.count(usual) <= len(side_sizes):
            continue
        for name in (name for name in lot if sizes[name] != usual):
            width, height = sizes[name]
            how = (
                "without being turned" if (height, width) == usual else "in the size of the others"
            )
            sentences.append(
                f"{name}: it has {width}x{height} px, the other photographs of its camera "
                f"{usual[0]}x{usual[1]} px: give it {how}, or leave its frame out."
            )
    return sentences
