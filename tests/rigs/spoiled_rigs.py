"""Rigs of three cameras and more that are unlike in everything, and one thing of them wrong."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.calibration.corrections import scaled, with_pixels, with_targets
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import BoardPattern, RigidObject
from stereocal.simulation.rigs import (
    IMAGE_SIZE,
    NOISE_PX,
    WAND,
    SimulatedRig,
    looking,
    nominal_of,
    recording_of,
)
from stereocal.system.array_types import FloatArray
from tests.rigs.mistakes import (
    Change,
    files_exchanged,
    flipped,
    from_below,
    from_the_right,
    of_lenses,
    one_file_for_all,
    one_of,
    upside_down,
    zoomed,
)

BAR = RigidObject.bar(0.6)
BOARD = RigidObject.of_board(BoardPattern(7, 5, 0.1))


@dataclass(frozen=True)
class Kind:
    """A kind of rig, and how its object is moved."""

    cameras: int
    object: RigidObject
    frames: int
    waved: bool = False
    """Whether frames follow each other."""
    arc_deg: float = 100.0
    seen_by: int | None = None
    """How many neighbouring cameras see a frame; None: all."""


KINDS: Mapping[str, Kind] = {
    "3 cameras": Kind(3, BAR, 120),
    "3 cameras, waved wand": Kind(3, WAND, 150, waved=True),
    "4 cameras": Kind(4, WAND, 100),
    "5 cameras, waved bar": Kind(5, BAR, 150, waved=True),
    "3 cameras, board": Kind(3, BOARD, 30, arc_deg=50.0),
    "9 cameras, few common frames": Kind(9, BAR, 240, arc_deg=240.0, seen_by=3),
}


def sound(kind: str, number: int) -> tuple[SimulatedRig, np.random.Generator]:
    """A rig of a kind with its recording, and more randomness."""
    rng = _draws(kind, number)
    return _recorded(KINDS[kind], rng, np.zeros(KINDS[kind].cameras)), rng


def late(kind: str, number: int, offset: float) -> SimulatedRig:
    """The same rig, whose second camera takes its frames later by a part of a frame."""
    offsets = np.where(np.arange(KINDS[kind].cameras) == 1, offset, 0.0)
    return _recorded(KINDS[kind], _draws(kind, number), offsets)


def _draws(kind: str, number: int) -> np.random.Generator:
    return np.random.default_rng([number, 40, [*KINDS].index(kind)])


def _recorded(it: Kind, rng: np.random.Generator, offsets: FloatArray) -> SimulatedRig:
    names = [f"c{number + 1}" for number in range(it.cameras)]
    world = [_pose(rng, number, it) for number in range(it.cameras)]
    true = {name: _camera(rng) for name in names}
    poses = {name: pose @ world[0].inverse() for name, pose in zip(names, world, strict=True)}
    placed = _waved(it, rng) if it.waved else _random(it, rng)
    times, pixels = np.arange(it.frames, dtype=np.float64), []
    middle = rng.integers(0, it.cameras, it.frames)
    for number, (pose, camera) in enumerate(zip(world, true.values(), strict=True)):
        points = pose.apply(placed(times + offsets[number]).reshape(-1, 3))
        images = camera.project(points) + rng.normal(0.0, NOISE_PX, (len(points), 2))
        inside = ((images > 0) & (images < np.array(IMAGE_SIZE) - 1)).all(axis=1)
        seen = np.array(camera.sees(points) & inside).reshape(it.frames, -1)
        seen &= rng.random((it.frames, 1)) < rng.uniform(0.65, 0.95)
        if it.seen_by is not None:
            seen &= (np.abs(middle - number) <= it.seen_by // 2)[:, None]
        if it.object.board is not None:
            seen &= np.all(seen, axis=1, keepdims=True)
        pixels.append(np.where(seen[..., None], images.reshape(it.frames, -1, 2), np.nan))
    recording = recording_of("spoiled", nominal_of(true, rng), it.object, pixels)
    recording = recording.counted_from(dict.fromkeys(names, 1))
    points_m = world[0].apply(placed(times).reshape(-1, 3)).reshape(it.frames, -1, 3)
    return SimulatedRig(recording, true, poses, points_m)


def _camera(rng: np.random.Generator) -> Camera:
    focal = rng.uniform(900, 1500)
    cx, cy = 0.5 * (np.array(IMAGE_SIZE) - 1) + rng.normal(0.0, 25.0, 2)
    K = np.array([[focal, 0.0, cx], [0.0, focal, cy], [0.0, 0.0, 1.0]])
    k1 = rng.uniform(-0.25, -0.05)
    return Camera(K, np.array([k1, -0.4 * k1, 5e-4, -4e-4]), IMAGE_SIZE)


def _pose(rng: np.random.Generator, number: int, it: Kind) -> Pose:
    """`camera_from_world`, of a camera that looks at about the world's origin, a little rolled."""
    angle = np.radians(it.arc_deg) * (number / (it.cameras - 1) - 0.5) + rng.normal(0.0, 0.05)
    away = 6.0 * rng.uniform(0.8, 1.2)
    centre = np.array([away * np.sin(angle), rng.uniform(-1.5, 0.3), -away * np.cos(angle)])
    level = looking(centre, rng.normal(0.0, 0.2, 3))
    roll = Rotation.from_rotvec([0.0, 0.0, rng.normal(0.0, 0.1)]).as_matrix()
    return Pose(roll, np.zeros(3)) @ level


Placed = Callable[[FloatArray], FloatArray]
"""The targets (f, k, 3) of the object, in the world, at times (f,)."""


def _random(it: Kind, rng: np.random.Generator) -> Placed:
    """At random places, in random directions; a board faces the cameras more or less."""
    middle = rng.uniform([-1.2, -0.9, -1.2], [1.2, 0.9, 1.2], (it.frames, 3))
    turns = Rotation.random(it.frames, rng).as_matrix()
    if it.object.board is not None:
        turns = Rotation.from_euler(
            "xyz", rng.uniform([-0.6, -0.6, -0.5], [0.6, 0.6, 0.5], (it.frames, 3))
        ).as_matrix()
    own = it.object.points - it.object.points.mean(axis=0)
    placed = middle[:, None] + np.einsum("fij,kj->fki", turns, own)
    return lambda times: placed[times.astype(int)]


def _waved(it: Kind, rng: np.random.Generator) -> Placed:
    """Along a smooth path."""
    period, phase = rng.uniform(15.0, 40.0, 7), rng.uniform(0.0, 6.0, 7)
    own = it.object.points[:, 0] - it.object.points[:, 0].mean()

    def placed(times: FloatArray) -> FloatArray:
        wave = np.sin(2 * np.pi * times[:, None] / period / 2 + phase)
        along = np.column_stack([wave[:, 3] + 0.3, wave[:, 4], wave[:, 5] * wave[:, 6]])
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        middle = wave[:, :3] * [1.2, 0.9, 1.2]
        return np.asarray(middle[:, None] + own[:, None] * along[:, None])

    return placed


def _one(recording: Recording, rng: np.random.Generator) -> int:
    return [*recording.cameras].index(one_of(recording.cameras, rng))


def _two(recording: Recording, rng: np.random.Generator) -> tuple[str, str]:
    """Two cameras that share frames."""
    names, first = list(recording.cameras), int(rng.integers(len(recording.cameras) - 1))
    return names[first], names[first + 1]


def of_one(change: Callable[[FloatArray, Camera], FloatArray]) -> Change:
    """The points of one camera changed."""
    return lambda recording, rng: with_pixels(recording, [one_of(recording.cameras, rng)], change)


def of_all(change: Callable[[FloatArray, Camera], FloatArray]) -> Change:
    """The points of all cameras changed."""
    return lambda recording, _: with_pixels(recording, recording.cameras, change)


def points_exchanged(recording: Recording, rng: np.random.Generator) -> Recording:
    a, b = (list(recording.cameras).index(name) for name in _two(recording, rng))
    camera = recording.camera.copy()
    camera[recording.camera == a], camera[recording.camera == b] = b, a
    return replace(recording, camera=camera)


def joined(*parts: Recording) -> Recording:
    """All points of several recordings of the same cameras."""
    columns = ("frame", "camera", "target", "points", "sigma_px")
    rows: dict[str, Any] = {
        name: np.concatenate([getattr(each, name) for each in parts]) for name in columns
    }
    return replace(parts[0], **rows)


def points_twice(recording: Recording, rng: np.random.Generator) -> Recording:
    """The points of a camera are given for another one too."""
    a, b = (list(recording.cameras).index(name) for name in _two(recording, rng))
    own = recording.where(recording.camera == a)
    again = replace(own, camera=np.full(len(own.frame), b))
    return joined(recording.where(recording.camera != b), again)


def cropped(recording: Recording, rng: np.random.Generator) -> Recording:
    """An eighth of the columns and rows of one camera was cut off on the left and above."""
    number = _one(recording, rng)
    cut = np.array([*recording.cameras.values()][number].image_size) / 8
    own = recording.camera == number
    kept = recording.where(np.asarray(~own | (recording.points > cut).all(axis=1)))
    return with_pixels(kept, [[*recording.cameras][number]], lambda points, _: points - cut)


def reordered(order: Callable[[list[int], np.random.Generator], list[int]]) -> Change:
    """The frames of one camera in another order."""

    def changed(recording: Recording, rng: np.random.Generator) -> Recording:
        own, frame = recording.camera == _one(recording, rng), recording.frame.copy()
        frames = np.unique(frame).tolist()
        other = dict(zip(frames, order(frames, rng), strict=True))
        frame[own] = [other[each] for each in frame[own].tolist()]
        return replace(recording, frame=frame)

    return changed


def one_later(frames: list[int], _: np.random.Generator) -> list[int]:
    return [frame + 1 for frame in frames]


def as_words(frames: list[int], _: np.random.Generator) -> list[int]:
    """Counted by their places among 1, 10, 11, ... 2."""
    return [frames[sorted(frames, key=str).index(frame)] for frame in frames]


def in_no_order(frames: list[int], rng: np.random.Generator) -> list[int]:
    return list(rng.permutation(frames).tolist())


def ends_exchanged(recording: Recording, rng: np.random.Generator) -> Recording:
    """The targets of one camera in the reverse order."""
    order = np.arange(len(recording.object.names))[::-1]
    return with_targets(recording, one_of(recording.cameras, rng), order)


def object_times(factor: float) -> Change:
    """The object in another unit."""
    return lambda recording, _: replace(
        recording, object=RigidObject(recording.object.names, factor * recording.object.points)
    )


def with_baseline(truth: SimulatedRig, factor: float) -> Recording:
    """A measured baseline, which may be wrong."""
    length = (truth.poses["c2"] @ truth.poses["c1"].inverse()).baseline
    return replace(truth.recording, baselines_m={("c1", "c2"): factor * length})


def bumped(truth: SimulatedRig, rng: np.random.Generator, degrees: float) -> Recording:
    """One camera turned from half-way on."""
    rows = truth.recording
    name = [*rows.cameras][_one(rows, rng)]
    return bumped_from(truth, name, degrees, int(rows.frame.max() // 2))


def bumped_from(truth: SimulatedRig, name: str, degrees: float, frame: int) -> Recording:
    """One camera turned from a frame on; points that leave its image are lost."""
    rows, camera = truth.recording, truth.cameras[name]
    after = (rows.camera == [*truth.cameras].index(name)) & (rows.frame >= frame)
    turn = Rotation.from_rotvec(np.radians(degrees) * np.array([0.5, 0.8, 0.3])).as_matrix()
    rays = np.column_stack([camera.undistort(rows.points[after]), np.ones(after.sum())]) @ turn.T
    points = rows.points.copy()
    points[after] = camera.distort(rays[:, :2] / rays[:, 2:])
    inside = ((points > 0) & (points < np.array(camera.image_size) - 1)).all(axis=1)
    return replace(rows, points=points).where(np.asarray(inside | ~after))


def changed(change: Change, kind: str, number: int) -> Recording:
    """A recording with something changed."""
    truth, rng = sound(kind, number)
    return change(truth.recording, rng)


MISTAKES: Mapping[str, Callable[[str, int], Recording]] = {
    "files exchanged": partial(changed, files_exchanged),
    "points exchanged": partial(changed, points_exchanged),
    "one file for all": partial(changed, one_file_for_all),
    "points twice": partial(changed, points_twice),
    "one mirrored": partial(changed, of_one(from_the_right)),
    "one from below": partial(changed, of_one(from_below)),
    "one upside down": partial(changed, of_one(upside_down)),
    "one half size": partial(changed, of_one(lambda points, _: 0.5 * points)),
    "all at 75 %": partial(changed, of_all(lambda points, _: 0.75 * points)),
    "all mirrored": partial(changed, of_all(from_the_right)),
    "all from below": partial(changed, of_all(from_below)),
    "K of half size": partial(changed, of_lenses(partial(scaled, factor=0.5))),
    "K of half size in all": partial(changed, of_lenses(partial(scaled, factor=0.5), True)),
    "K of twice the size": partial(changed, of_lenses(partial(scaled, factor=2.0))),
    "distortion of all negative": partial(changed, of_lenses(flipped, True)),
    "u and v exchanged": partial(changed, of_one(lambda points, _: points[:, ::-1])),
    "all upside down": partial(changed, of_all(upside_down)),
    "a crop": partial(changed, cropped),
    "another zoom": partial(changed, zoomed(0.3)),
    "negative distortion": partial(changed, of_lenses(flipped)),
    "ends exchanged": partial(changed, ends_exchanged),
    "frames shifted by one": partial(changed, reordered(one_later)),
    "frames backwards": partial(changed, reordered(lambda frames, _: frames[::-1])),
    "frames as words": partial(changed, reordered(as_words)),
    "frames in no order": partial(changed, reordered(in_no_order)),
    "object in cm": partial(changed, object_times(100.0)),
    "object in mm": partial(changed, object_times(1000.0)),
    "object in cm, baseline": lambda kind, number: object_times(100.0)(
        with_baseline(sound(kind, number)[0], 1.0), np.random.default_rng(0)
    ),
    "bar 5 % too long, baseline": lambda kind, number: object_times(1.05)(
        with_baseline(sound(kind, number)[0], 1.0), np.random.default_rng(0)
    ),
    "baseline 5 % too long": lambda kind, number: with_baseline(sound(kind, number)[0], 1.05),
    "half a frame late": lambda kind, number: late(kind, number, 0.5).recording,
    "moved by 2 degrees": lambda kind, number: bumped(*sound(kind, number), 2.0),
}
