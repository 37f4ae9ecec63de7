"""Detect typical mistakes in the inputs: exchanged files, wrong signs, wrong image size.

Each mistake is a hypothesis that changes the data set: camera files exchanged, distortion of the
opposite sign, K for another image size. A hypothesis is accepted if the essential matrix of the
changed data set fits much better. The fit is measured by two quantities that do not depend on the
scale: the median reprojection error, and the spread of the bar lengths about their median. Frames
that contradict the others are left out before.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from stereocal.calibration.essential import calibrate_essential
from stereocal.errors import StereocalError
from stereocal.rig.camera import Camera, CameraName, LensModel
from stereocal.rig.compiled import FloatArray
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Pose, reprojection_errors_of_rays
from stereocal.system.numbers import rounded

MINIMUM_BARS = 10
"""With five bars or five pairs, the five angles fit any cameras."""

CERTAIN_GAIN = 1.5
"""Geometric mean of the gains from which a mistake is certain. Measured on simulated rigs: files of
cameras whose focal lengths differ by 1 % exchanged, 2 to 6; distortion of the wrong sign, 3 to 30;
K of half the image size, 9 to 90."""
POSSIBLE_GAIN = 1.15
"""Gain from which a warning is given. Two real cameras that differ by 0.7 % gave 1.02 and 1.2."""

COMPARABLE_GAIN = 4.0
"""Explanations whose gains differ by less than this factor are both reported: for instance one
camera's focal length is too long, or the other's too short."""

FOCAL_RANGE = np.geomspace(0.3, 12.0, 17)
"""Focal lengths to try, in image widths: from fisheye to long telephoto."""

SIZE_FACTORS = np.geomspace(0.2, 5.0, 17)
"""Sizes of the images in which points were measured to try, over that of the camera file."""
SMALLEST_RESIZE = 0.05
"""Sizes that differ by less are not named: nobody resizes images by so little."""

NO_FIT_COST = 1e3
"""Cost of an input with which nothing fits; larger than any other cost."""

MOST_ALTERNATIVES = 3
"""Comparable explanations in one message."""
ONE_OR_BOTH: tuple[tuple[CameraName, ...], ...] = (
    ("primary",),
    ("secondary",),
    ("primary", "secondary"),
)


MAXIMUM_BEHIND = 0.2
"""Fraction of the points behind a camera above which a pose counts as no fit."""
LENGTH_TOLERANCE = 0.05
"""Relative difference up to which lengths count as equal."""


@dataclass(frozen=True)
class Fit:
    """How well a data set fits a pose."""

    px: float
    """Median reprojection error."""
    spread: float
    """Median absolute deviation of the bar lengths, relative."""
    scale: float
    """Median of stated over reconstructed bar length; 1 if baseline and bar agree."""

    @property
    def only_scale_is_wrong(self) -> bool:
        """Whether all bar lengths are wrong by the same factor."""
        return bool(self.spread < LENGTH_TOLERANCE < abs(np.log(self.scale)))


NO_FIT = Fit(np.inf, np.inf, np.nan)


def essential_fit(dataset: Dataset) -> Fit:
    """The fit of the constrained essential matrix; `NO_FIT` if there is no solution."""
    try:
        return pose_fit(dataset, calibrate_essential(dataset.rays, dataset.baseline_m).pose)
    except StereocalError:
        return NO_FIT


def pose_fit(dataset: Dataset, pose: Pose) -> Fit:
    """The fit of a pose; `NO_FIT` if too many points are behind a camera."""
    px = reprojection_errors_of_rays(pose.R, pose.T, dataset.rays, dataset.pixel_scale).mean(axis=1)
    logs = np.log(dataset.bar_distances_m / dataset.reconstructed_lengths_m(pose))
    known = logs[np.isfinite(logs)]
    if np.isnan(px).mean() > MAXIMUM_BEHIND or not len(known):
        return NO_FIT
    median = float(np.median(known))
    spread = float(np.median(np.abs(known - median)))
    return Fit(float(np.nanmedian(px)), spread, float(np.exp(median)))


def check_inputs(dataset: Dataset) -> list[str]:
    """Reject inputs that are certainly wrong; return warnings about those that may be."""
    if len(dataset.correspondences.bars) < MINIMUM_BARS:
        return []
    tested = _test_hypotheses(dataset, essential_fit(dataset))
    if message := _message(tested):
        raise StereocalError(message)
    possible = [
        case for case in tested if min(case.gains) > 1.0 and max(case.gains) > POSSIBLE_GAIN
    ]
    if not possible:
        return []
    best = max(possible, key=lambda case: case.gain)
    return [
        f"{best.claim}: the points would then fit {rounded(max(best.gains))} times better, which "
        "is not enough to be certain. Check it."
    ]


def find_wrong_input(dataset: Dataset, nominal: Fit | None = None) -> str:
    """A message that names the wrong input if one explains the data; else empty.

    For data that do not fit: wrong focal lengths and points measured in images of another size,
    which take longer to test, are considered too.

    Args:
        nominal: the fit of the unchanged data set; computed if None.
    """
    if len(dataset.correspondences.bars) < MINIMUM_BARS:
        return ""
    nominal = nominal or essential_fit(dataset)
    factors = [_test_factors(dataset, nominal, of_size) for of_size in (False, True)]
    return _message([*_test_hypotheses(dataset, nominal), *factors[0], *factors[1]])


@dataclass(frozen=True)
class _Tested:
    """A hypothesis about a wrong input, and how much better the data fit if it is true."""

    claim: str
    remedy: str
    gains: tuple[float, float]
    """In the images, and in the lengths."""

    @property
    def gain(self) -> float:
        return self.gains[0] * self.gains[1]


def _message(tested: Sequence[_Tested]) -> str:
    """The certain hypothesis with the largest gain, and those with comparable gains; or empty."""
    certain = [
        case for case in tested if min(case.gains) > POSSIBLE_GAIN and case.gain > CERTAIN_GAIN**2
    ]
    if not certain:
        return ""
    best = max(certain, key=lambda case: case.gain)
    others = sorted(
        (case for case in certain if case is not best and case.gain * COMPARABLE_GAIN >= best.gain),
        key=lambda case: -case.gain,
    )[:MOST_ALTERNATIVES]
    fits = (
        f"the points would then fit {rounded(best.gains[0])} times better in the images and the "
        f"bar lengths {rounded(best.gains[1])} times"
        if np.isfinite(best.gain)
        else "the points would then fit, and otherwise do not"
    )
    alternatives = f" Or: {'. Or: '.join(case.claim for case in others)}." if others else ""
    return f"{best.claim}: {fits}. {best.remedy}{alternatives}"


def _changed(
    dataset: Dataset, cameras: Sequence[CameraName], change: Callable[[Camera], Camera]
) -> Dataset:
    """The data set with some of its cameras changed."""
    changes: dict[str, Any] = {which: change(getattr(dataset, which)) for which in cameras}
    return replace(dataset, **changes)


def _whose(cameras: Sequence[CameraName]) -> str:
    return f"{cameras[0]} camera's" if len(cameras) == 1 else "cameras'"


def _tested(claim: str, remedy: str, nominal: Fit, found: Fit) -> _Tested:
    if not np.isfinite(found.px):
        return _Tested(claim, remedy, (0.0, 0.0))
    gains = nominal.px / max(found.px, 1e-9), nominal.spread / max(found.spread, 1e-9)
    return _Tested(claim, remedy, gains)


def _test_hypotheses(dataset: Dataset, nominal: Fit) -> list[_Tested]:
    tested = []
    for claim, remedy, corrected in _hypotheses(dataset):
        with suppress(StereocalError):
            tested.append(_tested(claim, remedy, nominal, essential_fit(corrected())))
    return tested


def _test_factors(dataset: Dataset, nominal: Fit, of_size: bool) -> list[_Tested]:
    """Test another focal length, or size of the images, of one camera, of the other, and of both,
    each at its best factor."""

    def fit(log_factor: float) -> Fit:
        factor = float(np.exp(log_factor))
        change = partial(_scaled, factor=factor, with_centre=of_size)
        return essential_fit(_changed(dataset, cameras, change))

    tested = []
    for cameras in ONE_OR_BOTH:
        camera: Camera = getattr(dataset, cameras[0])
        if of_size and camera.size_factor is not None:
            continue  # K contradicts the image size: a hypothesis of its own
        focal = FOCAL_RANGE * camera.image_size[0] / camera.K[0, 0]
        best = _best_factor(fit, SIZE_FACTORS if of_size else focal)
        if best is None or (of_size and abs(np.exp(best) - 1.0) < SMALLEST_RESIZE):
            continue
        message = _size_message if of_size else _focal_message
        claim, remedy = message(dataset, cameras, float(np.exp(best)))
        tested.append(_tested(claim, remedy, nominal, fit(best)))
    return tested


def _hypotheses(dataset: Dataset) -> Iterator[tuple[str, str, Callable[[], Dataset]]]:
    """What may be wrong, what to do about it, and the corrected data set."""
    one, two = dataset.primary, dataset.secondary
    if not _same_lens(one, two):
        sizes = {"primary": one.image_size, "secondary": two.image_size}
        exchanged = {"primary": two, "secondary": one}
        own = {name: replace(exchanged[name], image_size=size) for name, size in sizes.items()}
        yield (
            "The two camera files seem to be exchanged",
            "Exchange the files.",
            partial(replace, dataset, **own),
        )
    yield (
        "A and B seem to be exchanged in one of the cameras, in all frames",
        "Exchange the two targets of one camera.",
        partial(dataset.with_targets_exchanged, dataset.correspondences.frames),
    )
    for cameras in ONE_OR_BOTH:
        yield (
            f"The {_whose(cameras)} distortion coefficients seem to have the wrong sign",
            "Some programs write the inverse (undistorting) coefficients: export the lens in "
            "OpenCV's convention, or change the signs.",
            partial(_changed, dataset, cameras, _negated),
        )
    for cameras in ONE_OR_BOTH:
        if all(_has_other_model(getattr(dataset, which)) for which in cameras):
            yield (
                f"The {_whose(cameras)} four distortion coefficients seem to be of the other lens "
                "model (k1 k2 k3 k4 of a fisheye, k1 k2 p1 p2 of the usual lens)",
                "Give the camera file again, and state which they are.",
                partial(_changed, dataset, cameras, _of_other_model),
            )
    for cameras, camera in zip(ONE_OR_BOTH, (one, two), strict=False):
        factor = camera.size_factor
        if factor is not None:
            width, height = camera.image_size
            yield (
                f"The {_whose(cameras)} matrix K seems to be that of an image {rounded(factor, 3)} "
                f"times as large as {width}x{height} px",
                "Provide K for the size of the images in which the points were measured.",
                partial(_changed, dataset, cameras, partial(_scaled, factor=1.0 / factor)),
            )


def inconsistency_message(dataset: Dataset, nominal: Fit | None = None) -> str:
    """The message for inputs that contradict each other where no single mistake explains it.

    It names the two measured lengths if only the scale is wrong, and otherwise all inputs.

    Args:
        nominal: the fit of the unchanged data set; computed if None.
    """
    nominal = nominal or essential_fit(dataset)
    if nominal.only_scale_is_wrong:
        return _lengths_message(dataset, nominal.scale)
    same = " Both cameras have the same lens: if they are of different models, one file is wrong."
    if not _same_lens(dataset.primary, dataset.secondary):
        same = ""
    return (
        "Baseline, bar and lenses cannot all be right, and these frames cannot tell which is "
        "wrong. State the uncertainty of each, and check both camera files: focal lengths, image "
        f"size, signs of the distortion.{same}"
    )


def _size_message(
    dataset: Dataset, cameras: Sequence[CameraName], factor: float
) -> tuple[str, str]:
    width, height = getattr(dataset, cameras[0]).image_size
    return (
        f"The {_whose(cameras)} points seem to be measured in images of about {width * factor:.0f}x"
        f"{height * factor:.0f} px, {rounded(factor)} times the size in the camera file, "
        f"{width}x{height} px",
        "Give the points in pixels of the images that the lens was calibrated for, or the camera "
        "file for the images in which they were measured.",
    )


def _focal_message(
    dataset: Dataset, cameras: Sequence[CameraName], factor: float
) -> tuple[str, str]:
    stated, fitting = (
        " and ".join(f"{scale * getattr(dataset, which).K[0, 0]:.0f}" for which in cameras)
        for scale in (1.0, factor)
    )
    same = " Both cameras have the same lens: was one file used twice?"
    if not _same_lens(dataset.primary, dataset.secondary):
        same = ""
    return (
        f"The {_whose(cameras)} lens cannot have the stated focal length of {stated} px; "
        f"about {fitting} px would fit",
        "Calibrate it again, or check whether the file belongs to this camera, lens and image "
        f"size.{same}",
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


def _best_factor(fit: Callable[[float], Fit], factors: FloatArray) -> float | None:
    """The logarithm of the factor with the best fit of images and lengths; None if none fits.

    A wrong scale counts like a spread of the lengths.
    """

    def cost(log_factor: float) -> float:
        try:
            found = fit(log_factor)
        except StereocalError:
            return NO_FIT_COST
        if not np.isfinite(found.px):
            return NO_FIT_COST
        lengths = np.hypot(found.spread, np.log(found.scale))
        return float(np.log(max(found.px, 1e-9)) + np.log(lengths))

    tried = np.log(factors)
    values = [cost(each) for each in tried]
    if not values or min(values) >= NO_FIT_COST:
        return None
    at, step = int(np.argmin(values)), tried[1] - tried[0]
    bounds = tried[at] - step, tried[at] + step
    best = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-3})
    return float(best.x)


def _same_lens(one: Camera, other: Camera) -> bool:
    same = np.array_equal(one.K, other.K) and np.array_equal(one.distortion, other.distortion)
    return same and one.model == other.model


def _has_other_model(camera: Camera) -> bool:
    """Whether the lens has just the four coefficients that the other model has too."""
    own = camera.distortion
    return camera.is_fisheye or bool(own[:4].any() and not own[4:].any())


def _of_other_model(camera: Camera) -> Camera:
    model: LensModel = "brown" if camera.is_fisheye else "fisheye"
    return Camera(camera.K, camera.distortion[:4], camera.image_size, model=model)


def _negated(camera: Camera) -> Camera:
    return replace(camera, distortion=-camera.distortion)


def _scaled(camera: Camera, factor: float, with_centre: bool = True) -> Camera:
    """The camera of images this many times as large, or with such a focal length."""
    K = camera.K.copy()
    K[:2, : 3 if with_centre else 2] *= factor
    return replace(camera, K=K)
