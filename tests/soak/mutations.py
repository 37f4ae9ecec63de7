"""Sound files made unsound, as accident and malice do: the same random numbers, the same file."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

from tests.soak.packed import member, npy, png
from tests.soak.text import (
    LARGEST,
    cut,
    cut_out,
    deep,
    encoding,
    endings,
    flip,
    insert,
    long_run,
    moved_lines,
    other_number,
    other_numbers,
    other_word,
    quote,
    repeat,
    separators,
    splice,
    token,
    whole_number,
)
from tests.soak.trees import changed_json, dumped, random_tree

HEADS = (b"", b"", b"%YAML:1.0\n---\n", b'<?xml version="1.0"?>\n<opencv_storage>\n')
MAGIC = (
    b"",
    b"\x89PNG\r\n\x1a\n",
    b"\xff\xd8\xff",
    b"II*\0\x08\0\0\0",
    b"MM\0*\0\0\0\x08",
    b"BM",
    b"P5 ",
    b"P2 ",
    b"P6\n",
    b"PK\x03\x04",
    b"PK\x05\x06",
    b"PAR1",
    b"II+\0",
)
"""How photographs, zips and Parquet begin."""
Mutation = Callable[[Random, bytes, bytes], bytes]


def mutated(kind: str, random: Random, seed: bytes, other: bytes) -> bytes:
    """A sound file with one to four things wrong; `other` is one to splice with."""
    content = seed
    for _ in range(random.choice((1, 1, 1, 2, 2, 4))):
        mutation = random.choice((*BY_KIND[kind], *BY_KIND[kind], *_ANY))
        content = mutation(random, content, other)[:LARGEST]
    return content


def from_nothing(kind: str, random: Random) -> bytes:
    """A file that was never sound."""
    if kind in ("json", "npz", "project") or random.random() < 0.2:
        return dumped(random_tree(random, 0), random)
    if kind in ("text", "yaml", "xml") or random.random() < 0.2:
        lines = [
            b",".join(token(random) for _ in range(random.randrange(6)))
            for _ in range(random.randrange(12))
        ]
        return random.choice(HEADS) + random.choice((b"\n", b"\r\n", b"\r")).join(lines)
    return random.choice(MAGIC) + random.randbytes(random.choice((0, 3, 20, 100, 3000)))


_ANY: tuple[Mutation, ...] = (
    flip,
    cut,
    cut_out,
    insert,
    repeat,
    splice,
    long_run,
)
_TEXT: tuple[Mutation, ...] = (
    other_number,
    other_number,
    other_numbers,
    other_word,
    other_word,
    moved_lines,
    moved_lines,
    endings,
    separators,
    encoding,
    deep,
    quote,
)
BY_KIND: dict[str, tuple[Mutation, ...]] = {
    "text": _TEXT,
    "yaml": (*_TEXT, deep),
    "xml": (*_TEXT, deep),
    "json": (changed_json, changed_json, changed_json, changed_json, *_TEXT),
    "image": (flip, whole_number, whole_number, insert, cut),
    "png": (png, png, png, whole_number),
    "parquet": (flip, whole_number, whole_number),
    "npy": (npy, npy, whole_number),
    "npz": (member, member, member, whole_number),
    "zip": (member, member, member, whole_number),
}
