"""Cameras that were started by hand are brought into step by the offsets of all pairs."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from decimal import Decimal
from itertools import product
from types import MappingProxyType

import numpy as np
import pandas as pd

from stereocal.calibration.corrections import with_targets
from stereocal.errors import StereocalError
from stereocal.fit.readings.lost_frames import lost_in_step
from stereocal.fit.start.pairs import groups_of, reached
from stereocal.fit.timing.offset_of_pair import OffsetOfPair, exact, in_frames, offset_of_pair
from stereocal.rig.frame_rates import at_slowest
from stereocal.rig.recording import CameraPair, Recording
from stereocal.rig.tracks import MeasuredOffset
from stereocal.system.answers import TableAnswer
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import rounded

LEAST_SIGMA, CLOSED = 0.005, 0.25
"""Frames: the least error that a pair's offset may weigh, and by how much pairs may disagree."""

USUAL_RATES = (30, 60), (59.94, 60)
"""Frames a second of two cameras that are tried where none are stated."""


@dataclass(frozen=True, eq=False, repr=False)
class BroughtIntoStep(TableAnswer):
    """A recording whose cameras count their frames alike, and how that was found, which is in its
    notes."""

    recording: Recording
    offsets: Mapping[str, tuple[float, float]]
    """Of each camera, by how many frames of the first it was started later, with the standard
    error."""
    pairs: Mapping[CameraPair, OffsetOfPair]
    orders: Mapping[str, IntArray]
    """Of each camera, the order in which its targets are those of the first; empty if as named."""
    late: Mapping[str, float]
    """Of each camera, the part of a frame that is left of its offset in `recording`."""

    @property
    def answer(self) -> list[str]:
        """What was found, of each pair and of the cameras together."""
        sentences = [offset.sentence() for offset in self.pairs.values()]
        first, *others = self.offsets
        started = [
            f"{name} was started {in_frames(abs(self._exact(name)), sigma)} frames "
            f"{'later' if value >= 0 else 'earlier'} than {first}"
            for name, (value, sigma) in self.offsets.items()
            if name != first
        ]
        together = f"All pairs together: {', '.join(started)}."
        return [*sentences, together] if len(others) > 1 else sentences

    def _exact(self, camera: str) -> Decimal:
        return exact(self.recording.start_frames[camera], self.late[camera])

    def to_dataframe(self) -> pd.DataFrame:
        """The offset of each pair in frames, and the distances from the epipolar lines in px."""
        rows = {
            "-".join(pair): {
                "frames": offset.measured.frames,
                "sigma_frames": offset.measured.sigma,
                "median_px": offset.px,
                "one_frame_off_px": offset.one_off_px,
                "other_offset": offset.other,
                "other_px": offset.other_px,
            }
            for pair, offset in self.pairs.items()
        }
        return pd.DataFrame(rows).T.rename_axis("pair")


def bring_into_step(
    recording: Recording,
    near: Mapping[str, float] = MappingProxyType({}),
    orders: Sequence[IntArray] = (),
) -> BroughtIntoStep:
    """Find by how much later than the first each camera was started, from all pairs.

    Args:
        recording: whose cameras count their own frames.
        near, orders: as for `offset_of_pair`.

    Raises:
        StereocalError: the data do not tell it, or pairs contradict each other.
    """
    if recording.has_windows:
        raise StereocalError(
            "Cameras that were started by hand are brought into step by an essential matrix, which "
            'there is not behind a window: state their "start_frames" in dataset.json.'
        )
    names = list(recording.cameras)
    of_pairs, failed = dict[CameraPair, OffsetOfPair](), dict[CameraPair, str]()
    for pair in recording.pairs:
        try:
            of_pairs[pair] = offset_of_pair(recording, pair, near, orders)
        except StereocalError as error:
            failed[pair] = str(error)
    lost = [name for name in names if name not in reached(names, of_pairs)]
    if lost or not of_pairs:
        why = failed[pair := next(pair for pair in failed if not lost or {*pair} & {*lost})]
        # Of photographs, which have orders, the rates are known.
        raise StereocalError(why if orders else why + _what_fits(recording, pair))
    measured = {
        pair: replace(offset.measured, frames=offset.part) for pair, offset in of_pairs.items()
    }
    origins = {pair: offset.origin for pair, offset in of_pairs.items()}
    try:
        starts, covariance = _closed(names, measured, origins)
    except StereocalError as error:
        few = dict[CameraPair, MeasuredOffset]()
        for pair, offset in measured.items():  # as many as connect the cameras: they agree
            if not any({*pair} <= {*group} for group in groups_of(names, few).values()):
                few[pair] = offset
        by_few = _counted(recording, _closed(names, few, origins)[0])
        raise StereocalError(lost_in_step(by_few) or str(error)) from error
    errors = np.sqrt(np.diag(covariance)).tolist()
    begin = recording.first_frames
    more = {name: begin[names[0]] - frame for name, frame in begin.items()}
    near_0 = dict(zip(names, starts.tolist(), strict=True))
    late = {name: value - round(value) for name, value in near_0.items()}
    values = (value + more[name] for name, value in near_0.items())
    offsets = dict(zip(names, zip(values, errors, strict=True), strict=True))
    in_order = _in_order(names, of_pairs, orders) if orders else {}
    counted = _counted(recording, starts)
    for name, order in in_order.items():
        counted = with_targets(counted, name, order)
    brought = BroughtIntoStep(counted, offsets, of_pairs, in_order, late)
    notes = (*recording.step_notes, *brought.answer)
    return replace(brought, recording=replace(counted, step_notes=notes))


def _counted(recording: Recording, starts: FloatArray) -> Recording:
    """The recording with one count of frames, that of the first camera.

    Args:
        starts: (c,): by how much later each camera began to see what is held.
    """
    begin = [*recording.first_frames.values()]
    whole = {
        name: round(start) + begin[0] - first
        for name, start, first in zip(recording.cameras, starts.tolist(), begin, strict=True)
    }
    return replace(recording.counted_from(whole), start_frames=whole)


def _in_order(
    names: Sequence[str], pairs: Mapping[CameraPair, OffsetOfPair], orders: Sequence[IntArray]
) -> dict[str, IntArray]:
    """The order in which the targets of each camera are those of the first, by pairs that reach
    all."""
    known = {names[0]: orders[0]}
    while len(known) < len(names):
        for (a, b), offset in pairs.items():
            if a in known:
                known.setdefault(b, orders[offset.order][known[a]])
            elif b in known:
                known[a] = np.argsort(orders[offset.order])[known[b]]
    return known


def _closed(
    names: Sequence[str],
    pairs: Mapping[CameraPair, MeasuredOffset],
    origins: Mapping[CameraPair, int],
) -> tuple[FloatArray, FloatArray]:
    """How many frames of the first later each of n cameras was started, (n,), and their
    covariance (n, n), from the offsets of pairs that reach all.

    Args:
        origins: whole frames of each pair that its offset is counted from, which agree.

    Raises:
        StereocalError: the pairs contradict each other.
    """
    values, sigmas = np.array([[offset.frames, offset.sigma] for offset in pairs.values()]).T
    sigmas = np.maximum(sigmas, LEAST_SIGMA)
    rows = np.array([[(name == b) - (name == a) for name in names[1:]] for a, b in pairs], float)
    covariance = np.linalg.inv(rows.T @ (rows / sigmas[:, None] ** 2))
    starts = covariance @ rows.T @ (values / sigmas**2)
    off = np.abs(rows @ starts - values)
    if (off > CLOSED + 5 * sigmas).any():
        listed = ", ".join(
            f"{'-'.join(pair)} {exact(origins[pair], offset.frames):.2f}"
            for pair, offset in pairs.items()
        )
        raise StereocalError(
            f"The offsets of the pairs contradict each other by {off.max():.2f} frames: {listed}. "
            "One of them is wrong: record an irregular motion that all cameras see."
        )
    return np.array([0.0, *starts]), np.pad(covariance, ((1, 0), (1, 0)))


def _what_fits(recording: Recording, pair: CameraPair) -> str:
    """A sentence, if an offset stands out at other frame rates, or with the ends of the object
    exchanged in a camera."""
    two = recording.of_cameras(pair)
    for (slow, fast), (low, high) in product((pair, pair[::-1]), USUAL_RATES):
        rates = {slow: low, fast: high}
        with suppress(StereocalError):
            offset = offset_of_pair(at_slowest(two, rates), pair)
            stated = ", ".join(f'"{name}": {rates[name]}' for name in pair)
            return (
                f" With {high} frames of {fast} for {low} of {slow}, the points do fit, "
                f"{rounded(offset.px)} px from their lines: state the frame rates in dataset.json, "
                f'such as "frame_rates": {{{stated}}}.'
            )
    with suppress(StereocalError):
        offset = offset_of_pair(two, pair, orders=[two.object.half_turn])
        one, other = (two.object.names[target] for target in two.object.longest)
        return (
            f" With {one} and {other} exchanged in one of the two, in all frames, the points do "
            f"fit, {rounded(offset.px)} px from their lines: exchange them in its table."
        )
    return ""
