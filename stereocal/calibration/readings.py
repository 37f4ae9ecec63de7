"""Other readings of what was given, and whether the images prefer one: files, signs, sizes.

A camera file of the other camera, a distortion with the wrong sign, a matrix K of another image
size: each is one change of the data set, and the essential matrix of the changed one either fits
better or does not. What is compared is free of the scale: the median reprojection error, and the
spread of the bar's length about its median, both without the frames that contradict the others.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from stereocal.calibration.essential import calibrate_essential
from stereocal.errors import StereocalError
from stereocal.rig.camera import Camera
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Pose, reprojection_errors_of_rays

BARS_TO_TELL = 10
"""Five angles fit the lengths of five bars, and five pairs, whatever the cameras."""

SURELY = 1.5
"""Two simulated cameras whose focal lengths differ by 1 % fit 2 to 6 times worse when their files
are exchanged, a flipped distortion 3 to 30 times, K of half the image 9 to 90 (means of both)."""
MAYBE = 1.15
"""Two real cameras that differ by 0.7 % fit 1.02 and 1.2 times worse exchanged: worth a warning."""

AS_LIKELY = 4.0
"""Focal lengths that explain so nearly as much cannot be told apart: one camera's is too long, or
the other's too short."""

MOST_BEHIND = 0.2
"""Where more points than this lie behind a camera, nothing fits."""

FOCAL_RANGE = np.geomspace(0.3, 12.0, 17)
"""Focal lengths to try, in widths of the image: from a fisheye's to a long telephoto's."""

UNUSABLE = 1e3
"""Worse than any logarithm of a misfit."""

LENGTHS_AGREE = 0.05
"""Lengths that agree within this: with each other, or with what was stated."""


@dataclass(frozen=True)
class Fit:
    """How well a data set fits: reprojection error in px, relative spread of lengths, scale."""

    px: float
    spread: float
    scale: float
    """Stated over reconstructed length of the bar; 1 when baseline and bar agree."""

    @property
    def scale_alone_is_off(self) -> bool:
        """Whether all bars come out wrong by one and the same factor."""
        return bool(self.spread < LENGTHS_AGREE < abs(np.log(self.scale)))

    def gains_of(self, other: Fit) -> tuple[float, float]:
        """How many times better another reading fits, in the images and in the lengths."""
        if not np.isfinite(other.px):
            return 0.0, 0.0
        return self.px / max(other.px, 1e-9), self.spread / max(other.spread, 1e-9)


NOTHING_FITS = Fit(np.inf, np.inf, np.nan)


def fit_of(dataset: Dataset) -> Fit:
    """The fit of the constrained essential matrix; infinite where there is none."""
    try:
        return fit_at(dataset, calibrate_essential(dataset.rays, dataset.baseline_m).pose)
    except StereocalError:
        return NOTHING_FITS


def fit_at(dataset: Dataset, pose: Pose) -> Fit:
    """The fit of a pose; infinite where it has the points behind a camera."""
    px = reprojection_errors_of_rays(pose.R, pose.T, dataset.rays, dataset.pixel_scale).mean(axis=1)
    logs = np.log(dataset.bar_distances_m / dataset.reconstructed_lengths_m(pose))
    known = logs[np.isfinite(logs)]
    if np.isnan(px).mean() > MOST_BEHIND or not len(known):
        return NOTHING_FITS
    middle = float(np.median(known))
    spread = float(np.median(np.abs(known - middle)))
    return Fit(float(np.nanmedian(px)), spread, float(np.exp(middle)))


def check_reading(dataset: Dataset, given: Fit | None = None) -> list[str]:
    """Reject what was evidently given wrongly; a warning where it may be.

    Args:
        given: how well the data set fits as it was given, where that is known already.

    Raises:
        StereocalError: another reading fits images and lengths much better; says which.
    """
    if len(dataset.correspondences.bars) < BARS_TO_TELL:
        return []
    cases = _cases_of_readings(dataset, given or fit_of(dataset))
    if said := _accusation(cases):
        raise StereocalError(said)
    maybe = [case for case in cases if min(case.gains) > 1.0 and max(case.gains) > MAYBE]
    if not maybe:
        return []
    best = max(maybe, key=lambda case: case.better)
    return [
        f"{best.claim}: read so, the points fit {max(best.gains):.2g} times better, too little to "
        "be sure. Look at it."
    ]


def wrongly_given(dataset: Dataset, given: Fit | None = None) -> str:
    """What was given wrongly, focal lengths among it, where that explains the data; else empty.

    For data that do not fit as they were given: a focal length some percent off is found here too.

    Args:
        given: as for `check_reading`.
    """
    if len(dataset.correspondences.bars) < BARS_TO_TELL:
        return ""
    given = given or fit_of(dataset)
    return _accusation(
        [*_cases_of_readings(dataset, given), *_cases_of_focal_lengths(dataset, given)]
    )


@dataclass(frozen=True)
class _Case:
    """Something that may have been given wrongly, and how many times better the data then fit."""

    claim: str
    remedy: str
    gains: tuple[float, float]
    """In the images, and in the lengths."""

    @property
    def better(self) -> float:
        return self.gains[0] * self.gains[1]


def _accusation(cases: Sequence[_Case]) -> str:
    """The case that explains far more than what was given, and those that explain as much."""
    sure = [case for case in cases if min(case.gains) > MAYBE and case.better > SURELY**2]
    if not sure:
        return ""
    best = max(sure, key=lambda case: case.better)
    others = [case for case in sure if case is not best and case.better * AS_LIKELY >= best.better]
    fits = (
        f"so, the points fit {best.gains[0]:.2g} times better in the images and the bar lengths "
        f"{best.gains[1]:.2g} times"
        if np.isfinite(best.better)
        else "the points fit so, and not as given"
    )
    doubt = "".join(f" Or else, as these frames cannot tell: {case.claim}." for case in others)
    return f"{best.claim}: {fits}. {best.remedy}{doubt}"


def _cases_of_readings(dataset: Dataset, given: Fit) -> list[_Case]:
    cases = []
    for reading in _readings(dataset):
        with suppress(StereocalError):
            gains = given.gains_of(fit_of(reading.of(dataset)))
            cases.append(_Case(reading.claim, reading.remedy, gains))
    return cases


def _cases_of_focal_lengths(dataset: Dataset, given: Fit) -> list[_Case]:
    cases = []
    for cameras in (("primary",), ("secondary",), ("primary", "secondary")):
        factor = _best_factor(dataset, cameras)
        if factor is not None:
            gains = given.gains_of(fit_of(_refocused(dataset, cameras, factor)))
            cases.append(_Case(*_focal_length_words(dataset, cameras, factor), gains))
    return cases


@dataclass(frozen=True)
class _Reading:
    """What may have been meant, and what to do then."""

    claim: str
    remedy: str
    primary: Camera
    secondary: Camera
    targets_exchanged: bool = False

    def of(self, dataset: Dataset) -> Dataset:
        """The data set so read.

        Raises:
            StereocalError: it cannot be: a lens that cannot be inverted at a point.
        """
        if self.targets_exchanged:
            dataset = dataset.with_targets_exchanged(dataset.correspondences.frames)
        return replace(dataset, primary=self.primary, secondary=self.secondary)


def _readings(dataset: Dataset) -> Iterator[_Reading]:
    one, two = dataset.primary, dataset.secondary
    if not _same_lens(one, two):
        yield _Reading(
            "The two camera files seem to be exchanged",
            "Exchange the files.",
            replace(two, image_size=one.image_size),
            replace(one, image_size=two.image_size),
        )
    yield _Reading(
        "A and B seem to be exchanged in one of the cameras, in all frames",
        "Exchange the two targets of one camera.",
        one, two, targets_exchanged=True,
    )  # fmt: skip
    for names, first, second in (
        ("primary camera's", _flipped(one), two),
        ("secondary camera's", one, _flipped(two)),
        ("cameras'", _flipped(one), _flipped(two)),
    ):
        yield _Reading(
            f"The {names} distortion coefficients seem to have the wrong sign",
            "Some programs state the correction of the image instead: export the lens in "
            "OpenCV's convention, or change the signs.",
            first, second,
        )  # fmt: skip
    for which, camera in (("primary", one), ("secondary", two)):
        factor = camera.other_size
        if factor is not None:
            width, height = camera.image_size
            scaled = _scaled(camera, 1.0 / factor)
            yield _Reading(
                f"The {which} camera's matrix K seems to be that of an image {factor:.3g} times "
                f"as large as {width}x{height} px",
                "Give K for the size of the images that the points come from.",
                scaled if which == "primary" else one,
                scaled if which == "secondary" else two,
            )


def contradiction(dataset: Dataset, given: Fit | None = None) -> str:
    """What is wrong where the given values contradict each other grossly, or that none can tell.

    The measured lengths are accused where the images are content and all bars come out wrong alike.
    """
    given = given or fit_of(dataset)
    if given.scale_alone_is_off:
        return _lengths_sentence(dataset, given.scale)
    twice = (
        " Both cameras were given the same lens: if they are not of one kind, one file is wrong."
        if _same_lens(dataset.primary, dataset.secondary)
        else ""
    )
    return (
        "Baseline, bar and lenses cannot all be right, and these frames cannot tell which is "
        "wrong. State how well each is known, and look at both camera files: focal lengths, image "
        f"size, signs of the distortion.{twice}"
    )


def _focal_length_words(
    dataset: Dataset, cameras: tuple[str, ...], factor: float
) -> tuple[str, str]:
    """The claim that focal lengths are wrong, and the remedy."""
    given, fitting = (
        " and ".join(f"{scale * getattr(dataset, which).K[0, 0]:.0f}" for which in cameras)
        for scale in (1.0, factor)
    )
    whose = f"{cameras[0]} camera's" if len(cameras) == 1 else "cameras'"
    twice = (
        " Both cameras were given the same lens: was one file given twice?"
        if _same_lens(dataset.primary, dataset.secondary)
        else ""
    )
    return (
        f"The {whose} lens cannot be as given, with a focal length of {given} px; it would be "
        f"about {fitting} px",
        "Calibrate it again, or look whether the file belongs to this camera, lens and image "
        f"size.{twice}",
    )


def _lengths_sentence(dataset: Dataset, scale: float) -> str:
    stated = float(np.median(dataset.bar_distances_m))
    larger = scale > 1.0
    factor = scale if larger else 1.0 / scale
    hint = (
        "The images fix the ratio of the two, not which is wrong: the one that you are less sure "
        "of is to be measured again."
    )
    for size, unit in ((1000.0, "millimetres"), (100.0, "centimetres")):
        if size / 2 < factor < size * 2:
            one, other = ("distance", "baseline") if larger else ("baseline", "distance")
            hint = (
                f"The {one} looks like {unit}, or the {other} is {size:g} times too small. Give "
                "both in metres."
            )
    return (
        f"The distance between the targets is given as {stated:g} m and the baseline as "
        f"{dataset.baseline_m:g} m, but with this baseline the images say a distance of "
        f"{stated / scale:.3g} m. {hint}"
    )


def _best_factor(dataset: Dataset, cameras: tuple[str, ...]) -> float | None:
    """By what to multiply focal lengths so that images and lengths fit best; None for none.

    The stated lengths count too: a scale that is off is a spread of the lengths.
    """

    def badness(log_factor: float) -> float:
        try:
            fit = fit_of(_refocused(dataset, cameras, float(np.exp(log_factor))))
        except StereocalError:
            return UNUSABLE
        if not np.isfinite(fit.px):
            return UNUSABLE
        return float(np.log(max(fit.px, 1e-9)) + np.log(np.hypot(fit.spread, np.log(fit.scale))))

    camera: Camera = getattr(dataset, cameras[0])
    tried = np.log(FOCAL_RANGE * camera.image_size[0] / camera.K[0, 0])
    values = [badness(each) for each in tried]
    at = int(np.argmin(values))
    if values[at] >= UNUSABLE:
        return None
    step = tried[1] - tried[0]
    best = minimize_scalar(
        badness, bounds=(tried[at] - step, tried[at] + step), method="bounded",
        options={"xatol": 1e-3},
    )  # fmt: skip
    return float(np.exp(best.x))


def _same_lens(one: Camera, other: Camera) -> bool:
    return np.array_equal(one.K, other.K) and np.array_equal(one.distortion, other.distortion)


def _flipped(camera: Camera) -> Camera:
    return replace(camera, distortion=-camera.distortion)


def _scaled(camera: Camera, factor: float) -> Camera:
    K = camera.K.copy()
    K[:2] *= factor
    return replace(camera, K=K)


def _refocused(dataset: Dataset, cameras: tuple[str, ...], factor: float) -> Dataset:
    """The data set with other focal lengths of some cameras."""
    changed = {}
    for which in cameras:
        camera = getattr(dataset, which)
        K = camera.K.copy()
        K[[0, 0, 1], [0, 1, 1]] *= factor
        changed[which] = replace(camera, K=K)
    return replace(dataset, **changed)
