"""A simulated flock with known partners, and parameter sets from misjudged lenses to match it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from stereocal.calibration.essential import Solver
from stereocal.calibration.methods import CalibrationSettings
from stereocal.library.calibrations import calibrate
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import Rig
from stereocal.simulation.nineteen import simulate_nineteen
from stereocal.simulation.simulate import FIELD_DEPTHS_M, place_bars
from stereocal.system.array_types import FloatArray, IntArray

NOISE_PX = 0.3
MISSING = 0.10
SPURIOUS = 0.05


@dataclass(frozen=True, eq=False)
class FlockFrame:
    """What both cameras see in one frame, shuffled."""

    primary_px: FloatArray
    secondary_px: FloatArray
    primary_of: IntArray
    """Which bird each point is; -1 for a spurious one."""
    secondary_of: IntArray

    @property
    def pairs(self) -> int:
        """How many birds both cameras see."""
        return len(np.intersect1d(self.primary_of, self.secondary_of)) - int(
            (self.primary_of < 0).any() and (self.secondary_of < 0).any()
        )


def flock(
    rig: Rig, points: int, frames: int, seed: int, depths_m: tuple[float, float] = FIELD_DEPTHS_M
) -> Iterator[FlockFrame]:
    """Frames with about `points` points a camera, everywhere in the common view."""
    rng = np.random.default_rng([seed, points])
    birds = round(points * (1 - SPURIOUS) / (1 - MISSING))
    for _ in range(frames):
        places = place_bars(rig, rng, birds, 0.1, depths_m).ends_m[:, 0]
        moved = rig.pose.apply(places)
        sides = []
        for camera, seen in ((rig.primary, places), (rig.secondary, moved)):
            size = np.array(camera.image_size)
            kept = np.flatnonzero(rng.random(birds) >= MISSING)
            pixels = camera.project(seen[kept]) + NOISE_PX * rng.standard_normal((len(kept), 2))
            wrong = rng.uniform(-0.5, size - 0.5, (round(points * SPURIOUS), 2))
            order = rng.permutation(len(kept) + len(wrong))
            names = np.concatenate([kept, np.full(len(wrong), -1)])
            both = np.concatenate([pixels.clip(-0.5, size - 0.5), wrong])
            sides.append((both[order], names[order]))
        yield FlockFrame(sides[0][0], sides[1][0], sides[0][1], sides[1][1])


def parameter_sets(solver: Solver) -> tuple[Rig, Mapping[str, RigParameters]]:
    """One rig of the nineteen (lenses misjudged by 0.1 to 0.3 %, 3 to 5 px) and its sets.

    The essential pose is put into a 2D file, for it has no file of its own.
    """
    scene, dataset = simulate_nineteen(0)[9]
    calibration = calibrate(dataset, CalibrationSettings(essential=solver))
    matching, measuring = calibration.parameters("2d"), calibration.parameters("3d")
    essential = replace(matching, pose=calibration.methods["essential"].pose)
    return scene.rig, {"essential": essential, "2d": matching, "3d": measuring}
