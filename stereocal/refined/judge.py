"""What was given, judged with its other readings: how much noise each would leave.

`Judge` is the same for two cameras (`best_reading`) and for more (`network.wrong_inputs`): they
differ in how they are fitted, and in the readings of their frames.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Generic

import numpy as np
from scipy.special import chdtri

from stereocal.calibration.corrections import (
    Given,
    cameras_of,
    fitting_px,
    scaled,
    whose,
    with_files,
)
from stereocal.calibration.readings import (
    ESTIMATED_HANDICAP,
    Group,
    Reading,
    exchanged_files,
    readings_of_cameras,
    readings_of_points,
)
from stereocal.calibration.wrong_inputs import scaled_readings
from stereocal.errors import StereocalError
from stereocal.refined.refine import RefinedResult, refine
from stereocal.refined.robust import RobustFit
from stereocal.refined.unknowns import LensPrior, RefineSettings
from stereocal.rig.camera import Camera, same_lens
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Pose, on_their_heads
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import rounded

CROPPED = (
    "Was the image cropped? Then subtract what was cut off on the left and above from cx and cy, "
    "or give the points in pixels of the whole image."
)
HELD_LENGTHS = 1e-3
"""Scatter of the bars, as a fraction: what is wrong must show in pixels."""
MOST_STEPS = 30
ANY_LENS = LensPrior(0.3, 50.0)
CERTAIN_GAIN, POSSIBLE_GAIN = 1.5, 1.15
"""How many times the noise as given is that of a reading which is named as certain, or as possible.
"""
CONTRADICTED, FAR_FROM_FILE, BETTER = 30.0, 100.0, 0.3
"""Chi-squares of the lenses about the stated ones, from which on a reading may explain them that
fits the images no better, or one that estimates a value; and what it leaves of them, at most."""
EQUAL = 1.05
"""Noise that counts as equal there."""
ALIKE = ESTIMATED_HANDICAP
"""Readings whose noise differs by less explain the data equally well: one camera's focal length is
too long, or the other's too short. So do u and v from the other side, but for a camera that would
stand on its head; that counts as so many times the noise."""
SMALLEST_SHIFT, LARGEST_SHIFT = 10.0, 300.0
"""Of a centre, in units of `fitting_px`: 3 and 90 % of the diagonal. Smaller ones are named as an
input that disagrees."""
LARGEST_EXPONENT = 20.0
MOST_ALTERNATIVES = 3
"""Comparable explanations in one message."""


@dataclass(frozen=True)
class Noise:
    """What a fit leaves."""

    px: float = np.inf
    largest_px: float = 0.0
    """The largest that is noise of image points."""
    of_lenses: float = 0.0
    """Chi-square of the lenses about the stated ones, where it is looked at."""

    @property
    def fits(self) -> bool:
        """Whether it is noise of image points, of lenses that are as their files say."""
        return self.px < self.largest_px and self.of_lenses < CONTRADICTED


@dataclass(frozen=True)
class JudgedReading(Generic[Given]):
    """A reading and the noise that it leaves."""

    reading: Reading[Given]
    noise: Noise

    @property
    def rank(self) -> float:
        """The reading with the least is the best."""
        return self.reading.handicap * self.noise.px


class Judge(ABC, Generic[Given]):
    """What was given, and which readings of it fit."""

    part: Given
    """Enough of it to tell."""
    groups: Sequence[Group]
    about: Sequence[str]
    """The cameras that the readings are to concern."""
    known_cameras: Mapping[str, Camera]
    """All, of which the part may have some."""
    out_of_step = False
    """Whether cameras out of step seem to explain the data."""

    @property
    @abstractmethod
    def nominal(self) -> Noise:
        """What the fit leaves as given."""

    @property
    @abstractmethod
    def suspected(self) -> list[Reading[Given]]:
        """The readings that seem to fit better."""

    @abstractmethod
    def readings_in_time(self) -> Iterator[Reading[Given]]:
        """Those of the order of frames, and of cameras that moved."""

    @abstractmethod
    def refitted(self, files: Mapping[str, Camera]) -> Mapping[str, Camera]:
        """The lenses of some cameras, with files to start from, if they may be any; none where
        nothing fits."""

    def every_reading(self) -> Iterator[Reading[Given]]:
        """All of them, which are of `part` but for those in time."""
        part = self.part
        yield from self.of_one_file()
        yield from exchanged_files(part, self.about, self.known_cameras)
        yield from readings_of_cameras(part, self.groups)
        yield from readings_of_points(part, self.groups)
        yield from self.readings_in_time()
        if not self.out_of_step:
            alone = [group for group in self.groups if len(group.names) == len(group.roles)]
            yield from centred_readings(part, alone)
            yield from scaled_readings(part, self.groups)

    def of_one_file(self) -> Iterator[Reading[Given]]:
        """One lens for several cameras, which have others; that it is one, their files say."""
        cameras = cameras_of(self.part)
        alike = {
            tuple(other for other in cameras if same_lens(cameras[name], cameras[other]))
            for name in cameras
        }
        for names in sorted(alike):
            if len(names) < 2 or self.out_of_step:
                continue
            files = {name: _of_its_image(cameras[name]) for name in names}
            if not (fitted := self.refitted(files)):
                continue
            focal = " and ".join(f"{fitted[name].K[0, 0]:.0f}" for name in names)
            yield Reading(
                f"The cameras {' and '.join(names)} have the same lens, with a focal length of "
                f"{cameras[names[0]].K[0, 0]:.0f} px, but lenses of {focal} px would fit",
                "Was one file used for several cameras? Give each camera its own.",
                partial(with_files, self.part, dict(fitted)),
                names,
                is_likely=True,
                is_estimated=True,
            )

    @abstractmethod
    def fitted(self, readings: Iterable[Reading[Given]]) -> Iterator[JudgedReading[Given]]:
        """The readings that are worth a fit, with what it leaves."""

    def judged(self, readings: Iterable[Reading[Given]]) -> list[JudgedReading[Given]]:
        """The readings that fit, the best first: those of estimated values must leave less noise
        than others."""
        fitting = [it for it in self.fitted(readings) if it.rank < it.noise.largest_px]
        return sorted(fitting, key=lambda it: it.rank)

    def named(
        self, judged: Iterable[JudgedReading[Given]], gain: float
    ) -> list[JudgedReading[Given]]:
        """The readings that explain the points so many times better, or the lenses where the images
        fit both ways; the best first."""
        nominal = self.nominal
        fitting = [it for it in judged if it.reading.least_gain * it.noise.px < nominal.px]
        if better := [it for it in fitting if gain * it.noise.px < nominal.px]:
            return better
        alike = [
            it
            for it in fitting
            if it.noise.px < EQUAL * nominal.px
            and it.noise.of_lenses < BETTER * nominal.of_lenses
            and nominal.of_lenses > (FAR_FROM_FILE if it.reading.is_estimated else CONTRADICTED)
        ]
        return sorted(alike, key=lambda it: it.noise.of_lenses)

    def explanations(self) -> list[JudgedReading[Given]]:
        """All readings that fit; none where the data do as they are, and no suspect fits better."""
        if self.nominal.fits and not self.named(self.judged(self.suspected), POSSIBLE_GAIN):
            return []
        return self.judged(self.every_reading())

    def message(self, judged: list[JudgedReading[Given]]) -> str:
        """The best of the readings that are certain, and those that explain as much; or empty."""
        if not (certain := self.named(judged, CERTAIN_GAIN)):
            return ""
        best, nominal = certain[0], self.nominal
        if CERTAIN_GAIN * best.noise.px >= nominal.px:
            return (
                f"{best.reading.claim}: the lenses would then be as their files say, from which "
                "the images deviate as they were given (chi-square "
                f"{rounded(best.noise.of_lenses)} instead of {rounded(nominal.of_lenses)}). "
                f"{best.reading.remedy}"
            )
        # Of two that explain about as much the one that changes no value.
        best, *others = self.named(judged, POSSIBLE_GAIN)
        as_good = [it.reading.claim for it in others if it.noise.px < ALIKE * best.noise.px]
        claims = [claim for claim in dict.fromkeys(as_good) if claim != best.reading.claim]
        alternatives = "".join(f" Or: {claim}." for claim in claims[:MOST_ALTERNATIVES])
        before = f" instead of {rounded(nominal.px)} px"
        now = before if np.isfinite(nominal.px) else ", and otherwise do not"
        return (
            f"{best.reading.claim}: all points and lengths would then fit to "
            f"{rounded(best.noise.px)} px{now}. {best.reading.remedy}{alternatives}"
        )

    def warnings(self, judged: list[JudgedReading[Given]]) -> list[str]:
        """A warning about the best of the readings that may be right, if there are any."""
        return [
            f"{best.reading.claim}: all points and lengths would then fit to "
            f"{rounded(best.noise.px)} px instead of {rounded(self.nominal.px)} px, which is not "
            "enough to be certain. Check it."
            for best in self.named(judged, POSSIBLE_GAIN)[:1]
        ]


def typical_noise(
    fit: RefinedResult | RobustFit, sigma_px: float, poses: Sequence[Pose], parts: int = 1
) -> float:
    """The noise in pixels with which half of the frames fit; values far from their priors, and a
    camera that would stand on its head, count as noise.

    Args:
        parts: in time; the noise is that of the worst.
    """
    over = fit.chi_squares / chdtri(np.maximum(fit.degrees_of_freedom, 1), 0.5)
    half = max(float(np.median(part)) for part in np.array_split(over, parts))
    of_prior = fit.prior_cost
    stretched = np.exp(min(of_prior / (2.0 * fit.degrees_of_freedom.sum()), LARGEST_EXPONENT))
    return float(sigma_px * np.sqrt(half) * stretched * (ALIKE if on_their_heads(poses) else 1.0))


def fit_with_lenses(dataset: Dataset, start: Pose | None = None, **lenses: Any) -> RefinedResult:
    """The fit whose lengths are held, with other priors of the lenses of some roles; `start` as of
    `refine`."""
    settings = RefineSettings(
        baseline_sigma_m=np.inf,
        scatter_m=HELD_LENGTHS * dataset.target_distance_m,
        maximum_steps=MOST_STEPS,
        **lenses,
    )
    return refine(dataset, settings, start)


def centred_readings(data: Given, groups: Iterable[Group]) -> Iterator[Reading[Given]]:
    """The principal point elsewhere, as of images that were cropped."""
    for names, shown, roles in ((it.names, it.shown, it.roles) for it in groups):
        try:
            fit = fit_with_lenses(
                shown, None, **{role: LensPrior(centre_px=np.inf) for role in roles}
            )
        except StereocalError:
            continue
        fitted = {
            name: getattr(fit, role).K[:2, 2] for name, role in zip(names, roles, strict=True)
        }
        stated = {name: cameras_of(data)[name].K[:2, 2] for name in names}
        far = [float(np.linalg.norm(fitted[name] - stated[name])) for name in names]
        unit = fitting_px(shown)
        if not all(SMALLEST_SHIFT * unit < shift < LARGEST_SHIFT * unit for shift in far):
            continue
        stated_words, fitting_words = (
            " and ".join(f"({u:.0f}, {v:.0f})" for u, v in of.values()) for of in (stated, fitted)
        )
        files = {name: _centred(cameras_of(data)[name], fitted[name]) for name in names}
        yield Reading(
            f"The {whose(data, names)} image centre seems to be at {fitting_words} px, where the "
            f"file says {stated_words} px",
            CROPPED,
            partial(with_files, data, files),
            names,
            is_estimated=True,
        )


def _of_its_image(camera: Camera) -> Camera:
    """The camera with its K for the size of its image, if that is of another one."""
    return scaled(camera, 1.0 / (camera.size_factor or 1.0))


def _centred(camera: Camera, centre_px: FloatArray) -> Camera:
    """The camera with another principal point."""
    K = camera.K.copy()
    K[:2, 2] = centre_px
    return replace(camera, K=K)
