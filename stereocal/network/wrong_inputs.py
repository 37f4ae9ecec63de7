"""Which wrong input of a rig explains its points, if they do not fit as they were given.

As of a pair (`refined.best_reading`), each reading is judged by the noise that one robust fit
leaves, with the usual priors of the lenses and the lengths held; here it is the joint fit of all
cameras, of the readings with the best essential matrices. Of more than `MOST_CAMERAS`, each camera
is judged with those with which it shares most bars.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from operator import methodcaller

import numpy as np

from stereocal.calibration.checks import LARGEST_SCALE_ERROR
from stereocal.calibration.corrections import fitting_px, some_corners, with_files
from stereocal.calibration.readings import (
    SECONDARY,
    Group,
    Reading,
    readings_of_cameras,
    readings_of_frames,
)
from stereocal.calibration.wrong_inputs import essential_fit, inconsistency_message, suspects
from stereocal.errors import StereocalError
from stereocal.network.fit import RigFit, RigSettings
from stereocal.network.fuse import PairFit, chained
from stereocal.network.pairs import (
    FEWEST_BARS,
    bars_by_frame,
    groups_of,
    pairs_worth_a_fit,
    reached,
    shared_bars,
)
from stereocal.refined.best_reading import FAR
from stereocal.refined.free_baseline import with_rough_baseline
from stereocal.refined.judge import (
    ANY_LENS,
    CERTAIN_GAIN,
    HELD_LENGTHS,
    MOST_STEPS,
    Judge,
    JudgedReading,
    Noise,
    typical_noise,
)
from stereocal.refined.refine import refine
from stereocal.refined.small_steps import with_lens
from stereocal.refined.unknowns import LensPrior, RefineSettings
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.recording import CameraPair, Recording
from stereocal.system.sampling import evenly_spread

MOST_FRAMES = 75
"""Are enough to tell; of longer recordings so many, evenly spread."""
LEAST_BARS = 16
"""Of two cameras, or all that they share."""
MOST_POINTS = 9
"""Of an object."""
MOST_CAMERAS = 4
PARTS = 4
"""In time, each of which must fit: where a camera moved, many a reading fits half of the frames."""
CLEAN, CLEAN_PX = 3.0, 0.5
"""A reading that explains the rig leaves at most so many times the noise of its best pair, or this
many pixels."""
QUICK_PAIRS = 2
"""Of a camera."""
WORTH_A_FIT = 2.0
"""Times the best reprojection error of all readings' essential matrices."""
SHIFTS, SHIFT_GAIN = (1, -1, 2, -2, 3, -3), 4.0
"""Frames by which the numbers of a camera may be off. One that is late by a part of a frame fits
somewhat better a whole frame off."""


@dataclass(frozen=True)
class RigNoise(Noise):
    """What a joint fit leaves."""

    cameras: Mapping[str, Camera] | None = None
    """As fitted; None where nothing fits."""
    pairs: tuple[PairFit, ...] = ()
    """From which it began."""


class JudgeOfRig(Judge[Recording]):
    """Of some cameras that share bars."""

    def __init__(
        self,
        whole: Recording,
        names: Sequence[str],
        about: Sequence[str],
        known: Iterable[PairFit] = (),
        fit: RigFit | None = None,
    ) -> None:
        """Of cameras of a rig.

        Args:
            names: of the cameras.
            about: those that the readings are to concern.
            known: fits of pairs.
            fit: of all cameras of the rig.
        """
        self.whole, self.part, self.about = whole, _fewer_points(whole.of_cameras(names)), about
        self.known_cameras = whole.cameras
        self.known = [pair for pair in known if {*pair.pair} <= {*names}]
        self.fit, self.bars = fit, shared_bars(self.part)
        self.groups = [Group(tuple(names), self.part.pair(*next(iter(self.bars))), CAMERAS)]
        for name in about:  # with the camera with which it shares most bars
            others = (pair[pair[0] == name] for pair in self.bars if name in pair)
            if other := next(others, None):
                self.groups.append(Group((name,), self.part.pair(other, name), SECONDARY))

    @cached_property
    def nominal(self) -> RigNoise:
        found = noise_of_rig(self.part, self.known)
        if self.fit is not None and not np.isfinite(found.px):
            return RigNoise(self.fit.sigma_px, largest_noise(self.part, self.fit.sigma_px))
        return found

    @cached_property
    def suspected(self) -> list[Reading[Recording]]:
        found = [*self.of_one_file()]
        for group in self.groups[1:]:
            of_group = methodcaller("pair", *(group.shown.camera_names or CAMERAS))
            found += suspects(group.shown, readings_of_cameras(self.part, [group]), of_group)
        return found

    def readings_in_time(self) -> Iterator[Reading[Recording]]:
        names = tuple(self.part.cameras)
        for name in self.about:
            for reading in readings_of_frames(self.whole, name, SHIFTS, SHIFT_GAIN):
                yield replace(reading, corrected=partial(_of_cameras, reading.corrected, names))

    def refitted(self, files: Mapping[str, Camera]) -> Mapping[str, Camera]:
        fit = noise_of_rig(with_files(self.part, files), lenses=dict.fromkeys(files, ANY_LENS))
        return {name: replace(fit.cameras[name], uncertainty=None) for name in files if fit.cameras}

    def fitted(self, readings: Iterable[Reading[Recording]]) -> Iterator[JudgedReading[Recording]]:
        found, px = list[tuple[Reading[Recording], Recording]](), list[float]()
        for reading in readings:
            with suppress(StereocalError):
                data = _fewer_points(reading.corrected())
                known = {*data.cameras} <= {*self.part.cameras}
                of_data = self.bars if known else shared_bars(data)
                px.append(_quick_px(data, reading.cameras, of_data))
                found.append((reading, data))
        best = min([_quick_px(self.part, [*self.part.cameras], self.bars), *px])
        for (reading, data), quick_px in zip(found, px, strict=True):
            if quick_px <= WORTH_A_FIT * best < np.inf:
                alike = [it for it in self.nominal.pairs if not {*it.pair} & {*reading.cameras}]
                yield JudgedReading(reading, noise_of_rig(data, alike))


def check_inputs(fit: RigFit, pairs: Collection[PairFit]) -> list[str]:
    """Reject inputs of a rig that are certainly wrong, though it fits; return warnings about those
    that may be.

    Args:
        pairs: of the rig.
    """
    possible = list[str]()
    fits = _fits(fit, min(pair.noise_px for pair in pairs))
    for judge in _judges(fit.recording, pairs, fit):
        if fits and not judge.suspected:
            continue
        judged = judge.explanations()
        named = judge.named(judged, CERTAIN_GAIN)
        if named:
            raise StereocalError(judge.message(judged))
        possible += judge.warnings(judged)
    return list(dict.fromkeys(possible))


def find_wrong_input(recording: Recording) -> str:
    """A message that names the wrong input of a rig if one explains the points; else empty."""
    judges = _judges(recording)
    return next(filter(None, (judge.message(judge.explanations()) for judge in judges)), "")


def _fits(fit: RigFit, best_pair_px: float) -> bool:
    """Whether all cameras together leave noise, with lengths and lenses as they are stated."""
    scatter = fit.scatter / fit.recording.object.longest_m
    largest = largest_noise(fit.recording, best_pair_px)
    noise = Noise(fit.sigma_px, largest, fit.prior_cost)
    return noise.fits and scatter < HELD_LENGTHS and not fit.rig_settings.lenses


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


def _judges(
    recording: Recording, known: Collection[PairFit] = (), fit: RigFit | None = None
) -> Iterator[JudgeOfRig]:
    """Of groups of cameras that share bars; of large ones, each of one camera."""
    worth = pairs_worth_a_fit(recording)
    names = reached([*recording.cameras], worth)
    if 2 <= len(names) <= MOST_CAMERAS:
        yield JudgeOfRig(recording, names, names, known, fit)
    for name in names if len(names) > MOST_CAMERAS else ():
        group = [name]
        while len(group) < MOST_CAMERAS:  # the camera that shares most bars with one of the group
            group += next({*pair} - {*group} for pair in worth if len({*pair} & {*group}) == 1)
        ordered = [each for each in names if each in group]
        yield JudgeOfRig(recording, ordered, [name], known, fit)


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
    fewer = recording.where(kept & np.isin(recording.target, some_corners(board)))
    # Of a few boards, or of hidden ones, all corners.
    return fewer if {*worth} <= {*pairs_worth_a_fit(fewer)} else recording.where(kept)


def _of_cameras(corrected: Callable[[], Recording], names: Sequence[str]) -> Recording:
    return corrected().of_cameras(names)


def largest_noise(recording: Recording, best_pair_px: float) -> float:
    """The largest noise that cameras which fit together leave, in pixels."""
    return min(max(CLEAN * best_pair_px, CLEAN_PX), fitting_px(recording))


def _quick_px(recording: Recording, cameras: Sequence[str], bars: Iterable[CameraPair]) -> float:
    """The mean reprojection error of the essential matrices of some cameras with others."""
    pairs = {
        pair for name in cameras for pair in [each for each in bars if name in each][:QUICK_PAIRS]
    }
    found = [essential_fit(recording.pair(*pair)).px for pair in pairs]
    return float(np.mean(found)) if found else np.inf


def noise_of_rig(
    recording: Recording,
    known: Iterable[PairFit] = (),
    lenses: Mapping[str, LensPrior] | None = None,
) -> RigNoise:
    """What the joint fit of all cameras leaves; infinite where none fits.

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
        return RigNoise()
    free = replace(recording, baselines_m={})
    of_rig = RigSettings(lenses=lenses or {})
    fit = RigFit(free, chained(names, pairs), of_rig, held=settings)
    least = min(pair.noise_px for pair in pairs)
    fit.start_at({}, least)
    with suppress(np.linalg.LinAlgError):
        if fit.run() and fit.is_determined:
            own = enumerate(recording.cameras.items())
            cameras = {name: with_lens(camera, fit.q, number) for number, (name, camera) in own}
            parts = PARTS if len(fit.frames) >= PARTS * FEWEST_BARS else 1
            px = typical_noise(fit, fit.sigma_px, fit.poses, parts)
            of_lenses = fit.prior_cost
            largest = largest_noise(recording, least)
            return RigNoise(px, largest, of_lenses, cameras, tuple(pairs))
    return RigNoise()


def _first_pairs(
    recording: Recording, settings: RefineSettings, known: Iterable[PairFit]
) -> list[PairFit]:
    """Sound pairs that connect the cameras, those with the most bars."""
    found, names, limit = [*known], [*recording.cameras], fitting_px(recording)
    if len(reached(names, [fit.pair for fit in found])) == len(names):
        return sorted(found, key=lambda fit: fit.noise_px)
    worth = pairs_worth_a_fit(recording)
    near = {pair: essential_fit(recording.pair(*pair)).px for pair in worth}
    far = FAR * min(near.values(), default=np.inf)
    for pair, px in near.items():
        if not px < far or pair[1] in groups_of(names, [fit.pair for fit in found])[pair[0]]:
            continue
        with suppress(StereocalError, np.linalg.LinAlgError):
            fit = refine(with_rough_baseline(recording.pair(*pair)), settings)
            if fit.sigma_px.value < limit:
                found.append(PairFit.of(pair, fit))
    return sorted(found, key=lambda fit: fit.noise_px)
