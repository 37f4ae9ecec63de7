"""One thing wrong with a recording: the mistakes that the program names, and gross errors.

Those of `MISTAKES` are what the readings of `stereocal.calibration.mistakes`, of fitted values and
of lengths undo. Each takes a recording of two cameras or of more, of a bar, a wand or a board.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.calibration.corrections import (
    scaled,
    with_changed,
    with_files,
    with_frames,
    with_pixels,
    with_targets,
)
from stereocal.errors import StereocalError
from stereocal.rig.camera import CAMERAS, Camera, LensUncertainty
from stereocal.rig.geometry import homogeneous
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import BoardPattern, RigidObject
from stereocal.simulation.rigs import SimulatedRig
from stereocal.simulation.simulate import Scene, lens_off_by
from stereocal.system.array_types import BoolArray, FloatArray, IntArray
from tests.rigs.board_pairs import BoardPair, board_of
from tests.rigs.culprits import accusations_of
from tests.rigs.culprits import sound as sound_bars
from tests.rigs.culprits import waved as waved_bars
from tests.rigs.refined_rigs import Misjudged, random_scene, stated
from tests.rigs.several_cameras import late
from tests.rigs.several_cameras import sound as sound_rig

KNOWN = Misjudged()
SEED = 71
SLIPS_PX = (20.0, 100.0)
BAD_POINTS = 0.3


def rig(number: int) -> tuple[Scene, Pair, np.random.Generator]:
    """Rig number so and so: its truth, its data set with stated uncertainties, more randomness."""
    rng = np.random.default_rng([number, SEED])
    scene = random_scene(rng)
    data = stated(scene, rng, KNOWN)
    sigma_m, bar_sigma_m = KNOWN.baseline_m, KNOWN.bar_m
    data = data.changed(baseline_sigma_m=sigma_m, target_distance_sigma_m=bar_sigma_m)
    return scene, data, rng


def with_frames_exchanged(
    data: Pair, rng: np.random.Generator, count: int
) -> tuple[Pair, tuple[int, ...]]:
    """A and B exchanged in one camera, drawn by chance, in so many frames; and these frames."""
    rows = data.correspondences
    images = rows.primary.copy(), rows.secondary.copy()
    bad = rng.choice(len(rows.bars), count, replace=False)
    for bar in bad:
        a, b = rows.bars[bar]
        image = images[int(rng.integers(2))]
        image[[a, b]] = image[[b, a]]
    changed = replace(rows, primary=images[0], secondary=images[1])
    frames = sorted(int(frame) for frame in rows.frame[rows.bars[bad, 0]])
    return data.changed(correspondences=changed), tuple(frames)


def with_points_off(data: Pair, rng: np.random.Generator) -> tuple[Pair, tuple[int, ...]]:
    """`BAD_POINTS` of the points off by 20 to 100 px in one image; and the frames that have one."""
    rows = data.correspondences
    images = rows.primary.copy(), rows.secondary.copy()
    sizes = data.primary.image_size, data.secondary.image_size
    bad = rng.choice(len(rows), round(BAD_POINTS * len(rows)), replace=False)
    for row in bad:
        which = int(rng.integers(2))
        largest = np.array(sizes[which]) - 1.0
        while True:
            angle = rng.uniform(0.0, 2 * np.pi)
            slip = rng.uniform(*SLIPS_PX) * np.array([np.cos(angle), np.sin(angle)])
            moved = images[which][row] + slip
            if ((moved >= 0) & (moved <= largest)).all():
                images[which][row] = moved
                break
    changed = replace(rows, primary=images[0], secondary=images[1])
    return data.changed(correspondences=changed), tuple(sorted({int(f) for f in rows.frame[bad]}))


def misplaced(data: Pair, rows: Any, by: Any) -> Pair:
    """Points of the secondary camera, in some rows, off by so many pixels."""
    secondary = data.correspondences.secondary.copy()
    secondary[rows] += by
    return data.changed(correspondences=replace(data.correspondences, secondary=secondary))


Change = Callable[[Recording, np.random.Generator], Recording]
OfPoints = Callable[[FloatArray, Camera], FloatArray]


def flipped(camera: Camera) -> Camera:
    """The lens with all distortion of the other sign."""
    return replace(camera, distortion=-camera.distortion)


def upside_down(points: FloatArray, camera: Camera) -> FloatArray:
    """Images of a camera that stood on its head, turned by the program that recorded them."""
    return np.array(camera.image_size) - 1.0 - points


def from_the_right(points: FloatArray, camera: Camera) -> FloatArray:
    """u counted from the right."""
    return np.column_stack([camera.image_size[0] - 1 - points[:, 0], points[:, 1]])


def from_below(points: FloatArray, camera: Camera) -> FloatArray:
    """v counted from below."""
    return np.column_stack([points[:, 0], camera.image_size[1] - 1 - points[:, 1]])


def undistorted(points: FloatArray, camera: Camera) -> FloatArray:
    """In images of which the distortion was taken out."""
    return np.asarray(homogeneous(camera.undistort(points)) @ camera.K[:2].T)


def transposed(points: FloatArray, _: Camera) -> FloatArray:
    """u and v exchanged."""
    return points[:, ::-1]


def one_of(names: Iterable[str], rng: np.random.Generator) -> str:
    """The name of a camera."""
    every = [*names]
    return every[int(rng.integers(len(every)))]


def _one(recording: Recording, rng: np.random.Generator) -> tuple[str, BoolArray]:
    """A camera, and which points are its own."""
    name = one_of(recording.cameras, rng)
    return name, np.asarray(recording.camera == [*recording.cameras].index(name))


def _beside(recording: Recording, rng: np.random.Generator) -> tuple[str, str]:
    """Two cameras beside each other."""
    first = int(rng.integers(len(recording.cameras) - 1))
    one, two = [*recording.cameras][first : first + 2]
    return one, two


def in_images(recording: Recording) -> Recording:
    """Without the frames of a camera in which a point is outside its image."""
    sizes = np.array([camera.image_size for camera in recording.cameras.values()])
    points, image = recording.points, recording.frame * len(sizes) + recording.camera
    outside = ((points < 0) | (points > sizes[recording.camera] - 1)).any(axis=1)
    return recording.where(~np.isin(image, image[outside]))


def of_points(change: OfPoints, every: bool = False) -> Change:
    """The points of one camera, or of all, changed; frames that leave the image are lost."""

    def changed(recording: Recording, rng: np.random.Generator) -> Recording:
        names = [*recording.cameras] if every else [one_of(recording.cameras, rng)]
        return in_images(with_pixels(recording, names, change))

    return changed


def of_lenses(change: Callable[[Camera], Camera], every: bool = False) -> Change:
    """The file of one camera, or of every one, changed."""
    return lambda recording, rng: with_changed(
        recording, recording.cameras if every else [one_of(recording.cameras, rng)], change
    )


def zoomed(factor: float) -> Change:
    """The file of one camera is of a focal length longer by a part of itself."""
    return of_lenses(lambda camera: lens_off_by(camera, factor, (0.0, 0.0)))


def files_exchanged(recording: Recording, rng: np.random.Generator) -> Recording:
    """The files of two cameras exchanged, with the image sizes where they belong."""
    a, b = _beside(recording, rng)
    one, two = recording.cameras[a], recording.cameras[b]
    of_a, of_b = replace(two, image_size=one.image_size), replace(one, image_size=two.image_size)
    return with_files(recording, {a: of_a, b: of_b})


def one_file_for_all(recording: Recording, _: np.random.Generator) -> Recording:
    """The first camera's file for all, with the image sizes where they belong."""
    cameras = recording.cameras
    first = next(iter(cameras.values()))
    return with_changed(recording, cameras, lambda own: replace(first, image_size=own.image_size))


def points_exchanged(recording: Recording, rng: np.random.Generator) -> Recording:
    """The points of two cameras exchanged."""
    a, b = (list(recording.cameras).index(name) for name in _beside(recording, rng))
    camera = recording.camera.copy()
    camera[recording.camera == a], camera[recording.camera == b] = b, a
    return replace(recording, camera=camera)


def joined(*parts: Recording) -> Recording:
    """All points of several recordings of the same cameras."""
    columns = ("frame", "camera", "target", "points", "sigma_px")
    rows: dict[str, Any] = {
        name: np.concatenate([getattr(each, name) for each in parts]) for name in columns
    }
    unknown: dict[str, Any] = dict.fromkeys(("time_frame", "source", "line", "distance_m"))
    return replace(parts[0], **rows, **unknown)


def points_twice(recording: Recording, rng: np.random.Generator) -> Recording:
    """The points of a camera are given for another one too."""
    a, b = (list(recording.cameras).index(name) for name in _beside(recording, rng))
    own = recording.where(recording.camera == a)
    again = replace(own, camera=np.full(len(own.frame), b))
    return joined(recording.where(recording.camera != b), again)


def _less(points: FloatArray, _: Camera, cut: FloatArray) -> FloatArray:
    return points - cut


def cropped(
    left: float, above: float, right: float = 0.0, below: float = 0.0, every: bool = False
) -> Change:
    """Shares of the image of one camera, or of all, cut off, of which its file tells nothing."""

    def changed(recording: Recording, rng: np.random.Generator) -> Recording:
        for name in recording.cameras if every else [one_of(recording.cameras, rng)]:
            own = recording.camera == [*recording.cameras].index(name)
            size = np.array(recording.cameras[name].image_size)
            cut, end = np.array([left, above]) * size, (1.0 - np.array([right, below])) * size - 1.0
            inside = ((recording.points >= cut) & (recording.points <= end)).all(axis=1)
            kept = recording.where(np.asarray(~own | inside))
            recording = with_pixels(kept, [name], partial(_less, cut=cut))
        return recording

    return changed


def reordered(order: Callable[[IntArray, np.random.Generator], IntArray]) -> Change:
    """The frames of one camera in another order, by which comes in the place of each."""

    def changed(recording: Recording, rng: np.random.Generator) -> Recording:
        name, frames = one_of(recording.cameras, rng), np.unique(recording.frame)
        taken = order(frames, rng)
        found = with_frames(recording, name, frames[: len(taken)], taken)
        return replace(found, time_frame=None)

    return changed


def of_count_from_half_way(ahead: int) -> Change:
    """From half-way on, a camera's frames show what others see so many frames later."""

    def changed(recording: Recording, rng: np.random.Generator) -> Recording:
        frames, name = np.unique(recording.frame), one_of(recording.cameras, rng)
        is_own = recording.camera == [*recording.cameras].index(name)
        parts = [recording.where(~is_own)]
        for frame in frames.tolist():
            shown = frame + ahead * (frame >= frames[len(frames) // 2])
            part = recording.where(is_own & (recording.frame == shown))
            parts.append(replace(part, frame=np.full(len(part.frame), frame)))
        return joined(*parts)

    return changed


def as_words(frames: IntArray, _: np.random.Generator) -> IntArray:
    """1, 10, 11, ... 2, 20."""
    return np.array(sorted(frames.tolist(), key=str))


def copied(share: float) -> Change:
    """A share of the frames of one camera are others of its frames, saved once more."""

    def changed(recording: Recording, rng: np.random.Generator) -> Recording:
        _, own = _one(recording, rng)
        frames = rng.permutation(np.unique(recording.frame[own]))
        count = round(share * len(frames))
        copies = []
        for frame, taken in zip(frames[:count], rng.choice(frames[count:], count), strict=True):
            rows = recording.where(np.asarray(own & (recording.frame == taken)))
            copies.append(replace(rows, frame=np.full(len(rows.frame), frame)))
        kept = recording.where(np.asarray(~own | ~np.isin(recording.frame, frames[:count])))
        return joined(kept, *copies)

    return changed


def camera_by_camera(recording: Recording, _: np.random.Generator) -> Recording:
    """The columns of a wand table, A and B of each camera, read as both cameras of A and of B."""
    return replace(recording, camera=recording.target, target=recording.camera)


def ends_exchanged(recording: Recording, rng: np.random.Generator) -> Recording:
    """The targets of one camera in the reverse order."""
    order = np.arange(len(recording.object.names))[::-1]
    return with_targets(recording, one_of(recording.cameras, rng), order)


def numbered(order: Callable[[IntArray], IntArray]) -> Change:
    """The corners of a board under other numbers in one camera."""

    def changed(recording: Recording, rng: np.random.Generator) -> Recording:
        board = recording.object.board
        assert board is not None
        grid = np.arange(len(board.points)).reshape(board.rows, board.columns)
        return with_targets(recording, one_of(recording.cameras, rng), order(grid).ravel())

    return changed


def another_size(change: Callable[[BoardPattern], BoardPattern]) -> Change:
    """The board stated otherwise; the table is as it was."""

    def changed(recording: Recording, _: np.random.Generator) -> Recording:
        assert recording.object.board is not None
        held = RigidObject.of_board(change(recording.object.board))
        return replace(recording, object=held).where(recording.target < len(held.names))

    return changed


def lengths(baseline: float = 1.0, bar: float = 1.0) -> Change:
    """Lengths stated so many times too large."""

    def changed(recording: Recording, _: np.random.Generator) -> Recording:
        held = replace(recording.object, points=bar * recording.object.points)
        measured = {pair: baseline * m for pair, m in recording.baselines_m.items()}
        return replace(recording, object=held, baselines_m=measured)

    return changed


def sure(change: Change) -> Change:
    """What is stated with its uncertainties, of which the change takes no account."""

    def known(camera: Camera) -> Camera:
        focal, k = KNOWN.focal * camera.K[0, 0], np.zeros(len(camera.distortion))
        sigma = LensUncertainty(focal, focal, KNOWN.centre_px, KNOWN.centre_px, k)
        return replace(camera, uncertainty=sigma)

    def changed(recording: Recording, rng: np.random.Generator) -> Recording:
        found = change(with_changed(recording, recording.cameras, known), rng)
        held = replace(found.object, sigma_m=KNOWN.bar_m)
        return replace(found, object=held, baseline_sigma_m=1e-3)

    return changed


def turned(points: FloatArray, camera: Camera, turn: FloatArray) -> FloatArray:
    """Points of a camera that is turned about its centre.

    Args:
        turn: (3,), or (n, 3) of each point: rotation vectors.
    """
    rays = homogeneous(camera.undistort(points))
    return camera.project(Rotation.from_rotvec(turn).apply(rays))


def swaying(degrees: float) -> Change:
    """Every camera turned about its centre in each frame, by angles of this standard deviation."""

    def changed(recording: Recording, rng: np.random.Generator) -> Recording:
        frames, place = np.unique(recording.frame, return_inverse=True)
        points = recording.points.copy()
        for number, camera in enumerate(recording.cameras.values()):
            turns = np.radians(degrees) * rng.standard_normal((len(frames), 3))
            seen = recording.camera == number
            points[seen] = turned(points[seen], camera, turns[place[seen]])
        return in_images(replace(recording, points=points))

    return changed


def another_bar(recording: Recording, _: np.random.Generator) -> Recording:
    """In the second half the stated length is that of another bar, 1.2 times as long."""
    later = recording.frame > np.median(np.unique(recording.frame))
    return replace(recording, distance_m=recording.object.longest_m * np.where(later, 1.2, 1.0))


def turned_from(
    recording: Recording, name: str, turn: FloatArray, frame: float, lens: Camera | None = None
) -> Recording:
    """One camera turned about its centre from a frame on.

    Args:
        turn: (3,): a rotation vector.
        lens: the true one; None: as stated.
    """
    camera = lens or recording.cameras[name]
    after = (recording.camera == [*recording.cameras].index(name)) & (recording.frame >= frame)
    points = recording.points.copy()
    points[after] = turned(points[after], camera, turn)
    return in_images(replace(recording, points=points))


def moved(degrees: float) -> Change:
    """One camera turned from the middle on."""

    def changed(recording: Recording, rng: np.random.Generator) -> Recording:
        name, axis = one_of(recording.cameras, rng), rng.standard_normal(3)
        turn = np.radians(degrees) * axis / np.linalg.norm(axis)
        return turned_from(recording, name, turn, np.median(np.unique(recording.frame)) + 0.5)

    return changed


def bumped_from(truth: SimulatedRig, name: str, degrees: float, frame: int) -> Recording:
    """One camera of a rig turned from a frame on."""
    turn = np.radians(degrees) * np.array([0.5, 0.8, 0.3])
    return turned_from(truth.recording, name, turn, frame, truth.cameras[name])


ALL = BARS, BOARDS, RIGS = "bars", "boards", "rigs"
"""Recordings in which a mistake can be made: of two cameras, and of more."""


@dataclass(frozen=True)
class Mistake:
    """What is wrong, and words that name it, in lower case: one of them must stand in what is said.

    Args:
        of: of `ALL`.
        frames, kinds: of recordings of bars.
        every: of the frames of a bar that is waved, where the second camera is late.
        harmless: whether lengths stay right, measured in images that are spoiled in the same way.
        measured: whether a baseline is measured beside the object.
        printed: another board than is stated, which is seen with the true cameras.
    """

    change: Change | None
    """None: the second camera is late by a part of a frame."""
    words: tuple[str, ...]
    of: tuple[str, ...] = ALL
    frames: int | None = None
    kinds: tuple[str, ...] = ("unlike cameras", "like cameras", "wide, 90 degrees")
    every: int = 1
    harmless: bool = False
    measured: bool = False
    printed: Callable[[BoardPair, np.random.Generator], BoardPair] | None = None

    def of_pair(self, recording: Recording, rng: np.random.Generator) -> Pair:
        """A recording of two cameras with the mistake.

        Raises:
            StereocalError: the data set is impossible.
        """
        assert self.change is not None
        pair = self.change(recording, rng).within_view().pair(*CAMERAS)
        return pair.changed() if recording.baselines_m else pair  # impossible lengths are refused

    def data(self, number: int, kind: str | None = None) -> Pair:
        """A recording of bars with the mistake.

        Raises:
            StereocalError: the data set is impossible.
        """
        if self.change is None:
            return waved_bars(number, 0.3, self.every, kind)
        of_kind = kind or self.kinds[number % len(self.kinds)]
        _, data, rng = sound_bars(of_kind, number, self.frames)
        return self.of_pair(data.recording, rng)

    def of_board(self, pair: BoardPair, rng: np.random.Generator) -> Pair:
        """A recording of boards with the mistake."""
        if self.printed is not None:
            return self.printed(pair, rng).dataset
        return self.of_pair(pair.recording, rng)

    def of_rig(self, kind: str, number: int) -> Recording:
        """A recording of three cameras and more with the mistake."""
        if self.change is None:
            return late(kind, number, 0.5).recording
        truth, rng = sound_rig(kind, number)
        first, second = [*truth.cameras][:2]
        length = (truth.poses[second] @ truth.poses[first].inverse()).baseline
        known = replace(truth.recording, baselines_m={(first, second): length})
        return self.change(known if self.measured else truth.recording, rng)

    def named(self, number: int, apart: bool = False) -> bool:
        """Whether what is said of a recording of bars with the mistake names it.

        Args:
            apart: whether its frames are said to lie apart in time, as photographs do.
        """
        try:
            data = self.data(number)
            rows = data.correspondences
            far = replace(rows, time_frame=10 * rows.time_frame) if apart else rows
            said = " | ".join(accusations_of(data.changed(correspondences=far)))
        except StereocalError as error:
            said = str(error)
        return any(word in said.lower() for word in self.words)


LIKE = "like cameras", "wide, 90 degrees"
"""Images of one size: points of one camera are in those of the other."""
UNLIKE = ("unlike cameras",)
OF_FISHEYES = "more than 75 degrees"
"""Of most points: the message names the camera, and asks to check its file."""
FOCAL = "focal length", "primary focal", "secondary focal", "focal lengths"
OF_SIZE = "times as large", "matrix k", "k seems", OF_FISHEYES
MISTAKES: Mapping[str, Mistake] = {
    # Points of cameras
    "one camera mirrored": Mistake(of_points(from_the_right), ("mirrored",)),
    "one camera counted from below": Mistake(of_points(from_below), ("from below",)),
    "one camera upside down": Mistake(
        of_points(upside_down), ("mirrored", "from below", "head"), (BARS, RIGS), harmless=True
    ),
    "all cameras mirrored": Mistake(
        of_points(from_the_right, True), ("mirrored", "centre"), harmless=True
    ),
    "all cameras counted from below": Mistake(
        of_points(from_below, True), ("from below", "mirrored"), (BOARDS, RIGS)
    ),
    "all cameras upside down": Mistake(of_points(upside_down, True), ("head",), (RIGS,)),
    "one camera's points of half size": Mistake(
        of_points(lambda points, _: 0.5 * points), ("images of about", "times as large")
    ),
    "all points at 75 %": Mistake(
        of_points(lambda points, _: 0.75 * points, True), ("images of about", "times as large")
    ),
    "u and v exchanged in one camera": Mistake(of_points(transposed), ("u and v",)),
    "a crop of an eighth on each side": Mistake(
        cropped(0.125, 0.0, 0.125), ("image centre", "principal point"), (BARS,), 70
    ),
    "a crop": Mistake(cropped(0.125, 0.125), ("centre", "principal point"), (BOARDS, RIGS)),
    "points exchanged": Mistake(points_exchanged, ("exchanged",), (RIGS,)),
    "the same points in two cameras": Mistake(
        points_twice, ("same points",), (BARS, RIGS), kinds=LIKE
    ),
    "a wand table camera by camera": Mistake(
        camera_by_camera, ("camera by camera",), (BARS,), kinds=LIKE
    ),
    "undistorted in one camera": Mistake(of_points(undistorted), ("undistorted",)),
    "undistorted in all cameras": Mistake(of_points(undistorted, True), ("undistorted",)),
    "a crop of an eighth above in all cameras": Mistake(
        cropped(0.0, 0.125, below=0.125, every=True), ("image centre",), (BARS,), 40
    ),
    "a camera moved half-way": Mistake(moved(2.0), ("moved",)),
    "cameras that sway in every frame": Mistake(
        swaying(0.3), ("in every frame",), (BARS, RIGS), 70
    ),
    # Frames
    "0.3 frames late": Mistake(None, ("out of step", "same moment"), (BARS, RIGS)),
    "0.3 frames late, every tenth frame kept": Mistake(None, ("out of step",), (BARS,), every=10),
    "frames in the order of words": Mistake(reordered(as_words), ("order of words",)),
    "one frame less": Mistake(reordered(lambda frames, _: frames[1:]), ("counted 1 apart",)),
    "a frame lost half-way": Mistake(
        of_count_from_half_way(1), ("ahead of", "behind"), (BARS, RIGS), 40
    ),
    "two frames twice half-way": Mistake(
        of_count_from_half_way(-2), ("ahead of", "behind"), (BARS, RIGS), 40
    ),
    "frames backwards": Mistake(reordered(lambda frames, _: frames[::-1]), ("none of",), (RIGS,)),
    "frames in no order": Mistake(
        reordered(lambda frames, rng: rng.permutation(frames)), ("none of these explains it",)
    ),
    "a fifth of the frames copied": Mistake(copied(0.2), ("copied",), (BARS,)),
    "half of the frames copied": Mistake(
        copied(0.5), ("copied", "exactly those of"), (BARS, BOARDS)
    ),
    # Camera files
    "camera files exchanged": Mistake(files_exchanged, ("exchanged", OF_FISHEYES), kinds=UNLIKE),
    "one file for all cameras": Mistake(
        one_file_for_all, ("same lens", OF_FISHEYES, *FOCAL), kinds=UNLIKE
    ),
    "file of another zoom": Mistake(zoomed(0.5), ("focal length",)),
    "K of half the image": Mistake(of_lenses(partial(scaled, factor=0.5)), (*OF_SIZE, *FOCAL)),
    "K of twice the image": Mistake(of_lenses(partial(scaled, factor=2.0)), (*OF_SIZE, *FOCAL)),
    "K of all of half the image": Mistake(of_lenses(partial(scaled, factor=0.5), True), OF_SIZE),
    "distortion of one camera of the other sign": Mistake(
        of_lenses(flipped), ("distortion", OF_FISHEYES)
    ),
    "distortion of all of the other sign": Mistake(
        of_lenses(flipped, True), ("distortion", OF_FISHEYES)
    ),
    "focal length 2 % too long": Mistake(sure(zoomed(0.02)), FOCAL, (BARS,)),
    # The object and lengths
    "targets exchanged in one camera": Mistake(ends_exchanged, ("a and b seem",), (BARS, RIGS)),
    "baseline 3 % too long": Mistake(sure(lengths(1.03)), ("baseline", "distance"), (BARS,)),
    "bar 2 % too long": Mistake(sure(lengths(bar=1.02)), ("baseline", "distance"), (BARS,)),
    "baseline 5 % too long": Mistake(lengths(1.05), ("baseline",), (RIGS,), measured=True),
    "bar 5 % too long": Mistake(lengths(bar=1.05), ("baseline",), (RIGS,), measured=True),
    "baseline in cm": Mistake(lengths(100.0), ("centimetres", "millimetres"), (BARS,)),
    "bar in cm": Mistake(lengths(bar=100.0), ("centimetres",), (RIGS,), measured=True),
    "bar in mm": Mistake(lengths(bar=1000.0), ("millimetres",), (BARS,)),
    "object in cm": Mistake(lengths(bar=100.0), ("metres",), (RIGS,)),
    "object in mm": Mistake(lengths(bar=1000.0), ("metres",), (RIGS,)),
    "another bar from half-way on": Mistake(another_bar, ("times as l", "another"), (BARS,)),
    # Boards
    "a column too many": Mistake(
        another_size(lambda own: replace(own, columns=own.columns + 1)), ("columns",), (BOARDS,)
    ),
    "a column too few": Mistake(
        another_size(lambda own: replace(own, columns=own.columns - 1)), ("columns",), (BOARDS,)
    ),
    "rows and columns exchanged": Mistake(
        another_size(lambda own: replace(own, columns=own.rows, rows=own.columns)),
        ("columns",),
        (BOARDS,),
    ),
    "square 10 % too large": Mistake(
        another_size(lambda own: replace(own, square_m=1.1 * own.square_m)),
        ("contradict each other",),
        (BOARDS,),
        measured=True,
    ),
    "corners of one camera mirrored": Mistake(
        numbered(lambda grid: grid[:, ::-1]), ("from the other end of each row",), (BOARDS,)
    ),
    "corners of one camera from the last row": Mistake(
        numbered(lambda grid: grid[::-1]), ("from the last row",), (BOARDS,)
    ),
    "rows and columns exchanged in one camera": Mistake(
        numbered(np.transpose), ("columns",), (BOARDS,)
    ),
    "half a turn of one camera": Mistake(
        numbered(lambda grid: grid[::-1, ::-1]), ("opposite corner",), (BOARDS,)
    ),
    "stretched by 1.5 %": Mistake(
        None,
        ("ruler",),
        (BOARDS,),
        printed=lambda pair, rng: board_of(pair, [[1.015, 1.0], [1.0, 1.015]][rng.integers(2)]),
    ),
    "two boards of different sizes": Mistake(
        None,
        ("times as large",),
        (BOARDS,),
        printed=lambda pair, _: board_of(pair, [1.2, 1.2], second_half=True),
    ),
}
"""Of what the program names, each once; the docs' tables say which are named in which share."""


def mistakes_of(what: str) -> dict[str, Mistake]:
    """Those that can be made in recordings of `what`."""
    return {name: each for name, each in MISTAKES.items() if what in each.of}
