"""Which other reading of the inputs explains the data, if they do not fit as they were given.

Each reading is judged by one robust fit with the usual priors of the lenses, the baseline free and
the lengths of the bars held: the noise in pixels that would be left. A wrong reading leaves many
times the noise of the right one, and in sound data no reading leaves less. (Essential matrices are
no judges: lenses of 9 degrees and cameras that face each other fit exchanged files as well.) A
lens that the fit moves far from its prior counts as noise.

Nothing is named where no reading fits.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.special import chdtri

from stereocal.calibration.readings import (
    ONE_OR_BOTH,
    Claim,
    Reading,
    centred,
    fewer_corners,
    fitting_px,
    readings_of_cameras,
    readings_of_frames,
    readings_of_points,
    whose,
)
from stereocal.calibration.wrong_inputs import (
    MINIMUM_BARS,
    essential_fit,
    scaled_readings,
    suspects,
)
from stereocal.errors import StereocalError
from stereocal.refined.refine import RefinedResult, refine
from stereocal.refined.unknowns import LensPrior, RefineSettings, Unknowns
from stereocal.rig.camera import CameraName
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.rig.dataset import Dataset
from stereocal.system.numbers import rounded
from stereocal.system.sampling import evenly_spread

HELD_LENGTHS = 1e-3
"""Scatter of the bars, as a fraction: what is wrong must show in pixels."""
MOST_FRAMES = 60
"""Are enough to tell; of longer recordings so many, evenly spread."""
MOST_STEPS = 30
CERTAIN_GAIN, POSSIBLE_GAIN = 1.5, 1.15
"""How many times the noise as given is that of a reading which is named as certain, or as possible.
"""
FAR = 4.0
"""Times the largest noise that fits: an essential matrix that leaves more is not worth a fit. It is
not robust: three frames of 25 that contradict the others may leave so much."""
ALIKE = 1.3
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
class JudgedReading:
    """A reading and the noise that it leaves."""

    reading: Claim
    noise_px: float
    fits: bool
    """Whether that is noise of image points."""
    rank: float
    """The reading with the least is the best."""
    of_lenses: float = np.inf
    """Chi-square of the lenses about the stated ones; infinite if not known."""


def check_inputs(dataset: Dataset, out_of_step: bool = False) -> list[str]:
    """Reject inputs that are certainly wrong; return warnings about those that may be.

    Args:
        out_of_step: whether cameras out of step seem to explain the data. They fit otherwise
            estimated values too, and somewhat better many a wrong camera: neither is named then.
    """
    dataset = fewer_corners(dataset)
    suspected = suspects(dataset)
    if not suspected:
        return []
    nominal = noise_of_half(_fewer_frames(dataset))
    if nominal < fitting_px(dataset) and not named_readings(
        nominal, _by_noise(suspected), POSSIBLE_GAIN
    ):
        return []
    judged = _every_reading(dataset, out_of_step)
    if message := message_of(nominal, judged, CERTAIN_GAIN):
        raise StereocalError(message)
    possible = [] if out_of_step else named_readings(nominal, judged, POSSIBLE_GAIN)
    return possible_in_words(nominal, possible)


def find_wrong_input(dataset: Dataset, out_of_step: bool = False) -> str:
    """A message that names the wrong input if one explains the data; else empty.

    Args:
        out_of_step: as in `check_inputs`.
    """
    if len(dataset.correspondences.bars) < MINIMUM_BARS:
        return ""
    dataset = fewer_corners(dataset)
    nominal = noise_of_half(_fewer_frames(dataset))
    return message_of(nominal, _every_reading(dataset, out_of_step), CERTAIN_GAIN)


def nothing_fits(dataset: Dataset) -> str:
    """A message if no pose fits and `find_wrong_input` names nothing; else empty."""
    nominal = noise_of_half(_fewer_frames(fewer_corners(dataset)))
    if nominal < fitting_px(dataset) or len(dataset.correspondences.bars) < MINIMUM_BARS:
        return ""
    to = f" better than to {rounded(nominal)} px" if np.isfinite(nominal) else ""
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


def _every_reading(dataset: Dataset, out_of_step: bool) -> list[JudgedReading]:
    """All readings, the best first: those of estimated values must leave less noise than others."""
    readings = readings_of_cameras, readings_of_points, readings_of_frames
    judged = _by_noise(reading for of in readings for reading in of(dataset))
    if not out_of_step:
        dataset = _fewer_frames(dataset)
        judged += _by_noise([*centred_readings(dataset), *scaled_readings(dataset)], ALIKE)
    return sorted(judged, key=lambda it: it.rank)


def _by_noise(readings: Iterable[Reading], handicap: float = 1.0) -> list[JudgedReading]:
    found = []
    for reading in readings:
        with suppress(StereocalError):
            data = _fewer_frames(reading.corrected())  # an order is that of all frames
            noise = noise_of_half(data) if is_near(data) else float("inf")
            fits = handicap * noise < fitting_px(data)
            found.append(JudgedReading(reading, noise, fits, handicap * noise))
    return found


def is_near(dataset: Dataset) -> bool:
    """Whether the essential matrix fits so well that a reading is worth its fit."""
    return essential_fit(dataset).px < FAR * fitting_px(dataset)


def noise_of_half(dataset: Dataset) -> float:
    """The noise in pixels with which half of the frames fit, infinite where no pose fits."""
    scale = essential_fit(dataset).scale
    try:
        if np.isfinite(scale):  # so that a baseline that is wrong hinders no reading
            dataset = replace(dataset, baseline_m=scale * dataset.baseline_m)
        fit = _fit(dataset)
    except StereocalError:
        return float("inf")
    on_its_head = bool(fit.pose.R[1, 1] < 0.0)
    return typical_noise(
        fit.sigma_px.value,
        fit.chi_squares,
        fit.degrees_of_freedom,
        fit.unknowns,
        fit.p,
        on_its_head,
    )


def typical_noise(
    sigma_px: float,
    chi_squares: FloatArray,
    degrees: IntArray,
    unknowns: Unknowns,
    p: FloatArray,
    on_its_head: bool,
    parts: int = 1,
) -> float:
    """The noise in pixels with which half of the frames fit; values far from their priors, and a
    camera that would stand on its head, count as noise.

    Args:
        chi_squares, degrees: (f,): of the frames, with this sigma.
        p: (k,): the free parameters.
        parts: in time; the noise is that of the worst.
    """
    over = chi_squares / chdtri(np.maximum(degrees, 1), 0.5)
    half = max(float(np.median(part)) for part in np.array_split(over, parts))
    of_prior = float(p @ unknowns.precision @ p) / (2.0 * degrees.sum())
    stretched = np.exp(min(of_prior, LARGEST_EXPONENT))
    return float(sigma_px * np.sqrt(half) * stretched * (ALIKE if on_its_head else 1.0))


def _fit(dataset: Dataset, **lenses: Any) -> RefinedResult:
    settings = RefineSettings(
        baseline_sigma_m=np.inf,
        scatter_m=HELD_LENGTHS * dataset.target_distance_m,
        maximum_steps=MOST_STEPS,
        **lenses,
    )
    return refine(dataset, settings)


def centred_readings(
    dataset: Dataset, tried: Sequence[Sequence[CameraName]] = ONE_OR_BOTH
) -> Iterator[Reading]:
    """The principal point elsewhere, as of images that were cropped."""
    for cameras in tried:
        free = {which: LensPrior(centre_px=np.inf) for which in cameras}
        try:
            fit = _fit(dataset, **free)
        except StereocalError:
            continue
        stated, fitting = (
            {which: getattr(of, which).K[:2, 2] for which in cameras} for of in (dataset, fit)
        )
        far = [float(np.linalg.norm(fitting[which] - stated[which])) for which in cameras]
        unit = fitting_px(dataset)
        if not all(SMALLEST_SHIFT * unit < shift < LARGEST_SHIFT * unit for shift in far):
            continue
        stated_words, fitting_words = (
            " and ".join(f"({u:.0f}, {v:.0f})" for u, v in of.values()) for of in (stated, fitting)
        )
        lenses: dict[str, Any] = {
            which: centred(getattr(dataset, which), fitting[which]) for which in cameras
        }
        yield Reading(
            f"The {whose(cameras)} image centre seems to be at {fitting_words} px, where the file "
            f"says {stated_words} px",
            "Was the image cropped? Then subtract what was cut off on the left and above from cx "
            "and cy, or give the points in pixels of the whole image.",
            partial(replace, dataset, **lenses),
            tuple(cameras),
        )


def named_readings(nominal: float, judged: list[JudgedReading], gain: float) -> list[JudgedReading]:
    """The readings that fit, and so many times better than what was given; the best first."""
    return [it for it in judged if it.fits and gain * it.noise_px < nominal]


def possible_in_words(nominal: float, possible: list[JudgedReading]) -> list[str]:
    """A warning about the best of the readings that may be right, if there are any."""
    return [
        f"{best.reading.claim}: all points and lengths would then fit to "
        f"{rounded(best.noise_px)} px instead of {rounded(nominal)} px, which is not enough to be "
        "certain. Check it."
        for best in possible[:1]
    ]


def message_of(nominal: float, judged: list[JudgedReading], gain: float) -> str:
    """The reading with the least noise, and those that explain as much; or empty."""
    if not named_readings(nominal, judged, gain):
        return ""
    # Of two that explain about as much the one that changes no value.
    named = named_readings(nominal, judged, POSSIBLE_GAIN)
    best = named[0]
    others = dict.fromkeys(
        it.reading.claim for it in named[1:] if it.noise_px < ALIKE * best.noise_px
    )
    others.pop(best.reading.claim, None)
    alternatives = "".join(f" Or: {claim}." for claim in [*others][:MOST_ALTERNATIVES])
    now = f" instead of {rounded(nominal)} px" if np.isfinite(nominal) else ", and otherwise do not"
    return (
        f"{best.reading.claim}: all points and lengths would then fit to "
        f"{rounded(best.noise_px)} px{now}. {best.reading.remedy}{alternatives}"
    )
