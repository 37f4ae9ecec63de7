"""What goes wrong with a board before two cameras, one thing at a time."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.simulation.simulate import lens_off_by
from tests.rigs.board_pairs import BoardPair
from tests.rigs.mistakes import flipped, scaled
from tests.rigs.pair_mistakes import from_below, from_the_right, lexical

Spoil = Callable[[BoardPair, np.random.Generator], BoardPair]


@dataclass(frozen=True)
class BoardMistake:
    """What was done to a sound pair, and words that name it, in lower case."""

    spoil: Spoil
    words: tuple[str, ...]
    needs_truth: bool = False


def _grid(pair: BoardPair) -> IntArray:
    return np.arange(pair.points.shape[1]).reshape(pair.board.rows, pair.board.columns)


def stated_as(pair: BoardPair, columns: int, rows: int) -> BoardPair:
    """The board stated with other numbers of corners; the table is as it was."""
    points = pair.points[:, : columns * rows]
    return replace(pair, board=replace(pair.board, columns=columns, rows=rows), points=points)


def numbered(pair: BoardPair, order: IntArray, cameras: tuple[int, ...]) -> BoardPair:
    """The corners of some cameras under other numbers."""
    points = pair.points.copy()
    for camera in cameras:
        points[:, :, camera] = pair.points[:, order.ravel(), camera]
    return replace(pair, points=points)


def _one(rng: np.random.Generator) -> int:
    return int(rng.integers(2))


def with_pixels(
    pair: BoardPair, cameras: tuple[int, ...], change: Callable[[FloatArray, Camera], FloatArray]
) -> BoardPair:
    """The points (n, 2) of some cameras changed; frames that leave an image are lost."""
    points = pair.points.copy()
    for camera in cameras:
        own = points[:, :, camera]
        own[:] = change(own.reshape(-1, 2), pair.cameras[camera]).reshape(own.shape)
    sizes = np.array([camera.image_size for camera in pair.cameras])
    inside = ~((points < 0) | (points > sizes - 1)).any(axis=(1, 2, 3))
    return replace(pair, points=points[inside])


def images_mirrored(pair: BoardPair, cameras: tuple[int, ...]) -> BoardPair:
    return with_pixels(pair, cameras, from_the_right)


def copied(pair: BoardPair, rng: np.random.Generator, share: float) -> BoardPair:
    """A share of the frames of one camera are others of its frames, saved once more."""
    camera, count = _one(rng), round(share * len(pair.points))
    order, points = rng.permutation(len(pair.points)), pair.points.copy()
    points[order[:count], :, camera] = points[rng.choice(order[count:], count), :, camera]
    return replace(pair, points=points)


def reordered(pair: BoardPair, rng: np.random.Generator, places: list[int]) -> BoardPair:
    """The frames of one camera in other places."""
    camera, count = _one(rng), len(pair.points)
    order = np.array(places)
    kept = (order >= 0) & (order < count)
    points = pair.points.copy()
    points[:, :, camera] = pair.points[order % count, :, camera]
    return replace(pair, points=points[kept])


def moved(pair: BoardPair, rng: np.random.Generator, degrees: float = 2.0) -> BoardPair:
    """The secondary camera is turned by some degrees before the second half."""
    camera, points, count = pair.cameras[1], pair.points.copy(), len(pair.points)
    if pair.truth is not None:
        camera = pair.truth.secondary
    axis = rng.standard_normal(3)
    turn = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis))
    seen = points[count // 2 :, :, 1]
    rays = camera.undistort(seen.reshape(-1, 2))
    turned = turn.apply(np.column_stack([rays, np.ones(len(rays))]))
    points[count // 2 :, :, 1] = camera.project(turned).reshape(seen.shape)
    size = np.array(camera.image_size)
    inside = ((points[:, :, 1] > 0) & (points[:, :, 1] < size - 1)).all(axis=(1, 2))
    return replace(pair, points=points[inside])


def board_of(pair: BoardPair, scale: FloatArray, second_half: bool = False) -> BoardPair:
    """The printed board is larger by a factor along its columns and rows than is stated; all along
    or in the second half."""
    if pair.truth is None:  # of real corners: the stated board is changed instead
        raise NotImplementedError
    rng = np.random.default_rng(7)
    own = pair.board.points - pair.board.points.mean(axis=0)
    corners = own * np.array([*scale, 1.0])
    points = pair.points.copy()
    for frame, pose in enumerate(pair.placings):
        if second_half and frame < len(points) // 2:
            continue
        at = pose.apply(corners)
        seen = [pair.truth.primary.project(at)]
        seen.append(pair.truth.secondary.project(pair.truth.pose.apply(at)))
        points[frame] = np.stack(seen, axis=1)
        points[frame] += pair.noise_px * rng.standard_normal(points[frame].shape)
    sizes = np.array([camera.image_size for camera in pair.cameras])
    inside = ((points > 0) & (points < sizes - 1)).all(axis=(1, 2, 3))
    return replace(pair, points=points[inside])


def with_files(
    pair: BoardPair, cameras: tuple[int, ...], change: Callable[[Camera], Camera]
) -> BoardPair:
    """Some camera files changed, of which nothing else is known then."""
    files = [
        replace(change(own), uncertainty=None) if number in cameras else own
        for number, own in enumerate(pair.cameras)
    ]
    return replace(pair, cameras=(files[0], files[1]))


def cropped(pair: BoardPair, rng: np.random.Generator) -> BoardPair:
    """A tenth cut off on the left of one camera's images, and an eighteenth above."""
    which = _one(rng)
    width, height = pair.cameras[which].image_size
    points = pair.points.copy()
    points[:, :, which] -= np.array([width // 10, height // 18])
    lost = (points[:, :, which] < 0).any(axis=2)
    points[lost] = np.nan
    return replace(pair, points=points)


def files_exchanged(pair: BoardPair, _: np.random.Generator) -> BoardPair:
    one, two = pair.cameras
    return replace(
        pair,
        cameras=(replace(two, image_size=one.image_size), replace(one, image_size=two.image_size)),
    )


def square_off(pair: BoardPair, _: np.random.Generator) -> BoardPair:
    return replace(pair, board=replace(pair.board, square_m=1.1 * pair.board.square_m))


def file_twice(pair: BoardPair, _: np.random.Generator) -> BoardPair:
    one, two = pair.cameras
    return replace(pair, cameras=(one, replace(one, image_size=two.image_size)))


def _stated(columns: int, rows: int) -> Spoil:
    return lambda p, _: stated_as(p, p.board.columns + columns, p.board.rows + rows)


MISTAKES: Mapping[str, BoardMistake] = {
    "a column too many": BoardMistake(_stated(1, 0), ("columns",)),
    "a column too few": BoardMistake(_stated(-1, 0), ("columns",)),
    "rows and columns exchanged": BoardMistake(
        lambda p, _: stated_as(p, p.board.rows, p.board.columns), ("columns",)
    ),
    "both cameras mirrored": BoardMistake(lambda p, _: images_mirrored(p, (0, 1)), ("mirrored",)),
    "one camera mirrored": BoardMistake(lambda p, r: images_mirrored(p, (_one(r),)), ("mirrored",)),
    "corners of one camera mirrored": BoardMistake(
        lambda p, r: numbered(p, _grid(p)[:, ::-1], (_one(r),)), ("from the other end of each row",)
    ),
    "rows and columns exchanged in one camera": BoardMistake(
        lambda p, r: numbered(p, _grid(p).T, (_one(r),)), ("columns",)
    ),
    "half a turn of one camera": BoardMistake(
        lambda p, r: numbered(p, _grid(p)[::-1, ::-1], (_one(r),)), ("opposite corner",)
    ),
    "stretched by 1.5 %": BoardMistake(
        lambda p, r: board_of(p, np.array([[1.015, 1.0], [1.0, 1.015]][_one(r)])), ("ruler",), True
    ),
    "two boards of different sizes": BoardMistake(
        lambda p, _: board_of(p, np.array([1.2, 1.2]), second_half=True), ("times as large",), True
    ),
    "square 10 % too large": BoardMistake(square_off, ("contradict each other",)),
    "moved half-way": BoardMistake(moved, ("a camera moved",)),
    "frames in the order of words": BoardMistake(
        lambda p, r: reordered(p, r, lexical(len(p.points))), ("order of words",)
    ),
    "frames shifted by one": BoardMistake(
        lambda p, r: reordered(p, r, [k + 1 for k in range(len(p.points))]), ("counted 1 apart",)
    ),
    "K at half size": BoardMistake(
        lambda p, r: with_files(p, (_one(r),), partial(scaled, factor=0.5)),
        ("matrix k", "focal length"),
    ),
    "a crop": BoardMistake(cropped, ("centre", "principal point")),
    "camera files exchanged": BoardMistake(files_exchanged, ("camera files seem to be exchanged",)),
    "one camera from below": BoardMistake(
        lambda p, r: with_pixels(p, (_one(r),), from_below), ("from below",)
    ),
    "both cameras from below": BoardMistake(
        lambda p, _: with_pixels(p, (0, 1), from_below), ("from below", "mirrored")
    ),
    "u and v exchanged in one camera": BoardMistake(
        lambda p, r: with_pixels(p, (_one(r),), lambda points, _: points[:, ::-1]), ("u and v",)
    ),
    "one camera's points of half size": BoardMistake(
        lambda p, r: with_pixels(p, (_one(r),), lambda points, _: 0.5 * points),
        ("images of about",),
    ),
    "all points at 75 %": BoardMistake(
        lambda p, _: with_pixels(p, (0, 1), lambda points, _: 0.75 * points), ("images of about",)
    ),
    "K of both at half size": BoardMistake(
        lambda p, _: with_files(p, (0, 1), partial(scaled, factor=0.5)), ("matrix k", "k seems")
    ),
    "K at twice the size": BoardMistake(
        lambda p, r: with_files(p, (_one(r),), partial(scaled, factor=2.0)), ("matrix k",)
    ),
    "distortion of one camera of the other sign": BoardMistake(
        lambda p, r: with_files(p, (_one(r),), flipped), ("distortion",)
    ),
    "distortion of both of the other sign": BoardMistake(
        lambda p, _: with_files(p, (0, 1), flipped), ("distortion",)
    ),
    "file of another zoom": BoardMistake(
        lambda p, r: with_files(p, (_one(r),), lambda own: lens_off_by(own, 0.5, (0.0, 0.0))),
        ("focal length",),
    ),
    "one file for both cameras": BoardMistake(file_twice, ("same lens",)),
    "frames in no order": BoardMistake(
        lambda p, r: reordered(p, r, r.permutation(len(p.points)).tolist()), ("cannot tell",)
    ),
    "half of the frames copied": BoardMistake(partial(copied, share=0.5), ("exactly those of",)),
}
