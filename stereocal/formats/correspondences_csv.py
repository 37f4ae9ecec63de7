"""`correspondences.csv`: frame, target, four pixel coordinates, and optional measured lengths."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stereocal.errors import RefusedRowsError, RowProblem, StereocalError
from stereocal.rig.dataset import SOURCES, TARGETS, UNKNOWN_SOURCE, Correspondences
from stereocal.system.limits import Limits

if TYPE_CHECKING:
    from _csv import Reader

PIXELS = ("u_primary", "v_primary", "u_secondary", "v_secondary")
REQUIRED = ("frame", "target", *PIXELS)
KNOWN_POINT = ("x_m", "y_m", "z_m")
SIGMAS = ("sigma_primary_px", "sigma_secondary_px")
OPTIONAL = ("distance_m", *KNOWN_POINT, *SIGMAS)
SOURCE = "source"
TEMPLATE = (
    "frame,target,u_primary,v_primary,u_secondary,v_secondary\n"
    "1,A,1012.31,655.02,884.77,671.40\n"
    "1,B,1303.84,702.15,1190.26,720.93\n"
    "2,A,655.19,801.66,540.08,812.57\n"
    "2,B,921.42,1010.37,799.95,1029.11\n"
)


@dataclass(frozen=True)
class Table:
    """What was read of a file: the sound rows, and the refused ones with the reason."""

    correspondences: Correspondences
    problems: list[RowProblem]

    def strict(self, source: str) -> Correspondences:
        """The rows, if none was refused.

        Raises:
            StereocalError: some rows were refused; names the first three.
        """
        if self.problems:
            raise RefusedRowsError(f"{source}: ", self.problems, "cannot be used")
        return self.correspondences


def read_table(content: bytes, source: str) -> Table:
    """Read a table; comma, semicolon or tab between columns, further columns are ignored.

    Raises:
        StereocalError: the file as a whole is no such table, or is too large.
    """
    limits = Limits.from_environment()
    limits.check_size(len(content), source)
    limits.check_pairs(max(content.count(b"\n"), content.count(b"\r")) - 1, source)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise StereocalError(f"{source}: this is not a text file (CSV in UTF-8).") from error
    if not text.strip():
        raise StereocalError(f"{source}: the file is empty.")
    first = text.lstrip("\r\n").splitlines()[0]
    delimiter = max(",;\t", key=first.count)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)
    try:
        return _read_rows(reader, source, decimal_comma=delimiter == ";")
    except csv.Error as error:
        raise StereocalError(f"{source}, line {reader.line_num}: {error}.") from error


def write_table(rows: Correspondences) -> bytes:
    """The table of `rows`, which `read_table` reads back to the same numbers."""
    optional = {
        "distance_m": rows.distance_m,
        **{name: rows.known_points_m[:, i] for i, name in enumerate(KNOWN_POINT)},
        **{name: getattr(rows, name) for name in SIGMAS},
    }
    known = {name: column for name, column in optional.items() if np.isfinite(column).any()}
    if known.keys() & set(KNOWN_POINT):
        known = {name: optional[name] for name in OPTIONAL if name in known or name in KNOWN_POINT}
    with_source = bool((rows.source != UNKNOWN_SOURCE).any())
    out = io.StringIO(newline="")
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([*REQUIRED, *known, *[SOURCE] * with_source])
    for i in range(len(rows)):
        numbers = [*rows.primary[i], *rows.secondary[i], *(column[i] for column in known.values())]
        cells = ["" if math.isnan(x) else repr(float(x)) for x in numbers]
        if with_source:
            code = rows.source[i]
            cells.append("" if code == UNKNOWN_SOURCE else SOURCES[code])
        writer.writerow([int(rows.frame[i]), TARGETS[rows.target[i]], *cells])
    return out.getvalue().encode()


class _RefusedError(Exception):
    """A row that cannot be used; the text is the reason."""


@dataclass
class _Row:
    frame: int
    target: int
    numbers: list[float]
    """The four pixels, then the columns of `OPTIONAL`; NaN where a cell is empty."""
    source: int
    line: int


def _read_rows(reader: Reader, source: str, decimal_comma: bool) -> Table:
    columns: dict[str, int] | None = None
    width = 0
    rows: list[_Row] = []
    problems: list[RowProblem] = []
    seen: dict[tuple[int, int], int] = {}
    distances: dict[int, float] = {}
    for cells in reader:
        if not any(cell.strip() for cell in cells):
            continue
        if columns is None:
            columns, width = _columns_of(cells, source), len(cells)
            continue
        try:
            if any(cell.strip() for cell in cells[width:]):
                raise _RefusedError(f"{len(cells)} cells instead of {width}")
            row = _read_row(cells, columns, reader.line_num, decimal_comma)
            key = (row.frame, row.target)
            if key in seen:
                raise _RefusedError(
                    f"frame {row.frame} has target {TARGETS[row.target]} already, "
                    f"in line {seen[key]}"
                )
            distance = row.numbers[4]
            known = distances.setdefault(row.frame, distance)
            if not (math.isnan(distance) or math.isnan(known)) and distance != known:
                raise _RefusedError(
                    f"frame {row.frame} has two different distances, {known:g} and {distance:g} m"
                )
            seen[key] = row.line
            rows.append(row)
        except _RefusedError as refused:
            problems.append(RowProblem(reader.line_num, str(refused)))
    if not rows and not problems:
        raise StereocalError(f"{source}: the table has a header and no rows.")
    numbers = np.array([row.numbers for row in rows], dtype=np.float64)
    numbers = numbers.reshape(-1, len(PIXELS) + len(OPTIONAL))
    return Table(
        Correspondences(
            frame=np.array([row.frame for row in rows], dtype=np.int64),
            target=np.array([row.target for row in rows], dtype=np.int64),
            primary=numbers[:, 0:2].copy(),
            secondary=numbers[:, 2:4].copy(),
            distance_m=numbers[:, 4].copy(),
            known_points_m=numbers[:, 5:8].copy(),
            sigma_primary_px=numbers[:, 8].copy(),
            sigma_secondary_px=numbers[:, 9].copy(),
            source=np.array([row.source for row in rows], dtype=np.int64),
            line=np.array([row.line for row in rows], dtype=np.int64),
        ),
        problems,
    )


def _columns_of(header: list[str], source: str) -> dict[str, int]:
    names = [cell.strip().lower() for cell in header]
    missing = [name for name in REQUIRED if name not in names]
    if missing:
        raise StereocalError(
            f"{source}: the column{'s' if len(missing) > 1 else ''} {', '.join(missing)} "
            f"{'are' if len(missing) > 1 else 'is'} missing; the first line must name the columns "
            f"{', '.join(REQUIRED)}, and names {', '.join(names)[:200]}."
        )
    twice = [name for name in (*REQUIRED, *OPTIONAL, SOURCE) if names.count(name) > 1]
    if twice:
        raise StereocalError(f"{source}: the column {twice[0]} stands in the first line twice.")
    return {name: i for i, name in enumerate(names)}


def _read_row(cells: list[str], columns: dict[str, int], line: int, decimal_comma: bool) -> _Row:
    def cell(name: str) -> str:
        at = columns.get(name, len(cells))
        return cells[at].strip() if at < len(cells) else ""

    def number(name: str, optional: bool = False) -> float:
        return _number(name, cell(name), optional, decimal_comma)

    frame = number("frame")
    if frame != int(frame) or abs(frame) > 2**53:
        raise _RefusedError(f"frame is {cell('frame')[:40]}, which is not a whole number")
    target = cell("target").upper()
    if target not in TARGETS:
        raise _RefusedError(f'target is "{cell("target")[:40]}"; it must be A or B')
    numbers = [number(name) for name in PIXELS]
    optional = {name: number(name, optional=True) for name in OPTIONAL}
    for name in ("distance_m", *SIGMAS):
        if optional[name] <= 0:
            raise _RefusedError(f"{name} is {optional[name]:g}; it must be above 0")
    numbers += optional.values()
    return _Row(int(frame), TARGETS.index(target), numbers, _source_of(cell(SOURCE)), line)


def _number(name: str, text: str, optional: bool, decimal_comma: bool) -> float:
    if not text and optional:
        return math.nan
    if not text:
        raise _RefusedError(f"{name} is empty")
    try:
        value = float(text.replace(",", ".") if decimal_comma else text)
    except ValueError:
        raise _RefusedError(f'{name} is "{text[:40]}", which is not a number') from None
    if not math.isfinite(value):
        raise _RefusedError(f"{name} is {text[:40]}, which is not a finite number")
    return value


def _source_of(text: str) -> int:
    if text and text.lower() not in SOURCES:
        words = ", ".join(SOURCES)
        raise _RefusedError(f'{SOURCE} is "{text[:40]}"; it must be {words} or empty')
    return SOURCES.index(text.lower()) if text else UNKNOWN_SOURCE
