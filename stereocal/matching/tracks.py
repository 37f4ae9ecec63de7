"""Match the points of three cameras and more: the table of tracks."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pandas as pd

from stereocal.matching.names import AUTO, Names, TwoCameras, choose_names
from stereocal.matching.pairs import ERROR_DECIMALS, Stated, further_of
from stereocal.matching.point_noise import PointNoise, check_sigma, on_far
from stereocal.matching.point_table import POINT, pixels_of, together
from stereocal.matching.tables_by_camera import Report, TablesByCamera, pixel_columns
from stereocal.matching.threshold import choose_threshold
from stereocal.matching.view_groups import ViewFitter, expected_wrong, images_of_groups, match_views
from stereocal.network.rig_file import RigFile
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
class TrackMatching:
    """How the points of several cameras are matched: what is settled before the first frame."""

    fitter: ViewFitter
    cameras: tuple[str, ...]
    """Those whose points are given."""
    columns: list[str]
    """Of the table of tracks."""
    names: Names
    stated_px: float | None
    """The noise of the points as stated."""
    sigma_px: float
    """As stated, else by two of the cameras, before all are matched."""
    wrong: Mapping[int, float]
    """Share of wrong tracks, at most about, by the number of cameras; empty if unknown."""
    contradiction: str = ""
    """A note on names that the images contradict."""

    @classmethod
    def of_tables(cls, rig: RigFile, given: TablesByCamera, stated: Stated) -> "TrackMatching":
        """The names that decide, and the noise, by a sample of the frames."""
        check_sigma(stated.sigma_px)
        some = given.frames[:: max(len(given.frames) // SAMPLE_FRAMES, 1)].tolist()
        by_two, frames = _samples(rig, given, some)
        fitter = ViewFitter(rig)
        names, note = choose_names(by_two, given.distinct, given.columns, stated.names != AUTO)
        sigma_px = max(stated.sigma_px or _noise_of_two(rig, by_two[0], names), 1e-3)
        wrong: Mapping[int, float] = {}
        if len(given.frames) >= FEWEST_DECOYS:
            points, numbers = zip(*(_images(rig, names, rows) for rows in frames), strict=True)
            wrong = expected_wrong(fitter, points, sigma_px, numbers)
        further = [
            f"{column}_{name}" for name, each in given.tables.items() for column in each.further
        ]
        columns = ["frame", *pixel_columns(rig), *OF_TRACKS, *further]
        called = tuple(given.tables)
        return cls(fitter, called, columns, names, stated.sigma_px, sigma_px, wrong, note)

    @property
    def rig(self) -> RigFile:
        return self.fitter.rig

    def match_frame(
        self, frame: int, rows: Sequence[pd.DataFrame]
    ) -> tuple[pd.DataFrame, list[IntArray]]:
        """Tracks of one frame, and the rows (n,) of each camera without a partner.

        Args:
            rows: of the cameras whose points are given.
        """
        by_camera = dict(zip(self.cameras, rows, strict=True))
        points, numbers = _images(self.rig, self.names, by_camera)
        found = match_views(self.fitter, points, self.sigma_px, numbers)
        pixels = pixel_columns(self.rig)
        images = images_of_groups(found.images, points).reshape(-1, len(pixels))
        tracks = pd.DataFrame(images, columns=pixels)
        tracks["frame"] = frame
        tracks["views"], tracks["ambiguous"] = found.views, found.ambiguous
        tracks["error_px"] = found.error_px.round(ERROR_DECIMALS)
        tracks[CHI_SQUARE] = found.chi_square
        left = []
        for name, table in by_camera.items():
            image = found.images[:, self.rig.names.index(name)]
            left.append(np.setdiff1d(np.arange(len(table)), image))
            for column in further_of(table):
                values = table[column].tolist()
                own = [None if k < 0 else values[k] for k in image.tolist()]
                tracks[f"{column}_{name}"] = pd.Series(own, dtype=object)  # 1 does not become 1.0
        return tracks, left

    def tally(self, tracks: pd.DataFrame) -> pd.DataFrame:
        """What the report needs of tracks."""
        return tracks[["views", "ambiguous", CHI_SQUARE]]

    def report(self, tallies: Sequence[pd.DataFrame], given: TablesByCamera) -> Report:
        """What was found in all frames."""
        tracks = together(tallies)
        views = tracks["views"].to_numpy(dtype=np.int64)
        chi_square = tracks[CHI_SQUARE].to_numpy(dtype=np.float64)
        noise = noise_of_tracks(self.rig, views, chi_square, self.stated_px)
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
            f"{count(len(tracks), 'point')} in {count(len(given.frames), 'frame')}{by}: "
            f"{seen} cameras; "
            f"{tracks['ambiguous'].sum()} ambiguous (another partner fits as well).",
            f"At most about {wrong} are wrong."
            if wrong
            else "What share of them is wrong cannot be told from so few frames.",
        ]
        far = on_far(noise.sigma_px, self.rig.noise_px) if noise.source == "estimated" else ""
        notes = [*filter(None, [self.contradiction, far]), *given.left_out.values()]
        return Report(len(tracks), sentences, notes, names=self.names)


def noise_of_tracks(
    rig: RigFile, views: IntArray, chi_square: FloatArray, sigma_px: float | None = None
) -> PointNoise:
    """As stated, else by the errors of points in all cameras; that of the targets of few points.

    Args:
        views, chi_square: (n,) of the points, as of `view_groups.Measured`.
    """
    if sigma_px is not None:
        return PointNoise(sigma_px, "stated")
    known = np.isfinite(chi_square)
    if known.sum() < FEWEST_POINTS:
        return PointNoise(rig.noise_px, "calibration")
    # robust: the median of each chi-square over that of its distribution, (1 - 2 / 9 k)^3 k
    freedom = 2.0 * views[known] - 3.0
    median = freedom * (1 - 2 / (9 * freedom)) ** 3
    return PointNoise(float(np.sqrt(np.median(chi_square[known] / median))), "estimated")


def _images(rig: RigFile, names: Names, rows: Rows) -> tuple[list[FloatArray], list[IntArray]]:
    """Pixels (n, 2) of each camera of the rig in one frame, and the numbers (n,) of their names."""
    empty = pd.DataFrame(columns=[*POINT, *names.columns])
    seen = [rows.get(name, empty) for name in rig.names]
    return [pixels_of(table) for table in seen], [names.numbers(table) for table in seen]


def _samples(
    rig: RigFile, given: TablesByCamera, some: Sequence[int]
) -> tuple[list[TwoCameras], list[Rows]]:
    """Every two cameras, first those that see most points together; and the rows of some frames."""
    wanted = dict[CameraPair, list[int]]()
    for pair in combinations([name for name in rig.names if name in given.tables], 2):
        one, other = (given.contents[name].frames for name in pair)
        common = np.intersect1d(one, other)
        wanted[pair] = common[:: max(len(common) // SAMPLE_FRAMES, 1)].tolist()
    looked_at = {*some}.union(*wanted.values())
    seen, rows = Counter[CameraPair](), dict[int, Rows]()
    for frame, tables in given.side_by_side():
        own = dict(zip(given.tables, tables, strict=True))
        for pair in wanted:
            seen[pair] += min(len(own[name]) for name in pair)
        if frame in looked_at:
            rows[frame] = own
    columns = [*POINT, *given.columns]
    by_two = [
        TwoCameras(
            rig.pair(a, b),
            [(rows[k][a][columns], rows[k][b][columns]) for k in wanted[a, b]],
            f" of the cameras {listed((a, b))}",
        )
        for a, b in sorted(wanted, key=lambda pair: -seen[pair])
    ]
    return by_two, [rows[frame] for frame in some]


def _noise_of_two(rig: RigFile, two: TwoCameras, names: Names) -> float:
    """The noise of the points by two cameras, before all are matched."""
    found = choose_threshold(two.rig, [px for both in two.sample for px in names.samples(*both)])
    return found.noise.sigma_px if found.noise else rig.noise_px
