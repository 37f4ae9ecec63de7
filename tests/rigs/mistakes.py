"""The ordinary mistakes of a first hour: exchanged frames, wrong points, wrong lenses."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from stereocal.calibration.corrections import with_changed, with_files
from stereocal.rig.camera import Camera
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.simulation.simulate import Scene, lens_off_by
from stereocal.system.array_types import FloatArray
from tests.rigs.refined_rigs import Misjudged, random_scene, stated

KNOWN = Misjudged()
SEED = 71
SLIPS_PX = (20.0, 100.0)
BAD_POINTS = 0.3


def rig(number: int) -> tuple[Scene, Pair, np.random.Generator]:
    """Rig number so and so: its truth, its data set with stated uncertainties, more randomness."""
    rng = np.random.default_rng([number, SEED])
    scene = random_scene(rng)
    data = stated(scene, rng, KNOWN)
    sigma_m, bar_sigma_m = KNOWN.baseline_m, KNOWN.bar_m
    data = data.changed(baseline_sigma_m=sigma_m, target_distance_sigma_m=bar_sigma_m)
    return scene, data, rng


def with_frames_exchanged(
    data: Pair, rng: np.random.Generator, count: int
) -> tuple[Pair, tuple[int, ...]]:
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
    return data.changed(correspondences=changed), tuple(frames)


def with_points_off(data: Pair, rng: np.random.Generator) -> tuple[Pair, tuple[int, ...]]:
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
    return data.changed(correspondences=changed), tuple(sorted({int(f) for f in rows.frame[bad]}))


def misplaced(data: Pair, rows: Any, by: Any) -> Pair:
    """Points of the secondary camera, in some rows, off by so many pixels."""
    secondary = data.correspondences.secondary.copy()
    secondary[rows] += by
    return data.changed(correspondences=replace(data.correspondences, secondary=secondary))


def flipped(camera: Camera) -> Camera:
    """The lens with all distortion of the other sign."""
    return replace(camera, distortion=-camera.distortion)


def upside_down(points: FloatArray, camera: Camera) -> FloatArray:
    """Images of a camera that stood on its head, turned by the program that recorded them."""
    return np.array(camera.image_size) - 1.0 - points


def from_the_right(points: FloatArray, camera: Camera) -> FloatArray:
    """u counted from the right."""
    return np.column_stack([camera.image_size[0] - 1 - points[:, 0], points[:, 1]])


def from_below(points: FloatArray, camera: Camera) -> FloatArray:
    """v counted from below."""
    return np.column_stack([points[:, 0], camera.image_size[1] - 1 - points[:, 1]])


Change = Callable[[Recording, np.random.Generator], Recording]


def one_of(names: Iterable[str], rng: np.random.Generator) -> str:
    """The name of a camera."""
    every = [*names]
    return every[int(rng.integers(len(every)))]


def of_lenses(change: Callable[[Camera], Camera], every: bool = False) -> Change:
    """The file of one camera, or of every one, changed."""
    return lambda recording, rng: with_changed(
        recording, recording.cameras if every else [one_of(recording.cameras, rng)], change
    )


def zoomed(factor: float) -> Change:
    """The file of one camera is of a focal length longer by a part of itself."""
    return of_lenses(lambda camera: lens_off_by(camera, factor, (0.0, 0.0)))


def files_exchanged(recording: Recording, rng: np.random.Generator) -> Recording:
    """The files of two cameras beside each other exchanged, with the image sizes where they
    belong."""
    first = int(rng.integers(len(recording.cameras) - 1))
    (a, one), (b, two) = [*recording.cameras.items()][first : first + 2]
    of_a, of_b = replace(two, image_size=one.image_size), replace(one, image_size=two.image_size)
    return with_files(recording, {a: of_a, b: of_b})


def one_file_for_all(recording: Recording, _: np.random.Generator) -> Recording:
    """The first camera's file for all, with the image sizes where they belong."""
    cameras = recording.cameras
    first = next(iter(cameras.values()))
    return with_changed(recording, cameras, lambda own: replace(first, image_size=own.image_size))
