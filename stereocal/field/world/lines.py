"""The vertical of plumb lines, level lines and horizons, by one least squares in pixels.

Seen by a camera, a straight line lies in a plane through the camera's centre. The unknowns are the
vertical; for each level line its direction in the horizontal plane; and for each line in each
camera the turn of its plane about the line's direction. A residual is the distance of an image
point to the image of that plane. So the two images of a line need not show the same points.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stereocal.errors import StereocalError
from stereocal.field.world import frame
from stereocal.field.world.adjustment import FEWEST_DEGREES, Blocks, Solution, culprit, solve
from stereocal.field.world.noise import (
    ErrorModel,
    check_inside,
    error_model_of,
    tilt_jacobian,
    usual_place,
)
from stereocal.fit.least_squares.small_steps import derivatives_by_rig
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import plural, rounded

FEWEST_UPRIGHT = 0.1
"""Least part of the images' up direction along the vertical that tells which of its ends is up."""
CONTRADICTION = 10.0
"""Residuals over the image noise, above which the lines contradict each other."""
FARTHEST = 1e3
"""Distance over the baseline, beyond which a line's place is unknown."""
MOST_TRIED = 20
"""Lines that are left out one by one to find the one that contradicts the others."""
BENT = 10.0
"""Likewise for the points of one line in one image."""
ADVICE = "Add a plumb line, a second level line in another direction, or a horizon."
UNDETERMINED = f"These lines leave the vertical undetermined. {ADVICE}"


@dataclass(frozen=True, eq=False)
class Image:
    """The points of one line in one camera, two or more."""

    line: int
    camera: int
    pixels: FloatArray
    """(m, 2) raw."""
    normal: FloatArray
    """(3,) unit normal of the line's plane, in the primary's frame, as the points alone give it."""
    scatter: float
    """Sum of squares of the distances of the points from that plane, px^2."""

    def rays(self, rig: Rig) -> FloatArray:
        """(m, 2): the points on the plane z = 1."""
        return _cameras(rig)[self.camera].undistort(self.pixels)


@dataclass(frozen=True, eq=False)
class LineFit:
    """The vertical (3,), and the directions of the level lines, in the primary's frame."""

    up: FloatArray
    along: dict[str, FloatArray]
    solution: Solution
    bound: float
    """Angle that holds the error of the vertical at 95 %, radians."""


def world_of_lines(
    rig: RigParameters, lines: Sequence[frame.Line], stated: frame.WorldSettings
) -> frame.WorldFrame:
    """The world frame with the vertical of plumb lines, level lines and horizons."""
    images = _images(rig, lines)
    noise = _noise_of_clicks(images, error_model_of(rig, stated.sigma_px))
    for image in images:
        off = np.sqrt(image.scatter / max(len(image.pixels) - 2, 1))
        if len(image.pixels) > 2 and off > BENT * noise.sigma_px:
            raise StereocalError(
                f"{lines[image.line].name}: its points in the {CAMERAS[image.camera]} scatter by "
                f"{off:.1f} px about a straight line; {rounded(noise.sigma_px)} px are expected. "
                "How exactly were they clicked? State that as their noise. If it is less than the "
                "scatter, correct the wrong point, or leave out a line that is not straight."
            )
    fit = _fit(rig, lines, images, noise)
    if fit.solution.widening > CONTRADICTION:

        def agree_without(name: str) -> bool:
            rest = [image for image in images if lines[image.line].name != name]
            again = _fit(rig, lines, rest, noise).solution
            return again.degrees > 0 and again.widening < 3

        where = culprit([line.name for line in lines], agree_without, MOST_TRIED)
        raise StereocalError(
            f"The lines contradict each other: their points are {fit.solution.widening:.0f} times "
            f"the image noise of {rounded(noise.sigma_px)} px off any common vertical; {where}."
        )
    frame.check_tilt("These lines leave the vertical", fit.bound, ADVICE)
    upright = frame.uprightness(rig, fit.up)
    if abs(upright) < FEWEST_UPRIGHT:
        raise StereocalError(
            "Cannot tell which end of the vertical is up: the cameras look straight up or down, or "
            "lie on their side. Take a thrown object or surveyed points instead."
        )
    up = np.sign(upright) * (-1.0 if stated.upside_down else 1.0) * fit.up
    pose = frame.frame_of_up(rig, up, stated.axes, {}, fit.along, (frame.CAMERA, frame.VIEW))
    counts = {kind: sum(line.kind == kind for line in lines) for kind in frame.KINDS}
    parts = " and ".join(
        f"{n} {plural(n, kind if kind == 'horizon' else f'{kind} line')}"
        for kind, n in counts.items()
        if n
    )
    limits = {**noise.entries, "vertical_deg": float(np.degrees(fit.bound))}
    return frame.WorldFrame(
        pose,
        "plumb" if counts["plumb"] else "level",
        limits,
        f"World frame of {parts}: {frame.vertical_in_words(pose, fit.bound)}.",
        _notes(counts, noise, fit.solution.widening),
    )


def _images(rig: Rig, lines: Sequence[frame.Line]) -> list[Image]:
    """The lines' images with two points or more."""
    images = []
    for k, line in enumerate(lines):
        for number, (camera, pixels) in enumerate(zip(_cameras(rig), line.pixels, strict=True)):
            check_inside(pixels, camera, CAMERAS[number], (line.name,) * len(pixels))
            rays = camera.undistort(pixels)
            if len(pixels) < 2 or not np.ptp(rays, axis=0).any():
                continue
            along = np.column_stack([rays, np.ones(len(rays))])
            along /= np.linalg.norm(along, axis=1, keepdims=True)
            # Padded, so that two rows have three singular vectors.
            normal = np.linalg.svd(np.vstack([along, np.zeros(3)]))[2][2]
            off = _distances(camera, rays, normal)
            in_primary = rig.pose.R.T @ normal if number else normal
            images.append(Image(k, number, pixels, in_primary, float(off @ off)))
    return images


def _noise_of_clicks(images: Sequence[Image], known: ErrorModel) -> ErrorModel:
    """The noise of the points by their scatter about straight lines, unless it is stated: clicks
    are not as exact as the targets of the calibration. Too few points can only show that the noise
    is larger than that of the targets.
    """
    scatter = [(image.scatter, len(image.pixels) - 2) for image in images if len(image.pixels) > 2]
    if known.source == "stated" or not scatter:
        return known
    squares, degrees_of = np.array(scatter).T
    # The median over the images, so that a bent line does not hide itself.
    order = np.argsort(squares / degrees_of)
    middle = order[np.searchsorted(np.cumsum(degrees_of[order]), 0.5 * degrees_of.sum())]
    # The median of chi-square is below its mean.
    typical = degrees_of[middle] * (1 - 2 / (9 * degrees_of[middle])) ** 3
    seen = float(np.sqrt(squares[middle] / typical))
    if not seen or (degrees_of.sum() < FEWEST_DEGREES and seen <= known.sigma_px):
        return known
    return replace(known, sigma_px=seen, source="residuals")


def _cameras(rig: Rig) -> tuple[Camera, Camera]:
    return rig.primary, rig.secondary


def _distances(camera: Camera, rays: FloatArray, normal: FloatArray) -> FloatArray:
    """(m,): of rays (m, 2) from the image of a plane, in pixels as of `Camera`."""
    slopes = normal[:2] @ np.linalg.inv(camera.pixel_jacobians(rays))
    return np.asarray((rays @ normal[:2] + normal[2]) / np.linalg.norm(slopes, axis=1))


def _fit(
    rig: RigParameters, lines: Sequence[frame.Line], images: Sequence[Image], noise: ErrorModel
) -> LineFit:
    up0, along0 = _start(lines, images)
    across = np.linalg.svd(up0[None])[2][1:]
    free = [k for k, image in enumerate(images) if lines[image.line].kind != "horizon"]
    common = 2 + len(along0)
    count = common + len(free)
    if sum(len(image.pixels) for image in images) < count:
        raise StereocalError(UNDETERMINED)

    def directions(x: FloatArray) -> tuple[FloatArray, dict[int, FloatArray]]:
        up = _unit(up0 + x[:2] @ across)
        along = {}
        for (k, start), turn in zip(along0.items(), x[2:common], strict=True):
            e = start + turn * np.cross(up0, start)
            along[k] = _unit(e - (e @ up) * up)
        return up, along

    def distances(x: FloatArray, of: Rig, points: Sequence[FloatArray]) -> FloatArray:
        up, along = directions(x)
        turns = dict(zip(free, x[common:], strict=True))
        off = []
        for k, (image, seen) in enumerate(zip(images, points, strict=True)):
            normal = up
            if k in turns:
                e = along.get(image.line, up)
                n = image.normal + turns[k] * np.cross(e, image.normal)
                normal = n - (n @ e) * e
            in_camera = of.pose.R @ normal if image.camera else normal
            off.append(_distances(_cameras(of)[image.camera], seen, in_camera))
        return np.concatenate(off) / noise.sigma_px

    points = [image.rays(rig) for image in images]

    def by_rig(x: FloatArray) -> FloatArray:
        def distances_with(of: Rig) -> FloatArray:
            return distances(x, of, [image.rays(of) for image in images])

        return derivatives_by_rig(distances_with, rig, noise.spread)

    of_error = [
        np.full(len(seen), free.index(k) if k in free else -1) for k, seen in enumerate(points)
    ]
    blocks = Blocks(common, 1, np.concatenate(of_error))
    solution = solve(lambda x: distances(x, rig, points), np.zeros(count), by_rig, blocks)
    up, along = directions(solution.x)
    # What the parameters' errors do to the vertical, beyond what they do to points.
    beyond = solution.shift[:2] - across @ tilt_jacobian(
        rig, up, _places(rig, images), noise.spread
    )
    bound = solution.bound(solution.covariance[:2, :2] + beyond @ beyond.T)
    return LineFit(up, {lines[k].name: e for k, e in along.items()}, solution, bound)


def _places(rig: RigParameters, images: Sequence[Image]) -> FloatArray:
    """(n, 3): where the lines are that both cameras see, else the usual place."""
    planes = {image.line: image.normal for image in images if image.camera}
    centre = rig.pose.inverse().T
    places = []
    for image in images:
        if image.camera or image.line not in planes:
            continue
        ray = np.append(image.rays(rig).mean(axis=0), 1.0)
        away = planes[image.line] @ ray
        depth = (planes[image.line] @ centre) / away if away else np.nan
        if 0 < depth < FARTHEST * rig.pose.baseline:
            places.append(depth * ray)
    return np.array(places) if places else usual_place(rig)


def _start(
    lines: Sequence[frame.Line], images: Sequence[Image]
) -> tuple[FloatArray, dict[int, FloatArray]]:
    """A first vertical, and first directions of the level lines, by number."""
    rows: list[FloatArray] = []
    along = {}
    for k, line in enumerate(lines):
        normals = [image.normal for image in images if image.line == k]
        if line.kind == "plumb":
            rows += normals
        elif line.kind == "level" and len(normals) == 2:
            along[k] = np.cross(normals[0], normals[1])
            rows.append(along[k])
        elif line.kind == "horizon":
            rows += [direction for n in normals for direction in np.linalg.svd(n[None])[2][1:]]
    if len(rows) < 2:
        raise StereocalError(UNDETERMINED)
    up = np.linalg.svd(np.vstack([*rows, np.zeros(3)]))[2][2]
    flat = {k: e - (e @ up) * up for k, e in along.items()}
    if any(np.linalg.norm(flat[k]) <= 0.1 * np.linalg.norm(e) for k, e in along.items()):
        raise StereocalError(
            "A level line is seen along the baseline, so that its direction is unknown, or it "
            "contradicts the other lines. Take another one."
        )
    return up, {k: _unit(e) for k, e in flat.items()}


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector))


def _notes(
    counts: dict[frame.LineKind, int], noise: ErrorModel, widening: float
) -> tuple[str, ...]:
    notes = []
    if counts == {"plumb": 1, "level": 0, "horizon": 0}:
        notes.append("A single plumb line has nothing to check it; a second one would.")
    if widening > 2:
        notes.append(
            f"The points are {widening:.1f} times as far off as an image noise of "
            f"{rounded(noise.sigma_px)} px explains; the stated error is larger by that factor."
        )
    if counts["horizon"]:
        notes.append(
            "The horizon is taken for level. Seen from h metres above the sea it lies "
            "0.03° times the square root of h lower."
        )
    return tuple(notes)
