"""Bring the points of the secondary camera into step with those of the primary.

Its frames may have other numbers and another rate, and its shutter opens a part of a frame later. A
parameter file has how it was in the recording that was calibrated; with the known pose, the points
themselves tell whether it is so with them. They can be brought to the instants of the primary's
frames where they have tracks: points of the same name, or the only point of each frame.
"""

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pandas as pd

from stereocal.calibration.corrections import fitting_px
from stereocal.errors import StereocalError
from stereocal.fit.rig_file import Parameters
from stereocal.fit.timing.offset_of_pair import APART, STANDS_OUT
from stereocal.matching.point_table import POINT, PointTable
from stereocal.matching.trajectories import naming_columns
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.clusters import follow_each_other
from stereocal.rig.correspondences import PIXELS, TIME
from stereocal.rig.geometry import sampson
from stereocal.rig.parameters import RigParameters
from stereocal.rig.tracks import MeasuredOffset, interpolate
from stereocal.system.array_types import BoolArray, FloatArray, IntArray
from stereocal.system.sampling import evenly_spread

SHIFT = "time_shift_frames"
"""Column of points that were shifted: by how many frames, 0 where they have no neighbours."""
RATE = 5e-4
"""The least change of an offset from frame to frame that is one of rates."""
FRAMES, FEWEST = 40, 8
"""Frames that an offset is judged by, and at least so many."""
MOST_OFFSETS = 20_000
NTSC = 1.001
"""60 frames a second over 59.94."""
RATES = (1.0,), (2.0, 0.5), tuple(np.outer((1.0, 2.0, 0.5), (NTSC, 1 / NTSC)).ravel().tolist())
"""Of the primary over the secondary: those that are tried together, where none before fits."""
FITTED, TELLING, LONG = 1000, 40, 300
"""Frames that an offset is fitted to, fewest points, and frames from which on a drift is."""
ROUNDS, STEP, FAR, BLOCKS = 6, 0.02, 2.5, 10
"""Of the fit; frames of its derivative; medians from which an error loses its weight; and parts of
the time, within which errors are alike: the standard error is the larger of theirs and of that of
independent errors (of 160 simulated recordings, rms of the errors over the stated ones 1.08)."""
CLAIMED, LEAST = 3.2, 0.02
"""Standard errors and frames from which on it differs from the calibrated recording's."""
FOLLOWING = 10
"""Fewest points of tracks whose frames follow each other."""


def tables_in_step(
    rig: Parameters, tables: Mapping[str, PointTable]
) -> tuple[dict[str, PointTable], list[str]]:
    """What `points_in_step` gives, of tables that are read only if their cameras are not in
    step."""
    first, *others = tables
    late = [n for n in others if _is_late(rig.pair(first, n), tables[n].further)]
    if not late:
        return dict(tables), []
    read = {name: pd.concat(list(tables[name].blocks())) for name in (first, *late)}
    points, notes = points_in_step(rig, read)
    shifted = {n: PointTable(points[n], tables[n].numbers, tables[n].label) for n in late}
    sentences = [f"{tables[name].label}: {note}" for name in late for note in notes[name]]
    return {**tables, **shifted}, sentences


def points_in_step(
    rig: Parameters, tables: Mapping[str, pd.DataFrame], numbered_alike: bool = False
) -> tuple[dict[str, pd.DataFrame], dict[str, list[str]]]:
    """The points of all cameras with their frames numbered as the first's, at the instants of
    these; and what was done with those of each that was not in step.

    Args:
        numbered_alike: their frames are, however those of the calibrated recording were counted.

    Raises:
        StereocalError: the points do not tell by how much the cameras were counted apart.
    """
    first, *others = tables
    in_step, notes = dict(tables), dict[str, list[str]]()
    called = {name: f"the {name}" if name in CAMERAS else name for name in tables}
    for name in others:
        pair, points = rig.pair(first, name), tables[name]
        pair = replace(pair, start_frame=0) if numbered_alike else pair
        if not _is_late(pair, points):
            continue
        both = _Both.of(pair, tables[first], points, POINT * 2)
        offset, notes[name] = both.counted(called[first], called[name])
        i, j, _ = both.nearest(both.placed(offset), 0, FITTED)
        in_step[name], sentences = both.moved(offset, i, j, *both.moments(offset))
        notes[name] += sentences
    return in_step, notes


def pairs_in_step(table: PointTable, rig: RigParameters) -> tuple[PointTable, str]:
    """Pairs with their secondary points shifted by a time offset, and what was done as a sentence;
    unchanged, and empty, if there is none or they are shifted already."""
    if not _is_late(rig, table.further):
        return table, ""
    pairs = pd.concat(list(table.blocks()))
    both, some = _Both.of(rig, pairs, pairs, PIXELS), evenly_spread(len(pairs), FITTED)

    def misfit(tried: MeasuredOffset) -> float:
        points, _ = both.at(tried, both.times)
        errors = both.errors(both.first, _seen(rig, rig.secondary, points))
        return float(np.median(np.abs(errors)))

    offset, _ = how_counted(rig, rig.start_frame, misfit)
    moved, sentences = both.moved(offset, some, some, both.times, np.ones(len(pairs), np.bool_))
    if not sentences:
        return table, ""
    return PointTable(moved, table.numbers, table.label), " ".join([f"{table.label}:", *sentences])


def how_counted(
    rig: RigParameters, whole: int, misfit: Callable[[MeasuredOffset], float]
) -> tuple[MeasuredOffset, float]:
    """The time offset of a parameter set, with the whole frames by which the calibrated recording
    was counted apart if the points then fit far better; and their misfit, infinite where neither
    fits far better than the other.

    Args:
        misfit: of the points at an offset, px.
    """
    known = rig.time_offset or MeasuredOffset()
    if not whole:
        return known, 0.0
    apart = replace(known, frames=known.frames + whole, reference=known.reference - whole)
    px = {offset: misfit(offset) for offset in (known, apart)}
    best, other = sorted(px, key=px.__getitem__)
    return (best, px[best]) if STANDS_OUT * px[best] < px[other] else (known, np.inf)


def _is_late(rig: RigParameters, columns: Container[str]) -> bool:
    """Whether points with these columns are to be brought into step."""
    return (rig.time_offset is not None or rig.start_frame != 0) and SHIFT not in columns


Placed = tuple[IntArray, IntArray, FloatArray]
"""Of points: their frames, ascending, which they are, and their rays as of `_seen`."""


def _seen(rig: RigParameters, camera: Camera, pixels: FloatArray) -> FloatArray:
    """(n, 2): the rays of pixels of one of two cameras; where there are windows the pixels, as then
    epipolar errors are by these."""
    return pixels if rig.has_windows else camera.undistort(pixels)


@dataclass(frozen=True, eq=False)
class _Both:
    """What two cameras saw, whose pose is known: m points of the first and n of the second."""

    rig: RigParameters
    frames: IntArray
    first: FloatArray
    """(m,) and (m, 2): of the first camera, with its rays as of `_seen`."""
    points: pd.DataFrame
    """Of the second, with its pixels in some columns."""
    columns: tuple[str, ...]
    times: IntArray
    second: FloatArray
    """(n,) and (n, 2): frames of the second as recorded, and its pixels."""
    track: IntArray
    """(n,): which points of the second belong together; each one alone where no column names tracks
    whose frames follow."""

    @classmethod
    def of(
        cls, rig: RigParameters, first: pd.DataFrame, second: pd.DataFrame, columns: Sequence[str]
    ) -> "_Both":
        """The points of two tables with the column `frame`, and of the second perhaps `TIME` and
        names of tracks.

        Args:
            columns: the pixels of the first and of the second.
        """
        rays = _seen(rig, rig.primary, first[list(columns[:2])].to_numpy(float))
        of_second = (*columns[2:],)
        pixels, frame = second[list(of_second)].to_numpy(dtype=np.float64), second["frame"]
        recorded = pd.to_numeric(second.get(TIME, frame), errors="coerce").fillna(frame)
        times, frames = recorded.to_numpy(dtype=np.int64), first["frame"].to_numpy(dtype=np.int64)
        named = second.assign(frame=times).dropna(axis="columns")
        further = named.columns.difference(["frame", TIME, *of_second], sort=False)
        codes = [pd.factorize(named[name])[0] for name in naming_columns(named, further)]
        if not named["frame"].duplicated().any():
            codes = [0 * times]
        for track in codes:
            if follow_each_other(pixels[np.lexsort([times, track])], FOLLOWING):
                break
        else:
            track = np.arange(len(times))
        return cls(rig, frames, rays, second, of_second, times, pixels, track)

    def moments(self, offset: MeasuredOffset) -> tuple[IntArray, BoolArray]:
        """The first's frame for each point of the second, as recorded; and whether the point is the
        nearest to it, of a camera with another rate, (n,) each."""
        if abs(offset.drift) < RATE:
            return self.times + offset.split()[0], np.ones(len(self.times), np.bool_)
        moment = np.floor(self.times + offset.at(self.times) + 0.5).astype(np.int64)
        late = self.late(offset, moment)
        return moment, (late >= -0.5) & (late < 0.5)

    def late(self, offset: MeasuredOffset, moment: IntArray) -> FloatArray:
        """(n,): by how many of its own frames a point of the second is later than a frame of the
        first."""
        return (self.times - moment + offset.at(self.times)) / (1.0 + offset.drift)

    def at(self, offset: MeasuredOffset, moment: IntArray) -> tuple[FloatArray, BoolArray]:
        """The second's points at frames of the first, (n, 2), and whether that is known, (n,);
        those that have no neighbours or would leave the image are where they are."""
        interpolated = interpolate(self.track, self.times, self.second, self.late(offset, moment))
        known = interpolated.inside(self.rig.secondary.image_size)
        return np.where(known[:, None], interpolated.positions, self.second), known

    def renumbered(self, moment: IntArray) -> IntArray:
        """(n,): the second's frames, moved as far as those recorded."""
        return self.points["frame"].to_numpy(dtype=np.int64) + moment - self.times

    def placed(self, offset: MeasuredOffset) -> Placed:
        """The second's points in the order of the first's frames: the frame, which point, and its
        ray there."""
        moment, kept = self.moments(offset)
        rows, frame = np.flatnonzero(kept), self.renumbered(moment)
        rows = rows[np.argsort(frame[rows], kind="stable")]
        pixels, _ = self.at(offset, moment)
        return frame[rows], rows, _seen(self.rig, self.rig.secondary, pixels[rows])

    def errors(self, first: FloatArray, second: FloatArray) -> FloatArray:
        """Signed distances of rays, as of `_seen`, from their epipolar lines, in px."""
        if self.rig.has_windows:
            return self.rig.epipolar_errors(first, second)
        focal = np.sqrt(self.rig.primary.K[0, 0] * self.rig.secondary.K[0, 0])
        both = np.column_stack([first, second])
        return np.asarray(focal * sampson(self.rig.pose.essential, both))

    def nearest(
        self, placed: Placed, later: int, most: int
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """For the points of the first in some frames the second's that is nearest to the epipolar
        line: indices of both, (k,), and the distance in px; none of too few frames.

        Args:
            placed: `later` frames before their time.
        """
        frame, rows, rays = placed
        common = np.intersect1d(self.frames, frame + later)
        if len(common) < FEWEST:
            return np.empty(0, np.int64), np.empty(0, np.int64), np.array([np.inf])
        i = np.flatnonzero(np.isin(self.frames, common[evenly_spread(len(common), most)]))
        begin, end = (np.searchsorted(frame + later, self.frames[i], s) for s in ("left", "right"))
        width = end - begin
        start = np.cumsum(width) - width
        one = np.repeat(np.arange(len(i)), width)
        other = np.arange(len(one)) + (begin - start)[one]
        px = np.abs(self.errors(self.first[i[one]], rays[other]))
        best = np.lexsort((px, one))[start]
        return i, rows[other[best]], px[best]

    def misfit(self, placed: Placed, later: int = 0) -> float:
        """The median distance of the nearest points from the epipolar lines, in px."""
        return float(np.median(self.nearest(placed, later, FRAMES)[2]))

    def counted(self, first: str, second: str) -> tuple[MeasuredOffset, list[str]]:
        """How the second's points were counted, and a sentence with the cameras' names."""
        whole = self.rig.start_frame
        offset, px = how_counted(self.rig, whole, lambda tried: self.misfit(self.placed(tried)))
        if not whole:
            return offset, []
        if px > fitting_px((self.rig.primary, self.rig.secondary)):
            if min(len(np.unique(frames)) for frames in (self.frames, self.times)) < FEWEST:
                return offset, [
                    f"the calibrated recording was counted {abs(whole)} frames apart; these frames "
                    "are too few to tell whether they are, and were used as numbered."
                ]
            anew = next(filter(None, map(self.scanned, RATES)), None)
            if anew is None:
                raise StereocalError(
                    f"The calibrated recording was counted {abs(whole)} frames apart. By how much "
                    "these points are, they do not tell: at no offset do they fit the parameters "
                    "far better than at all others. Number the frames of both cameras alike, or "
                    "give more frames with few points that move."
                )
            offset = anew
        start = offset.split()[0]
        if abs(offset.drift) >= RATE:
            where = f"frame k of {second} is frame {1.0 + offset.drift:.6g} k {start:+d} of {first}"
        elif start:
            where = f"frame 0 of {second} is frame {start} of {first}"
        else:
            return offset, ["by these points, both cameras counted their frames alike."]
        return offset, [f"by these points, {where}: they are paired like this, with its numbers."]

    def scanned(self, rates: Sequence[float]) -> MeasuredOffset | None:
        """The offset at which the points fit far better than at all others; None if none does."""
        tries = list[tuple[float, float, float]]()
        for rate, phase in product(rates, (0.0, 0.5)):
            placed = self.placed(MeasuredOffset(phase, rate - 1.0))
            low, high = self.frames.min() - placed[0][-1], self.frames.max() - placed[0][0]
            if high - low > MOST_OFFSETS:
                return None
            whole = range(low, high + 1)
            tries += [(self.misfit(placed, shift), shift + phase, rate - 1.0) for shift in whole]
        errors, frames, drifts = np.array(tries).T
        best, offsets = int(errors.argmin()), frames + drifts * np.median(self.times)
        other = errors[np.abs(offsets - offsets[best]) > APART].min(initial=np.inf)
        if (
            errors[best] <= fitting_px((self.rig.primary, self.rig.secondary))
            and STANDS_OUT * errors[best] < other < np.inf
        ):
            return MeasuredOffset(float(frames[best]), float(drifts[best]))
        return None

    def by_points(
        self, tried: MeasuredOffset, i: IntArray, j: IntArray, moment: IntArray
    ) -> MeasuredOffset | None:
        """The offset by points in pairs, if they tell it and it is not the one near it that was
        tried.

        The errors e (k,) of the pairs, signed distances from their epipolar lines, have the
        derivatives J (k, 1 or 2) by the offset in the middle and, of a long recording, by its
        drift: an image point moves by minus its velocity a frame. Newton's steps lower Cauchy's
        sum of log(1 + f), f = (e / c)^2, with c `FAR` medians of |e|. The covariance is the
        sandwich H^-1 (sum of s s^T) H^-1 of the scores s = J e / (1 + f) and the curvature H = sum
        of J J^T (1 - f) / (1 + f)^2; the larger one of single pairs and of sums over `BLOCKS` runs
        in time, whose errors may be alike.

        Args:
            i, j: (k,): of the first and of the second.
            moment: (n,): the first's frames.
        """
        if len(j) < TELLING:
            return None
        times, middle = self.times[j], float(np.round(self.times[j].mean()))
        since = np.column_stack([np.ones(len(j)), times - middle])[:, : 1 + (np.ptp(times) > LONG)]
        offset = MeasuredOffset(float(tried.at(middle)), tried.drift, middle)

        for _ in range(ROUNDS):
            interpolated = interpolate(
                self.track, self.times, self.second, self.late(offset, moment)
            )
            # Not of positions at the next instants: their noise is not independent of these'.
            both = (
                interpolated.positions[j],
                interpolated.positions[j] - STEP * interpolated.velocities[j],
            )
            seen = (_seen(self.rig, self.rig.secondary, pixels) for pixels in both)
            here, ahead = (self.errors(self.first[i], second) for second in seen)
            use = interpolated.inside(self.rig.secondary.image_size)[j] & np.isfinite(here + ahead)
            if use.sum() < TELLING:
                return None
            e, J = here[use], (since * ((ahead - here) / STEP)[:, None])[use]
            # 1e-9: exact points have a median of 0.
            far = np.square(e / (FAR * np.median(np.abs(e)) + 1e-9))
            scores = J * (e / (1.0 + far))[:, None]
            step = np.linalg.pinv(J.T @ (J / (1.0 + far)[:, None])) @ scores.sum(axis=0)
            offset = replace(
                offset, frames=offset.frames - step[0], drift=offset.drift - step[1:].sum()
            )
        inverse = np.linalg.pinv(J.T @ (J * ((1.0 - far) / (1.0 + far) ** 2)[:, None]))
        runs = np.array_split(scores[np.argsort(times[use], kind="stable")], BLOCKS)
        variances = [
            np.square(parts @ inverse).sum(axis=0) * len(parts) / (len(parts) - J.shape[1])
            for parts in (scores, np.array([run.sum(axis=0) for run in runs]))
        ]
        spread = np.sqrt(np.max(variances, axis=0))
        offset = replace(offset, sigma=float(spread[0]), drift_sigma=float(spread[1:].sum()))
        ends = np.array([times.min(), times.max()])
        off = np.hypot(offset.sigma, offset.drift_sigma * np.abs(ends - middle))
        apart = np.abs(offset.at(ends) - tried.at(ends))
        differs = apart > np.maximum(LEAST, CLAIMED * np.hypot(off, tried.sigma))
        is_near = abs(offset.frames - tried.at(middle)) < APART / 2
        return offset if differs.any() and is_near else None

    def moved(
        self, tried: MeasuredOffset, i: IntArray, j: IntArray, moment: IntArray, kept: BoolArray
    ) -> tuple[pd.DataFrame, list[str]]:
        """The points of the second at frames of the first, with the column `SHIFT`, and how.

        Args:
            i, j, moment: as of `by_points`.
            kept: (n,): which points.
        """
        measured = self.by_points(tried, i, j, moment)
        pixels, known = self.at(measured or tried, moment)
        late, known = self.late(measured or tried, moment)[kept], known[kept]
        moved = self.points.assign(frame=self.renumbered(moment))[kept]
        moved[list(self.columns)] = pixels[kept]
        moved[SHIFT] = np.where(known, late, 0.0)
        if not late.any():
            return moved, []
        shift = f"{np.median(late):.3f} frames"
        if not known.any():
            return moved, [
                f"the time offset of {shift} could not be applied, because no column names the "
                "tracks of points from frame to frame: the secondary points are used as recorded."
            ]
        sentence = f"the secondary points were shifted in time by {shift}"
        if measured is not None:
            change = measured.at(measured.reference) - tried.at(measured.reference)
            sentence += f", {change:+.3f} of it by these points themselves"
        if lost := int((~known).sum()):
            sentence += f"; {lost} of {len(known)} have no neighbours in their track and were not"
        return moved, [f"{sentence}."]
