"""Cameras that took different numbers of frames a second, brought to the frames of the slowest."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from stereocal.errors import StereocalError
from stereocal.rig.recording import Recording
from stereocal.rig.tracks import NO_SHIFT
from stereocal.system.records import of_plain

RATES = "frame_rates"
"""The entry of `dataset.json` that states them: frames a second, by camera."""


def at_stated_rates(recording: Recording, given: Any) -> Recording:
    """The recording at the frames of its slowest camera, with a note; as it is without rates.

    Args:
        given: the entry `RATES`, or None.

    Raises:
        StereocalError: it does not give the rate of each camera.
    """
    if given is None:
        return recording
    try:
        rates = of_plain(given, dict[str, float])
    except ValueError:
        rates = {}
    if rates.keys() != recording.cameras.keys() or not all(0 < r < np.inf for r in rates.values()):
        raise StereocalError(f'"{RATES}" must give the frames per second of each camera.')
    slowest = min(rates, key=rates.__getitem__)
    others = [
        f"of {name} frame {rate / rates[slowest]:.6g} k"
        for name, rate in rates.items()
        if rate > rates[slowest]
    ]
    if not others:
        return recording
    note = (
        f"The frames are counted as by the slowest camera, {slowest}: by the frame rates stated, "
        f"frame k is {', '.join(others)}, interpolated where that is between two frames."
    )
    return replace(at_slowest(recording, rates), step_notes=(note,))


def at_slowest(recording: Recording, rates: Mapping[str, float]) -> Recording:
    """The recording at the frames of its slowest camera: the points of others are interpolated.

    Frame k of each camera is then the moment of k frames of the slowest after its own frame 0.

    Args:
        rates: frames per second of each camera.
    """
    slowest, own_frame = min(rates.values()), recording.frame
    ratio = np.array([rates[name] / slowest for name in recording.cameras])[recording.camera]
    # From about the first frame of each: parts of frames are lost in numbers near 2^53.
    begin = np.array([recording.first_frames[name] for name in recording.cameras])
    start = np.floor(begin[recording.camera] / ratio)
    own_frame = own_frame - start * ratio
    frame = np.ceil((own_frame - 0.5) / ratio)
    late = own_frame - frame * ratio
    between = np.abs(late) > NO_SHIFT
    interpolated, known = recording.moved(late)
    return replace(
        recording,
        frame=frame.astype(np.int64) + start.astype(np.int64),
        points=np.where(between[:, None], interpolated.positions, recording.points),
        sigma_px=recording.sigma_px * np.where(between, np.sqrt(interpolated.variance), 1.0),
    ).where((late > -0.5) & (known | ~between))
