"""What goes wrong with a recording of two cameras and a bar, balls or tags, one thing at a time."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.calibration.corrections import scaled
from stereocal.errors import StereocalError
from stereocal.rig.camera import CAMERAS, Camera, LensUncertainty
from stereocal.rig.pair import Pair
from stereocal.system.array_types import FloatArray
from tests.rigs.culprits import OFF, accusations_of, sound, waved
from tests.rigs.mistakes import Change as OfRecording
from tests.rigs.mistakes import (
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
from tests.rigs.spoiled_rigs import ends_exchanged, points_twice

Change = Callable[[Pair, np.random.Generator], Pair]


def in_pair(change: OfRecording) -> Change:
    """A mistake of any recording."""
    return lambda data, rng: change(data.recording, rng).pair(*CAMERAS)


def of_files(change: Callable[[Camera], Camera], every: bool = False) -> Change:
    """The file of one camera, or of both, changed."""
    return in_pair(of_lenses(change, every))


EXCHANGED, ONE_FILE, ANOTHER_ZOOM = map(in_pair, (files_exchanged, one_file_for_all, zoomed(0.5)))


def _points(data: Pair, **changed: FloatArray) -> Pair:
    points: dict[str, Any] = {**changed}
    return data.recording.with_pairs(replace(data.correspondences, **points)).pair(*CAMERAS)


def cropped(data: Pair, rng: np.random.Generator) -> Pair:
    """The outer columns of one camera cut off, an eighth on each side, of which its file tells
    nothing: only bars that are left."""
    which = one_of(CAMERAS, rng)
    width = getattr(data, which).image_size[0]
    points = getattr(data.correspondences, which) - [width / 8, 0.0]
    kept = (points[:, 0] >= 0) & (points[:, 0] <= 0.75 * width - 1)
    frames = data.correspondences.frames
    kept = np.array([kept[data.correspondences.frame == frame].all() for frame in frames])
    return _points(data, **{which: np.maximum(points, -0.5)}).of_frames(frames[kept])


def camera_by_camera(data: Pair, _: np.random.Generator) -> Pair:
    """The columns of a wand table, A and B of each camera, read as both cameras of A and of B."""
    rows = data.correspondences
    a, b = rows.bars.T
    primary, secondary = rows.primary.copy(), rows.secondary.copy()
    secondary[a], primary[b] = rows.primary[b], rows.secondary[a]
    return _points(data, primary=primary, secondary=secondary)


def reordered(order: Callable[[int], list[int]]) -> Change:
    """The frames of one camera in another order, given by their places."""

    def change(data: Pair, rng: np.random.Generator) -> Pair:
        rows, which = data.correspondences, one_of(CAMERAS, rng)
        places = np.array(order(len(rows.frames)))
        points = getattr(rows, which).reshape(len(places), -1, 2)
        changed = _points(data, **{which: points[places % len(points)].reshape(-1, 2)})
        return changed.of_frames(rows.frames[(places >= 0) & (places < len(points))])

    return change


def lexical(count: int) -> list[int]:
    """1, 10, 11, ... 2, 20: the places of frames sorted as words."""
    return sorted(range(count), key=lambda place: str(place + 1))


def slipped(count: int) -> list[int]:
    """One frame less at the start of a camera."""
    return [place + 1 for place in range(count)]


def copied(data: Pair, rng: np.random.Generator, share: float = 0.2) -> Pair:
    """A share of the frames of one camera are others of its frames, saved once more."""
    which, rows = one_of(CAMERAS, rng), data.correspondences
    points = getattr(rows, which).reshape(len(rows.frames), -1, 2).copy()
    count = round(share * len(points))
    order = rng.permutation(len(points))
    points[order[:count]] = points[rng.choice(order[count:], count)]
    return _points(data, **{which: points.reshape(-1, 2)})


def unrelated(data: Pair, rng: np.random.Generator) -> Pair:
    """The frames of one camera in no order: nothing given otherwise would fit."""
    return reordered(lambda count: rng.permutation(count).tolist())(data, rng)


def of_points(change: Callable[[FloatArray, Camera], FloatArray], both: bool = False) -> Change:
    """The points of one camera, or of both, changed; frames that leave the image are lost."""

    def changed(data: Pair, rng: np.random.Generator) -> Pair:
        rows, points = data.correspondences, dict[str, FloatArray]()
        lost = np.zeros(len(rows), dtype=bool)
        for which in CAMERAS if both else [one_of(CAMERAS, rng)]:
            camera = getattr(data, which)
            own = change(getattr(rows, which), camera)
            lost |= ~((own >= 0) & (own <= np.array(camera.image_size) - 1)).all(axis=1)
            points[which] = np.where(lost[:, None], 0.0, own)
        kept = np.setdiff1d(rows.frames, rows.frame[lost])
        return _points(data, **points).of_frames(kept)

    return changed


def lengths(baseline: float = 1.0, bar: float = 1.0) -> Change:
    """Lengths stated so many times too large."""
    return lambda data, _: data.changed(
        baseline_m=baseline * data.baseline_m, target_distance_m=bar * data.target_distance_m
    )


def _known(data: Pair) -> Pair:
    """The data set with the uncertainties of its lenses."""
    lenses: dict[str, Any] = {}
    for which in CAMERAS:
        camera = getattr(data, which)
        focal, k = OFF.focal * camera.K[0, 0], np.zeros(len(camera.distortion))
        sigma = LensUncertainty(focal, focal, OFF.centre_px, OFF.centre_px, k)
        lenses[which] = replace(camera, uncertainty=sigma)
    return data.changed(**lenses)


def sure(change: Change) -> Change:
    """What is stated with its uncertainties, of which the change takes no account."""

    def changed(data: Pair, rng: np.random.Generator) -> Pair:
        sigmas: dict[str, Any] = {"baseline_sigma_m": 1e-3, "target_distance_sigma_m": OFF.bar_m}
        return replace(change(_known(data), rng), **sigmas)

    return changed


def moved(data: Pair, rng: np.random.Generator, degrees: float = 2.0) -> Pair:
    """One camera turned from the middle on."""
    which, axis = one_of(CAMERAS, rng), rng.standard_normal(3)
    turn = np.radians(degrees) * axis / np.linalg.norm(axis)
    return turned_after(data, which, turn, float(np.median(data.correspondences.frames)))


def turned_after(data: Pair, which: str, turn: FloatArray, frame: float) -> Pair:
    """One camera turned about its centre after a frame."""

    def turned(points: FloatArray, camera: Camera) -> FloatArray:
        rays = np.column_stack([camera.undistort(points), np.ones(len(points))])
        seen = camera.project(Rotation.from_rotvec(turn).apply(rays))
        return np.where(data.correspondences.frame[:, None] > frame, seen, points)

    only = of_points(turned)
    return only(data, np.random.default_rng(0 if which == "primary" else 3))


def another_bar(data: Pair, _: np.random.Generator) -> Pair:
    """In the second half the stated length is that of another bar, 1.2 times as long."""
    rows = data.correspondences
    later = rows.frame > np.median(rows.frames)
    lengths_m = data.target_distance_m * np.where(later, 1.2, 1.0)
    return data.changed(correspondences=replace(rows, distance_m=lengths_m))


@dataclass(frozen=True)
class Mistake:
    """What is wrong, and the words that name it; one of them must stand in what is said."""

    change: Change | None
    names: tuple[str, ...]
    frames: int | None = None
    kinds: tuple[str, ...] = ("unlike cameras", "like cameras", "wide, 90 degrees")
    every: int = 1
    """Without a change: of a waved bar, 0.3 frames late."""
    harmless: bool = False
    """Whether lengths stay right, measured in images that are spoiled in the same way."""

    def data(self, number: int, kind: str | None = None) -> Pair:
        """A recording with the mistake.

        Raises:
            StereocalError: the data set is impossible.
        """
        if self.change is None:
            return waved(number, 0.3, self.every, kind)
        of_kind = kind or self.kinds[number % len(self.kinds)]
        _, data, rng = sound(of_kind, number, self.frames)
        return self.change(data, rng)

    def said(self, number: int, kind: str | None = None, apart: bool = False) -> tuple[str, ...]:
        """What is said of a recording with the mistake.

        Args:
            apart: whether its frames are said to lie apart in time, as photographs do.
        """
        try:
            data = self.data(number, kind)
            rows = data.correspondences
            late = replace(rows, time_frame=10 * rows.time_frame) if apart else rows
            return accusations_of(data.changed(correspondences=late))
        except StereocalError as error:
            return (str(error),)

    def named(self, number: int, apart: bool = False) -> bool:
        """Whether what is said of a recording with the mistake names it."""
        said = " | ".join(self.said(number, apart=apart))
        return any(name in said for name in self.names)


LIKE = "like cameras", "wide, 90 degrees"
"""Images of one size: points of one camera are in those of the other."""
OF_FISHEYES = ("more than 75 degrees",)
"""Of most points: the message names the camera, and asks to check its file."""
UNLIKE = ("unlike cameras",)
FOCAL = "focal length", "primary focal", "secondary focal", "focal lengths"
MISTAKES: Mapping[str, Mistake] = {
    "one camera mirrored": Mistake(of_points(from_the_right), ("mirrored",)),
    "one camera counted from below": Mistake(of_points(from_below), ("from below",)),
    "a crop of an eighth on each side": Mistake(cropped, ("image centre", "principal point"), 70),
    "a wand table camera by camera": Mistake(camera_by_camera, ("camera by camera",), kinds=LIKE),
    "frames in the order of words": Mistake(reordered(lexical), ("order of words",)),
    "one frame less": Mistake(reordered(slipped), ("counted 1 apart",)),
    "a fifth of the frames copied": Mistake(copied, ("copied",)),
    "half of the frames copied": Mistake(partial(copied, share=0.5), ("copied",)),
    "camera files exchanged": Mistake(EXCHANGED, ("exchanged", *OF_FISHEYES), kinds=UNLIKE),
    "file of another zoom": Mistake(ANOTHER_ZOOM, ("focal length",)),
    "0.3 frames late": Mistake(None, ("out of step", "same moment")),
    "0.3 frames late, every tenth frame kept": Mistake(None, ("out of step",), every=10),
    "frames in no order": Mistake(unrelated, ("None of these explains it",)),
    "one camera upside down": Mistake(
        of_points(upside_down), ("mirrored", "from below", "head"), harmless=True
    ),
    "both cameras mirrored": Mistake(
        of_points(from_the_right, True), ("mirrored", "centre"), harmless=True
    ),
    "one camera's points of half size": Mistake(
        of_points(lambda points, _: 0.5 * points), ("images of about", "times as large")
    ),
    "all points at 75 %": Mistake(
        of_points(lambda points, _: 0.75 * points, True), ("images of about", "times as large")
    ),
    "u and v exchanged in one camera": Mistake(
        of_points(lambda points, _: points[:, ::-1]), ("u and v",)
    ),
    "K of half the image": Mistake(
        of_files(partial(scaled, factor=0.5)), ("times as large", "matrix K", *OF_FISHEYES, *FOCAL)
    ),
    "K of twice the image": Mistake(
        of_files(partial(scaled, factor=2.0)), ("times as large", "matrix K", *OF_FISHEYES, *FOCAL)
    ),
    "K of both of half the image": Mistake(
        of_files(partial(scaled, factor=0.5), True), ("matrix K", "K seems", *OF_FISHEYES)
    ),
    "distortion of one camera of the other sign": Mistake(
        of_files(flipped), ("distortion", *OF_FISHEYES)
    ),
    "distortion of both of the other sign": Mistake(
        of_files(flipped, True), ("distortion", *OF_FISHEYES)
    ),
    "focal length 2 % too long": Mistake(sure(in_pair(zoomed(0.02))), FOCAL),
    "baseline 3 % too long": Mistake(sure(lengths(1.03)), ("baseline", "distance")),
    "bar 2 % too long": Mistake(sure(lengths(bar=1.02)), ("baseline", "distance")),
    "baseline in cm": Mistake(lengths(100.0), ("centimetres", "millimetres")),
    "bar in mm": Mistake(lengths(bar=1000.0), ("millimetres",)),
    "one file for both cameras": Mistake(
        ONE_FILE, ("same lens", *OF_FISHEYES, *FOCAL), kinds=UNLIKE
    ),
    "the same points in both cameras": Mistake(in_pair(points_twice), ("same points",), kinds=LIKE),
    "targets exchanged in one camera": Mistake(in_pair(ends_exchanged), ("A and B seem",)),
    "a camera moved half-way": Mistake(moved, ("moved",)),
    "another bar from half-way on": Mistake(another_bar, ("times as l", "another")),
}
