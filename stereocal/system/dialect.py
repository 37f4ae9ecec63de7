"""How a text table is written, found in its first lines.

The delimiter is comma, semicolon, tab, bar or blanks, the decimal sign is point or comma, and blank
lines or Excel's `sep=;` may stand above the first row.
"""

import codecs
import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from stereocal.errors import StereocalError

DELIMITERS = ",;\t| "
"""The last stands for any number of blanks."""
HEAD_LINES, HEAD_CHARACTERS = 30, 1_000_000
"""What a dialect is found in."""
_SEPARATOR = re.compile(r'"?sep=(.)"?', re.IGNORECASE)
_NUMBER = re.compile(r"[-+]?(\d+(\.\d*|,\d+)?|[.,]\d+)(e[-+]?\d+)?|nan|", re.IGNORECASE)
_COMMA, _POINT = re.compile(r"[-+]?\d*,\d+(e[-+]?\d+)?"), re.compile(r"[-+]?\d*\.\d+")
_CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1f]")
"""Bytes that are in no text."""
_THOUSANDS = re.compile(r"[-+]?\d{1,3}(,\d{3})+")


@dataclass(frozen=True)
class Dialect:
    """How a table is written."""

    delimiter: str = ","
    above: int = 0
    """Lines above its first row."""
    decimal_comma: bool = False
    encoding: str = "utf-8-sig"

    def cells(self, lines: str, source: str) -> list[list[str]]:
        """The cells of lines."""
        if self.delimiter == " ":
            return [line.split() for line in lines.splitlines()]
        try:
            return list(csv.reader(io.StringIO(lines), delimiter=self.delimiter))
        except csv.Error as error:
            raise StereocalError(f"{source}: this is not a CSV file ({error}).") from error

    def with_points(self, row: list[str]) -> list[str]:
        """A row whose numbers have decimal points."""
        if not self.decimal_comma:
            return row
        return [c.replace(",", ".") if _COMMA.fullmatch(c.strip()) else c for c in row]

    def count(self, line: str) -> int:
        """The largest possible number of cells of a line."""
        return len(line.split()) if self.delimiter == " " else 1 + line.count(self.delimiter)


def dialect_of(lines: Sequence[str]) -> Dialect:
    """The dialect of a table's first lines: that which makes the most of its cells numbers."""
    above = 0
    while above < len(lines) - 1 and not lines[above].strip(f'"{DELIMITERS}\r\n'):
        above += 1
    stated = _SEPARATOR.fullmatch(lines[above].strip("\ufeff\r\n")) if lines else None
    if stated is not None and len(lines) > above + 1:
        above += 1
    head = lines[above : above + HEAD_LINES]
    tried = stated[1] if stated else [sign for sign in DELIMITERS if any(sign in k for k in head)]
    scored = [_tried(Dialect(sign, above), head) for sign in tried or ","]
    return max(scored, key=lambda pair: pair[0])[1]


def _tried(dialect: Dialect, lines: Sequence[str]) -> tuple[float, Dialect]:
    """The share of cells that are numbers, and the dialect with its decimal sign."""
    try:
        rows = [row for row in dialect.cells("".join(lines), "") if any(row)]
    except StereocalError:
        return 0.0, dialect
    widths = [len(row) for row in rows]
    usual = max(set(widths), key=widths.count, default=0)
    cells = [cell.strip() for row in rows[len(rows) > 1 :] for cell in row if len(row) == usual]
    share = sum(_NUMBER.fullmatch(cell) is not None for cell in cells) / max(len(cells), 1)
    commas = [cell for cell in cells if _COMMA.fullmatch(cell)]
    if dialect.delimiter == ",":  # only in quotes: 1,215 may be thousands
        comma = any(not _THOUSANDS.fullmatch(cell) for cell in commas)
    else:
        comma = not any(_POINT.fullmatch(cell) for cell in cells)
    score = share * widths.count(usual) / max(len(rows), 1) + 1e-3 if usual > 1 else 0.0
    return score, replace(dialect, decimal_comma=comma)


def head_of(text: str) -> list[str]:
    """The first lines, with their ends."""
    return text[:HEAD_CHARACTERS].splitlines(keepends=True)[:HEAD_LINES]


def encoding_of(head: bytes) -> str:
    """UTF-8, the UTF-16 of Excel's *Unicode text*, or what Windows writes umlauts with."""
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)  # which may end within a letter
    except UnicodeDecodeError:
        return "utf-8-sig" if _CONTROL.search(head) else "cp1252"
    return "utf-8-sig"


def refuse_binary(head: bytes, source: str) -> None:
    """Reject what is no text, such as a spreadsheet or NumPy's arrays, in place of a table."""
    if encoding_of(head) != "utf-16" and _CONTROL.search(head):
        raise StereocalError(f"{source}: this is not a text file: save the table as CSV (UTF-8).")


def one_line_end(text: str) -> str:
    """The text with `\\n` at the ends of lines, where they are those of old Macintoshes."""
    return text if "\n" in text else text.replace("\r", "\n")
