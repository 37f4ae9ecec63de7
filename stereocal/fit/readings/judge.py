"""What was given, judged with its other readings: how much noise each would leave.

Each reading is judged by one robust fit of the cameras that share bars, with the usual priors of
the lenses, the baselines free and the lengths held: by the noise in pixels that would be left. A
wrong reading leaves many times the noise of the right one, and in sound data no reading leaves
less. (Essential matrices are no judges: lenses of 9 degrees and cameras that face each other fit
exchanged files as well.) A lens that the fit moves far from its prior counts as noise.

Nothing is named where no reading fits.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations

import numpy as np

from stereocal.calibration.corrections import fitting_px, scaled, undistorted, with_files
from stereocal.calibration.mistakes import (
    OF_CAMERAS,
    OF_FILES,
    OF_FRAMES,
    OF_IMAGES,
    OF_POINTS,
    UNDISTORTED,
)
from stereocal.calibration.reading import Group, Reading, Row, Way, readings_of
from stereocal.calibration.wrong_inputs import SCALED, PoseFit, suspects
from stereocal.errors import StereocalError
from stereocal.fit.least_squares.robust import RobustFit
from stereocal.fit.least_squares.unknowns import LensPrior
from stereocal.fit.readings.lost_frames import LOST
from stereocal.fit.readings.noise_left import (
    ALIKE,
    CONTRADICTED,
    FAR,
    NoiseLeft,
    fewer_points,
    fit_of_pair,
    largest_noise,
    mean_px,
    noise_of,
    quick_fits,
)
from stereocal.fit.start.fuse import PairFit
from stereocal.fit.start.pairs import shared_bars
from stereocal.rig.camera import Camera, same_lens
from stereocal.rig.recording import CameraPair, Recording
from stereocal.system.numbers import rounded

ANY_LENS = LensPrior(0.3, 50.0)
CERTAIN_GAIN, POSSIBLE_GAIN = 1.5, 1.15
"""How many times the noise as given is that of a reading which is named as certain, or as possible.
"""
FAR_FROM_FILE, BETTER = 100.0, 0.3
"""Chi-square of the lenses about the stated ones from which on a reading that estimates a value may
explain them (`CONTRADICTED` of others) and fit the images no better; and what it leaves of it, at
most."""
EQUAL = 1.05
"""Noise that counts as equal there."""
SMALLEST_SHIFT, LARGEST_SHIFT = 10.0, 300.0
"""Of a centre, in units of `fitting_px`: 3 and 90 % of the diagonal. Smaller ones are named as an
input that disagrees."""
MOST_ALTERNATIVES = 3
"""Comparable explanations in one message."""
SAME_ROW_PX, SAME_ROW = 2.0, 0.01
"""Largest difference of v of a target in rectified images, in pixels and over the range of v."""
RECTIFIED = "rectified images (v of each target is the same in both cameras)"
WORTH_A_FIT = 2.0
"""Times the best reprojection error of all readings' essential matrices."""


@dataclass(frozen=True)
class JudgedReading:
    """A reading and the noise that it leaves."""

    reading: Reading
    noise: NoiseLeft

    @property
    def rank(self) -> float:
        """The reading with the least is the best."""
        return self.reading.handicap * self.noise.px


class Judge:
    """What was given of some cameras that share bars, and which readings of it fit."""

    def __init__(
        self,
        whole: Recording,
        names: Sequence[str],
        concerned: Sequence[str],
        known: Iterable[PairFit] = (),
        fit: RobustFit | None = None,
        out_of_step: bool = False,
    ) -> None:
        """A judge of some cameras of a recording.

        Args:
            names: of the cameras.
            concerned: those that the readings are to concern.
            known: fits of pairs.
            fit: of all cameras, if there is one.
            out_of_step: whether cameras out of step seem to explain the data. They fit otherwise
                estimated values too, and somewhat better many a wrong camera.
        """
        self.whole, self.fit, self.out_of_step = whole, fit, out_of_step
        self.part, self.concerned = fewer_points(whole.of_cameras(names)), concerned
        self.known = [pair for pair in known if {*pair.pair} <= {*names}]
        self.bars = shared_bars(self.part)
        self.groups = list[Group]()
        for name in concerned:  # with the camera with which it shares most bars
            others = (pair[pair[0] == name] for pair in self.bars if name in pair)
            if other := next(others, None):
                self.groups.append(Group((name,), (other, name)))
        self.groups.append(Group(tuple(names), next(iter(self.bars))))

    @cached_property
    def nominal(self) -> NoiseLeft:
        """What the fit leaves as given."""
        noise = noise_of(self.part, self.known)
        if self.fit is not None and not np.isfinite(noise.px):
            return NoiseLeft(self.fit.sigma_px, largest_noise(self.part, self.fit.sigma_px))
        return noise

    @cached_property
    def suspected(self) -> list[Reading]:
        """The readings that seem to fit better, or may. A fit of all cameras shows by itself that
        lenses or lengths are wrong; lengths of a few boards that face the cameras do not tell."""
        of_one_file = [*self._of_one_file()]
        points = (it for it in self._readings(OF_POINTS) if it.way.is_likely)
        looked_at = [*self._readings(OF_CAMERAS), *points]
        if self.fit is None:
            looked_at += self.exchanged(self.part)
            if self.part.object.board is not None and not self.out_of_step:
                looked_at += self._readings(SCALED)
        of_both = list[Reading]()
        if not self.out_of_step:  # two cameras cropped alike fit a compromise of both
            of_both += readings_of(self.part, [OF_CENTRE], self.groups[-1:], [*self.whole.cameras])
        return of_one_file + of_both + suspects(self.part, looked_at)

    def _readings(self, rows: Iterable[Row]) -> Iterator[Reading]:
        return readings_of(self.part, rows, self.groups, [*self.whole.cameras])

    def exchanged(self, recording: Recording) -> Iterator[Reading]:
        """Any two cameras of a recording exchanged, at least one of which is concerned."""
        pairs = [pair for pair in combinations(recording.cameras, 2) if {*pair} & {*self.concerned}]
        groups = [Group(pair, pair) for pair in pairs]
        return readings_of(recording, OF_FILES, groups, [*self.whole.cameras])

    def every_reading(self) -> Iterator[Reading]:
        """Every reading of what was given of the cameras; those that estimate a value only if the
        cameras are in step."""
        yield from self._of_one_file()
        yield from self.exchanged(self.whole)
        yield from self._readings((*OF_CAMERAS, *OF_POINTS, *OF_IMAGES))
        of_frames = (*OF_FRAMES, LOST)
        yield from readings_of(self.whole, of_frames, self.groups, [*self.whole.cameras])
        if not self.out_of_step:
            yield from self._readings(ESTIMATED)

    def _of_one_file(self) -> Iterator[Reading]:
        """One lens for several cameras, which have others; that it is one, their files say."""
        cameras = self.part.cameras
        alike = {
            tuple(other for other in cameras if same_lens(cameras[name], cameras[other]))
            for name in cameras
        }
        groups = [Group(names, (names[0], names[1])) for names in sorted(alike) if len(names) > 1]
        if not self.out_of_step:
            yield from readings_of(self.part, [OF_ONE_FILE], groups, [*self.whole.cameras])

    def _fitted(self, readings: Iterable[Reading]) -> Iterator[JudgedReading]:
        """The readings that are worth a fit, with what it leaves."""
        names = [*self.part.cameras]
        candidates = list[tuple[Reading, Recording, dict[CameraPair, PoseFit]]]()
        for reading in readings:
            with suppress(StereocalError):
                data = fewer_points(reading.way.corrected().of_cameras(names))
                quick = quick_fits(data, reading.group.names, shared_bars(data))
                candidates.append((reading, data, quick))
        as_given = quick_fits(self.part, names, self.bars)
        limit = FAR * fitting_px(self.part.cameras.values())
        if len(names) > 2:  # whose fits take longer
            limit = WORTH_A_FIT * min(map(mean_px, [as_given, *(it[-1] for it in candidates)]))
        for reading, data, quick in candidates:
            if mean_px(quick) <= limit < np.inf:
                of = {*reading.group.names}
                alike = [it for it in self.nominal.pairs if not {*it.pair} & of]
                yield JudgedReading(reading, noise_of(data, alike, quick))

    def judged(self, readings: Iterable[Reading]) -> list[JudgedReading]:
        """The readings that fit, the best first: those of estimated values must leave less noise
        than others."""
        fitting = [it for it in self._fitted(readings) if it.rank < it.noise.largest_px]
        return sorted(fitting, key=lambda it: it.rank)

    def named(self, judged: Iterable[JudgedReading], gain: float) -> list[JudgedReading]:
        """The readings that explain the points so many times better, or the lenses where the images
        fit both ways; the best first."""
        nominal = self.nominal
        fitting = [it for it in judged if it.reading.row.least_gain * it.noise.px < nominal.px]
        if better := [it for it in fitting if gain * it.noise.px < nominal.px]:
            return better
        alike = [
            it
            for it in fitting
            if it.noise.px < EQUAL * nominal.px
            and it.noise.of_lenses < BETTER * nominal.of_lenses
            and nominal.of_lenses > (FAR_FROM_FILE if it.reading.row.is_estimated else CONTRADICTED)
        ]
        return sorted(alike, key=lambda it: it.noise.of_lenses)

    def explanations(self) -> list[JudgedReading]:
        """All readings that fit; none where the data do as they are, and no suspect fits better.

        Where there is no fit of all cameras, lenses may be somewhat farther from their files.
        """
        nominal = self.nominal
        farthest = FAR_FROM_FILE if self.fit is None else CONTRADICTED
        fits = nominal.px < nominal.largest_px and nominal.of_lenses < farthest
        if fits and not self.named(self.judged(self.suspected), POSSIBLE_GAIN):
            return []
        return self.judged(self.every_reading())

    def message(self, judged: list[JudgedReading]) -> str:
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

    def warnings(self, judged: list[JudgedReading]) -> list[str]:
        """A warning about the best of the readings that may be right, if there are any."""
        return [
            f"{best.reading.claim}: all points and lengths would then fit to "
            f"{rounded(best.noise.px)} px instead of {rounded(self.nominal.px)} px, which is not "
            "enough to be certain. Check it."
            for best in self.named(judged, POSSIBLE_GAIN)[:1]
        ]


def _one_file(recording: Recording, group: Group) -> Iterator[Way]:
    """Lenses of their own for cameras that have one."""
    names = group.names
    given = {name: recording.cameras[name] for name in names}
    files = {
        name: scaled(camera, 1.0 / (camera.size_factor or 1.0)) for name, camera in given.items()
    }
    lenses = dict.fromkeys(names, ANY_LENS)
    fitted = noise_of(with_files(recording, files), lenses=lenses).cameras
    if fitted is not None:
        cameras = {name: replace(fitted[name], uncertainty=None) for name in names}
        values = {
            "names": " and ".join(names),
            "stated": f"{given[names[0]].K[0, 0]:.0f}",
            "fitting": " and ".join(f"{camera.K[0, 0]:.0f}" for camera in cameras.values()),
        }
        yield Way(partial(with_files, recording, cameras), values, is_likely=True)


def _without_distortion(recording: Recording, group: Group) -> Iterator[Way]:
    """Lenses without distortion, of another focal length and centre, as of images that were
    undistorted to another matrix, or rectified; not where other lengths and centres with the
    distortion that is stated fit about as well."""
    stated = {name: recording.cameras[name] for name in group.names}
    pinholes = {name: undistorted(camera) for name, camera in stated.items()}
    files = {name: camera for name, camera in pinholes.items() if camera is not None}
    if len(files) < len(stated):
        return
    lenses = dict.fromkeys(files, LensPrior(0.3, np.inf))
    pinhole_noise = noise_of(with_files(recording, files), lenses=lenses)
    as_stated = noise_of(recording, lenses=lenses)
    fitted = pinhole_noise.cameras
    if fitted is not None and ALIKE * pinhole_noise.px < as_stated.px:
        cameras = {name: fitted[name] for name in files}
        focal = (" and ".join(f"{it[n].K[0, 0]:.0f}" for n in files) for it in (stated, cameras))
        same_rows = len(group.names) > 1 and same_rows_px(recording, group.pair)
        values = dict(zip(("stated", "fitting"), focal, strict=True))
        values["images"] = RECTIFIED if same_rows else "undistorted images"
        yield Way(partial(with_files, recording, cameras), values)


def same_rows_px(recording: Recording, pair: CameraPair) -> float:
    """The median difference of v of a target in two cameras, where it is the same as in rectified
    images; else 0."""
    with suppress(StereocalError):  # a lens that cannot be inverted
        rows = recording.pair(*pair).correspondences
        v = rows.primary[:, 1]
        apart_px = float(np.median(np.abs(v - rows.secondary[:, 1])))
        return apart_px if apart_px < min(SAME_ROW_PX, SAME_ROW * float(np.ptp(v))) else 0.0
    return 0.0


def _elsewhere(recording: Recording, group: Group) -> Iterator[Way]:
    """The principal point elsewhere, as of images that were cropped; of one camera, or of two."""
    if len(group.names) > 2:
        return
    lenses = dict.fromkeys(group.names, LensPrior(centre_px=np.inf))
    try:
        fit = fit_of_pair(recording, group.pair, {}, lenses)
    except StereocalError:
        return
    fitted = dict(zip(group.pair, (fit.primary, fit.secondary), strict=True))
    files, stated, fitting = dict[str, Camera](), list[str](), list[str]()
    unit = fitting_px(recording.cameras[name] for name in group.pair)
    for name in group.names:
        camera, centre_px = recording.cameras[name], fitted[name].K[:2, 2]
        if not SMALLEST_SHIFT < np.linalg.norm(centre_px - camera.K[:2, 2]) / unit < LARGEST_SHIFT:
            return
        K = camera.K.copy()
        K[:2, 2] = centre_px
        files[name] = replace(camera, K=K)
        for words, (u, v) in ((stated, camera.K[:2, 2]), (fitting, centre_px)):
            words.append(f"({u:.0f}, {v:.0f})")
    values = {"stated": " and ".join(stated), "fitting": " and ".join(fitting)}
    yield Way(partial(with_files, recording, files), values)


OF_ONE_FILE = Row(
    "The cameras {names} have the same lens, with a focal length of {stated} px, but lenses of "
    "{fitting} px would fit",
    "Was one file used for several cameras? Give each camera its own.",
    "all",
    _one_file,
    "lenses that are alike",
    is_estimated=True,
)
OF_NEW_MATRIX = Row(
    "The points of {which} seem to be of {images}, without distortion and with focal lengths of "
    "{fitting} px, where the files say {stated} px",
    UNDISTORTED,
    "each and all",
    _without_distortion,
    "lenses with distortion",
    is_estimated=True,
)
OF_CENTRE = Row(
    "The {whose} image centre seems to be at {fitting} px, where the file says {stated} px",
    "Was the image cropped? Then subtract what was cut off on the left and above from cx and cy, "
    "or give the points in pixels of the whole image.",
    "each and all",
    _elsewhere,
    is_estimated=True,
)
ESTIMATED = (OF_CENTRE, OF_NEW_MATRIX, *SCALED)
TABLE = (*OF_FILES, OF_ONE_FILE, *OF_CAMERAS, *OF_POINTS, *OF_IMAGES, *OF_FRAMES, LOST, *ESTIMATED)
"""All readings."""
