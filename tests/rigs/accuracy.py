"""What the refined method says, against the truth."""

from dataclasses import replace

import numpy as np

from stereocal.calibration.methods import errors_of
from stereocal.fit.errors.disagreement import compare_inputs
from stereocal.fit.errors.uncertainty import length_sigmas, length_variances
from stereocal.fit.least_squares.small_steps import pose_places, rig_at, step_between
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.refine import refine
from stereocal.fit.refined_result import RefinedResult
from stereocal.library.calibrations import calibrate
from stereocal.rig.geometry import Pose
from stereocal.simulation.simulate import (
    Nominal,
    Scene,
    field_rig,
    lens_off_by,
    observe,
    place_bars,
)
from stereocal.system.array_types import FloatArray
from tests.rigs.refined_rigs import Misjudged, held_out, random_scene, spoiled, stated

NAMES = ("turn x", "turn y", "turn z", "T x", "T y", "T z", "held-out distance")


def turned(pose: Pose, truth: Pose) -> float:
    """Angle of the rotation between two poses, in radians."""
    cosine = (np.trace(pose.R @ truth.R.T) - 1) / 2
    return float(np.arccos(min(cosine, 1.0)))


def deviations(rigs: int, off: Misjudged, settings: RefineSettings, seed: int) -> FloatArray:
    """(rigs, 7): errors of `NAMES` in stated standard errors, inputs drawn from their priors."""
    found = np.empty((rigs, len(NAMES)))
    for k in range(rigs):
        rng = np.random.default_rng([seed, k])
        scene = random_scene(rng, 26)
        fit, test = held_out(stated(scene, rng, off), 1)
        result = refine(fit, settings)
        errors = step_between(result.at, rig_at(scene.rig))[pose_places(1)]
        found[k, :6] = errors / np.sqrt(np.diag(result.covariance)[pose_places(1)])
        ends = scene.ends_m[-1]
        length = result.apply(test).reconstructed_lengths_m(result.pose)[0]
        known = result.at, result.sigma_px.value, result.covariance
        sigma = length_sigmas(*known, ends[:1], ends[1:])[0]
        found[k, 6] = (length - scene.bar_length_m) / sigma
    return found


def over_bound(
    rigs: int, off: Misjudged, settings: RefineSettings, seed: int
) -> tuple[float, float]:
    """RMS error of rotation, and of the length of a held-out bar, over their Cramer-Rao bounds.

    The length is seen without noise: its error is that of the calibration alone.
    """
    rows = np.empty((rigs, 4))
    for k in range(rigs):
        rng = np.random.default_rng([seed, k])
        scene = random_scene(rng, 26)
        fit, _ = held_out(stated(scene, rng, off), 1)
        result = refine(fit, settings)
        exact = observe(scene, np.random.default_rng(0), 0.0, "exact")
        exact_fit, exact_test = held_out(exact, 1)
        # At the truth, with the true noise: its covariance is the bound.
        bound = refine(exact_fit, replace(settings, sigma_px=off.noise_px, scatter_m=0.0))
        C, ends = bound.covariance, scene.ends_m[-1]
        noise = bound.sigma_px.value
        slope = length_variances(bound.at, noise, ends[:1], ends[1:])[1][0]
        length = result.apply(exact_test).reconstructed_lengths_m(result.pose)[0]
        truth = scene.rig.pose
        rows[k] = (
            turned(result.pose, truth) ** 2,
            np.diag(C)[pose_places(1)][:3].sum(),
            (length - scene.bar_length_m) ** 2,
            slope @ C @ slope,
        )
    mean = rows.mean(axis=0)
    return float(np.sqrt(mean[0] / mean[1])), float(np.sqrt(mean[2] / mean[3]))


def accusations(rigs: int, wrong: str, seed: int) -> tuple[int, int]:
    """In how many rigs the wrong input is named, and in how many a sound one is accused.

    Args:
        wrong: `baseline` (typed 3 % too long), `primary focal` (2 % too long), or nothing.
    """
    off = Misjudged()
    named = accused = 0
    for k in range(rigs):
        rng = np.random.default_rng([seed, k])
        data = stated(
            random_scene(rng),
            rng,
            off,
            baseline=1.03 if wrong == "baseline" else 1.0,
            focal=0.02 if wrong == "primary focal" else 0.0,
        )
        keys = {
            item.key for item in compare_inputs(refine(data, off.settings())).inputs if item.accused
        }
        named += wrong in keys
        accused += bool(keys - {wrong})
    return named, accused


def calibration_error(result: RefinedResult, scene: Scene) -> tuple[float, float]:
    """Error of the rotation in radians, and RMS relative length error without noise."""
    exact = observe(scene, np.random.default_rng(0), 0.0, "exact")
    lengths = result.apply(exact).reconstructed_lengths_m(result.pose)
    return (
        turned(result.pose, scene.rig.pose),
        float(np.sqrt(np.mean((lengths / scene.bar_length_m - 1) ** 2))),
    )


def with_gross_errors(rigs: int, share: float, seed: int) -> tuple[FloatArray, FloatArray]:
    """RMS errors (rotation, length) clean and spoiled, (4,); frames bad, named, false, (3,)."""
    off = Misjudged()
    errors, counts = np.empty((rigs, 4)), np.zeros(3)
    for k in range(rigs):
        rng = np.random.default_rng([seed, k])
        scene = random_scene(rng, 30, margin_px=45)
        data = stated(scene, rng, off)
        dirty, bad = spoiled(data, rng, share)
        clean, robust = refine(data, off.settings()), refine(dirty, off.settings())
        errors[k] = *calibration_error(clean, scene), *calibration_error(robust, scene)
        left_out = set(robust.outlying_frames)
        counts += len(bad), len(left_out & set(bad)), len(left_out - set(bad))
    return np.sqrt(np.mean(np.square(errors), axis=0)), counts


def against_the_paper(rigs: int, noise_px: float, seed: int) -> FloatArray:
    """(rigs, 4): mean length error of 2D set, refined; mean reprojection error of 3D, refined.

    The field rig, 25 frames fitted, 25 tested; each lens off by 0.3 % and 5 px in a random sense.
    """
    rows = np.empty((rigs, 4))
    for k in range(rigs):
        rng = np.random.default_rng([seed, k])
        scene = place_bars(field_rig(), rng, 50, 0.9)
        off = [
            lens_off_by(
                camera,
                0.003 * float(rng.choice([-1, 1])),
                tuple(5 * np.sqrt(0.5) * rng.choice([-1, 1], 2)),
            )
            for camera in (scene.rig.primary, scene.rig.secondary)
        ]
        baseline = scene.rig.pose.baseline
        nominal = Nominal(off[0], off[1], baseline, scene.bar_length_m)
        fit, test = held_out(observe(scene, rng, noise_px, "rig", nominal), 25)
        paper, found = calibrate(fit).methods, refine(fit)
        matching, measuring = (errors_of(test, paper[name].pose) for name in ("2d", "3d"))
        both = errors_of(found.apply(test), found.pose)
        rows[k] = (
            matching.mean_length,
            both.mean_length,
            measuring.mean_reprojection_px,
            both.mean_reprojection_px,
        )
    return rows
