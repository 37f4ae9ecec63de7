"""Which other reading of the inputs explains the data, if they do not fit as they were given.

Each reading is judged by one robust fit with the usual priors of the lenses, the baselines free and
the lengths of the bars held: the noise in pixels that would be left. A wrong reading leaves many
times the noise of the right one, and in sound data no reading leaves less. (Essential matrices are
no judges: lenses of 9 degrees and cameras that face each other fit exchanged files as well.) A
lens that the fit moves far from its prior counts as noise.

Nothing is named where no reading fits. `Judge` is the same for two cameras, here, and for more
(`network.wrong_inputs`): what differs is how they are fitted, and which readings there are.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Generic

import numpy as np
from scipy.special import chdtri

from stereocal.calibration.corrections import (
    Given,
    cameras_of,
    fewer_corners,
    fitting_px,
    of_lenses,
    whose,
    with_files,
)
from stereocal.calibration.readings import (
    ESTIMATED_HANDICAP,
    Group,
    Reading,
    exchanged_files,
    groups_of_pair,
    readings_of_cameras,
    readings_of_frames,
    readings_of_points,
)
from stereocal.calibration.wrong_inputs import (
    MINIMUM_BARS,
    essential_fit,
    scaled_readings,
    suspects,
)
from stereocal.errors import StereocalError
from stereocal.refined.refine import RefinedResult, refine
from stereocal.refined.robust import RobustFit
from stereocal.refined.unknowns import LensPrior, RefineSettings
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.dataset import Dataset
from stereocal.system.numbers import rounded
from stereocal.system.sampling import evenly_spread

CROPPED = (
    "Was the image cropped? Then subtract what was cut off on the left and above from cx and cy, "
    "or give the points in pixels of the whole image."
)
HELD_LENGTHS = 1e-3
"""Scatter of the bars, as a fraction: what is wrong must show in pixels."""
MOST_FRAMES = 60
"""Are enough to tell; of longer recordings so many, evenly spread."""
MOST_STEPS = 30
CERTAIN_GAIN, POSSIBLE_GAIN = 1.5, 1.15
"""How many times the noise as given is that of a reading which is named as certain, or as possible.
"""
CONTRADICTED, FAR_FROM_FILE, BETTER = 30.0, 100.0, 0.3
"""Chi-squares of the lenses about the stated ones, from which on a reading may explain them that
fits the images no better, or one that estimates a value; and what it leaves of them, at most."""
EQUAL = 1.05
"""Noise that counts as equal there."""
FAR = 4.0
"""Times the largest noise that fits: an essential matrix that leaves more is not worth a fit. It is
not robust: three frames of 25 that contradict the others may leave so much."""
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

    @property
    @abstractmethod
    def nominal(self) -> Noise:
        """What the fit leaves as given."""

    @property
    @abstractmethod
    def suspected(self) -> list[Reading[Given]]:
        """The readings that seem to fit better."""

    @abstractmethod
    def every_reading(self) -> Iterator[Reading[Given]]:
        """All of them."""

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


class JudgeOfPair(Judge[Dataset]):
    """Of two cameras."""

    def __init__(self, dataset: Dataset, out_of_step: bool = False) -> None:
        self.dataset, self.out_of_step = fewer_corners(dataset), out_of_step
        self.groups = groups_of_pair(self.dataset)

    @cached_property
    def nominal(self) -> Noise:
        return noise_of_half(_fewer_frames(self.dataset))

    @cached_property
    def suspected(self) -> list[Reading[Dataset]]:
        return suspects(self.dataset, self._of_cameras(), lambda dataset: dataset)

    def _of_cameras(self) -> Iterator[Reading[Dataset]]:
        yield from exchanged_files(self.dataset, CAMERAS, cameras_of(self.dataset))
        yield from readings_of_cameras(self.dataset, self.groups)

    def every_reading(self) -> Iterator[Reading[Dataset]]:
        yield from self._of_cameras()
        yield from readings_of_points(self.dataset, self.groups)
        yield from readings_of_frames(self.dataset, CAMERAS[1], (1, -1, 2, -2))
        if not self.out_of_step:
            few = _fewer_frames(self.dataset)
            yield from centred_readings(few, groups_of_pair(few))
            yield from scaled_readings(few, groups_of_pair(few))

    def fitted(self, readings: Iterable[Reading[Dataset]]) -> Iterator[JudgedReading[Dataset]]:
        for reading in readings:
            with suppress(StereocalError):
                data = _fewer_frames(reading.corrected())  # an order is that of all frames
                if essential_fit(data).px < FAR * fitting_px(data):
                    yield JudgedReading(reading, noise_of_half(data))


def check_inputs(dataset: Dataset, out_of_step: bool = False) -> list[str]:
    """Reject inputs that are certainly wrong; return warnings about those that may be.

    Args:
        out_of_step: whether cameras out of step seem to explain the data. They fit otherwise
            estimated values too, and somewhat better many a wrong camera: neither is named then.
    """
    judge = JudgeOfPair(dataset, out_of_step)
    if not judge.suspected:
        return []
    judged = judge.explanations()
    if message := judge.message(judged):
        raise StereocalError(message)
    return [] if out_of_step else judge.warnings(judged)


def find_wrong_input(dataset: Dataset, out_of_step: bool = False) -> str:
    """A message that names the wrong input if one explains the data; else empty.

    Args:
        out_of_step: as in `check_inputs`.
    """
    if len(dataset.correspondences.bars) < MINIMUM_BARS:
        return ""
    judge = JudgeOfPair(dataset, out_of_step)
    return judge.message(judge.judged(judge.every_reading()))


def nothing_fits(dataset: Dataset) -> str:
    """A message if no pose fits and `find_wrong_input` names nothing; else empty."""
    nominal = JudgeOfPair(dataset).nominal
    if nominal.fits or len(dataset.correspondences.bars) < MINIMUM_BARS:
        return ""
    to = f" better than to {rounded(nominal.px)} px" if np.isfinite(nominal.px) else ""
    return (
        f"Nothing fits these points{to}, and they cannot tell what is wrong. Tried in vain: "
        "camera files or targets exchanged, images mirrored or counted from below, frames and "
        "columns in another order, other signs and models of the distortion, image sizes, focal "
        "lengths and centres. Check that the points of a frame are of the same moment and of the "
        "same target in both cameras, that the cameras stood still, and both camera files."
    )


def _fewer_frames(dataset: Dataset) -> Dataset:
    frames = dataset.correspondences.frames
    if len(frames) <= MOST_FRAMES:
        return dataset
    return dataset.of_frames(frames[evenly_spread(len(frames), MOST_FRAMES)])


def noise_of_half(dataset: Dataset) -> Noise:
    """The noise in pixels with which half of the frames fit, infinite where no pose fits."""
    scale = essential_fit(dataset).scale
    try:
        if np.isfinite(scale):  # so that a baseline that is wrong hinders no reading
            dataset = replace(dataset, baseline_m=scale * dataset.baseline_m)
        fit = _fit(dataset)
    except StereocalError:
        return Noise()
    on_its_head = bool(fit.pose.R[1, 1] < 0.0)
    return Noise(typical_noise(fit, fit.sigma_px.value, on_its_head), fitting_px(dataset))


def typical_noise(
    fit: RefinedResult | RobustFit, sigma_px: float, on_its_head: bool, parts: int = 1
) -> float:
    """The noise in pixels with which half of the frames fit; values far from their priors, and a
    camera that would stand on its head, count as noise.

    Args:
        parts: in time; the noise is that of the worst.
    """
    over = fit.chi_squares / chdtri(np.maximum(fit.degrees_of_freedom, 1), 0.5)
    half = max(float(np.median(part)) for part in np.array_split(over, parts))
    of_prior = float(fit.p @ fit.unknowns.precision @ fit.p)
    stretched = np.exp(min(of_prior / (2.0 * fit.degrees_of_freedom.sum()), LARGEST_EXPONENT))
    return float(sigma_px * np.sqrt(half) * stretched * (ALIKE if on_its_head else 1.0))


def _fit(dataset: Dataset, **lenses: Any) -> RefinedResult:
    settings = RefineSettings(
        baseline_sigma_m=np.inf,
        scatter_m=HELD_LENGTHS * dataset.target_distance_m,
        maximum_steps=MOST_STEPS,
        **lenses,
    )
    return refine(dataset, settings)


def centred_readings(data: Given, groups: Iterable[Group]) -> Iterator[Reading[Given]]:
    """The principal point elsewhere, as of images that were cropped."""
    for names, shown, roles in ((it.names, it.shown, it.roles) for it in groups):
        try:
            fit = _fit(shown, **{role: LensPrior(centre_px=np.inf) for role in roles})
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
            of_lenses(data, CROPPED),
            partial(with_files, data, files),
            names,
            is_estimated=True,
        )


def _centred(camera: Camera, centre_px: FloatArray) -> Camera:
    """The camera with another principal point."""
    K = camera.K.copy()
    K[:2, 2] = centre_px
    return replace(camera, K=K)
