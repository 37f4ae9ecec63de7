"""Which photographs of cameras that were started by hand belong together: the motion tells.

Each camera's targets are found by themselves and followed from photograph to photograph, so that
targets that look alike keep their names; `fit.timing.started_by_hand` then finds the offset of the
counts. What the soundtracks say narrows the search where the images leave two offsets, and is
checked by the images where they do not.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stereocal.errors import StereocalError
from stereocal.fit.timing.started_by_hand import bring_into_step
from stereocal.frames.pairing import ByHand, Motion
from stereocal.rig.camera import Camera, camera_in_words
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import RigidObject
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import rounded

ALIKE = 3.0
"""Photographs within which the sound and the images agree: sound is a few hundredths of a second
late or early in most cameras."""


def found_by_motion(
    by_hand: ByHand,
    points: Mapping[str, FloatArray],
    cameras: Mapping[str, Camera],
    held: RigidObject,
    orders: Sequence[IntArray],
) -> Motion:
    """How photographs belong together by the motion of what is held.

    Args:
        points: (k, 2) pixels of the targets in each photograph, NaN where not seen.
        orders: numbers of the targets with which the object looks the same, its own first.

    Raises:
        StereocalError: the photographs do not tell it.
    """
    followed = {
        name: _Followed.of(numbers, points, orders) for name, numbers in by_hand.counts.items()
    }
    for name, side in followed.items():
        if not side.names:
            raise StereocalError(
                f"In none of the {len(by_hand.counts[name])} photographs of "
                f"{camera_in_words(name)} was a target found. Is the kind of target the one that "
                "was filmed?"
            )
    recording, heard, by_sound = _recording(followed, cameras, held), by_hand.heard, list[str]()
    try:
        in_step = bring_into_step(recording, orders=orders)
    except StereocalError:
        if not heard:
            raise
        in_step = bring_into_step(recording, {next(iter(followed)): 0.0, **heard}, orders)
        if any(abs(in_step.offsets[name][0] - said) > ALIKE for name, said in heard.items()):
            raise
        by_sound = ["Of several offsets that fit, it is the one that the sound of all says."]
    for name, said in {} if by_sound else heard.items():
        apart = abs(said - in_step.offsets[name][0])
        of = f" of {name}" * (len(followed) > 2)
        contradicted = f"The sound{of} says {said:.1f}, which the images contradict."
        agrees = f"The sound{of} agrees: {said:.1f} photographs, {rounded(apart)} from that."
        by_sound.append(contradicted if apart > ALIKE else agrees)
    later = in_step.recording.start_frames
    exchanged = frozenset(
        name
        for camera, side in followed.items()
        for name, first in zip(side.names, side.orders[:, in_step.orders[camera][0]], strict=True)
        if first
    )
    return Motion(later, in_step.late, exchanged, " ".join([*in_step.answer, *by_sound]))


@dataclass(frozen=True, eq=False)
class _Followed:
    """The targets that a camera saw, followed from photograph to photograph."""

    names: list[str]
    """The n photographs with targets."""
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
    sides: Mapping[str, _Followed], cameras: Mapping[str, Camera], held: RigidObject
) -> Recording:
    """What each camera saw, by its own count."""
    parts = []
    for camera, side in enumerate(sides.values()):
        ordered = np.take_along_axis(side.points, side.orders[:, :, None], axis=1)
        row, target = np.nonzero(np.isfinite(ordered).all(axis=2))
        parts.append((side.numbers[row], np.full(len(row), camera), target, ordered[row, target]))
    frame, camera_of, target_of, points = map(np.concatenate, zip(*parts, strict=True))
    named = {name: cameras[name] for name in sides}
    unknown = np.full(len(frame), np.nan)
    return Recording("", named, held, frame, camera_of, target_of, points, unknown)
