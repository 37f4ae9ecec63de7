"""The offset of two cameras that were started by hand: which frame of one is which of the other.

Every offset of the counts of frames is scanned (`calibration.offset_scan`); the best are judged by
an essential matrix and by the lengths of what is held, and the fit of the time offset finds the
fraction of the one that stands out.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import cached_property, partial
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from stereocal.calibration.corrections import fitting_px, with_targets
from stereocal.calibration.offset_scan import FEWEST, Track, common_points, scan
from stereocal.errors import StereocalError, naming
from stereocal.fit.screening.screen import wide_settings
from stereocal.fit.start.first_poses import robust_pose
from stereocal.fit.start.free_baseline import with_rough_baseline
from stereocal.fit.timing.time_offset import fit_time_offset, spread_over_runs, usable_after
from stereocal.rig.camera import camera_in_words
from stereocal.rig.geometry import Pose, sampson, triangulate_rays
from stereocal.rig.pair import Pair
from stereocal.rig.recording import CameraPair, Recording
from stereocal.rig.rigid_object import RigidObject
from stereocal.rig.tracks import MeasuredOffset, TimeOffset, exchanged_ends
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.latest import once_or_refused
from stereocal.system.numbers import count, rounded
from stereocal.system.sampling import evenly_spread

STANDS_OUT = 1.5
"""How many times farther from the epipolar lines the points must lie at any other offset."""
FURTHER, FURTHER_WITH_LENGTHS, TOO_FEW = 40.0, 15.0, 20
"""With this number of moments above those too few to tell anything, an offset must stand out twice
as much: chance fits few moments at one of many offsets, more rarely so that lengths agree."""
LENGTHS_AGREE, ALIKE = 0.1, 0.03
"""Median deviation of reconstructed lengths from their median, as a fraction of it, that doubles
the distance; and up to which they count as agreeing. Measured: at right offsets at most 0.014, with
noise of 2 px too; where 25 moments were fitted by chance 0.03 and 0.07."""
FEWEST_LENGTHS = 15
FREEDOM, LEAST_PX, RIVAL, ENOUGH = 8, 1e-3, 0.5, 200.0
"""Places that any fit fits; the least distance that counts; and the part of the evidence for the
best offset from which another is its rival, if that is enough; else all are (one wrong had 64)."""
CANDIDATES, FINALISTS, FEWEST_OTHERS = 30, 4, 8
APART, NEAR = 2.0, 0.6
"""Frames between candidates; and between the best one and the fit of the motion there."""
AROUND = 30
"""Frames about an offset that something else tells."""
JUDGED, SAMPLES = 300, 200
"""Points that judge a candidate, and samples of them drawn: at wrong offsets none is the last."""
TARGETS = 4
"""Points of an object that are enough, spread over it."""
HILL = 0.5
"""Of the median over all offsets: offsets next to the best are part of its valley below it."""
EXCHANGED = 3.0
"""How many times farther from their lines the ends lie in a frame where they are exchanged."""
LONG, RUNS, RUN = 3000, 40, 10
"""Frames from which the drift is fitted; and the runs of frames about those that tell the offset
which the fit uses."""
LONGEST = 400_000
"""The largest count of frames, from the first frame seen."""


@dataclass(frozen=True, eq=False)
class OffsetOfPair:
    """The offset of two cameras' counts: the second's frame j is taken at j + `frames` of the
    first."""

    pair: CameraPair
    measured: MeasuredOffset
    px: float
    """Median distance of the points from their epipolar lines there."""
    one_off_px: float
    """The same one frame off, and at the best of all other offsets, `other`."""
    other_px: float
    other: float
    offsets: FloatArray
    """(m,): the offsets scanned, and the distance at each."""
    errors_px: FloatArray
    order: int = 0
    """In which of the orders of the targets the second's fit the first's."""
    origin: int = 0
    part: float = 0.0
    """Whole frames, and what the offset is more: their sum is exact also near 2^53."""

    @property
    def exact(self) -> Decimal:
        """The offset, in frames."""
        return exact(self.origin, self.part)

    def sentence(self) -> str:
        """In words that a person can check."""
        first, second = self.pair
        measured = self.measured
        offset = in_frames(self.exact, measured.sigma)
        drift = ""
        if measured.drift_sigma:
            drift = (
                f", drifting by {1e6 * measured.drift:.1f} ± {1e6 * measured.drift_sigma:.1f} ppm"
            )
        return (
            f"Frame 0 of {second} is frame {offset} of {first}{drift}: the "
            f"points then lie {rounded(self.px)} px from their epipolar lines, one frame off "
            f"{rounded(self.one_off_px)} px, at the best other offset ({self.other:.0f}) "
            f"{rounded(self.other_px)} px."
        )


def exact(whole: int, part: float) -> Decimal:
    """A number of frames as a whole number and what it is more."""
    return Decimal(whole) + Decimal(part)


def in_frames(frames: Decimal, sigma: float) -> str:
    """An offset with its standard error."""
    return f"{frames:.3f} ± {max(sigma, 0.001):.3f}"


def offset_of_pair(
    recording: Recording,
    pair: CameraPair,
    near: Mapping[str, float] = MappingProxyType({}),
    orders: Sequence[IntArray] = (),
) -> OffsetOfPair:
    """The offset of two cameras that counted their own frames; what was found is kept for the
    pairs asked about last.

    Args:
        near: by how much later cameras were started than one of them, by what else tells it: with
            both cameras of the pair, only offsets within `AROUND` of that are tried.
        orders: of the targets with which the object looks the same, its own first, if a camera may
            have its targets in any of them.

    Raises:
        StereocalError: the data do not tell it.
    """
    two, searches = recording.of_cameras(pair), list[_Search]()
    # Each count begins at its first frame, in whole numbers.
    begin = two.first_frames
    two, origin = two.counted_from({name: -start for name, start in begin.items()}), begin[pair[0]]
    expected = near[pair[1]] - near[pair[0]] if {*pair} <= near.keys() else None
    expected = None if expected is None else expected + begin[pair[1]] - origin
    content = [repr([expected, begin, *two.cameras.items()]).encode()]
    for number, order in enumerate(orders or [np.arange(len(recording.object.names))]):
        named = with_targets(two, pair[1], order)
        shown = np.unique(named.target)
        few = shown[evenly_spread(len(shown), TARGETS)]
        fewer = named.where(np.isin(named.target, few))
        searches.append(_Search(fewer, expected, number, begin))
        content += map(bytes, (fewer.frame, fewer.camera, fewer.target, fewer.points))
    compute = partial(_offset, searches)
    return once_or_refused("time offset", hashlib.sha256(b"".join(content)).hexdigest(), compute)


def px_as_numbered(two: Recording) -> float:
    """The median distance of two cameras' points from their epipolar lines at the frames as they
    are numbered; infinite if too few moments are common to tell."""
    return _Search(two, None, 0, dict.fromkeys(two.cameras, 0)).at(0.0).px


class _Candidate(NamedTuple):
    """How well the points fit an essential matrix at an offset."""

    offset: float
    px: float = np.inf
    """Median distance from the epipolar lines."""
    score: float = np.inf
    """The same, larger where the lengths of what is held contradict each other."""
    evidence: float = -np.inf
    """The logarithm of how unlikely chance fits as many places of the images so well."""
    lengths_agree: bool = False
    frames: IntArray = np.empty(0, dtype=np.int64)
    """The moments that tell it: numbers of frames of the first camera."""
    pose: Pose | None = None
    order: int = 0


@dataclass(frozen=True, eq=False)
class _Search:
    """The search for the offset of the two cameras of a recording, by their own counts."""

    recording: Recording
    near: float | None
    """About which offset, if something else tells that."""
    order: int
    """Which of the orders of the targets the second camera has."""
    begin: Mapping[str, int]
    """Which frame of each camera, as it counted, is 0 in `recording`."""

    @property
    def origin(self) -> int:
        """Frames by which offsets are larger as the cameras counted."""
        first, second = self.begin.values()
        return first - second

    def stated(self, offset: float) -> str:
        """An offset of `recording` as the cameras counted."""
        return f"{exact(self.origin, offset):f}"

    @cached_property
    def tracks(self) -> tuple[Track, Track]:
        """The rays of both."""
        shown, tracks = np.unique(self.recording.target), []
        for number, (name, camera) in enumerate(self.recording.cameras.items()):
            of_camera = self.recording.where(self.recording.camera == number)
            if not len(of_camera.frame):
                raise StereocalError(f"{camera_in_words(name, begins=True)} saw no points.")
            first, many = int(of_camera.frame.min()), int(np.ptp(of_camera.frame))
            if many >= LONGEST:
                raise StereocalError(f"The {many:,} frames of {name} are too many to search.")
            rays = np.full((many + 1, len(shown), 2), np.nan)
            places = of_camera.frame - first, np.searchsorted(shown, of_camera.target)
            rays[places] = camera.undistort(of_camera.points)
            tracks.append(Track(first, rays))
        return tracks[0], tracks[1]

    @cached_property
    def focal_px(self) -> float:
        """Pixels per unit on the plane z = 1."""
        return float(
            np.sqrt(np.prod([camera.K[0, 0] for camera in self.recording.cameras.values()]))
        )

    @cached_property
    def scanned(self) -> tuple[FloatArray, FloatArray]:
        """All offsets by half frames, and the distance in px at each; NaN where not judged."""
        one, other = self.tracks
        whole = np.arange(FEWEST - len(other.rays), len(one.rays) - FEWEST + 1)
        whole = whole + one.first - other.first
        if self.near is not None:
            whole = whole[np.abs(whole - self.near) <= AROUND]
        both = [scan(one, track, whole) for track in (other, other.earlier(0.5))]
        return (whole[:, None] + [0.0, 0.5]).ravel(), self.focal_px * np.column_stack(both).ravel()

    @cached_property
    def usual_px(self) -> float:
        """The distance at wrong offsets."""
        return float(np.nanmedian(self.scanned[1]))

    def at(self, offset: float) -> _Candidate:
        """How well the points fit at an offset."""
        whole, (one, other) = int(np.floor(offset)), self.tracks
        if offset > whole:
            other = other.earlier(offset - whole)
        places, rays = common_points(one, other, whole, JUDGED)
        frames = np.unique(places[:, 0])
        pose = None
        if len(frames) >= FEWEST:
            pose = robust_pose([*self.recording.cameras.values()], rays, SAMPLES)
        if pose is None:
            return _Candidate(offset)
        px = self.focal_px * float(np.median(np.abs(sampson(pose.essential, rays.T))))
        seen = one.rays[frames], other.rays[frames - whole - other.first + one.first]
        off = _of_lengths(pose, np.concatenate(seen, axis=2)[:, [0, -1]])
        score = px * (1.0 + float(np.nan_to_num(off, posinf=1e9)) / LENGTHS_AGREE)
        differing = min(len(np.unique(places[:, camera])) for camera in (2, 3))
        evidence = (differing - FREEDOM) * float(np.log(self.usual_px / max(score, LEAST_PX)))
        agree, frames = off < ALIKE, frames + one.first
        return _Candidate(offset, px, score, evidence, agree, frames, pose, self.order)

    def nearby(self, candidate: _Candidate) -> _Candidate:
        """The best at parts of a frame next to it."""
        for step in (0.5, 0.25, 0.125, 0.0625):
            beside = [self.at(candidate.offset + way * step) for way in (-1, 1)]
            candidate = _best([candidate, *beside])
        return candidate

    def valleys(self) -> list[float]:
        """The offsets with the smallest errors, each some frames from the others."""
        (offsets, errors), valleys = self.scanned, list[float]()
        order = np.argsort(errors, kind="stable")[: np.isfinite(errors).sum()]
        for offset in offsets[order].tolist():
            if len(valleys) < CANDIDATES and all(
                abs(offset - valley) > APART for valley in valleys
            ):
                valleys.append(offset)
        return valleys

    def valley(self, best: float) -> tuple[float, float]:
        """The offsets about the best one at which the errors are far below those at others."""
        offsets, errors = self.scanned
        high = offsets[~(errors < HILL * self.usual_px)]
        low_end = high[high < best].max(initial=-np.inf)
        high_end = high[high > best].min(initial=np.inf)
        return min(low_end, best - APART), max(high_end, best + APART)

    def measured(self, best: _Candidate) -> MeasuredOffset:
        """The offset with its standard error, by the fit of what remains of it."""
        whole, (pair,), moving = round(best.offset), self.recording.pairs, best.frames
        dataset = self.recording.counted_from({pair[1]: whole}).pair(*pair)
        assert best.pose is not None
        dataset = _named_alike(dataset, best.pose, best.px / self.focal_px)
        if len(dataset.correspondences.frames) > RUNS * RUN:
            moving = moving[evenly_spread(len(moving), RUNS)]
        near = np.unique(moving[:, None] + np.arange(-(RUN // 2), RUN // 2))
        dataset = dataset.of_frames(near)
        # Out of step, 2.0 m were found of 4.9, which no fit leaves.
        shifted = usable_after(dataset, TimeOffset(best.offset - whole, reference=near[0]))
        dataset = dataset.changed(baseline_m=with_rough_baseline(shifted).baseline_m)
        settings = replace(wide_settings(dataset), time_drift=bool(np.ptp(near) > LONG))
        fit, note = fit_time_offset(dataset, settings, best.offset - whole)
        if fit is None:
            raise StereocalError(note)
        offset = fit.time_offset
        sigma = max(offset.sigma, spread_over_runs(fit))
        reference = offset.reference + self.begin[pair[0]]
        return replace(offset, frames=whole + offset.frames, reference=reference, sigma=sigma)


def _offset(searches: Sequence[_Search]) -> OffsetOfPair:
    """The offset that stands out, with its fraction.

    Raises:
        StereocalError: none does.
    """
    ((first, second),) = searches[0].recording.pairs
    with naming(f"The offset of {camera_in_words(first, second)} cannot be told"):
        best, other = _two_best(searches)
        search = searches[best.order]
        beside = min(search.at(best.offset + way).px for way in (-1, 1))
        measured = search.measured(best)
        if abs(measured.frames - best.offset) > NEAR + 5 * measured.sigma:
            raise StereocalError(
                f"the best offset, {search.stated(best.offset)} frames, and the one that fits the "
                f"motion there, {exact(search.origin, measured.frames):.2f}, contradict each other."
            )
    origin, (offsets, errors_px) = search.origin, search.scanned
    return OffsetOfPair(
        (first, second),
        replace(measured, frames=origin + measured.frames),
        best.px,
        beside,
        other.px,
        origin + other.offset,
        origin + offsets,
        errors_px,
        best.order,
        origin,
        measured.frames,
    )


def _two_best(searches: Sequence[_Search]) -> tuple[_Candidate, _Candidate]:
    """The offset that stands out, and the best of the others."""
    every = (search.at(offset) for search in searches for offset in search.valleys())
    judged = [candidate for candidate in every if candidate.px < np.inf]
    if (places := len({candidate.offset for candidate in judged})) < FEWEST_OTHERS:
        raise StereocalError(
            f"at no more than {count(places, 'offset')} do both cameras see {FEWEST} moments of a "
            "motion, so none stands out. Record both cameras for longer while the object moves "
            "through what both see; one at rest tells nothing."
        )
    # Short arcs of a motion fit well at wrong offsets too, near the ends of the recordings.
    likely = sorted(judged, key=lambda candidate: -candidate.evidence)[:FINALISTS]
    near = sorted(judged, key=lambda candidate: candidate.score)[:FINALISTS]
    finalists = {(candidate.offset, candidate.order): candidate for candidate in (*likely, *near)}
    judged += (searches[candidate.order].nearby(candidate) for candidate in finalists.values())
    best = max(judged, key=lambda candidate: candidate.evidence)
    low, high = searches[best.order].valley(best.offset)
    others = [candidate for candidate in judged if not low <= candidate.offset <= high]
    least = RIVAL * best.evidence if best.evidence > ENOUGH else -np.inf
    rival = _best(candidate for candidate in others if candidate.evidence > least)
    stated = searches[0].stated
    if best.px > fitting_px(searches[0].recording.cameras.values()):
        raise StereocalError(
            f"at no offset do their points fit together; at the best, {stated(best.offset)} "
            f"frames, they lie {rounded(best.px)} px from their epipolar lines. Check that both "
            "saw the same motion at the same time, with as many frames a second, and their camera "
            "files."
        )
    further = FURTHER_WITH_LENGTHS if best.lengths_agree else FURTHER
    need = STANDS_OUT * (1.0 + further / (len(best.frames) - TOO_FEW))
    if not rival.score >= need * best.score:
        which = "" if rival.order == best.order else " with its ends the other way round"
        raise StereocalError(
            f"two offsets fit nearly as well, {stated(best.offset)} frames ({rounded(best.px)} px "
            f"from the epipolar lines) and {stated(rival.offset)} ({rounded(rival.px)} px{which}): "
            "the motion repeats itself, or is too short. A longer recording of an irregular motion "
            "decides, or an offset that you know to a few frames."
        )
    return best, _best(others)


def _named_alike(dataset: Pair, pose: Pose, near: float) -> Pair:
    """The data set with the ends of what is held named alike in both cameras, and as in the frame
    before.

    Where they are exchanged in some frames, no point has a motion to interpolate. With three tenths
    of them exchanged in the second camera of real windows, 10 of 20 parts of a frame were in their
    95 % interval, now 17 of 23; with sound names 18 of 23.

    Args:
        near: how far points are from their epipolar lines, on z = 1.
    """
    rows = dataset.correspondences
    frames, frame_of = np.unique(rows.frame, return_inverse=True)

    def apart(named: Pair) -> FloatArray:
        """(f,): rms distance of the points of each frame from their epipolar lines, on z = 1."""
        squares = np.square(sampson(pose.essential, named.rays.T))
        return np.asarray(np.sqrt(np.bincount(frame_of, squares) / np.bincount(frame_of)))

    exchanged = dataset.with_targets_exchanged(frames)  # in the secondary camera
    wrong = apart(dataset) > EXCHANGED * (apart(exchanged) + near)
    if not wrong.any():
        return dataset
    rows = dataset.with_targets_exchanged(frames[wrong]).correspondences
    held = rows.rigid_object or RigidObject.bar(dataset.target_distance_m)
    pixels = np.full((len(frames), len(held.names), 4), np.nan)  # u, v of both cameras
    pixels[frame_of, rows.target] = np.hstack([rows.primary, rows.secondary])
    turned = exchanged_ends(pixels[:, held.longest])
    names = np.where(turned[frame_of], held.half_turn[rows.target], rows.target)
    return dataset.changed(correspondences=replace(rows, target=names))


def _best(candidates: Iterable[_Candidate]) -> _Candidate:
    """The candidate of the least score; one of no offset and infinite score if there is none."""
    return min(candidates, key=lambda candidate: candidate.score, default=_Candidate(np.nan))


def _of_lengths(pose: Pose, ends: FloatArray) -> float:
    """Median deviation of the reconstructed lengths of what is held, as a fraction; NaN without
    enough.

    Args:
        ends: (n, 2, 4): rays of two targets.
    """
    ends = ends[np.isfinite(ends).all(axis=(1, 2))]
    if len(ends) < FEWEST_LENGTHS or (ends[:, 0] == ends[:, 1]).all():
        return np.nan
    rays = (np.ascontiguousarray(ends[:, k].T) for k in (0, 1))
    first, last = (triangulate_rays(pose.R, pose.T, end) for end in rays)
    lengths = np.nan_to_num(np.linalg.norm(first - last, axis=1), nan=np.inf)
    middle = np.median(lengths)
    return float(np.median(np.abs(lengths / middle - 1.0))) if middle < np.inf else np.inf
