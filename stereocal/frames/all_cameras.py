"""Photographs of three cameras and more: the same targets in all, with the same names.

The pair stays the unit: A and B are told apart in every pair of cameras, as for two. A photograph
has the same targets in all its pairs, so that these give one order to all photographs of a frame.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import PurePosixPath
from types import MappingProxyType

import numpy as np

from stereocal.errors import StereocalError
from stereocal.frames.by_time import aligned_clocks, times_of
from stereocal.frames.frame import Frame
from stereocal.frames.pairing import Moments, Pairing, natural, numbered, short_names
from stereocal.frames.proposal import CONTRADICTED, Choice, by_hand_of
from stereocal.frames.sides import in_order_taken
from stereocal.rig.camera import Camera
from stereocal.rig.field_of_view import beyond_in_words
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import RigidObject
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.taken import Taken

PairPoints = Mapping[tuple[str, str], Mapping[int, tuple[FloatArray, FloatArray]]]
"""The u, v and standard error (n, 3) of every target in both cameras, by pair of cameras and frame;
NaN if not seen."""
UNFIT = "no other camera sees its targets, or they do not fit together."
BY_MOTION = "Which photographs belong together is found with the targets, by their motion."
DISAGREE = "the pairs of cameras name the targets differently; the frame is left out."


@dataclass(frozen=True, eq=False)
class Found:
    """What the photographs of all cameras show of an object, found pair by pair."""

    pairing: Pairing
    """How the photographs belong together; of cameras started by hand, as the motion tells."""
    cameras: Mapping[str, Camera]
    object: RigidObject
    """Whose targets these are; a bar is one of 1 m."""
    orders: Sequence[IntArray]
    """Orders of the targets, each (n,), in which the object looks the same."""
    points: PairPoints
    why: Mapping[str, str]
    """What was wrong with each photograph; empty if nothing."""
    frames: list[Frame] = field(default_factory=list)
    """The frames of a bar and two cameras, in order, also those that are not used."""
    sentence: str = ""
    """What was found in the photographs of two cameras, for the user."""
    doubtful: Mapping[int, str] = field(default_factory=dict)
    """Why frames of a board are not used or do not fit well."""

    @cached_property
    def _sorted(self) -> tuple[list[tuple[int, int, int, FloatArray]], list[str]]:
        """Frame, camera, target and point of what is used; which photographs are not, and why."""
        rows: list[tuple[int, int, int, FloatArray]] = []
        unused = []
        for frame, files in self.pairing.moments.items():
            by_pair = {pair: its[frame] for pair, its in self.points.items() if frame in its}
            points, agree = in_one_order(by_pair, self.orders)
            for number, (camera, name) in enumerate((k, files.get(k)) for k in self.cameras):
                if name is None:
                    continue
                if not agree or camera not in points:
                    reason = DISAGREE if not agree else self.why.get(name) or UNFIT
                    unused.append(reason if reason.startswith(name) else f"{name}: {reason}")
                    continue
                seen = np.flatnonzero(np.isfinite(points[camera][:, 0])).tolist()
                rows += [(frame, number, target, points[camera][target]) for target in seen]
        return rows, unused

    @cached_property
    def recording(self) -> Recording:
        """What is used, with the targets named alike in all cameras.

        Raises:
            StereocalError: no two cameras see the object in one frame.
        """
        rows, unused = self._sorted
        if not rows:
            raise StereocalError(
                f"No two cameras see the targets in the same frame. The first: {unused[0]}"
            )
        frame, camera, target = np.array([row[:3] for row in rows], dtype=np.int64).T
        values = np.array([row[3] for row in rows])
        return Recording(
            "", dict(self.cameras), self.object, frame, camera, target, values[:, :2], values[:, 2]
        ).within_view()

    @property
    def beyond(self) -> str:
        """Which points lie farther out than a fisheye sees, for the user; empty if none."""
        return beyond_in_words(self.recording.beyond_view)

    @property
    def unused(self) -> tuple[str, ...]:
        """Photographs that are not used, and why; a line each."""
        return (*self._sorted[1], *filter(None, [self.beyond]))


def by_folder(names: Iterable[str], cameras: Iterable[str]) -> dict[str, list[str]]:
    """The photographs in the folder of each camera, which has the camera's name."""
    by_camera: dict[str, list[str]] = {camera: [] for camera in cameras}
    for name in names:
        folders = PurePosixPath(name).parent.parts
        camera = next((folder for folder in folders if folder in by_camera), None)
        if camera is not None:
            by_camera[camera].append(name)
    return by_camera


def pair_folders(taken: Mapping[str, Taken], cameras: Iterable[str], choice: Choice) -> Pairing:
    """How the photographs in the folders of all cameras belong together.

    Args:
        taken: what the file of each says, by name.
        choice: of its ways, motion only.

    Raises:
        StereocalError: neither names nor times tell it.
    """
    folders = by_folder(sorted(taken, key=natural), cameras)
    if choice.way != "motion":
        return Pairing(match_names(folders, taken))
    by_hand = by_hand_of(folders, choice.heard)
    return Pairing(by_hand.moments(dict.fromkeys(folders, 0)), sentence=BY_MOTION, by_hand=by_hand)


def match_names(
    folders: Mapping[str, Sequence[str]], taken: Mapping[str, Taken] = MappingProxyType({})
) -> Moments:
    """The photographs of one moment, from those by camera: of the same name, else of the same
    number in it; by the time taken, where names tell nothing or the cameras' clocks contradict.

    Args:
        taken: what the files say, by name.
    """
    named, timed = _by_name(folders), _by_time(folders, taken)
    moment_of = {name: frame for frame, files in timed.items() for name in files.values()}
    timed_moments = [
        {moment_of[name] for name in files.values() if name in moment_of}
        for files in named.values()
    ]
    if timed and (not named or sum(len(moments) > 1 for moments in timed_moments) >= CONTRADICTED):
        return timed
    if not named:
        raise StereocalError(
            "No two cameras have photographs of the same name: name those of one moment alike, "
            "apart from the camera, such as left07 and right07, or 07 in the folder of each."
        )
    return named


def _by_name(folders: Mapping[str, Sequence[str]]) -> Moments:
    by_stem: dict[str, dict[str, str]] = {}
    by_number: dict[int, dict[str, str]] = {}
    for camera, names in folders.items():
        of_camera = {PurePosixPath(name).stem.lower(): name for name in names}
        if len(of_camera) < len(names):
            raise StereocalError(f"Two photographs of {camera} have the same name: remove one.")
        for stem, frame in numbered(of_camera).items():
            by_stem.setdefault(stem, {})[camera] = of_camera[stem]
            if re.search(rf"(?<![0-9])0*{frame}(?![0-9])", stem):  # else it was counted
                by_number.setdefault(frame, {})[camera] = of_camera[stem]
    alike = {stem: files for stem, files in by_stem.items() if len(files) > 1}
    if alike:
        by_number = {frame: alike[stem] for stem, frame in numbered(alike).items()}
    return {frame: files for frame, files in sorted(by_number.items()) if len(files) > 1}


def _by_time(folders: Mapping[str, Sequence[str]], taken: Mapping[str, Taken]) -> Moments:
    """The photographs of one moment by the clocks of the cameras, each compared with that of most
    photographs; empty if one of them is not sure."""
    known = {
        camera: times_of(in_order_taken([n for n in names if n in taken], taken), taken)
        for camera, names in folders.items()
    }
    most = max(known, key=lambda camera: len(known[camera].names), default="")
    moments: dict[str, dict[str, str]] = {}
    for camera, times in known.items():
        aligned = aligned_clocks(known[most], times) if camera != most else None
        if camera != most and (aligned is None or not aligned.sure or times.source != "camera"):
            return {}
        for i, j in [] if aligned is None else aligned.pairs.tolist():
            name = known[most].names[i]
            moments.setdefault(name, {most: name})[camera] = times.names[j]
    stems = dict(zip(short_names([*moments]), moments, strict=True))
    return {
        frame: {camera: files[camera] for camera in folders if camera in files}
        for stem, frame in numbered(stems).items()
        if (files := moments[stems[stem]])
    }


def in_one_order(
    pairs: Mapping[tuple[str, str], tuple[FloatArray, FloatArray]], ways: Sequence[IntArray]
) -> tuple[dict[str, FloatArray], bool]:
    """The points (n, 3) of one frame by camera, in one order, and whether all pairs agree on it.
    Pairs are joined by the cameras they share, from the first; those that share none are not used.
    """
    left, points = dict(pairs), dict[str, FloatArray]()
    while joined := next((pair for pair in left if not points or {*pair} & {*points}), None):
        both = dict(zip(joined, left.pop(joined), strict=True))
        known = [camera for camera in joined if camera in points]
        fitting = (
            way
            for way in ways
            if all(
                np.array_equal(both[camera][way], points[camera], equal_nan=True)
                for camera in known
            )
        )
        if (way := next(fitting, None)) is None:
            return {}, False
        points |= {camera: seen[way] for camera, seen in both.items()}
    return points, True
