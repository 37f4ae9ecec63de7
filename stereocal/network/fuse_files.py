"""Refined parameter files of pairs, recorded at different times or by different people, fused."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from stereocal.errors import DAMAGED, StereocalError
from stereocal.network.fit import RigSettings
from stereocal.network.fuse import LOCAL, Fused, PairFit, difference, fuse
from stereocal.network.pairs import pair_name, reached
from stereocal.network.rig_file import RigFile, counts_and_shutters, fused_file
from stereocal.network.started_by_hand import closed, fused_values
from stereocal.refined.two_views import BAR, SHARED, shared_unknowns, with_lens
from stereocal.refined.unknowns import LensPrior
from stereocal.refined.views import EACH, TIME
from stereocal.rig.camera import Camera
from stereocal.rig.parameters import RigParameters
from stereocal.rig.recording import CameraPair, Recording
from stereocal.rig.rigid_object import RigidObject
from stereocal.rig.tracks import MeasuredOffset
from stereocal.system.numbers import rounded
from stereocal.system.records import of_plain

CONTRADICTS = 60.0
"""Growth of a pair's chi-square above which a file contradicts the others: with 24 values, sound
pairs exceed it in 1 of 10,000."""
EXPLAINED = 0.2
"""What is left of the growth of all files when one length explains it."""
AGREE = 5.0
"""Standard errors by which the drifts of pairs may be off."""
COUNTED_ANEW = (
    "They were recorded at different times, with cameras that were started anew, or one is wrong: "
    "the rig has no time offsets. Number the frames of all its cameras alike."
)
DRIFTING = (
    "The files of the pairs contradict each other about how the clocks of the cameras drift: the "
    "rig has no drift. Record all cameras together."
)


def fuse_files(files: Sequence[Path]) -> RigFile:
    """The rig of the pairs of some files."""
    sets = [RigParameters.load(file) for file in files]
    pairs = [_pair(found, str(file)) for found, file in zip(sets, files, strict=True)]
    names = list(dict.fromkeys(name for fit in pairs for name in fit.pair))
    known = reached(names, [fit.pair for fit in pairs])
    if len(known) < len(names):
        lost = ", ".join(name for name in names if name not in known)
        raise StereocalError(
            f"No file connects {lost} with {', '.join(known)}: calibrate a pair of both groups."
        )
    stated, priors = _lenses(sets, files)
    none = np.empty(0, dtype=np.int64)
    wand = RigidObject.bar(1.0)
    empty = Recording("", stated, wand, none, none, none, np.empty((0, 2)), np.empty(0))
    fuse_these = partial(fuse, empty, settings=RigSettings(lenses=priors))
    fused = fuse_these(pairs)
    rig, warnings = _in_time(fused_file(stated, pairs, fused), sets)
    if max(fused.misfits.values()) > CONTRADICTS:
        warnings += [_contradiction(names, pairs, fuse_these, sum(fused.misfits.values()))]
    return replace(rig, about=replace(rig.about, warnings=tuple(warnings)))


def _in_time(rig: RigFile, sets: Sequence[RigParameters]) -> tuple[RigFile, list[str]]:
    """The rig with the counts and shutters of its cameras, and warnings where it has none."""
    offsets = dict[CameraPair, MeasuredOffset]()
    for found in sets:
        assert found.camera_names is not None
        late = found.time_offset or MeasuredOffset()
        offsets[found.camera_names] = replace(late, frames=late.frames + found.start_frame)
    if not any(offset.is_shift for offset in offsets.values()):
        return rig, []
    offsets = _at_one_frame(offsets)
    try:
        starts, errors = closed(rig.names, offsets, COUNTED_ANEW)
    except StereocalError as error:
        return rig, [str(error)]
    covariance, times = rig.covariance.copy(), np.arange(len(starts)) * EACH + TIME
    covariance[np.ix_(times, times)] = errors
    both = dict(zip(rig.names, starts.round(9).tolist(), strict=True))
    wholes, shutters = counts_and_shutters(both, covariance)
    in_time = replace(rig, time_offsets=shutters, start_frames=wholes, covariance=covariance)
    if not any(offset.drift for offset in offsets.values()):
        return in_time, []
    sigmas = np.array([offset.drift_sigma for offset in offsets.values()])
    sigmas[sigmas == 0.0] = sigmas.max()  # not significant there
    values = np.array([offset.drift for offset in offsets.values()])
    drifts, errors, off = fused_values(rig.names, [*offsets], values, sigmas)
    if (off > AGREE * sigmas).any():
        return in_time, [DRIFTING]
    reference = next(iter(offsets.values())).reference
    each = zip(rig.names, drifts.round(12).tolist(), np.sqrt(np.diag(errors)).tolist(), strict=True)
    clocks = {
        name: MeasuredOffset(shutters[name], drift, reference, drift_sigma=sigma)
        for name, drift, sigma in each
    }
    return replace(in_time, drifts={name: own for name, own in clocks.items() if own.drift}), []


def _at_one_frame(offsets: Mapping[CameraPair, MeasuredOffset]) -> dict[CameraPair, MeasuredOffset]:
    """Offsets that drift, all as they are at one frame of the recording of the rig."""
    drifting = [own.reference for own in offsets.values() if own.drift]
    middle = float(np.median(drifting or [0.0]))
    return {
        pair: replace(own, frames=float(own.at(middle)), reference=middle)
        for pair, own in offsets.items()
    }


def _pair(file: RigParameters, source: str) -> PairFit:
    """What a file says of its pair."""
    if file.camera_names is None:
        raise StereocalError(
            f"{source}: the file does not name its cameras: calibrate the pair from a data set of "
            "format 2, with the names of its cameras."
        )
    stored = (file.uncertainties or {}).get("information")
    if stored is None or file.noise_px is None:
        raise StereocalError(
            f"{source}: the file does not say what its images tell: give parameters_refined.json "
            "of `stereocal calibrate`, of this version."
        )
    try:
        H, g = (np.array(stored[name], dtype=np.float64) for name in ("matrix", "gradient"))
        q = shared_unknowns(file)
        q[BAR] = float(stored["bar_factor"])
        if H.shape != (SHARED, SHARED) or g.shape != (SHARED,) or not np.isfinite(H).all():
            raise ValueError("the information is not a table of numbers")
        frames = int(stored["frames"])
    except DAMAGED as error:
        raise StereocalError(f"{source}: its information is damaged ({error}).") from error
    return PairFit(file.camera_names, q, H, g, file.noise_px, frames)


def _lenses(
    sets: Sequence[RigParameters], files: Sequence[Path]
) -> tuple[dict[str, Camera], dict[str, LensPrior]]:
    """The stated lens of each camera, and how well it was known; the same in all files."""
    stated: dict[str, Camera] = {}
    priors: dict[str, LensPrior] = {}
    values: dict[str, list[float]] = {}
    for rig, file in zip(sets, files, strict=True):
        assert rig.camera_names is not None
        assert rig.uncertainties is not None
        lenses = rig.uncertainties["information"]["lenses"]
        for name, which, lens in zip(
            rig.camera_names, ("primary", "secondary"), lenses, strict=True
        ):
            if name in values and not np.allclose(values[name], lens, rtol=1e-9):
                raise StereocalError(
                    f"{file}: the camera {name} was stated with another lens in another file: "
                    "calibrate both pairs with the same camera file, or name the cameras apart."
                )
            values[name] = lens
            stated[name] = with_lens(getattr(rig, which), np.array(lens))
            given = rig.settings.get(which)
            priors[name] = LensPrior() if given is None else of_plain(given, LensPrior)
    return stated, priors


def _contradiction(
    names: Sequence[str],
    pairs: Sequence[PairFit],
    fuse_these: Callable[[Sequence[PairFit]], Fused],
    growth: float,
) -> str:
    """Which file contradicts the others: the one whose known length, left open, explains it."""
    total, length = [], []
    for k, fit in enumerate(pairs):
        H, g = fit.information, fit.gradient
        along = H[:, BAR] / H[BAR, BAR]
        alone = replace(fit, information=H - np.outer(along, H[BAR]), gradient=g - along * g[BAR])
        others = [*pairs[:k], alone, *pairs[k + 1 :]]
        fused = fuse_these(others)
        total.append(sum(fused.misfits.values()))
        length.append(_length_of(fit, names, fused))
    order = np.argsort(total)
    best, second = (total[k] for k in order[:2])
    if best < EXPLAINED * growth and second > 2.0 * best:
        fit = pairs[order[0]]
        percent = 100 * (length[order[0]] - 1)
        return (
            f"The pair {pair_name(fit.pair)} contradicts the others by its length: its object "
            f"seems {rounded(abs(percent))} % {'longer' if percent > 0 else 'shorter'} than stated "
            "there. Measure it, correct the length of that recording, and calibrate the pair again."
        )
    return (
        "The pairs contradict each other, and it cannot be told which is wrong: a camera was moved "
        "between the recordings, or a length or a camera file of one of them is wrong. Record all "
        "cameras together, or one more pair."
    )


def _length_of(fit: PairFit, names: Sequence[str], fused: Fused) -> float:
    """The length of a pair's object over the stated one, as the others have it."""
    R = np.array([pose.R for pose in fused.poses])
    first, second = (names.index(name) for name in fit.pair)
    d, _ = difference(fit, first, second, fused.q, R)
    _, A, b = fit.local
    bar = LOCAL - 2
    rest = A[bar] @ d - A[bar, bar] * d[bar] + b[bar]
    return float((fit.q[BAR] - rest / A[bar, bar]) / fused.q[-1])
