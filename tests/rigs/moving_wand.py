"""Simulate a wand that is waved before three cameras and more, each late by some frames."""

import numpy as np

from stereocal.fit.errors.held_out import seen_by_others
from stereocal.fit.least_squares.robust import RobustFit
from stereocal.fit.rig_calibration import RigCalibration
from stereocal.rig.recording import Recording
from stereocal.simulation.rigs import IMAGE_SIZE, WAND, SimulatedRig, recording_of, simulated_rig
from stereocal.system.array_types import FloatArray
from tests.rigs.refined_rigs import smooth_fields, wave_errors


def wave_wand(
    seed: int,
    late: FloatArray,
    frames: int,
    misfit_px: float = 0.0,
    noise_px: float = 0.2,
    drift: float = 0.0,
) -> tuple[SimulatedRig, Recording]:
    """A rig and the recording of a wand on a smooth path.

    Args:
        late: (c,): by how many frames each camera is late, in the middle of the recording.
        misfit_px: root mean square of an error of each lens that no model contains.
        drift: of the last camera, in frames per frame.
    """
    rng = np.random.default_rng([seed, 5])
    truth = simulated_rig(np.random.default_rng(seed), len(late), 20)
    centre = truth.points_m.reshape(-1, 3).mean(axis=0)
    pace, phase = 1 / rng.uniform(9, 30, 6), rng.uniform(0, 2 * np.pi, 6)
    along = WAND.points[:, 0] - WAND.points[:, 0].mean()

    def wand(times: FloatArray) -> FloatArray:
        """(n, 3, 3): its targets."""
        a, b, c, d, e, _ = (pace * times[:, None] + phase).T
        middle = np.column_stack([np.sin(a), 0.8 * np.sin(b), np.cos(c)])
        way = np.column_stack([np.cos(d), np.sin(d) * np.cos(e), np.sin(e) * np.sin(d)])
        return np.asarray(centre + 0.9 * middle[:, None] + along[None, :, None] * way[:, None])

    pixels, recorded = [], np.arange(float(frames))
    for number, (name, camera) in enumerate(truth.cameras.items()):
        times = recorded + late[number]
        if number == len(late) - 1:
            times = times + drift * (recorded - frames / 2)
        images = camera.project(truth.poses[name].apply(wand(times).reshape(-1, 3)))
        images += misfit_px * wave_errors(smooth_fields(rng)[:2], images / max(IMAGE_SIZE))
        images += noise_px * rng.standard_normal(images.shape)
        images[~((images > 0) & (images < np.array(IMAGE_SIZE) - 1)).all(axis=1)] = np.nan
        pixels.append(images.reshape(frames, -1, 2))
    return truth, recording_of("simulated", truth.recording.cameras, WAND, pixels)


def stated_over_true(rig: RigCalibration, rest: Recording) -> list[float]:
    """Of each camera: within how many px half of its images are said to lie of where the others see
    the point, over what the rest of the recording shows."""
    seen = RobustFit.of(rest.of_cameras(rig.names), rig.fit.poses, rig.fit.settings).seen
    apart = seen_by_others(rig.fit, seen, np.arange(len(seen.frame_of)))
    true = {name: own[np.isfinite(own)] for name, own in zip(rig.names, apart.T, strict=True)}
    return [rig.image_px[name] / float(np.median(own)) for name, own in true.items() if len(own)]
