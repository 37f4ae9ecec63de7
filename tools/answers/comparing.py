"""Compare two folders of kept answers, file by file."""

import io
import re
import zipfile
import zlib
from base64 import a85decode
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath

import cv2
import numpy as np
import pandas as pd
from scipy.io import loadmat

NUMBER = re.compile(r"((?:(?<![\w.])[-+])?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")
UNLIKE_ALWAYS = {
    r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(?::\d\d)?(?:\.\d+)?(?:Z|\+00:00| UTC)?": "when it was written",
    r'"(?:stereocal|python|numpy|scipy|numba|opencv)": "[^"]*"': "a version",
    r"(?:stereocal|Python|NumPy) \d+\.\d+[.\w]*|version = \{\{.*\}\}": "a version in prose",
    r"(?<=\d) +\d+\.\d{3}(?=  [a-z])": "the seconds of a method, before why it stopped",
    r": done in \d+ s": "progress, with its seconds",
    r"\b[\da-f]{8}(?:-[\da-f]{4}){3}-[\da-f]{12}\b": "the random name that plotly gives a figure",
    r"/Length \d+|^\d{10} \d{5} [nf] $|startxref\n\d+": "lengths of parts of a PDF",
}
"""What is not compared in a text, and what it is."""
_MASKED = re.compile("|".join(UNLIKE_ALWAYS), re.MULTILINE)


def _text(content: bytes) -> str:
    return content.decode("utf-8", errors="surrogateescape")


def _pdf(content: bytes) -> str:
    """With its compressed streams as text."""

    def inflated(found: re.Match[bytes]) -> bytes:
        packed = found[1].strip(b"\r\n")
        with suppress(ValueError, zlib.error):
            return zlib.decompress(a85decode(packed, adobe=False) if b"~>" in packed else packed)
        return packed

    return re.sub(rb"stream\r?\n(.*?)endstream", inflated, content, flags=re.DOTALL).decode(
        "latin1"
    )


def _parquet(content: bytes) -> str:
    return str(pd.read_parquet(io.BytesIO(content)).to_csv(index=False))


def _matlab(content: bytes) -> str:
    found = loadmat(io.BytesIO(content))  # type: ignore[arg-type]
    with np.printoptions(floatmode="unique", threshold=10**9):
        return "\n".join(f"{k}: {v}" for k, v in sorted(found.items())[3:])


def _pixels(content: bytes) -> str:
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return "\n".join(" ".join(map(str, row.ravel())) for row in image)


@dataclass(frozen=True)
class Kind:
    """How files of a kind are read, and how far their numbers may differ."""

    files: str
    read: Callable[[bytes], str]
    tolerance: float = 0.0
    """Times the number, or times 1 if that is larger."""
    reason: str = ""
    """Why the tolerance is not 0."""


KINDS = (
    Kind("*.pdf", _pdf),
    Kind("*.parquet", _parquet),
    Kind("*.mat", _matlab),
    Kind("*.png", _pixels),
    Kind("*.jpg", _pixels),
    Kind("*", _text),
)
"""The first that fits a file is its kind."""


def compare(old: Path, new: Path, only: Collection[str]) -> tuple[int, list[str]]:
    """The number of files compared, and a line for each file that differs and each lone case."""
    before, after = (dict(_files(folder, only)) for folder in (old, new))
    names = sorted({*before, *after})
    lines = []
    for name in names:
        one, other = before.get(name), after.get(name)
        if one is None or other is None:
            folder, lacking = (old, new) if other is None else (new, old)
            *case, _ = PurePosixPath(name).parts[: 3 if name.startswith("inputs/") else 2]
            if lacking.joinpath(*case).is_dir():
                lines.append(f"{name}: only in {folder}")
            elif len(case) == 1:  # which inputs there are depends on the cases
                lines.append(f"{case[0]}: only in {folder}")
        elif one != other:
            kind = next(kind for kind in KINDS if fnmatchcase(name, kind.files))
            found = difference(kind.read(one), kind.read(other), kind.tolerance)
            lines += [f"{name}: {found}"] if found else []
    return len(names), list(dict.fromkeys(lines))


def _files(folder: Path, only: Collection[str]) -> Iterator[tuple[str, bytes]]:
    """All files of the cases; instead of an archive, those in it."""
    for path in sorted(folder.glob("*/**/*")):
        name = path.relative_to(folder)
        wanted = not only or any(fnmatchcase(name.parts[0], pattern) for pattern in only)
        if wanted and path.is_file():
            yield from _opened(name.as_posix(), path.read_bytes())


def _opened(name: str, content: bytes) -> Iterator[tuple[str, bytes]]:
    if not name.endswith(".zip"):
        yield name, content
        return
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        for each in archive.namelist():
            yield from _opened(f"{name}/{each}", archive.read(each))


def difference(old: str, new: str, tolerance: float) -> str | None:
    """What differs first in the words of two texts, and most in their numbers; None if nothing."""
    texts = [_MASKED.sub("", text).split("\n") for text in (old, new)]
    found = []
    if len(texts[0]) != len(texts[1]):
        found.append(f"{len(texts[1])} lines, not {len(texts[0])}")
    numbers: list[tuple[float, float, str]] = []
    for at, (one, other) in enumerate(zip(*texts, strict=False), start=1):
        if one == other:
            continue
        parts, others = NUMBER.split(one), NUMBER.split(other)
        if parts[::2] != others[::2]:
            ends = (k for k, (a, b) in enumerate(zip(one, other, strict=False)) if a != b)
            same = next(ends, min(len(one), len(other)))
            found.append(f"line {at}: {_short(one, same)} is now {_short(other, same)}")
            continue
        for k in range(1, len(parts), 2):
            if parts[k] != others[k]:
                a, b = float(parts[k]), float(others[k])
                apart, place = abs(b - a), f"line {at}, after {parts[k - 1][-40:]!r}"
                relative = apart / max(abs(a), abs(b), 1e-300)
                about = f"{parts[k]} is now {others[k]} ({place})"
                numbers.append((apart / max(1.0, abs(a)), relative, about))
    # Without a tolerance 1.0 is not 1.00 either.
    numbers = [each for each in numbers if each[0] > tolerance or not tolerance]
    found = found[:2]
    if numbers:
        most, relatively = max(numbers), max(numbers, key=lambda each: each[1])
        found.append(f"{len(numbers)} numbers, most by {most[0]:.2g}: {most[2]}")
        if relatively != most:
            found.append(f"relatively most by {relatively[1]:.2g}: {relatively[2]}")
    return "; ".join(found) or None


def _short(line: str, from_: int) -> str:
    return repr(line[max(0, from_ - 20) : from_ + 40])
