"""Which other readings of the inputs are worth a closer look, by the essential matrix of each.

The fit of a reading is measured by two quantities that do not depend on the scale: the median
reprojection error, and the spread of the bar lengths about their median. Both can be better by
chance: of lenses of 9 degrees the essential matrix hardly fixes the lengths. So these readings only
are suspects; `fit.readings.judge` judges them, with all the images and lengths in one fit.
"""

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import minimize_scalar

from stereocal.calibration.corrections import fitting_px, scaled, with_changed
from stereocal.calibration.essential import calibrate_essential
from stereocal.calibration.reading import Group, Reading, Row, Way
from stereocal.errors import StereocalError
from stereocal.rig.camera import one_file_in_words
from stereocal.rig.geometry import Pose, reprojection_errors_of_rays
from stereocal.rig.pair import Pair
from stereocal.rig.recording import CameraPair, Recording
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
"""The largest factor by which wrong camera files change all lengths."""
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


def essential_fit(dataset: Pair) -> PoseFit:
    """The fit of the constrained essential matrix; `NO_FIT` if there is no solution."""
    try:
        return pose_fit(dataset, calibrate_essential(dataset.rays, dataset.baseline_m).pose)
    except StereocalError:
        return NO_FIT


def pose_fit(dataset: Pair, pose: Pose) -> PoseFit:
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


def suspects(recording: Recording, readings: Iterable[Reading]) -> list[Reading]:
    """The readings that seem to fit better before the two cameras of their group; all of them where
    the points do not fit as they are given."""
    suspected, as_given = list[Reading](), dict[CameraPair, PoseFit | None]()
    for reading in readings:
        pair, likely = reading.group.pair, reading.way.is_likely
        if pair not in as_given:
            shown = recording.pair(*pair)
            enough = len(shown.correspondences.bars) >= MINIMUM_BARS
            as_given[pair] = essential_fit(shown) if enough else None
        if (nominal := as_given[pair]) is None:
            continue
        if likely or not (
            nominal.px < fitting_px(recording.cameras.values())
            and nominal.spread < LENGTH_TOLERANCE
        ):
            suspected.append(reading)
            continue
        with suppress(StereocalError):
            gains = _gains(nominal, essential_fit(reading.way.corrected().pair(*pair)))
            if min(gains) > 1.0 and max(gains) > POSSIBLE_GAIN:
                suspected.append(reading)
    return suspected


def _gains(nominal: PoseFit, reading: PoseFit) -> tuple[float, float]:
    """How many times better a reading fits in the images and in the lengths; 0 if not at all."""
    if not np.isfinite(reading.px):
        return 0.0, 0.0
    return nominal.px / max(reading.px, 1e-9), nominal.spread / max(reading.spread, 1e-9)


def _of_another_lens(recording: Recording, group: Group) -> Iterator[Way]:
    """Other focal lengths, at the best factor."""
    cameras = [recording.cameras[name] for name in group.names]
    focal_px = FOCAL_RANGE * cameras[0].image_size[0]
    best = _best_factor(recording, group, focal_px / cameras[0].K[0, 0], with_centre=False)
    if best is not None:
        stated, fitting = (
            " and ".join(f"{factor * camera.K[0, 0]:.0f}" for camera in cameras)
            for factor in (1.0, best)
        )
        corrected = partial(_rescaled, recording, group.names, best, with_centre=False)
        yield Way(corrected, {"stated": stated, "fitting": fitting})


def _of_another_size(recording: Recording, group: Group) -> Iterator[Way]:
    """Images of another size, at the best factor."""
    camera = recording.cameras[group.names[0]]
    if camera.size_factor is not None:
        return  # K contradicts the image size: a reading of its own
    best = _best_factor(recording, group, SIZE_FACTORS, with_centre=True)
    if best is not None and abs(best - 1.0) >= SMALLEST_RESIZE:
        width, height = camera.image_size
        values = {
            "about": f"{width * best:.0f}x{height * best:.0f}",
            "times": f"{rounded(best)}",
            "size": f"{width}x{height}",
        }
        yield Way(partial(_rescaled, recording, group.names, best, with_centre=True), values)


def _rescaled(
    recording: Recording, names: Iterable[str], factor: float, with_centre: bool
) -> Recording:
    return with_changed(recording, names, partial(scaled, factor=factor, with_centre=with_centre))


SCALED = (
    Row(
        "The {whose} lens cannot have the stated focal length of {stated} px; about {fitting} px "
        "would fit",
        "Calibrate it again, or check whether the file belongs to this camera, lens and image "
        "size.",
        "each and all",
        _of_another_lens,
        is_estimated=True,
    ),
    Row(
        "The {whose} points seem to be measured in images of about {about} px, {times} times the "
        "size in the camera file, {size} px",
        "Give the points in pixels of the images that the lens was calibrated for, or the camera "
        "file for the images in which they were measured.",
        "each and all",
        _of_another_size,
        "centres that are in the middle of the image",
        is_estimated=True,
    ),
)


def inconsistency_message(dataset: Pair, nominal: PoseFit | None = None) -> str:
    """The message for inputs that contradict each other where no single mistake explains it.

    It names the two measured lengths if only the scale is wrong, and otherwise all inputs.

    Args:
        nominal: the fit of the unchanged data set; computed if None.
    """
    nominal = nominal or essential_fit(dataset)
    if nominal.only_scale_is_wrong:
        return _lengths_message(dataset, nominal.scale)
    same_file = one_file_in_words((dataset.primary, dataset.secondary))  # ends with a space
    return (
        f"{same_file}Baseline, bar and lenses cannot all be right, and these frames cannot tell "
        "which is wrong. State the uncertainty of each, and check both camera files: focal "
        "lengths, image size, signs of the distortion; and, if the bar moved, that both cameras "
        "exposed at the same moment."
    )


def _lengths_message(dataset: Pair, scale: float) -> str:
    """The message for a bar and a baseline that contradict each other; a unit is named where the
    factor between them is within a factor of 2 of its number in a metre.

    Args:
        scale: stated over reconstructed bar length.
    """
    stated_m = float(np.median(dataset.bar_distances_m))
    bar_is_too_long = scale > 1.0  # for the baseline
    factor = scale if bar_is_too_long else 1.0 / scale
    hint = (
        "The images fix the ratio of the two, not which is wrong: measure again the one that you "
        "are less sure of."
    )
    for in_a_metre, unit in ((1000.0, "millimetres"), (100.0, "centimetres")):
        if in_a_metre / 2 < factor < in_a_metre * 2:
            lengths = ("distance", "baseline") if bar_is_too_long else ("baseline", "distance")
            too_large, too_small = lengths
            hint = (
                f"The {too_large} looks like {unit}, or the {too_small} is {in_a_metre:g} times "
                "too small. Enter both in metres."
            )
    return (
        f"The distance between the targets is stated as {stated_m:g} m and the baseline as "
        f"{dataset.baseline_m:g} m, but with this baseline the images give a distance of "
        f"{rounded(stated_m / scale, 3)} m. {hint}"
    )


def _best_factor(
    recording: Recording, group: Group, factors: FloatArray, with_centre: bool
) -> float | None:
    """The factor of the cameras' matrices with the best fit of images and lengths; None if none
    fits.

    A wrong scale counts like a spread of the lengths.
    """
    shown = recording.of_cameras(group.pair)

    def cost(log_factor: float) -> float:
        factor = float(np.exp(log_factor))
        try:
            read = _rescaled(shown, {*group.names} & {*group.pair}, factor, with_centre)
            fit = essential_fit(read.pair(*group.pair))
        except StereocalError:
            return NO_FIT_COST
        if not np.isfinite(fit.px):
            return NO_FIT_COST
        lengths = np.hypot(fit.spread, 0.0 if fit.scale_is_free else np.log(fit.scale))
        return float(np.log(max(fit.px, 1e-9)) + np.log(lengths))

    tried = np.log(factors)
    values = [cost(log_factor) for log_factor in tried]
    if not values or min(values) >= NO_FIT_COST:
        return None
    least, step = int(np.argmin(values)), tried[1] - tried[0]
    bounds = tried[least] - step, tried[least] + step
    best = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-3})
    return float(np.exp(best.x))
