"""Has a camera or a wall moved? The check of cameras that look through windows.

There is no essential matrix, and the pairs of a rig share their wall. So new images are fitted by
all cameras at once, with the old parameters as prior: with nothing changed, with one camera or one
window moved, and with all of them moved, which tells the noise. Nested hypotheses are compared by F
tests (docs/check.md).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from scipy.special import chdtri, chndtrinc, fdtrc

from stereocal.errors import StereocalError
from stereocal.evaluation.summary import Estimate
from stereocal.field.checking.check_words import OWN_IMAGES, size_range
from stereocal.field.checking.findings import AS_LIKELY, LARGEST_NOISE_RATIO, Verdict
from stereocal.field.checking.fits import ENOUGH, LEVEL, PriorFit, Smallest, information_of
from stereocal.field.checking.known_behind_windows import (
    WALL,
    Known,
    Move,
    after,
    all_that_shows,
    directions,
    moves_of,
)
from stereocal.field.checking.new_images import FEWEST_PAIRS, NewImages
from stereocal.field.checking.repair import FrameErrors, Residuals
from stereocal.fit.least_squares.observations import Observations
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.rig.recording import CameraPair, Recording
from stereocal.rig.rig import Rig
from stereocal.system.array_types import BoolArray, FloatArray
from stereocal.system.numbers import count, rounded
from stereocal.verdict.in_words import listed

WINDOWS_CHECK_FORMAT = "stereocal-check-windows/1"
ROUNDS = 3
"""Of a fit, each about where the last one ended: a normal is not linear in a turn."""
CONSISTENT = 0.01
"""An explanation is possible above this probability."""
MAXIMUM_OUTLYING = 1 / 3
NORMAL_95 = 1.96


@dataclass(frozen=True, eq=False)
class Explanation:
    """New images with one thing moved, or several, or nothing."""

    moves: Sequence[Move]
    u: FloatArray
    """(m,): the values of the moves."""
    fit: PriorFit

    @property
    def score(self) -> float:
        """Bayesian information criterion."""
        values = len(self.u)
        return self.fit.cost + values * float(np.log(max(self.fit.degrees + values, 2)))

    def size(self, values: slice, factor: float, unit: str) -> str:
        """The length of a vector among the values, times a factor, with its 95 % interval."""
        vector, covariance = self.u[values], self.fit.change_covariance[values, values]
        size = float(np.linalg.norm(vector))
        reach = NORMAL_95 * float(np.sqrt(vector @ covariance @ vector)) / max(size, 1e-300)
        return size_range(Estimate(size, max(size - reach, 0.0), size + reach), factor, unit)

    @property
    def by(self) -> str:
        """How the camera or the window has moved, and by how much."""
        how = self.moves[0].how
        turn = self.size(slice(2 if how == "shifted" else 3), float(np.degrees(1.0)), "°")
        if how == "shifted":
            where = "moved away" if self.u[2] > 0 else "come closer"
            away = f"{where} by {self.size(slice(2, 3), 1e3, ' mm')}"
            together = ", or all cameras moved together" * (self.moves[0].what == WALL)
            return f"{away} and tilted by {turn}{together}"
        shift = f" and moved by {self.size(slice(3, 6), 1e3, ' mm')}" if how == "moved" else ""
        return f"turned by {turn}{shift}"


@dataclass(frozen=True, eq=False)
class WindowCheck:
    """The answer of a check of cameras behind windows."""

    known: Known
    recording: Recording
    """Of the new images, with all cameras of the parameters."""
    own: bool
    smallest: Smallest
    noise_px: float
    """Of an image coordinate: never below that of the calibration."""
    nothing: Explanation
    single: Sequence[Explanation]
    """With one move each, the likeliest first."""
    everything: Explanation

    def _p(self, smaller: Explanation, larger: Explanation) -> float:
        """Probability of their cost difference by chance, if the smaller hypothesis is true."""
        values = len(larger.u) - len(smaller.u)
        gain = max(smaller.fit.cost - larger.fit.cost, 0.0)
        degrees = self.known.degrees + max(self.everything.fit.degrees, 1)
        return float(fdtrc(values, degrees, gain / values)) if values else 1.0

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
        """How many cameras and windows may have moved."""
        return len({it.moves[0].what for it in self.single})

    @cached_property
    def likely(self) -> list[Explanation]:
        """The single moves that explain the images about as well as the best; none if none does."""
        possible = [it for it in self.single if self._p(it, self.everything) > CONSISTENT]
        return [it for it in possible if it.score - possible[0].score < AS_LIKELY]

    @property
    def causes(self) -> list[str]:
        """What may have moved: one if it is known."""
        return list(dict.fromkeys(it.moves[0].what for it in self.likely))

    @cached_property
    def detectable_turn_rad(self) -> float:
        """Turn of any camera about any axis that is found with a probability of 80 %."""
        return self._found("turned", lambda information: np.linalg.eigvalsh(information)[0])

    @cached_property
    def detectable_shift_m(self) -> float:
        """Shift of any window along its normal, likewise."""
        return self._found("shifted", lambda information: information[2, 2])

    def _found(self, how: str, least: Callable[[FloatArray], float]) -> float:
        """The least move, by the information about its three values, that is found."""
        moves = (it.fit.change for it in self.single if it.moves[0].how == how)
        known = [least(information_of(self.everything.fit, change)) for change in moves]
        needed = chndtrinc(chdtri(3, LEVEL / self._things), 3, 1.0 - ENOUGH)
        return float(np.sqrt(needed / max(min(known, default=0.0), 1e-300)))

    @property
    def verdict(self) -> Verdict:
        if self.own or not self.usable:
            return "cannot tell"
        if self.p_value < LEVEL:
            return "moved"
        return "same" if self.detectable_turn_rad <= self.smallest.turn_rad else "cannot tell"

    @property
    def sentence(self) -> str:
        """The answer."""
        if self.own:
            return OWN_IMAGES
        if not self.usable:
            return (
                "Cannot tell with these: the points do not fit these cameras and windows "
                f"({rounded(self.noise_px)} px instead of {rounded(self.known.noise_px)} px). "
                "Check that the pairs are right, and of the same cameras."
            )
        if self.verdict == "moved":
            return self._what_moved
        found = (
            f"A turn of a camera by {rounded(np.degrees(self.detectable_turn_rad))}°, or a shift "
            f"of a window by {rounded(1000 * self.detectable_shift_m)} mm, would have been found "
            "with a probability of 80 %."
        )
        if self.verdict == "same":
            return f"Same: no camera and no window has moved. {found}"
        return f"Cannot tell with these: no movement is seen, but a small one may be. {found}"

    @property
    def _what_moved(self) -> str:
        again = "Calibrate again, with bars recorded since."
        if not self.causes:
            return f"Moved: no single camera or window explains the images. {again}"
        if len(self.causes) > 1:
            return f"Moved, and it cannot be told what: {' or '.join(self.causes)}. {again}"
        return f"Moved: {self.causes[0]} seems to have {self.likely[0].by}. {again}"

    @property
    def notes(self) -> list[str]:
        """What was left out."""
        seen, left_out = self.everything.fit.seen, int(self.everything.fit.outlying.sum())
        of = count(len(seen.frames), "frame" if seen.has_lengths else "matched point")
        return [f"{left_out} of {of} contradict the others and were left out."] * (left_out > 0)

    def to_json(self) -> dict[str, Any]:
        """The content of `check.json`."""
        return {
            "format": WINDOWS_CHECK_FORMAT,
            "verdict": self.verdict,
            "reason": self.sentence,
            "causes": self.causes if self.verdict == "moved" else [],
            "p_value": self.p_value,
            "detectable_turn_rad": self.detectable_turn_rad,
            "detectable_shift_m": self.detectable_shift_m,
            "noise_px": self.noise_px,
            "notes": self.notes,
        }

    @property
    def residuals(self) -> dict[CameraPair, Residuals]:
        """The errors of all frames with the old parameters, of each pair with common frames."""
        return {
            pair: self._residuals_of(*pair)
            for pair in combinations(self.known.placed, 2)
            if len(self.recording.common_frames(*pair))
        }

    def _residuals_of(self, first: str, second: str) -> Residuals:
        (one, from_one), (other, from_other) = (self.known.placed[it] for it in (first, second))
        dataset = self.recording.pair(first, second)
        frames, bars = dataset.correspondences.frames, len(dataset.correspondences.bars)
        rig = Rig(one, other, from_other @ from_one.inverse())
        px, lengths = NewImages(dataset, frames, bars).errors_with(rig)
        errors = FrameErrors(px, lengths if bars else None)
        return Residuals(frames, errors, None, self.verdict == "moved")


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
    names = [name for name in known.placed if name in recording.cameras]
    recording = _with_parameters(known, recording, names)
    known, seen = known.seen_in(recording), Observations.of(recording)
    if len(seen.frames) < 2 or np.isfinite(seen.pixels[..., 0]).sum() < 2 * FEWEST_PAIRS:
        raise StereocalError(
            f"{recording.name}: these are too few points to check anything; at least "
            f"{FEWEST_PAIRS} that two cameras see are needed, better 50."
        )
    moves = moves_of(known.placed, names)
    begun = _explained(known, seen, all_that_shows(moves))
    noise_px = max(known.noise_px, begun.fit.sigma_px) if begun else np.nan
    counted_px = noise_px * known.design_effect**0.5

    def fitted(moves: Sequence[Move]) -> Explanation | None:
        return begun and _explained(known, seen, moves, counted_px, begun.fit.outlying)

    nothing, everything = fitted([]), fitted(all_that_shows(moves))
    if nothing is None or everything is None:
        raise StereocalError(
            f"{recording.name}: no pose of these cameras fits the points. Are they of the same "
            "cameras, in their order, and are the pairs right?"
        )
    single = sorted(filter(None, map(fitted, ([it] for it in moves))), key=lambda it: it.score)
    least = smallest or Smallest()
    return WindowCheck(known, recording, own, least, noise_px, nothing, single, everything)


def _with_parameters(known: Known, recording: Recording, names: Sequence[str]) -> Recording:
    """The recording of some cameras, with all those of the parameters, their lenses and windows."""
    if len(names) < 2:
        raise StereocalError(
            f"{recording.name}: it has the cameras {listed([*recording.cameras])}, and the "
            f"parameters are of {listed([*known.placed])}: they share fewer than two."
        )
    every = {name: it.camera for name, it in known.placed.items()}
    for name in names:
        size, wanted = recording.cameras[name].image_size, every[name].image_size
        if size != wanted:
            raise StereocalError(
                f"{recording.name}: the images of {name} are {size[0]}x{size[1]} px, and the "
                f"parameters are of {wanted[0]}x{wanted[1]} px: they are not of the same cameras, "
                "or the images were scaled."
            )
    some = recording.of_cameras(names)
    numbers = np.array([[*every].index(name) for name in names])
    return replace(some, cameras=every, camera=numbers[some.camera], windows=())


def _explained(
    known: Known,
    seen: Observations,
    moves: Sequence[Move],
    sigma_px: float | None = None,
    outlying: BoolArray | None = None,
) -> Explanation | None:
    """The fit with these moves; None if there is none.

    Args:
        sigma_px: the noise; None to estimate it.
        outlying: (f,): frames to leave out; None to find them.
    """
    u = np.zeros(sum(len(move.sigma) for move in moves))
    settings = RefineSettings(sigma_px=sigma_px, scatter_m=known.scatter_m)
    try:
        for _ in range(ROUNDS):
            change = directions(moves, known, u)
            fit = PriorFit(seen, after(moves, known, u), change, settings)
            fit.set_limits(len(u))
            if outlying is None:
                fit.run()
            else:
                fit.fit_all_but(outlying)
            u = u + fit.d
    except StereocalError:  # a window behind its camera
        return None
    return Explanation(moves, u, fit) if np.isfinite(fit.cost) else None
