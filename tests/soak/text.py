"""Bytes and texts made unsound: flipped, cut, spliced, other numbers, other signs, deep nests."""

from __future__ import annotations

import re
import struct
from random import Random
from typing import Any

NUMBERS = (
    "nan",
    "NaN",
    "inf",
    "-inf",
    "Infinity",
    "-Infinity",
    "1e999",
    "-1e999",
    "1e308",
    "1e-320",
    "-0",
    "0",
    "-1",
    "1",
    "0.5",
    "9007199254740993",
    "9223372036854775808",
    "-9223372036854775809",
    "4294967296",
    "2147483648",
    "65536",
    "1" + "0" * 400,
    "9" * 5000,
    "0x10",
    "1_000",
    "1,5",
    "",
    " ",
    "٣",
    "½",
    "1e",
    "--1",
    "null",
    "true",
    "None",
    "1+2j",
    "a",
    '"',
    "'",
    "<b>",
    "[1]",
    "{}",
    "2026-01-01",
    "~",
    "1:30",
    "*x",
    "&x 1",
)
NAMES = (
    "",
    ".",
    "..",
    "../../etc/passwd",
    "/etc/passwd",
    "C:\\a",
    "a\x00b",
    "con",
    "\u202egnp.exe",
    "\ud800",
    "<script>alert(1)</script>",
    "**bold**",
    "$x$",
    "é" * 300,
    "a" * 5000,
    "a\nb",
    "'; drop",
    ":red[x]",
    "日本",
    "\ufeff",
    "-",
    "0" * 32,
    "__proto__",
    "primary.json",
    "project.json",
)
VALUES: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    -0.0,
    -1,
    1,
    2,
    0.5,
    1e308,
    -1e308,
    5e-324,
    1e-9,
    2**31,
    2**53 + 1,
    2**63,
    2**64,
    10**400,
    float("nan"),
    float("inf"),
    float("-inf"),
    [],
    {},
    [[]],
    [[], []],
    [None],
    {"a": 1},
    [1, 2, 3],
    ["1", "2"],
    [[1, 2], [3]],
    "1",
    "nan",
    *NAMES,
)
SIGNS = (
    b"\x00",
    b"\xff",
    b"\xfe\xff",
    b"\xef\xbb\xbf",
    b"\r",
    b"\n",
    b"\r\n",
    b"\t",
    b",",
    b";",
    b'"',
    b"'",
    b"[",
    b"]",
    b"{",
    b"}",
    b":",
    b"-",
    b"#",
    b"%",
    b"&",
    b"*",
    b"!!",
    b"<",
    b">",
    b"</",
    b"<!--",
    b"<![CDATA[",
    b'<!ENTITY a "b">',
    b"\xc3",
    b"\xed\xa0\x80",
    b"\xe2\x80\xae",
    b"---\n",
    b"...\n",
    b"\\",
    b"\\u0000",
    b"!!python/object/apply:os.system [id]\n",
    b"!!opencv-matrix",
    b"\x1a",
    b"\x0c",
    b"\xc2\x85",
    b"\xe2\x80\xa8",
)
RUNS = (
    b"\n",
    b" ",
    b"\t",
    b"\r\n",
    b"\xff",
    b"#",
    b"%",
    b".",
    b"[",
    b"{",
    b"(",
    b"<a>",
    b"- ",
    b"a: ",
    b"1,",
    b"x,1\n",
    b'"',
    b"'",
    b"0",
    b"-",
    b"1 ",
    b"\\",
    b"a",
    b"a\n",
    b"\0",
    b"<!--",
    b"a=[\n",
    b"&",
    b"*",
    b"?",
)
LARGEST = 400_000
"""Bytes; what grows by repetition ends here."""
_NUMBER = re.compile(rb"[-+]?\d[\d.eE+-]*")
_WORD = re.compile(rb"[A-Za-z_]\w*")


# Bytes


def flip(random: Random, content: bytes, _: bytes) -> bytes:
    """Some bits turned."""
    changed = bytearray(content)
    for _each in range(random.choice((1, 2, 8, 64)) if changed else 0):
        changed[_place(random, len(changed))] ^= 1 << random.randrange(8)
    return bytes(changed)


def cut(random: Random, content: bytes, _: bytes) -> bytes:
    """The end is missing."""
    return content[: random.randrange(len(content) + 1)]


def cut_out(random: Random, content: bytes, _: bytes) -> bytes:
    """A piece is missing."""
    start = _place(random, len(content) + 1)
    return content[:start] + content[start + random.choice((1, 2, 4, 50, 1000)) :]


def insert(random: Random, content: bytes, _: bytes) -> bytes:
    """Signs or noise put in."""
    start = _place(random, len(content) + 1)
    piece = random.choice((random.choice(SIGNS), random.randbytes(random.choice((1, 4, 100)))))
    return content[:start] + piece * random.choice((1, 1, 1, 3, 60, 3000)) + content[start:]


def long_run(random: Random, content: bytes, _: bytes) -> bytes:
    """One sign or piece so often that whoever looks at it once for each does not come to an end."""
    start = random.choice((0, 2, len(content), random.randrange(len(content) + 1)))
    piece = random.choice((*RUNS, random.choice(SIGNS)))
    rest = random.choice((b"", content[start:]))
    return content[:start] + piece * (LARGEST // 2 // len(piece)) + rest


def repeat(random: Random, content: bytes, _: bytes) -> bytes:
    """A piece many times."""
    start = random.randrange(len(content) + 1)
    end = min(len(content), start + random.choice((1, 10, 100, 2000)))
    return content[:start] + content[start:end] * random.choice((2, 10, 500)) + content[end:]


def splice(random: Random, content: bytes, other: bytes) -> bytes:
    """The beginning of one and the end of another."""
    return content[: random.randrange(len(content) + 1)] + other[random.randrange(len(other) + 1) :]


def whole_number(random: Random, content: bytes, _: bytes) -> bytes:
    """A length, an offset or a count with an extreme value."""
    form = random.choice(("<H", ">H", "<I", ">I", "<Q", ">Q", "B"))
    size = struct.calcsize(form)
    if len(content) < size:
        return content
    most = 256**size - 1
    value = random.choice(
        (0, 1, 2, most, most // 2, most // 2 + 1, len(content), random.randrange(most))
    )
    start = _place(random, len(content) - size + 1)
    return content[:start] + struct.pack(form, min(value, most)) + content[start + size :]


def _place(random: Random, length: int) -> int:
    """Anywhere, but half of the time where the heads and the lists of contents are."""
    if length < 1:
        return 0
    near = min(length, 200)
    return random.choice(
        (random.randrange(length), random.randrange(near), length - 1 - random.randrange(near))
    )


# Text


def other_number(random: Random, content: bytes, _: bytes) -> bytes:
    """One number replaced."""
    return _exchanged(random, content, _NUMBER, random.choice(NUMBERS).encode())


def other_numbers(random: Random, content: bytes, _: bytes) -> bytes:
    """Every number replaced."""
    new = random.choice(NUMBERS).encode().replace(b"\\", b"")
    return _NUMBER.sub(new, content, count=1 + LARGEST // (1 + len(new)))


def other_word(random: Random, content: bytes, other: bytes) -> bytes:
    """A word replaced."""
    words = _WORD.findall(other) or [b"x"]
    new = random.choice((random.choice(words), token(random)))
    return _exchanged(random, content, _WORD, new)


def _exchanged(random: Random, content: bytes, pattern: re.Pattern[bytes], new: bytes) -> bytes:
    found = list(pattern.finditer(content))
    if not found:
        return content + new
    match = random.choice(found[: random.choice((20, len(found)))])
    return content[: match.start()] + new + content[match.end() :]


def moved_lines(random: Random, content: bytes, other: bytes) -> bytes:
    """Lines lost, doubled, moved, lengthened."""
    lines = content.split(b"\n")
    at = random.randrange(min(len(lines), random.choice((3, len(lines)))))
    act = random.randrange(6)
    if act == 0:
        del lines[at]
    elif act == 1:
        lines.insert(at, lines[random.randrange(len(lines))])
    elif act == 2:
        lines[at:at] = [lines[at]] * min(
            random.choice((2, 50, 1000)), 1 + LARGEST // (1 + len(lines[at]))
        )
    elif act == 3:
        lines.insert(at, random.choice(other.split(b"\n")))
    elif act == 4:
        lines[at] *= min(random.choice((2, 100, 3000)), 1 + LARGEST // (1 + len(lines[at])))
    else:
        random.shuffle(lines)
    return b"\n".join(lines)


def endings(random: Random, content: bytes, _: bytes) -> bytes:
    """Other ends of lines."""
    new = random.choice((b"\r\n", b"\r", b"\n\n", b"\x00\n", b"", b" \n", b"\xe2\x80\xa8", b"\x0b"))
    return content.replace(b"\r\n", b"\n").replace(b"\n", new)


def separators(random: Random, content: bytes, _: bytes) -> bytes:
    """Other signs between the cells."""
    return content.replace(b",", random.choice((b";", b"\t", b",,", b" ", b"", b"|", b'","')))


def encoding(random: Random, content: bytes, _: bytes) -> bytes:
    """Another encoding."""
    text = content.decode("utf-8", "replace")
    act = random.randrange(5)
    if act == 0:
        return text.encode("utf-16")
    if act == 1:
        return text.encode("utf-32")
    if act == 2:
        return b"\xef\xbb\xbf" * random.choice((1, 2)) + content
    if act == 3:
        return content.replace(b"a", "ä".encode("latin-1"))
    return text.replace("1", "１").replace("a", "а").encode()


def deep(random: Random, content: bytes, _: bytes) -> bytes:
    """Deeply nested."""
    opening, closing = random.choice(
        (
            (b"[", b"]"),
            (b'{"a":', b"}"),
            (b"<a>", b"</a>"),
            (b"- ", b""),
            (b"{a: ", b"}"),
            (b"[[", b"]]"),
            (b"(", b")"),
            (b"[a.", b"]"),
            (b"? ", b""),
            (b"a:\n ", b""),
        )
    )
    depth = random.choice((3, 60, 990, 1010, 20_000, 100_000))
    start = _place(random, len(content) + 1)
    return content[:start] + opening * depth + b"1" + closing * depth + content[start:]


def quote(random: Random, content: bytes, _: bytes) -> bytes:
    """A quotation mark that nothing closes."""
    start = random.randrange(len(content) + 1)
    return content[:start] + random.choice((b'"', b"'", b'"""', b"'''", b'\\"')) + content[start:]


def token(random: Random) -> bytes:
    """A number, a name or what looks like one."""
    token = random.choice((random.choice(NUMBERS), str(random.choice(NAMES)), str(random.random())))
    return token.encode("utf-8", "surrogatepass")
