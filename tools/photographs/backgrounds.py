"""Backgrounds of photographs: sky, trees, houses with windows, a fence, bushes and grass.

The scenery (`scenery`) is painted on one large upright plane far behind the bar, once for a rig.
Each camera sees it through its own lens, so that both cameras see the same clutter, as outdoors.
It is the same in all frames, because the cameras do not move.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray
from tools.photographs.rendering import (
    HERE,
    Picture,
    Placed,
    blurred,
    chessboard,
    paint,
    pixel_ray,
    ray_splines,
    turned,
)
from tools.photographs.scenery import Canvas, clouded, paint_scenery

WALL_M = 40.0
"""Distance of the painted plane."""
LARGEST_CANVAS_PX = 9000
"""Longest side of the painting; a wide view is painted with a lower resolution."""
WIDEST = 2.0
"""Half width of the painting over its distance; it is mirrored beyond."""
CHESSBOARD_M = 26.0
"""Distance of the chessboard on the grass, behind all positions of the bar."""


def outdoors(
    rig: Rig, rng: np.random.Generator, softness_px: float = 1.5
) -> tuple[Picture, Picture]:
    """Backgrounds of the two cameras, (height, width) grey levels before the optics.

    A chessboard of 6x4 squares lies on the grass, in view of the primary: its corners look like
    targets. The softness is the standard deviation of the defocus blur.
    """
    views = ((rig.primary, HERE), (rig.secondary, rig.pose))
    canvas = _canvas_for(views)
    paint_scenery(canvas, rng)
    lying = lying_chessboard(rig.primary, rng)
    first, second = (blurred(seen_wall(canvas, *view), softness_px) for view in views)
    for picture, (camera, pose) in zip((first, second), views, strict=True):
        paint(picture, camera, lying.seen_from(pose), max(0.5 * softness_px, 0.3))
    return first, second


def indoors(camera: Camera, rng: np.random.Generator) -> Picture:
    """Background of a board in the lab: a defocused wall with shelves and papers."""
    width, height = camera.image_size
    canvas = Canvas(np.zeros((height, width), dtype=np.uint8), 0.0, 0.0, width / 4.0)
    canvas.grey[:] = np.clip(125.0 + 12.0 * clouded((height, width), rng, width / 3, 60.0), 0, 255)
    for x, y in rng.uniform([-0.3, -0.3], [4.0, 4.0 * height / width], (14, 2)):
        right, bottom = np.array([x, y]) + rng.uniform([0.2, 0.1], [1.2, 0.9])
        canvas.rectangle(x, y, right, bottom, float(rng.uniform(50.0, 200.0)))
    return blurred(canvas.grey.astype(np.float32), 6.0)


def seen_wall(canvas: Canvas, camera: Camera, camera_from_primary: Pose) -> Picture:
    """The painted plane as a camera sees it, (height, width); mirrored beyond its edges."""
    width, height = camera.image_size
    x, y = _wall_points(
        camera, camera_from_primary, np.arange(1.0 * width), np.arange(1.0 * height)
    )
    columns = ((x - canvas.left_m) * canvas.pixels_per_m).astype(np.float32)
    rows = ((y - canvas.top_m) * canvas.pixels_per_m).astype(np.float32)
    edges = cv2.BORDER_REFLECT_101
    seen = cv2.remap(canvas.grey, columns, rows, cv2.INTER_LINEAR, borderMode=edges)
    return np.asarray(seen, dtype=np.float32)


def lying_chessboard(camera: Camera, rng: np.random.Generator) -> Placed:
    """A chessboard of 6x4 squares on the ground, in the lower part of a camera's image."""
    width, height = camera.image_size
    pixel = rng.uniform([0.1, 0.8], [0.9, 0.92]) * [width, height]
    spin = float(rng.uniform(-np.pi, np.pi))
    steep = float(rng.uniform(0.7, 1.1))
    R = turned((-steep, 0.0, 0.0)) @ turned((0.0, 0.0, spin))
    black, white = rng.uniform([30.0, 150.0], [60.0, 200.0])
    return Placed(
        chessboard((6, 4), 0.15, black, white), Pose(R, CHESSBOARD_M * pixel_ray(camera, pixel))
    )


def _wall_points(
    camera: Camera, camera_from_primary: Pose, columns: FloatArray, rows: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Intersections of the rays of a pixel grid with the plane: x, y in the primary's frame, m."""
    x, y = (spline(rows, columns) for spline in ray_splines(camera, columns, rows))
    rays = np.stack([x, y, np.ones_like(x)], -1)
    back = camera_from_primary.inverse()
    directions = rays @ back.R.T
    depth = np.maximum(directions[..., 2], 1e-3)
    scale = (WALL_M - back.T[2]) / depth
    limit = WIDEST * WALL_M
    x = np.clip(back.T[0] + scale * directions[..., 0], -limit, limit)
    y = np.clip(back.T[1] + scale * directions[..., 1], -limit, limit)
    return x, y


def _canvas_for(views: Sequence[tuple[Camera, Pose]]) -> Canvas:
    """An empty canvas that covers both views, with the resolution of the cameras if possible."""
    seen = []
    for camera, pose in views:
        grid = (np.linspace(0, n - 1, 33) for n in camera.image_size)
        seen.append(np.stack(_wall_points(camera, pose, *grid), axis=-1).reshape(-1, 2))
    points = np.concatenate(seen)
    low, high = points.min(axis=0), points.max(axis=0)
    finest = max(camera.K[0, 0] for camera, _ in views) / WALL_M
    pixels_per_m = min(finest, LARGEST_CANVAS_PX / float((high - low).max()))
    width, height = (int(side) for side in np.ceil((high - low) * pixels_per_m) + 1)
    grey = np.zeros((height, width), dtype=np.uint8)
    return Canvas(grey, float(low[0]), float(low[1]), float(pixels_per_m))
