"""What is wrong with a whole camera: its file, or that it moved during the recording."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from stereocal.calibration.methods import POOR_LENGTH
from stereocal.errors import StereocalError
from stereocal.fit.errors.stated_inputs import moved_length
from stereocal.fit.least_squares.robust import RobustFit
from stereocal.fit.least_squares.small_steps import lens_places
from stereocal.fit.least_squares.unknowns import RefineSettings, lenses_of
from stereocal.fit.readings.likely_cause import heads_in_words
from stereocal.fit.readings.noise_left import CONTRADICTED
from stereocal.fit.rig_calibration import RigCalibration
from stereocal.fit.screening.movement import Movement
from stereocal.fit.start.pairs import MOST_NOISE
from stereocal.rig.camera import camera_in_words
from stereocal.rig.field_of_view import beyond_in_words
from stereocal.system.numbers import rounded

OUT_OF_STEP = (
    " If the object moved fast, the cameras may be out of step instead: ask for their time offsets."
)
BASELINES_AGREE, FAR_OFF = 3.0, 5.0
"""Standard errors within which all measured baselines fit; and how many times farther they are."""
SOUND_PX = 1.0
"""A rig with less noise is not refused for its noise."""


def refuse_poor_fit(rig: RigCalibration) -> None:
    """Raise an error where the cameras do not fit together, and say what may be the cause."""
    fit, of_pairs = rig.fit, [pair.noise_px for pair in rig.pairs.fits.values()]
    noise = float(np.median(of_pairs))
    if not fit.is_determined:
        seen = "the points do not determine the cameras"
    elif fit.sigma_px > max(MOST_NOISE * noise, SOUND_PX):
        seen = f"{rounded(fit.sigma_px)} px in the rig, {rounded(noise)} px in pairs by themselves"
    elif len(rig.length_errors) and np.quantile(np.abs(rig.length_errors), 0.95) > POOR_LENGTH:
        within = rounded(100 * float(np.quantile(np.abs(rig.length_errors), 0.95)))
        seen = f"95 % of the lengths are within {within} % only"
    else:
        return
    cause = rig.moved or (
        "The points or the file of a camera are wrong, as of mirrored images or of another "
        "recording, and it cannot be told which: calibrate without one camera after the other."
    )
    raise StereocalError(f"The cameras do not fit together: {seen}. {cause}")


def view_warnings(fit: RobustFit) -> list[str]:
    """Points that were left out, and cameras on their heads, of a joint fit that has ended."""
    beyond = filter(None, [beyond_in_words(fit.recording.beyond_view)])
    heads = heads_in_words(fit.poses, [*fit.recording.cameras]) if fit.is_determined else []
    return [*beyond, *heads]


def contradicted_inputs(fit: RobustFit) -> list[str]:
    """Lenses and baselines that the images contradict, of a joint fit that has ended."""
    return [*_lens_warnings(fit), *_baseline_warnings(fit)] if fit.is_determined else []


def _baseline_warnings(fit: RobustFit) -> list[str]:
    """Measured baselines that the rig leaves by more than their uncertainty."""
    names, poses = list(fit.recording.cameras), fit.poses
    stated = {fit.settings.baseline_sigma_m, fit.recording.baseline_sigma_m} != {None}
    warnings = (
        moved_length(
            f"The baseline {names[int(first)]}-{names[int(second)]}",
            (poses[int(second)] @ poses[int(first)].inverse()).baseline,
            measured,
            sigma,
            "stated" if stated else "assumed",
        )
        for first, second, measured, sigma in fit.baselines.tolist()
    )
    return list(filter(None, [*warnings, _exchanged(fit)]))


def _exchanged(fit: RobustFit) -> str:
    """Which two cameras, exchanged, have the measured baselines, if those of the rig are far off:
    lenses that are alike do not tell whose points are whose."""
    names, measured, sigma = list(fit.recording.cameras), fit.baselines[:, 2], fit.baselines[:, 3]
    if len(measured) < 2:
        return ""
    of = fit.baselines[:, :2].astype(np.int64)
    centres = np.array([pose.inverse().T for pose in fit.poses])

    def off(order: list[int]) -> float:
        first, second = centres[np.array(order)[of.T]]
        return float(np.abs((np.linalg.norm(first - second, axis=1) - measured) / sigma).max())

    def with_two_exchanged(pair: tuple[int, int]) -> float:
        return off([sum(pair) - k if k in pair else k for k in as_given])

    as_given = list(range(len(names)))
    a, b = min(combinations(as_given, 2), key=with_two_exchanged)
    best = with_two_exchanged((a, b))
    if best > BASELINES_AGREE or off(as_given) < FAR_OFF * max(best, 1.0):
        return ""
    return (
        f"The measured baselines fit if {names[a]} and {names[b]} are exchanged: check whether "
        "their points are, or their names in the baselines."
    )


def _lens_warnings(fit: RobustFit) -> list[str]:
    """Cameras whose files the images contradict, by focal length or centre."""
    warnings = list[str]()
    priors = lenses_of(fit.recording, fit.settings).values()
    cameras = zip(fit.recording.cameras.items(), priors, strict=True)
    for number, ((name, camera), prior) in enumerate(cameras):
        if not (0 < prior.focal < np.inf and 0 < prior.centre_px < np.inf):
            continue
        fitted, stated = fit.q[lens_places(number)], camera.lens_values
        longer, away = fitted[0] / stated[0] - 1.0, np.linalg.norm(fitted[2:4] - stated[2:4])
        of_focal, of_centre = abs(longer) / prior.focal, away / prior.centre_px
        if of_focal**2 + of_centre**2 <= CONTRADICTED:
            continue
        what = (
            f"its centre would be {rounded(float(away))} px from the stated one, at "
            f"({fitted[2]:.0f}, {fitted[3]:.0f}) px. Were its images cropped, mirrored or turned, "
            "or is it the file of another camera?"
            if of_centre > of_focal
            else f"its focal length would be {rounded(100 * abs(longer))} % "
            f"{'longer' if longer > 0.0 else 'shorter'}. Is it the file of this camera, with this "
            "zoom and focus?"
        )
        warnings.append(f"The images contradict the stated lens of {camera_in_words(name)}: {what}")
    return warnings


def moved_in_words(movement: Movement, names: Sequence[str], settings: RefineSettings) -> str:
    """What to do about a camera that moved.

    Args:
        names: of the camera, or of all that it may be.
    """
    seems = f"seems to have moved at about frame {movement.first}"
    which = (
        f"{camera_in_words(names[0], begins=True)} {seems}, by {movement.in_words}"
        if len(names) == 1
        else f"A camera {seems}, and it cannot be told which: {' or '.join(names)}"
    )
    step = "" if settings.time_offset else OUT_OF_STEP
    return f"{which}. Calibrate with the frames before it, or after it, alone.{step}"
