"""The refined set of two cameras: pose and lenses with their covariance, and each frame's fit."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stereocal.fit.least_squares.design_effect import (
    FEWEST,
    clusters_in,
    covariance_of_boards,
    design_effect,
    lenses_without,
)
from stereocal.fit.least_squares.noise import Noise
from stereocal.fit.least_squares.observations import Observations
from stereocal.fit.least_squares.robust import RobustFit
from stereocal.fit.least_squares.small_steps import FACTOR, with_own_windows
from stereocal.fit.least_squares.stated_windows import cameras_of
from stereocal.fit.least_squares.unknowns import RefineSettings, Unknowns
from stereocal.fit.least_squares.views import DRIFT, EACH, TIME, Cameras
from stereocal.rig.camera import Camera
from stereocal.rig.clusters import Clusters, in_equal_runs
from stereocal.rig.geometry import AT_ORIGIN, Pose
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.rig.tracks import MeasuredOffset, TimeOffset
from stereocal.system.array_types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class RefinedResult:
    """The refined set: pose and lenses with their covariance, and the fit of each frame."""

    dataset: Pair
    settings: RefineSettings
    pose: Pose
    primary: Camera
    secondary: Camera
    rows: BoolArray | None
    """(n,): mask of the rows that were fitted; None for all."""
    unknowns: Unknowns
    """With the measured baseline among the priors of T."""
    p: FloatArray
    """(k,): the estimated free parameters, as deviations from `unknowns.origin`."""
    information: FloatArray
    """(Q, Q): information matrix of the unknowns of `views` from images and lengths, without the
    priors."""
    sigma_px: Noise
    """Standard deviation of an image coordinate."""
    scatter_m: Noise
    """Standard deviation of the bar's length from frame to frame."""
    frames: IntArray
    """(f,): the frame numbers."""
    chi_squares: FloatArray
    """(f,): chi-square of each frame; infinite behind a camera."""
    degrees_of_freedom: IntArray
    """(f,): 3 for a frame with a bar, 1 for a single target; the sum of the parts of an object."""
    outlying: BoolArray
    """(f,): true for the frames that were left out."""
    frame_of: IntArray
    """(u,): index into `frames` of each part of a frame (`Correspondences.parts`), ascending."""
    points_m: FloatArray
    """(u, 2, 3): adjusted 3D points of A and B in the primary's frame, of an object those of each
    part; NaN if not seen."""
    cost: float
    """Sum of the chi-squares of the frames used and of the priors; of a pair of a rig, which has no
    priors of its own, of the frames."""
    steps: int
    stop_reason: str
    seconds: float

    @cached_property
    def at(self) -> Cameras:
        """Where both cameras are, with the stated distortion, for the compiled functions."""
        stated = cameras_of(self.dataset.recording, (AT_ORIGIN, self.pose))
        return stated._replace(q=np.asarray(self.unknowns.origin + self.unknowns.M @ self.p))

    @property
    def prior_cost(self) -> float:
        """The cost of priors and the measured baseline."""
        return float(self.p @ self.unknowns.precision @ self.p)

    @property
    def rig(self) -> Rig:
        """The refined cameras and their pose."""
        return Rig(self.primary, self.secondary, self.pose)

    @cached_property
    def standardised_residuals(self) -> FloatArray:
        """(n,): distances of all pairs from their epipolar lines over their standard deviations."""
        rows = self.dataset.correspondences
        return self.rig.epipolar_errors(rows.primary, rows.secondary) / self.sigma_px.value

    @cached_property
    def clusters(self) -> Clusters:
        """The frames that were not left out, in clusters of alike errors."""
        rows = self.dataset.correspondences.where(self.used_rows)
        return clusters_in(rows, self.rig, self.frames[~self.outlying])

    @property
    def used(self) -> IntArray:
        """Indices of the frames that were not left out."""
        return np.flatnonzero(~self.outlying)

    @property
    def fit(self) -> RobustFit:
        """The fit at its end, for normal equations of parts of the data."""
        fit = self.fit_of(self.dataset, self.rows)
        fit.outlying, fit.chi_squares = self.outlying, self.chi_squares
        return fit

    def fit_of(self, dataset: Pair, rows: BoolArray | None = None) -> RobustFit:
        """The fit of some points with the parameters and the noise of this one."""
        moving = self.settings.time_offset or self.settings.time_drift
        seen = Observations.of(dataset.recording, moving, dataset.of_both(rows))
        fit = RobustFit(seen, self.unknowns, self.settings, self.at.R, np.empty((0, 4)))
        return fit.take(self.p, self.sigma_px.value, self.scatter_m.value)

    @cached_property
    def design_effect(self) -> float:
        """How many times the clusters scatter more than independent frames would; at least 1."""
        if self.settings.of_rig is not None:
            return self.settings.of_rig.design_effect
        rows = self.dataset.correspondences.where(self.used_rows)
        places = rows.primary[np.unique(rows.frame, return_index=True)[1]]
        clusters = self.clusters
        # Errors of lenses may be alike at a place though neighbours do not show it.
        clusters = clusters if clusters.has_runs else in_equal_runs(clusters, places)
        return design_effect(self.fit, self.used, clusters)

    @cached_property
    def images_alone(self) -> tuple[FloatArray, FloatArray]:
        """Normal equations of images and lengths, without priors: H (Q, Q) and the gradient (Q,),
        of all unknowns, free or fixed. Frames that follow each other count less."""
        H, g, _ = self.fit.equations([self.used])
        return H[0] / self.design_effect, g[0] / self.design_effect

    @cached_property
    def p_covariance(self) -> FloatArray:
        """(k, k): covariance of the free parameters, priors included.

        Frames that follow each other count for less: the information of the images is divided by
        the `design_effect`. Where the same boards gave the lenses: `covariance_of_boards`.
        """
        covariance = self.unknowns.covariance(self.information / self.design_effect)
        without = lenses_without(self.dataset, self.settings)
        if not without or len(self.used) < FEWEST:
            return covariance
        H, g, _ = self.fit.equations([*self.used[:, None]])
        names = map(str, self.frames[self.used].tolist())
        equations = dict(zip(names, zip(H, g, strict=True), strict=True))
        return covariance_of_boards(self.unknowns, covariance, equations, without)

    @cached_property
    def p_covariance_by_model(self) -> FloatArray:
        """(k, k): the same if all frames were independent, for degrees of freedom."""
        return self.unknowns.covariance(self.information)

    @cached_property
    def covariance(self) -> FloatArray:
        """(Q, Q): covariance of the unknowns of `views`; 0 for fixed ones."""
        M = self.unknowns.M
        return np.asarray(M @ self.p_covariance @ M.T)

    @cached_property
    def covariance_of_file(self) -> FloatArray:
        """(Q, Q): the same, with the window of each camera in its own frame, as files have it."""
        if not self.dataset.recording.windows:
            return self.covariance
        J = with_own_windows(self.at)[1]
        return np.asarray(J @ self.covariance @ J.T)

    @property
    def used_rows(self) -> BoolArray:
        """(n,): mask of the rows of the frames that were not left out."""
        used = np.isin(self.dataset.correspondences.frame, self.frames[~self.outlying])
        return np.asarray(used if self.rows is None else used & self.rows)

    @property
    def used_points_m(self) -> FloatArray:
        """(v, 2, 3): the points of the frames that were not left out."""
        return self.points_m[~self.outlying[self.frame_of]]

    @property
    def middles_m(self) -> FloatArray:
        """(f, 3): the middle of the bar of each frame, of an object of its longest distance."""
        first = np.searchsorted(self.frame_of, np.arange(len(self.frames)))
        return np.asarray(self.points_m[first].mean(axis=1))

    @property
    def outlying_frames(self) -> dict[int, float]:
        """The frames left out with their share of the total chi-square, largest first."""
        known = np.isfinite(self.chi_squares)
        largest = self.chi_squares[known].max(initial=1.0)
        finite = np.where(known, self.chi_squares, 10 * largest)
        share = finite / max(float(finite.sum()), 1e-300)
        order = np.argsort(-finite, kind="stable")
        return {int(self.frames[i]): float(share[i]) for i in order if self.outlying[i]}

    @property
    def bar_factor(self) -> float:
        """Estimated over stated length of the bar."""
        return float(self.at.q[FACTOR])

    @property
    def time_offset(self) -> MeasuredOffset:
        """The offset of the data set's points, with what the fit adds to it.

        The standard errors are 0 if it is not an unknown.
        """
        stated = self.dataset.time_offset or TimeOffset()
        late = [EACH + TIME, EACH + DRIFT]
        frames, drift = self.at.q[late].tolist()
        sigma = np.sqrt(np.diag(self.covariance)[late])
        return MeasuredOffset(
            stated.frames + frames,
            stated.drift + drift,
            stated.reference,
            float(sigma[0]),
            float(sigma[1]),
        )

    def apply(self, dataset: Pair) -> Pair:
        """A data set of the same rig, with the refined lenses instead of its own."""
        return dataset.changed(primary=self.primary, secondary=self.secondary)
