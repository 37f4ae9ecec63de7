"""The ordinary mistakes of a first hour: exchanged frames, wrong points, wrong lenses."""

from dataclasses import replace

import numpy as np

from stereocal.rig.camera import Camera
from stereocal.rig.dataset import Dataset
from stereocal.simulation.simulate import Scene
from tests.rigs.refined_rigs import Misjudged, random_scene, stated

KNOWN = Misjudged()
SEED = 71
SLIPS_PX = (20.0, 100.0)
BAD_POINTS = 0.3


def rig(number: int) -> tuple[Scene, Dataset, np.random.Generator]:
    """Rig number so and so: its truth, its data set with stated uncertainties, more randomness."""
    rng = np.random.default_rng([number, SEED])
    scene = random_scene(rng)
    data = stated(scene, rng, KNOWN)
    sigmas = {"baseline_sigma_m": KNOWN.baseline_m, "target_distance_sigma_m": KNOWN.bar_m}
    return scene, replace(data, **sigmas), rng  # type: ignore[arg-type]


def with_frames_exchanged(
    data: Dataset, rng: np.random.Generator, count: int
) -> tuple[Dataset, tuple[int, ...]]:
    """A and B exchanged in one camera, drawn by chance, in so many frames; and these frames."""
    rows = data.correspondences
    images = rows.primary.copy(), rows.secondary.copy()
    bad = rng.choice(len(rows.bars), count, replace=False)
    for bar in bad:
        a, b = rows.bars[bar]
        image = images[int(rng.integers(2))]
        image[[a, b]] = image[[b, a]]
    changed = replace(rows, primary=images[0], secondary=images[1])
    frames = sorted(int(frame) for frame in rows.frame[rows.bars[bad, 0]])
    return replace(data, correspondences=changed), tuple(frames)


def with_points_off(data: Dataset, rng: np.random.Generator) -> tuple[Dataset, tuple[int, ...]]:
    """`BAD_POINTS` of the points off by 20 to 100 px in one image; and the frames that have one."""
    rows = data.correspondences
    images = rows.primary.copy(), rows.secondary.copy()
    sizes = data.primary.image_size, data.secondary.image_size
    bad = rng.choice(len(rows), round(BAD_POINTS * len(rows)), replace=False)
    for row in bad:
        which = int(rng.integers(2))
        largest = np.array(sizes[which]) - 1.0
        while True:
            angle = rng.uniform(0.0, 2 * np.pi)
            slip = rng.uniform(*SLIPS_PX) * np.array([np.cos(angle), np.sin(angle)])
            moved = images[which][row] + slip
            if ((moved >= 0) & (moved <= largest)).all():
                images[which][row] = moved
                break
    changed = replace(rows, primary=images[0], secondary=images[1])
    return replace(data, correspondences=changed), tuple(sorted({int(f) for f in rows.frame[bad]}))


def flipped(camera: Camera) -> Camera:
    """The lens with all distortion of the other sign."""
    return replace(camera, distortion=-camera.distortion)
