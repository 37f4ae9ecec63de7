"""Files that are no table of text as one, of Excel, SLEAP and DLTdv8; and tables of clicks.

Of an Excel workbook it is the first sheet whose columns are those of points. SLEAP's analysis HDF5
(`tracks`, `node_names`) becomes its CSV table. DLTdv8's sparse table (`xypts.tsv`) has a row for
each coordinate, as row, column and value: rows are frames, columns are x and y of each camera of
the first point, then of the second. How many cameras there are is not in the file: two, unless the
columns only fit three. A first row with the size of the table may have the value 0.
"""

import re
from collections.abc import Sequence
from contextlib import suppress

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.formats.other_files import is_hdf5, is_workbook, refuse_other_points
from stereocal.formats.point_files import is_number_or_empty
from stereocal.formats.point_layouts import first_rows, layout_name
from stereocal.formats.sleap_analysis import analysis_table
from stereocal.formats.workbook_sheets import Sheet, sheets_in
from stereocal.matching.clicks import Clicks
from stereocal.system.csv_text import csv_text
from stereocal.system.dialect import dialect_of, encoding_of, head_of, one_line_end
from stereocal.system.guarded import read_apart
from stereocal.system.limits import Limits
from stereocal.system.tables import (
    MAXIMUM_COLUMNS,
    MISSING,
    Column,
    numbers_in,
    rows_below,
    text_of,
)
from stereocal.system.zip_files import open_zip


def point_text(content: bytes, source: str) -> bytes:
    """A point file as text: Excel and HDF5 converted to CSV in a child process, a sparse table
    spread out, other files unchanged.
    """
    if is_workbook(content):
        return _of_workbook(content, source)
    if not is_hdf5(content):
        return dense_text(content, source)
    refuse_other_points(content, source)
    Limits.from_environment().check_size(len(content), source)
    try:
        import h5py  # noqa: F401
    except ImportError as error:
        raise StereocalError(
            f"{source}: this is an HDF5 file. To read one of SLEAP, the package h5py is needed, "
            "which is not installed: pip install h5py, or use the CSV that SLEAP exports."
        ) from error
    text: bytes = read_apart(analysis_table, content, source, source)
    return text


def _of_workbook(content: bytes, source: str) -> bytes:
    """The first sheet with columns of points, or else the first that is a table."""
    try:
        import openpyxl  # noqa: F401
    except ImportError as error:
        raise StereocalError(
            f"{source}: this is an Excel file. To read it, the package openpyxl is needed, which "
            "is not installed: pip install openpyxl, or save the table as CSV."
        ) from error
    limits = Limits.from_environment()
    limits.check_size(len(content), source)
    with open_zip(content, source) as opened:
        limits.check_expansion(len(content), sum(map(opened.size, opened.names)), source)
    sheets: list[Sheet] = read_apart(sheets_in, content, source, source)
    known = (sheet for sheet in sheets if layout_name(sheet.text, source) is not None)
    tables = (sheet for sheet in sheets if _is_table(sheet.text, source))
    if (sheet := next(known, None) or next(tables, None)) is None:
        raise StereocalError(f"{source}: no sheet of this Excel file is a table.")
    if sheet.problem:
        raise StereocalError(f"{source}: sheet {sheet.title}, cell {sheet.problem}.")
    return dense_text(sheet.text, source)


def _is_table(text: bytes, source: str) -> bool:
    with suppress(StereocalError):
        return min(map(len, first_rows(text, source)[0])) > 1
    return False


CELLS = ("row", "column", "value")
FEWEST_ROWS = 4
POSITIVE = re.compile(r"0*[1-9]\d{0,17}")


def dense_text(content: bytes, source: str) -> bytes:
    """A sparse table of DLTdv8 as its flat table; other files unchanged."""
    head = one_line_end(content[:20_000].decode(encoding_of(content), errors="replace"))
    lines = head_of(head)
    dialect = dialect_of(lines)
    rows = dialect.cells("".join(lines[dialect.above :]), source)
    header = int(bool(rows) and not any(map(is_number_or_empty, rows[0])))
    below = [row for row in rows[header:] if any(row)]
    if len(below) < FEWEST_ROWS or any(len(row) != len(CELLS) for row in below):
        return content
    if not all(POSITIVE.fullmatch(row[k].strip()) for row in below for k in (0, 1)):
        return content
    text = text_of(content, source)
    raw, long = rows_below(text, dialect, header, len(CELLS), source)
    raw.columns = pd.Index(CELLS)
    indices = [Column(name, is_whole=True, is_positive=True) for name in CELLS[:2]]
    columns = [*indices, Column(CELLS[2], may_be_empty=True)]
    values, reasons = numbers_in(raw, columns, dialect.decimal_comma, MISSING)
    if long or reasons:
        return content  # as any other table, whose reader names the rows
    row, column = (values[name].astype(np.int64) - 1 for name in CELLS[:2])
    width = int(column.max()) + 1
    width += width % 2
    cameras = 2 if width % 4 == 0 else 3 if width % 6 == 0 else 0
    # A table of two columns of whole numbers is as likely frame,u,v: columns come block by block.
    if not cameras or width > MAXIMUM_COLUMNS or (np.diff(column) < 0).sum() > 1:
        return content
    Limits.from_environment().check_rows(int(row.max()) * width // 8, source)
    dense = np.full((int(row.max()) + 1, width), np.nan)
    dense[row, column] = values["value"]
    names = [
        f"pt{point + 1}_cam{camera + 1}_{axis}"
        for point in range(width // (2 * cameras))
        for camera in range(cameras)
        for axis in "UV"
    ]
    return pd.DataFrame(dense, columns=names).to_csv(index=False, lineterminator="\n").encode()


LATEST_DLTDV = 1_000_000
"""The latest frame of a table that has a row for each: 5 hours at 60 frames a second."""


def dltdv_table(clicks: Clicks, cameras: Sequence[str]) -> str:
    """DLTdv8's flat table of all cameras (`xypts.csv`): a row for each frame from 1, which is for
    clicks up to `LATEST_DLTDV`."""
    frames = range(1, clicks.last_frame + 1)
    columns = {}
    for number, track in enumerate(clicks.tracks, 1):
        for which, camera in enumerate(cameras, 1):
            pixels = np.full((len(frames), 2), np.nan)
            for click in clicks.along(track, camera):
                if click.frame >= 1:
                    pixels[click.frame - 1] = click.u + 1.0, click.v + 1.0
            columns[f"pt{number}_cam{which}_U"], columns[f"pt{number}_cam{which}_V"] = pixels.T
    return pd.DataFrame(columns).to_csv(index=False, na_rep="NaN", lineterminator="\n")


def sleap_table(clicks: Clicks, camera: str) -> str:
    """SLEAP's table of one camera: a row for each track and frame, of one node."""
    columns = ["track", "frame_idx", "instance.score", "point.x", "point.y", "point.score"]
    rows = [
        (track, click.frame, 1.0, click.u, click.v, 1.0)
        for track in clicks.tracks
        for click in clicks.along(track, camera)
    ]
    return csv_text(pd.DataFrame(rows, columns=columns))
