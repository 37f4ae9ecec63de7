"""`correspondences.csv`: frame, target, four pixel coordinates, and optional columns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import pandas as pd

from stereocal.errors import RefusedRowsError, RowProblem, naming
from stereocal.rig.correspondences import (
    KNOWN_POINT,
    OBJECT,
    OPTIONAL,
    PIXELS,
    SOURCE,
    SOURCES,
    TARGETS,
    TIME,
    UNKNOWN_SOURCE,
    Correspondences,
)
from stereocal.rig.rigid_object import RigidObject
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.csv_text import as_names, csv_text
from stereocal.system.tables import EMPTY, LARGEST_INTEGER, Column, Reasons, Values, read_rows

Texts: TypeAlias = "pd.Series[str]"
REQUIRED = ("frame", "target", *PIXELS)
NUMBERS = (
    *(Column(name, is_whole=True, most=LARGEST_INTEGER) for name in ("frame", TIME)),
    *(Column(name, is_pixel=True) for name in PIXELS),
    *(Column(name, may_be_empty=True, is_positive=name not in KNOWN_POINT) for name in OPTIONAL),
    *(Column(name) for name in OBJECT),
)
TEMPLATE = (
    "frame,target,u_primary,v_primary,u_secondary,v_secondary\n"
    "1,A,1012.31,655.02,884.77,671.40\n"
    "1,B,1303.84,702.15,1190.26,720.93\n"
    "2,A,655.19,801.66,540.08,812.57\n"
    "2,B,921.42,1010.37,799.95,1029.11\n"
)


@dataclass(frozen=True)
class Table:
    """The valid rows of a file, and the reasons why the others are invalid."""

    correspondences: Correspondences
    problems: list[RowProblem]

    def strict(self, source: str) -> Correspondences:
        """The rows, if all are valid."""
        if self.problems:
            raise RefusedRowsError(f"{source}: ", self.problems, "cannot be used")
        return self.correspondences


def read_table(content: bytes, source: str) -> Table:
    """Read a table separated by comma, semicolon or tab; further columns are ignored."""
    rows = read_rows(content, source, REQUIRED, NUMBERS, (SOURCE,), EMPTY)
    raw, values, reasons = rows.raw, rows.values, rows.reasons
    if SOURCE not in raw:
        raw[SOURCE] = ""
    if TIME not in raw:
        values[TIME] = values["frame"]
    words = {name: as_names(raw[name]) for name in ("target", SOURCE)}
    rigid_object = _object(words["target"], values, reasons, source) if OBJECT[0] in raw else None
    names = TARGETS if rigid_object is None else rigid_object.names
    targets = words["target"].str.upper() if rigid_object is None else words["target"]
    known = {name: i for i, name in enumerate(names)}
    target = codes_of(targets, known, " or ".join(names[:2]), words["target"], reasons)
    known = {"": UNKNOWN_SOURCE} | {name: i for i, name in enumerate(SOURCES)}
    lower, allowed = words[SOURCE].str.lower(), f"{', '.join(SOURCES)} or empty"
    origin = codes_of(lower, known, allowed, words[SOURCE], reasons)
    reasons.update(_contradictions(values, target, raw.index.to_numpy(), reasons, names))
    sound = np.ones(len(raw), dtype=bool)
    sound[list(reasons)] = False
    numbers = np.column_stack([values[name] for name in (*PIXELS, *OPTIONAL)])[sound]
    return Table(
        Correspondences(
            frame=values["frame"][sound].astype(np.int64),
            target=target[sound],
            primary=numbers[:, 0:2].copy(),
            secondary=numbers[:, 2:4].copy(),
            distance_m=numbers[:, 4].copy(),
            known_points_m=numbers[:, 5:8].copy(),
            sigma_primary_px=numbers[:, 8].copy(),
            sigma_secondary_px=numbers[:, 9].copy(),
            source=origin[sound],
            line=raw.index.to_numpy(dtype=np.int64)[sound],
            time_frame=values[TIME][sound].astype(np.int64),
            rigid_object=rigid_object,
        ),
        rows.problems,
    )


def codes_of(
    words: Texts, codes: Mapping[str, int], allowed: str, written: Texts, reasons: Reasons
) -> IntArray:
    """The codes of words; adds rows with others, as `written` under the name of that column."""
    code = words.map(codes)
    bad = np.flatnonzero(code.isna())
    for row, cell in zip(bad.tolist(), written.iloc[bad].tolist(), strict=True):
        reasons.setdefault(row, f'{written.name} is "{cell[:40]}"; it must be {allowed}')
    return np.asarray(code.fillna(0), dtype=np.int64)


def _object(targets: Texts, values: Values, reasons: Reasons, source: str) -> RigidObject:
    """The object of the columns `OBJECT`; adds rows that contradict an earlier one."""
    places = np.column_stack([values[name] for name in OBJECT])
    points: dict[str, FloatArray] = {}
    for row, name in enumerate(targets.tolist()):
        if row not in reasons and (points.setdefault(name, places[row]) != places[row]).any():
            reasons[row] = f"target {name[:40]} is at two places on the object"
    names = sorted(points, key=lambda name: (len(name), name))
    with naming(source):
        return RigidObject(tuple(names), np.array([points[name] for name in names]).reshape(-1, 3))


def _contradictions(
    values: Values, target: IntArray, lines: IntArray, bad: Reasons, names: Sequence[str]
) -> Reasons:
    """Valid rows that contradict an earlier row of the same frame."""
    rows = pd.DataFrame(
        {"frame": values["frame"], "target": target, "own": values["distance_m"], "line": lines}
    ).drop(index=list(bad))
    earlier = rows.groupby(["frame", "target"])["line"].transform("first")
    firsts = rows.drop_duplicates("frame").set_index("frame")["own"]
    known = rows["frame"].map(firsts)
    repeated = rows["line"] != earlier
    differ = rows["own"].notna() & known.notna() & (rows["own"] != known)
    reasons: Reasons = {}
    contradicting = rows.assign(earlier=earlier, known=known)[repeated | differ]
    for row, (frame, which, distance, line, first, other) in zip(
        contradicting.index.tolist(), contradicting.to_numpy().tolist(), strict=True
    ):
        if line != first:
            problem = f"has target {names[int(which)]} already, in line {first:.0f}"
        else:
            problem = f"has two different distances, {other:g} and {distance:g} m"
        reasons[row] = f"frame {frame:.0f} {problem}"
    return reasons


def write_table(rows: Correspondences) -> bytes:
    """The table of `rows`, read back exactly by `read_table`."""
    return csv_text(rows.to_dataframe()).encode()
