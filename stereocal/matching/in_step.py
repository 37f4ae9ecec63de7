"""Bring the points of the secondary camera into step with those of the primary.

Its frames may have other numbers and another rate, and its shutter opens a part of a frame later. A
parameter file has how it was in the recording that was calibrated; with the known pose, the points
themselves tell whether it is so with them. They can be brought to the instants of the primary's
frames where they have tracks: points of the same name, or the only point of each frame.
"""

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
import pandas as pd

from stereocal.calibration.corrections import FITTING
from stereocal.errors import StereocalError
from stereocal.matching.own_count import RATE, SHIFT, Seen
from stereocal.matching.point_table import POINT, PointTable
from stereocal.network.rig_file import Parameters, RigFile
from stereocal.network.started_by_hand import STANDS_OUT
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray
from stereocal.rig.correspondences import PIXELS
from stereocal.rig.geometry import sampson
from stereocal.rig.parameters import RigParameters
from stereocal.rig.tracks import MeasuredOffset, interpolate
from stereocal.system.sampling import evenly_spread

FRAMES, FEWEST, APART = 40, 8, 2
"""Frames that an offset is judged by, at least so many; and frames between offsets that compete."""
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
NEIGHBOURS = np.arange(-3, 4)
"""Frames about one that its points are interpolated from."""


def tables_in_step(
    rig: Parameters, tables: Mapping[str, PointTable]
) -> tuple[dict[str, PointTable], list[str]]:
    """As `points_in_step`, of tables that are read only if their cameras are not in step."""
    first, *others = tables
    late = [n for n in others if _is_late(rig.pair(first, n), tables[n].further)]
    if not late:
        return dict(tables), []
    read = {name: pd.concat(list(tables[name].blocks())) for name in (first, *late)}
    points, notes = points_in_step(rig, read)
    found = {n: PointTable(points[n], tables[n].numbers, tables[n].label) for n in late}
    told = [f"{tables[name].label}: {note}" for name in late for note in notes[name]]
    return {**tables, **found}, told


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
    found, notes = dict(tables), dict[str, list[str]]()
    called = {name: name if isinstance(rig, RigFile) else f"the {name}" for name in tables}
    for name in others:
        pair, points = rig.pair(first, name), tables[name]
        pair = replace(pair, start_frame=0) if numbered_alike else pair
        if not _is_late(pair, points):
            continue
        both = _Both(pair, Seen.of(tables[first], POINT), Seen.of(points, POINT))
        offset, notes[name] = both.counted(called[first], called[name])
        frame, moment, kept = both.second.numbered(offset)
        pairs = both.nearest(*both.placed(offset), 0, FITTED)[:2]
        points = points.assign(frame=frame)
        found[name], told = both.moved(points, POINT, offset, pairs, moment, kept)
        notes[name] += told
    return found, notes


def pairs_in_step(table: PointTable, rig: RigParameters) -> tuple[PointTable, str]:
    """Pairs with their secondary points shifted by a time offset, and what was done as a sentence;
    unchanged, and empty, if there is none or they are shifted already."""
    if not _is_late(rig, table.further):
        return table, ""
    pairs = pd.concat(list(table.blocks()))
    both = _Both(rig, Seen.of(pairs, PIXELS[:2]), Seen.of(pairs, PIXELS[2:]))
    times = both.second.times

    def misfit(tried: MeasuredOffset) -> float:
        points = both.second.at(tried, times, rig.secondary.image_size)[0]
        return float(np.median(np.abs(rig.epipolar_errors(both.first.pixels, points))))

    offset = how_counted(rig, rig.start_frame, misfit)[0]
    some = evenly_spread(len(pairs), FITTED)
    all_of_them = np.ones(len(pairs), np.bool_)
    moved, told = both.moved(pairs, PIXELS[2:], offset, (some, some), times, all_of_them)
    if not told:
        return table, ""
    return PointTable(moved, table.numbers, table.label), " ".join([f"{table.label}:", *told])


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
    px = {each: misfit(each) for each in (known, apart)}
    best, other = sorted(px, key=px.__getitem__)
    return (best, px[best]) if STANDS_OUT * px[best] < px[other] else (known, np.inf)


def _is_late(rig: RigParameters, columns: Container[str]) -> bool:
    """Whether points with these columns are to be brought into step."""
    return (rig.time_offset is not None or rig.start_frame != 0) and SHIFT not in columns


Rows = Mapping[int, IntArray]
"""Which points are of a frame."""


@dataclass(frozen=True, eq=False)
class _Both:
    """What two cameras saw, whose pose is known."""

    rig: RigParameters
    first: Seen
    second: Seen

    @cached_property
    def _of_first(self) -> tuple[Rows, FloatArray]:
        """Its points by frame, and their rays."""
        every = np.arange(len(self.first.frame))
        return _by_frame(self.first.frame, every), self.rig.primary.undistort(self.first.pixels)

    def placed(self, offset: MeasuredOffset) -> tuple[Rows, FloatArray]:
        """The points of the second by frames of the first, and their rays at these."""
        frame, moment, kept = self.second.numbered(offset)
        pixels, _ = self.second.at(offset, moment, self.rig.secondary.image_size)
        return _by_frame(frame, np.flatnonzero(kept)), self.rig.secondary.undistort(pixels)

    def nearest(
        self, rows: Rows, rays: FloatArray, later: int, most: int
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """For the points of the first in some frames the second's that is nearest to the epipolar
        line: indices of both, (k,), and the distance in px; none of too few frames.

        Args:
            rows, rays: as `placed`, `later` frames before their time.
        """
        of_first, own_rays = self._of_first
        common = np.array([k for k in of_first if k - later in rows], dtype=np.int64)
        if len(common) < FEWEST:
            return np.empty(0, np.int64), np.empty(0, np.int64), np.array([np.inf])
        some = np.sort(common)[evenly_spread(len(common), most)].tolist()
        each = [(of_first[frame], rows[frame - later]) for frame in some]
        i = np.concatenate([np.repeat(one, len(two)) for one, two in each])
        j = np.concatenate([np.tile(two, len(one)) for one, two in each])
        widths = np.concatenate([np.full(len(one), len(two)) for one, two in each])
        px = np.abs(self._errors(own_rays[i], rays[j]))
        order = np.lexsort((px, np.repeat(np.arange(len(widths)), widths)))
        best = order[np.cumsum(widths) - widths]
        return i[best], j[best], px[best]

    def _errors(self, first: FloatArray, second: FloatArray) -> FloatArray:
        """Signed distances of rays from their epipolar lines, in px."""
        focal = np.sqrt(self.rig.primary.K[0, 0] * self.rig.secondary.K[0, 0])
        both = np.column_stack([first, second])
        return np.asarray(focal * sampson(self.rig.pose.essential, both))

    def _misfit(self, rows: Rows, rays: FloatArray, later: int = 0) -> float:
        return float(np.median(self.nearest(rows, rays, later, FRAMES)[2]))

    def counted(self, first: str, second: str) -> tuple[MeasuredOffset, list[str]]:
        """How the second's points were counted, and a sentence with the cameras' names."""
        whole = self.rig.start_frame
        best, px = how_counted(self.rig, whole, lambda tried: self._misfit(*self.placed(tried)))
        if not whole:
            return best, []
        if px > self._limit:
            if min(len(np.unique(each.frame)) for each in (self.first, self.second)) < FEWEST:
                return best, [
                    f"the calibrated recording was counted {abs(whole)} frames apart; these frames "
                    "are too few to tell whether they are, and were used as numbered."
                ]
            found = next(filter(None, map(self._scanned, RATES)), None)
            if found is None:
                raise StereocalError(
                    f"The calibrated recording was counted {abs(whole)} frames apart. By how much "
                    "these points are, they do not tell: at no offset do they fit the parameters "
                    "far better than at all others. Number the frames of both cameras alike, or "
                    "give more frames with few points that move."
                )
            best = found
        start, rate = best.split()[0], 1.0 + best.drift
        if abs(best.drift) >= RATE:
            where = f"frame k of {second} is frame {rate:.6g} k {start:+d} of {first}"
        elif start:
            where = f"frame 0 of {second} is frame {start} of {first}"
        else:
            return best, ["by these points, both cameras counted their frames alike."]
        return best, [f"by these points, {where}: they are paired like this, with its numbers."]

    @property
    def _limit(self) -> float:
        """The largest misfit of points that fit, in px."""
        sizes = (self.rig.primary.image_size, self.rig.secondary.image_size)
        return FITTING * min(float(np.hypot(*size)) for size in sizes)

    def _scanned(self, rates: Sequence[float]) -> MeasuredOffset | None:
        """The offset at which the points fit far better than at all others; None if none does."""
        tries = list[tuple[float, float, float]]()
        for rate, phase in product(rates, (0.0, 0.5)):
            if phase and rate >= 1.0 and self.second.track is None:
                continue
            rows, rays = self.placed(MeasuredOffset(phase, rate - 1.0))
            low, high = min(self._of_first[0]) - max(rows), max(self._of_first[0]) - min(rows)
            if high - low > MOST_OFFSETS:
                return None
            whole = range(low, high + 1)
            tries += [(self._misfit(rows, rays, each), each + phase, rate - 1.0) for each in whole]
        errors, frames, drifts = np.array(tries).T
        best, at = int(errors.argmin()), frames + drifts * np.median(self.second.times)
        other = errors[np.abs(at - at[best]) > APART].min(initial=np.inf)
        if errors[best] <= self._limit and STANDS_OUT * errors[best] < other < np.inf:
            return MeasuredOffset(float(frames[best]), float(drifts[best]))
        return None

    def own(
        self, tried: MeasuredOffset, i: IntArray, j: IntArray, moment: IntArray
    ) -> MeasuredOffset | None:
        """The offset by points in pairs, if they tell it and it is not the one near it that was
        tried.

        Args:
            i, j: (k,): of the first and of the second.
            moment: the frame of the primary of all points of the second.
        """
        around = np.unique(self.second.times[j])[:, None] + NEIGHBOURS
        used = np.isin(self.second.times, around)
        some, moment, j = self.second.where(used), moment[used], np.cumsum(used)[j] - 1
        times, rays, size = some.times[j], self._of_first[1][i], self.rig.secondary.image_size
        if some.track is None or len(j) < TELLING:
            return None
        middle = float(np.round(times.mean()))
        since = np.column_stack([np.ones(len(j)), times - middle])[:, : 1 + (np.ptp(times) > LONG)]
        found = MeasuredOffset(float(tried.at(middle)), tried.drift, middle)

        for _ in range(ROUNDS):
            at = interpolate(some.track, some.times, some.pixels, some.late(found, moment))
            # Not of positions at the next instants: their noise is not independent of these'.
            pixels = at.positions[j], at.positions[j] - STEP * at.velocities[j]
            here, ahead = (self._errors(rays, self.rig.secondary.undistort(p)) for p in pixels)
            use = at.inside(size)[j] & np.isfinite(here + ahead)
            if use.sum() < TELLING:
                return None
            e, J = here[use], (since * ((ahead - here) / STEP)[:, None])[use]
            far = np.square(e / (FAR * np.median(np.abs(e)) + 1e-9))
            scores = J * (e / (1.0 + far))[:, None]
            step = np.linalg.pinv(J.T @ (J / (1.0 + far)[:, None])) @ scores.sum(axis=0)
            found = replace(
                found, frames=found.frames - step[0], drift=found.drift - step[1:].sum()
            )
        inverse = np.linalg.pinv(J.T @ (J * ((1.0 - far) / (1.0 + far) ** 2)[:, None]))
        order = np.argsort(times[use], kind="stable")
        blocks = np.array([scores[own].sum(axis=0) for own in np.array_split(order, BLOCKS)])
        variances = [
            np.square(own @ inverse).sum(axis=0) * len(own) / (len(own) - J.shape[1])
            for own in (scores, blocks)
        ]
        spread = np.sqrt(np.max(variances, axis=0))
        found = replace(found, sigma=float(spread[0]), drift_sigma=float(spread[1:].sum()))
        ends = np.array([times.min(), times.max()])
        sigma = np.hypot(found.sigma, found.drift_sigma * np.abs(ends - middle))
        apart = np.abs(found.at(ends) - tried.at(ends))
        told = apart > np.maximum(LEAST, CLAIMED * np.hypot(sigma, tried.sigma))
        return found if told.any() and abs(found.frames - tried.at(middle)) < APART / 2 else None

    def moved(
        self,
        points: pd.DataFrame,
        columns: tuple[str, ...],
        tried: MeasuredOffset,
        pairs: tuple[IntArray, IntArray],
        moment: IntArray,
        kept: BoolArray,
    ) -> tuple[pd.DataFrame, list[str]]:
        """The points of the second at frames of the first, with the column `SHIFT`, and how.

        Args:
            pairs, moment: as of `own`.
            kept: which points.
        """
        own = self.own(tried, *pairs, moment)
        offset = own or tried
        pixels, known = self.second.at(offset, moment, self.rig.secondary.image_size)
        late = self.second.late(offset, moment)
        moved = points.assign(**dict(zip(columns, pixels.T, strict=True)))
        moved[SHIFT] = np.where(known, late, 0.0)
        moved, late, known = moved[kept], late[kept], known[kept]
        if not late.any():
            return moved, []
        shift = f"{np.median(late):.3f} frames"
        if self.second.track is None:
            return moved, [
                f"the time offset of {shift} could not be applied, because no column names the "
                "tracks of points from frame to frame: the secondary points are used as recorded."
            ]
        told = f"the secondary points were shifted in time by {shift}"
        if own is not None:
            change = own.at(own.reference) - tried.at(own.reference)
            told += f", {change:+.3f} of it by these points themselves"
        if lost := int((~known).sum()):
            told += f"; {lost} of {len(known)} have no neighbours in their track and were not"
        return moved, [f"{told}."]


def _by_frame(frame: IntArray, rows: IntArray) -> Rows:
    found = pd.Series(rows).groupby(frame[rows])
    return {int(str(k)): own.to_numpy() for k, own in found}
