"""Match the points of three cameras and more: the table of tracks."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from stereocal.fit.rig_file import Parameters
from stereocal.matching.names import AUTO, Names, TwoCameras, choose_names
from stereocal.matching.point_noise import PointNoise, check_sigma, on_far
from stereocal.matching.point_table import POINT, pixels_of
from stereocal.matching.settled import ERROR_DECIMALS, Matching, Stated
from stereocal.matching.tables_by_camera import Report, TablesByCamera, pixel_columns
from stereocal.matching.threshold import choose_threshold
from stereocal.matching.view_groups import ViewFitter, expected_wrong, match_views
from stereocal.rig.recording import CameraPair
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import count, rounded
from stereocal.verdict.in_words import listed

SAMPLE_FRAMES = 60
OF_TRACKS = ("views", "error_px", "ambiguous")
CHI_SQUARE = "chi_square"
"""Column of the tracks of a frame that shows the noise and is not written."""
FEWEST_DECOYS = 3
"""Frames without which the share of wrong groups is not estimated."""
FEWEST_POINTS = 20
"""Without which their noise is not estimated."""
Rows = Mapping[str, pd.DataFrame]
"""Of one frame, by camera."""


@dataclass(frozen=True, eq=False)
class InGroups(Matching):
    """Points of N cameras in groups, whose images fit one point by the noise of the points."""

    fitter: ViewFitter
    stated_px: float | None
    """The noise of the points as stated."""
    sigma_px: float
    """The noise, as stated, else by two of the cameras, before all are matched."""
    wrong: Mapping[int, float]
    """Share of wrong tracks, at most about, by the number of cameras; empty if unknown."""

    @classmethod
    def of_tables(cls, fitter: ViewFitter, by_camera: TablesByCamera, stated: Stated) -> "InGroups":
        """The names that decide, and the noise, by a sample of the frames."""
        check_sigma(stated.sigma_px)
        rig = fitter.rig
        some = by_camera.frames[:: max(len(by_camera.frames) // SAMPLE_FRAMES, 1)].tolist()
        by_two, frames = _samples(rig, by_camera, some)
        names, note = choose_names(
            by_two, by_camera.distinct, by_camera.columns, stated.names != AUTO, [*by_camera.tables]
        )
        sigma_px = max(stated.sigma_px or _noise_of_two(rig, by_two[0], names), 1e-3)
        wrong: Mapping[int, float] = {}
        if len(by_camera.frames) >= FEWEST_DECOYS:
            points, numbers = zip(*(_images(rig, names, rows) for rows in frames), strict=True)
            wrong = expected_wrong(fitter, points, sigma_px, numbers)
        tables = by_camera.tables
        further = [
            {key: f"{key}_{name}" for key in table.further} for name, table in tables.items()
        ]
        written = [name for renamed in further for name in renamed.values()]
        columns = ["frame", *pixel_columns(rig), *OF_TRACKS, *written]
        return cls(
            (*tables,),
            further,
            columns,
            ["views", "ambiguous", CHI_SQUARE],
            names,
            note,
            fitter,
            stated.sigma_px,
            sigma_px,
            wrong,
        )

    def groups(self, rows: Sequence[pd.DataFrame]) -> tuple[IntArray, dict[str, Any]]:
        by_camera = dict(zip(self.cameras, rows, strict=True))
        points, numbers = _images(self.fitter.rig, self.names, by_camera)
        groups = match_views(self.fitter, points, self.sigma_px, numbers)
        of_cameras = [self.fitter.names.index(name) for name in self.cameras]
        return groups.images[:, of_cameras], {
            "views": groups.views,
            "error_px": groups.error_px.round(ERROR_DECIMALS),
            "ambiguous": groups.ambiguous,
            CHI_SQUARE: groups.chi_square,
        }

    def report(self, reported: pd.DataFrame, by_camera: TablesByCamera) -> Report:
        rig, views = self.fitter.rig, reported["views"].to_numpy(dtype=np.int64)
        chi_square = reported[CHI_SQUARE].to_numpy(dtype=np.float64)
        noise = noise_of_tracks(rig, views, chi_square, self.stated_px)
        numbers = np.bincount(views)
        seen = ", ".join(f"{numbers[n]} by {n}" for n in np.flatnonzero(numbers)[::-1].tolist())
        wrong = ", ".join(
            f"{rounded(100 * share)} % of those seen by {n}" for n, share in self.wrong.items()
        )
        shown = f"{rounded(noise.sigma_px)} px"
        scatter = {
            "estimated": f"Your points scatter by {shown}.",
            "calibration": "Your points are too few to show their noise, so that of the targets is "
            f"used, {shown}.",
        }
        by = f", of one name ({self.names.in_words})" if self.names.columns else ""
        sentences = [
            scatter.get(noise.source, f"Your points scatter by {shown}, as stated."),
            f"{count(len(reported), 'point')} in {count(len(by_camera.frames), 'frame')}{by}: "
            f"{seen} cameras; "
            f"{reported['ambiguous'].sum()} ambiguous (another partner fits as well).",
            f"At most about {wrong} are wrong."
            if wrong
            else "The share of wrong ones cannot be estimated from so few frames.",
        ]
        far = on_far(noise.sigma_px, rig.noise_px) if noise.source == "estimated" else ""
        notes = [*filter(None, [self.contradiction, far]), *by_camera.left_out.values()]
        return Report(len(reported), sentences, notes, sigma_px=self.stated_px, names=self.names)


def noise_of_tracks(
    rig: Parameters, views: IntArray, chi_square: FloatArray, sigma_px: float | None = None
) -> PointNoise:
    """The noise as stated, else by the errors of points in all cameras; that of the targets if they
    are few.

    Args:
        views, chi_square: (n,) of the points, as of `view_groups.Measured`.
    """
    if sigma_px is not None:
        return PointNoise(sigma_px, "stated")
    known = np.isfinite(chi_square)
    if known.sum() < FEWEST_POINTS:
        return PointNoise(rig.noise_px or 0.0, "calibration")
    # robust: the median of each chi-square over that of its distribution, (1 - 2 / 9 k)^3 k
    freedom = 2.0 * views[known] - 3.0
    median = freedom * (1 - 2 / (9 * freedom)) ** 3
    return PointNoise(float(np.sqrt(np.median(chi_square[known] / median))), "estimated")


def _images(rig: Parameters, names: Names, rows: Rows) -> tuple[list[FloatArray], list[IntArray]]:
    """Pixels (n, 2) of each camera of the rig in one frame, and the numbers (n,) of their names."""
    empty = pd.DataFrame(columns=[*POINT, *names.columns])
    seen = [rows.get(name, empty) for name in rig.placed]
    return [pixels_of(table) for table in seen], [names.numbers(table) for table in seen]


def _samples(
    rig: Parameters, by_camera: TablesByCamera, some: Sequence[int]
) -> tuple[list[TwoCameras], list[Rows]]:
    """Every two cameras, first those that see most points together; and the rows of some frames."""
    wanted = dict[CameraPair, list[int]]()
    for pair in combinations([name for name in rig.placed if name in by_camera.tables], 2):
        one, other = (by_camera.contents[name].frames for name in pair)
        common = np.intersect1d(one, other)
        wanted[pair] = common[:: max(len(common) // SAMPLE_FRAMES, 1)].tolist()
    looked_at = {*some}.union(*wanted.values())
    seen, rows = Counter[CameraPair](), dict[int, Rows]()
    for frame, tables in by_camera.side_by_side():
        of_frame = dict(zip(by_camera.tables, tables, strict=True))
        for pair in wanted:
            seen[pair] += min(len(of_frame[name]) for name in pair)
        if frame in looked_at:
            rows[frame] = of_frame
    columns = [*POINT, *by_camera.columns]
    by_two = [
        TwoCameras(
            rig.pair(a, b),
            [(rows[k][a][columns], rows[k][b][columns]) for k in wanted[a, b]],
            f" of the cameras {listed((a, b))}",
        )
        for a, b in sorted(wanted, key=lambda pair: -seen[pair])
    ]
    return by_two, [rows[frame] for frame in some]


def _noise_of_two(rig: Parameters, two: TwoCameras, names: Names) -> float:
    """The noise of the points by two cameras, before all are matched."""
    choice = choose_threshold(two.rig, [px for both in two.sample for px in names.samples(*both)])
    return choice.noise.sigma_px if choice.noise else rig.noise_px or 0.0


def common_columns(further: pd.DataFrame, cameras: Sequence[str]) -> pd.DataFrame:
    """One column in place of those that end in the cameras' names: what all that have a value say;
    empty where they differ, and not there where none agree."""
    groups: dict[str, list[str]] = {}
    by_length = sorted(cameras, key=len, reverse=True)
    for name in map(str, further):
        camera = next((camera for camera in by_length if name.endswith(f"_{camera}")), None)
        groups.setdefault(name if camera is None else name[: -len(camera) - 1], []).append(name)
    columns = {}
    for stem, names in groups.items():
        values = further[names].where(further[names] != "")
        first = values.bfill(axis=1).iloc[:, 0]
        agree = (values.eq(first, axis=0) | values.isna()).all(axis=1) & first.notna()
        if agree.any():
            columns[stem] = first.where(agree, "")
    return pd.DataFrame(columns, index=further.index)
