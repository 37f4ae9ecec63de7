"""The stated windows of a recording among the unknowns: where they begin, and their priors."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from stereocal.fit.least_squares.small_steps import (
    cameras_at,
    window_places,
    window_values,
    windows_of,
)
from stereocal.fit.least_squares.views import Cameras
from stereocal.fit.least_squares.windows import KIND, SHARED
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import Recording
from stereocal.rig.window import StatedWindow, Window, moved_window
from stereocal.system.array_types import FloatArray

BEGIN_M = 0.3
"""The distance at which a window begins that is not stated."""
SQUARE = 0.0, 0.0, 1.0
WIDE_NORMAL, WIDE_DISTANCE_M = 2.0, 5.0
"""Standard errors of a normal (its tangent) and a distance that are not stated: they hardly
restrict them, and keep those finite about which the images say nothing."""
USUAL_DISTANCE_M, USUAL_NORMAL_DEG = 0.01, 2.0
"""Of those that are stated without: a distance is measured from the housing, and ends inside."""
PARTS = ("x", "y", "distance", "medium", "glass")
Column = tuple[str, float, list[int]]
"""A free parameter: its name, its prior standard deviation, and its places in q."""


def windows_held(recording: Recording) -> FloatArray:
    """(c, 2): as of `windows`, of the cameras of a recording."""
    if not recording.windows:
        return windows_of([*recording.cameras.values()])
    names = list(recording.cameras)
    begun = dict(recording.cameras)
    for window in recording.windows:
        begin = window.at(window.normal or SQUARE, window.distance_m or BEGIN_M)
        begun |= {name: replace(begun[name], window=begin) for name in window.cameras}
    held = windows_of([*begun.values()])
    for window in recording.windows:
        if is_shared(window, names):
            held[[names.index(name) for name in window.cameras], KIND] = SHARED
    return held


def is_shared(window: StatedWindow, names: Sequence[str]) -> bool:
    """Whether a window has the same unknowns for all its cameras: the reference looks through it.

    Others have a normal and a distance of each camera, which may face each other.
    """
    return len(window.cameras) > 1 and names[0] in window.cameras


def cameras_of(recording: Recording, poses: Sequence[Pose]) -> Cameras:
    """Where the cameras of a recording begin.

    Args:
        poses: `camera_from_reference` of each.
    """
    begin, names = cameras_at([*recording.cameras.values()], poses), list(recording.cameras)
    if not recording.windows:
        return begin
    values = np.zeros((len(names), len(PARTS)))
    for window in recording.windows:
        for name in window.cameras:
            is_stated = is_shared(window, names) or name == window.cameras[0]
            normal, distance_m = window.normal or SQUARE, window.distance_m or BEGIN_M
            at = window.at(normal, distance_m) if is_stated else window.at(SQUARE, BEGIN_M)
            values[names.index(name)] = window_values(at)
    q = np.concatenate([begin.q[:-1], values.ravel(), begin.q[-1:]])
    return begin._replace(q=q, windows=windows_held(recording))


def window_blocks(recording: Recording) -> Iterator[list[Column]]:
    """The free parameters of the stated windows."""
    names = list(recording.cameras)
    labels = dict(zip(names, recording.labels, strict=True))
    for window in recording.windows:
        places = {
            name: window_places(names.index(name), len(names)).start for name in window.cameras
        }
        every = list(places.values())
        groups = [every] if is_shared(window, names) else [[place] for place in every]
        for number, (name, group) in enumerate(zip(window.cameras, groups, strict=False)):
            sigmas = _sigmas(window) if number == 0 else (WIDE_NORMAL, WIDE_NORMAL, WIDE_DISTANCE_M)
            yield [
                (window_name(labels[name], part), sigma, [place + i for place in group])
                for i, (part, sigma) in enumerate(zip(PARTS, sigmas, strict=False))
            ]
        indices = zip(PARTS[3:], (window.medium_sigma, window.glass_sigma), strict=True)
        yield [
            (window_name(labels[window.cameras[0]], part), sigma, [place + i for place in every])
            for i, (part, sigma) in enumerate(indices, 3)
        ]


def begin_at(
    recording: Recording, poses: Sequence[Pose], seen: Mapping[str, Window]
) -> dict[str, float]:
    """The free parameters of the stated windows, where cameras see them.

    Args:
        poses: `camera_from_reference` of each camera.
        seen: windows as some cameras see them, in their frames; the best first.
    """
    names, begin = list(recording.cameras), cameras_of(recording, poses)
    values = dict[str, float]()
    for window in recording.windows:
        shared = is_shared(window, names)
        known = [name for name in seen if name in window.cameras]
        for name in window.cameras[: 1 if shared else None]:
            if shared and known:
                there = poses[names.index(known[0])].inverse()
                found = moved_window(seen[known[0]], there)
            elif name in seen:
                found = seen[name]
            else:
                continue
            number = names.index(name)
            away = window_values(found) - begin.q[window_places(number, len(names))]
            label = recording.labels[number]
            parts = zip(PARTS, away.tolist(), strict=True)
            values |= {window_name(label, part): value for part, value in parts}
    return values


def window_name(label: str, part: str) -> str:
    """The name of a free parameter of the window of a camera, its first one."""
    return f"{label} window {part}"


def _sigmas(window: StatedWindow) -> tuple[float, float, float]:
    """Prior standard deviations of the normal's two numbers and of the distance."""
    turn, away = WIDE_NORMAL, WIDE_DISTANCE_M
    if window.normal is not None:
        degrees = window.normal_sigma_deg
        degrees = USUAL_NORMAL_DEG if degrees is None else degrees
        turn = float(np.radians(degrees)) / window.normal[2] ** 2
    if window.distance_m is not None:
        sigma = window.distance_sigma_m
        away = USUAL_DISTANCE_M if sigma is None else sigma
    return turn, turn, away
