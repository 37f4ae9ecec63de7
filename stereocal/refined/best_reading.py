"""Which other reading of the inputs explains the data, if they do not fit as they were given.

Each reading is judged by one robust fit with the usual priors of the lenses, the baselines free and
the lengths of the bars held: the noise in pixels that would be left. A wrong reading leaves many
times the noise of the right one, and in sound data no reading leaves less. (Essential matrices are
no judges: lenses of 9 degrees and cameras that face each other fit exchanged files as well.) A
lens that the fit moves far from its prior counts as noise.

Nothing is named where no reading fits.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from itertools import chain

import numpy as np

from stereocal.calibration.corrections import cameras_of, fewer_corners, fitting_px, with_files
from stereocal.calibration.readings import (
    Reading,
    exchanged_files,
    groups_of_pair,
    readings_of_cameras,
    readings_of_frames,
)
from stereocal.calibration.wrong_inputs import (
    MINIMUM_BARS,
    PoseFit,
    essential_fit,
    scaled_readings,
    suspects,
)
from stereocal.errors import StereocalError
from stereocal.refined.judge import (
    ANY_LENS,
    Judge,
    JudgedReading,
    Noise,
    fit_with_lenses,
    typical_noise,
)
from stereocal.rig.camera import CAMERAS, Camera, one_file_in_words
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import AT_ORIGIN, Pose
from stereocal.system.numbers import rounded
from stereocal.system.sampling import evenly_spread

MOST_FRAMES = 60
"""Are enough to tell; of longer recordings so many, evenly spread."""
FAR = 4.0
"""Times the largest noise that fits: an essential matrix that leaves more is not worth a fit. It is
not robust: three frames of 25 that contradict the others may leave so much."""


class JudgeOfPair(Judge[Dataset]):
    """Of two cameras."""

    about = CAMERAS

    def __init__(self, dataset: Dataset, out_of_step: bool = False) -> None:
        self.dataset, self.out_of_step = fewer_corners(dataset), out_of_step
        self.part, self.known_cameras = _fewer_frames(self.dataset), cameras_of(dataset)
        self.groups = groups_of_pair(self.part)

    @cached_property
    def nominal(self) -> Noise:
        return noise_of_half(self.part)

    @cached_property
    def suspected(self) -> list[Reading[Dataset]]:
        whole = self.dataset
        exchanged = exchanged_files(whole, CAMERAS, self.known_cameras)
        groups = groups_of_pair(whole)
        others = readings_of_cameras(whole, groups)
        # Lengths of a few boards that face the cameras do not tell.
        sizes = scaled_readings(whole, groups) if whole.board and not self.out_of_step else ()
        every = chain(self.of_one_file(), exchanged, others, sizes)
        return suspects(whole, every, lambda dataset: dataset)

    def readings_in_time(self) -> Iterator[Reading[Dataset]]:
        return readings_of_frames(self.dataset, CAMERAS[1], (1, -1, 2, -2))

    def refitted(self, files: Mapping[str, Camera]) -> Mapping[str, Camera]:
        with suppress(StereocalError):
            fit = fit_with_lenses(
                with_files(self.part, files), None, **dict.fromkeys(files, ANY_LENS)
            )
            return {name: replace(getattr(fit, name), uncertainty=None) for name in files}
        return {}

    def fitted(self, readings: Iterable[Reading[Dataset]]) -> Iterator[JudgedReading[Dataset]]:
        for reading in readings:
            with suppress(StereocalError):
                data = _fewer_frames(reading.corrected())  # an order is that of all frames
                found = essential_fit(data)
                if found.px < FAR * fitting_px(data):
                    yield JudgedReading(reading, noise_of_half(data, found))


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
        f"{one_file_in_words((dataset.primary, dataset.secondary))}Nothing fits these points{to}, "
        "and they cannot tell what is wrong. Tried in vain: camera files or targets exchanged, "
        "images mirrored or counted from below, frames and columns in another order, other signs "
        "and models of the distortion, image sizes, focal lengths and centres. Check that the "
        "points of a frame are of the same moment and of the same target in both cameras, that "
        "the cameras stood still, and both camera files."
    )


def _fewer_frames(dataset: Dataset) -> Dataset:
    frames = dataset.correspondences.frames
    if len(frames) <= MOST_FRAMES:
        return dataset
    return dataset.of_frames(frames[evenly_spread(len(frames), MOST_FRAMES)])


def noise_of_half(dataset: Dataset, found: PoseFit | None = None) -> Noise:
    """The noise in pixels with which half of the frames fit, infinite where no pose fits.

    Args:
        found: of `essential_fit`; computed if None.
    """
    found, start = found or essential_fit(dataset), None
    try:
        if found.pose is not None:  # so that a baseline that is wrong hinders no reading
            dataset = replace(dataset, baseline_m=found.scale * dataset.baseline_m)
            start = Pose(found.pose.R, found.scale * found.pose.T)
        fit = fit_with_lenses(dataset, start)
    except StereocalError:
        return Noise()
    poses = AT_ORIGIN, fit.pose
    return Noise(typical_noise(fit, fit.sigma_px.value, poses), fitting_px(dataset))
