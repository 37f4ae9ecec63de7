"""Simulated rigs for the studies of the refined method: truth drawn, then misjudged as stated."""

from dataclasses import dataclass, replace

import numpy as np

from stereocal.fit.least_squares.unknowns import LensPrior, RefineSettings
from stereocal.rig.camera import CAMERAS
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import Nominal, Scene, lens_off_by, observe, place_bars
from stereocal.system.array_types import FloatArray
from tests.rigs import known_rig as rig

BAR_M = 0.87
DEPTHS_M = (4.0, 10.0)
FRAMES = 25
WAVES = 6


@dataclass(frozen=True)
class Misjudged:
    """Standard deviations of what is stated: a careful field day's by default; 0 is exact."""

    baseline_m: float = 0.005
    bar_m: float = 0.0005
    focal: float = 0.003
    centre_px: float = 5.0
    noise_px: float = 0.2

    def settings(self) -> RefineSettings:
        """What an experimenter who knows these figures would set."""
        lens = LensPrior(self.focal, self.centre_px)
        return RefineSettings(dict.fromkeys(CAMERAS, lens), self.baseline_m, self.bar_m)


def random_scene(rng: np.random.Generator, frames: int = FRAMES, margin_px: float = 20.0) -> Scene:
    """A random rig, and the bar."""
    return place_bars(random_rig(rng), rng, frames, BAR_M, DEPTHS_M, margin_px)


def random_rig(rng: np.random.Generator) -> Rig:
    """Two cameras that differ in everything and toe in by a random amount."""
    low, high = [0.16, -0.12, -0.15, 0.02, 2.9], [0.32, 0.12, 0.15, 0.2, 3.2]
    pose = Pose.from_angles(Angles(*rng.uniform(low, high).tolist()), rng.uniform(1.8, 2.8))
    return Rig(rig.PRIMARY, rig.SECONDARY, pose)


def stated(
    scene: Scene,
    rng: np.random.Generator,
    off: Misjudged,
    baseline: float = 1.0,
    focal: float = 0.0,
    name: str = "rig",
) -> Pair:
    """The data set with lenses and lengths misjudged at random.

    Args:
        baseline: factor of the baseline as typed, on top.
        focal: further relative error of the primary's focal length.
    """
    nominal = misjudged(scene.rig, scene.bar_length_m, rng, off)
    changed = replace(
        nominal,
        primary=lens_off_by(nominal.primary, focal, (0.0, 0.0)),
        baseline_m=nominal.baseline_m * baseline,
    )
    return observe(scene, rng, off.noise_px, name, changed)


def misjudged(cameras: Rig, bar_m: float, rng: np.random.Generator, off: Misjudged) -> Nominal:
    """Lenses and lengths misjudged at random."""
    primary, secondary = (
        lens_off_by(camera, off.focal * rng.normal(), tuple(off.centre_px * rng.normal(size=2)))
        for camera in (cameras.primary, cameras.secondary)
    )
    baseline = cameras.pose.baseline + off.baseline_m * rng.normal()
    return Nominal(primary, secondary, baseline, bar_m + off.bar_m * rng.normal())


def in_runs(dataset: Pair, rng: np.random.Generator, length: int, noise_px: float) -> Pair:
    """The data set with further noise that stays the same for runs of so many frames."""
    rows = dataset.correspondences
    run = (rows.frame - rows.frame.min() + rng.integers(length)) // length
    moves = noise_px * rng.standard_normal((run.max() + 1, 2, 4))[run, rows.target]
    changed = replace(
        rows, primary=rows.primary + moves[:, :2], secondary=rows.secondary + moves[:, 2:]
    )
    return dataset.changed(correspondences=changed)


def smooth_fields(rng: np.random.Generator) -> FloatArray:
    """(4, WAVES, 4): waves of an error of the lens for each of u, v in both cameras.

    Each has two wave numbers, in waves across the image, a phase, and an amplitude.
    """
    numbers = rng.uniform(-1.5, 1.5, (4, WAVES, 2))
    phases = rng.uniform(0, 2 * np.pi, (4, WAVES, 1))
    return np.concatenate([numbers, phases, rng.standard_normal((4, WAVES, 1))], axis=2)


def wave_errors(waves: FloatArray, places: FloatArray) -> FloatArray:
    """(n, 2): the error of a lens at places (n, 2) in widths of the image, of rms 1.

    Args:
        waves: (2, WAVES, 4): as of `smooth_fields`, of one camera.
    """
    angles = 2 * np.pi * np.einsum("nk,awk->naw", places, waves[:, :, :2])
    found = np.sum(waves[:, :, 3] * np.cos(angles + waves[:, :, 2]), axis=2)
    return np.asarray(found / np.sqrt(0.5 * np.square(waves[:, :, 3]).sum(axis=1)))


def with_waves(dataset: Pair, fields: FloatArray, rms_px: float) -> Pair:
    """The data set seen with errors of the lenses that vary smoothly over the images."""
    rows = dataset.correspondences
    size = float(max(dataset.primary.image_size))
    primary, secondary = (
        pixels + rms_px * wave_errors(waves, pixels / size)
        for pixels, waves in ((rows.primary, fields[:2]), (rows.secondary, fields[2:]))
    )
    changed = replace(rows, primary=primary, secondary=secondary)
    return dataset.changed(correspondences=changed)


def held_out(dataset: Pair, frames: int) -> tuple[Pair, Pair]:
    """All but the last frames, and those."""
    numbers = dataset.correspondences.frames
    return dataset.of_frames(numbers[:-frames]), dataset.of_frames(numbers[-frames:])


def fixed_lenses(settings: RefineSettings) -> RefineSettings:
    """The same with both lenses held."""
    return replace(settings, lenses=dict.fromkeys(CAMERAS, LensPrior(0.0, 0.0)))


def spoiled(
    dataset: Pair, rng: np.random.Generator, share: float = 0.1, slip_px: float = 40.0
) -> tuple[Pair, list[int]]:
    """The data set with gross errors in a share of its frames, and these frames.

    In turn: a point of the secondary that belongs to another frame, a point that slipped in one
    image in a random direction, and A and B exchanged in one image.
    """
    rows = dataset.correspondences
    primary, secondary = rows.primary.copy(), rows.secondary.copy()
    bad = rng.choice(len(rows.bars), round(share * len(rows.bars)), replace=False)
    for turn, bar in enumerate(bad):
        a, b = rows.bars[bar]
        one = a if rng.random() < 0.5 else b
        if turn % 3 == 0:
            others = np.flatnonzero(rows.frame != rows.frame[a])
            secondary[one] = rows.secondary[rng.choice(others)]
        elif turn % 3 == 1:
            first = rng.random() < 0.5
            image, camera = (primary, dataset.primary) if first else (secondary, dataset.secondary)
            angle = rng.uniform(0, 2 * np.pi)
            slip = slip_px * np.array([np.cos(angle), np.sin(angle)])
            inside = not camera.outside(image[one][None] + slip)
            image[one] += slip if inside else -slip
        else:
            secondary[[a, b]] = secondary[[b, a]]
    changed = replace(rows, primary=primary, secondary=secondary)
    frames = sorted(int(frame) for frame in rows.frame[rows.bars[bad, 0]])
    return dataset.changed(correspondences=changed), frames


MARGIN_PX = 60.0


def waved_scene(cameras: Rig, rng: np.random.Generator, frames: int, length: int) -> Scene:
    """A bar that is somewhere else, in another direction, every `length` frames."""
    keys = place_bars(cameras, rng, frames // length + 2, BAR_M, DEPTHS_M, MARGIN_PX).ends_m
    middles, halves = keys.mean(axis=1), 0.5 * (keys[:, 0] - keys[:, 1])
    at, part = np.divmod(np.arange(frames), length)
    share = (part / length)[:, None]
    middle = (1 - share) * middles[at] + share * middles[at + 1]
    # Of two ways round the shorter one.
    flip = np.where(np.sum(halves[at] * halves[at + 1], axis=1) < 0, -1.0, 1.0)[:, None]
    half = (1 - share) * halves[at] + share * flip * halves[at + 1]
    half *= 0.5 * BAR_M / np.linalg.norm(half, axis=1, keepdims=True)
    return Scene(cameras, np.stack([middle + half, middle - half], axis=1))


def waved(
    rng: np.random.Generator,
    frames: int,
    length: int,
    off: Misjudged,
    wave_px: float | None = None,
    alike_px: float | None = None,
) -> tuple[Rig, Pair]:
    """A random rig, and the data set of a `waved_scene` before it.

    Args:
        wave_px: rms of `smooth_fields` of the lenses.
        alike_px: noise that runs of `length` frames share.
    """
    cameras = random_rig(rng)
    data = stated(waved_scene(cameras, rng, frames, length), rng, off)
    if wave_px is not None:
        data = with_waves(data, smooth_fields(rng), wave_px)
    return cameras, data if alike_px is None else in_runs(data, rng, length, alike_px)
