"""Calibrate a rig of N cameras: pairs, fused; a joint fit that screens; the joint adjustment."""

from dataclasses import replace

import numpy as np

from stereocal.calibration.board_numbering import check_numbering
from stereocal.calibration.methods import CalibrationSettings
from stereocal.errors import StereocalError
from stereocal.network.diagnosis import camera_warnings, refuse_poor_fit
from stereocal.network.fit import RigFit, RigSettings
from stereocal.network.fuse import Fused, PairFit, fuse
from stereocal.network.pairs import (
    FEWEST_BARS,
    FURTHER_STEPS,
    Pairs,
    calibrate_pairs,
    pair_problem,
    reached,
    shared_bars,
)
from stereocal.network.result import RigCalibration
from stereocal.network.screening import rows_of, wrong_images
from stereocal.network.wrong_inputs import (
    check_inputs,
    contradicting_lengths,
    find_wrong_input,
    refuse_same_points,
)
from stereocal.refined.free_baseline import with_baseline_found
from stereocal.refined.refine import refine
from stereocal.refined.screening import WIDE_LENGTH_PRIOR, screened
from stereocal.refined.unknowns import LensPrior
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from stereocal.rig.lengths_in_words import question_about_units
from stereocal.rig.recording import Recording
from stereocal.rig.tracks import interpolate
from stereocal.system.numbers import count
from stereocal.system.tasks import Progress

WIDE_LENS = LensPrior(0.05, 50.0)
MOST_ROUNDS = 8
IN_STEP = 0.05
"""A remaining time offset below this fraction of its standard error is left to the fit."""
MOST_MISFIT = 400.0
"""Growth of a pair's chi-square by being fused above which it contradicts the others: one of its
lengths or lenses is another than theirs. Sound pairs of a real recording: 2 to 5."""
NO_RIG = (
    "No rig of these cameras fits the points: check that points and camera files are not exchanged."
)


def calibrate_rig(
    recording: Recording, settings: RigSettings | None = None, progress: Progress | None = None
) -> RigCalibration:
    """Calibrate all cameras of a recording together.

    Args:
        progress: called with the steps done, and those in all.
    """
    refuse_same_points(recording)
    check_numbering(recording)
    try:
        rig = _calibrated(recording, settings or RigSettings(), progress)
        refuse_poor_fit(rig)
    except (StereocalError, np.linalg.LinAlgError) as error:  # LinAlgError: no rig is near
        known = isinstance(error, StereocalError)
        cause = contradicting_lengths(recording) or find_wrong_input(recording)
        raise StereocalError(cause or (str(error) if known else NO_RIG)) from error
    disagree = {name for pair in rig.pairs.failed for name in pair} & {*rig.unreached}
    if disagree and (wrong := find_wrong_input(recording)):
        raise StereocalError(wrong)
    possible = check_inputs(rig.recording, rig.fit.sigma_px)
    told = [*possible, *rig.warnings, _question(rig)]
    return replace(rig, warnings=tuple(filter(None, told)))


def _question(rig: RigCalibration) -> str:
    """Whether unusually long lengths are in metres; empty if none is."""
    pair = next(iter(rig.pairs.fits))
    of_rig, dataset = rig.pair(*pair), rig.recording.pair(*pair)
    if dataset.baseline_is_free:
        dataset = replace(dataset, baseline_m=of_rig.pose.baseline)
    question = question_about_units(dataset, of_rig.pose)
    return question and f"{question} If not, correct them: no residual shows a wrong unit."


def _calibrated(
    recording: Recording, settings: RigSettings, progress: Progress | None
) -> RigCalibration:
    """The rig, however well it fits."""
    if len(recording.cameras) == 2 and not settings.time_offsets:
        alone = _of_two(recording, settings)
        if alone is not None:
            return alone
    pairs = calibrate_pairs(recording, settings, progress)
    if pairs.out_of_step:
        late = replace(settings, time_offsets=True)
        found = _of_pairs(recording, calibrate_pairs(recording, late, progress), late, progress)
        if found.out_of_step:
            return found
        settings = replace(settings, time_offsets=False)
        pairs = calibrate_pairs(recording, settings, progress)
    return _of_pairs(recording, pairs, settings, progress)


def _of_pairs(
    recording: Recording, pairs: Pairs, settings: RigSettings, progress: Progress | None
) -> RigCalibration:
    """The rig, from its pairs."""
    if not pairs.fits:
        raise StereocalError(_no_pair(recording, pairs))
    names = reached(list(recording.cameras), pairs.fits)
    unreached = {
        name: _why_unreached(name, pairs) for name in recording.cameras if name not in names
    }
    kept = recording.of_cameras(names)
    pairs, fused = _consistent(kept, pairs, settings)
    noise = float(np.median([fit.noise_px for fit in pairs.fits.values()]))
    wide = replace(settings, lenses=dict.fromkeys(names, WIDE_LENS), object_sigma=WIDE_LENGTH_PRIOR)
    report = progress or (lambda *_: None)
    steps = len(pairs.fits) + len(pairs.failed) + FURTHER_STEPS
    report(steps - 2, steps)
    screening, _ = _fit(kept, fused, wide, noise)
    wrong = wrong_images(screening)
    out = screening.frames[screening.outlying]
    out = out[~np.isin(out, [image.frame for image in wrong])]
    good = ~rows_of(kept, wrong) & ~np.isin(kept.frame, out)
    report(steps - 1, steps)
    fit, offsets = _fit(kept.where(good), fused, settings, screening.sigma_px)
    report(steps, steps)
    left_out = {*out.tolist(), *fit.frames[fit.outlying].tolist()}
    return RigCalibration(
        fit,
        pairs,
        tuple(wrong),
        tuple(sorted(left_out)),
        unreached,
        offsets,
        tuple(camera_warnings(fit)),
    )


def _of_two(recording: Recording, settings: RigSettings) -> RigCalibration | None:
    """A rig of two cameras: the refined set of their pair, with its screening; None if they are out
    of step."""
    (pair,), bars = recording.pairs, shared_bars(recording)
    dataset, priors = pair_problem(recording, pair, settings)
    screening = screened(with_baseline_found(dataset), CalibrationSettings())
    if screening.shift is not None:
        return None
    refined = refine(screening.dataset, priors)
    pairs = Pairs(bars, {pair: PairFit.of(pair, refined)})
    kept = recording.where(~np.isin(recording.frame, screening.left_out))
    fit = RigFit(kept, [Pose(np.eye(3), np.zeros(3)), refined.pose], settings)
    fit.end_at(refined)
    left_out = tuple(sorted({*screening.left_out, *refined.outlying_frames}))
    warnings = tuple(camera_warnings(fit))
    return RigCalibration(fit, pairs, (), left_out, {}, np.zeros(2), warnings)


def _consistent(recording: Recording, pairs: Pairs, settings: RigSettings) -> tuple[Pairs, Fused]:
    """The pairs without those that contradict the others, worst first, and the others fused."""
    names, failed = list(recording.cameras), dict(pairs.failed)
    fits = {pair: fit for pair, fit in pairs.fits.items() if {*pair} <= {*names}}
    while True:
        fused = fuse(recording, list(fits.values()), settings)
        spare = [
            pair
            for pair, misfit in sorted(fused.misfits.items(), key=lambda item: -item[1])
            if misfit > MOST_MISFIT and len(reached(names, fits.keys() - {pair})) == len(names)
        ]
        if not spare:
            return replace(pairs, fits=fits, failed=failed), fused
        del fits[spare[0]]
        failed[spare[0]] = "it contradicts the other pairs"


def _fit(
    recording: Recording, start: Fused, settings: RigSettings, noise_px: float
) -> tuple[RigFit, FloatArray]:
    """The joint fit, and by how many frames each camera is late."""
    p = start.unknowns.named(start.p)
    keys = [f"{name} time offset" for name in recording.cameras]
    offsets = np.array([p.pop(name, 0.0) for name in keys])
    poses: list[Pose] = start.poses
    for _ in range(MOST_ROUNDS):
        shifted, velocities = recording, None
        if settings.time_offsets:
            shifted, velocities = _shifted(recording, offsets)
        fit = RigFit(shifted, poses, settings, velocities)
        fit.start_at(p, noise_px)
        if not fit.run():
            raise StereocalError(NO_RIG)
        if not settings.time_offsets:
            break
        values = fit.unknowns.named(fit.p)
        remaining = np.array([values.pop(name, 0.0) for name in keys])
        sigma = np.sqrt(np.diag(fit.unknowns.covariance(fit.information)))
        places = [fit.unknowns.names.index(name) for name in keys if name in fit.unknowns.names]
        offsets, poses, p, noise_px = offsets + remaining, fit.poses, values, fit.sigma_px
        if (np.abs(remaining[1:]) < IN_STEP * sigma[places]).all():
            break
    return fit, offsets


def _shifted(recording: Recording, offsets: FloatArray) -> tuple[Recording, FloatArray]:
    """The points at the instants of the reference's frames, without those of late cameras that have
    no neighbours there; and their velocities (n, 2), in pixels per frame."""
    offset = offsets[recording.camera]
    track = recording.camera * len(recording.object.names) + recording.target
    tracks = interpolate(track, recording.frame, recording.points, offset)
    moved, known = offset != 0.0, tracks.known.copy()
    for number, camera in enumerate(recording.cameras.values()):
        of_camera = recording.camera == number
        known[of_camera] &= tracks.inside(camera.image_size)[of_camera]
    points = np.where((moved & known)[:, None], tracks.positions, recording.points)
    usable = ~moved | known
    shifted = replace(recording, points=points).where(usable)
    return shifted, np.nan_to_num(tracks.velocities[usable])


def _why_unreached(name: str, pairs: Pairs) -> str:
    """Why a camera is not connected with the others."""
    shared = {pair: count for pair, count in pairs.bars.items() if name in pair}
    if not shared:
        return f"The camera {name} sees no bar that another camera sees too."
    most = max(shared.values())
    if most < FEWEST_BARS:
        return (
            f"The camera {name} shares {count(most, 'bar')} at most with another one, "
            f"{FEWEST_BARS} are needed: record more bars that both see."
        )
    why = [f"{'-'.join(pair)}: {text}" for pair, text in pairs.failed.items() if name in pair]
    return (
        f"The camera {name} agrees with none of the others: are its points of this recording, with "
        "the same frame numbers, is its camera file its own, and did it stand still? "
        f"{' '.join(why)[:400]}"
    )


def _no_pair(recording: Recording, pairs: Pairs) -> str:
    if not pairs.failed:
        return (
            f"No two cameras share {FEWEST_BARS} bars: record bars that two cameras see together. "
            f"{recording.describe_pairs()}"
        )
    pair, why = next(iter(pairs.failed.items()))
    return f"No two cameras can be calibrated with each other. {'-'.join(pair)}: {why}"
