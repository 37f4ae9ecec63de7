"""Zips, arrays and PNG made unsound inside, with right lists and checksums outside."""

from __future__ import annotations

import io
import re
import struct
import warnings
import zipfile
import zlib
from collections.abc import Sequence
from random import Random

from tests.soak.text import NAMES, cut, flip, whole_number
from tests.soak.trees import changed_json

# Zips, and arrays in them


def member(random: Random, content: bytes, other: bytes) -> bytes:
    """One file of a zip changed, renamed, doubled or taken out; the zip itself stays sound."""
    from tests.soak.mutations import mutated  # which knows this module

    files, others = _unzipped(content), _unzipped(other)
    if not files:
        return flip(random, content, other)
    at = random.randrange(len(files))
    name, data = files[at]
    act = random.randrange(8)
    if act == 0:
        del files[at]
    elif act == 1:
        files[at] = (str(random.choice(NAMES)), data)
    elif act == 2:
        files.append(
            (random.choice((name, str(random.choice(NAMES)), f"a/{name}", f"{name}/b")), data)
        )
    elif act == 3 and others:
        files[at] = (name, random.choice(others)[1])
    else:
        kind = kind_of(name)
        another = random.choice(others)[1] if others else b""
        files[at] = (name, mutated(kind, random, data, another))
    return _zipped(files, random)


def kind_of(name: str) -> str:
    """How a file is changed, by its name."""
    ending = name.rsplit(".", 1)[-1].lower()
    return {
        "json": "json",
        "csv": "text",
        "npy": "npy",
        "npz": "npz",
        "png": "png",
        "zip": "zip",
    }.get(ending, "json" if name.endswith(("-primary", "-secondary")) else "text")


def _unzipped(content: bytes) -> list[tuple[str, bytes]]:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            return [(item.filename, archive.read(item)) for item in archive.infolist()[:100]]
    except Exception:  # the mutations before have made it unsound
        return []


def _zipped(files: Sequence[tuple[str, bytes]], random: Random) -> bytes:
    packed = io.BytesIO()
    how = random.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))
    with warnings.catch_warnings(), zipfile.ZipFile(packed, "w", how) as archive:
        warnings.simplefilter("ignore")  # a name twice
        for name, data in files:
            archive.writestr(zipfile.ZipInfo(name.encode("utf-8", "replace").decode()), data, how)
    return packed.getvalue()


def npy(random: Random, content: bytes, other: bytes) -> bytes:
    """Another type or shape in the head of an array, or other numbers in it."""
    if content[:6] != b"\x93NUMPY" or len(content) < 12:
        return flip(random, content, other)
    (length,) = struct.unpack_from("<H", content, 8)
    head, data = content[10 : 10 + length], content[10 + length :]
    act = random.randrange(6)
    if act == 0:
        types = (
            b"'|O'",
            b"'<f8'",
            b"'>i4'",
            b"'<c16'",
            b"'|S7'",
            b"'<U3'",
            b"'<M8[s]'",
            b"'|b1'",
            b"'<i8'",
            b"[('a', '<f8')]",
            b"'|V8'",
            b"'<f2'",
        )
        head = re.sub(rb"'descr': '[^']*'", b"'descr': " + random.choice(types), head)
    elif act == 1:
        shapes = (
            b"()",
            b"(0,)",
            b"(1,)",
            b"(-1,)",
            b"(3, 0)",
            b"(100000000000,)",
            b"(2, 2, 2, 2)",
            b"(1000000, 1000000)",
            b"(9223372036854775807, 4)",
        )
        head = re.sub(rb"'shape': \([^)]*\)", b"'shape': " + random.choice(shapes), head)
    elif act == 2:
        head = head.replace(b"False", b"True")
    elif act == 3 and data[:1] == b"{":
        data = changed_json(random, data, b"{}")
        head = re.sub(rb"'shape': \([^)]*\)", b"'shape': (%d,)" % len(data), head)
    elif act == 4:
        special = random.choice((float("nan"), float("inf"), -1.0, 1e300, 0.0))
        data = struct.pack("<d", special) * (len(data) // 8) + data[len(data) // 8 * 8 :]
    else:
        data = flip(random, data, other)
    return content[:8] + struct.pack("<H", len(head)) + head + data


# PNG


def png(random: Random, content: bytes, other: bytes) -> bytes:
    """A chunk changed, doubled or taken out, with a right checksum all the same."""
    chunks = _chunks(content)
    if not chunks:
        return flip(random, content, other)
    at = 0 if random.random() < 0.4 else random.randrange(len(chunks))
    kind, data = chunks[at]
    act = random.randrange(6)
    if act == 0:
        del chunks[at]
    elif act == 1:
        chunks.insert(at, chunks[random.randrange(len(chunks))])
    elif act == 2:
        extra = (
            b"tRNS",
            b"PLTE",
            b"iCCP",
            b"zTXt",
            b"gAMA",
            b"sBIT",
            b"eXIf",
            b"acTL",
            b"fcTL",
            b"cHRM",
        )
        chunks.insert(1, (random.choice(extra), random.randbytes(random.choice((0, 1, 13, 300)))))
    elif act == 3 and kind == b"IDAT":
        data = zlib.compress(random.randbytes(random.choice((0, 10, 5000))))
        chunks[at] = (kind, data)
    else:
        chunks[at] = (kind, random.choice((flip, whole_number, cut))(random, data, other))
    return content[:8] + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )


def _chunks(content: bytes) -> list[tuple[bytes, bytes]]:
    found, at = [], 8
    while content[:4] == b"\x89PNG" and at + 12 <= len(content):
        (length,) = struct.unpack_from(">I", content, at)
        found.append((content[at + 4 : at + 8], content[at + 8 : at + 8 + length]))
        at += 12 + length
    return found
