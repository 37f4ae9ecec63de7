"""What a parameter file knows about its rig: the prior of a check with new images."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stereocal.errors import DAMAGED, StereocalError
from stereocal.fit.least_squares.noise import ASSUMED, GIVEN
from stereocal.fit.least_squares.small_steps import FACTOR, lens_places, pose_places, rig_at
from stereocal.fit.least_squares.unknowns import DEFAULT_DISTANCE
from stereocal.fit.least_squares.views import Cameras
from stereocal.matching.reconstruction import noise_of_file
from stereocal.rig.camera import Camera
from stereocal.rig.pair import Pair
from stereocal.rig.parameters import RigParameters
from stereocal.system.array_types import FloatArray

SPENT = 12.0
"""Degrees of freedom that a calibration spends on the pose and, in part, on the lenses."""
DEGREES_GIVEN, DEGREES_ASSUMED = 1000.0, 4.0
"""For a noise that was stated, and for one that nothing was known about."""
LENS_ERROR = 0.5
"""Error of the images for each unknown of a lens: rms in units of the noise."""
SMALLEST_EIGENVALUE = 1e-12
"""Least of the correlation; directions below are taken as exact."""


@dataclass(frozen=True, eq=False)
class Prior:
    """Two cameras by a parameter file: normal, a step root N(0, 1) from where they are."""

    rig: RigParameters
    at: Cameras
    root: FloatArray
    """(33, r), with root root^T the covariance of the unknowns of `views`."""
    sigma_px: float
    """Noise of an image coordinate at the calibration."""
    degrees: float
    """Degrees of freedom behind `sigma_px`."""
    scatter_m: float
    """Scatter of the bar's length from frame to frame; 0 if unknown."""
    design_effect: float = 1.0
    """Variance of the parameters over that with independent frames; in the covariance."""

    @property
    def covariance(self) -> FloatArray:
        """(33, 33)."""
        return np.asarray(self.root @ self.root.T)

    def with_lens_errors(self, dataset: Pair) -> "Prior":
        """The prior of lenses with errors that no calibration shows, where the images of a data
        set are.

        A lens is nowhere exactly as its model. The pose of the file makes up for that where its
        bars were, and not elsewhere: bars at other places then look as if a camera had moved.
        """
        covariance, rows = self.covariance, dataset.correspondences
        of_cameras = (rows.primary, dataset.primary), (rows.secondary, dataset.secondary)
        for number, (pixels, camera) in enumerate(of_cameras):
            places = lens_places(number)
            f = float(np.mean(self.at.q[places[:2]]))
            covariance[places, places] += lens_variances(camera, f, pixels, self.sigma_px)
        return replace(self, root=root_of(covariance))

    def with_bar_of(self, dataset: Pair) -> "Prior":
        """The prior for the bar of a data set: that of the calibration, whose factor is correlated
        with the baseline, if its stated length is the same; another has its own standard error.
        """
        stated, length = self.rig.length_m, dataset.target_distance_m
        if stated is not None and np.isclose(stated, length, rtol=1e-6, atol=0.0):
            return self
        q, covariance = self.at.q.copy(), self.covariance
        q[FACTOR], covariance[FACTOR], covariance[:, FACTOR] = 1.0, 0.0, 0.0
        sigma = dataset.target_distance_sigma_m or DEFAULT_DISTANCE * length
        covariance[FACTOR, FACTOR] = (sigma / length) ** 2
        return replace(self, at=self.at._replace(q=q), root=root_of(covariance))


def lens_variances(
    camera: Camera, focal_px: float, pixels: FloatArray, sigma_px: float
) -> FloatArray:
    """(8,): variances of fx, fy, cx, cy, k1, k2, p1, p2 by which pixels (n, 2) move by
    `LENS_ERROR`."""
    x = camera.undistort(pixels)
    f, r2 = focal_px, np.square(x).sum(axis=1)
    # Images move by these, over the change of fx, fy, cx, cy, k1, k2, p1, p2.
    moves = [*np.abs(x).T, 1.0, 1.0, f * r2**1.5, f * r2**2.5, 2 * f * r2, 2 * f * r2]
    sizes = np.array([np.sqrt(np.mean(np.square(move))) for move in moves])
    return np.asarray((LENS_ERROR * sigma_px / sizes) ** 2)


def prior_of(rig: RigParameters, source: str = "parameters") -> Prior:
    """The prior of a parameter file."""
    sigma_px, covariance = noise_of_file(rig)
    if sigma_px is None or covariance is None:
        raise StereocalError(
            f"{source}: the file does not state the covariance of its parameters, so a movement "
            "cannot be separated from their errors. Use the refined file of the same calibration "
            "(parameters_refined.json), or calibrate again."
        )
    entries = rig.uncertainties or {}
    try:
        scatter = float((entries.get("bar_scatter_m") or {}).get("value", 0.0))
        bar = entries.get("bar_length_m") or {"estimate": 1.0, "stated": 1.0}
        factor = float(bar["estimate"]) / float(bar["stated"])
        degrees = _degrees(rig, entries["sigma_px"])
        design_effect = float(entries.get("design_effect", 1.0))
    except DAMAGED as error:
        raise StereocalError(f"{source}: the uncertainties are damaged ({error}).") from error
    root, variances = root_of(covariance), np.abs(np.diag(covariance))
    scale = np.sqrt(np.where(variances > 0, variances, 1.0))
    units = np.outer(scale, scale)
    is_whole = np.allclose(root @ root.T / units, covariance / units, atol=1e-6)
    if not (is_whole and covariance[pose_places(1), pose_places(1)].any() and sigma_px > 0):
        raise StereocalError(f"{source}: the covariance is not symmetric and positive.")
    numbers = np.array([scatter, factor, sigma_px, design_effect])
    if not (np.isfinite(numbers).all() and scatter >= 0 and factor > 0 and design_effect >= 1):
        raise StereocalError(f"{source}: the uncertainties have an impossible noise or length.")
    cameras = rig_at(rig)
    cameras.q[FACTOR] = factor
    return Prior(rig, cameras, root, sigma_px, degrees, scatter, design_effect)


def _degrees(rig: RigParameters, noise: Mapping[str, Any]) -> float:
    """Degrees of freedom of the file's noise; if the file does not state them, three for each bar,
    less what the unknowns spend."""
    if "degrees_of_freedom" in noise:
        return float(np.clip(float(noise["degrees_of_freedom"]), 1.0, DEGREES_GIVEN))
    source, frames = noise.get("source"), rig.inputs.get("frames")
    if source == GIVEN:
        return DEGREES_GIVEN
    if source == ASSUMED or not isinstance(frames, list):
        return DEGREES_ASSUMED
    used = len(set(map(str, frames)) - set(map(str, rig.frames_left_out)))
    return max(3.0 * used - SPENT, DEGREES_ASSUMED)


def root_of(covariance: FloatArray) -> FloatArray:
    """(n, r): root root^T = covariance, whose entries may differ in their units; without what is
    not positive of it."""
    variances = np.diag(covariance)
    scale = np.sqrt(np.where(variances > 0, variances, 1.0))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = values > SMALLEST_EIGENVALUE
    return np.asarray(scale[:, None] * vectors[:, kept] * np.sqrt(values[kept]))
