"""The vertical from plumb lines, level lines and horizons, by one least squares in pixels.

Seen by a camera, a straight line lies in a plane through the camera's centre. The unknowns are the
vertical; for each level line its direction in the horizontal plane; and for each line in each
camera the turn of its plane about the line's direction. A residual is the distance of an image
point to the image of that plane. So the two images of a line need not show the same points.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stereocal.errors import StereocalError
from stereocal.field.world.adjustment import FEWEST_DEGREES, Blocks, Solution, solve
from stereocal.field.world.frame import (
    CAMERA,
    FEWEST_UPRIGHT,
    LARGEST_TILT,
    VIEW,
    Axes,
    WorldFrame,
    about_noise,
    camera_directions,
    degrees,
    frame_of_up,
    how_cameras_stand,
    uprightness,
)
from stereocal.field.world.noise import Noise, check_inside, noise_of, turns_at, usual_place
from stereocal.field.world.observed import Line, Source
from stereocal.refined.unknowns import rig_errors
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import Rig
from stereocal.system.numbers import rounded

CONTRADICTION = 10.0
"""Residuals over the image noise, above which the lines contradict each other."""
FARTHEST = 1e3
"""Distance over the baseline, beyond which a line's place is unknown."""
MOST_TRIED = 20
"""Lines that are left out one by one to find the one that contradicts the others."""
BENT = 10.0
"""Likewise for the points of one line in one image."""
ADVICE = "Add a plumb line, a second level line in another direction, or a horizon."


@dataclass(frozen=True, eq=False)
class Image:
    """The points of one line in one camera."""

    line: int
    camera: int
    pixels: FloatArray
    """(m, 2) raw."""
    normal: FloatArray
    """(3,) unit normal of the line's plane, in the primary's frame, as the points alone give it."""


@dataclass(frozen=True, eq=False)
class LineFit:
    """The vertical, and the level lines' directions."""

    lines: Sequence[Line]
    up: FloatArray
    """(3,) in the primary's frame."""
    along: dict[str, FloatArray]
    """Directions of the level lines, in the primary's frame."""
    solution: Solution
    turns: FloatArray
    """(2, r): what the parameters' errors do to the vertical, beyond what they do to points."""

    @property
    def bound(self) -> float:
        """Angle that holds the error of the vertical at 95 %, radians."""
        covariance = self.solution.covariance[:2, :2] + self.turns @ self.turns.T
        return self.solution.bound(covariance)


def world_of_lines(
    rig: RigParameters,
    lines: Sequence[Line],
    axes: Axes | None = None,
    sigma_px: float | None = None,
    upside_down: bool = False,
) -> WorldFrame:
    """The world frame with the vertical of plumb lines, level lines and horizons.

    Args:
        sigma_px: noise of an image coordinate; None: as the points scatter about their lines.
        upside_down: whether the cameras hang upside down.
    """
    for line in lines:
        for side, camera, at in zip(
            CAMERAS, (rig.primary, rig.secondary), line.pixels, strict=True
        ):
            check_inside(at, camera.image_size, side, (line.name,) * len(at))
    axes, noise = axes or Axes(), _noise_of_clicks(lines, rig, noise_of(rig, sigma_px))
    images = list(_images(rig, lines, noise))
    fit = _fit(rig, lines, images, noise)
    if fit.solution.widening > CONTRADICTION:
        _refuse_contradiction(rig, lines, images, noise, fit)
    if not fit.bound < LARGEST_TILT:
        raise StereocalError(
            f"These lines leave the vertical undetermined (within {degrees(fit.bound)}). {ADVICE}"
        )
    upright = uprightness(rig, fit.up)
    if abs(upright) < FEWEST_UPRIGHT:
        raise StereocalError(
            "Cannot tell which end of the vertical is up: the cameras look straight up or down, or "
            "lie on their side. Take a thrown object or surveyed points instead."
        )
    sign = np.sign(upright) * (-1.0 if upside_down else 1.0)
    up = sign * fit.up
    pose = frame_of_up(
        up, axes, {CAMERA: np.zeros(3)}, {**camera_directions(rig), **fit.along}, (CAMERA, VIEW)
    )
    source: Source = "plumb" if any(line.kind == "plumb" for line in lines) else "level"
    sentence = (
        f"World frame of {_counted(lines)}: the vertical is known within {degrees(fit.bound)} "
        f"(95 %); {how_cameras_stand(pose)}."
    )
    return WorldFrame(
        pose,
        source,
        {**about_noise(noise), "vertical_deg": float(np.degrees(fit.bound))},
        sentence,
        _notes(lines, noise, fit),
    )


def _noise_of_clicks(lines: Sequence[Line], rig: Rig, known: Noise) -> Noise:
    """The noise of the points by their scatter about straight lines, unless it is stated: clicks
    are not as exact as the targets of the calibration.

    The median over the images, so that a bent line does not hide itself. Too few points can only
    show that the noise is larger than that of the targets.
    """
    if known.source == "stated":
        return known
    scatter = []
    for line in lines:
        for camera, pixels in zip((rig.primary, rig.secondary), line.pixels, strict=True):
            if len(pixels) > 2:
                rays = camera.undistort(pixels)
                off = _distances(camera, rays, _plane(rays))
                scatter.append((off @ off, len(pixels) - 2))
    if not scatter:
        return known
    squares, degrees_of = np.array(scatter).T
    order = np.argsort(squares / degrees_of)
    middle = order[np.searchsorted(np.cumsum(degrees_of[order]), 0.5 * degrees_of.sum())]
    # The median of chi-square is below its mean.
    typical = degrees_of[middle] * (1 - 2 / (9 * degrees_of[middle])) ** 3
    seen = float(np.sqrt(squares[middle] / typical))
    if degrees_of.sum() < FEWEST_DEGREES and seen <= known.sigma_px:
        return known
    return replace(known, sigma_px=seen, source="residuals") if seen > 0 else known


def _counted(lines: Sequence[Line]) -> str:
    counts = {kind: sum(line.kind == kind for line in lines) for kind in ("plumb", "level")}
    parts = [f"{n} {kind} line{'s' * (n != 1)}" for kind, n in counts.items() if n]
    horizons = sum(line.kind == "horizon" for line in lines)
    parts += [f"{horizons} horizon{'s' * (horizons != 1)}"] if horizons else []
    return " and ".join(parts)


def _images(rig: Rig, lines: Sequence[Line], noise: Noise) -> Iterator[Image]:
    """The lines' images with two points or more."""
    for k, line in enumerate(lines):
        for number, (camera, pixels) in enumerate(
            zip((rig.primary, rig.secondary), line.pixels, strict=True)
        ):
            if len(pixels) < 2:
                continue
            rays = camera.undistort(pixels)
            if not np.ptp(rays, axis=0).any():
                continue
            normal = _plane(rays)
            off = np.linalg.norm(_distances(camera, rays, normal))
            off /= np.sqrt(max(len(pixels) - 2, 1))
            if len(pixels) > 2 and off > BENT * noise.sigma_px:
                raise StereocalError(
                    f"{line.name}: its points in the {CAMERAS[number]} scatter by {off:.1f} px "
                    f"about a straight line; {rounded(noise.sigma_px)} px are expected. How "
                    "exactly were they clicked? State that as their noise. If it is less than the "
                    "scatter, correct the wrong point, or leave out a line that is not straight."
                )
            yield Image(k, number, pixels, rig.pose.R.T @ normal if number else normal)


def _plane(rays: FloatArray) -> FloatArray:
    """(3,): unit normal of the plane through the centre nearest to rays (m, 2) of z = 1."""
    along = np.column_stack([rays, np.ones(len(rays))])
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return np.asarray(np.linalg.svd(np.vstack([along, np.zeros(3)]))[2][2])


def _distances(camera: Camera, rays: FloatArray, normal: FloatArray) -> FloatArray:
    """(m,): of rays (m, 2) from the image of a plane, in pixels as of `Camera`."""
    slopes = normal[:2] @ np.linalg.inv(camera.pixel_jacobians(rays))
    return np.asarray((rays @ normal[:2] + normal[2]) / np.linalg.norm(slopes, axis=1))


def _fit(
    rig: RigParameters, lines: Sequence[Line], images: Sequence[Image], noise: Noise
) -> LineFit:
    up0, along0 = _start(lines, images)
    level = list(along0)
    across = np.linalg.svd(up0[None])[2][1:]
    free = [k for k, image in enumerate(images) if lines[image.line].kind != "horizon"]
    count = 2 + len(level) + len(free)
    if sum(len(image.pixels) for image in images) < count:
        raise StereocalError(f"These lines leave the vertical undetermined. {ADVICE}")

    def directions(x: FloatArray) -> tuple[FloatArray, dict[int, FloatArray]]:
        up = _unit(up0 + x[:2] @ across)
        along = {}
        for k, turn in zip(level, x[2 : 2 + len(level)], strict=True):
            e = along0[k] + turn * np.cross(up0, along0[k])
            along[k] = _unit(e - (e @ up) * up)
        return up, along

    def distances(x: FloatArray, of: Rig, points: Sequence[FloatArray]) -> FloatArray:
        up, along = directions(x)
        turns = dict(zip(free, x[2 + len(level) :], strict=True))
        found = []
        for k, (image, seen) in enumerate(zip(images, points, strict=True)):
            normal = up
            if k in turns:
                e = along.get(image.line, up)
                n = image.normal + turns[k] * np.cross(e, image.normal)
                normal = n - (n @ e) * e
            camera = of.secondary if image.camera else of.primary
            n = of.pose.R @ normal if image.camera else normal
            found.append(_distances(camera, seen, n))
        return np.concatenate(found) / noise.sigma_px

    points = _rays(rig, images)

    def by_rig(x: FloatArray) -> FloatArray:
        return rig_errors(lambda of: distances(x, of, _rays(of, images)), rig, noise.spread)

    block_of = {k: block for block, k in enumerate(free)}
    of_error = [np.full(len(seen), block_of.get(k, -1)) for k, seen in enumerate(points)]
    blocks = Blocks(count - len(free), 1, np.concatenate(of_error))
    found = solve(lambda x: distances(x, rig, points), np.zeros(count), by_rig, blocks)
    up, along = directions(found.x)
    turns = turns_at(rig, up, _places(rig, images), noise.spread)
    return LineFit(
        lines,
        up,
        {lines[k].name: e for k, e in along.items()},
        found,
        found.shift[:2] - across @ turns,
    )


def _places(rig: RigParameters, images: Sequence[Image]) -> FloatArray:
    """(n, 3): where the lines are that both cameras see, else the usual place."""
    planes = {image.line: image.normal for image in images if image.camera}
    centre = rig.pose.inverse().T
    found = []
    for image in images:
        if image.camera or image.line not in planes:
            continue
        ray = np.append(rig.primary.undistort(image.pixels).mean(axis=0), 1.0)
        away = planes[image.line] @ ray
        depth = (planes[image.line] @ centre) / away if away else np.nan
        if 0 < depth < FARTHEST * rig.pose.baseline:
            found.append(depth * ray)
    return np.array(found) if found else usual_place(rig)


def _rays(rig: Rig, images: Sequence[Image]) -> list[FloatArray]:
    """The points of each image on the plane z = 1."""
    cameras = rig.primary, rig.secondary
    return [cameras[image.camera].undistort(image.pixels) for image in images]


def _start(
    lines: Sequence[Line], images: Sequence[Image]
) -> tuple[FloatArray, dict[int, FloatArray]]:
    """A first vertical, and first directions of the level lines, by number."""
    rows: list[FloatArray] = []
    along = {}
    for k, line in enumerate(lines):
        normals = [image.normal for image in images if image.line == k]
        if line.kind == "plumb":
            rows += normals
        elif line.kind == "level" and len(normals) == 2:
            e = np.cross(normals[0], normals[1])
            size = float(np.linalg.norm(e))
            rows.append(e)
            along[k] = e / size if size > 0 else e
        elif line.kind == "horizon":
            rows += [each for n in normals for each in np.linalg.svd(n[None])[2][1:]]
    if len(rows) < 2:
        raise StereocalError(f"These lines leave the vertical undetermined. {ADVICE}")
    # Padded, so that two rows have three singular vectors.
    up = np.linalg.svd(np.vstack([*rows, np.zeros(3)]))[2][2]
    flat = {k: e - (e @ up) * up for k, e in along.items()}
    if any(np.linalg.norm(e) < 0.1 for e in flat.values()):
        raise StereocalError(
            "A level line is seen along the baseline, so that its direction is unknown, or it "
            "contradicts the other lines. Take another one."
        )
    return up, {k: _unit(e) for k, e in flat.items()}


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector))


def _refuse_contradiction(
    rig: RigParameters, lines: Sequence[Line], images: Sequence[Image], noise: Noise, fit: LineFit
) -> None:
    """Name the line without which the others agree, if there is just one."""
    culprits = []
    for k, line in enumerate(lines if len(lines) <= MOST_TRIED else []):
        rest = [image for image in images if image.line != k]
        try:
            again = _fit(rig, lines, rest, noise)
        except StereocalError:
            continue
        if again.solution.degrees > 0 and again.solution.widening < 3:
            culprits.append(line.name)
    where = (
        f"without {culprits[0]} the others agree"
        if len(culprits) == 1
        else "cannot tell which of them is wrong"
    )
    raise StereocalError(
        f"The lines contradict each other: their points are {fit.solution.widening:.0f} times the "
        f"image noise of {rounded(noise.sigma_px)} px off any common vertical; {where}."
    )


def _notes(lines: Sequence[Line], noise: Noise, fit: LineFit) -> tuple[str, ...]:
    notes = []
    if len(lines) == 1 and lines[0].kind == "plumb":
        notes.append("A single plumb line has nothing to check it; a second one would.")
    if fit.solution.widening > 2:
        notes.append(
            f"The points are {fit.solution.widening:.1f} times as far off as an image noise of "
            f"{rounded(noise.sigma_px)} px explains; the stated error is larger by that factor."
        )
    if any(line.kind == "horizon" for line in lines):
        notes.append(
            "The horizon is taken for level. Seen from h metres above the sea it lies "
            "0.03° times the square root of h lower."
        )
    return tuple(notes)
