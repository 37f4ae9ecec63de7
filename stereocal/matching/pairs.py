"""Match tables in memory (`match`), and the columns of tables of pairs."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.matching.in_step import shift_pixels
from stereocal.matching.matching import ANY_DEPTH, match_points
from stereocal.matching.names import (
    AUTO,
    NO_NAMES,
    WITHIN,
    Names,
    TwoCameras,
    choose_named_threshold,
    choose_names,
    match_groups,
    stated_columns,
)
from stereocal.matching.point_noise import PointNoise
from stereocal.matching.point_table import PAIR_SIGMAS, SIGMA, SIGMAS
from stereocal.matching.threshold import sample_of
from stereocal.rig.camera import CAMERAS
from stereocal.rig.compiled import FloatArray
from stereocal.rig.parameters import RigParameters

POINT = ("u", "v")
PIXELS = ("u_primary", "v_primary", "u_secondary", "v_secondary")
PAIR_COLUMNS = ("frame", *PIXELS, "error_px", "runner_up_px", "ambiguous")
ERROR_DECIMALS = 6


def match(
    rig: RigParameters,
    primary: pd.DataFrame,
    secondary: pd.DataFrame,
    threshold_px: float | Literal["auto"] | None = "auto",
    depths_m: tuple[float, float] = ANY_DEPTH,
    sigma_px: float | None = None,
    names: str = AUTO,
) -> pd.DataFrame:
    """Match two tables in memory: columns `frame`, `u`, `v` (raw pixels), and any further ones.

    Args:
        threshold_px: "auto" or None: by the noise of the points.
        sigma_px: the noise of the points, if it is known; None: that of the column `sigma_px`,
            else estimated.
        names: "auto": where both tables name their points (`names.name_columns`), only points of
            one name are a pair; "none": names are not used; else the columns that name points.

    Returns:
        The pairs, with the columns of `pairs.csv`, ordered by frame.
    """
    for which, table in (("primary", primary), ("secondary", secondary)):
        missing = [name for name in ("frame", *POINT) if name not in table]
        if missing:
            raise StereocalError(f"The {which} table has no column {missing[0]}.")
        if not np.isfinite(table[["frame", *POINT]].to_numpy(dtype=np.float64)).all():
            raise StereocalError(f"The {which} table has a number that is not finite.")
    secondary = shift_pixels(rig, secondary, POINT)
    both = [
        {int(str(frame)): rows for frame, rows in table.groupby(table["frame"].astype(np.int64))}
        for table in (primary, secondary)
    ]
    frames = sorted(both[0].keys() & both[1].keys())
    own = ("frame", *POINT, *SIGMAS)
    further = [[str(c) for c in table if c not in own] for table in (primary, secondary)]
    renamed = further_names(*further)
    wanted = sample_of(frames, len(primary) / max(len(both[0]), 1))
    rows = [(both[0][f], both[1][f]) for f in sorted(wanted)]
    columns = stated_columns(names, *further)
    distinct = primary[list(columns)], secondary[list(columns)]
    known, _ = choose_names([TwoCameras(rig, rows)], distinct, columns, names != AUTO)
    given_px = None if threshold_px == "auto" else threshold_px
    chosen = choose_named_threshold(rig, rows, known, depths_m, sigma_px, given_px)
    found = [
        match_frame(
            rig,
            f,
            both[0][f],
            both[1][f],
            chosen.threshold_px,
            depths_m,
            renamed,
            chosen.noise,
            known,
        )[0]
        for f in frames
    ]
    if not found:
        return pd.DataFrame(columns=[*PAIR_COLUMNS, *renamed[0].values(), *renamed[1].values()])
    return pd.concat(found, ignore_index=True)


def further_names(primary: Sequence[str], secondary: Sequence[str]) -> list[dict[str, str]]:
    """The further columns of both inputs, and their names in the table of pairs.

    Unique names stay; names in both inputs or in `PAIR_COLUMNS` get the camera's name added.
    """
    taken = {*PAIR_COLUMNS} | ({*primary} & {*secondary})
    return [
        {name: f"{name}_{which}" if name in taken else name for name in names}
        for which, names in zip(CAMERAS, (primary, secondary), strict=True)
    ]


def match_frame(
    rig: RigParameters,
    frame: int,
    first: pd.DataFrame,
    second: pd.DataFrame,
    threshold: float,
    depths_m: tuple[float, float],
    names: Sequence[Mapping[str, str]],
    noise: PointNoise | None = None,
    known: Names = NO_NAMES,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Pairs and points without a partner of one frame; with `PAIR_SIGMAS` if the noise is known,
    and with `WITHIN` if the points have names.
    """
    primary, secondary = pixels_of(first), pixels_of(second)
    if known.columns:
        groups = known.groups(first, second)
        found = match_groups(rig, primary, secondary, groups, threshold, depths_m)
    else:
        found = match_points(rig, primary, secondary, threshold, depths_m)
    i, j = found.primary, found.secondary
    columns: dict[str, Any] = {
        "frame": np.full(len(found), frame),
        **dict(zip(PIXELS, np.column_stack([primary[i], secondary[j]]).T, strict=True)),
        "error_px": found.error_px.round(ERROR_DECIMALS),
        "runner_up_px": found.runner_up_px.round(ERROR_DECIMALS),
        "ambiguous": found.ambiguous,
        **({WITHIN: found.error_px <= threshold} if known.columns else {}),
    }
    for name, table, at in zip(sigma_columns(noise), (first, second), (i, j), strict=False):
        assert noise is not None
        by_column = noise.source == "columns" and SIGMA in table
        columns[name] = table[SIGMA].array[at] if by_column else np.full(len(at), noise.sigma_px)
    lonely = []
    left = (found.unmatched_primary, found.unmatched_secondary)
    for k, (which, table) in enumerate(zip(CAMERAS, (first, second), strict=True)):
        columns |= {new: table[name].array[(i, j)[k]] for name, new in names[k].items()}
        alone = table.iloc[left[k]].copy()
        alone.insert(0, "camera", which)
        lonely.append(alone)
    return pd.DataFrame(columns), pd.concat(lonely)


def sigma_columns(noise: PointNoise | None) -> tuple[str, ...]:
    """`PAIR_SIGMAS`, if the noise is that of the points."""
    return PAIR_SIGMAS if noise is not None and noise.source != "calibration" else ()


def pixels_of(table: pd.DataFrame) -> FloatArray:
    """(n, 2) raw pixels of a table of points."""
    pixels: FloatArray = table[list(POINT)].to_numpy(dtype=np.float64)
    return pixels
