"""Colour photographs of a bar with a ball at each end, with the true image points of their centres.

Each ball is a Lambertian sphere under one distant light and ambient light. Every pixel of its
surroundings is divided into parts, whose rays meet the sphere or the background, so that outline,
perspective and distortion are exact to a part. Then come blur, photon and read noise, gamma, and
eight bits. Colours are linear, red, green and blue from 0 to 1.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.system.array_types import FloatArray
from tools.photographs.rendering import ray_splines

ColourPicture = npt.NDArray[np.float32]
"""(height, width, 3), linear red, green, blue."""
ColourPhotograph = npt.NDArray[np.uint8]
"""(height, width, 3), blue, green, red, as OpenCV has them."""
Colour = tuple[float, float, float]
RED: Colour = (0.45, 0.03, 0.04)
YELLOW: Colour = (0.60, 0.42, 0.03)
BLUE: Colour = (0.03, 0.10, 0.42)
PARTS = 6
"""Parts of a pixel, each way."""
FULL_WELL_E = 12_000.0
VIVID = 0.25
"""Share of the shapes of a background with saturated colours of any hue."""


@dataclass(frozen=True)
class BallSettings:
    """Light, lens and sensor."""

    light: FloatArray
    """(3,): unit vector towards the light, in the frame of the camera that photographs."""
    direct: float = 0.9
    ambient: float = 0.12
    gloss: float = 0.0
    """Brightness of a highlight."""
    blur_px: float = 1.0
    read_noise: float = 0.004
    gamma: float = 2.2
    """1: a linear camera."""


def photograph_balls(
    camera: Camera,
    background: ColourPicture,
    centres_m: FloatArray,
    radius_m: float,
    colours: tuple[Colour, Colour],
    settings: BallSettings,
    rng: np.random.Generator,
    rod_m: float = 0.0,
) -> ColourPhotograph:
    """Render both balls, the farther one first.

    Args:
        background: (height, width, 3), not changed.
        centres_m: (2, 3) in the camera's frame.
        rod_m: thickness of a grey rod between them; 0 draws none.
    """
    picture = background.copy()
    if rod_m:
        _rod(picture, camera, centres_m, rod_m)
    for which in np.argsort(-centres_m[:, 2]):
        paint_ball(picture, camera, centres_m[which], radius_m, colours[which], settings)
    return expose_colours(picture, settings, rng)


def expose_colours(
    picture: ColourPicture, settings: BallSettings, rng: np.random.Generator
) -> ColourPhotograph:
    """Blur, noise, gamma and eight bits."""
    soft = picture
    if settings.blur_px:
        soft = np.asarray(cv2.GaussianBlur(picture, (0, 0), settings.blur_px), np.float32)
    variance = np.maximum(soft, 0.0) / np.float32(FULL_WELL_E) + np.float32(settings.read_noise**2)
    noisy = soft + np.sqrt(variance) * rng.standard_normal(soft.shape, dtype=np.float32)
    coded = np.clip(noisy, 0.0, 1.0) ** np.float32(1.0 / settings.gamma)
    return np.ascontiguousarray(np.rint(255.0 * coded[:, :, ::-1]).astype(np.uint8))


def paint_ball(
    picture: ColourPicture,
    camera: Camera,
    centre: FloatArray,
    radius: float,
    colour: Colour,
    settings: BallSettings,
) -> None:
    """Paint a ball with its centre (3,) m in the camera's frame over a picture, in place."""
    height, width = picture.shape[:2]
    middle = camera.project(centre[None])[0]
    reach = 1.3 * radius / centre[2] * float(camera.K[0, 0]) + 3.0
    left, top = np.maximum(np.floor(middle - reach), 0).astype(int).tolist()
    right, bottom = np.minimum(np.ceil(middle + reach) + 1, [width, height]).astype(int).tolist()
    if left >= right or top >= bottom:
        return
    at = (np.arange(PARTS) + 0.5) / PARTS - 0.5
    columns = (np.arange(left, right)[:, None] + at).ravel()
    rows = (np.arange(top, bottom)[:, None] + at).ravel()
    splines = ray_splines(camera, columns, rows)
    x, y = (spline(rows, columns) for spline in splines)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    along = rays @ centre
    inside = along**2 - (centre @ centre - radius**2)
    hit = inside > 0
    near = along - np.sqrt(np.maximum(inside, 0.0))
    normal = (rays * near[..., None] - centre) / radius
    lit = settings.ambient + settings.direct * np.maximum(normal @ settings.light, 0.0)
    colours = lit[..., None] * np.asarray(colour)
    if settings.gloss:
        between = settings.light - rays
        between /= np.linalg.norm(between, axis=-1, keepdims=True)
        shine = settings.gloss * np.maximum((normal * between).sum(axis=-1), 0.0) ** 40
        colours += shine[..., None]
    colours[~hit] = 0.0
    shape = (bottom - top, PARTS, right - left, PARTS)
    cover = hit.reshape(shape).mean(axis=(1, 3))[..., None]
    seen = colours.reshape(*shape, 3).mean(axis=(1, 3))
    part = picture[top:bottom, left:right]
    part += (seen - cover * part).astype(np.float32)


def _rod(picture: ColourPicture, camera: Camera, ends: FloatArray, thickness_m: float) -> None:
    """A grey line from ball to ball; its outline is not exact, and need not be."""
    steps = np.linspace(0.0, 1.0, 24)[:, None]
    points = camera.project(ends[0] + steps * (ends[1] - ends[0]))
    wide = max(1, round(thickness_m * float(camera.K[0, 0]) / float(ends[:, 2].mean())))
    line = np.rint(points * 16).astype(np.int32)[:, None]
    cv2.polylines(picture, [line], False, (0.12, 0.12, 0.13), wide, cv2.LINE_AA, 4)


def clutter(
    size: tuple[int, int], rng: np.random.Generator, shapes: int = 90, grain: float = 0.25
) -> ColourPicture:
    """A background (width, height) of blotches, plates, poles and leaves of all colours; the grain
    is the strength of its fine texture."""
    width, height = size
    small = rng.uniform(0.05, 0.45, (6, 8, 1)) + rng.normal(0.0, 0.02, (6, 8, 3))
    picture = cv2.resize(small.astype(np.float32), size, interpolation=cv2.INTER_CUBIC)
    for _ in range(shapes):
        colour = _any_colour(rng, rng.random() < VIVID)
        middle = tuple(int(v) for v in rng.uniform((0, 0), (width, height)))
        long = float(np.exp(rng.uniform(np.log(4), np.log(0.22 * width))))
        kind = rng.integers(3)
        turn = float(rng.uniform(0, 180))
        if kind == 0:
            axes = int(long / 2) + 1, int(long * rng.uniform(0.1, 0.6) / 2) + 1
            cv2.ellipse(picture, middle, axes, turn, 0, 360, colour, -1, cv2.LINE_AA)
        elif kind == 1:
            box = cv2.boxPoints((middle, (long, long * float(rng.uniform(0.15, 1.0))), turn))
            cv2.fillPoly(picture, [np.asarray(box, np.int32)], colour, cv2.LINE_AA)
        else:
            spread = rng.normal(0.0, 0.4 * long, (int(rng.integers(4, 7)), 2))
            cv2.fillPoly(picture, [np.asarray(middle + spread, np.int32)], colour, cv2.LINE_AA)
    noise = cv2.GaussianBlur(rng.standard_normal((height, width), np.float32), (0, 0), 1.5)
    return np.clip(picture * (1.0 + grain * noise[..., None]), 0.0, 1.0).astype(np.float32)


def _any_colour(rng: np.random.Generator, vivid: bool) -> Colour:
    grey = float(rng.uniform(0.03, 0.7))
    if not vivid:
        r, g, b = np.clip(grey * (1.0 + rng.normal(0.0, 0.12, 3)), 0.0, 1.0).tolist()
        return r, g, b
    hue = float(rng.uniform(0, 360))
    hsv = np.array([[[hue, rng.uniform(0.4, 0.95), rng.uniform(0.15, 0.8)]]], np.float32)
    r, g, b = cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)[0, 0].tolist()
    return r, g, b


def side_light(
    rng: np.random.Generator, least_deg: float = 60.0, most_deg: float = 90.0
) -> FloatArray:
    """A unit vector towards a light from the side, this far from the direction to the camera."""
    away, around = np.deg2rad(rng.uniform(least_deg, most_deg)), rng.uniform(-np.pi, np.pi)
    return np.array([np.sin(away) * np.cos(around), np.sin(away) * np.sin(around), -np.cos(away)])


def seen_by(light: FloatArray, camera_from_here: Pose) -> FloatArray:
    """The direction (3,) in a camera's frame."""
    return np.asarray(camera_from_here.R @ light)
