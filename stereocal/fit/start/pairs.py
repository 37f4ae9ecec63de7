"""The pairs of a rig that are worth calibrating, and their refined sets."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from stereocal.errors import StereocalError
from stereocal.fit.least_squares.unknowns import RefineSettings, of_some
from stereocal.fit.refine import refine
from stereocal.fit.refined_result import RefinedResult
from stereocal.fit.screening.movement import Movement
from stereocal.fit.screening.screen import wide_settings
from stereocal.fit.screening.two_recordings import movement_of_pair
from stereocal.fit.start.free_baseline import with_rough_baseline
from stereocal.fit.start.fuse import PairFit
from stereocal.fit.timing.out_of_step import with_offset_if_out_of_step
from stereocal.fit.timing.time_offset import fit_time_offset
from stereocal.rig.recording import CameraPair, Recording
from stereocal.rig.rigid_object import FEWEST_TO_PLACE
from stereocal.system.array_types import BoolArray, IntArray
from stereocal.system.tasks import Progress

FEWEST_BARS = 8
"""Bars that two cameras must share: with fewer, their pose and lenses can fit wrong points too."""
FEWEST_BOARDS, MANY = 4, 80
"""Placings that are enough where two cameras share so many points in them: boards have more points
than bars."""
MOST_NOISE = 4.0
"""Of a sound pair, over the median of all pairs."""
LEAST_NOISE_PX = 2.0
"""A pair with less noise than this is sound."""
MOST_LEFT_OUT = 0.4
"""Of the frames of a sound pair."""
FURTHER_STEPS = 2
"""Of a rig, after its pairs: the joint fit that screens, and the adjustment."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """The refined sets of the pairs of a rig."""

    bars: Mapping[CameraPair, int]
    """Bars that both cameras see, of all pairs that share any."""
    fits: Mapping[CameraPair, PairFit]
    """Of the sound pairs, best first."""
    failed: Mapping[CameraPair, str] = field(default_factory=dict)
    """Pairs with enough bars and no sound fit, and why."""
    moved: Mapping[CameraPair, Movement] = field(default_factory=dict)
    """Those of them before which a camera moved."""
    out_of_step: bool = False
    """Whether a pair was found out of step though that was not asked; then there are no fits."""


def pair_name(pair: CameraPair) -> str:
    """The name of a pair, such as `left-right`."""
    return "-".join(pair)


def shared_bars(recording: Recording) -> dict[CameraPair, int]:
    """How many bars each pair of cameras sees, of all pairs that see any; most first."""
    counts, names = bars_by_frame(recording).sum(axis=0), list(recording.cameras)
    pairs = combinations(range(len(names)), 2)
    bars = {(names[i], names[j]): int(counts[i, j]) for i, j in pairs if counts[i, j]}
    return dict(sorted(bars.items(), key=lambda item: -item[1]))


def bars_by_frame(recording: Recording) -> BoolArray:
    """(f, c, c): in which frames two cameras see a bar together, or enough of a board."""
    seen = np.isfinite(recording.images()[1][..., 0])
    if recording.object.board is None:
        whole: BoolArray = np.asarray(seen[:, list(recording.object.longest)].all(axis=1))
        return np.asarray(whole[:, :, None] & whole[:, None])
    # A board of which some corners are hidden is one too.
    return np.asarray(_common_points(seen) >= FEWEST_TO_PLACE)


def _common_points(seen: BoolArray) -> IntArray:
    """(f, c, c): how many points (f, k, c) two cameras see in each frame."""
    points = seen.astype(np.int64)
    return np.asarray(points.transpose(0, 2, 1) @ points)


def pairs_worth_a_fit(recording: Recording) -> list[CameraPair]:
    """The pairs that share enough bars, or fewer placings of an object with many points; the most
    bars first."""
    names = list(recording.cameras)
    points = _common_points(np.isfinite(recording.images()[1][..., 0])).sum(axis=0)
    return [
        pair
        for pair, bars in shared_bars(recording).items()
        if bars >= FEWEST_BARS
        or (bars >= FEWEST_BOARDS and points[names.index(pair[0]), names.index(pair[1])] >= MANY)
    ]


def calibrate_pairs(
    recording: Recording,
    settings: RefineSettings,
    late: bool | None = None,
    progress: Progress | None = None,
) -> Pairs:
    """Calibrate every pair that shares enough bars, or until one is out of step unasked.

    Args:
        late: as of `calibrate_rig`.
        progress: called with the pairs done, and those in all.
    """
    bars = shared_bars(recording)
    worth = pairs_worth_a_fit(recording)
    fits: dict[CameraPair, RefinedResult] = {}
    failed: dict[CameraPair, str] = {}
    moved: dict[CameraPair, Movement] = {}
    for number, pair in enumerate(worth):
        if progress is not None:
            progress(number, len(worth) + FURTHER_STEPS)
        try:
            fits[pair] = _fit(recording, pair, settings, late)
        except StereocalError as error:
            failed[pair] = str(error)
            continue
        if late is None and fits[pair].dataset.time_offset is not None:
            return Pairs(bars, {}, out_of_step=True)
    noises = [fit.sigma_px.value for fit in fits.values()]
    limit = max(MOST_NOISE * float(np.median(noises)) if noises else 0.0, LEAST_NOISE_PX)
    for pair, fit in list(fits.items()):
        out = int(fit.outlying.sum())
        if fit.sigma_px.value <= limit and out <= MOST_LEFT_OUT * len(fit.frames):
            continue
        failed[pair] = (
            f"its fit leaves {fit.sigma_px.value:.1f} px and contradicts {out} of "
            f"{len(fit.frames)} frames"
        )
        if (movement := movement_of_pair(fit)) is not None:
            moved[pair] = movement
        del fits[pair]
    sound = {pair: PairFit.of(pair, fit) for pair, fit in fits.items()}
    best = sorted(sound.items(), key=lambda item: -item[1].frames / item[1].noise_px ** 2)
    return Pairs(bars, dict(best), failed, moved)


def _fit(
    recording: Recording, pair: CameraPair, settings: RefineSettings, late: bool | None
) -> RefinedResult:
    """The robust refined set of a pair; in step if that was asked for, or if it is out of step."""
    dataset = recording.pair(*pair)
    priors = of_some(recording, replace(settings, time_offset=False, time_drift=False), pair)
    if dataset.baseline_is_free:
        priors = replace(priors, baseline_sigma_m=None)
    dataset = with_rough_baseline(dataset)
    if late:
        in_step = fit_time_offset(dataset, wide_settings(dataset)).fit
        return refine(dataset, priors) if in_step is None else in_step
    if late is None:
        return with_offset_if_out_of_step(dataset, priors)[0]
    return refine(dataset, priors)


def groups_of(cameras: Sequence[str], pairs: Iterable[CameraPair]) -> dict[str, set[str]]:
    """The cameras that pairs connect with each camera, itself among them."""
    groups = {name: {name} for name in cameras}
    for first, second in pairs:
        joined = groups[first] | groups[second]
        for name in joined:
            groups[name] = joined
    return groups


def reached(cameras: Sequence[str], pairs: Iterable[CameraPair]) -> list[str]:
    """The largest group of cameras that pairs connect, in the cameras' order."""
    largest = max(groups_of(cameras, pairs).values(), key=len)
    return [name for name in cameras if name in largest]
