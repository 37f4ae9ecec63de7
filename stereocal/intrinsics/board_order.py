"""The order of a board's corners in the images of two cameras.

The finder orders the corners by the colours of the squares (`in_board_order`). Where a
board looks the same turned, the two cameras may disagree. Then the geometry decides: with the right
order all boards give one pose of the cameras. The direction of a row in the images does not tell:
one camera may hang upside down.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from stereocal.errors import StereocalError
from stereocal.intrinsics.boards import BoardView
from stereocal.intrinsics.lens_fit import board_pose
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.array_types import FloatArray, IntArray

FITTING_PX = 8.0
"""Median distance of corners from where another board's pose of the cameras puts them, of boards in
the right order. A wrong order gives tens of pixels."""
MOST_HYPOTHESES = 40
ODD = (3, 8, 9, 13)
"""Indices of p2, s1, s2 and tau_y in OpenCV's list of coefficients."""


class SeenBoard(NamedTuple):
    """A board in the photographs of two cameras at one moment."""

    frame: int
    views: tuple[BoardView, BoardView]


def orders_of(pattern: BoardPattern) -> list[IntArray]:
    """Other numbers of the corners with which a board looks the same, each (n,); its own first."""
    grid = np.arange(pattern.rows * pattern.columns).reshape(pattern.rows, pattern.columns)
    turned = [grid]
    if pattern.dictionary is None and (pattern.rows + pattern.columns) % 2 == 0:
        turned.append(grid[::-1, ::-1])
        if pattern.rows == pattern.columns and pattern.rows % 2 == 0:
            turned += [np.rot90(grid), np.rot90(grid, 3)]
    return [order.ravel() for order in turned]


def boards_in_one_order(
    common: Sequence[SeenBoard], cameras: tuple[Camera, Camera], pattern: BoardPattern
) -> list[SeenBoard]:
    """The boards with the corners of the secondary's in the order of the primary's; an error if the
    images of one camera are mirrored."""
    orders = orders_of(pattern)
    errors, chosen = _best_orders(common, cameras, pattern, orders)
    if np.median(errors) > FITTING_PX and len(common) > 2:
        grid = np.arange(len(pattern.points)).reshape(pattern.rows, pattern.columns)
        flipped = [grid[:, ::-1].ravel(), grid[::-1].ravel()]
        mirrored, camera = _mirrored(common, cameras[1])
        if np.median(_best_orders(mirrored, (cameras[0], camera), pattern, flipped)[0]) <= (
            FITTING_PX
        ):
            raise StereocalError(
                "The photographs of one camera are mirrored, left to right: only then do all "
                "boards give one pose of the cameras. Give them as the camera recorded them."
            )
    return [
        SeenBoard(seen.frame, (seen.views[0], _renumbered(seen.views[1], orders[order])))
        for seen, order in zip(common, chosen, strict=True)
    ]


def _mirrored(common: Sequence[SeenBoard], camera: Camera) -> tuple[list[SeenBoard], Camera]:
    """The boards with the secondary camera's images mirrored, left to right, and the camera that
    takes such images.

    u becomes w - 1 - u, where w is the width of the image in pixels, and x on z = 1 becomes -x.
    So fx x + s y + cx keeps its form with the skew -s and w - 1 - cx, and the coefficients `ODD`
    change their signs: p2 stands at r^2 + 2 x^2 in x and at 2 x y in y, s1 and s2 at even powers in
    x alone, and tau_y is a turn about the axis y.
    """
    last_column = camera.image_size[0] - 1.0
    K, distortion = camera.K.copy(), camera.distortion.copy()
    K[0, 1], K[0, 2] = -K[0, 1], last_column - K[0, 2]
    if not camera.is_fisheye:
        distortion[[k for k in ODD if k < len(distortion)]] *= -1.0
    mirrored = []
    for frame, (primary, secondary) in common:
        corners = np.array([last_column, 0.0]) + [-1.0, 1.0] * secondary.corners
        mirrored.append(SeenBoard(frame, (primary, replace(secondary, corners=corners))))
    return mirrored, replace(camera, K=K, distortion=distortion)


def _renumbered(view: BoardView, order: IntArray) -> BoardView:
    return replace(view, ids=order[view.ids])


def _best_orders(
    common: Sequence[SeenBoard],
    cameras: tuple[Camera, Camera],
    pattern: BoardPattern,
    orders: Sequence[IntArray],
) -> tuple[FloatArray, IntArray]:
    """For each board, the distance (px) of its best order from the pose of the cameras that
    explains most boards, and the order's index."""
    candidates = [[_renumbered(seen.views[1], order) for order in orders] for seen in common]
    boards = [_pose(cameras[0], pattern, seen.views[0]) for seen in common]
    every = max(len(common) // MOST_HYPOTHESES, 1)
    best = np.full((len(common), len(orders)), np.inf)
    for renumbered, board in list(zip(candidates, boards, strict=True))[::every]:
        for view in renumbered:
            rig = _pose(cameras[1], pattern, view) @ board.inverse()
            distances = np.array(
                [
                    [_distance_px(cameras[1], pattern, rig @ pose, other) for other in others]
                    for others, pose in zip(candidates, boards, strict=True)
                ]
            )
            if np.median(distances.min(axis=1)) < np.median(best.min(axis=1)):
                best = distances
    return best.min(axis=1), best.argmin(axis=1).astype(np.int64)


def _pose(camera: Camera, pattern: BoardPattern, view: BoardView) -> Pose:
    """`camera_from_board`; behind the camera, where it fits nothing, if the view gives none."""
    pose = board_pose(camera, pattern, view)
    if pose is None:
        return Pose(np.eye(3), np.array([0.0, 0.0, -1.0]))
    return Pose(np.asarray(cv2.Rodrigues(pose[:3])[0], dtype=np.float64), pose[3:])


def _distance_px(camera: Camera, pattern: BoardPattern, pose: Pose, view: BoardView) -> float:
    """Median distance of a board's corners from where a pose puts them; infinite behind it."""
    points, corners = pose.apply(pattern.points[view.ids]), view.corners
    if camera.is_fisheye:
        used = camera.uses(camera.undistort(corners))
        points, corners = points[used], corners[used]
    if not (len(points) and (points[:, 2] > 0).all()):
        return np.inf
    with np.errstate(all="ignore"):  # far outside the image a distortion may have no value
        apart = np.linalg.norm(camera.project(points) - corners, axis=1)
    return float(np.median(np.nan_to_num(apart, nan=np.inf)))
