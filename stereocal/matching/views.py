"""What is done with the points that N cameras see, and what is special of two.

Points of N cameras belong together in groups whose images fit one point, the one of least squares.
With a parameter set of two, pairs below a threshold do, and a point is the midpoint of its rays.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd
from scipy.special import chdtri

from stereocal.fit.rig_file import Parameters
from stereocal.matching.in_step import pairs_in_step
from stereocal.matching.matching import ANY_DEPTH, purpose_warning
from stereocal.matching.pairs import BelowThreshold, names_and_threshold, sample_frames
from stereocal.matching.point_noise import (
    FEWEST_PAIRS,
    PointNoise,
    fit_noise,
    noise_of_calibration,
    on_far,
    pair_errors,
)
from stereocal.matching.point_table import PAIR_SIGMAS, POINT, SIGMAS, PointTable, pixels_of
from stereocal.matching.reconstruction import Measured, Noise, midpoints
from stereocal.matching.settled import Matching, Settled, Stated
from stereocal.matching.tables_by_camera import Report, TablesByCamera, pixel_columns
from stereocal.matching.tracks import OF_TRACKS, InGroups, common_columns, noise_of_tracks
from stereocal.matching.trajectories import TRACK
from stereocal.matching.view_groups import LOST, ViewFitter
from stereocal.rig.correspondences import PIXELS
from stereocal.rig.parameters import RigParameters
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import count, rounded
from stereocal.verdict.in_words import listed

PAIRS, TRACKS = "pairs.csv", "tracks.csv"
OF_MATCHING = ("error_px", "runner_up_px")
"""Errors by the matching's parameters, not passed on; the points have their own error."""
FAR_OFF = 0.05
"""A median error above this fraction of the image's diagonal means another rig."""
LARGE_ERRORS = " The 3D set is fitted to lengths; its reprojection errors may be large."
Tables = Mapping[str, pd.DataFrame]
"""The points of each camera."""
SAMPLE_PAIRS = 4000
"""Pairs that show the noise."""


class Views:
    """The points that N cameras see."""

    TABLE: ClassVar[str] = TRACKS
    """Name of the table of what belongs together."""
    SOURCE: ClassVar[str] = "of_track"
    """Added in the table of points to a name that is taken there."""
    MAY_LACK: ClassVar[bool] = True
    """Whether a camera may see nothing of a row."""
    COUNTED: ClassVar[tuple[str, ...]] = ("views",)
    """Columns of the table of points for the number of cameras."""
    AT_ONCE: ClassVar[bool] = True
    """Whether all are measured at once, as noise and columns that are passed on may need."""
    IN_PAIRS: ClassVar[bool] = False
    """Whether points of two cameras are joined in pairs."""
    SECONDS: ClassVar[tuple[float, float, float]] = 0.012, 0.0, 1e-4
    """CPU time per frame, per row, and per pair of images of one frame: 60 frames of three cameras
    and three points took 1.4 s."""
    NONE_FOUND: ClassVar[str] = (
        "No two points of different cameras belong together: make sure that the points and the "
        "cameras are not exchanged, and that the points are of the same frames; or state the "
        "noise of the points, if they are less exact."
    )
    """Why nothing belongs together, and what to do; of two cameras with the threshold."""

    def __init__(self, rig: Parameters) -> None:
        self.rig = rig

    @property
    def seconds(self) -> tuple[float, float, float]:
        """`SECONDS` of the rig."""
        return self.SECONDS

    @cached_property
    def _fitter(self) -> ViewFitter:
        return ViewFitter(self.rig)

    # Matching

    def settled(self, by_camera: TablesByCamera, stated: Stated) -> Matching:
        """How the points of tables are matched."""
        return InGroups.of_tables(self._fitter, by_camera, stated)

    def settled_by_hand(self, tables: Tables, stated: Stated, usual_px: float) -> Settled:
        """The noise of points that a person clicked, and the threshold.

        Args:
            tables: by camera, in step, with a column `TRACK`.
            usual_px: the noise of points that do not show their own.
        """
        _, pixels = points_of_names(tables, self.rig.placed)
        chi_square = self.fit(pixels).chi_square
        noise = noise_of_tracks(self.rig, cameras_of(pixels), chi_square, stated.sigma_px)
        return Settled(noise.sigma_px if noise.source == "estimated" else usual_px)

    def errors_px(self, pixels: FloatArray, settled: Settled) -> tuple[FloatArray, FloatArray]:
        """(n,) each: reprojection errors, and the largest of images of one point.

        Args:
            pixels: (n, c, 2), NaN where a camera does not see a point.
        """
        views = cameras_of(pixels)
        limits = settled.sigma_px * np.sqrt(chdtri(2.0 * views - 3.0, LOST) / views)
        return np.sqrt(self.fit(pixels).chi_square / views), limits

    # Measuring

    def table(self, source: Path | pd.DataFrame, label: str | None = None) -> PointTable:
        """A table of what belongs together, with the images of all cameras in a row."""
        return PointTable(source, pixel_columns(self.rig), label, self.MAY_LACK)

    def fit(self, pixels: FloatArray, sigma_px: Noise = None) -> Measured:
        """Points of images (n, c, 2), NaN where a camera does not see one."""
        sigma = None if sigma_px is None else float(np.max(sigma_px))
        return self._fitter.fit(pixels, self._fitter.rays(pixels), sigma)

    def in_step(self, table: PointTable) -> tuple[PointTable, str]:
        """What belongs together, at the instants of the first camera, and what was done."""
        return table, ""

    def noise_of(self, sample: pd.DataFrame, sigma_px: float | None = None) -> PointNoise | None:
        """The noise of what belongs together; None if nothing is known of it.

        Args:
            sigma_px: the noise, if it is known.
        """
        pixels = self.pixels(sample)
        chi_square = self.fit(pixels).chi_square if sigma_px is None else np.empty(0)
        return noise_of_tracks(self.rig, cameras_of(pixels), chi_square, sigma_px)

    def pixels(self, table: pd.DataFrame) -> FloatArray:
        """(n, c, 2): of all cameras; NaN where one does not see a point."""
        pixels = pixels_of(table, pixel_columns(self.rig)).reshape(len(table), -1, 2)
        return np.where(np.isfinite(pixels).all(axis=2, keepdims=True), pixels, np.nan)

    def passed(self, table: pd.DataFrame) -> pd.DataFrame:
        """The columns that the points get too."""
        written = ["frame", *pixel_columns(self.rig), *OF_TRACKS]
        return common_columns(table.drop(columns=written, errors="ignore"), [*self.rig.placed])

    def report(self, errors: FloatArray, outside: int, noise: PointNoise | None) -> Report:
        """The result of measuring, by the errors (n,) of all points, NaN where there is none."""
        lost, median = _lost_and_median(errors)
        behind = f"; {lost} do not meet in front of the cameras" if lost else ""
        beyond = (
            f" {outside} lie outside the volume that the object filled, where errors can be "
            "larger than stated."
        )
        assert noise is not None  # a rig states that of its targets
        sentence = (
            f"{len(errors) - lost} points, median reprojection error {rounded(median, 3)} px"
            f"{behind}.{beyond * bool(outside)} Standard errors are for points known to "
            f"{rounded(noise.sigma_px)} px."
        )
        return Report(len(errors), [sentence], lost=lost)

    # What a result is made with

    def used(self, _measuring: Parameters) -> dict[str, Any]:
        """Method and digest of what matches and what measures, with two cameras."""
        return {}

    def in_words(
        self, files: Sequence[str], _measuring: Parameters, _threshold_px: float, _stated: Stated
    ) -> str:
        """What matches and measures, by the names of the parameter files."""
        return f"matched and measured with {files[0]}, cameras {listed([*self.rig.placed])}"


class TwoViews(Views):
    """The points of two cameras, with a set to match and one to measure with."""

    IN_PAIRS = True
    MAY_LACK = False
    TABLE, SOURCE, COUNTED, AT_ONCE = PAIRS, "of_pair", (), False
    SECONDS = 3.5e-3, 2.2e-5, 1.5e-9
    """Within 10 % of the measured 1.4 s for 400 frames of 3 points and 11.6 s for 200 frames of
    1,000."""
    BEHIND_WINDOWS = 2.2e-7
    """In place of the last of them: 0.9 us for each of 300 x 300 pairs."""
    NONE_FOUND = (
        "No pair of points has an error of {} px or less: raise the threshold, or make sure that "
        "points, parameters and the two cameras (primary, secondary) belong together."
    )

    def __init__(self, rig: RigParameters) -> None:
        super().__init__(rig)
        self.pair = rig

    @property
    def seconds(self) -> tuple[float, float, float]:
        return (*self.SECONDS[:2], self.BEHIND_WINDOWS) if self.pair.has_windows else self.SECONDS

    def settled(self, by_camera: TablesByCamera, stated: Stated) -> Matching:
        return BelowThreshold.of_tables(self.pair, by_camera, stated)

    def settled_by_hand(self, tables: Tables, stated: Stated, usual_px: float) -> Settled:
        first, second = tables.values()
        sample, distinct = sample_frames(first, second), [first[[TRACK]], second[[TRACK]]]
        *_, chosen = names_and_threshold(self.pair, sample, distinct, stated)
        return Settled(chosen.noise.sigma_px if chosen.noise else usual_px, chosen.threshold_px)

    def errors_px(self, pixels: FloatArray, settled: Settled) -> tuple[FloatArray, FloatArray]:
        errors = self.pair.reprojection_errors(pixels[:, 0], pixels[:, 1]).mean(axis=1)
        return errors, np.full(len(errors), settled.threshold_px)

    def fit(self, pixels: FloatArray, sigma_px: Noise = None) -> Measured:
        return midpoints(self.pair, pixels, sigma_px)

    def in_step(self, table: PointTable) -> tuple[PointTable, str]:
        return pairs_in_step(table, self.pair)

    def noise_of(self, sample: pd.DataFrame, sigma_px: float | None = None) -> PointNoise | None:
        """The noise of pairs by their columns, else by their errors, else that of the calibration.

        Pairs were matched below some threshold, and what lies beyond it is missing: the estimate
        takes the largest error for the threshold.
        """
        if sigma_px is not None:
            return PointNoise(sigma_px, "stated")
        if set(PAIR_SIGMAS) <= set(sample):
            stated = sample[list(PAIR_SIGMAS)].to_numpy(dtype=np.float64)
            if np.isfinite(stated).any():
                return PointNoise(float(np.sqrt(np.nanmean(stated**2))), "columns")
        thin = sample.iloc[:: max(len(sample) // SAMPLE_PAIRS, 1)]
        pixels = thin[list(PIXELS)].to_numpy(dtype=np.float64)
        errors = pair_errors(self.pair, pixels[:, :2], pixels[:, 2:], thin["frame"].to_numpy())
        if len(errors) >= FEWEST_PAIRS:
            limit = errors.error_px.max() / np.quantile(errors.relative, 0.99)
            mixture = fit_noise(errors, float(limit))
            if mixture is not None and mixture.is_clear:
                return PointNoise(mixture.deviation, "estimated", mixture.relative_error)
        return noise_of_calibration(self.pair)

    def passed(self, table: pd.DataFrame) -> pd.DataFrame:
        return table.drop(columns=["frame", *PIXELS, *OF_MATCHING, *SIGMAS], errors="ignore")

    def report(self, errors: FloatArray, outside: int, noise: PointNoise | None) -> Report:
        lost, median = _lost_and_median(errors)
        notes = [*filter(None, [purpose_warning(self.pair, "reconstruction")])]
        diagonal = float(np.hypot(*self.pair.primary.image_size))
        targets = noise_of_calibration(self.pair)
        if lost > len(errors) / 2 or median > FAR_OFF * diagonal:
            notes.append(
                "Most pairs do not fit these parameters at all: make sure that both are of the "
                "same rig, and that primary and secondary are not exchanged."
            )
        elif self.pair.purpose != "reconstruction":
            notes += filter(None, [on_far(median, targets.sigma_px if targets else None)])
        behind = f"; {count(lost, 'pair', 'do')} not meet in front of both cameras" * bool(lost)
        measured = len(errors) - lost
        error = f"median reprojection error {rounded(median, 3)} px"
        text = f"{count(measured, 'point')}, {error}{behind}."
        if self.pair.purpose == "reconstruction":
            text += LARGE_ERRORS
        if self.pair.volume is not None:
            filled = f"outside the volume that the bars filled ({self.pair.volume.depths})"
            beyond = (
                f"{outside} of {measured} points {'lies' if outside == 1 else 'lie'} {filled}; "
                "errors there can be larger than stated."
            )
            text = f"{text} {beyond if outside else f'No point lies {filled}.'}"
        return Report(len(errors), [text, _on_errors(noise)], notes, lost)

    def used(self, measuring: Parameters) -> dict[str, Any]:
        sets = {"matching": self.pair, "measuring": measuring.pair(*measuring.placed)}
        return {use: [chosen.method, chosen.digest] for use, chosen in sets.items()}

    def in_words(
        self, files: Sequence[str], measuring: Parameters, threshold_px: float, stated: Stated
    ) -> str:
        near, far = stated.depths_m
        depths = "" if (near, far) == ANY_DEPTH else f", depths from {near:g} to {far:g} m"
        return (
            f"matched with {files[0]} ({self.pair.set_name}), threshold "
            f"{rounded(threshold_px, 3)} px{depths}; measured with {files[1]} "
            f"({measuring.pair(*measuring.placed).set_name})"
        )


def views_of(rig: Parameters) -> Views:
    """What is done with the points of some cameras: the one place that asks whether they are two
    with a parameter set."""
    return TwoViews(rig) if isinstance(rig, RigParameters) else Views(rig)


def cameras_of(pixels: FloatArray) -> IntArray:
    """(n,): the number of cameras that see each point, of pixels (n, c, 2)."""
    return np.asarray(np.isfinite(pixels[..., 0]).sum(axis=1))


def points_of_names(
    tables: Tables, cameras: Iterable[str], values: Sequence[str] = POINT
) -> tuple[pd.Index, FloatArray]:
    """Frame and `TRACK` of each point that two cameras or more have, and its pixels (n, c, 2), or
    what other columns hold; NaN where a camera has none."""
    rows = pd.concat([table.assign(camera=camera) for camera, table in tables.items()])
    wide = rows.pivot_table(index=["frame", TRACK], columns="camera", values=[*values])
    columns = [(axis, camera) for camera in cameras for axis in values]
    pixels = wide.reindex(columns=columns).to_numpy(np.float64).reshape(len(wide), -1, len(values))
    seen = cameras_of(pixels) > 1
    return wide.index[seen], pixels[seen]


def _lost_and_median(errors: FloatArray) -> tuple[int, float]:
    """The number of points that there are not, and the median error of the others."""
    lost = int(np.isnan(errors).sum())
    return lost, float(np.nanmedian(errors)) if lost < len(errors) else float("nan")


def _on_errors(noise: PointNoise | None) -> str:
    """What the standard errors rest on."""
    if noise is None:
        return "No standard errors: the noise of the points is unknown. State it in pixels."
    words = (
        "The standard errors contain those of pose and lenses, which neighbouring points "
        f"share; the points are known to {noise.in_words}"
    )
    if noise.source != "calibration":
        return f"{words}.{noise.disagreement}"
    return (
        f"{words}: that of the targets, because the pairs do not show their own. If your "
        "points are less exact, state their noise."
    )
