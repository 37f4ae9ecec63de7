"""Has a camera or a wall moved? The check of cameras that look through windows.

There is no essential matrix, and the pairs of a rig share their wall. So new images are fitted by
all cameras at once, with the old parameters as prior: with nothing changed, with one change each (a
camera turned, moved or refocused, or a window moved), and with all of them, which tells the noise.
A wall that several cameras look through stays when one of them moves; a window of a camera by
itself goes along with it. The costs of nested hypotheses are compared by F tests (docs/check.md).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from scipy.special import chdtri, chndtr, chndtrinc, fdtrc

from stereocal.errors import StereocalError
from stereocal.field.checking.findings import AS_LIKELY, LARGEST_NOISE_RATIO, Verdict
from stereocal.field.checking.fits import ENOUGH, LEVEL, Change, PriorFit, Smallest, information_of
from stereocal.field.checking.known_behind_windows import (
    Known,
    Move,
    after,
    all_moves,
    directions,
    single_moves,
)
from stereocal.field.checking.prior import root_of
from stereocal.field.checking.repair import FrameErrors, Residuals
from stereocal.fit.least_squares.observations import Observations
from stereocal.fit.least_squares.small_steps import window_places
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.least_squares.views import Cameras
from stereocal.fit.least_squares.windows import DISTANCE
from stereocal.rig.recording import CameraPair, Recording
from stereocal.rig.rig import Rig
from stereocal.system.array_types import BoolArray, FloatArray
from stereocal.system.numbers import count, decimals_of, rounded
from stereocal.verdict.in_words import listed, named_frames

WINDOWS_CHECK_FORMAT = "stereocal-check-windows/1"
FEWEST_POINTS = 8
LARGEST = 2000
"""Frames that are used."""
ROUNDS = 3
"""Of a fit, each about where the last one ended: a normal is not linear in a turn."""
CONSISTENT = 0.01
"""An explanation is possible above this probability."""
MAXIMUM_OUTLYING = 1 / 3
NORMAL_95 = 1.96


@dataclass(frozen=True, eq=False)
class _Start:
    """Where a fit begins."""

    at: Cameras
    root: FloatArray


@dataclass(frozen=True, eq=False)
class Explanation:
    """New images with one thing changed, or several."""

    moves: Sequence[Move]
    u: FloatArray
    """(m,): the values of the moves."""
    fit: PriorFit

    @property
    def score(self) -> float:
        """Bayesian information criterion."""
        values = len(self.fit.change)
        return self.fit.cost + values * float(np.log(max(self.fit.degrees + values, 2)))


@dataclass(frozen=True, eq=False)
class WindowCheck:
    """The answer of a check of cameras behind windows."""

    known: Known
    recording: Recording
    """Of the new images, with the lenses and windows of the parameters."""
    own: bool
    smallest: Smallest
    noise_px: float
    degrees: float
    nothing: Explanation
    single: Sequence[Explanation]
    """With one change each, the likeliest first."""
    everything: Explanation

    def _p(self, smaller: Explanation, larger: Explanation) -> float:
        """Probability of their cost difference by chance, if the smaller hypothesis is true."""
        degrees = len(larger.fit.change) - len(smaller.fit.change)
        gain = max(smaller.fit.cost - larger.fit.cost, 0.0)
        return float(fdtrc(degrees, self.degrees, gain / degrees)) if degrees else 1.0

    @property
    def usable(self) -> bool:
        """Whether the images fit these cameras, wherever they are."""
        fits = self.noise_px <= LARGEST_NOISE_RATIO * self.known.noise_px
        return fits and self.everything.fit.outlying.mean() <= MAXIMUM_OUTLYING

    @cached_property
    def p_value(self) -> float:
        """Probability that unmoved cameras look as changed as these."""
        smallest = min(self._p(self.nothing, it) for it in (*self.single, self.everything))
        return min(1.0, self._things * smallest)

    @property
    def _things(self) -> int:
        """How many cameras and windows there are, of each of which a movement is looked for."""
        return len({it.moves[0].what for it in self.single})

    @cached_property
    def likely(self) -> list[Explanation]:
        """The single changes that explain the images about as well as the best; none if none does
        so."""
        possible = [it for it in self.single if self._p(it, self.everything) > CONSISTENT]
        return [it for it in possible if it.score - possible[0].score < AS_LIKELY]

    @property
    def causes(self) -> list[str]:
        """What has changed: one if it is known."""
        return list(dict.fromkeys(it.moves[0].what for it in self.likely))

    @cached_property
    def chance(self) -> float:
        """Probability that the smallest turn of interest of any camera would be found."""
        return min(
            _power(it, self.smallest.turn_rad * _worst(it), self._level) for it in self._turns
        )

    @property
    def _level(self) -> float:
        """False alarms of each test."""
        return LEVEL / self._things

    @cached_property
    def _turns(self) -> list[FloatArray]:
        """Information (3, 3) about a turn of each camera."""
        return [self._information(it.moves) for it in self.single if it.moves[0].how == "turned"]

    def _information(self, moves: Sequence[Move]) -> FloatArray:
        sizes = np.zeros(sum(len(move.sigma) for move in moves))
        return information_of(self.everything.fit, directions(moves, self.known.placed, sizes))

    @cached_property
    def detectable_turn_rad(self) -> float:
        """Turn of any camera about any axis that is found with a probability of 80 %."""
        return max(_found(it, _worst(it), self._level) for it in self._turns)

    @cached_property
    def detectable_shift_m(self) -> float:
        """Shift of any window along its normal, likewise."""
        walls = [it.moves for it in self.single if it.moves[0].how == "shifted"]
        along = np.array([0.0, 0.0, 1.0])
        return max(_found(self._information(it), along, self._level) for it in walls)

    @property
    def verdict(self) -> Verdict:
        if self.usable and not self.own and self.p_value < LEVEL:
            return "moved"
        would_be_seen = self.usable and not self.own and self.chance >= ENOUGH
        return "same" if would_be_seen else "cannot tell"

    @property
    def described(self) -> str:
        frames = count(len(self.nothing.fit.frames), "frame")
        return frames if self.nothing.fit.seen.has_lengths else f"matched points of {frames}"

    @property
    def sentence(self) -> str:
        """The answer."""
        if self.own:
            return (
                "Cannot tell with these: the parameters come from these images, which do not show "
                "what has changed since. Check with new ones."
            )
        if not self.usable:
            return (
                f"Cannot tell with these: the points do not fit these cameras and windows "
                f"({rounded(self.noise_px)} px instead of {rounded(self.known.noise_px)} px). "
                "Check that the pairs are right, and of the same cameras."
            )
        if self.verdict == "moved":
            return self._what_changed
        turn = f"{rounded(np.degrees(self.detectable_turn_rad))}°"
        shift = f"{rounded(1000 * self.detectable_shift_m)} mm"
        if self.verdict == "same":
            return (
                f"Same: no camera and no window has moved. A turn of a camera by {turn}, or a "
                f"shift of a window by {shift}, would have been found with a probability of 80 %."
            )
        return (
            f"Cannot tell with {self.described} whether a camera turned by less than {turn} or a "
            f"window moved by less than {shift}: a larger movement would be found (with a "
            "probability of 80 %), and none is seen. More of them, near and far and all over the "
            "images, show smaller movements."
        )

    @property
    def _what_changed(self) -> str:
        causes = self.causes
        if not causes:
            return (
                "Moved: the parameters no longer fit, and no single camera or window explains it. "
                "Calibrate again."
            )
        if len(causes) > 1:
            return (
                f"Moved, and it cannot be told what: {' or '.join(causes)}. Any of them by itself "
                "explains the images."
            )
        return f"Moved: {causes[0]} seems to have {self._by(self.likely[0])}."

    def _by(self, best: Explanation) -> str:
        """How a camera or a window has changed, and by how much."""
        move, u, C = best.moves[0], best.u, best.fit.change_covariance
        if move.how == "refocused":
            return f"been refocused: its focal length changed by {_size(100 * u, 1e4 * C, ' %')}"
        if move.how == "shifted":
            behind = self._behind(move)
            places = [window_places(k, len(self.known.placed)).start + DISTANCE for k in behind]
            along = best.fit.change.directions[places].mean(axis=0)
            shift, variance = np.atleast_1d(along @ u), np.atleast_2d(along @ C @ along)
            whose = "the cameras, or all cameras together" if len(behind) > 1 else "its camera"
            where = "away from" if shift[0] > 0 else "towards"
            return f"moved by {_size(1000 * shift, 1e6 * variance, ' mm')} {where} {whose}"
        turn = f"turned by {_size(np.degrees(u[:3]), np.degrees(np.degrees(C[:3, :3])), '°')}"
        if move.how == "turned":
            return turn
        return f"{turn} and moved by {_size(1000 * u[3:], 1e6 * C[3:, 3:], ' mm')}"

    def _behind(self, move: Move) -> list[int]:
        """The numbers of the cameras of a window that has moved."""
        before, names = self.known.placed, [*self.known.placed]
        now = move.after(before, np.array([0.0, 0.0, 1e-3]))
        return [k for k, name in enumerate(names) if now[name].camera is not before[name].camera]

    @property
    def notes(self) -> list[str]:
        """Frames left out, other noise, and what to do."""
        fit, notes = self.everything.fit, list[str]()
        if left_out := fit.frames[fit.outlying].tolist():
            notes.append(
                f"Points of {named_frames(left_out)} contradict the others and were left out."
            )
        if self.verdict == "moved":
            notes.append("Calibrate again, with bars recorded since.")
        return notes

    def to_json(self) -> dict[str, Any]:
        """The content of `check.json`."""
        fit = self.everything.fit
        return {
            "format": WINDOWS_CHECK_FORMAT,
            "verdict": self.verdict,
            "reason": self.sentence,
            "causes": self.causes if self.verdict == "moved" else [],
            "explanations": [
                {
                    "what": it.moves[0].what,
                    "how": it.moves[0].how,
                    "cost": it.fit.cost,
                    "p_value": self._p(it, self.everything),
                    "by": it.u.tolist(),
                }
                for it in self.single
            ],
            "p_value": self.p_value,
            "power": {
                "turn_rad": self.smallest.turn_rad,
                "turn": self.chance,
                "detectable_turn_rad": self.detectable_turn_rad,
                "detectable_shift_m": self.detectable_shift_m,
            },
            "noise_px": self.noise_px,
            "frames_left_out": fit.frames[fit.outlying].tolist(),
            "repaired": None,
            "notes": self.notes,
        }

    @property
    def residuals(self) -> dict[CameraPair, Residuals]:
        """The errors of all frames with the old parameters, of each pair with common frames."""
        return {
            (first, second): self._residuals_of(first, second)
            for first, second in combinations(self.known.placed, 2)
            if len(self.recording.common_frames(first, second))
        }

    def _residuals_of(self, first: str, second: str) -> Residuals:
        (one, from_one), (other, from_other) = (self.known.placed[it] for it in (first, second))
        rig, dataset = (
            Rig(one, other, from_other @ from_one.inverse()),
            self.recording.pair(first, second),
        )
        rows = dataset.correspondences
        frames, row = np.unique(rows.frame, return_inverse=True)
        px = rig.reprojection_errors(rows.primary, rows.secondary).mean(axis=1)
        lengths = np.full(len(frames), np.nan)
        if len(rows.bars):
            ends = rig.reconstruct(rows.primary, rows.secondary)[rows.bars]
            apart = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
            lengths[row[rows.bars[:, 0]]] = np.abs(apart / dataset.bar_distances_m - 1.0)
        mean_px = np.bincount(row, px) / np.bincount(row)
        errors = FrameErrors(mean_px, lengths if len(rows.bars) else None)
        return Residuals(frames, errors, None, self.verdict == "moved")


def _size(vector: FloatArray, covariance: FloatArray, unit: str) -> str:
    """The length of a vector with its 95 % interval."""
    size = float(np.linalg.norm(vector))
    along = vector / max(size, 1e-300)
    reach = NORMAL_95 * float(np.sqrt(along @ covariance @ along))
    places = decimals_of(reach)
    value, low, high = (
        f"{it:.{places}f}{unit}" for it in (size, max(size - reach, 0.0), size + reach)
    )
    return f"{value} ({low} to {high})"


def _worst(information: FloatArray) -> FloatArray:
    """(m,): the unit vector about which least is known."""
    return np.asarray(np.linalg.eigh(information)[1][:, 0])


def _power(information: FloatArray, change: FloatArray, level: float) -> float:
    """Probability that a change (m,) is found."""
    m, noncentrality = len(change), float(change @ information @ change)
    return float(1.0 - chndtr(chdtri(m, level), m, noncentrality))


def _found(information: FloatArray, along: FloatArray, level: float) -> float:
    """How far along a unit vector is found with a probability of 80 %."""
    m = len(information)
    needed = float(chndtrinc(chdtri(m, level), m, 1.0 - ENOUGH))
    return float(np.sqrt(needed / max(float(along @ information @ along), 1e-300)))


def check_behind_windows(
    known: Known, recording: Recording, smallest: Smallest | None = None, own: bool = False
) -> WindowCheck:
    """Check whether a camera or a window has moved.

    Args:
        recording: new images of two of the cameras or more, by the same names.
        own: whether they are the images that the parameters come from.

    Raises:
        StereocalError: they are of other cameras, or nothing fits the points.
    """
    recording = _with_parameters(known, recording)
    known = known.of_cameras([*recording.cameras]).seen_in(recording)
    seen = Observations.of(recording)
    if len(seen.frames) < 2 or np.isfinite(seen.pixels[..., 0]).sum() < 2 * FEWEST_POINTS:
        raise StereocalError(
            f"{recording.name}: these are too few points to check anything; at least "
            f"{FEWEST_POINTS} that two cameras see are needed, better 50."
        )
    widened = float(np.sqrt(known.design_effect))
    everything = _explained(known, seen, all_moves(known.placed), None, None)
    if everything is None:
        raise StereocalError(
            f"{recording.name}: no pose of these cameras fits the points. Are they of the same "
            "cameras, in their order, and are the pairs right?"
        )
    outlying, noise_px = everything.fit.outlying, max(known.noise_px, everything.fit.sigma_px)
    counted_px = widened * noise_px

    def fitted(moves: Sequence[Move]) -> Explanation | None:
        return _explained(known, seen, moves, counted_px, outlying)

    single = filter(None, (fitted([move]) for move in single_moves(known.placed)))
    nothing, everything = fitted([]), fitted(all_moves(known.placed)) or everything
    assert nothing is not None
    by_score = sorted(single, key=lambda it: it.score)
    degrees = known.degrees + max(everything.fit.degrees, 1)
    return WindowCheck(
        known,
        recording,
        own,
        smallest or Smallest(),
        noise_px,
        degrees,
        nothing,
        by_score,
        everything,
    )


def _with_parameters(known: Known, recording: Recording) -> Recording:
    """The recording of the cameras that are known, with their lenses and windows."""
    names = [name for name in known.placed if name in recording.cameras]
    if len(names) < 2:
        raise StereocalError(
            f"{recording.name}: it has the cameras {listed([*recording.cameras])}, and the "
            f"parameters are of {listed([*known.placed])}: they share fewer than two."
        )
    cameras = {name: known.placed[name].camera for name in names}
    for name, camera in cameras.items():
        size, wanted = recording.cameras[name].image_size, camera.image_size
        if size != wanted:
            raise StereocalError(
                f"{recording.name}: the images of {name} are {size[0]}x{size[1]} px, and the "
                f"parameters are of {wanted[0]}x{wanted[1]} px: they are not of the same cameras, "
                "or the images were scaled."
            )
    shared = replace(recording.of_cameras(names), cameras=cameras, windows=())
    frames = np.unique(shared.frame)
    if len(frames) <= LARGEST:
        return shared
    kept = frames[np.linspace(0, len(frames) - 1, LARGEST).astype(np.int64)]
    return shared.where(np.isin(shared.frame, kept))


def _explained(
    known: Known,
    seen: Observations,
    moves: Sequence[Move],
    sigma_px: float | None,
    outlying: BoolArray | None,
) -> Explanation | None:
    """The fit with these moves; None if there is none.

    Args:
        sigma_px: the noise; None to estimate it.
        outlying: (f,): frames to leave out; None to find them.
    """
    u = np.zeros(sum(len(move.sigma) for move in moves))
    settings = RefineSettings(sigma_px=sigma_px, scatter_m=known.scatter_m)
    root, fit = root_of(known.covariance), None
    try:
        for _ in range(ROUNDS if moves else 1):
            there = replace(known, placed=after(moves, known.placed, u))
            change = directions(moves, known.placed, u) if moves else _none(len(root))
            fit = PriorFit(seen, _Start(there.at, root), change, settings)
            fit.set_limits(len(change))
            if outlying is None:
                fit.run()
            else:
                fit.fit_all_but(outlying)
            if not np.isfinite(fit.cost):
                return None
            u = u + fit.d
    except StereocalError:  # a window behind its camera
        return None
    return Explanation(moves, u, fit) if fit is not None else None


def _none(unknowns: int) -> Change:
    return Change(np.zeros((unknowns, 0)), np.zeros(0))
