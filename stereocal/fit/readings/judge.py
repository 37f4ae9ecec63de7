"""What was given, judged with its other readings: how much noise each would leave.

Each reading is judged by one robust fit of the cameras that share bars, with the usual priors of
the lenses, the baselines free and the lengths held: by the noise in pixels that would be left. A
wrong reading leaves many times the noise of the right one, and in sound data no reading leaves
less. (Essential matrices are no judges: lenses of 9 degrees and cameras that face each other fit
exchanged files as well.) A lens that the fit moves far from its prior counts as noise.

Nothing is named where no reading fits.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations

import numpy as np
from scipy.special import chdtri

from stereocal.calibration.corrections import fitting_px, scaled, some_corners, with_files
from stereocal.calibration.mistakes import (
    ESTIMATED_HANDICAP,
    OF_CAMERAS,
    OF_FILES,
    OF_FRAMES,
    OF_POINTS,
    Group,
    Reading,
    Row,
    Way,
    readings_of,
)
from stereocal.calibration.wrong_inputs import SCALED, PoseFit, essential_fit, suspects
from stereocal.errors import StereocalError
from stereocal.fit.least_squares.robust import RobustFit
from stereocal.fit.least_squares.small_steps import with_lens
from stereocal.fit.least_squares.unknowns import LensPrior, RefineSettings, of_some
from stereocal.fit.refine import refine
from stereocal.fit.refined_result import RefinedResult
from stereocal.fit.start.fuse import PairFit, chained
from stereocal.fit.start.pairs import (
    FEWEST_BARS,
    bars_by_frame,
    groups_of,
    pairs_worth_a_fit,
    reached,
    shared_bars,
)
from stereocal.rig.camera import Camera, same_lens
from stereocal.rig.geometry import AT_ORIGIN, Pose, on_their_heads
from stereocal.rig.recording import CameraPair, Recording
from stereocal.system.numbers import rounded
from stereocal.system.sampling import evenly_spread

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
MOST_FRAMES = 75
"""Are enough to tell; of longer recordings so many, evenly spread."""
LEAST_BARS = 16
"""Of two cameras, or all that they share."""
MOST_POINTS = 9
"""Of an object."""
PARTS = 4
"""In time, each of which must fit: where a camera moved, many a reading fits half of the frames."""
CLEAN, CLEAN_PX = 3.0, 0.5
"""A reading that explains the points leaves at most so many times the noise of its best pair, or
this many pixels."""
QUICK_PAIRS = 2
"""Of a camera."""
WORTH_A_FIT = 2.0
"""Times the best reprojection error of all readings' essential matrices."""
FAR = 4.0
"""Times the largest noise that fits: an essential matrix that leaves more is not worth a fit. It is
not robust: three frames of 25 that contradict the others may leave so much."""


@dataclass(frozen=True)
class Noise:
    """What a fit leaves."""

    px: float = np.inf
    largest_px: float = 0.0
    """The largest that is noise of image points."""
    of_lenses: float = 0.0
    """Chi-square of the lenses about the stated ones."""
    cameras: Mapping[str, Camera] | None = None
    """As fitted; None where nothing fits."""
    pairs: tuple[PairFit, ...] = ()
    """From which it began."""

    @property
    def fits(self) -> bool:
        """Whether it is noise of image points, of lenses that are as their files say."""
        return self.px < self.largest_px and self.of_lenses < CONTRADICTED


@dataclass(frozen=True)
class JudgedReading:
    """A reading and the noise that it leaves."""

    reading: Reading
    noise: Noise

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
        self.part, self.about = fewer_points(whole.of_cameras(names)), concerned
        self.known = [pair for pair in known if {*pair.pair} <= {*names}]
        self.bars = shared_bars(self.part)
        self.groups = list[Group]()
        for name in concerned:  # with the camera with which it shares most bars
            others = (pair[pair[0] == name] for pair in self.bars if name in pair)
            if other := next(others, None):
                self.groups.append(Group((name,), (other, name)))
        self.groups.append(Group(tuple(names), next(iter(self.bars))))

    @cached_property
    def nominal(self) -> Noise:
        """What the fit leaves as given."""
        noise = noise_of(self.part, self.known)
        if self.fit is not None and not np.isfinite(noise.px):
            return Noise(self.fit.sigma_px, largest_noise(self.part, self.fit.sigma_px))
        return noise

    @cached_property
    def suspected(self) -> list[Reading]:
        """The readings that seem to fit better. A fit of all cameras shows by itself that lenses
        or lengths are wrong; lengths of a few boards that face the cameras do not tell."""
        of_one_file = [*self._of_one_file()]
        points = (it for it in self._readings(OF_POINTS) if it.way.is_likely)
        looked_at = [*self._readings(OF_CAMERAS), *points]
        if self.fit is None:
            looked_at += self._exchanged(self.part)
            if self.part.object.board is not None and not self.out_of_step:
                looked_at += self._readings(SCALED)
        return of_one_file + suspects(self.part, looked_at)

    def _readings(self, rows: Iterable[Row]) -> Iterator[Reading]:
        return readings_of(self.part, rows, self.groups, [*self.whole.cameras])

    def _exchanged(self, recording: Recording) -> Iterator[Reading]:
        """Any two cameras of a recording exchanged, at least one of which is asked about."""
        pairs = [pair for pair in combinations(recording.cameras, 2) if {*pair} & {*self.about}]
        groups = [Group(pair, pair) for pair in pairs]
        return readings_of(recording, OF_FILES, groups, [*self.whole.cameras])

    def every_reading(self) -> Iterator[Reading]:
        """All of them."""
        yield from self._of_one_file()
        yield from self._exchanged(self.whole)
        yield from self._readings((*OF_CAMERAS, *OF_POINTS))
        yield from readings_of(self.whole, OF_FRAMES, self.groups, [*self.whole.cameras])
        if not self.out_of_step:
            yield from self._readings((OF_CENTRE, *SCALED))

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
                quick = _quick_fits(data, reading.group.names, shared_bars(data))
                candidates.append((reading, data, quick))
        as_given = _quick_fits(self.part, names, self.bars)
        limit = FAR * fitting_px(self.part.cameras.values())
        if len(names) > 2:  # whose fits take longer
            limit = WORTH_A_FIT * min(map(_mean_px, [as_given, *(it[-1] for it in candidates)]))
        for reading, data, quick in candidates:
            if _mean_px(quick) <= limit < np.inf:
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


def fewer_points(recording: Recording) -> Recording:
    """The recording with enough of the frames in which cameras see a bar together, and of a large
    object's points; of cameras that share few bars, with all frames."""
    frames, images = recording.images()
    common = np.flatnonzero((np.isfinite(images[..., 0]).sum(axis=2) > 1).any(axis=1))
    worth = pairs_worth_a_fit(recording)
    if len(common) > MOST_FRAMES:
        names, bars = list(recording.cameras), bars_by_frame(recording)
        common = common[evenly_spread(len(common), MOST_FRAMES)]
        for pair in worth:
            of_pair = np.flatnonzero(bars[:, names.index(pair[0]), names.index(pair[1])])
            if np.isin(of_pair, common).sum() < LEAST_BARS:
                common = np.union1d(common, of_pair[evenly_spread(len(of_pair), LEAST_BARS)])
    kept = np.isin(recording.frame, frames[common])
    count, board = len(recording.object.names), recording.object.board
    if board is None:
        chosen = np.union1d(evenly_spread(count, MOST_POINTS), recording.object.longest)
        return recording.where(kept & np.isin(recording.target, chosen))
    fewer = recording.where(kept & np.isin(recording.target, some_corners(board)))
    # Of a few boards, or of hidden ones, all corners.
    return fewer if {*worth} <= {*pairs_worth_a_fit(fewer)} else recording.where(kept)


def largest_noise(recording: Recording, best_pair_px: float) -> float:
    """The largest noise that cameras which fit together leave, in pixels."""
    return min(max(CLEAN * best_pair_px, CLEAN_PX), fitting_px(recording.cameras.values()))


def _quick_fits(
    recording: Recording, names: Iterable[str], bars: Iterable[CameraPair]
) -> dict[CameraPair, PoseFit]:
    """The essential matrices of some cameras with others."""
    pairs = {pair for name in names for pair in [it for it in bars if name in it][:QUICK_PAIRS]}
    return {pair: essential_fit(recording.pair(*pair)) for pair in pairs}


def _mean_px(quick: Mapping[CameraPair, PoseFit]) -> float:
    """The mean reprojection error; infinite where there is none."""
    return float(np.mean([fit.px for fit in quick.values()])) if quick else np.inf


def noise_of(
    recording: Recording,
    known: Iterable[PairFit] = (),
    quick: Mapping[CameraPair, PoseFit] | None = None,
    lenses: Mapping[str, LensPrior] | None = None,
) -> Noise:
    """What the fit of all cameras leaves, from fits of pairs; infinite where none fits.

    Args:
        known: fits of pairs.
        quick: essential matrices of pairs.
        lenses: priors other than the usual ones.
    """
    names, quick, lenses = list(recording.cameras), quick or {}, lenses or {}
    with suppress(StereocalError, np.linalg.LinAlgError):
        if len(names) == 2:  # the fit of the pair is that of all
            pair = _fit_of_pair(recording, (names[0], names[1]), quick, lenses)
            cameras = dict(zip(names, (pair.primary, pair.secondary), strict=True))
            largest = fitting_px(cameras.values())  # there is no better pair
            poses = [AT_ORIGIN, pair.pose]
            return _noise_left(pair, pair.sigma_px.value, poses, largest, cameras)
        pairs = _first_pairs(recording, known, quick, lenses)
        if len(reached(names, [pair.pair for pair in pairs])) < len(names):
            return Noise()
        free, held = replace(recording, baselines_m={}), _held(recording.object.longest_m)
        fit = RobustFit.of(free, chained(names, pairs), replace(held, lenses=lenses))
        least = min(pair.noise_px for pair in pairs)
        fit.start_at({}, least)
        if fit.run() and fit.is_determined:
            numbered = enumerate(recording.cameras.items())
            cameras = {
                name: with_lens(camera, fit.q, number) for number, (name, camera) in numbered
            }
            largest = largest_noise(recording, least)
            noise = _noise_left(fit, fit.sigma_px, fit.poses, largest, cameras)
            return replace(noise, pairs=tuple(pairs))
    return Noise()


def _noise_left(
    fit: RefinedResult | RobustFit,
    sigma_px: float,
    poses: Sequence[Pose],
    largest_px: float,
    cameras: Mapping[str, Camera],
) -> Noise:
    """The noise in pixels with which half of the frames fit, in the worst part in time; values far
    from their priors, and a camera that would stand on its head, count as noise."""
    parts = PARTS if len(fit.frames) >= PARTS * FEWEST_BARS else 1
    over = fit.chi_squares / chdtri(np.maximum(fit.degrees_of_freedom, 1), 0.5)
    half = max(float(np.median(part)) for part in np.array_split(over, parts))
    of_prior = fit.prior_cost
    stretched = np.exp(min(of_prior / (2.0 * fit.degrees_of_freedom.sum()), LARGEST_EXPONENT))
    on_head = ALIKE if on_their_heads(poses) else 1.0
    px = float(sigma_px * np.sqrt(half) * stretched * on_head)
    return Noise(px, largest_px, of_prior, cameras)


def _first_pairs(
    recording: Recording,
    known: Iterable[PairFit],
    quick: Mapping[CameraPair, PoseFit],
    lenses: Mapping[str, LensPrior],
) -> list[PairFit]:
    """Sound pairs that connect the cameras, those with the most bars."""
    fits, names = [*known], [*recording.cameras]
    limit = fitting_px(recording.cameras.values())
    if len(reached(names, [fit.pair for fit in fits])) == len(names):
        return sorted(fits, key=lambda fit: fit.noise_px)
    near = {
        pair: quick[pair] if pair in quick else essential_fit(recording.pair(*pair))
        for pair in pairs_worth_a_fit(recording)
    }
    far = FAR * min((fit.px for fit in near.values()), default=np.inf)
    for pair, start in near.items():
        if not start.px < far or pair[1] in groups_of(names, [fit.pair for fit in fits])[pair[0]]:
            continue
        with suppress(StereocalError, np.linalg.LinAlgError):
            fit = _fit_of_pair(recording, pair, near, lenses)
            if fit.sigma_px.value < limit:
                fits.append(PairFit.of(pair, fit))
    return sorted(fits, key=lambda fit: fit.noise_px)


def _held(longest_m: float) -> RefineSettings:
    """The settings of a fit whose lengths are held."""
    return RefineSettings(
        baseline_sigma_m=np.inf, scatter_m=HELD_LENGTHS * longest_m, maximum_steps=MOST_STEPS
    )


def _fit_of_pair(
    recording: Recording,
    pair: CameraPair,
    quick: Mapping[CameraPair, PoseFit],
    lenses: Mapping[str, LensPrior],
) -> RefinedResult:
    """The fit of two cameras, as of `noise_of`, from their essential matrix."""
    dataset, start = recording.pair(*pair), None
    near = quick[pair] if pair in quick else essential_fit(dataset)
    if near.pose is not None:  # so that a baseline that is wrong hinders no reading
        dataset = dataset.changed(baseline_m=near.scale * dataset.baseline_m)
        start = Pose(near.pose.R, near.scale * near.pose.T)
    held = replace(_held(dataset.target_distance_m), lenses=lenses)
    return refine(dataset, of_some(recording, held, pair), start)


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


def _elsewhere(recording: Recording, group: Group) -> Iterator[Way]:
    """The principal point elsewhere, as of images that were cropped; of one camera, or of two."""
    if len(group.names) > 2:
        return
    lenses = dict.fromkeys(group.names, LensPrior(centre_px=np.inf))
    try:
        fit = _fit_of_pair(recording, group.pair, {}, lenses)
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
OF_CENTRE = Row(
    "The {whose} image centre seems to be at {fitting} px, where the file says {stated} px",
    "Was the image cropped? Then subtract what was cut off on the left and above from cx and cy, "
    "or give the points in pixels of the whole image.",
    "each and all",
    _elsewhere,
    is_estimated=True,
)
TABLE = (*OF_FILES, OF_ONE_FILE, *OF_CAMERAS, *OF_POINTS, *OF_FRAMES, OF_CENTRE, *SCALED)
"""All readings."""
