"""Recordings with one thing wrong, on rigs of several kinds, and sound ones of each."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.errors import StereocalError
from stereocal.library.calibrations import calibrate
from stereocal.refined.disagreement import compare_inputs
from stereocal.rig.camera import CAMERAS, Camera, CameraName
from stereocal.rig.compiled import FloatArray
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.rig import Rig
from stereocal.rig.tracks import TimeOffset
from stereocal.simulation.simulate import Scene, lens_off_by, observe, place_bars
from tests.rigs.moving_bar import move_bar, record
from tests.rigs.refined_rigs import Misjudged, misjudged, random_rig

OFF = Misjudged()
SEED = 38
Change = Callable[[Dataset, np.random.Generator], Dataset]


@dataclass(frozen=True)
class Kind:
    """A kind of rig, with the bar and its depths, in metres."""

    cameras: Callable[[np.random.Generator], Rig]
    bar_m: float
    depths_m: tuple[float, float]


def camera(focal: float, k1: float, shift: float = 0.0, width: int = 1920) -> Camera:
    """A camera of 1080 rows whose image was cropped by twice a shift from the left."""
    K = np.array([[focal, 0.0, 966.5 - shift], [0.0, focal, 534.5], [0.0, 0.0, 1.0]])
    return Camera(K, np.array([k1, -0.4 * k1, 5e-4, -4e-4, 0.0]), (width, 1080))


def toed_in(rng: np.random.Generator, one: Camera, two: Camera, m: float, crossing_m: float) -> Rig:
    """Two cameras so many metres apart, whose axes about cross."""
    toe = float(np.arctan2(0.5 * m, crossing_m))
    angles = np.array([2.0 * toe, 0.0, 0.0, toe, 3.1]) + 0.03 * rng.standard_normal(5) * toe
    return Rig(one, two, Pose.from_angles(Angles(*angles.tolist()), m))


def facing(rng: np.random.Generator) -> Rig:
    """Two cameras that look at each other, 6 m apart, up to 3 degrees beside the axis."""
    turn = np.array([0.0, np.pi, 0.0]) + 0.02 * rng.standard_normal(3)
    T = np.array([*(0.15 * rng.standard_normal(2)), 6.0])
    pose = Pose(Rotation.from_rotvec(turn).as_matrix(), T)
    return Rig(camera(1500.0, -0.1), camera(1510.0, -0.1), pose)


KINDS: Mapping[str, Kind] = {
    "unlike cameras": Kind(random_rig, 0.87, (4.0, 10.0)),
    "like cameras": Kind(
        lambda rng: toed_in(rng, camera(1500.0, -0.1), camera(1510.0, -0.1), 1.2, 3.0),
        0.5,
        (1.5, 5.0),
    ),
    "tele, 9 degrees": Kind(
        lambda rng: toed_in(rng, camera(12200.0, -0.1), camera(12260.0, -0.1), 4.0, 22.0),
        1.0,
        (15.0, 30.0),
    ),
    "wide, 90 degrees": Kind(
        lambda rng: toed_in(rng, camera(960.0, -0.2), camera(970.0, -0.2), 1.0, 2.5),
        0.5,
        (1.0, 4.0),
    ),
    "cropped": Kind(
        lambda rng: toed_in(
            rng, camera(1500.0, -0.1, 240.0, 1600), camera(1510.0, -0.1, 180.0, 1560), 1.2, 3.0
        ),
        0.5,
        (1.5, 5.0),
    ),
    "facing each other": Kind(facing, 0.5, (2.0, 4.0)),
}


def sound(
    kind: str, number: int, frames: int = 25, noise_px: float = OFF.noise_px
) -> tuple[Scene, Dataset, np.random.Generator]:
    """The truth of a rig, what is given of it, and more randomness."""
    it, rng = KINDS[kind], np.random.default_rng([number, SEED, [*KINDS].index(kind)])
    scene = place_bars(it.cameras(rng), rng, frames, it.bar_m, it.depths_m)
    nominal = misjudged(scene.rig, it.bar_m, rng, replace(OFF, baseline_m=1e-3))
    return scene, observe(scene, rng, noise_px, f"{kind} {number}", nominal), rng


def _which(rng: np.random.Generator) -> CameraName:
    return CAMERAS[int(rng.integers(2))]


def _points(data: Dataset, **changed: FloatArray) -> Dataset:
    points: dict[str, Any] = {**changed}
    return replace(data, correspondences=replace(data.correspondences, **points))


def mirrored(data: Dataset, rng: np.random.Generator, axis: int = 0) -> Dataset:
    """The columns (0) or rows (1) of one camera counted from the other side."""
    which = _which(rng)
    points = getattr(data.correspondences, which).copy()
    points[:, axis] = getattr(data, which).image_size[axis] - 1 - points[:, axis]
    return _points(data, **{which: points})


def cropped(data: Dataset, rng: np.random.Generator) -> Dataset:
    """The outer columns of one camera cut off, an eighth on each side, of which its file tells
    nothing: only bars that are left."""
    which = _which(rng)
    width = getattr(data, which).image_size[0]
    points = getattr(data.correspondences, which) - [width / 8, 0.0]
    kept = (points[:, 0] >= 0) & (points[:, 0] <= 0.75 * width - 1)
    frames = data.correspondences.frames
    kept = np.array([kept[data.correspondences.frame == frame].all() for frame in frames])
    return _points(data, **{which: np.maximum(points, -0.5)}).of_frames(frames[kept])


def camera_by_camera(data: Dataset, _: np.random.Generator) -> Dataset:
    """The columns of a wand table, A and B of each camera, read as both cameras of A and of B."""
    rows = data.correspondences
    a, b = rows.bars.T
    primary, secondary = rows.primary.copy(), rows.secondary.copy()
    secondary[a], primary[b] = rows.primary[b], rows.secondary[a]
    return _points(data, primary=primary, secondary=secondary)


def reordered(order: Callable[[int], list[int]]) -> Change:
    """The frames of one camera in another order, given by their places."""

    def change(data: Dataset, rng: np.random.Generator) -> Dataset:
        rows, which = data.correspondences, _which(rng)
        places = np.array(order(len(rows.frames)))
        points = getattr(rows, which).reshape(-1, 2, 2)
        changed = _points(data, **{which: points[places % len(points)].reshape(-1, 2)})
        return changed.of_frames(rows.frames[(places >= 0) & (places < len(points))])

    return change


def lexical(count: int) -> list[int]:
    """1, 10, 11, ... 2, 20: the places of frames sorted as words."""
    return sorted(range(count), key=lambda place: str(place + 1))


def slipped(count: int) -> list[int]:
    """One frame less at the start of a camera."""
    return [place + 1 for place in range(count)]


def copied(data: Dataset, rng: np.random.Generator, share: float = 0.2) -> Dataset:
    """A share of the frames of one camera are others of its frames, saved once more."""
    which, rows = _which(rng), data.correspondences
    points = getattr(rows, which).reshape(-1, 2, 2).copy()
    count = round(share * len(points))
    order = rng.permutation(len(points))
    points[order[:count]] = points[rng.choice(order[count:], count)]
    return _points(data, **{which: points.reshape(-1, 2)})


def files_exchanged(data: Dataset, _: np.random.Generator) -> Dataset:
    """The camera files exchanged, with the image sizes where they belong."""
    one, two = data.primary, data.secondary
    return replace(
        data,
        primary=replace(two, image_size=one.image_size),
        secondary=replace(one, image_size=two.image_size),
    )


def zoomed(data: Dataset, rng: np.random.Generator) -> Dataset:
    """The file of one camera is of a focal length half as long again."""
    which = _which(rng)
    lens: dict[str, Any] = {which: lens_off_by(getattr(data, which), 0.5, (0.0, 0.0))}
    return replace(data, **lens)


def unrelated(data: Dataset, rng: np.random.Generator) -> Dataset:
    """The frames of one camera in no order: nothing given otherwise would fit."""
    return reordered(lambda count: rng.permutation(count).tolist())(data, rng)


def waved(number: int, offset: float, every: int = 1) -> Dataset:
    """A waved bar, seen by a secondary camera that is late by a part of a frame.

    Args:
        every: of so many frames one was kept, and numbered by itself.
    """
    kind = [*KINDS][number % 4]
    it, rng = KINDS[kind], np.random.default_rng([number, SEED, 1])
    between = int(rng.choice([12, 20, 30]))
    bar = move_bar(it.cameras(rng), rng, 80 * every, it.bar_m, it.depths_m, between)
    nominal = misjudged(bar.rig, it.bar_m, rng, replace(OFF, baseline_m=1e-3))
    data = record(bar, rng, OFF.noise_px, f"late {number}", TimeOffset(offset), nominal)
    rows = data.correspondences
    kept = rows.where(rows.time_frame % every == 0)
    frame = np.searchsorted(kept.frames, kept.frame) + 1
    return replace(data, correspondences=replace(kept, frame=frame, time_frame=frame))


@dataclass(frozen=True)
class Mistake:
    """What is wrong, and the words that name it; one of them must stand in what is said."""

    change: Change | None
    names: tuple[str, ...]
    frames: int = 25
    kinds: tuple[str, ...] = ("unlike cameras", "like cameras", "wide, 90 degrees")
    every: int = 1
    """Without a change: of a waved bar, 0.3 frames late."""

    def data(self, number: int) -> Dataset:
        """A recording with the mistake."""
        if self.change is None:
            return waved(number, 0.3, self.every)
        _, data, rng = sound(self.kinds[number % len(self.kinds)], number, self.frames)
        return self.change(data, rng)

    def named(self, number: int) -> bool:
        """Whether what is said of a recording with the mistake names it."""
        said = " | ".join(accusations_of(self.data(number)))
        return any(name in said for name in self.names)


LIKE = "like cameras", "wide, 90 degrees"
"""Images of one size: points of one camera are in those of the other."""
MISTAKES: Mapping[str, Mistake] = {
    "one camera mirrored": Mistake(mirrored, ("mirrored",)),
    "one camera counted from below": Mistake(partial(mirrored, axis=1), ("from below",)),
    "a crop of an eighth on each side": Mistake(cropped, ("image centre",), 70),
    "a wand table camera by camera": Mistake(camera_by_camera, ("camera by camera",), kinds=LIKE),
    "frames in the order of words": Mistake(reordered(lexical), ("order of words",)),
    "one frame less": Mistake(reordered(slipped), ("counted 1 apart",)),
    "a fifth of the frames copied": Mistake(copied, ("copied",)),
    "half of the frames copied": Mistake(partial(copied, share=0.5), ("copied",)),
    "camera files exchanged": Mistake(files_exchanged, ("exchanged",), kinds=("unlike cameras",)),
    "file of another zoom": Mistake(zoomed, ("focal length",)),
    "0.3 frames late": Mistake(None, ("out of step", "same moment")),
    "0.3 frames late, every tenth frame kept": Mistake(None, ("out of step",), every=10),
    "frames in no order": Mistake(unrelated, ("cannot tell",)),
}


def accusations_of(data: Dataset) -> tuple[str, ...]:
    """What `calibrate` says, an error or warnings, and the inputs that *What disagrees* accuses."""
    try:
        found = calibrate(data)
    except StereocalError as error:
        return (str(error),)
    inputs = compare_inputs(found.refined).inputs if found.refined else []
    notes = filter(None, [found.screening.time_note])
    return (*notes, *found.warnings, *(item.key for item in inputs if item.accused))
