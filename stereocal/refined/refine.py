"""Method 4, refined: one set that matches and measures, by one weighted least squares.

Pixel residuals over their noise, lengths of the bar over their scatter, and priors on the measured
baseline, the measured bar and both lenses are adjusted together (`adjustment`). The places of the
targets are eliminated, so a bar far away or along the line of sight weighs as little as the images
say of its length.

Frames with gross errors are found, named and left out (`solve`); the covariance is that of the
least squares over the others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from stereocal.calibration.essential import calibrate_essential, choose_pose
from stereocal.errors import StereocalError
from stereocal.refined.bar_fit import BAR, BASELINE, EPSILON, PRIMARY, SECONDARY
from stereocal.refined.solve import Noise, Solve, lenses_of
from stereocal.refined.unknowns import RefineSettings, Unknowns, camera_of, with_lens_priors
from stereocal.rig.camera import Camera
from stereocal.rig.compilations import clock
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Angles, Pose, residuals

OUT_OF_STEPS = "the largest number of steps was reached"
UNBELIEVABLE_PX = 30.0
"""Noise beyond this is no noise: the points do not belong together."""


@dataclass(frozen=True, eq=False)
class RefinedResult:
    """The one set: pose and lenses with their covariance, and how each frame fits."""

    dataset: Dataset
    settings: RefineSettings
    pose: Pose
    primary: Camera
    secondary: Camera
    rows: BoolArray | None
    """(n,), the rows that were fitted; None for all."""
    unknowns: Unknowns
    p: FloatArray
    """(k,), what was estimated, as departures from `unknowns.origin`."""
    information: FloatArray
    """(15, 15), of the images and lengths on the shared unknowns, without the priors."""
    sigma_px: Noise
    scatter_m: Noise
    """Error of the bar's length that differs from frame to frame."""
    frames: IntArray
    """(f,), the frame numbers."""
    misfits: FloatArray
    """(f,): sum of squares of each frame in standard deviations; infinite behind a camera."""
    freedom: IntArray
    """(f,): what a good frame's misfit is on average: 3 for a bar, 1 for a single target."""
    outlying: BoolArray
    """(f,): the frames that were left out."""
    places_m: FloatArray
    """(f, 2, 3): A and B in the primary's frame, with the lengths taken in; NaN if not seen."""
    cost: float
    """Sum of the misfits of the frames used and of the priors."""
    steps: int
    stop_reason: str
    seconds: float

    @cached_property
    def q(self) -> FloatArray:
        """(15,): the shared unknowns, as in `bar_fit`."""
        return np.asarray(self.unknowns.origin + self.unknowns.M @ self.p)

    @cached_property
    def lenses(self) -> FloatArray:
        """(2, 23): skew and distortion of both lenses, for the compiled functions."""
        return lenses_of(self.dataset)

    @cached_property
    def p_covariance(self) -> FloatArray:
        """(k, k): covariance of the free numbers, priors included."""
        M = self.unknowns.M
        A = M.T @ self.information @ M + np.diag(self.unknowns.precision)
        scale = 1.0 / np.sqrt(np.diag(A))
        return np.asarray(np.linalg.inv(A * np.outer(scale, scale)) * np.outer(scale, scale))

    @cached_property
    def covariance(self) -> FloatArray:
        """(15, 15): covariance of the shared unknowns; 0 for those held fixed."""
        M = self.unknowns.M
        return np.asarray(M @ self.p_covariance @ M.T)

    @property
    def outlying_frames(self) -> dict[int, float]:
        """The frames left out with their share of the misfit of all frames, largest first."""
        finite = np.where(np.isfinite(self.misfits), self.misfits, np.nanmax(self._known) * 10)
        share = finite / max(float(finite.sum()), 1e-300)
        order = np.argsort(-finite, kind="stable")
        return {int(self.frames[i]): float(share[i]) for i in order if self.outlying[i]}

    @property
    def _known(self) -> FloatArray:
        return np.append(self.misfits[np.isfinite(self.misfits)], 1.0)

    @property
    def bar_factor(self) -> float:
        """True over stated length of the bar, as estimated."""
        return float(self.q[BAR])

    def apply(self, dataset: Dataset) -> Dataset:
        """Another data set of the same rig, seen through the refined lenses."""
        return replace(dataset, primary=self.primary, secondary=self.secondary)


def refine(
    dataset: Dataset,
    settings: RefineSettings | None = None,
    start: Pose | None = None,
    rows: BoolArray | None = None,
) -> RefinedResult:
    """The refined set of a data set.

    Args:
        rows: (n,), which rows to fit; all when not given.
        start: where to begin, such as the essential method's pose; found here when not given.
            Where frames stand out, a start that ignores gross errors is tried too.

    Raises:
        StereocalError: too few points, no scale, or nothing that fits.
    """
    settings = with_lens_priors(settings or RefineSettings(), dataset)
    began = clock()
    found: Solve | None = None
    rays = dataset.rays if rows is None else np.ascontiguousarray(dataset.rays[:, rows])
    for pose in _starts(dataset, rays, start, settings):
        if found is not None and not found.outlying.any():
            break
        other = _solved(dataset, pose, settings, rows)
        if found is None or (other is not None and other.better_than(found)):
            found = other
    if found is None or found.sigma_px > UNBELIEVABLE_PX:
        raise StereocalError(
            "The refined method found no position of the cameras that fits: check that points, "
            "targets and camera files are not exchanged."
        )
    return _result(found, rows, clock() - began)


def _starts(
    dataset: Dataset, rays: FloatArray, start: Pose | None, settings: RefineSettings
) -> list[Pose]:
    """Where to begin: the given or the essential pose and one that ignores gross errors.

    The better one, by the median of the residuals, comes first.
    """
    if start is None:
        try:
            start = calibrate_essential(rays, dataset.baseline_m).pose
        except StereocalError:
            start = None
    robust = robust_start(dataset, rays) if settings.loss == "robust" else None
    found = [pose for pose in (start, robust) if pose is not None]
    return sorted(
        found,
        key=lambda pose: float(
            np.median(np.abs(residuals(pose.essential, rays[:2].T, rays[2:].T)))
        ),
    )


def robust_start(dataset: Dataset, rays: FloatArray) -> Pose | None:
    """The pose of an essential matrix that ignores wrong pairs (MAGSAC++, from OpenCV)."""
    if rays.shape[1] < 6:
        return None
    focal = float(np.sqrt(np.prod(dataset.pixel_scale[:, 0])))
    E, _ = cv2.findEssentialMat(
        np.ascontiguousarray(rays[:2].T), np.ascontiguousarray(rays[2:].T), np.eye(3),
        method=cv2.USAC_MAGSAC, prob=0.9999, threshold=2.0 / focal,
    )  # fmt: skip
    if E is None or np.shape(E) != (3, 3):
        return None
    R, t, in_front = choose_pose(np.asarray(E, dtype=np.float64), rays)
    return Pose(R, dataset.baseline_m * t) if in_front else None


def _solved(
    dataset: Dataset, start: Pose, settings: RefineSettings, rows: BoolArray | None
) -> Solve | None:
    """The solve from one start; None if it leads nowhere."""
    solve = Solve(dataset, start, settings, rows)
    return solve if solve.run() else None


def _result(solve: Solve, rows: BoolArray | None, seconds: float) -> RefinedResult:
    """What a finished solve says."""
    q = solve.q
    seen = np.isfinite(solve.pixels[:, :, :1])
    return RefinedResult(
        dataset=solve.dataset,
        settings=solve.settings,
        pose=Pose.from_angles(Angles(*q[: EPSILON + 1].tolist()), float(q[BASELINE])),
        primary=camera_of(solve.dataset.primary, q[PRIMARY : PRIMARY + 4]),
        secondary=camera_of(solve.dataset.secondary, q[SECONDARY : SECONDARY + 4]),
        rows=rows,
        unknowns=solve.unknowns,
        p=solve.p,
        information=solve.H,
        sigma_px=Noise(solve.sigma_px, solve.source_px),
        scatter_m=Noise(solve.scatter, solve.source_scatter),
        frames=solve.frames,
        misfits=solve.misfits,
        freedom=solve.freedom,
        outlying=solve.outlying,
        places_m=np.where(seen, solve.places.reshape(-1, 2, 3), np.nan),
        cost=float(solve.cost),
        steps=solve.steps,
        stop_reason="converged" if solve.converged else OUT_OF_STEPS,
        seconds=seconds,
    )
