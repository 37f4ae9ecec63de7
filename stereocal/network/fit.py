"""The joint adjustment of a rig: the robust fit of `refined.robust` over N views."""

from collections.abc import Sequence

import numpy as np

from stereocal.network.placings import observations_of
from stereocal.network.unknowns import RigSettings, baselines_of, unknowns_of
from stereocal.refined.adjustment import add_baselines
from stereocal.refined.refine import RefinedResult
from stereocal.refined.robust import RobustFit
from stereocal.refined.two_views import views_of
from stereocal.refined.unknowns import RefineSettings
from stereocal.refined.views import EACH, Cameras
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import Recording


class RigFit(RobustFit):
    """A fit from first poses."""

    def __init__(
        self,
        recording: Recording,
        poses: Sequence[Pose],
        settings: RigSettings,
        velocities: FloatArray | None = None,
    ) -> None:
        """From first poses; velocities (n, 2) of the points in pixels per frame, if known."""
        self.recording, self.rig_settings = recording, settings
        seen = observations_of(recording, velocities)
        unknowns = unknowns_of(recording, poses, settings, seen.has_lengths)
        R, baselines = np.array([pose.R for pose in poses]), baselines_of(recording, settings)
        super().__init__(seen, unknowns, RefineSettings(), R, baselines)

    @property
    def cameras(self) -> Cameras:
        """As of `views`, with the stated distortion."""
        return self.views(self.q)[0]

    @property
    def poses(self) -> list[Pose]:
        """`camera_from_reference` of each camera."""
        T = self.q[:-1].reshape(-1, EACH)[:, 3:6]
        return [Pose(R, own) for R, own in zip(self.R, T, strict=True)]

    @property
    def information(self) -> FloatArray:
        """(Q, Q): of images, lengths and baselines, without the other priors."""
        H = self.H.copy()
        add_baselines(self.baselines, self.q, self.R, H, np.empty(len(H)))
        return H

    def end_at(self, pair: RefinedResult) -> None:
        """Take the refined set of a pair, where there are no other cameras."""
        q, self.R, _ = views_of(pair.q)
        self.p = np.linalg.pinv(self.unknowns.M) @ (q - self.unknowns.origin)
        self.sigma_px, self.scatter = pair.sigma_px.value, pair.scatter_m.value
        self.outlying = np.isin(self.frames, pair.frames[pair.outlying])
        self.evaluate(np.where(self.outlying, 0.0, np.inf))
        self.cost, self.steps, self.converged = pair.cost, pair.steps, True
