"""The outline of a ball: a circle in the direction of its centre, fitted to edges around it."""

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from stereocal.detection.ball_colours import Colours
from stereocal.detection.intensity import profiles, steepest
from stereocal.fit.screening.outliers import MAD_TO_SIGMA
from stereocal.rig.camera import Camera
from stereocal.system.array_types import FloatArray

ANGLES_PX, FEWEST_PROFILES, MOST_PROFILES = 1.5, 24, 120
"""Profiles across the outline are so far apart, px; their least and largest number."""
LEAST_REACH_PX = 3.0
ROUNDS, FEWEST_EDGES = 8, 6
REACHES = (0.25, 0.16, 0.12)
"""Reach of the profiles in each round of the fit, in radii."""
LEAST_SIGMA_PX, SHADING_OF_BLUR = 0.005, 0.85
"""In light from the side, shading inside a blurred outline moves it by this times the blur's
variance over the radius; found in renderings with blurs of 0.7 to 1.8 px."""
CODING = (0.96, 0.42)
"""A file does not say whether its grey levels are linear or coded for a screen (gamma 2.2). Coding
moves a blurred edge towards its dark side by `0.96 tanh(0.42 log(ratio of the levels))` sigmas of
the blur: with light from the side, the centre by 0.1 to 0.5 px. The middle is taken, and half the
difference is part of the stated error. In renderings coding moves it by 1.1 times that, but
linear levels differ more and would then have a larger error than coded ones."""
HARMONICS, LOW = np.arange(2, 13), 3
"""Harmonics of the residuals along the rim. The centre's error is their first harmonic, which the
fit takes out of them: from the 5th on they have the power of the edges' own noise, correlated from
edge to edge as it is. The lowest `LOW` have more where stretches of the rim stray together, as they
follow a shadow's border or a thing behind the ball, and the fit gives way to them."""
STRAYED = (4.0, 8.0)
"""What the low harmonics have beyond this times the noise is added, this many times: by chance in
1 of 80 balls. In even light renderings, what they have below that does not move the centre."""
WEAKEST_EDGE = 6.0
"""Grey levels by which the colour changes across an edge."""
STRONG, SHARP = 0.75, 0.25
"""Quantiles of the edges' steps and spreads: what the outline has, where others may be of the
border between day and night on the ball, which is wider and weaker."""
LEAST_STRENGTH, WIDEST, LEAST_SHARPNESS = 0.05, 2.5, 0.01
"""A weight is the square of the step over the strong one, at least the first, at most 1; times
`WIDEST` less the spread over the sharp one, at least the last, at most 1. Measured on the 80 balls
of sample_data/balls: a `WIDEST` of 1.3 weighs the sharp edges alone and moves single centres by 8
px, one of 10 moves them by 0.03 px at most; the other two change nothing at a quarter and four
times as much."""
PER_UNEVENNESS = 10.0
"""One over the resultant of the steps around the rim by their sum at which light counts as from the
side. On the same balls, errors are 0.82 of the stated ones; with 2.5 they are 1.28, with 40 0.75.
"""
FIRST_LIMIT, SCATTERS, LEAST_LIMIT_PX = 0.25, 4.0, 0.8
"""Of Tukey's biweight: at first in radii, then in scatters of the edges, at least in px. Errors of
the same balls are 0.103 px (rms) with these; 0.104 px with a first limit of 0.06 or 1, 0.106 px
with 1 scatter, and 0.177 px with 16."""
LEAST_SEEN = 0.25


@dataclass(frozen=True, eq=False)
class Outline:
    """A fitted outline, in px."""

    centre: FloatArray
    """(2,): the image of the sphere's centre."""
    radius: float
    sigma: float
    """Standard error of one coordinate of the centre."""
    scatter: float
    """Scatter of the edges about the outline."""
    seen: float
    """Part of the outline that fits."""


def fit_outline(
    colours: Colours, middle: tuple[float, float], radius: float, camera: Camera | None
) -> Outline | None:
    """Fit the outline of a ball, from wide profiles to narrow ones.

    Args:
        middle, radius: of a circle around the ball's colour, px.
        camera: its lens shapes the outline; None: a circle in the image.
    """
    first, centre = radius, np.array(middle)
    pad = 1.6 * radius + 4.0
    height, width = colours.shape[:2]
    left, top = (int(max(0, c - pad)) for c in centre)
    right, bottom = int(min(width, centre[0] + pad + 1)), int(min(height, centre[1] + pad + 1))
    part = colours[top:bottom, left:right].astype(np.float32)
    origin = np.array([left, top], dtype=np.float64)
    fitted: Outline | None = None
    for reach in REACHES:
        lens = camera if reach == REACHES[-1] else None
        reach_px = max(LEAST_REACH_PX, reach * radius)
        fitted = _round(part, centre - origin, radius, reach_px, lens, origin)
        if fitted is None or fitted.seen < LEAST_SEEN:
            return None
        if not 0.5 * first < fitted.radius < 1.6 * first:
            return None
        centre, radius = fitted.centre, fitted.radius
    return fitted


def _round(
    part: npt.NDArray[np.float32],
    centre: FloatArray,
    radius: float,
    reach: float,
    camera: Camera | None,
    origin: FloatArray,
) -> Outline | None:
    """One round of the fit, in a part of the photograph at `origin`; `centre` is in the part.

    Of n profiles across the outline, the edge of each (n,) is where its colour changes most along
    the line from the colour inside to the one outside.
    """
    n = int(np.clip(2.0 * math.pi * radius / ANGLES_PX, FEWEST_PROFILES, MOST_PROFILES))
    turn = 2.0 * math.pi * np.arange(n) / n
    normals = np.column_stack([np.cos(turn), np.sin(turn)])
    points = centre + radius * normals
    sampled = [profiles(part[:, :, k], points, normals, reach) for k in range(3)]
    along, colour = sampled[0][0], np.stack([one for _, one in sampled], axis=-1)
    ends = max(2, len(along) // 4)
    inside, outside = colour[:, :ends].mean(axis=1), colour[:, -ends:].mean(axis=1)
    step = inside - outside
    height = np.linalg.norm(step, axis=1)
    # Each profile in the direction of its own change of colour, whatever is behind the ball.
    with np.errstate(invalid="ignore", divide="ignore"):
        grey = (colour * (step / height[:, None])[:, None]).sum(axis=-1)
    away, fall, spread = steepest(along, grey, 2.5)
    good = np.isfinite(away) & (fall > WEAKEST_EDGE)
    if good.sum() < 8:
        return None
    shift = CODING[0] * np.tanh(CODING[1] * np.log((inside + 1.0) / (outside + 1.0)))
    with np.errstate(invalid="ignore", divide="ignore"):
        coded = (step**2 * shift).sum(axis=1) / height**2
    blur = float(np.median(spread[good]))
    coded = 0.5 * math.sqrt(blur) * coded[good]
    strong = float(np.quantile(fall[good], STRONG))
    sharp = float(np.quantile(spread[good], SHARP))
    weight = np.clip(fall[good] / strong, LEAST_STRENGTH, 1.0) ** 2
    weight *= np.clip(WIDEST - spread[good] / sharp, LEAST_SHARPNESS, 1.0)
    edges = origin + points[good] + (away[good] - coded)[:, None] * normals[good]
    fitted = _circle(edges, weight, coded, origin + centre, radius, camera, n)
    uneven = float(np.linalg.norm(fall[good] @ normals[good])) / float(fall[good].sum())
    shading = SHADING_OF_BLUR * blur / radius * min(1.0, PER_UNEVENNESS * uneven) ** 2
    shading = math.hypot(LEAST_SIGMA_PX, shading)
    return fitted and replace(fitted, sigma=math.hypot(fitted.sigma, shading))


def _circle(
    edges: FloatArray,
    weight: FloatArray,
    coded: FloatArray,
    centre: FloatArray,
    radius: float,
    camera: Camera | None,
    n: int,
) -> Outline | None:
    """The outline of a sphere through edges (m, 2) px, found in n profiles, robustly; `coded` (m,)
    is how far the edges may lie farther outside, or inside, px.

    With a lens, edges are taken to the plane across the ray of the centre (`_axes`), where the
    sphere is a circle about it. There the residuals are |edge - middle| - radius, and Gauss and
    Newton's step solves (J^T W J) step = J^T W off with J (m, 3) by the middle and the radius, and
    the weights times Tukey's biweight. The variance of the middle is that of J with the power of
    the residuals' harmonics (`HARMONICS`), and the square of how far `coded` would move it.
    """
    flat = edges - centre
    if camera is not None:
        axes = _axes(camera, centre)
        rays = np.column_stack([camera.undistort(edges), np.ones(len(edges))]) @ axes.T
        scale = math.sqrt(float(camera.K[0, 0] * camera.K[1, 1]))
        flat = scale * rays[:, :2] / rays[:, 2:]
    if not np.isfinite(flat).all():
        return None
    limit, middle = FIRST_LIMIT * radius, np.zeros(2)
    for _ in range(ROUNDS):
        away = flat - middle
        size = np.linalg.norm(away, axis=1)
        off = size - radius
        robust = weight * np.clip(1.0 - (off / limit) ** 2, 0.0, 1.0) ** 2
        if (robust > 0).sum() < FEWEST_EDGES:
            return None
        J = np.column_stack([away / size[:, None], np.ones(len(flat))])
        try:
            inverse = np.linalg.inv(J.T @ (robust[:, None] * J))
        except np.linalg.LinAlgError:
            return None
        step = inverse @ (J.T @ (robust * off))
        middle = middle + step[:2]
        radius += float(step[2])
        limit = max(SCATTERS * MAD_TO_SIGMA * float(np.median(np.abs(off))), LEAST_LIMIT_PX)
    centre = centre + middle
    if camera is not None:
        ray = np.append(middle / scale, 1.0) @ axes
        centre = camera.distort((ray[:2] / ray[2])[None])[0]
    used = robust > 0
    scatter = math.sqrt(float((robust * off**2).sum() / robust.sum()))
    turned = np.arctan2(away[:, 1], away[:, 0])[:, None] * HARMONICS
    waves = np.stack([np.cos(turned), np.sin(turned)])  # (2, m, harmonics)
    # Less what the fit explains of them; their power (2, harmonics) in the residuals.
    waves -= J @ (inverse @ (J.T @ (robust[:, None] * waves)))
    power = ((robust * off) @ waves) ** 2 / (robust @ waves**2 + 1e-9)
    noise, low = (float(part.mean()) for part in np.split(power, [LOW], axis=1)[::-1])
    power_at_first = noise + STRAYED[1] * max(low - STRAYED[0] * noise, 0.0)
    either = inverse @ (J.T @ (robust * coded))
    variance = power_at_first * float(np.trace(inverse[:2, :2])) + float(either[:2] @ either[:2])
    return Outline(centre, radius, math.sqrt(0.5 * variance), scatter, float(used.sum()) / n)


def _axes(camera: Camera, centre: FloatArray) -> FloatArray:
    """(3, 3): a frame that looks at a point of the image; its third axis points there."""
    ray = np.append(camera.undistort(centre[None])[0], 1.0)
    ray /= np.linalg.norm(ray)
    across = np.cross([0.0, 1.0, 0.0], ray)
    across /= np.linalg.norm(across)
    return np.array([across, np.cross(ray, across), ray])
