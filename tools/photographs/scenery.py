"""Paint a scenery as a background: sky, trees, houses, bushes, a fence, grass.

Coordinates are metres on a distant plane; y points down, and y = 0 is the height of the cameras.
Grey levels are 0 to 255.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.system.array_types import FloatArray

Grey = npt.NDArray[np.uint8]

GROUND_M = 1.6
"""Upper edge of the grass: the cameras are this high above the ground."""
SHIFT = 4
"""Fractional bits of coordinates for OpenCV's drawing functions: 1/16 px."""


@dataclass(frozen=True, eq=False)
class Canvas:
    """A picture with its position and resolution."""

    grey: Grey
    left_m: float
    """x of the centre of the first column."""
    top_m: float
    """y of the centre of the first row."""
    pixels_per_m: float

    @property
    def right_m(self) -> float:
        """x of the last column."""
        return self.left_m + (int(self.grey.shape[1]) - 1) / self.pixels_per_m

    def row(self, y_m: float) -> int:
        """The row at a height, clipped to the canvas."""
        row = round((y_m - self.top_m) * self.pixels_per_m)
        return int(np.clip(row, 0, self.grey.shape[0]))

    def fill(self, outline_m: npt.ArrayLike, grey: float) -> None:
        """Draw a polygon (n, 2), antialiased."""
        scale = self.pixels_per_m * 2**SHIFT
        pixels = np.round((np.asarray(outline_m) - [self.left_m, self.top_m]) * scale)
        cv2.fillPoly(self.grey, [pixels.astype(np.int32)], float(grey), cv2.LINE_AA, SHIFT)

    def rectangle(self, left: float, top: float, right: float, bottom: float, grey: float) -> None:
        """Draw an upright rectangle."""
        self.fill([(left, top), (right, top), (right, bottom), (left, bottom)], grey)

    def leaves(
        self,
        centres_m: FloatArray,
        sizes_m: FloatArray,
        greys: FloatArray,
        rng: np.random.Generator,
    ) -> None:
        """Draw n leaves of random directions; centres (n, 2), sizes and grey levels (n,)."""
        shape = [(1.0, 0.0), (0.3, 0.35), (-0.5, 0.3), (-1.0, 0.0), (-0.5, -0.3), (0.3, -0.35)]
        angles = rng.uniform(0.0, 2.0 * np.pi, len(centres_m))
        cos, sin = np.cos(angles), np.sin(angles)
        turns = np.stack([np.stack([cos, sin], -1), np.stack([-sin, cos], -1)], axis=1)
        outlines = centres_m[:, None] + sizes_m[:, None, None] * (np.array(shape) @ turns)
        for outline, grey in zip(outlines, greys, strict=True):
            self.fill(outline, grey)


def paint_scenery(canvas: Canvas, rng: np.random.Generator) -> None:
    """Paint the whole scenery, from far to near."""
    scale, shape = canvas.pixels_per_m, canvas.grey.shape[:2]
    sky = np.linspace(rng.uniform(165.0, 185.0), rng.uniform(205.0, 225.0), shape[0])
    clouds = clouded(shape, rng, 6.0 * scale, 0.5 * scale)
    canvas.grey[:] = np.clip(sky[:, None] + 7.0 * clouds, 0, 255).astype(np.uint8)
    _treeline(canvas, rng)
    span = canvas.right_m - canvas.left_m
    start = canvas.left_m + float(rng.uniform(-0.05, 0.1)) * span
    while start < canvas.right_m:
        width = float(rng.uniform(6.0, 10.0))
        _house(canvas, rng, start, start + width)
        start += width + float(rng.uniform(4.0, 8.0))
    for x in rng.uniform(canvas.left_m, canvas.right_m, max(2, round(span / 7.0))):
        _tree(canvas, rng, float(x))
    _ground(canvas, rng)
    _fence(canvas, rng)
    for x in rng.uniform(canvas.left_m, canvas.right_m, max(3, round(span / 4.0))):
        _bush(canvas, rng, float(x))


def clouded(
    shape: tuple[int, int], rng: np.random.Generator, coarsest_px: float, finest_px: float
) -> npt.NDArray[np.float32]:
    """Smooth noise (height, width) of about unit standard deviation, strongest at coarse scales."""
    noise = np.zeros(shape, dtype=np.float32)
    size, weight, power = coarsest_px, 1.0, 0.0
    while size >= finest_px:
        rows, columns = (max(2, int(np.ceil(side / size)) + 1) for side in shape)
        layer = rng.standard_normal((rows, columns), dtype=np.float32)
        big = cv2.resize(layer, shape[::-1], interpolation=cv2.INTER_LINEAR)
        noise += np.float32(weight) * big
        power += 0.5 * weight**2
        size, weight = size / 2.0, weight * 0.6
    return noise / np.float32(np.sqrt(max(power, 1e-9)))


def _treeline(canvas: Canvas, rng: np.random.Generator) -> None:
    """Distant woods: a dark ragged band above the ground."""
    (height, width), scale = canvas.grey.shape, canvas.pixels_per_m
    ragged = clouded((2, width), rng, 4.0 * scale, 0.05 * scale)[0]
    crowns = (-0.6 + 0.5 * ragged - canvas.top_m) * scale
    texture = clouded((height, width), rng, 0.8 * scale, 0.04 * scale)
    woods = np.clip(92.0 + 13.0 * texture, 0, 255).astype(np.uint8)
    np.copyto(canvas.grey, woods, where=np.arange(height)[:, None] > crowns)


def _house(canvas: Canvas, rng: np.random.Generator, left: float, right: float) -> None:
    """A wall with rows of windows, a roof and a door."""
    top, wall = float(rng.uniform(-3.8, -2.2)), float(rng.uniform(120.0, 185.0))
    eaves, ridge = [(left - 0.4, top), (right + 0.4, top)], [(right - 1.2, top - 1.5)]
    canvas.fill([*eaves, *ridge, (left + 1.2, top - 1.5)], float(rng.uniform(60.0, 100.0)))
    canvas.rectangle(left, top, right, GROUND_M + 0.1, wall)
    for course in np.arange(top, GROUND_M, 0.3):
        canvas.rectangle(left, course, right, course + 0.02, wall - 9.0)
    columns = max(2, int((right - left) / 2.2))
    pitch = (right - left) / columns
    door = int(rng.integers(columns))
    for i in range(columns):
        x = left + (i + 0.5) * pitch
        for sill in np.arange(top + 2.0, GROUND_M - 0.4, 2.6):
            _window(canvas, rng, x, float(sill), wall)
        if i == door:
            canvas.rectangle(x - 0.5, GROUND_M - 2.1, x + 0.5, GROUND_M + 0.1, 70.0)


def _window(canvas: Canvas, rng: np.random.Generator, x: float, sill: float, wall: float) -> None:
    """Four panes, some reflecting the sky, in a light frame."""
    canvas.rectangle(x - 0.6, sill - 1.5, x + 0.6, sill, min(wall + 45.0, 235.0))
    for across in (-0.53, 0.03):
        for up in (1.43, 0.68):
            pane = float(rng.choice([45.0, 60.0, 75.0, 160.0]) + rng.uniform(-12.0, 12.0))
            canvas.rectangle(x + across, sill - up, x + across + 0.5, sill - up + 0.6, pane)
    canvas.rectangle(x - 0.7, sill, x + 0.7, sill + 0.08, wall - 35.0)


def _tree(canvas: Canvas, rng: np.random.Generator, x: float) -> None:
    """A trunk and a crown of leaves."""
    foot, crown = GROUND_M + 0.1, float(rng.uniform(-2.6, -1.4))
    trunk = [(x - 0.09, crown), (x + 0.09, crown), (x + 0.16, foot), (x - 0.16, foot)]
    canvas.fill(trunk, 55.0)
    _foliage(canvas, rng, (x, crown), (1.1, 1.0), 2600)


def _bush(canvas: Canvas, rng: np.random.Generator, x: float) -> None:
    """Leaves above the ground."""
    size = float(rng.uniform(0.5, 1.0))
    _foliage(canvas, rng, (x, GROUND_M + 0.3 - 0.4 * size), (size, 0.6 * size), 900)


def _foliage(
    canvas: Canvas,
    rng: np.random.Generator,
    centre: tuple[float, float],
    spread_m: tuple[float, float],
    count: int,
) -> None:
    """Leaves around a centre: dark ones first, then bright ones over them."""
    radii = np.sqrt(rng.uniform(0.0, 1.2, count)) * (1.0 + 0.15 * rng.standard_normal(count))
    angles = rng.uniform(0.0, 2.0 * np.pi, count)
    offsets = radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    centres = np.array(centre) + offsets * spread_m
    light = np.linspace(-25.0, 45.0, count) - 14.0 * offsets[:, 1]
    greys = np.clip(80.0 + light + rng.normal(0.0, 12.0, count), 20.0, 190.0)
    canvas.leaves(centres, rng.uniform(0.035, 0.09, count), greys, rng)


def _ground(canvas: Canvas, rng: np.random.Generator) -> None:
    """Grass, with more contrast towards the bottom, which is nearer."""
    first = canvas.row(GROUND_M)
    height, width = canvas.grey.shape[0] - first, canvas.grey.shape[1]
    if height < 2:
        return
    scale = canvas.pixels_per_m
    patches = clouded((height, width), rng, 2.0 * scale, 0.3 * scale)
    blades = clouded((height, max(width, 2)), rng, 0.12 * scale, 0.03 * scale)
    upright = np.asarray(cv2.blur(blades, (1, max(3, int(0.15 * scale)))), dtype=np.float32)
    near = np.linspace(0.5, 1.0, height, dtype=np.float32)[:, None]
    grass = 112.0 + 8.0 * patches + 26.0 * near * upright
    canvas.grey[first:] = np.clip(grass, 0, 255).astype(np.uint8)


def _fence(canvas: Canvas, rng: np.random.Generator) -> None:
    """Pickets on two rails along a part of the view."""
    span = canvas.right_m - canvas.left_m
    left = canvas.left_m + float(rng.uniform(0.0, 0.5)) * span
    right = left + float(rng.uniform(0.3, 0.5)) * span
    grey, top, bottom = float(rng.uniform(150.0, 205.0)), GROUND_M - 0.75, GROUND_M + 0.25
    for rail in (top + 0.2, bottom - 0.25):
        canvas.rectangle(left, rail, right, rail + 0.08, grey - 30.0)
    for x in np.arange(left, right, 0.16):
        shade = grey + float(rng.normal(0.0, 6.0))
        picket = [(x, top + 0.06), (x + 0.05, top), (x + 0.1, top + 0.06), (x + 0.1, bottom)]
        canvas.fill([*picket, (x, bottom)], shade)
