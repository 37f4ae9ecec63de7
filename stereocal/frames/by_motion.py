"""Pair the photographs of two cameras that were started by hand: the motion of the target tells.

Each camera's targets are found by themselves and followed from photograph to photograph, so that
targets that look alike keep their names; `network.started_by_hand` then finds the offset of the
counts. What both soundtracks say narrows the search where the images leave two offsets, and is
checked by the images where they do not.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stereocal.errors import StereocalError
from stereocal.frames.pairing import Counts, Motion, Pair, Pairing, counted
from stereocal.network.started_by_hand import STANDS_OUT, BroughtIntoStep, bring_into_step
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import RigidObject
from stereocal.system.numbers import rounded

ALIKE = 3.0
"""Photographs within which the sound and the images agree: sound is a few hundredths of a second
late or early in most cameras."""


def paired_from(counts: Counts, later: int) -> tuple[Pair, ...]:
    """The pairs where the secondary's photograph 0 is the primary's `later`, numbered as the
    primary's; where one camera did not run yet or any more, there are none."""
    first = {number: name for name, number in counts[0].items()}
    second = {number + later: name for name, number in counts[1].items()}
    both = sorted(first.keys() & second.keys())
    return tuple(Pair(number, first[number], second[number]) for number in both)


def paired_by_motion(
    pairing: Pairing,
    points: Mapping[str, FloatArray],
    cameras: tuple[Camera, Camera],
    held: RigidObject,
    orders: Sequence[IntArray],
) -> Pairing:
    """The pairing of photographs by the motion of what is held.

    Args:
        pairing: with the counts of both cameras.
        points: (k, 2) pixels of the targets in each photograph, NaN where not seen.
        orders: numbers of the targets with which the object looks the same, its own first.

    Raises:
        StereocalError: the photographs do not tell it.
    """
    assert pairing.counts is not None
    first, second = (_Followed.of(own, points, orders) for own in pairing.counts)
    sides = [(first, replace(second, orders=order[second.orders])) for order in orders]
    tries = [_recording(each, cameras, held) for each in sides]
    heard, told = pairing.heard, ""
    try:
        found, best = _best(tries)
    except StereocalError:
        if heard is None:
            raise
        found, best = _best(tries, heard)
        if abs(heard - found.offsets[CAMERAS[1]][0]) > ALIKE:
            raise
        told = " Of several offsets that fit, it is the one that the sound of both says."
    offset, later = found.offsets[CAMERAS[1]][0], found.recording.start_frames[CAMERAS[1]]
    if heard is not None and not told:
        told = f" The sound says the same to {rounded(abs(heard - offset))} photographs."
        if abs(heard - offset) > ALIKE:
            told = f" Their sound says {heard:.1f}, which the images contradict."
    pairs = paired_from(pairing.counts, later)
    sentence = f"{counted(len(pairs))} by the motion. {' '.join(found.answer)}{told}"
    exchanged = frozenset(
        name
        for side in sides[best]
        for name, order in zip(side.names, side.orders, strict=True)
        if order[0]
    )
    motion = Motion(later, offset - later, exchanged)
    about = pairs, (), pairing.unknown, sentence, False, pairing.counts, heard
    return Pairing(*about, motion)


@dataclass(frozen=True, eq=False)
class _Followed:
    """The targets that a camera saw, followed from photograph to photograph."""

    names: list[str]
    """Of the n photographs with targets."""
    numbers: IntArray
    """(n,)."""
    points: FloatArray
    """(n, k, 2), NaN where not seen."""
    orders: IntArray
    """(n, k): of each target, which of `points` it is."""

    @classmethod
    def of(
        cls, counts: Mapping[str, int], points: Mapping[str, FloatArray], orders: Sequence[IntArray]
    ) -> "_Followed":
        """The targets, each in the order that is nearest to the photograph before."""
        seen = [name for name in counts if np.isfinite(points.get(name, np.nan)).any()]
        names = sorted(seen, key=counts.__getitem__)
        every = np.array([points[name] for name in names]).reshape(-1, len(orders[0]), 2)
        chosen = np.tile(orders[0], (len(names), 1))
        for k in range(1, len(names)):
            away = every[k, np.array(orders)] - every[k - 1, chosen[k - 1]]
            apart = np.linalg.norm(away, axis=2)
            both = np.maximum(np.isfinite(apart).sum(axis=1), 1)
            chosen[k] = orders[int(np.argmin(np.nansum(apart, axis=1) / both))]
        return cls(names, np.array([counts[name] for name in names]), every, chosen)


def _recording(
    sides: Iterable[_Followed], cameras: tuple[Camera, Camera], held: RigidObject
) -> Recording:
    """What each camera saw, by its own count."""
    parts = []
    for camera, own in enumerate(sides):
        found = np.take_along_axis(own.points, own.orders[:, :, None], axis=1)
        at, target = np.nonzero(np.isfinite(found).all(axis=2))
        numbers = own.numbers[at], np.full(len(at), camera), target
        parts.append(np.column_stack([*numbers, found[at, target]]))
    rows = np.concatenate(parts)
    frame, camera_of, target_of = rows[:, :3].T.astype(np.int64)
    named = {str(name): camera for name, camera in zip(CAMERAS, cameras, strict=True)}
    unknown = np.full(len(rows), np.nan)
    return Recording("", named, held, frame, camera_of, target_of, rows[:, 3:], unknown)


def _best(tries: Sequence[Recording], near: float | None = None) -> tuple[BroughtIntoStep, int]:
    """The try whose points fit best, and which; an error if another fits nearly as well."""
    found, failed = list[tuple[float, int, BroughtIntoStep]](), list[StereocalError]()
    for number, each in enumerate(tries):
        try:
            brought = bring_into_step(each, near)
            found.append((brought.pairs[CAMERAS].px, number, brought))
        except StereocalError as error:
            failed.append(error)
    if not found:
        raise failed[0]
    (px, number, best), *others = sorted(found)
    for other_px, _, other in others:
        same = other.recording.start_frames == best.recording.start_frames
        if not same and other_px < STANDS_OUT * px:
            raise StereocalError(
                "Which end of the object is which decides when the cameras were started, and is "
                f"open: {best.answer[0]} Or: {other.answer[0]}"
            )
    return best, number
