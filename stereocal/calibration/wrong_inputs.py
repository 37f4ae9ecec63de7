"""Which other readings of the inputs are worth a closer look, by the essential matrix of each.

The fit of a reading is measured by two quantities that do not depend on the scale: the median
reprojection error, and the spread of the bar lengths about their median. Both can be better by
chance: of lenses of 9 degrees the essential matrix hardly fixes the lengths. So these readings only
are suspects; `refined.best_reading` judges them, with all the images and lengths in one fit.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np
from scipy.optimize import minimize_scalar

from stereocal.calibration.corrections import (
    Given,
    cameras_of,
    fitting_px,
    scaled,
    whose,
    with_changed,
)
from stereocal.calibration.essential import calibrate_essential
from stereocal.calibration.readings import Group, Reading
from stereocal.errors import StereocalError
from stereocal.rig.camera import one_file_in_words
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Pose, reprojection_errors_of_rays
from stereocal.rig.recording import Recording
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import rounded

MINIMUM_BARS = 10
"""With five bars or five pairs, the five angles fit any cameras."""

POSSIBLE_GAIN = 1.15
"""Gain of a suspect in images or lengths. Two real cameras that differ by 0.7 % gave 1.02 and 1.2.
Measured on simulated rigs: files of cameras whose focal lengths differ by 1 % exchanged, 2 to 6;
distortion of the wrong sign, 3 to 30; K of half the image size, 9 to 90."""

FOCAL_RANGE = np.geomspace(0.3, 12.0, 17)
"""Focal lengths to try, in image widths: from fisheye to long telephoto."""

SIZE_FACTORS = np.geomspace(0.2, 5.0, 17)
"""Sizes of the images in which points were measured to try, over that of the camera file."""
SMALLEST_RESIZE = 0.05
"""Sizes that differ by less are not named: nobody resizes images by so little."""

NO_FIT_COST = 1e3
"""Cost of an input with which nothing fits; larger than any other cost."""

MAXIMUM_BEHIND = 0.2
"""Fraction of the points behind a camera above which a pose counts as no fit."""
LARGEST_SCALE = 20.0
"""By which wrong camera files change all lengths, at most."""
LENGTH_TOLERANCE = 0.05
"""Relative difference up to which lengths count as equal."""


@dataclass(frozen=True)
class PoseFit:
    """How well a data set fits a pose."""

    px: float
    """Median reprojection error."""
    spread: float
    """Median absolute deviation of the bar lengths, relative."""
    scale: float
    """Median of stated over reconstructed bar length; 1 if baseline and bar agree."""
    scale_is_free: bool = False
    """Whether the baseline is free, so that the scale tells nothing."""
    pose: Pose | None = None
    """None for `NO_FIT`."""

    @property
    def only_scale_is_wrong(self) -> bool:
        """Whether all bar lengths are wrong by the same factor."""
        return bool(self.spread < LENGTH_TOLERANCE < abs(np.log(self.scale)))

    @property
    def a_unit_is_wrong(self) -> bool:
        """Whether they are by a factor that no camera file explains."""
        return self.only_scale_is_wrong and bool(abs(np.log(self.scale)) > np.log(LARGEST_SCALE))


NO_FIT = PoseFit(np.inf, np.inf, np.nan)


def essential_fit(dataset: Dataset) -> PoseFit:
    """The fit of the constrained essential matrix; `NO_FIT` if there is no solution."""
    try:
        return pose_fit(dataset, calibrate_essential(dataset.rays, dataset.baseline_m).pose)
    except StereocalError:
        return NO_FIT


def pose_fit(dataset: Dataset, pose: Pose) -> PoseFit:
    """The fit of a pose; `NO_FIT` if too many points are behind a camera."""
    px = reprojection_errors_of_rays(pose.R, pose.T, dataset.rays, dataset.pixel_scale).mean(axis=1)
    with np.errstate(divide="ignore"):  # both ends at one place
        logs = np.log(dataset.bar_distances_m / dataset.reconstructed_lengths_m(pose))
    known = logs[np.isfinite(logs)]
    if np.isnan(px).mean() > MAXIMUM_BEHIND or not len(known):
        return NO_FIT
    median = float(np.median(known))
    spread = float(np.median(np.abs(known - median)))
    free = dataset.baseline_is_free
    return PoseFit(float(np.nanmedian(px)), spread, float(np.exp(median)), free, pose)


def suspects(
    shown: Dataset, readings: Iterable[Reading[Given]], seen: Callable[[Given], Dataset]
) -> list[Reading[Given]]:
    """The readings that seem to fit better; all of them where the points do not fit as they are
    given.

    Args:
        shown: two cameras, by which the readings are judged.
        seen: these two, of corrected data.
    """
    found: list[Reading[Given]] = []
    if len(shown.correspondences.bars) < MINIMUM_BARS:
        return found
    nominal = essential_fit(shown)
    if not (nominal.px < fitting_px(shown) and nominal.spread < LENGTH_TOLERANCE):
        return list(readings)
    for reading in readings:
        if reading.is_likely:
            found.append(reading)
            continue
        with suppress(StereocalError):
            gains = _gains(nominal, essential_fit(seen(reading.corrected())))
            if min(gains) > 1.0 and max(gains) > POSSIBLE_GAIN:
                found.append(reading)
    return found


def _gains(nominal: PoseFit, reading: PoseFit) -> tuple[float, float]:
    """How many times better a reading fits in the images and in the lengths; 0 if not at all."""
    if not np.isfinite(reading.px):
        return 0.0, 0.0
    return nominal.px / max(reading.px, 1e-9), nominal.spread / max(reading.spread, 1e-9)


def scaled_readings(data: Given, groups: Sequence[Group]) -> Iterator[Reading[Given]]:
    """Another focal length, or size of the images, of the cameras of each group, at its best
    factor."""
    for of_size, group in product((False, True), groups):
        camera = cameras_of(group.shown)[group.roles[0]]
        if of_size and camera.size_factor is not None:
            continue  # K contradicts the image size: a reading of its own
        focal = FOCAL_RANGE * camera.image_size[0] / camera.K[0, 0]
        shown = partial(_rescaled, group.shown, group.roles, of_size)
        best = _best_factor(shown, SIZE_FACTORS if of_size else focal)
        if best is None or (of_size and abs(np.exp(best) - 1.0) < SMALLEST_RESIZE):
            continue
        message = _size_message if of_size else _focal_message
        claim, remedy = message(data, group.names, float(np.exp(best)))
        corrected = partial(_rescaled, data, group.names, of_size, best)
        yield Reading(claim, remedy, corrected, group.names, is_estimated=True)


def _rescaled(data: Given, names: Sequence[str], of_size: bool, log_factor: float) -> Given:
    change = partial(scaled, factor=float(np.exp(log_factor)), with_centre=of_size)
    return with_changed(data, names, change)


def inconsistency_message(dataset: Dataset, nominal: PoseFit | None = None) -> str:
    """The message for inputs that contradict each other where no single mistake explains it.

    It names the two measured lengths if only the scale is wrong, and otherwise all inputs.

    Args:
        nominal: the fit of the unchanged data set; computed if None.
    """
    nominal = nominal or essential_fit(dataset)
    if nominal.only_scale_is_wrong:
        return _lengths_message(dataset, nominal.scale)
    return (
        f"{one_file_in_words((dataset.primary, dataset.secondary))}Baseline, bar and lenses "
        "cannot all be right, and these frames cannot tell which is wrong. State the uncertainty "
        "of each, and check both camera files: focal lengths, image size, signs of the distortion; "
        "and, if the bar moved, that both cameras exposed at the same moment."
    )


def _size_message(
    data: Dataset | Recording, names: Sequence[str], factor: float
) -> tuple[str, str]:
    width, height = cameras_of(data)[names[0]].image_size
    return (
        f"The {whose(data, names)} points seem to be measured in images of about "
        f"{width * factor:.0f}x{height * factor:.0f} px, {rounded(factor)} times the size in the "
        f"camera file, {width}x{height} px",
        "Give the points in pixels of the images that the lens was calibrated for, or the camera "
        "file for the images in which they were measured.",
    )


def _focal_message(
    data: Dataset | Recording, names: Sequence[str], factor: float
) -> tuple[str, str]:
    cameras = [cameras_of(data)[name] for name in names]
    stated, fitting = (
        " and ".join(f"{scale * camera.K[0, 0]:.0f}" for camera in cameras)
        for scale in (1.0, factor)
    )
    remedy = (
        "Calibrate it again, or check whether the file belongs to this camera, lens and image size."
    )
    return (
        f"The {whose(data, names)} lens cannot have the stated focal length of {stated} px; "
        f"about {fitting} px would fit",
        remedy,
    )


def _lengths_message(dataset: Dataset, scale: float) -> str:
    stated = float(np.median(dataset.bar_distances_m))
    larger = scale > 1.0
    factor = scale if larger else 1.0 / scale
    hint = (
        "The images fix the ratio of the two, not which is wrong: measure again the one that you "
        "are less sure of."
    )
    for size, unit in ((1000.0, "millimetres"), (100.0, "centimetres")):
        if size / 2 < factor < size * 2:
            one, other = ("distance", "baseline") if larger else ("baseline", "distance")
            hint = (
                f"The {one} looks like {unit}, or the {other} is {size:g} times too small. Enter "
                "both in metres."
            )
    return (
        f"The distance between the targets is stated as {stated:g} m and the baseline as "
        f"{dataset.baseline_m:g} m, but with this baseline the images give a distance of "
        f"{rounded(stated / scale, 3)} m. {hint}"
    )


def _best_factor(corrected: Callable[[float], Dataset], factors: FloatArray) -> float | None:
    """The logarithm of the factor with the best fit of images and lengths; None if none fits.

    A wrong scale counts like a spread of the lengths.
    """

    def cost(log_factor: float) -> float:
        try:
            found = essential_fit(corrected(log_factor))
        except StereocalError:
            return NO_FIT_COST
        if not np.isfinite(found.px):
            return NO_FIT_COST
        lengths = np.hypot(found.spread, 0.0 if found.scale_is_free else np.log(found.scale))
        return float(np.log(max(found.px, 1e-9)) + np.log(lengths))

    tried = np.log(factors)
    values = [cost(each) for each in tried]
    if not values or min(values) >= NO_FIT_COST:
        return None
    at, step = int(np.argmin(values)), tried[1] - tried[0]
    bounds = tried[at] - step, tried[at] + step
    best = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-3})
    return float(best.x)
