"""Sound recordings of rigs of several kinds, and what is said of a recording."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.errors import StereocalError
from stereocal.fit.errors.disagreement import compare_inputs
from stereocal.library.calibrations import calibrate
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.rig.tracks import TimeOffset
from stereocal.simulation.simulate import Scene, observe, place_bars
from tests.rigs.board_pairs import wide_lens
from tests.rigs.fisheye_rig import within_74_degrees
from tests.rigs.moving_bar import move_bar, record
from tests.rigs.refined_rigs import Misjudged, misjudged, random_rig

OFF = Misjudged()
SEED = 38


@dataclass(frozen=True)
class Kind:
    """A kind of rig, with the bar and its depths, in metres, and what is seen of it."""

    cameras: Callable[[np.random.Generator], Rig]
    bar_m: float
    depths_m: tuple[float, float]
    frames: int = 25
    noise_px: float = OFF.noise_px
    light_px: float = 0.0
    """By how much light from the side moves the centres of balls, in the root mean square."""


def camera(focal: float, k1: float, shift: float = 0.0, width: int = 1920) -> Camera:
    """A camera of 1080 rows whose image was cropped by twice a shift from the left."""
    K = np.array([[focal, 0.0, 966.5 - shift], [0.0, focal, 534.5], [0.0, 0.0, 1.0]])
    return Camera(K, np.array([k1, -0.4 * k1, 5e-4, -4e-4, 0.0]), (width, 1080))


def toed_in(rng: np.random.Generator, one: Camera, two: Camera, m: float, crossing_m: float) -> Rig:
    """Two cameras so many metres apart, whose axes about cross."""
    toe = float(np.arctan2(0.5 * m, crossing_m))
    angles = np.array([2.0 * toe, 0.0, 0.0, toe, 3.1]) + 0.03 * rng.standard_normal(5) * toe
    return Rig(one, two, Pose.from_angles(Angles(*angles.tolist()), m))


def facing(rng: np.random.Generator) -> Rig:
    """Two cameras that look at each other, 6 m apart, up to 3 degrees beside the axis."""
    turn = np.array([0.0, np.pi, 0.0]) + 0.02 * rng.standard_normal(3)
    T = np.array([*(0.15 * rng.standard_normal(2)), 6.0])
    pose = Pose(Rotation.from_rotvec(turn).as_matrix(), T)
    return Rig(camera(1500.0, -0.1), camera(1510.0, -0.1), pose)


def like_ones(rng: np.random.Generator) -> Rig:
    """Two cameras with images of one size, and lenses that differ by an eighth."""
    return toed_in(rng, camera(1500.0, -0.1), camera(1690.0, -0.12), 1.2, 3.0)


KINDS: Mapping[str, Kind] = {
    "unlike cameras": Kind(random_rig, 0.87, (4.0, 10.0)),
    "like cameras": Kind(
        lambda rng: toed_in(rng, camera(1500.0, -0.1), camera(1510.0, -0.1), 1.2, 3.0),
        0.5,
        (1.5, 5.0),
    ),
    "tele, 9 degrees": Kind(
        lambda rng: toed_in(rng, camera(12200.0, -0.1), camera(12260.0, -0.1), 4.0, 22.0),
        1.0,
        (15.0, 30.0),
    ),
    "wide, 90 degrees": Kind(
        lambda rng: toed_in(rng, camera(960.0, -0.2), camera(970.0, -0.2), 1.0, 2.5),
        0.5,
        (1.0, 4.0),
    ),
    "cropped": Kind(
        lambda rng: toed_in(
            rng, camera(1500.0, -0.1, 240.0, 1600), camera(1510.0, -0.1, 180.0, 1560), 1.2, 3.0
        ),
        0.5,
        (1.5, 5.0),
    ),
    "facing each other": Kind(facing, 0.5, (2.0, 4.0)),
    "balls": Kind(like_ones, 0.6, (1.5, 5.0), 40, 0.03, 0.14),
    "tags": Kind(like_ones, 0.5, (1.5, 4.0), 30, 0.03),
    "fisheyes": Kind(
        lambda rng: toed_in(rng, wide_lens(rng), wide_lens(rng), 1.0, 3.0), 0.4, (0.7, 4.0), 40, 0.3
    ),
}
"""Of balls and tags with the noise and about the frames that photographs of them give
(docs/photographs.md); fisheyes of 120 to 175 degrees."""


def sound(
    kind: str, number: int, frames: int | None = None, noise_px: float | None = None
) -> tuple[Scene, Pair, np.random.Generator]:
    """The truth of a rig, what is given of it, and more randomness."""
    it, rng = KINDS[kind], np.random.default_rng([number, SEED, [*KINDS].index(kind)])
    scene = bars_of(it, it.cameras(rng), rng, frames or it.frames)
    nominal = misjudged(scene.rig, it.bar_m, rng, replace(OFF, baseline_m=1e-3))
    noise = it.noise_px if noise_px is None else noise_px
    data = observe(scene, rng, noise, f"{kind} {number}", nominal)
    return scene, lit(data, it.light_px, rng), rng


def bars_of(it: Kind, rig: Rig, rng: np.random.Generator, frames: int) -> Scene:
    """Bars at random places, of a fisheye within 74 degrees of its axis."""
    if not rig.primary.is_fisheye:
        return place_bars(rig, rng, frames, it.bar_m, it.depths_m)
    scene = place_bars(rig, rng, 3 * frames, it.bar_m, it.depths_m)
    return within_74_degrees(scene, frames)


def lit(data: Pair, light_px: float, rng: np.random.Generator) -> Pair:
    """The centres of balls moved towards the light, which is that of all recordings of this name,
    alike in all photographs but for a half."""
    if not light_px:
        return data
    rows, light = data.correspondences, np.random.default_rng([*data.name.encode()])
    turn, size = light.uniform(0.0, 2 * np.pi), light.standard_normal()
    sizes = light_px * (0.7 * size + 0.7 * rng.standard_normal((2, len(rows), 1)))
    moves = sizes * np.array([np.cos(turn), np.sin(turn)])
    moved = replace(rows, primary=rows.primary + moves[0], secondary=rows.secondary + moves[1])
    return data.changed(correspondences=moved)


def waved(
    number: int,
    offset: float,
    every: int = 1,
    kind: str | None = None,
    frames: int = 80,
    noise_px: float | None = None,
) -> Pair:
    """A waved bar, seen by a secondary camera that is late by a part of a frame.

    Args:
        every: of so many frames one was kept, and numbered by itself.
        kind: None for the first four in turn.
    """
    name = kind or [*KINDS][number % 4]
    it, rng = KINDS[name], np.random.default_rng([number, SEED, 1])
    between = int(rng.choice([12, 20, 30]))
    bar = move_bar(it.cameras(rng), rng, frames * every, it.bar_m, it.depths_m, between)
    nominal = misjudged(bar.rig, it.bar_m, rng, replace(OFF, baseline_m=1e-3))
    noise = it.noise_px if noise_px is None else noise_px
    data = record(bar, rng, noise, f"late {number}", TimeOffset(offset), nominal)
    data = lit(data, it.light_px, rng)
    rows = data.correspondences
    kept = rows.where(rows.time_frame % every == 0)
    frame = np.searchsorted(kept.frames, kept.frame) + 1
    return data.changed(correspondences=replace(kept, frame=frame, time_frame=frame))


def accusations_of(data: Pair) -> tuple[str, ...]:
    """What `calibrate` says, an error or warnings, and the inputs that *What disagrees* accuses."""
    try:
        found = calibrate(data)
    except StereocalError as error:
        return (str(error),)
    inputs = compare_inputs(found.refined).inputs if found.refined else []
    notes = filter(None, [found.screening.time_note])
    return (*notes, *found.warnings, *(item.key for item in inputs if item.accused))
