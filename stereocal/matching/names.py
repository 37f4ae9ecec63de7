"""Names that points have in both cameras, or in all: only points of one name belong together.

Body parts, nodes and landmarks are named by a person, in all cameras alike. Tracks often are not:
programs that track in one camera count them as they come. So the images are asked before names
decide: pairs of one name must fit as well as the nearest partners, or better than other pairs.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.matching.matching import ANY_DEPTH, Matches, match_points
from stereocal.matching.point_table import POINT, SIGMA, pixels_of
from stereocal.matching.threshold import FramePixels
from stereocal.rig.camera import CAMERAS
from stereocal.rig.parameters import RigParameters
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.names import JoinedNames, check_name
from stereocal.system.numbers import plural, rounded

PARTS: tuple[str, ...] = ("point", "bodypart", "bodyparts", "body_part", "body part", "part")
PARTS += ("node", "keypoint", "landmark", "joint", "marker", "name", "label")
TRACKS = ("track", "track_id", "track id", "trackid", "id", "individual", "animal")
AUTO, OFF = "auto", "none"
BETTER = 0.75
"""Share of other pairs of the frame that a pair of one name fits better than: 0.5 by chance."""
WORSE = 5.0
"""Times the error of the nearest partner. Measured for points of 0.8 px on an animal of 10 cm:
names that are right 1.4, names of another point 14."""
WITHIN = "within_threshold"
"""Column of pairs by name: False where the error is above the threshold."""
Sample = Sequence[tuple[pd.DataFrame, pd.DataFrame]]
"""Rows of both cameras, frame by frame."""
Group = tuple[IntArray, IntArray]


@dataclass(frozen=True, eq=False)
class TwoCameras:
    """Two cameras, and some of their points."""

    rig: RigParameters
    sample: Sample
    words: str = ""
    """Which cameras, for messages about a rig of more than two."""


@dataclass(frozen=True)
class Names:
    """Which columns name points, and the names that two cameras have."""

    columns: tuple[str, ...] = ()
    """Empty: points have no names."""
    common: frozenset[str] = frozenset()
    alike: Mapping[str, str] = field(default_factory=dict)
    """Other spellings of these, as of `JoinedNames`."""

    def groups(self, first: pd.DataFrame, second: pd.DataFrame) -> list[Group]:
        """Rows of each camera in one frame that may be pairs; the last are those without a name."""
        sides = [self._rows(table) for table in (first, second)]
        none = np.empty(0, dtype=np.int64)
        named = [name for name in sides[0] if name]
        named += [name for name in sides[1] if name and name not in sides[0]]
        rows = [[side.get(name, none) for side in sides] for name in (*named, "")]
        return [(one, two) for one, two in rows]

    def samples(self, first: pd.DataFrame, second: pd.DataFrame) -> list[FramePixels]:
        """Pixels of one frame by group, with standard deviations if both tables have them."""
        columns = [*POINT, *([SIGMA] if SIGMA in first and SIGMA in second else [])]
        one, two = (pixels_of(table, columns) for table in (first, second))
        if not self.columns:
            return [(one, two)]
        groups = self.groups(first, second)
        return [(one[i], two[j]) for i, j in groups if len(i) and len(j)]

    def numbers(self, table: pd.DataFrame) -> IntArray:
        """(n,): the number of each row's name, from 1; 0 without a name."""
        if not self.columns:
            return np.zeros(len(table), dtype=np.int64)
        numbers = [self._numbers.get(name, 0) for name in self._texts(table)]
        return np.array(numbers, dtype=np.int64)

    @cached_property
    def _numbers(self) -> dict[str, int]:
        return {name: number for number, name in enumerate(sorted(self.common), 1)}

    @property
    def in_words(self) -> str:
        """The columns, for messages."""
        return f"{plural(len(self.columns), 'column')} {' and '.join(self.columns)}"

    def _texts(self, table: pd.DataFrame) -> list[str]:
        return [self.alike.get(name, name) for name in texts(table, self.columns)]

    def _rows(self, table: pd.DataFrame) -> dict[str, IntArray]:
        rows: dict[str, list[int]] = {}
        for row, name in enumerate(self._texts(table)):
            rows.setdefault(name if name in self.common else "", []).append(row)
        return {name: np.array(numbers, dtype=np.int64) for name, numbers in rows.items()}


NO_NAMES = Names()


def texts(table: pd.DataFrame, columns: Sequence[str]) -> list[str]:
    """The name of each row, empty if it has none.

    Text stays as it is: tracks 1 and 1.0 are two. Whole numbers that a library holds as floats,
    since some are missing, are named without decimals.
    """
    cells = [map(_name, table[column].tolist()) for column in columns]
    return [" ".join(filter(None, row)) for row in zip(*cells, strict=True)]


def _name(cell: object) -> str:
    if isinstance(cell, float) and cell.is_integer():
        return str(int(cell))
    name = str(cell).strip()
    return "" if name in ("nan", "None", "<NA>") else name


def name_columns(*tables: Sequence[str]) -> tuple[str, ...]:
    """The columns of all tables that seem to name points: of parts, then of tracks."""
    common = [name for name in tables[0] if all(name in table for table in tables)]
    kinds = ([name for name in common if name.lower() in kind][:1] for kind in (PARTS, TRACKS))
    return tuple(name for kind in kinds for name in kind)


def stated_columns(wanted: str, *tables: Sequence[str]) -> tuple[str, ...]:
    """The columns of `AUTO`, `OFF`, or columns that are named, with commas between.

    Args:
        tables: the columns of each.
    """
    if wanted in (AUTO, OFF):
        return name_columns(*tables) if wanted == AUTO else ()
    columns = tuple(name.strip() for name in wanted.split(","))
    for name in columns:
        if any(name not in table for table in tables):
            have = " and ".join(", ".join(table)[:100] or "none" for table in tables)
            raise StereocalError(
                f"{'Both' if len(tables) == 2 else 'All'} tables need the column {name!r} that "
                f"names their points; they have {have}."
            )
    return columns


def choose_names(
    cameras: Sequence[TwoCameras],
    distinct: Sequence[pd.DataFrame],
    columns: tuple[str, ...],
    is_forced: bool = False,
    called: Sequence[str] = CAMERAS,
) -> tuple[Names, str]:
    """The names that decide, and a note on names that the images contradict, that differ in
    capitals or blanks only, or that one table lacks.

    Args:
        cameras: the two, or every two of a rig.
        distinct: the different rows of `columns` in each table.
        columns: those of `stated_columns`.
        is_forced: they decide in any case.
        called: the tables, for notes.
    """
    note = ""
    columns = tuple(
        column for column in columns if all(any(texts(table, [column])) for table in distinct)
    )
    for tried in dict.fromkeys([columns, columns[:1], columns[1:]]):
        tables = [texts(table, tried) for table in distinct]
        joined = JoinedNames.of(tables)
        seen = Counter(name for table in tables for name in {joined.alike.get(n, n) for n in table})
        common = frozenset(name for name, count in seen.items() if name and count > 1)
        names = Names(tried, common, joined.alike)
        lists = is_forced or any(column.lower() in PARTS for column in tried)
        on_names = joined.in_words(dict(zip(called, tables, strict=True)) if lists else {})
        if not names.common:
            note = note or (f"{on_names} They are not used." if on_names else "")
            continue
        for name in names.common:
            check_name(f"A point ({names.in_words})", name)
        against = next(filter(None, (_contradiction(two, names) for two in cameras)), "")
        if not against or is_forced:
            return names, " ".join(filter(None, [against or note, on_names]))
        note = note or f"{against} They are not used."
    return NO_NAMES, note


def _contradiction(cameras: TwoCameras, names: Names) -> str:
    """Why the images contradict the names; empty if they do not."""
    same, nearest, better = [], [], []
    for first, second in cameras.sample:
        pairs = [(i[0], j[0]) for i, j in names.groups(first, second)[:-1] if len(i) == len(j) == 1]
        if not pairs:
            continue
        one, two = np.array(pairs).T
        i, j = np.meshgrid(one, two, indexing="ij")
        pixels = pixels_of(first)[i.ravel()], pixels_of(second)[j.ravel()]
        errors = cameras.rig.reprojection_errors(*pixels).mean(axis=1).reshape(i.shape)
        errors = np.nan_to_num(errors, nan=np.inf)  # behind a camera
        of_names = np.diag(errors)
        same.append(of_names)
        nearest.append(errors.min(axis=1))
        others = errors[~np.eye(len(of_names), dtype=bool)].reshape(len(of_names), -1)
        better.append((others > of_names[:, None]).ravel())
    if not same:
        return ""
    of_names, least, share = (np.concatenate(parts) for parts in (same, nearest, better))
    typical, best = float(np.median(of_names)), float(np.median(least))
    if typical <= WORSE * best + 1e-3 or (len(share) and share.mean() >= BETTER):
        return ""
    return (
        f"The names in the {names.in_words} do not fit the images{cameras.words}: pairs of "
        f"one name have a median error of {rounded(typical)} px, the nearest partners "
        f"{rounded(best)} px."
    )


def match_groups(
    rig: RigParameters,
    primary_px: FloatArray,
    secondary_px: FloatArray,
    groups: Sequence[Group],
    threshold_px: float,
    depths_m: tuple[float, float] = ANY_DEPTH,
) -> Matches:
    """Match the points of one frame within groups, those of a name last.

    The only two points of a group are a pair whatever their error; all others are matched as in
    `match_points`.
    """
    single = [(i[0], j[0]) for i, j in groups[:-1] if len(i) == len(j) == 1]
    one, two = np.array(single, dtype=np.int64).reshape(-1, 2).T
    pixels = primary_px[one], secondary_px[two]
    depth = rig.reconstruct(*pixels)[:, 2]
    kept = (depth >= depths_m[0]) & (depth <= depths_m[1])
    one, two = one[kept], two[kept]
    error = rig.reprojection_errors(primary_px[one], secondary_px[two]).mean(axis=1)
    parts = [(one, two, error, np.full(len(one), np.nan), np.zeros(len(one), dtype=bool))]
    for number, (i, j) in enumerate(groups):
        if len(i) and len(j) and (len(i) + len(j) > 2 or number == len(groups) - 1):
            matches = match_points(rig, primary_px[i], secondary_px[j], threshold_px, depths_m)
            rows = i[matches.primary], j[matches.secondary]
            parts.append((*rows, matches.error_px, matches.runner_up_px, matches.ambiguous))
    one, two, error, second, ambiguous = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    order = np.argsort(one, kind="stable")
    return Matches(one[order], two[order], error[order], second[order], ambiguous[order])
