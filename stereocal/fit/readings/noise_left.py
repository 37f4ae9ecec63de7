"""The noise in pixels that a reading of what was given would leave: one robust fit of the cameras
that share bars, from the essential matrices of pairs, with the baselines free and the lengths held.

Enough of the frames and points tell. A lens that the fit moves far from its prior, and a camera
that would stand on its head, count as noise.
"""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from stereocal.calibration.corrections import fitting_px, some_corners
from stereocal.calibration.reading import ESTIMATED_HANDICAP
from stereocal.calibration.wrong_inputs import PoseFit, essential_fit
from stereocal.errors import StereocalError
from stereocal.fit.least_squares.robust import RobustFit
from stereocal.fit.least_squares.small_steps import camera_at
from stereocal.fit.least_squares.unknowns import LensPrior, RefineSettings, of_some
from stereocal.fit.refine import refine
from stereocal.fit.refined_result import RefinedResult
from stereocal.fit.start.fuse import PairFit, chained
from stereocal.fit.start.pairs import (
    FEWEST_BARS,
    bars_by_frame,
    groups_of,
    pairs_worth_a_fit,
    reached,
)
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import AT_ORIGIN, Pose, on_their_heads
from stereocal.rig.recording import CameraPair, Recording
from stereocal.system.sampling import evenly_spread

HELD_LENGTHS = 1e-3
"""Scatter of the bars, as a fraction: what is wrong must show in pixels."""
MOST_STEPS = 30
CONTRADICTED = 30.0
"""Chi-square of the lenses about the stated ones: above it the images contradict the files."""
ALIKE = ESTIMATED_HANDICAP
"""Readings whose noise differs by less explain the data equally well: one camera's focal length is
too long, or the other's too short. So do u and v from the other side, but for a camera that would
stand on its head; that counts as so many times the noise."""
LARGEST_EXPONENT = 20.0
"""Of the factor for priors: more than exp(20) fits as little."""
MOST_FRAMES = 75
"""Are enough to tell; of longer recordings so many, evenly spread."""
LEAST_BARS = 16
"""Of two cameras, or all that they share."""
MOST_POINTS = 9
"""Of an object."""
PARTS = 4
"""In time, each of which must fit: where a camera moved, many a reading fits half of the frames."""
CLEAN, CLEAN_PX = 3.0, 0.5
"""A reading that explains the points leaves at most so many times the noise of its best pair, or
this many pixels."""
QUICK_PAIRS = 2
"""Of a camera."""
FAR = 4.0
"""Times the largest noise that fits: an essential matrix that leaves more is not worth a fit. It is
not robust: three frames of 25 that contradict the others may leave so much."""


@dataclass(frozen=True)
class NoiseLeft:
    """What a fit leaves."""

    px: float = np.inf
    largest_px: float = 0.0
    """The largest that is noise of image points."""
    of_lenses: float = 0.0
    """Chi-square of the lenses about the stated ones."""
    cameras: Mapping[str, Camera] | None = None
    """As fitted; None where nothing fits."""
    pairs: tuple[PairFit, ...] = ()
    """From which it began."""

    @property
    def fits(self) -> bool:
        """Whether it is noise of image points, of lenses that are as their files say."""
        return self.px < self.largest_px and self.of_lenses < CONTRADICTED


def fewer_points(recording: Recording) -> Recording:
    """The recording with enough of the frames in which cameras see a bar together, and of a large
    object's points; of cameras that share few bars, with all frames."""
    frames, images = recording.images()
    common = np.flatnonzero((np.isfinite(images[..., 0]).sum(axis=2) > 1).any(axis=1))
    worth = pairs_worth_a_fit(recording)
    if len(common) > MOST_FRAMES:
        names, bars = list(recording.cameras), bars_by_frame(recording)
        common = common[evenly_spread(len(common), MOST_FRAMES)]
        for pair in worth:
            of_pair = np.flatnonzero(bars[:, names.index(pair[0]), names.index(pair[1])])
            if np.isin(of_pair, common).sum() < LEAST_BARS:
                common = np.union1d(common, of_pair[evenly_spread(len(of_pair), LEAST_BARS)])
    kept = np.isin(recording.frame, frames[common])
    count, board = len(recording.object.names), recording.object.board
    if board is None:
        chosen = np.union1d(evenly_spread(count, MOST_POINTS), recording.object.longest)
        return recording.where(kept & np.isin(recording.target, chosen))
    fewer = recording.where(kept & np.isin(recording.target, some_corners(board)))
    # Of a few boards, or of hidden ones, all corners.
    return fewer if {*worth} <= {*pairs_worth_a_fit(fewer)} else recording.where(kept)


def largest_noise(recording: Recording, best_pair_px: float) -> float:
    """The largest noise that cameras which fit together leave, in pixels."""
    return min(max(CLEAN * best_pair_px, CLEAN_PX), fitting_px(recording.cameras.values()))


def quick_fits(
    recording: Recording, names: Iterable[str], bars: Iterable[CameraPair]
) -> dict[CameraPair, PoseFit]:
    """The essential matrices of some cameras with others; not of a pair whose lenses cannot be
    inverted at its points."""
    pairs = {pair for name in names for pair in [it for it in bars if name in it][:QUICK_PAIRS]}
    fits = dict[CameraPair, PoseFit]()
    for pair in pairs:
        with suppress(StereocalError):
            fits[pair] = essential_fit(recording.pair(*pair))
    return fits


def mean_px(quick: Mapping[CameraPair, PoseFit]) -> float:
    """The mean reprojection error; infinite where there is none."""
    return float(np.mean([fit.px for fit in quick.values()])) if quick else np.inf


def noise_of(
    recording: Recording,
    known: Iterable[PairFit] = (),
    quick: Mapping[CameraPair, PoseFit] | None = None,
    lenses: Mapping[str, LensPrior] | None = None,
) -> NoiseLeft:
    """What the fit of all cameras leaves, from fits of pairs; infinite where none fits.

    Args:
        known: fits of pairs.
        quick: essential matrices of pairs.
        lenses: priors other than the usual ones.
    """
    names, quick, lenses = list(recording.cameras), quick or {}, lenses or {}
    with suppress(StereocalError, np.linalg.LinAlgError):
        if len(names) == 2:  # the fit of the pair is that of all
            pair = fit_of_pair(recording, (names[0], names[1]), quick, lenses)
            cameras = dict(zip(names, (pair.primary, pair.secondary), strict=True))
            largest = fitting_px(cameras.values())  # there is no better pair
            poses = [AT_ORIGIN, pair.pose]
            return _noise_left(pair, pair.sigma_px.value, poses, largest, cameras)
        pairs = _first_pairs(recording, known, quick, lenses)
        if len(reached(names, [pair.pair for pair in pairs])) < len(names):
            return NoiseLeft()
        free, held = replace(recording, baselines_m={}), _held(recording.object.longest_m)
        fit = RobustFit.of(free, chained(names, pairs), replace(held, lenses=lenses))
        least = min(pair.noise_px for pair in pairs)
        fit.start_at({}, least)
        if fit.run() and fit.is_determined:
            numbered, at = enumerate(recording.cameras.items()), fit.at
            cameras = {name: camera_at(camera, at, number) for number, (name, camera) in numbered}
            largest = largest_noise(recording, least)
            noise = _noise_left(fit, fit.sigma_px, fit.poses, largest, cameras)
            return replace(noise, pairs=tuple(pairs))
    return NoiseLeft()


def _noise_left(
    fit: RefinedResult | RobustFit,
    sigma_px: float,
    poses: Sequence[Pose],
    largest_px: float,
    cameras: Mapping[str, Camera],
) -> NoiseLeft:
    """The noise in pixels with which half of the frames fit, in the worst part in time; values far
    from their priors, and a camera that would stand on its head, count as noise.

    sigma sqrt(m) exp(P / 2 n), m being the median over the frames of chi-square over its own
    median, P the cost of the priors and n the degrees of freedom: of n residuals with the standard
    deviation s, the likelihood s^-n exp(-P / 2) falls as if s were larger by exp(P / 2 n).
    """
    parts = PARTS if len(fit.frames) >= PARTS * FEWEST_BARS else 1
    over_median = fit.chi_squares / chdtri(np.maximum(fit.degrees_of_freedom, 1), 0.5)
    of_half = max(float(np.median(part)) for part in np.array_split(over_median, parts))
    exponent = fit.prior_cost / (2.0 * fit.degrees_of_freedom.sum())
    of_priors = np.exp(min(exponent, LARGEST_EXPONENT))
    on_head = ALIKE if on_their_heads(poses) else 1.0
    px = float(sigma_px * np.sqrt(of_half) * of_priors * on_head)
    return NoiseLeft(px, largest_px, fit.prior_cost, cameras)


def _first_pairs(
    recording: Recording,
    known: Iterable[PairFit],
    quick: Mapping[CameraPair, PoseFit],
    lenses: Mapping[str, LensPrior],
) -> list[PairFit]:
    """Sound pairs that connect the cameras, those with the most bars."""
    fits, names = [*known], [*recording.cameras]
    limit = fitting_px(recording.cameras.values())
    if len(reached(names, [fit.pair for fit in fits])) == len(names):
        return sorted(fits, key=lambda fit: fit.noise_px)
    near = {
        pair: quick[pair] if pair in quick else essential_fit(recording.pair(*pair))
        for pair in pairs_worth_a_fit(recording)
    }
    far = FAR * min((fit.px for fit in near.values()), default=np.inf)
    for pair, start in near.items():
        if not start.px < far or pair[1] in groups_of(names, [fit.pair for fit in fits])[pair[0]]:
            continue
        with suppress(StereocalError, np.linalg.LinAlgError):
            fit = fit_of_pair(recording, pair, near, lenses)
            if fit.sigma_px.value < limit:
                fits.append(PairFit.of(pair, fit))
    return sorted(fits, key=lambda fit: fit.noise_px)


def _held(longest_m: float) -> RefineSettings:
    """The settings of a fit whose lengths are held."""
    return RefineSettings(
        baseline_sigma_m=np.inf, scatter_m=HELD_LENGTHS * longest_m, maximum_steps=MOST_STEPS
    )


def fit_of_pair(
    recording: Recording,
    pair: CameraPair,
    quick: Mapping[CameraPair, PoseFit],
    lenses: Mapping[str, LensPrior],
) -> RefinedResult:
    """The fit of two cameras, as of `noise_of`, from their essential matrix."""
    dataset, start = recording.pair(*pair), None
    near = quick[pair] if pair in quick else essential_fit(dataset)
    if near.pose is not None:  # so that a baseline that is wrong hinders no reading
        dataset = dataset.changed(baseline_m=near.scale * dataset.baseline_m)
        start = Pose(near.pose.R, near.scale * near.pose.T)
    held = replace(_held(dataset.target_distance_m), lenses=lenses)
    return refine(dataset, of_some(recording, held, pair), start)
