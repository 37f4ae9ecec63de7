"""Two cameras that were started by hand: which frame of one belongs to which of the other.

Every offset of the counts of frames is scanned (`calibration.offset_scan`); an essential matrix
judges the best by the same evidence, and the fit of the time offset finds the fraction of the one
that stands out.
"""

import hashlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import pandas as pd

from stereocal.calibration.corrections import fitting_px
from stereocal.calibration.offset_scan import FEWEST, Common, Scan, Track
from stereocal.errors import StereocalError, naming
from stereocal.network.frame_rates import at_slowest
from stereocal.network.pairs import reached
from stereocal.refined.free_baseline import with_rough_baseline
from stereocal.refined.refine import robust_pose
from stereocal.refined.screening import wide_settings
from stereocal.refined.time_offset import fit_time_offset, spread_over_runs
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.rig.geometry import Pose, sampson, triangulate_rays
from stereocal.rig.recording import CameraPair, Recording
from stereocal.rig.tracks import MeasuredOffset
from stereocal.system.answers import TableAnswer
from stereocal.system.latest import Latest, once_or_refused
from stereocal.system.numbers import rounded
from stereocal.system.sampling import evenly_spread

STANDS_OUT, FURTHER, TOO_FEW = 1.5, 15.0, 20
"""How many times farther from the epipolar lines the points must lie at any other offset; with the
second number of moments above the third, twice as much: chance fits few moments well."""
ENOUGH, CANDIDATES = 60.0, 30
"""The least evidence for an offset, and offsets judged."""
LENGTHS_AGREE, FEWEST_LENGTHS = 0.03, 15
"""Median deviation of reconstructed lengths from their median, as a fraction of it, that doubles
the distance, if so many are known. Measured: at right offsets up to 0.02, with noise of 2 px up to
0.03; where short arcs fit by chance 0.03 to 0.5."""
NEAR = 0.6
"""Frames between the best candidate and the fit of the motion there."""
JUDGED, SAMPLES = 300, 200
"""Points that judge a candidate, and samples of them drawn: at wrong offsets none is the last."""
TARGETS = 4
"""Points of an object that are enough, spread over it."""
LONG, RUNS, RUN = 3000, 40, 10
"""Frames from which the drift is fitted; and the runs of frames about those that tell the offset
which the fit uses."""
LEAST_SIGMA, CLOSED = 0.005, 0.25
"""Frames: the least error that a pair's offset may weigh, and by how much pairs may disagree."""
LONGEST = 400_000
"""The largest count of frames, from the first frame seen."""

KEPT: Latest["OffsetOfPair | StereocalError"] = Latest(16)


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

    def sentence(self) -> str:
        """In words that a person can check."""
        first, second = self.pair
        found = self.measured
        drift = ""
        if found.drift_sigma:
            drift = f", drifting by {1e6 * found.drift:.1f} ± {1e6 * found.drift_sigma:.1f} ppm"
        return (
            f"Frame 0 of {second} is frame {_pm(found.frames, found.sigma)} of {first}{drift}: the "
            f"points then lie {rounded(self.px)} px from their epipolar lines, one frame off "
            f"{rounded(self.one_off_px)} px, at the best other offset ({self.other:.0f}) "
            f"{rounded(self.other_px)} px."
        )


@dataclass(frozen=True, eq=False, repr=False)
class BroughtIntoStep(TableAnswer):
    """A recording whose cameras count their frames alike, and how that was found, which is in its
    notes."""

    recording: Recording
    offsets: Mapping[str, tuple[float, float]]
    """Of each camera, by how many frames of the first it was started later, with the standard
    error."""
    pairs: Mapping[CameraPair, OffsetOfPair]

    @property
    def answer(self) -> list[str]:
        """What was found, of each pair and of the cameras together."""
        told = [found.sentence() for found in self.pairs.values()]
        first, *others = self.offsets
        each = [
            f"{name} {_pm(abs(value), sigma)} frames {'later' if value >= 0 else 'earlier'}"
            for name, (value, sigma) in self.offsets.items()
            if name != first
        ]
        together = f"All pairs together: {', '.join(each)} than {first} was started."
        return [*told, together] if len(others) > 1 else told

    def to_dataframe(self) -> pd.DataFrame:
        """The offset of each pair in frames, and the distances from the epipolar lines in px."""
        rows = {
            "-".join(pair): {
                "frames": own.measured.frames,
                "sigma_frames": own.measured.sigma,
                "median_px": own.px,
                "one_frame_off_px": own.one_off_px,
                "other_offset": own.other,
                "other_px": own.other_px,
            }
            for pair, own in self.pairs.items()
        }
        return pd.DataFrame(rows).T.rename_axis("pair")


def _pm(frames: float, sigma: float) -> str:
    return f"{frames:.3f} ± {max(sigma, 0.001):.3f}"


def bring_into_step(
    recording: Recording, near: Mapping[str, float] = MappingProxyType({})
) -> BroughtIntoStep:
    """Find by how much later than the first each camera was started, from all pairs.

    Args:
        recording: whose cameras count their own frames.
        near: as for `offset_of_pair`.

    Raises:
        StereocalError: the data do not tell it, or pairs contradict each other.
    """
    names = list(recording.cameras)
    found, failed = dict[CameraPair, OffsetOfPair](), dict[CameraPair, str]()
    for pair in recording.pairs:
        try:
            found[pair] = offset_of_pair(recording, pair, near)
        except StereocalError as error:
            failed[pair] = str(error)
    lost = [name for name in names if name not in reached(names, found)]
    if lost or not found:
        told = failed[pair := next(pair for pair in failed if not lost or {*pair} & {*lost})]
        raise StereocalError(told + _rates_that_fit(recording, pair))
    advice = "One of them is wrong: record an irregular motion that all cameras see."
    measured = {pair: own.measured for pair, own in found.items()}
    starts, covariance = closed(names, measured, advice)
    errors = np.sqrt(np.diag(covariance)).tolist()
    offsets = dict(zip(names, zip(starts.tolist(), errors, strict=True), strict=True))
    whole = {name: round(value) for name, (value, _) in offsets.items()}
    counted = replace(recording.counted_from(whole), start_frames=whole)
    brought = BroughtIntoStep(counted, offsets, found)
    notes = (*recording.step_notes, *brought.answer)
    return replace(brought, recording=replace(counted, step_notes=notes))


def closed(
    names: Sequence[str], pairs: Mapping[CameraPair, MeasuredOffset], advice: str
) -> tuple[FloatArray, FloatArray]:
    """By how many frames of the first each of n cameras was started later, (n,), and their
    covariance (n, n), from the offsets of pairs that reach all.

    Raises:
        StereocalError: the pairs contradict each other; with this advice.
    """
    values, sigmas = np.array([[own.frames, own.sigma] for own in pairs.values()]).T
    sigmas = np.maximum(sigmas, LEAST_SIGMA)
    starts, covariance, off = fused_values(names, [*pairs], values, sigmas)
    if (off > CLOSED + 5 * sigmas).any():
        each = ", ".join(f"{a}-{b} {own.frames:.2f}" for (a, b), own in pairs.items())
        raise StereocalError(
            f"The offsets of the pairs contradict each other by {off.max():.2f} frames: {each}. "
            f"{advice}"
        )
    return starts, covariance


def fused_values(
    names: Sequence[str], pairs: Sequence[CameraPair], values: FloatArray, sigmas: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What each of n cameras has more than the first, (n,), of differences (p,) of pairs; their
    covariance (n, n); and by how much each pair is off, (p,)."""
    rows = np.array([[(name == b) - (name == a) for name in names[1:]] for a, b in pairs], float)
    covariance = np.linalg.inv(rows.T @ (rows / sigmas[:, None] ** 2))
    found = covariance @ rows.T @ (values / sigmas**2)
    off = np.abs(rows @ found - values)
    return np.array([0.0, *found]), np.pad(covariance, ((1, 0), (1, 0))), off


def _rates_that_fit(recording: Recording, pair: CameraPair) -> str:
    """A sentence, if an offset stands out where a camera takes two frames for each of the other."""
    two = recording.of_cameras(pair)
    for slow, fast in (pair, pair[::-1]):
        rates = {slow: 30, fast: 60}
        with suppress(StereocalError):
            found = offset_of_pair(at_slowest(two, rates), pair)
            stated = ", ".join(f'"{name}": {rates[name]}' for name in pair)
            return (
                f" With two frames of {fast} for each of {slow}, the points do fit, "
                f"{rounded(found.px)} px from their lines: state the frame rates in dataset.json, "
                f'such as "frame_rates": {{{stated}}}.'
            )
    return ""


def offset_of_pair(
    recording: Recording, pair: CameraPair, near: Mapping[str, float] = MappingProxyType({})
) -> OffsetOfPair:
    """The offset of two cameras that counted their own frames; what was found is kept for the
    pairs asked about last.

    Args:
        near: by how much later cameras were started than one of them, by what else tells it: with
            both cameras of the pair, only offsets within `AROUND` of that are tried.

    Raises:
        StereocalError: the data do not tell it.
    """
    shown = np.unique(recording.target)
    few = shown[evenly_spread(len(shown), TARGETS)]
    two = recording.where(np.isin(recording.target, few)).of_cameras(pair)
    search = _Search(two, near[pair[1]] - near[pair[0]] if {*pair} <= near.keys() else None)
    columns = two.frame, two.camera, two.target, two.points
    content = repr([search.near, *two.cameras.items()]).encode(), *map(bytes, columns)
    return once_or_refused(KEPT, hashlib.sha256(b"".join(content)).hexdigest(), search.offset)


class _Candidate(NamedTuple):
    """How well the points fit an essential matrix at an offset."""

    offset: float
    px: float = np.inf
    """Median distance from the epipolar lines."""
    lengths: float = 0.0
    """How far the lengths of what is held are from their median, as a fraction, in the median."""
    frames: IntArray = np.empty(0, dtype=np.int64)
    """The moments that tell it: numbers of frames of the first camera."""

    @property
    def score(self) -> float:
        """The distance, larger where the lengths contradict each other."""
        return self.px * (1.0 + (self.lengths / LENGTHS_AGREE) ** 2)


@dataclass(frozen=True, eq=False)
class _Search:
    """The search for the offset of the two cameras of a recording, by their own counts."""

    recording: Recording
    near: float | None
    """About which offset, if something else tells that."""

    @cached_property
    def tracks(self) -> tuple[Track, Track]:
        """The rays of both."""
        shown, tracks = np.unique(self.recording.target), []
        for number, (name, camera) in enumerate(self.recording.cameras.items()):
            own = self.recording.where(self.recording.camera == number)
            if not len(own.frame):
                raise StereocalError(f"The camera {name} saw no points.")
            first, many = int(own.frame.min()), int(np.ptp(own.frame))
            if many >= LONGEST:
                raise StereocalError(f"The {many:,} frames of {name} are too many to search.")
            rays = np.full((many + 1, len(shown), 2), np.nan)
            at = own.frame - first, np.searchsorted(shown, own.target)
            rays[at] = camera.undistort(own.points)
            tracks.append(Track(first, rays))
        return tracks[0], tracks[1]

    @cached_property
    def focal_px(self) -> float:
        """Pixels per unit on the plane z = 1."""
        return float(np.sqrt(np.prod([each.K[0, 0] for each in self.recording.cameras.values()])))

    @cached_property
    def scan(self) -> Scan:
        """All offsets."""
        return Scan.of(*self.tracks, self.focal_px, self.near)

    def at(self, offset: float) -> _Candidate:
        """How well the points fit at an offset."""
        common = Common.of(*self.tracks, offset)
        frames, rays = common.drawn(JUDGED)
        frames, pose = np.unique(frames), None
        if len(frames) >= FEWEST:
            pose = robust_pose([*self.recording.cameras.values()], rays, SAMPLES)
        if pose is None:
            return _Candidate(offset)
        px = self.focal_px * float(np.median(np.abs(sampson(pose.essential, rays.T))))
        return _Candidate(offset, px, _of_lengths(pose, common.rays[:, [0, -1]]), frames)

    def evidence(self, found: _Candidate) -> float:
        """The logarithm of how unlikely chance fits as many moments so well."""
        return float(self.scan.evidence(len(found.frames), found.score))

    def offset(self) -> OffsetOfPair:
        """The offset that stands out, with its fraction.

        Raises:
            StereocalError: none does.
        """
        (pair,) = self.recording.pairs
        with naming(f"The offset of the cameras {pair[0]} and {pair[1]} cannot be told"):
            best, other = self.two_best()
            beside = min(self.at(best.offset + way).px for way in (-1, 1))
            measured = self.measured(best)
            if abs(measured.frames - best.offset) > NEAR + 5 * measured.sigma:
                raise StereocalError(
                    f"the best offset, {best.offset:.2f} frames, and the one that fits the motion "
                    f"there, {measured.frames:.2f}, contradict each other."
                )
        found = best.px, beside, other.px, other.offset
        return OffsetOfPair(pair, measured, *found, self.scan.offsets, self.scan.px)

    def two_best(self) -> tuple[_Candidate, _Candidate]:
        """The offset that stands out, and the best of the others."""
        judged = [each for each in map(self.at, self.scan.likely(CANDIDATES)) if each.px < np.inf]
        best = max(judged, key=self.evidence, default=_Candidate(np.nan, 0.0))
        if best.score > fitting_px(self.recording):
            differ = f", and lengths of what is held differ by {100 * best.lengths:.0f} %"
            raise StereocalError(
                f"at no offset do their points fit together; at the best, {best.offset:.0f} "
                f"frames, they lie {rounded(best.px)} px from their epipolar lines"
                f"{differ if best.lengths > LENGTHS_AGREE else ''}. Check that both saw the same "
                "motion at the same time, with as many frames a second and none lost, and their "
                "camera files."
            )
        low, high = self.scan.valley(best.offset)
        others = [each for each in judged if not low <= each.offset <= high]
        if self.evidence(best) < ENOUGH or not others:
            raise StereocalError(
                f"at no offset do both cameras see so many more than {FEWEST} moments of a motion "
                "that it stands out. Record both cameras for longer while the object moves through "
                "what both see; one at rest tells nothing."
            )
        rival = min(others, key=lambda each: each.score)
        need = STANDS_OUT * (1.0 + FURTHER / (len(best.frames) - TOO_FEW))
        if not rival.score >= need * best.score:
            raise StereocalError(
                f"two offsets fit nearly as well, {best.offset:.0f} frames ({rounded(best.px)} px "
                f"from the epipolar lines) and {rival.offset:.0f} ({rounded(rival.px)} px): the "
                "motion repeats itself, or is too short. A longer recording of an irregular motion "
                "decides, or an offset that you know to a few frames."
            )
        return best, rival

    def measured(self, best: _Candidate) -> MeasuredOffset:
        """The offset with its standard error, by the fit of what remains of it."""
        whole, (pair,), moving = round(best.offset), self.recording.pairs, best.frames
        dataset = self.recording.counted_from({pair[1]: whole}).pair(*pair)
        if len(dataset.correspondences.frames) > RUNS * RUN:
            moving = moving[evenly_spread(len(moving), RUNS)]
        near = np.unique(moving[:, None] + np.arange(-(RUN // 2), RUN // 2))
        dataset = with_rough_baseline(dataset.of_frames(near))
        settings = replace(wide_settings(dataset), time_drift=bool(np.ptp(near) > LONG))
        fit, note = fit_time_offset(dataset, settings, best.offset - whole)
        if fit is None:
            raise StereocalError(note)
        sigma = max(fit.time_offset.sigma, spread_over_runs(fit))
        return replace(fit.time_offset, frames=whole + fit.time_offset.frames, sigma=sigma)


def _of_lengths(pose: Pose, ends: FloatArray) -> float:
    """Median deviation of the reconstructed lengths of what is held, as a fraction; 0 without
    enough.

    Args:
        ends: (n, 2, 4): rays of two targets.
    """
    ends = ends[np.isfinite(ends).all(axis=(1, 2))]
    if len(ends) < FEWEST_LENGTHS:
        return 0.0
    points = triangulate_rays(pose.R, pose.T, np.ascontiguousarray(ends.reshape(-1, 4).T))
    lengths = np.nan_to_num(np.linalg.norm(points[::2] - points[1::2], axis=1), nan=np.inf)
    middle = float(np.median(lengths))
    if not 0.0 < middle < np.inf:
        return 0.0 if middle == 0.0 else 1.0  # of one target alone, or of rays that do not meet
    return float(np.median(np.abs(lengths / middle - 1.0)))
