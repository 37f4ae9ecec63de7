"""What is solved: simulated rigs with known truth, and the real recording."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.peers.solution import Solution
from stereocal.formats.dataset_files import read_dataset
from stereocal.rig.camera import CAMERAS
from stereocal.rig.pair import Pair
from stereocal.simulation.simulate import Nominal, place_bars
from stereocal.system.array_types import FloatArray
from tests.rigs.refined_rigs import BAR_M, DEPTHS_M, Misjudged, random_scene, spoiled, stated

FRAMES = 25
TEST_FRAMES = 50
NOISE_PX = 0.2
OUTLIERS = 0.12
"""3 of 25 frames: a point of another frame, a slip of 40 px, A and B exchanged."""
FOCAL = 0.003
CENTRE_PX = 5.0
BASELINE = 0.01


@dataclass(frozen=True, eq=False)
class Task:
    """One data set to solve, others to test on, and the truth where it is known."""

    fit: Pair
    test: Pair
    truth: Solution | None = None
    kept: float = 1.0
    """Best part of the test's points and bars that counts."""
    middle: FloatArray | None = None
    """(n, 2, 2): raw pixels of a third marker in both images, for each of the test's frames."""


@dataclass(frozen=True)
class Scenario:
    """A kind of simulated rig."""

    key: str
    name: str
    misjudged: bool
    outliers: bool

    def tasks(self, rigs: int, seed: int = 0) -> Iterator[Task]:
        """As many rigs, each drawn from its own stream: the same in every scenario."""
        for number in range(rigs):
            yield self.task(np.random.default_rng([seed, number]))

    def task(self, rng: np.random.Generator) -> Task:
        """One rig: 25 frames to fit, 50 clean ones to test, all with 0.2 px noise."""
        drawn = random_scene(rng, 1).rig
        K = drawn.secondary.K.copy()
        K[0, 1] = 0.0  # most peers know no skew
        lens = np.append(drawn.secondary.distortion, 0.0)
        rig = replace(drawn, secondary=replace(drawn.secondary, K=K, distortion=lens))
        pose = rig.pose
        scene = place_bars(rig, rng, FRAMES + TEST_FRAMES, BAR_M, DEPTHS_M)
        off = Misjudged(
            baseline_m=BASELINE * pose.baseline if self.misjudged else 0.0,
            bar_m=0.0,
            focal=FOCAL if self.misjudged else 0.0,
            centre_px=CENTRE_PX if self.misjudged else 0.0,
            noise_px=NOISE_PX,
        )
        data = stated(scene, rng, off)
        frames = data.correspondences.frames
        fit, test = data.of_frames(frames[:FRAMES]), data.of_frames(frames[FRAMES:])
        if self.outliers:
            fit, _ = spoiled(fit, rng, OUTLIERS)
        nominal = Nominal.exact(scene)
        test = test.changed(target_distance_m=nominal.target_distance_m)
        return Task(fit, test, Solution(pose.R, pose.T, (rig.primary, rig.secondary)))


EXACT = "Exact lenses and baseline"
OFF = "Lenses off by 0.3 % and 5 px, baseline by 1 %"
SPOILED = "gross errors in 12 % of the frames"
SCENARIOS = (
    Scenario("exact", EXACT, False, False),
    Scenario("exact-outliers", f"{EXACT}, {SPOILED}", False, True),
    Scenario("off", OFF, True, False),
    Scenario("off-outliers", f"{OFF}, {SPOILED}", True, True),
)
RECORDING = "ewand12"


def recording() -> Task:
    """ewand12, even frames to fit and odd ones to test."""
    folder = Path(__file__).parents[2] / "sample_data" / "recording"
    data = read_dataset(folder)
    frames = data.correspondences.frames
    odd = frames[frames % 2 == 1]
    middle = [
        np.genfromtxt(folder / f"points_{side}.csv", delimiter=",", skip_header=1)
        for side in CAMERAS
    ]
    return Task(
        fit=data.of_frames(frames[frames % 2 == 0]),
        test=data.of_frames(odd),
        kept=0.98,
        middle=np.stack([table[np.isin(table[:, 0], odd), 1:] for table in middle], axis=1),
    )
