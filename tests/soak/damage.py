"""Sound files made unsound, as accident and malice do."""

import io
import json
import re
import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable, Sequence
from typing import Any

from hypothesis import strategies as st

from tests.files import chunks_of, png_of

Draw = Callable[[st.SearchStrategy[Any]], Any]
Change = Callable[[Draw, bytes, bytes], Any]
"""Bytes, of what is drawn."""
LARGEST = 400_000
"""Bytes; what grows by repetition ends here."""

WRITTEN = """
nan NaN inf -Infinity 1e999 1e308 -1e308 1e-320 -0 0 -1 0.5 9007199254740993 4294967296 65536
-9223372036854775809 0x10 1_000 1,5 ٣ ½ 1e --1 null true None 1+2j 2026-01-01 ~ 1:30 *x &x
. .. ../../etc/passwd /etc/passwd C:\\a con <script> **bold** $x$ '; :red[x] 日本 \u202egnp.exe
__proto__ primary.json project.json K R T frames pairs files
, ; " ' [ ] { } ( ) : - # % & * ? !! < > </ <!-- <![CDATA[ --- ... \\ \\u0000 !!opencv-matrix
"""
WORDS = [*WRITTEN.split(), "", *" \t\r\0\ud800\ufeff\x85\u2028"]
WORDS += ["1" + "0" * 400, "9" * 5000, "é" * 300, "0" * 32]
"""Numbers, names and signs that readers stumble over."""
HEADS = [b"%YAML:1.0\n---\n", b'<?xml version="1.0"?>\n', b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"]
HEADS += [b"II*\0\x08\0\0\0", b"BM", b"P5 ", b"PK\x03\x04", b"PAR1", b"\x89HDF\r\n\x1a\n"]
BYTES = [b"\xff", b"\xfe\xff", b"\xef\xbb\xbf", b"- ", b"a: ", b"<a>", b"x,1\n", b"a=[\n"]
BYTES += [word.encode("utf-8", "surrogatepass") for word in WORDS]
PIECES = st.sampled_from(BYTES) | st.binary(max_size=100)
ODD: list[Any] = [None, True, False, 0, -1, 1, 2, 2**31, 2**53 + 1, 2**64, 10**400, [], {}, [[]]]
VALUES: st.SearchStrategy[Any] = st.sampled_from(ODD) | st.floats() | st.sampled_from(WORDS)
TREES = st.recursive(
    VALUES,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(WORDS), inner, max_size=4)
    ),
    max_leaves=8,
)
NPY_TYPES = ("|O", "<f8", ">i4", "<c16", "|S7", "<U3", "<M8[s]", "|b1", "<i8", "|V8", "<f2")
NPY_SHAPES = ("()", "(0,)", "(-1,)", "(3, 0)", "(100000000000,)", "(1000000, 1000000)")
NESTED = [each.split(b"1") for each in (b"[1]", b'{"a":1}', b"<a>1</a>", b"- 1", b"(1)", b"? 1")]


@st.composite
def damaged(draw: Draw, kind: str, sound: Sequence[bytes]) -> bytes:
    """A sound file with one to three things wrong, which may be taken from another."""
    content, other = draw(st.sampled_from(sound)), draw(st.sampled_from(sound))
    for _ in range(draw(st.integers(1, 3))):
        content = draw(st.sampled_from(CHANGES[kind]))(draw, content, other)[:LARGEST]
    return bytes(content)


def never_sound() -> st.SearchStrategy[bytes]:
    """Bytes, texts, trees, and files that only begin like one that a program writes."""
    noise = st.binary(max_size=2000)
    lines = st.lists(st.lists(PIECES, max_size=6).map(b",".join), max_size=12).map(b"\n".join)
    begun = st.tuples(st.sampled_from(HEADS), noise).map(b"".join)
    return noise | lines | begun | TREES.map(dumped)


def dumped(tree: object) -> bytes:
    """As JSON, whatever its texts hold."""
    return json.dumps(tree, ensure_ascii=False).encode("utf-8", "surrogatepass")


def _place(draw: Draw, content: bytes) -> int:
    """Anywhere, but half of the time where heads and lists of contents are."""
    end = len(content)
    near = st.integers(0, min(end, 200))
    return int(draw(near | near.map(lambda at: end - at) | st.integers(0, end)))


def _flip(draw: Draw, content: bytes, _: bytes) -> Any:
    changed = bytearray(content)
    for _each in range(draw(st.sampled_from((1, 2, 8, 64))) if changed else 0):
        changed[min(_place(draw, content), len(content) - 1)] ^= 1 << draw(st.integers(0, 7))
    return bytes(changed)


def _piece(draw: Draw, content: bytes, other: bytes) -> Any:
    """A piece cut out, doubled, of another file, or put in so often that who looks once for each
    does not come to an end."""
    start = _place(draw, content)
    end = start + draw(st.sampled_from((0, 1, 4, 50, 1000, LARGEST)))
    new = draw(PIECES | st.just(content[start:end]) | st.just(other[_place(draw, other) :]))
    many = draw(st.sampled_from((0, 1, 1, 2, 60, LARGEST // 2 // (1 + len(new)))))
    return content[:start] + new * many + content[draw(st.sampled_from((start, end))) :]


def _whole_number(draw: Draw, content: bytes, _: bytes) -> Any:
    """A length, an offset or a count with an extreme value."""
    form = draw(st.sampled_from(("<H", ">H", "<I", ">I", "<Q", ">Q", "B")))
    most = 256 ** struct.calcsize(form) - 1
    value = draw(st.sampled_from((0, 1, 2, most, most // 2)) | st.integers(0, most))
    start = _place(draw, content)
    return content[:start] + struct.pack(form, value) + content[start + struct.calcsize(form) :]


def _token(draw: Draw, content: bytes, other: bytes) -> Any:
    """One number, word or separator replaced, or all of them."""
    pattern = draw(st.sampled_from((rb"[-+]?\d[\d.eE+-]*", rb"[A-Za-z_]\w*", rb"[\n, ]")))
    found = list(re.finditer(pattern, content[:20_000]))
    new = draw(PIECES | st.sampled_from(re.findall(pattern, other)[:50] or [b""]))
    if not found:
        return content + new
    if draw(st.integers(0, 9)) == 0:
        return re.sub(pattern, lambda _: new, content, count=1 + LARGEST // (1 + len(new)))
    match = draw(st.sampled_from(found))
    return content[: match.start()] + new + content[match.end() :]


def _lines(draw: Draw, content: bytes, other: bytes) -> Any:
    """Lines lost, doubled, moved, lengthened."""
    lines = content.split(b"\n")
    at = draw(st.integers(0, len(lines) - 1))
    new = draw(st.sampled_from((lines[0], lines[at] * 2, *other.split(b"\n")[:20])))
    lines[at : at + draw(st.integers(0, 2))] = [new] * draw(st.sampled_from((0, 1, 2, 1000)))
    return b"\n".join(lines)


def _encoding(draw: Draw, content: bytes, _: bytes) -> Any:
    codec = draw(st.sampled_from(("utf-16", "utf-32", "utf-8-sig", "utf-7")))
    return content.decode("utf-8", "replace").encode(codec)


def _deep(draw: Draw, content: bytes, _: bytes) -> Any:
    opening, closing = draw(st.sampled_from(NESTED))
    depth, start = draw(st.sampled_from((3, 60, 1010, 100_000))), _place(draw, content)
    return content[:start] + opening * depth + b"1" + closing * depth + content[start:]


def _tree(draw: Draw, content: bytes, other: bytes) -> Any:
    """JSON with another value, key or kind at some depth."""
    try:
        tree = json.loads(content)
    except (ValueError, RecursionError):
        return _token(draw, content, other)
    return dumped(_changed(draw, tree))


def _changed(draw: Draw, tree: Any) -> Any:
    if not (isinstance(tree, dict | list) and tree) or draw(st.integers(0, 7)) == 0:
        return draw(TREES | st.just([tree]) | st.just([tree] * 300))
    grown: Any = tree.copy()
    key = draw(st.sampled_from(list(tree) if isinstance(tree, dict) else range(len(tree))))
    act = draw(st.integers(0, 5))
    if act == 0:
        del grown[key]
    elif act == 1 and isinstance(grown, dict):
        grown[draw(st.sampled_from(WORDS))] = grown.pop(key)
    elif act == 1:
        grown.insert(key, draw(TREES))
    else:
        grown[key] = _changed(draw, tree[key])
    return grown


def _member(draw: Draw, content: bytes, other: bytes) -> Any:
    """One file of a zip changed, renamed, doubled or taken out; the zip itself stays sound."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            files = [(item.filename, archive.read(item)) for item in archive.infolist()[:100]]
    except Exception:  # the changes before have made it unsound
        return _flip(draw, content, other)
    if not files:
        return _flip(draw, content, other)
    at = draw(st.integers(0, len(files) - 1))
    name, data = files[at]
    act, named = draw(st.integers(0, 6)), draw(st.sampled_from((name, f"a/{name}", *WORDS)))
    if act == 0:
        del files[at]
    elif act == 1:
        files[at] = (named, data)
    elif act == 2:
        files.append((named, data))
    else:
        ending = name.rsplit(".", 1)[-1].lower()
        kind = {"csv": "text", "m": "text"}.get(ending, ending if ending in CHANGES else "json")
        files[at] = (name, draw(damaged(kind, [data])))
    packed = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(packed, "w") as archive:
        warnings.simplefilter("ignore")  # a name twice
        for name, data in files:
            archive.writestr(zipfile.ZipInfo(name.encode("utf-8", "replace").decode()), data)
    return packed.getvalue()


def _npy(draw: Draw, content: bytes, other: bytes) -> Any:
    """Another type or shape in the head of an array."""
    if content[:6] != b"\x93NUMPY" or len(content) < 12:
        return _flip(draw, content, other)
    (length,) = struct.unpack_from("<H", content, 8)
    old, new = draw(
        st.sampled_from(NPY_TYPES).map(lambda kind: (rb"'descr': '[^']*'", f"'descr': '{kind}'"))
        | st.sampled_from(NPY_SHAPES).map(lambda of: (rb"'shape': \([^)]*\)", f"'shape': {of}"))
    )
    head = re.sub(old, new.encode(), content[10 : 10 + length])
    return content[:8] + struct.pack("<H", len(head)) + head + content[10 + length :]


def _png(draw: Draw, content: bytes, other: bytes) -> Any:
    """A chunk changed, doubled or taken out, with a right checksum all the same."""
    chunks = chunks_of(content)
    if not chunks:
        return _flip(draw, content, other)
    at = draw(st.integers(0, len(chunks) - 1))
    kind, data = chunks[at]
    kinds = st.sampled_from([kind, b"tRNS", b"PLTE", b"iCCP", b"zTXt", b"gAMA", b"eXIf", b"acTL"])
    data = draw(st.sampled_from((_flip, _whole_number, _piece)))(draw, data, other)
    data = draw(st.sampled_from((data, zlib.compress(data * 50))))
    chunks[at : at + draw(st.integers(0, 1))] = [(draw(kinds), data)] * draw(st.integers(0, 2))
    return png_of(chunks)


ANY: tuple[Change, ...] = (_flip, *[_piece] * 4)
TEXT: tuple[Change, ...] = (*[_token] * 3, _lines, _encoding, _deep, *ANY)
CHANGES: dict[str, tuple[Change, ...]] = {
    "text": TEXT,
    "json": (*[_tree] * 6, *TEXT),
    "image": (*[_whole_number] * 3, *ANY),
    "png": (*[_png] * 6, _whole_number, *ANY),
    "npy": (*[_npy] * 4, _whole_number, *ANY),
    "npz": (*[_member] * 6, _whole_number, *ANY),
    "zip": (*[_member] * 6, _whole_number, *ANY),
}
"""By kind of file, as often as they are drawn."""
