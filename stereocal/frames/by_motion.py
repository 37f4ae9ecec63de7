"""Pair the photographs of two cameras that were started by hand: the motion of the target tells.

Each camera's targets are found by themselves and followed from photograph to photograph, so that
targets that look alike keep their names; `network.started_by_hand` then finds the offset of the
counts. What both soundtracks say narrows the search where the images leave two offsets, and is
checked by the images where they do not.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from stereocal.errors import StereocalError
from stereocal.frames.pairing import Alone, Counts, Motion, Pair, Pairing, counted
from stereocal.network.started_by_hand import STANDS_OUT, BroughtIntoStep, bring_into_step
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import RigidObject
from stereocal.system.numbers import rounded

ALIKE = 3.0
"""Photographs within which the sound and the images agree: sound is a few hundredths of a second
late or early in most cameras."""


def paired_from(counts: Counts, later: int) -> tuple[tuple[Pair, ...], tuple[Alone, ...]]:
    """The pairs where the secondary's photograph 0 is the primary's `later`, numbered as the
    primary's, and the photographs without a partner."""
    first = {number: name for name, number in counts[0].items()}
    second = {number + later: name for name, number in counts[1].items()}
    both = sorted(first.keys() & second.keys())
    pairs = tuple(Pair(number, first[number], second[number]) for number in both)
    alone = tuple(
        Alone(own[number], camera, where="the other camera did not run then")
        for camera, own in enumerate((first, second))
        for number in sorted(own.keys() - {*both})
    )
    return pairs, alone


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
    first, second = (_followed(own, points, orders) for own in pairing.counts)
    turned = [{name: order[own] for name, own in second.items()} for order in orders]
    tries = [
        _recording(
            [
                _by_number(own, count, points)
                for own, count in zip((first, each), pairing.counts, strict=True)
            ],
            cameras,
            held,
        )
        for each in turned
    ]
    heard = pairing.heard
    try:
        (found, best), told = _best(tries), ""
    except StereocalError:
        if heard is None:
            raise
        found, best = _best(tries, heard)
        told = " Of several offsets that fit, it is the one that the sound of both says."
    offset = found.offsets[CAMERAS[1]][0]
    if heard is not None and not told:
        told = f" The sound says the same to {rounded(abs(heard - offset))} photographs."
        if abs(heard - offset) > ALIKE:
            told = f" Their sound says {heard:.1f}, which the images contradict."
    later = found.recording.start_frames[CAMERAS[1]]
    pairs, alone = paired_from(pairing.counts, later)
    sentence = f"{counted(len(pairs))} by the motion. {' '.join(found.sentences())}{told}"
    orders_of = first | turned[best]
    exchanged = frozenset(name for name, order in orders_of.items() if order[0])
    return replace(
        pairing,
        pairs=pairs,
        alone=alone,
        sentence=sentence,
        ambiguous=False,
        motion=Motion(later, offset - later, exchanged),
    )


def _followed(
    counts: Mapping[str, int], points: Mapping[str, FloatArray], orders: Sequence[IntArray]
) -> dict[str, IntArray]:
    """By photograph the order of its targets that is nearest to the one before."""
    found = dict[str, IntArray]()
    last: FloatArray | None = None
    for name in sorted(counts, key=counts.__getitem__):
        seen = points.get(name)
        if seen is None or not np.isfinite(seen).any():
            continue
        away = [0.0 if last is None else _apart(seen[order], last) for order in orders]
        found[name] = orders[int(np.argmin(away))]
        last = seen[found[name]]
    return found


def _by_number(
    orders: Mapping[str, IntArray], counts: Mapping[str, int], points: Mapping[str, FloatArray]
) -> dict[int, FloatArray]:
    """The targets in these orders, by number of the photograph."""
    return {counts[name]: points[name][order] for name, order in orders.items()}


def _apart(one: FloatArray, other: FloatArray) -> float:
    both = np.isfinite(one + other).all(axis=1)
    return float(np.linalg.norm((one - other)[both], axis=1).mean()) if both.any() else np.inf


def _recording(
    sides: Iterable[Mapping[int, FloatArray]], cameras: tuple[Camera, Camera], held: RigidObject
) -> Recording:
    """What each camera saw, by its own count."""
    parts = []
    for camera, own in enumerate(sides):
        for number, seen in own.items():
            for target in np.flatnonzero(np.isfinite(seen).all(axis=1)).tolist():
                parts.append((number, camera, target, *seen[target]))
    rows = np.array(parts, dtype=np.float64).reshape(-1, 5)
    numbers = rows[:, :3].astype(np.int64)
    named = {str(name): camera for name, camera in zip(CAMERAS, cameras, strict=True)}
    frame, camera_of, target = numbers.T
    unknown = np.full(len(rows), np.nan)
    return Recording("", named, held, frame, camera_of, target, rows[:, 3:], unknown)


def _best(tries: Sequence[Recording], near: float | None = None) -> tuple[BroughtIntoStep, int]:
    """The try whose points fit best, and which; an error if another fits nearly as well."""
    found, failed = list[tuple[BroughtIntoStep, int]](), list[StereocalError]()
    for number, each in enumerate(tries):
        try:
            found.append((bring_into_step(each, near), number))
        except StereocalError as error:
            failed.append(error)
    if not found:
        raise failed[0]
    (best, number), *others = sorted(found, key=lambda each: _px(each[0]))
    starts = best.recording.start_frames
    for other, _ in others:
        if other.recording.start_frames != starts and _px(other) < STANDS_OUT * _px(best):
            raise StereocalError(
                "Which end of the object is which decides when the cameras were started, and is "
                f"open: {best.sentences()[0]} Or: {other.sentences()[0]}"
            )
    return best, number


def _px(found: BroughtIntoStep) -> float:
    return found.pairs[CAMERAS].px
