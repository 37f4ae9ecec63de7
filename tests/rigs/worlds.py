"""Calibrated rigs in a world with a vertical: plumb lines, throws and surveys."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.errors import StereocalError
from stereocal.field.world.find import find_world
from stereocal.field.world.frame import Line, Survey, Throw
from stereocal.field.world.throw import path
from stereocal.fit.parameter_file import refined_parameters
from stereocal.fit.refine import refine
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray
from tests.rigs.refined_rigs import FRAMES, Misjudged, random_scene, stated

OFF = Misjudged()
CLICK_PX = 0.3
SURVEY_M = 0.005
GRAVITY = 9.81
FRAME_RATE = 100.0
MOST_TILT = np.radians(20.0)
MARGIN_PX = 10.0
RIGS = 100
"""Calibrated rigs; trials beyond their number use them again with other observations."""


MIRRORS = (
    np.eye(3)[[1, 0, 2]],
    np.eye(3)[[0, 2, 1]],
    np.eye(3)[[2, 1, 0]],
    np.diag([-1.0, 1, 1]),
    np.diag([1.0, -1, 1]),
    np.diag([1.0, 1, -1]),
)
"""Two axes exchanged, or one sign wrong."""


@dataclass(frozen=True, eq=False)
class Place:
    """A calibrated rig in a world."""

    truth: Rig
    rig: RigParameters
    world: Pose
    """`world_from_primary`, z up."""
    rng: np.random.Generator

    @property
    def up(self) -> FloatArray:
        """(3,) in the primary's frame."""
        return np.asarray(self.world.R[2])

    def images(self, points: FloatArray, noise_px: float) -> FloatArray:
        """Raw pixels (n, 4) of points in the primary's frame."""
        seen = (
            self.truth.primary.project(points),
            self.truth.secondary.project(self.truth.pose.apply(points)),
        )
        exact = np.hstack(seen)
        return np.asarray(exact + noise_px * self.rng.standard_normal(exact.shape))

    def is_seen(self, points: FloatArray) -> bool:
        """Whether both cameras see all points."""
        pixels = self.images(points, 0.0)
        size = np.array([*self.truth.primary.image_size, *self.truth.secondary.image_size])
        with np.errstate(invalid="ignore"):
            return bool(((pixels > MARGIN_PX) & (pixels < size - MARGIN_PX)).all())


def world_of_cameras(rng: np.random.Generator) -> Pose:
    """A world in which the primary stands upright and level within 20 degrees."""
    level = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # x ahead, z up
    turn = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)).as_matrix()
    tilt = Rotation.from_euler("yx", rng.uniform(-MOST_TILT, MOST_TILT, 2)).as_matrix()
    return Pose(turn @ tilt @ level, rng.uniform(-20, 20, 3))


def places(trials: int, seed: int) -> Iterator[Place]:
    """Places with calibrated rigs, each with its own random stream."""
    rigs: list[tuple[Rig, RigParameters]] = []
    for k in range(trials):
        rng = np.random.default_rng([seed, k])
        if k < RIGS:
            scene = random_scene(rng, FRAMES)
            fit = refine(stated(scene, rng, OFF), OFF.settings())
            rigs.append((scene.rig, refined_parameters(fit)))
        truth, rig = rigs[k % RIGS]
        yield Place(truth, rig, world_of_cameras(rng), rng)


def known_places(trials: int, seed: int) -> Iterator[Place]:
    """Places with rigs that are known exactly."""
    for k in range(trials):
        rng = np.random.default_rng([seed, k])
        yield known_place(random_scene(rng, 5).rig, rng)


def known_place(truth: Rig, rng: np.random.Generator) -> Place:
    """A place with this rig, known exactly."""
    rig = RigParameters(
        truth.primary, truth.secondary, truth.pose, "2d", 1.0, {}, {}, noise_px=CLICK_PX
    )
    return Place(truth, rig, world_of_cameras(rng), rng)


def common_view(place: Place, depth: float) -> FloatArray:
    """A point (3,) that both cameras see at a depth."""
    while True:
        point = depth * np.array([*place.rng.uniform(-0.4, 0.4, 2), 1.0])
        if place.is_seen(point[None]):
            return point


def plumb_lines(
    place: Place, count: int = 4, depth: float = 4.0, length: float = 2.0, clicks: int = 10
) -> list[Line]:
    """Plumb lines about a depth, each clicked at other places in the two images."""
    lines: list[Line] = []
    while len(lines) < count:
        middle = common_view(place, depth * place.rng.uniform(0.9, 1.1))
        images = []
        for _ in range(2):
            along = length * (place.rng.uniform(size=clicks) - 0.5)
            points = middle + along[:, None] * place.up
            images.append((points, place.images(points, CLICK_PX)))
        if all(place.is_seen(points) for points, _ in images):
            pixels = images[0][1][:, :2], images[1][1][:, 2:]
            lines.append(Line(f"line {len(lines)}", "plumb", pixels))
        else:
            length *= 0.98
    return lines


def thrown(place: Place, throws: int = 1, drag: float | None = None) -> Throw:
    """Throws upwards, of about a second, with a drag common to all."""
    k = place.rng.uniform(0.0, 0.03) if drag is None else drag
    tracks: list[str] = []
    frames: list[int] = []
    pixels: list[FloatArray] = []
    rounds = 0
    while len(pixels) < throws:
        rounds += 1
        seconds = place.rng.uniform(0.6, 1.0) * 0.99 ** min(rounds, 60)
        top = common_view(place, place.rng.uniform(6.0, 9.0))
        sideways = np.cross(place.up, place.rng.standard_normal(3))
        speed = place.rng.uniform(0.0, 2.5) * sideways / np.linalg.norm(sideways)
        begun = speed + 0.5 * GRAVITY * seconds * place.up
        start = top - 0.5 * seconds * speed - GRAVITY / 8 * seconds**2 * place.up
        times = np.arange(0.0, seconds, 1 / FRAME_RATE)
        points = path(times, start, begun, -GRAVITY * place.up, k)
        if not place.is_seen(points):
            continue
        tracks += [f"throw {len(pixels)}"] * len(times)
        frames += range(len(times))
        pixels.append(place.images(points, CLICK_PX))
    return Throw(tuple(tracks), np.array(frames, dtype=np.int64), np.vstack(pixels), FRAME_RATE)


def surveyed(place: Place, count: int, on_ground: bool = False) -> Survey:
    """Surveyed points; off one plane by a fifth of their extent, unless on the ground."""
    while True:
        xyz = np.array([common_view(place, place.rng.uniform(4.0, 9.0)) for _ in range(count)])
        if on_ground:
            xyz -= np.outer((xyz - xyz[0]) @ place.up, place.up)
            if not place.is_seen(xyz):
                continue
        extent = np.linalg.svd(xyz - xyz.mean(axis=0), compute_uv=False)
        if extent[1] > 0.3 * extent[0] and (on_ground or extent[2] > 0.2 * extent[0]):
            break
    world = place.world.apply(xyz) + SURVEY_M * place.rng.standard_normal(xyz.shape)
    return Survey(
        tuple(f"P{k}" for k in range(count)),
        world,
        place.images(xyz, OFF.noise_px),
        np.full((count, 3), np.nan),
    )


def mirrored(survey: Survey, rng: np.random.Generator) -> Survey:
    """The survey with left-handed axes."""
    return replace(survey, world_m=survey.world_m @ MIRRORS[rng.integers(len(MIRRORS))].T)


def off_vertical(place: Place, pose: Pose, depth: float) -> float:
    """Tilt in degrees of a true plumb line that is reconstructed with the file, at a depth."""
    while True:
        middle = common_view(place, depth)
        ends = middle + 0.25 * np.outer([1, -1], place.up)
        if place.is_seen(ends):
            break
    pixels = place.images(ends, 0.0)
    upper, lower = pose.apply(place.rig.reconstruct(pixels[:, :2], pixels[:, 2:]))
    return float(np.degrees(np.arctan2(np.hypot(*(upper - lower)[:2]), (upper - lower)[2])))


def refusal(place: Place, survey: Survey) -> str | None:
    """Why a survey is refused; None if it is accepted."""
    try:
        find_world(place.rig, survey)
    except StereocalError as error:
        return str(error)
    return None
