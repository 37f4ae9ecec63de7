"""Calibrate a rig of N cameras: pairs, fused; a joint fit that screens; the joint adjustment."""

from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from stereocal.calibration.board_numbering import check_numbering
from stereocal.calibration.checks import refuse_same_points
from stereocal.errors import StereocalError
from stereocal.fit.errors.held_out import fitted_to
from stereocal.fit.free_distortion import better_held_out, lenses_with_distortion
from stereocal.fit.joint_fit import NO_RIG, Start, joint_fit
from stereocal.fit.least_squares.stated_windows import begin_at
from stereocal.fit.least_squares.unknowns import RefineSettings, check_stated, of_some
from stereocal.fit.readings.changing_focal import changing_focal
from stereocal.fit.readings.diagnosis import (
    contradicted_inputs,
    moved_in_words,
    refuse_poor_fit,
    view_warnings,
)
from stereocal.fit.readings.moving_cameras import LEAST_PX, moving_cameras
from stereocal.fit.readings.windows import (
    in_air,
    into_water,
    no_window,
    stated_otherwise,
    window_warnings,
)
from stereocal.fit.readings.wrong_inputs import (
    check_inputs,
    contradicting_lengths,
    find_wrong_input,
    instead_of_movement,
)
from stereocal.fit.refine import refine
from stereocal.fit.rig_calibration import RigCalibration
from stereocal.fit.screening.misplaced_target import misplaced_target
from stereocal.fit.screening.movement import MovedError, movement
from stereocal.fit.screening.screen import MAXIMUM_LEFT_OUT, WIDE_LENGTH_PRIOR, WIDE_LENS
from stereocal.fit.screening.wrong_images import rows_of, wrong_images
from stereocal.fit.start.fuse import Fused, fuse
from stereocal.fit.start.pairs import FEWEST_BARS, FURTHER_STEPS, Pairs, calibrate_pairs, reached
from stereocal.fit.timing.time_offset import DRIFTING
from stereocal.rig.camera import camera_in_words
from stereocal.rig.correspondences import TARGETS
from stereocal.rig.lengths_in_words import question_about_units
from stereocal.rig.recording import Recording
from stereocal.rig.window import NOT_BEFORE, TURNED_AWAY, Window
from stereocal.system.numbers import count, rounded
from stereocal.system.tasks import Progress

MOST_MISFIT = 400.0
"""Growth of a pair's chi-square by being fused above which it contradicts the others: one of its
lengths or lenses is another than theirs. Sound pairs of a real recording: 2 to 5."""


def calibrate_rig(
    recording: Recording,
    settings: RefineSettings | None = None,
    late: bool | None = None,
    progress: Progress | None = None,
) -> RigCalibration:
    """Calibrate all cameras of a recording together.

    Args:
        settings: except whether time offsets are unknowns; a drift is one where they are.
        late: whether each camera may be out of step by some frames; None: where that is
            significant.
        progress: called with the steps done, and those in all.
    """
    if recording.distance_m is not None or recording.time_frame is not None:
        raise StereocalError(
            "The table has a column distance_m or time_frame: calibrate its two cameras with "
            "`calibrate`, which uses them."
        )
    refuse_same_points(recording)
    check_numbering(recording)
    check_stated(settings or RefineSettings(), recording)
    try:
        rig = _calibrated(recording, settings or RefineSettings(), late, progress)
        refuse_poor_fit(rig)
    except MovedError as error:
        raise MovedError(instead_of_movement(recording) or str(error)) from error
    except (StereocalError, np.linalg.LinAlgError) as error:  # LinAlgError: no rig is near
        named = (
            (recording.windows and no_window(in_air(recording), np.inf))
            or _otherwise(recording, settings or RefineSettings(), late)
            or into_water(recording)
            or contradicting_lengths(recording)
            or find_wrong_input(recording)
            or moving_cameras(recording)
        )
        # A fit may have brought a window beside its camera, or behind it.
        by_fit = isinstance(error, np.linalg.LinAlgError) or str(error) in (TURNED_AWAY, NOT_BEFORE)
        known = NO_RIG if by_fit else str(error)
        raise StereocalError(named or known) from error
    of_windows = list[str]()
    if recording.windows:
        air = in_air(recording)
        if none := no_window(air, rig.fit.sigma_px):
            raise StereocalError(none)
        of_windows = window_warnings(rig, air)
    if rig.moved and (wrong := instead_of_movement(recording)):
        raise MovedError(wrong)
    disagree = {name for pair in rig.pairs.failed for name in pair} & {*rig.unreached}
    contradicting = {*rig.left_out, *(image.frame for image in rig.wrong)}
    are_many = len(contradicting) > MAXIMUM_LEFT_OUT * len(np.unique(recording.frame))
    if (disagree or are_many) and not rig.moved and (wrong := find_wrong_input(recording)):
        raise StereocalError(wrong)
    possible = check_inputs(rig.fit.recording, rig.fit, [*rig.pairs.fits.values()])
    swaying = moving_cameras(recording) if rig.fit.sigma_px > LEAST_PX else ""
    focal = changing_focal(rig.fit, rig.fit.points.reshape(-1, 2, 3), lambda: rig.design_effect)
    contradicted = [] if focal else contradicted_inputs(rig.fit)
    of_cameras = [focal, *view_warnings(rig.fit), *of_windows, *contradicted]
    warnings = [_misplaced(rig), *possible, *of_cameras, rig.moved, swaying, _question(rig)]
    return replace(rig, warnings=tuple(filter(None, warnings)), sha256=recording.sha256)


def _otherwise(recording: Recording, settings: RefineSettings, late: bool | None) -> str:
    """Which windows fit instead of the stated ones, through which no rig does; empty if none."""
    for said, windows in stated_otherwise(recording).items() if recording.windows else ():
        with suppress(StereocalError, np.linalg.LinAlgError):
            rig = _calibrated(replace(recording, windows=windows), settings, late, None)
            refuse_poor_fit(rig)
            if not rig.unreached:
                return (
                    "The points do not fit through the window as it is stated. They do "
                    f"{said}: to {rounded(rig.fit.sigma_px)} px. Correct what is stated of it (on "
                    "the page Data, or in dataset.json); or a camera file, if that is right."
                )
    return ""


def _misplaced(rig: RigCalibration) -> str:
    """Which target of the object is not where it is said to be, by the two cameras that share most
    bars; empty if none is."""
    if len(rig.recording.object.names) <= len(TARGETS) or rig.recording.object.board:
        return ""
    pair = next(iter(rig.pairs.fits))
    with suppress(StereocalError):  # the rig fits; its pair need not by itself
        settings = of_some(rig.recording, RefineSettings(), pair)
        dataset, pose = rig.recording.pair(*pair), rig.pair(*pair).pose
        if dataset.baseline_is_free:
            dataset = dataset.changed(baseline_m=pose.baseline)
        return misplaced_target(refine(dataset, settings, pose))
    return ""


def _question(rig: RigCalibration) -> str:
    """Whether unusually long lengths are in metres; empty if none is."""
    pair = next(iter(rig.pairs.fits))
    of_rig, dataset = rig.pair(*pair), rig.recording.pair(*pair)
    if dataset.baseline_is_free:
        dataset = dataset.changed(baseline_m=of_rig.pose.baseline)
    question = question_about_units(dataset, of_rig.pose)
    return question and f"{question} If not, correct them: no residual shows a wrong unit."


def _calibrated(
    recording: Recording, settings: RefineSettings, late: bool | None, progress: Progress | None
) -> RigCalibration:
    """The rig, however well it fits."""
    pairs = calibrate_pairs(recording, settings, late, progress)
    if pairs.out_of_step:
        rig = _calibrated(recording, settings, True, progress)
        return rig if rig.out_of_step else _calibrated(recording, settings, False, progress)
    drifting = bool(late) and settings.time_drift
    settings = replace(settings, time_offset=bool(late), time_drift=drifting)
    return _of_pairs(recording, pairs, settings, progress)


def _of_pairs(
    recording: Recording, pairs: Pairs, settings: RefineSettings, progress: Progress | None
) -> RigCalibration:
    """The rig, from its pairs."""
    names, unreached = _connected(recording, pairs, settings)
    kept, settings = recording.of_cameras(names), of_some(recording, settings, names)
    pairs, fused = _consistent(kept, pairs, settings)
    noise = float(np.median([fit.noise_px for fit in pairs.fits.values()]))
    wide = replace(
        settings,
        lenses=dict.fromkeys(kept.labels, WIDE_LENS),
        distance_sigma_m=WIDE_LENGTH_PRIOR * kept.object.longest_m,
    )
    report = progress or (lambda *_: None)
    steps = len(pairs.fits) + len(pairs.failed) + FURTHER_STEPS
    report(steps - 2, steps)
    seen = dict[str, Window]()
    for fit in pairs.fits.values():
        seen = {**fit.windows, **seen}
    begin = begin_at(kept, fused.poses, seen)
    start = Start(fused.poses, {**fused.unknowns.named(fused.p), **begin}, noise)
    screening, _ = joint_fit(kept, start, wide)
    moved = ""
    if (change := movement(screening, partial(fitted_to, screening, near=False))) is not None:
        moved = moved_in_words(change, [names[number] for number in change.cameras], settings)
        if change.is_far or len(change.cameras) == len(names):  # no camera is known to stand still
            raise MovedError(moved)
    wrong = wrong_images(screening)
    out = screening.frames[screening.outlying]
    out = out[~np.isin(out, [image.frame for image in wrong])]
    good = ~rows_of(kept, wrong) & ~np.isin(kept.frame, out)
    report(steps - 1, steps)

    def fitted(start: Start, settings: RefineSettings) -> RigCalibration:
        fit, offsets = joint_fit(kept.where(good), start, settings)
        left_out = tuple(sorted({*out.tolist(), *fit.frames[fit.outlying].tolist()}))
        return RigCalibration(fit, pairs, tuple(wrong), left_out, unreached, offsets, moved=moved)

    rig = fitted(replace(start, noise_px=screening.sigma_px), settings)
    if settings.time_offset:
        drifting = replace(settings, time_drift=True)
        with suppress(StereocalError):  # else the cameras have no drift that can be fitted
            tried = fitted(Start.of(rig.fit, rig.shifts), drifting)
            if any(abs(offset.drift) > DRIFTING * offset.drift_sigma for offset in tried.offsets):
                rig, settings = tried, drifting
    if lenses := lenses_with_distortion(rig):
        freed = replace(settings, lenses={**settings.lenses, **lenses})
        rig = better_held_out(rig, fitted(Start.of(rig.fit, rig.shifts), freed))
    report(steps, steps)
    return rig


def _connected(
    recording: Recording, pairs: Pairs, settings: RefineSettings
) -> tuple[list[str], dict[str, str]]:
    """The cameras that pairs connect, and of others why they do not.

    Raises:
        StereocalError: there is no pair, or a camera has moved.
    """
    if not pairs.fits:
        moved = [moved_in_words(change, pair, settings) for pair, change in pairs.moved.items()]
        raise StereocalError(moved[0] if moved else _no_pair(recording, pairs))
    names = reached(list(recording.cameras), pairs.fits)
    others = [name for name in recording.cameras if name not in names]
    for name in others:
        for pair, movement_of_pair in pairs.moved.items():
            if name in pair:
                raise MovedError(moved_in_words(movement_of_pair, [name], settings))
    return names, {name: _why_unreached(name, pairs) for name in others}


def _consistent(
    recording: Recording, pairs: Pairs, settings: RefineSettings
) -> tuple[Pairs, Fused]:
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


def _why_unreached(name: str, pairs: Pairs) -> str:
    """Why a camera is not connected with the others."""
    camera = camera_in_words(name, begins=True)
    shared = {pair: count for pair, count in pairs.bars.items() if name in pair}
    if not shared:
        return f"{camera} sees no bar that another camera sees too."
    most = max(shared.values())
    if most < FEWEST_BARS:
        return (
            f"{camera} shares {count(most, 'bar')} at most with another one, "
            f"{FEWEST_BARS} are needed: record more bars that both see."
        )
    why = [f"{'-'.join(pair)}: {text}" for pair, text in pairs.failed.items() if name in pair]
    return (
        f"{camera} agrees with none of the others: are its points of this recording, with the same "
        "frame numbers, is its camera file its own, and did it stand still? "
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
