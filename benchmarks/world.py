"""Does the world frame tell the truth? Simulated studies of `field.world`.

    nice python -m benchmarks.world [STUDY ...] [--trials N]

Each rig is calibrated with 25 frames (`refined_rigs`: 0.2 px, lenses and lengths misjudged as
stated), and its refined file is used. The cameras stand within 20 degrees of level and upright.

- plumb: the vertical of four plumb lines at 4 m, 0.3 px; and whether the stated limits hold;
- plumb_known: the same with the rig known exactly: what the lines themselves give;
- gravity: throws at 100 frames per second, 0.3 px, drag from none to that of a light ball;
- survey: axes of eight surveyed points, 5 mm;
- mirrored: surveys with two axes exchanged or one sign wrong, of 4 to 10 points off one plane;
- ground: mirrored surveys of 3 to 6 points on the ground;
- sound: sound surveys, to be accepted.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.bumps import exact_interval
from benchmarks.refined_rigs import FRAMES, Misjudged, random_scene, stated
from stereocal.errors import StereocalError
from stereocal.field.world.lines import world_of_lines
from stereocal.field.world.observed import Line, Survey, Throw
from stereocal.field.world.survey import world_of_survey
from stereocal.field.world.throw import path, world_of_throw
from stereocal.refined.parameter_file import refined_parameters
from stereocal.refined.refine import refine
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import Rig

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
        truth = random_scene(rng, 5).rig
        rig = RigParameters(
            truth.primary, truth.secondary, truth.pose, "2d", 1.0, {}, {}, noise_px=CLICK_PX
        )
        yield Place(truth, rig, world_of_cameras(rng), rng)


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


def print_plumb(trials: int, of: Callable[[int, int], Iterator[Place]] = places) -> None:
    """Errors of the vertical, and how often its limit holds."""
    errors, limits = [], []
    for place in of(trials, 1):
        found = world_of_lines(place.rig, plumb_lines(place), sigma_px=CLICK_PX)
        errors.append(off_vertical(place, found.pose, 4.0))
        limits.append(found.uncertainty["vertical_deg"])
    _print_errors(errors, limits)


def print_plumb_known(trials: int) -> None:
    """The same with an exact rig."""
    print_plumb(trials, known_places)


def _print_errors(errors: list[float], limits: list[float]) -> None:
    within = np.array(errors) <= np.array(limits)
    print(
        f"  vertical off by {np.median(errors):.3f} degrees (median), "
        f"{np.percentile(errors, 95):.3f} (95 %), {max(errors):.3f} (largest); within 0.1 degrees "
        f"{exact_interval(int(np.sum(np.array(errors) < 0.1)), len(errors))}\n"
        f"  stated 95 % limit {np.median(limits):.3f} (median), held by "
        f"{exact_interval(int(within.sum()), len(errors))}"
    )


def print_gravity(trials: int) -> None:
    """How often the interval of |g| holds 9.81."""
    errors, limits, held, halves, agree, seen = [], [], 0, [], 0, 0
    for place in places(trials, 2):
        found = world_of_throw(place.rig, thrown(place))
        gravity = found.about["gravity"]
        interval = gravity["m_per_s2"]
        held += interval["low"] <= GRAVITY <= interval["high"]
        halves.append(0.5 * (interval["high"] - interval["low"]))
        agree += gravity["agrees"]
        seen += gravity["drag_per_m"]["low"] > 0
        errors.append(off_vertical(place, found.pose, 7.0))
        limits.append(found.uncertainty["vertical_deg"])
    print(f"  95 % intervals of g hold {GRAVITY}: {exact_interval(held, trials)}")
    print(f"  half an interval {np.median(halves):.3f} m/s^2 (median); drag seen in {seen}")
    print(f"  said to agree: {exact_interval(agree, trials)}")
    _print_errors(errors, limits)


def print_survey(trials: int) -> None:
    """Errors of the vertical of surveyed points."""
    errors, limits = [], []
    for place in places(trials, 3):
        found = world_of_survey(place.rig, surveyed(place, 8))
        errors.append(off_vertical(place, found.pose, 7.0))
        limits.append(found.uncertainty["vertical_deg"])
    _print_errors(errors, limits)


def print_mirrored(trials: int) -> None:
    """Mirrored surveys refused, of points off one plane."""
    refused = sum(
        refusal(place, mirrored(surveyed(place, int(place.rng.integers(4, 11))), place.rng))
        is not None
        for place in places(trials, 4)
    )
    print(f"  refused {refused} of {trials}")


def print_ground(trials: int) -> None:
    """Mirrored surveys refused, of points on the ground; z wrong in sign is 0 there."""
    refused, of = 0, 0
    for place in places(trials, 5):
        survey = surveyed(place, int(place.rng.integers(3, 7)), on_ground=True)
        bad = mirrored(survey, place.rng)
        if np.allclose(bad.world_m[:, :2], survey.world_m[:, :2]):
            continue
        of += 1
        refused += refusal(place, bad) is not None
    print(f"  refused {refused} of {of}")


def print_sound(trials: int) -> None:
    """Sound surveys accepted."""
    whys: list[str] = []
    for place in places(trials, 6):
        count = int(place.rng.integers(3, 11))
        why = refusal(place, surveyed(place, count, on_ground=count < 6))
        whys += [why] if why else []
    print(f"  refused {len(whys)} of {trials}", *sorted(set(whys))[:3], sep="\n  ")


def refusal(place: Place, survey: Survey) -> str | None:
    """Why a survey is refused; None if it is accepted."""
    try:
        world_of_survey(place.rig, survey)
    except StereocalError as error:
        return str(error)
    return None


STUDIES = {
    "plumb": (print_plumb, 400),
    "plumb_known": (print_plumb_known, 400),
    "gravity": (print_gravity, 1000),
    "survey": (print_survey, 400),
    "mirrored": (print_mirrored, 1000),
    "ground": (print_ground, 1000),
    "sound": (print_sound, 400),
}


def main() -> None:
    """Run the studies named, or all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("studies", nargs="*", metavar="STUDY")
    parser.add_argument("--trials", type=int)
    parsed = parser.parse_args()
    for name in parsed.studies or STUDIES:
        study, usual = STUDIES[name]
        begun = time.perf_counter()
        trials = parsed.trials or usual
        print(f"{name}, {trials} trials:")
        study(trials)
        print(f"  {time.perf_counter() - begun:.0f} s")


if __name__ == "__main__":
    main()
