"""Which wrong input of a rig explains its points, if they do not fit as they were given.

As of a pair (`refined.best_reading`), each reading is judged by the noise that one robust fit
leaves, with the usual priors of the lenses and the lengths held; here it is the joint fit of all
cameras, of the readings with the best essential matrices. Of more than `MOST_CAMERAS`, each camera
is judged with those with which it shares most bars.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from stereocal.calibration.checks import LARGEST_SCALE_ERROR
from stereocal.calibration.readings import FITTING, same_lens
from stereocal.calibration.wrong_inputs import essential_fit, inconsistency_message, suspects
from stereocal.errors import StereocalError
from stereocal.network.fit import RigFit, RigSettings, camera_at
from stereocal.network.fuse import PairFit, chained
from stereocal.network.pairs import (
    FEWEST_BARS,
    bars_by_frame,
    pairs_worth_a_fit,
    reached,
    shared_bars,
)
from stereocal.network.rig_readings import (
    ESTIMATED_HANDICAP,
    OWN,
    RigReading,
    best_pair,
    carried_over,
    exchanged_files,
    readings_of_frames,
    readings_of_movement,
    readings_of_rig,
    with_lenses,
)
from stereocal.refined.best_reading import (
    CERTAIN_GAIN,
    FAR,
    HELD_LENGTHS,
    MOST_STEPS,
    POSSIBLE_GAIN,
    JudgedReading,
    message_of,
    possible_in_words,
    typical_noise,
)
from stereocal.refined.free_baseline import with_rough_baseline
from stereocal.refined.refine import refine
from stereocal.refined.unknowns import LensPrior, RefineSettings
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import CameraPair, Recording
from stereocal.system.numbers import rounded
from stereocal.system.sampling import evenly_spread

MOST_FRAMES = 75
"""Are enough to tell; of longer recordings so many, evenly spread."""
LEAST_BARS = 16
"""Of two cameras, or all that they share."""
MOST_POINTS, MOST_IN_ROW = 9, 3
"""Of an object; of a row, and of a column, of a board."""
MOST_CAMERAS = 4
CONTRADICTED, FAR_FROM_FILE, BETTER = 30.0, 100.0, 0.3
"""Chi-squares of the lenses about the stated ones, from which on a reading may explain them that
fits the images no better, or one that estimates a value; and what it leaves of them, at most."""
PARTS = 4
"""In time, each of which must fit: where a camera moved, many a reading fits half of the frames."""
ALIKE = 1.05
"""Noise that counts as equal."""
CLEAN, CLEAN_PX = 3.0, 0.5
"""A reading that explains the rig leaves at most so many times the noise of its best pair, or this
many pixels."""
ANY_LENS = LensPrior(0.3, 50.0)
QUICK_PAIRS = 2
"""Of a camera."""
WORTH_A_FIT = 2.0
"""Times the best reprojection error of all readings' essential matrices."""


@dataclass(frozen=True)
class RigNoise:
    """What a joint fit leaves."""

    px: float
    of_lenses: float
    """Chi-square of the lenses about the stated ones."""
    best_pair_px: float
    """The noise of the best pair by itself."""
    cameras: Mapping[str, Camera]
    """As fitted."""
    pairs: tuple[PairFit, ...] = ()
    """From which it began."""


NO_FIT = RigNoise(np.inf, np.inf, np.inf, {})


def check_inputs(fit: RigFit, pairs: Collection[PairFit]) -> list[str]:
    """Reject inputs of a rig that are certainly wrong, though it fits; return warnings about those
    that may be.

    Args:
        pairs: of the rig.
    """
    certain, possible = list[tuple[float, str]](), list[str]()
    for nominal, judged in _judged_parts(fit.recording, pairs, fit):
        named = _named(nominal, judged, CERTAIN_GAIN)
        best = named[0].reading if named else None
        if isinstance(best, RigReading) and best.is_movement:
            continue  # which the rig says itself: by how much, too
        if named:
            certain.append((named[0].rank, _message(nominal, named)))
        possible += possible_in_words(nominal.px, _named(nominal, judged, POSSIBLE_GAIN))
    if certain:
        raise StereocalError(min(certain)[1])
    return list(dict.fromkeys(possible))


def find_wrong_input(recording: Recording) -> str:
    """A message that names the wrong input of a rig if one explains the points; else empty."""
    for nominal, judged in _judged_parts(recording):
        if named := _named(nominal, judged, CERTAIN_GAIN):
            return _message(nominal, named)
    return ""


def _judged_parts(
    recording: Recording, known: Collection[PairFit] = (), whole_fit: RigFit | None = None
) -> Iterator[tuple[RigNoise, list[JudgedReading]]]:
    """What each group of cameras leaves as given, and all readings of it; of groups that fit, only
    where one seems to fit better.

    Args:
        known: fits of pairs; without any, the cameras come first that agree least with others.
        whole_fit: of all cameras.
    """
    parts = [(_fewer_points(whole), about) for whole, about in _parts(recording)]
    if len(parts) > 1 and not known:
        parts = sorted(parts, key=lambda it: -max(_px_of_best(it[0], name) for name in it[1]))
    fits = whole_fit is not None and _fits(whole_fit, min(pair.noise_px for pair in known))
    for part, about in parts:
        suspected = [*_suspects(part, about)] if fits else []
        if fits and not suspected:
            continue
        nominal = noise_of_rig(part, [it for it in known if {*it.pair} <= {*part.cameras}])
        if whole_fit is not None and not np.isfinite(nominal.px):
            nominal = RigNoise(whole_fit.sigma_px, 0.0, whole_fit.sigma_px, {})
        if nominal.px < _largest_noise(part, nominal) and nominal.of_lenses < CONTRADICTED:
            suspected = suspected or [*_suspects(part, about)]
            if not _named(nominal, _judged(part, nominal, suspected), POSSIBLE_GAIN):
                continue
        yield nominal, _judged(part, nominal, every_reading(recording, part, about))


def _fits(fit: RigFit, best_pair_px: float) -> bool:
    """Whether all cameras together leave noise, with lengths and lenses as they are stated."""
    scatter = fit.scatter / fit.recording.object.longest_m
    of_lenses = float(fit.p @ fit.unknowns.precision @ fit.p)
    noise = RigNoise(fit.sigma_px, of_lenses, best_pair_px, {})
    within = fit.sigma_px < _largest_noise(fit.recording, noise) and scatter < HELD_LENGTHS
    return within and of_lenses < CONTRADICTED and not fit.rig_settings.lenses


def nothing_is_near(recording: Recording) -> bool:
    """Whether no pair of some camera fits as given, so that it is worth looking first for what is
    wrong."""
    fewer, limit = _fewer_points(recording), _fitting_px(recording)
    cameras = {name for pair in pairs_worth_a_fit(fewer) for name in pair}
    return any(_px_of_best(fewer, name, limit) > limit for name in cameras)


def _px_of_best(recording: Recording, name: str, enough: float = 0.0) -> float:
    """The reprojection error of the best essential matrix of a camera with others, or the first
    that is small enough; 0 without any."""
    least = np.inf
    for pair in pairs_worth_a_fit(recording):
        if name in pair:
            least = min(least, essential_fit(recording.pair(*pair)).px)
            if least < enough:
                break
    return least if least < np.inf else 0.0


def contradicting_lengths(recording: Recording) -> str:
    """A message if a measured baseline and the object cannot both be right; else empty."""
    for pair in recording.pairs:
        if recording.baseline_m(*pair) is None or recording.baseline_sigma_m == np.inf:
            continue
        with suppress(StereocalError):
            dataset = recording.pair(*pair)
            fit = essential_fit(dataset)
            if fit.only_scale_is_wrong and abs(np.log(fit.scale)) > np.log(LARGEST_SCALE_ERROR):
                return f"The cameras {' and '.join(pair)}: {inconsistency_message(dataset, fit)}"
    return ""


def _parts(recording: Recording) -> list[tuple[Recording, list[str]]]:
    """Groups of cameras that share bars, and the cameras that each is to tell about."""
    worth = pairs_worth_a_fit(recording)
    names = reached([*recording.cameras], worth)
    if len(names) < 2:
        return []
    if len(names) <= MOST_CAMERAS:
        return [(recording.of_cameras(names), names)]
    found = []
    for name in names:
        group = [name]
        while len(group) < MOST_CAMERAS:  # the camera that shares most bars with one of the group
            group += next({*pair} - {*group} for pair in worth if len({*pair} & {*group}) == 1)
        ordered = [each for each in names if each in group]
        found.append((recording.of_cameras(ordered), [name]))
    return found


def _fewer_points(recording: Recording) -> Recording:
    """Of the frames in which cameras see a bar together, and of a large object's points, enough;
    of cameras that share few bars, all."""
    frames, images = recording.images()
    common = np.flatnonzero((np.isfinite(images[..., 0]).sum(axis=2) > 1).any(axis=1))
    worth = pairs_worth_a_fit(recording)
    if len(common) > MOST_FRAMES:
        names, bars = list(recording.cameras), bars_by_frame(recording)
        common = common[evenly_spread(len(common), MOST_FRAMES)]
        for pair in worth:
            own = np.flatnonzero(bars[:, names.index(pair[0]), names.index(pair[1])])
            if np.isin(own, common).sum() < LEAST_BARS:
                common = np.union1d(common, own[evenly_spread(len(own), LEAST_BARS)])
    kept = np.isin(recording.frame, frames[common])
    count, board = len(recording.object.names), recording.object.board
    if board is None:
        chosen = np.union1d(evenly_spread(count, MOST_POINTS), recording.object.longest)
        return recording.where(kept & np.isin(recording.target, chosen))
    grid = np.arange(count).reshape(board.rows, board.columns)
    chosen = grid[np.ix_(*(evenly_spread(n, MOST_IN_ROW) for n in grid.shape))]
    fewer = recording.where(kept & np.isin(recording.target, chosen))
    # Of a few boards, or of hidden ones, all corners.
    return fewer if {*worth} <= {*pairs_worth_a_fit(fewer)} else recording.where(kept)


def every_reading(whole: Recording, part: Recording, about: Sequence[str]) -> Iterator[RigReading]:
    """All readings: those of the order of frames are of the whole recording, others of a part."""
    yield from _one_file(part)
    yield from exchanged_files(part, about, whole.cameras)
    yield from readings_of_rig(part, about)
    yield from readings_of_movement(whole.of_cameras([*part.cameras]), about)
    for reading in readings_of_frames(whole, about):
        yield replace(reading, corrected=partial(_of_these, reading.corrected, [*part.cameras]))


def _of_these(corrected: Callable[[], Recording], cameras: Sequence[str]) -> Recording:
    return corrected().of_cameras(cameras)


def _suspects(recording: Recording, about: Sequence[str]) -> Iterator[RigReading]:
    for name in about:
        if (pair := best_pair(recording, name)) is not None:
            yield from carried_over(recording, pair, suspects(recording.pair(*pair), OWN))


def _one_file(recording: Recording) -> Iterator[RigReading]:
    """One lens for several cameras, which have others."""
    cameras = recording.cameras
    groups = {
        tuple(other for other in cameras if same_lens(cameras[name], cameras[other]))
        for name in cameras
    }
    for group in sorted(groups):
        if len(group) < 2:
            continue
        fit = noise_of_rig(recording, lenses=dict.fromkeys(group, ANY_LENS))
        if not fit.cameras:
            continue
        fitted = {name: replace(fit.cameras[name], uncertainty=None) for name in group}
        focal = " and ".join(f"{fitted[name].K[0, 0]:.0f}" for name in group)
        yield RigReading(
            f"The cameras {' and '.join(group)} have one lens, with a focal length of "
            f"{cameras[group[0]].K[0, 0]:.0f} px, but lenses of {focal} px would fit",
            "Was one file used for several cameras? Give each camera its own.",
            group,
            partial(with_lenses, recording, fitted),
            ESTIMATED_HANDICAP,
        )


def _judged(
    recording: Recording, nominal: RigNoise, readings: Iterable[RigReading]
) -> list[JudgedReading]:
    """The readings that are worth a fit, with the noise that they leave, the best first."""
    bars, found, px = shared_bars(recording), [], []
    every = [*readings]
    for reading in every:
        px.append(np.inf)
        with suppress(StereocalError):
            data = _fewer_points(reading.corrected())
            of_data = bars if {*data.cameras} <= {*recording.cameras} else shared_bars(data)
            px[-1] = _quick_px(data, reading.cameras, of_data)
    best = min([_quick_px(recording, [*recording.cameras], bars), *px])
    for reading, quick_px in zip(every, px, strict=True):
        if quick_px <= WORTH_A_FIT * best < np.inf:
            data = _fewer_points(reading.corrected())
            known = [pair for pair in nominal.pairs if not {*pair.pair} & {*reading.cameras}]
            noise = noise_of_rig(data, known)
            fits = noise.px < _largest_noise(data, noise)
            fits = fits and reading.least_gain * noise.px < nominal.px
            least = FAR_FROM_FILE if reading.is_estimated else CONTRADICTED
            of_lenses = noise.of_lenses if nominal.of_lenses > least else np.inf
            rank = reading.handicap * noise.px
            found.append(JudgedReading(reading, noise.px, fits, rank, of_lenses))
    return sorted(found, key=lambda it: it.rank)


def _largest_noise(recording: Recording, fit: RigNoise) -> float:
    """The largest noise that cameras which fit together leave, in pixels."""
    return min(max(CLEAN * fit.best_pair_px, CLEAN_PX), _fitting_px(recording))


def _quick_px(recording: Recording, cameras: Sequence[str], bars: Iterable[CameraPair]) -> float:
    """The mean reprojection error of the essential matrices of some cameras with others."""
    pairs = {
        pair for name in cameras for pair in [each for each in bars if name in each][:QUICK_PAIRS]
    }
    found = [essential_fit(recording.pair(*pair)).px for pair in pairs]
    return float(np.mean(found)) if found else np.inf


def _named(nominal: RigNoise, judged: list[JudgedReading], gain: float) -> list[JudgedReading]:
    """The readings that explain the points so many times better, or the lenses where the images fit
    both ways; the best first."""
    fitting = [it for it in judged if it.fits]
    if better := [it for it in fitting if gain * it.noise_px < nominal.px]:
        return better
    alike = [
        it
        for it in fitting
        if it.noise_px < ALIKE * nominal.px and it.of_lenses < BETTER * nominal.of_lenses
    ]
    return sorted(alike, key=lambda it: it.of_lenses)


def _message(nominal: RigNoise, named: list[JudgedReading]) -> str:
    """What is said of the best of some readings, and of those that explain as much."""
    best = named[0]
    if CERTAIN_GAIN * best.noise_px < nominal.px:
        return message_of(nominal.px, named, 0.0)
    return (
        f"{best.reading.claim}: the lenses would then be as their files say, from which the images "
        f"deviate as they were given (chi-square {rounded(best.of_lenses)} instead of "
        f"{rounded(nominal.of_lenses)}). {best.reading.remedy}"
    )


def noise_of_rig(
    recording: Recording,
    known: Iterable[PairFit] = (),
    lenses: Mapping[str, LensPrior] | None = None,
) -> RigNoise:
    """What the joint fit of all cameras leaves; `NO_FIT` where none fits.

    Args:
        known: fits of pairs.
        lenses: priors other than the usual ones.
    """
    settings = RefineSettings(
        scatter_m=HELD_LENGTHS * recording.object.longest_m, maximum_steps=MOST_STEPS
    )
    pairs = _first_pairs(recording, settings, known)
    names = list(recording.cameras)
    if len(reached(names, [pair.pair for pair in pairs])) < len(names):
        return NO_FIT
    free = replace(recording, baselines_m={})
    of_rig = RigSettings(lenses=lenses or {})
    fit = RigFit(free, chained(names, pairs), of_rig, held=settings)
    least = min(pair.noise_px for pair in pairs)
    fit.start_at({}, least)
    with suppress(np.linalg.LinAlgError):
        if fit.run() and fit.is_determined:
            own = enumerate(recording.cameras.items())
            cameras = {name: camera_at(camera, fit.q, number) for number, (name, camera) in own}
            px = typical_noise(
                fit.sigma_px,
                fit.chi_squares,
                fit.degrees_of_freedom,
                fit.unknowns,
                fit.p,
                _one_on_its_head(fit.poses),
                PARTS if len(fit.frames) >= PARTS * FEWEST_BARS else 1,
            )
            of_lenses = float(fit.p @ fit.unknowns.precision @ fit.p)
            return RigNoise(px, of_lenses, least, cameras, tuple(pairs))
    return NO_FIT


def _first_pairs(
    recording: Recording, settings: RefineSettings, known: Iterable[PairFit]
) -> list[PairFit]:
    """Sound pairs that connect the cameras, those with the most bars."""
    found, names, limit = [*known], [*recording.cameras], _fitting_px(recording)
    if len(reached(names, [fit.pair for fit in found])) == len(names):
        return sorted(found, key=lambda fit: fit.noise_px)
    worth = pairs_worth_a_fit(recording)
    near = {pair: essential_fit(recording.pair(*pair)).px for pair in worth}
    far = FAR * min(near.values(), default=np.inf)
    for pair, px in near.items():
        if not px < far or _connected(names, [fit.pair for fit in found], pair):
            continue
        with suppress(StereocalError, np.linalg.LinAlgError):
            fit = refine(with_rough_baseline(recording.pair(*pair)), settings)
            if fit.sigma_px.value < limit:
                found.append(PairFit.of(pair, fit))
    return sorted(found, key=lambda fit: fit.noise_px)


def _connected(names: list[str], joined: list[CameraPair], pair: CameraPair) -> bool:
    """Whether pairs connect two cameras."""
    group = {pair[0]}
    for _ in names:
        group |= {name for each in joined if {*each} & group for name in each}
    return pair[1] in group


def _one_on_its_head(poses: Sequence[Pose]) -> bool:
    """Whether a camera stands on its head beside the others."""
    down = np.array([pose.R[1] for pose in poses])  # of each camera, in the reference's frame
    return bool((down @ down.sum(axis=0) < 0.0).any())


def _fitting_px(recording: Recording) -> float:
    return FITTING * min(float(np.hypot(*own.image_size)) for own in recording.cameras.values())
