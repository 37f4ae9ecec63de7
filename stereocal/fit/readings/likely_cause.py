"""Find the likely cause when a data set does not fit.

Candidates in order: single frames, a wrong input, a recording whose geometry does not determine the
pose. If none explains the data, the message says that the cause is unknown.
"""

from collections.abc import Sequence

import numpy as np

from stereocal.calibration.checks import warnings_about_copies
from stereocal.calibration.wrong_inputs import essential_fit, inconsistency_message
from stereocal.errors import StereocalError
from stereocal.fit.least_squares.small_steps import largest_turn_sigma
from stereocal.fit.readings.moving_cameras import LEAST_PX, moving_cameras
from stereocal.fit.readings.wrong_inputs import find_wrong_input, nothing_fits
from stereocal.fit.refined_result import RefinedResult
from stereocal.fit.screening.screen import (
    MAXIMUM_LEFT_OUT,
    Screening,
    enough_frames,
    screen,
    wide_settings,
)
from stereocal.fit.timing.out_of_step import with_offset_if_out_of_step
from stereocal.rig.camera import CAMERAS, camera_in_words
from stereocal.rig.geometry import AT_ORIGIN, Pose, on_their_heads
from stereocal.rig.pair import Pair
from stereocal.rig.tracks import MeasuredOffset
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import rounded

MAXIMUM_NAMED = 10
LARGEST_SIGMA = np.radians(3.0)
"""An angle with a larger standard error counts as undetermined."""
FLATNESS = 0.02
"""Points whose RMS distance from a plane is a smaller fraction of their depth count as coplanar."""
THIN = 0.15
"""So they do if it is also a smaller fraction of their extent along the plane: a lens of 9 degrees
sees a volume that is thin against its depth, but 0.5 as high as wide."""
MAXIMUM_NOISE_PX = 5.0
"""A fit with more noise explains nothing, and its 3D points are not used."""
NARROW_FIELD = np.radians(6.0)
"""In a smaller field of view all rays are nearly parallel: there is hardly any perspective."""
UPRIGHT = 0.7
"""Least cosine between the vertical and the columns of images that tell it."""
PARALLEL = np.radians(8.0)
"""Bars within this angle of a common direction count as parallel."""


def explain_failure(dataset: Pair, screening: Screening, failure: str = "") -> str:
    """The message for data that no pose of the cameras explains: the likely cause and the remedy.

    Args:
        dataset: the frames to calibrate with.
        screening: of all frames.
        failure: what was seen of it; repeated only where no cause is found.
    """
    offer, frames = "", dataset.correspondences.frames
    if not screening.fit:
        screening = screen(dataset)
        offer = offer_time_offset(screening.shift)
    fit, dataset = screening.fit, frames_to_judge(dataset, screening)
    if fit is not None:
        bad = fit.frames[fit.outlying & np.isin(fit.frames, frames)]
        if 0 < len(bad) <= MAXIMUM_LEFT_OUT * len(frames):
            named = ", ".join(str(frame) for frame in bad[:MAXIMUM_NAMED])
            return f"Some frames contradict the others ({named}): leave them out."
    nominal = essential_fit(dataset)
    if nominal.a_unit_is_wrong:
        return inconsistency_message(dataset, nominal)
    # The residuals of exchanged files may follow the motion by chance.
    if (
        named := find_wrong_input(dataset.recording, bool(offer))
        or offer
        or " ".join(warnings_about_copies(dataset))
    ):
        return named
    if nominal.only_scale_is_wrong:
        return inconsistency_message(dataset, nominal)
    if moving := moving_cameras(dataset.recording):
        return moving
    geometry = geometry_warning(fit) if fit is not None else ""
    unknown = nothing_fits(dataset) or inconsistency_message(dataset, nominal)
    return geometry or f"{failure}{unknown}"


def warnings_about_fit(dataset: Pair, screening: Screening, poor: bool, offer: str) -> list[str]:
    """Warnings about a calibration that succeeded but may be wrong.

    Args:
        poor: whether the length errors of the 3D set are large.
        offer: the message of `offer_time_offset`; no input is blamed where it explains the fit.
    """
    failure = screening.failure and f"The frames could not be screened: {screening.failure}"
    fit, dataset = screening.fit, frames_to_judge(dataset, screening)
    is_noisy = fit is not None and fit.sigma_px.value > LEAST_PX
    cause = offer or (moving_cameras(dataset.recording) if is_noisy else "")
    cause = cause or (geometry_warning(fit) if fit is not None else "")
    heads = heads_in_words((AT_ORIGIN, fit.pose), CAMERAS) if fit is not None else []
    if poor and not cause:
        nominal = essential_fit(dataset)
        cause = find_wrong_input(dataset.recording) or nothing_fits(dataset)
        if not cause and nominal.only_scale_is_wrong:
            cause = inconsistency_message(dataset, nominal)
    return [*filter(None, (failure, screening.together, cause)), *heads]


def heads_in_words(poses: Sequence[Pose], names: Sequence[str]) -> list[str]:
    """Which cameras stand on their heads beside the others; of two it is one of them.

    Args:
        poses: as of `on_their_heads`, of the cameras with these names.
    """
    turned = on_their_heads(poses, UPRIGHT)
    one = [camera_in_words(names[number], begins=True) for number in turned]
    others = "others" if len(names) > 2 else "other"
    return [
        f"{which} stands on its head beside the {others}. If it was not mounted so, its images are "
        "turned by half a turn."
        for which in (one if len(names) > 2 else ["One of the two cameras"][: len(turned)])
    ]


def frames_to_judge(dataset: Pair, screening: Screening) -> Pair:
    """The frames by which inputs are judged: all, where so many were left out that the others may
    have been kept because of a wrong input."""
    return screening.full_dataset if screening.share > MAXIMUM_LEFT_OUT else dataset


def claimed_offset(screening: Screening) -> MeasuredOffset | None:
    """The offset by which the cameras are out of step; None if not, or if it is applied."""
    dataset = screening.full_dataset
    unjudged = screening.fit is None and not screening.failure and not screening.time_note
    if not unjudged or not enough_frames(dataset):
        return None
    try:
        fit, note = with_offset_if_out_of_step(dataset, wide_settings(dataset))
    except StereocalError:
        return None
    return fit.time_offset if note else None


def offer_time_offset(offset: MeasuredOffset | None) -> str:
    """A message if there is a `claimed_offset`."""
    if offset is None:
        return ""
    return (
        f"The cameras seem to be out of step: the residuals follow the motion in the images, as if "
        f"the secondary took its frames {offset.frames:+.2f} ± {offset.sigma:.2f} frame intervals "
        "late. Calibrate with the time offset as an unknown (in the settings of the page "
        "Calibrate; on the command line --time-offset)."
    )


def geometry_warning(fit: RefinedResult) -> str:
    """Why the pose of the cameras is poorly determined, and what to record; empty if it is not.

    Args:
        fit: a fit with wide priors, such as that of the screening.
    """
    if not fit.sigma_px.value < MAXIMUM_NOISE_PX:
        return ""
    largest = largest_turn_sigma(fit.at, fit.covariance)
    ends = fit.used_points_m
    points, flat = _finite(ends.reshape(-1, 3)), False
    if len(points) > 3:  # the RMS distances from the best plane, and along it the shorter way
        sizes = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        thickness = sizes[-1] / np.sqrt(len(points))
        flat = thickness < FLATNESS * np.median(points[:, 2]) and sizes[-1] < THIN * sizes[-2]
    if not (largest > LARGEST_SIGMA or flat):
        return ""
    known = f"the largest standard error of an angle is {np.degrees(largest):.1f} degrees"
    rays = _unit(points)
    # Twice the largest angle between the rays to the points and their mean.
    cosines = rays @ _unit(rays.mean(axis=0)) if len(points) else np.array([-1.0])
    view = float(2.0 * np.arccos(np.clip(cosines.min(), -1.0, 1.0)))
    if view < NARROW_FIELD:
        return (
            f"The bars cover only {np.degrees(view):.1f} degrees of the view, "
            f"where perspective hardly shows: {known}. Use shorter lenses, or move the bar "
            "through the whole view and the whole depth."
        )
    if flat:
        return (
            f"All bars lie close to one plane ({rounded(np.median(points[:, 2]), 3)} m away): "
            f"{known}, because two poses of the cameras give the same images of a plane. Record "
            "the bar at other depths too."
        )
    directions = _unit(_finite(ends[:, 1] - ends[:, 0]))
    if len(directions) > 1:  # the RMS angle between the bars and their common axis
        along = np.abs(directions @ np.linalg.svd(directions)[2][0])
        if np.sqrt(np.mean(np.square(np.arccos(np.minimum(along, 1.0))))) < PARALLEL:
            return f"All bars are parallel: {known}. Turn the bar between the photographs."
    return f"These frames determine the pose of the cameras poorly: {known}. Record more bars."


def _finite(points: FloatArray) -> FloatArray:
    return points[np.isfinite(points).all(axis=1)]


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
