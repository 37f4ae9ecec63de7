"""Which frame of the secondary belongs to which of the primary, where a calibration's did not have
the same number: the points tell, with the known pose of the cameras.

New points may be of the recording that was calibrated, counted as it was, or of another one.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd

from stereocal.calibration.corrections import FITTING
from stereocal.errors import StereocalError
from stereocal.matching.point_table import POINT, PointTable
from stereocal.network.rig_file import RigFile
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import Rig
from stereocal.rig.tracks import MeasuredOffset

STANDS_OUT = 1.5
"""How many times farther from the epipolar lines points must lie at any other offset."""
FRAMES, FEWEST, APART = 40, 8, 2
"""Frames that an offset is judged by, at least so many; and frames between offsets that compete."""
MOST_OFFSETS = 20_000
Sides = dict[int, FloatArray]
Points = tuple[FloatArray, FloatArray]
CALLED = "the primary", "the secondary"


def tables_alike(
    rig: RigParameters | RigFile, tables: Mapping[str, PointTable]
) -> tuple[dict[str, PointTable], list[str]]:
    """The tables with the frames of all cameras numbered as the first's, and what was done."""
    first, *others = tables
    found, notes = dict(tables), list[str]()
    for name in others:
        pair = rig.pair(first, name) if isinstance(rig, RigFile) else rig
        if not pair.start_frame:
            continue
        one, other = (pd.concat(list(tables[each].blocks())) for each in (first, name))
        called = (first, name) if isinstance(rig, RigFile) else CALLED
        points, note = counted_alike(pair, one, other, called)
        found[name] = PointTable(points, tables[name].numbers, tables[name].label)
        notes.append(f"{tables[name].label}: {note}")
    return found, notes


def counted_alike(
    rig: RigParameters,
    primary: pd.DataFrame,
    secondary: pd.DataFrame,
    called: tuple[str, str] = CALLED,
) -> tuple[pd.DataFrame, str]:
    """The points of the secondary with their frames numbered as the primary's, and a sentence.

    Args:
        called: the names of both cameras in the sentence.

    Raises:
        StereocalError: the points do not tell by how much the cameras were counted apart.
    """
    if not rig.start_frame:
        return secondary, ""
    sides = tuple(_by_frame(table) for table in (primary, secondary))
    try:
        offset = _offset_of(rig, sides[0], sides[1])
    except StereocalError as error:
        raise StereocalError(f"{error}{_rates_that_fit(rig, sides, called)}") from error
    if offset is None:
        return secondary, (
            "the calibrated recording was counted "
            f"{abs(rig.start_frame)} frames apart; these frames are too few to tell whether they "
            "are, and were used as numbered."
        )
    if not offset:
        return secondary, "by these points, both cameras counted their frames alike."
    note = (
        f"by these points, frame 0 of {called[1]} is frame {offset} of {called[0]}: they are "
        f"paired like this, with the numbers of {called[0]}."
    )
    return secondary.assign(frame=secondary["frame"] + offset), note


def _rates_that_fit(rig: RigParameters, sides: tuple[Sides, ...], called: tuple[str, str]) -> str:
    """A sentence, if the points fit where a camera takes two frames for each of the other."""
    for fast, odd in product((0, 1), (0, 1)):
        tried = [*sides]
        tried[fast] = {k // 2: own for k, own in sides[fast].items() if k % 2 == odd}
        with suppress(StereocalError):
            if _offset_of(rig, tried[0], tried[1]) is not None:
                return (
                    f" With two frames of {called[fast]} for each of {called[1 - fast]}, they do: "
                    f"give the points at the frames of {called[1 - fast]}, as `sync` writes them."
                )
    return ""


def offset_of_pairs(
    rig: RigParameters, whole: int, points_at: Callable[[MeasuredOffset], Points]
) -> MeasuredOffset | None:
    """The time offset of a parameter set for points in pairs, with the whole frames by which the
    calibrated recording was counted apart if they then fit far better.

    Args:
        points_at: the pixels of both cameras, those of the secondary shifted by an offset.
    """
    own = rig.time_offset or MeasuredOffset()
    tried = own, replace(own, frames=own.frames + whole)
    errors = [np.abs(rig.epipolar_errors(*points_at(offset))) for offset in tried]
    plain, apart = (float(np.median(each)) if len(each) else np.inf for each in errors)
    return tried[1] if apart * STANDS_OUT < plain else rig.time_offset


def _by_frame(table: pd.DataFrame) -> Sides:
    known = table[["frame", *POINT]].astype(np.float64).dropna()
    return {
        int(str(frame)): rows[list(POINT)].to_numpy()
        for frame, rows in known.groupby(known["frame"].astype(np.int64))
    }


def _offset_of(rig: RigParameters, primary: Sides, secondary: Sides) -> int | None:
    """By how many frames to raise the secondary's numbers; None if too few are in common."""
    stated = {offset: _misfit(rig, primary, secondary, offset) for offset in (0, rig.start_frame)}
    best, other = sorted(stated, key=stated.__getitem__)
    limit = FITTING * min(
        float(np.hypot(*size.image_size)) for size in (rig.primary, rig.secondary)
    )
    if stated[best] <= limit and stated[other] > STANDS_OUT * stated[best]:
        return best
    low, high = min(primary) - max(secondary), max(primary) - min(secondary)
    offsets = np.arange(low, high + 1)
    if min(len(primary), len(secondary)) < FEWEST:
        return None
    if len(offsets) <= MOST_OFFSETS:
        errors = np.array([_misfit(rig, primary, secondary, int(each)) for each in offsets])
        found = int(offsets[errors.argmin()])
        others = errors[np.abs(offsets - found) > APART].min(initial=np.inf)
        if errors.min() <= limit and STANDS_OUT * errors.min() < others < np.inf:
            return found
    raise StereocalError(
        f"The calibrated recording was counted {abs(rig.start_frame)} frames apart. By how much "
        "these points are, they do not tell: at no offset do they fit the parameters far better "
        "than at all others. Number the frames of both cameras alike, or give more frames with few "
        "points that move."
    )


def _misfit(rig: Rig, primary: Sides, secondary: Sides, offset: int) -> float:
    """The median distance in px of the primary's points from the nearest epipolar line."""
    common = np.array([frame for frame in primary if frame - offset in secondary], dtype=np.int64)
    if len(common) < FEWEST:
        return np.inf
    some: IntArray = common[np.linspace(0, len(common) - 1, min(len(common), FRAMES)).astype(int)]
    pairs = [(primary[frame], secondary[frame - offset]) for frame in some.tolist()]
    first = np.concatenate([np.repeat(one, len(two), axis=0) for one, two in pairs])
    second = np.concatenate([np.tile(two, (len(one), 1)) for one, two in pairs])
    widths = np.concatenate([np.full(len(one), len(two)) for one, two in pairs])
    errors = np.abs(rig.epipolar_errors(first, second))
    nearest = np.minimum.reduceat(errors, np.concatenate([[0], np.cumsum(widths)[:-1]]))
    return float(np.median(nearest))
