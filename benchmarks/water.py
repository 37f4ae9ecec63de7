"""Cameras in air, a bar in water behind a flat window: are rig and window found?

    python -m benchmarks.water [distances|angles|thicknesses|tilts|ports|cameras|...] [--rigs 20]

Simulated rigs (`tests.rigs.behind_glass`: noise of 0.2 px, lenses to 0.05 % and 0.5 px, baseline to
2 mm), their window stated by its thickness and indices. The mean length error of fresh bars that
the same cameras see is divided by that with the true cameras, poses and windows. Over the rigs:
median and middle 90 %.

- distances, angles, thicknesses, tilts: of one wall;
- ports: a window for each camera;
- cameras: 2 to 4, before one wall and behind ports of their own;
- wrong: a thickness wrong by 2 mm, an index of water wrong by 0.002, and that index free;
- lenses: refined sets without a window of the same points (`calibrate` itself refuses these);
- boards: the same with lenses that were calibrated in the water, by boards at some of the
  distances; errors at those distances, and beyond them.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.studies import Asked, Study, rms, run_studies, spread
from stereocal.errors import StereocalError
from stereocal.fit.calibrate import calibrate_rig
from stereocal.fit.least_squares.small_steps import (
    cameras_at,
    window_at,
    window_places,
    window_values,
)
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.least_squares.views import fit_points
from stereocal.fit.refine import refine
from stereocal.fit.rig_calibration import RigCalibration
from stereocal.rig.camera import Camera, LensUncertainty
from stereocal.rig.geometry import AT_ORIGIN, Pose
from stereocal.rig.recording import Recording
from stereocal.rig.rig import Rig
from stereocal.simulation.rigs import seen_by
from stereocal.system.array_types import FloatArray
from tests.rigs.behind_glass import FREE_LENS, Submerged, Tank, further, submerged

BARS = (25, 80)
FRESH = 200
WITHIN = 1.15
OFF_M, OFF_INDEX = 0.002, 0.002
BOARDS, BOARDS_M, SQUARE_M = 20, (0.3, 0.45), 0.02
"""How many photographs of a board, at which distances behind the wall, and its squares."""
WALL = slice(0, 3)
"""Of `window_values`: both numbers of the normal, and the distance."""
Way = Callable[[Submerged], Recording]
"""What is stated of drawn points."""


@dataclass(frozen=True)
class Found:
    """What one rig shows."""

    ratio: float
    """Of mean length errors; infinite without a rig."""
    length: float = np.nan
    """Mean relative error of lengths."""
    places_m: float = np.nan
    """Median error of 3D points, in the frame of the first camera."""
    spent_s: float = np.nan
    wall: tuple[float, ...] = ()
    """Errors of its distance, mm, and direction, degrees; z of its normal and distance (3)."""


def ends_of(cameras: Sequence[Camera], poses: Sequence[Pose], pixels: FloatArray) -> FloatArray:
    """(bars, 2, 3): from images (bars, 2, c, 2), in the frame of the first camera."""
    flat = pixels.reshape(-1, len(cameras), 2)
    if len(cameras) == 2:
        rig = Rig(cameras[0], cameras[1], poses[1] @ poses[0].inverse())
        return rig.reconstruct(flat[:, 0], flat[:, 1]).reshape(-1, 2, 3)
    rays = np.stack([camera.rays_of(flat[:, c]) for c, camera in enumerate(cameras)], axis=1)
    return fit_points(cameras_at(cameras, poses), flat, rays).points.reshape(-1, 2, 3)


def wall_sigmas(rig: RigCalibration) -> FloatArray:
    """(3,): standard errors of the window of the first camera, as of `WALL`."""
    variances = np.diag(rig.covariance)[window_places(0, len(rig.names))]
    return np.asarray(np.sqrt(variances[WALL]))


def wall_errors(rig: RigCalibration, drawn: Submerged) -> tuple[float, ...]:
    """As of `Found.wall`, for the first camera."""
    found, true = window_at(rig.fit.at, 0), next(iter(drawn.cameras.values())).window
    assert found is not None and true is not None
    off = window_values(found)[WALL] - window_values(true)[WALL]
    turned = float(np.degrees(np.linalg.norm(np.cross(found.normal, true.normal))))
    return 1000.0 * abs(float(off[2])), turned, *(off / wall_sigmas(rig)).tolist()


def tried(drawn: Submerged, recording: Recording, free: bool, rng: np.random.Generator) -> Found:
    """A rig calibrated with what is stated, and measured with fresh bars."""
    lenses = dict.fromkeys(recording.cameras, FREE_LENS) if free else {}
    begun, wall = time.process_time(), tuple[float, ...]()
    try:
        if recording.has_windows:
            rig = calibrate_rig(recording, late=False)
            if rig.unreached:
                return Found(np.inf)
            cameras, poses = [*rig.cameras.values()], [*rig.poses.values()]
            wall = wall_errors(rig, drawn)
        else:
            fit = refine(recording.pair(*recording.cameras), RefineSettings(lenses=lenses))
            cameras, poses = [fit.primary, fit.secondary], [AT_ORIGIN, fit.pose]
    except StereocalError:
        return Found(np.inf)
    spent = time.process_time() - begun
    fresh = further(drawn, rng, FRESH)
    truth, pixels = fresh.ends_m, fresh.recording.images()[1]
    exact = ends_of([*drawn.cameras.values()], drawn.true_poses, pixels)
    ends = ends_of(cameras, poses, pixels)
    least, error = (
        np.abs(np.linalg.norm(own[:, 0] - own[:, 1], axis=1) / drawn.tank.bar_m - 1.0)
        for own in (exact, ends)
    )
    length = float(
        np.mean(error[np.isfinite(least)])
    )  # NaN, as a length that is lost, is not within
    places = float(np.nanmedian(np.linalg.norm(ends - truth, axis=2)))
    return Found(length / float(np.nanmean(least)), length, places, spent, wall)


def stated(drawn: Submerged) -> Recording:
    """The window by its thickness and indices."""
    return drawn.asked()


def row(
    name: str, tank: Tank, bars: int, asked: Asked, way: Way = stated, free: bool = False
) -> None:
    """Print what the rigs of a tank show."""
    found = list[Found]()
    for number in asked.numbers:
        drawn = submerged(tank, np.random.default_rng([number, 64]), bars)
        found.append(tried(drawn, way(drawn), free, np.random.default_rng([number, 65])))
    known = [each for each in found if each.ratio < np.inf]
    within = sum(each.ratio <= WITHIN for each in found)
    text = f"  {name}, {bars} bars: {within} of {len(found)} within {WITHIN}"
    if known:
        text += f", lengths {spread([each.ratio for each in known])} times"
        text += f" ({100 * np.median([each.length for each in known]):.2f} %)"
        text += f", points {spread([1000 * each.places_m for each in known])} mm off"
        text += f"; {np.median([each.spent_s for each in known]):.2f} s"
    if walls := [each.wall for each in known if each.wall]:
        mm, degrees, *z = np.array(walls).T
        text += f"; wall {spread(mm)} mm, {spread(degrees)} degrees off; rms of z of the distance "
        text += f"{rms(z[2]):.2f}, of the normal {rms(z[:2]):.2f}"
    print(text, flush=True)


def rows(tanks: Mapping[str, Tank]) -> Study:
    """A study of tanks."""

    def study(asked: Asked) -> None:
        for name, tank in tanks.items():
            for bars in BARS:
                row(name, tank, bars, asked)

    return study


WRONG: Mapping[str, Way] = {
    "nothing": stated,
    "thickness 2 mm": lambda own: own.asked(thickness_m=own.tank.thickness_m + OFF_M),
    "index 0.002": lambda own: own.asked(medium=own.tank.medium + OFF_INDEX),
    "index 0.002, stated to it": lambda own: own.asked(
        medium=own.tank.medium + OFF_INDEX, medium_sigma=OFF_INDEX
    ),
}


def wrong(asked: Asked) -> None:
    """What is stated wrongly of a window."""
    for wall_m in (0.1, 0.4):
        for name, way in WRONG.items():
            row(f"wall at {wall_m:g} m, wrong: {name}", Tank(wall_m), BARS[1], asked, way)


def in_water(drawn: Submerged) -> Recording:
    """No window, but focal lengths times the index."""
    cameras = dict[str, Camera]()
    for name, lens in drawn.recording.cameras.items():
        K = lens.K.copy()
        K[[0, 1], [0, 1]] *= drawn.tank.medium
        cameras[name] = replace(lens, K=K)
    return replace(drawn.recording, cameras=cameras)


def lenses(asked: Asked) -> None:
    """Calibrations without a window, beside the one with it."""
    for wall_m in (0.1, 0.4):
        name, tank = f"wall at {wall_m:g} m", Tank(wall_m)
        row(f"{name}: window", tank, BARS[1], asked)
        row(f"{name}: lenses freed", tank, BARS[1], asked, lambda own: own.recording, free=True)
        row(f"{name}: focal lengths times 1.333", tank, BARS[1], asked, in_water)
        row(f"{name}: those, freed", tank, BARS[1], asked, in_water, free=True)


def by_boards(drawn: Submerged, rng: np.random.Generator) -> Recording:
    """No window, and lenses from photographs of boards in the water at `BOARDS_M`."""
    corners = np.stack([*np.mgrid[:9, :6], np.zeros((9, 6))], axis=-1).reshape(-1, 3)
    corners = SQUARE_M * (corners - corners.mean(axis=0))
    cameras = dict[str, Camera]()
    for name, lens in drawn.recording.cameras.items():
        true, from_world, seen = drawn.cameras[name], drawn.world[name], list[Any]()
        while len(seen) < BOARDS:
            turn = Rotation.from_euler("xyz", rng.uniform(-25.0, 25.0, 3), degrees=True)
            middle = rng.uniform([-0.4, -0.3, BOARDS_M[0]], [0.4, 0.3, BOARDS_M[1]])
            points = from_world.apply(turn.apply(corners) + middle)
            pixels = seen_by(true, points, drawn.tank.noise_px, rng)
            if np.isfinite(pixels).all():
                seen.append(pixels.astype(np.float32)[:, None])
        board, flags = corners.astype(np.float32), cv2.CALIB_FIX_K3
        _, matrix, bends, _, _, sigmas, *_ = cv2.calibrateCameraExtended(
            [board] * BOARDS, seen, lens.image_size, lens.K.copy(), np.zeros(5), flags=flags
        )
        K = np.asarray(matrix, dtype=np.float64)
        d = np.asarray(bends, dtype=np.float64).ravel()[:4]
        fx, fy, cx, cy, *of_lens = sigmas.ravel()[:8].tolist()
        known = LensUncertainty(fx, fy, cx, cy, np.array(of_lens))
        cameras[name] = replace(lens, K=K, distortion=d, uncertainty=known)
    return replace(drawn.recording, cameras=cameras)


def boards(asked: Asked) -> None:
    """Lenses that were calibrated in the water, at the distances of the boards and beyond them."""
    for wall_m in (0.1, 0.4):
        found = list[FloatArray]()
        for number in asked.numbers:
            drawn = submerged(Tank(wall_m), np.random.default_rng([number, 64]), BARS[1])
            rng = np.random.default_rng([number, 66])
            recording = by_boards(drawn, rng)
            try:
                fit = refine(recording.pair(*recording.cameras), RefineSettings())
            except StereocalError:
                found.append(np.full(4, np.nan))
                continue
            fresh = further(drawn, rng, FRESH)
            in_world = next(iter(drawn.world.values())).inverse().apply(fresh.ends_m.reshape(-1, 3))
            depths = in_world[:, 2].reshape(-1, 2).mean(axis=1)
            zones = np.digitize(depths, BOARDS_M)
            pixels, poses = fresh.recording.images()[1], [AT_ORIGIN, fit.pose]
            ends = ends_of([fit.primary, fit.secondary], poses, pixels)
            lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
            error = np.abs(lengths / drawn.tank.bar_m - 1.0)
            by_zone = [100 * np.nanmean(error[zones == zone]) for zone in (1, 0, 2)]
            found.append(np.array([*by_zone, fit.sigma_px.value]))
        at, near, far, px = (spread(column) for column in np.array(found).T)
        print(
            f"  wall at {wall_m:g} m, lenses by boards in the water: lengths {at} % off at their "
            f"distances, {near} % nearer, {far} % farther; the points fit to {px} px",
            flush=True,
        )


STUDIES: Mapping[str, Study] = {
    "distances": rows({f"wall at {m:g} m": Tank(m) for m in (0.03, 0.1, 0.2, 0.4, 1.0)}),
    "angles": rows({f"{a:g} degrees": Tank(turned_deg=a) for a in (0.0, 10.0, 30.0, 45.0)}),
    "thicknesses": rows({f"{1000 * m:g} mm": Tank(thickness_m=m) for m in (0.0, 0.005, 0.02)}),
    "tilts": rows({f"tilted by {a:g} degrees": Tank(tilt_deg=a) for a in (5.0, 15.0)}),
    "ports": rows({f"ports at {m:g} m": Tank(m, each=True) for m in (0.03, 0.1)}),
    "cameras": rows(
        {
            f"{n} cameras, {'ports' if each else 'one wall'}": Tank(m, cameras=n, each=each)
            for each, m in ((False, 0.4), (True, 0.05))
            for n in (2, 3, 4)
        }
    ),
    "wrong": wrong,
    "lenses": lenses,
    "boards": boards,
}


if __name__ == "__main__":
    run_studies({name: (study, 20) for name, study in STUDIES.items()}, __doc__)
