"""Readings that only a rig has: a camera that moved."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from stereocal.calibration.readings import Reading
from stereocal.calibration.wrong_inputs import essential_fit
from stereocal.network.pairs import shared_bars
from stereocal.rig.dataset import Dataset
from stereocal.rig.recording import CameraPair, Recording

FEWEST_OF_PART, CUTS = 10, 8
"""Frames before a camera moved and after it, and cuts that are tried at first."""


def readings_of_movement(
    recording: Recording, about: Sequence[str]
) -> Iterator[Reading[Recording]]:
    """A camera that moved: from a frame on it is another one, with the same lens."""
    for name in about:
        if (pair := best_pair(recording, name)) is None:
            continue
        dataset = recording.pair(*pair)
        if (when := _best_cut(dataset)) is not None:
            after = f"{name} from frame {when} on"
            yield Reading(
                f"The camera {name} seems to have moved at about frame {when}",
                "Calibrate with the frames before it, or after it, alone.",
                partial(_as_two_cameras, recording, name, after, when),
                (name, after),
                is_movement=True,
            )


def _best_cut(dataset: Dataset) -> int | None:
    """The frame at which the pairs of two cameras are best divided, so that each part fits by
    itself; None for few frames."""
    frames = dataset.correspondences.frames
    if len(frames) < 2 * FEWEST_OF_PART:
        return None

    def px(cut: int) -> float:
        parts = frames[:cut], frames[cut:]
        return sum(len(part) * essential_fit(dataset.of_frames(part)).px for part in parts)

    first, last = FEWEST_OF_PART, len(frames) - FEWEST_OF_PART
    step = max((last - first) // CUTS, 1)
    best = min(range(first, last + 1, step), key=px)
    while step > 1:
        step //= 2
        best = min(
            (cut for cut in (best - step, best, best + step) if first <= cut <= last), key=px
        )
    return int(frames[best])


def _as_two_cameras(recording: Recording, name: str, after: str, when: int) -> Recording:
    """The recording with a camera as two, before a frame and from it on."""
    cameras = {**recording.cameras, after: recording.cameras[name]}
    moved = (recording.camera == [*recording.cameras].index(name)) & (recording.frame >= when)
    camera = np.where(moved, len(recording.cameras), recording.camera)
    return replace(recording, cameras=cameras, camera=camera)


def best_pair(recording: Recording, name: str) -> CameraPair | None:
    """The pair of a camera, as the second one, with which it shares most bars; None without any."""
    pair = next((pair for pair in shared_bars(recording) if name in pair), None)
    return None if pair is None else (pair[pair[0] == name], name)
