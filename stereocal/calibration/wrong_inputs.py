"""Detect typical mistakes in the inputs: exchanged files, wrong signs, wrong image size.

Each mistake is a hypothesis that changes the data set: camera files exchanged, distortion of the
opposite sign, K for another image size. A hypothesis is accepted if the essential matrix of the
changed data set fits much better. The fit is measured by two quantities that do not depend on the
scale: the median reprojection error, and the spread of the bar lengths about their median. Frames
that contradict the others are left out before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from stereocal.calibration.pose_fit import Fit, essential_fit
from stereocal.errors import StereocalError
from stereocal.rig.camera import Camera, CameraName
from stereocal.rig.compiled import FloatArray
from stereocal.rig.dataset import Dataset
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
    return _message(
        [
            *_test_hypotheses(dataset, nominal),
            *_test_factors(
                dataset, nominal, _with_focal_factor, _focal_factors, _focal_length_message
            ),
            *_test_factors(dataset, nominal, _with_size_factor, _size_factors, _size_message),
        ]
    )


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


def _test_hypotheses(dataset: Dataset, nominal: Fit) -> list[_Tested]:
    tested = []
    for hypothesis in _hypotheses(dataset):
        with suppress(StereocalError):
            gains = nominal.gains_of(essential_fit(hypothesis.apply(dataset)))
            tested.append(_Tested(hypothesis.claim, hypothesis.remedy, gains))
    return tested


def _test_factors(
    dataset: Dataset,
    nominal: Fit,
    apply: Callable[[Dataset, tuple[CameraName, ...], float], Dataset],
    to_try: Callable[[Camera], FloatArray],
    message: Callable[[Dataset, tuple[CameraName, ...], float], tuple[str, str]],
) -> list[_Tested]:
    """Test a factor of one camera, of the other, and of both, at its best value.

    Args:
        apply: the data set with that factor.
        to_try: ascending factors of a camera, between which the best one lies; may be empty.
        message: the claim that the factor is wrong, and the remedy.
    """
    tested = []
    both: list[tuple[CameraName, ...]] = [("primary",), ("secondary",), ("primary", "secondary")]
    for cameras in both:
        factor = _best_factor(dataset, cameras, apply, to_try(getattr(dataset, cameras[0])))
        if factor is not None and not (
            apply is _with_size_factor and abs(factor - 1.0) < SMALLEST_RESIZE
        ):
            gains = nominal.gains_of(essential_fit(apply(dataset, cameras, factor)))
            tested.append(_Tested(*message(dataset, cameras, factor), gains))
    return tested


@dataclass(frozen=True)
class _Hypothesis:
    """What may be wrong, what to do about it, and the corrected inputs."""

    claim: str
    remedy: str
    primary: Camera
    secondary: Camera
    targets_exchanged: bool = False

    def apply(self, dataset: Dataset) -> Dataset:
        """The data set with the corrected inputs."""
        if self.targets_exchanged:
            dataset = dataset.with_targets_exchanged(dataset.correspondences.frames)
        return replace(dataset, primary=self.primary, secondary=self.secondary)


def _hypotheses(dataset: Dataset) -> Iterator[_Hypothesis]:
    one, two = dataset.primary, dataset.secondary
    if not _same_lens(one, two):
        yield _Hypothesis(
            "The two camera files seem to be exchanged",
            "Exchange the files.",
            replace(two, image_size=one.image_size),
            replace(one, image_size=two.image_size),
        )
    yield _Hypothesis(
        "A and B seem to be exchanged in one of the cameras, in all frames",
        "Exchange the two targets of one camera.",
        one,
        two,
        targets_exchanged=True,
    )
    for names, first, second in (
        ("primary camera's", _negated(one), two),
        ("secondary camera's", one, _negated(two)),
        ("cameras'", _negated(one), _negated(two)),
    ):
        yield _Hypothesis(
            f"The {names} distortion coefficients seem to have the wrong sign",
            "Some programs write the inverse (undistorting) coefficients: export the lens in "
            "OpenCV's convention, or change the signs.",
            first,
            second,
        )
    other_one, other_two = _of_other_model(one), _of_other_model(two)
    for names, own, other in (
        ("primary camera's", other_one, two),
        ("secondary camera's", one, other_two),
        ("cameras'", other_one, other_two),
    ):
        if own is not None and other is not None:
            yield _Hypothesis(
                f"The {names} four distortion coefficients seem to be of the other lens model "
                "(k1 k2 k3 k4 of a fisheye, k1 k2 p1 p2 of the usual lens)",
                "Give the camera file again, and state which they are.",
                own,
                other,
            )
    for which, camera in (("primary", one), ("secondary", two)):
        factor = camera.size_factor
        if factor is not None:
            width, height = camera.image_size
            scaled = _scaled(camera, 1.0 / factor)
            yield _Hypothesis(
                f"The {which} camera's matrix K seems to be that of an image {rounded(factor, 3)} "
                f"times as large as {width}x{height} px",
                "Provide K for the size of the images in which the points were measured.",
                scaled if which == "primary" else one,
                scaled if which == "secondary" else two,
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
    same = (
        " Both cameras have the same lens: if they are of different models, one file is wrong."
        if _same_lens(dataset.primary, dataset.secondary)
        else ""
    )
    return (
        "Baseline, bar and lenses cannot all be right, and these frames cannot tell which is "
        "wrong. State the uncertainty of each, and check both camera files: focal lengths, image "
        f"size, signs of the distortion.{same}"
    )


def _size_message(
    dataset: Dataset, cameras: tuple[CameraName, ...], factor: float
) -> tuple[str, str]:
    """The claim that points were measured in images of another size, and the remedy."""
    width, height = getattr(dataset, cameras[0]).image_size
    whose = f"{cameras[0]} camera's" if len(cameras) == 1 else "cameras'"
    return (
        f"The {whose} points seem to be measured in images of about {width * factor:.0f}x"
        f"{height * factor:.0f} px, {rounded(factor)} times the size in the camera file, "
        f"{width}x{height} px",
        "Give the points in pixels of the images that the lens was calibrated for, or the camera "
        "file for the images in which they were measured.",
    )


def _focal_length_message(
    dataset: Dataset, cameras: tuple[CameraName, ...], factor: float
) -> tuple[str, str]:
    """The claim that focal lengths are wrong, and the remedy."""
    stated, fitting = (
        " and ".join(f"{scale * getattr(dataset, which).K[0, 0]:.0f}" for which in cameras)
        for scale in (1.0, factor)
    )
    whose = f"{cameras[0]} camera's" if len(cameras) == 1 else "cameras'"
    same = (
        " Both cameras have the same lens: was one file used twice?"
        if _same_lens(dataset.primary, dataset.secondary)
        else ""
    )
    return (
        f"The {whose} lens cannot have the stated focal length of {stated} px; "
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


def _best_factor(
    dataset: Dataset,
    cameras: tuple[CameraName, ...],
    apply: Callable[[Dataset, tuple[CameraName, ...], float], Dataset],
    factors: FloatArray,
) -> float | None:
    """The factor with the best fit of images and lengths; None if none fits.

    A wrong scale counts like a spread of the lengths.
    """

    def cost(log_factor: float) -> float:
        try:
            fit = essential_fit(apply(dataset, cameras, float(np.exp(log_factor))))
        except StereocalError:
            return NO_FIT_COST
        if not np.isfinite(fit.px):
            return NO_FIT_COST
        return float(np.log(max(fit.px, 1e-9)) + np.log(np.hypot(fit.spread, np.log(fit.scale))))

    tried = np.log(factors)
    values = [cost(each) for each in tried]
    if not values or min(values) >= NO_FIT_COST:
        return None
    at, step = int(np.argmin(values)), tried[1] - tried[0]
    best = minimize_scalar(
        cost, bounds=(tried[at] - step, tried[at] + step), method="bounded", options={"xatol": 1e-3}
    )
    return float(np.exp(best.x))


def _focal_factors(camera: Camera) -> FloatArray:
    return np.asarray(FOCAL_RANGE * camera.image_size[0] / camera.K[0, 0])


def _size_factors(camera: Camera) -> FloatArray:
    """None where K contradicts the image size, which is a hypothesis of its own."""
    return SIZE_FACTORS if camera.size_factor is None else np.empty(0)


def _same_lens(one: Camera, other: Camera) -> bool:
    same = np.array_equal(one.K, other.K) and np.array_equal(one.distortion, other.distortion)
    return same and one.model == other.model


def _of_other_model(camera: Camera) -> Camera | None:
    """The lens with its four coefficients in the other model; None if it has none."""
    if camera.is_fisheye:
        return replace(camera, model="brown")
    if not camera.distortion[:4].any() or camera.distortion[4:].any():
        return None
    return Camera(camera.K, camera.distortion[:4], camera.image_size, model="fisheye")


def _negated(camera: Camera) -> Camera:
    return replace(camera, distortion=-camera.distortion)


def _scaled(camera: Camera, factor: float) -> Camera:
    K = camera.K.copy()
    K[:2] *= factor
    return replace(camera, K=K)


def _with_focal_factor(dataset: Dataset, cameras: tuple[CameraName, ...], factor: float) -> Dataset:
    """The data set with the focal lengths of some cameras multiplied by `factor`."""
    changed = {}
    for which in cameras:
        camera = getattr(dataset, which)
        K = camera.K.copy()
        K[[0, 0, 1], [0, 1, 1]] *= factor
        changed[which] = replace(camera, K=K)
    return replace(dataset, **changed)


def _with_size_factor(dataset: Dataset, cameras: tuple[CameraName, ...], factor: float) -> Dataset:
    """The data set with some cameras for images `factor` times as large."""
    changed: dict[str, Any] = {}
    for which in cameras:
        changed[which] = _scaled(getattr(dataset, which), factor)
    return replace(dataset, **changed)
