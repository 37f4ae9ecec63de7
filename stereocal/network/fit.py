"""The joint adjustment of a rig: the robust fit of `refined.robust` over N views."""

from collections.abc import Mapping, Sequence

import numpy as np

from stereocal.network.placings import images_of, placings_of
from stereocal.network.unknowns import RigSettings, baselines_of, unknowns_of
from stereocal.refined.adjustment import add_baselines
from stereocal.refined.refine import RefinedResult
from stereocal.refined.robust import ESTIMATED, RobustFit
from stereocal.refined.solve import lenses_of_cameras
from stereocal.refined.two_views import views_of
from stereocal.refined.unknowns import RefineSettings
from stereocal.refined.views import EACH, Cameras
from stereocal.rig.compiled import BoolArray, FloatArray
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
        self.recording, self.rig_settings, self.settings = recording, settings, RefineSettings()
        self.placings = own = placings_of(recording)
        cameras, bars = list(recording.cameras.values()), bool(np.isfinite(own.distances).any())
        self.frames, self.frame_of = own.frames, own.of_frame
        self.pixels, self.distances = own.pixels, own.distances
        unknowns = unknowns_of(recording, poses, settings, bars)
        self.baselines = baselines_of(recording, settings)
        self.R = np.array([pose.R for pose in poses])
        self.lenses = lenses_of_cameras(*cameras)
        self.rays = np.full(own.pixels.shape, np.nan)
        for number, camera in enumerate(cameras):
            seen = own.seen[:, :, number]
            self.rays[:, :, number][seen] = camera.undistort(own.pixels[:, :, number][seen])
        self.motion = np.empty((0, 2, len(cameras), 3))
        if velocities is not None:
            frames, every = images_of(recording, np.pad(velocities, [(0, 0), (0, 1)]))
            of_unit = np.searchsorted(frames, own.frames[own.of_frame])
            self.motion = np.nan_to_num(every[of_unit[:, None], own.targets])
        self.pixel_variance = np.ones(len(self.frames))
        self._begin(unknowns, recording.object.longest_m)
        self.turns = self._within(3)

    def views(self, q: FloatArray) -> tuple[FloatArray, FloatArray, None]:
        return q, self.R, None

    @property
    def cameras(self) -> Cameras:
        """As of `views`, with the stated distortion."""
        return Cameras(self.q, self.R, self.lenses)

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

    def start_at(self, p: Mapping[str, float], sigma_px: float) -> None:
        """Start where another fit ended, as far as it has the same free parameters."""
        found = np.array([p.get(name, 0.0) for name in self.unknowns.names])
        self.p = np.where(self._within(6), 0.0, found)  # the poses are in the first ones
        self.sigma_px = sigma_px if self.source_px == ESTIMATED else self.sigma_px

    def end_at(self, pair: RefinedResult) -> None:
        """Take the refined set of a pair, where there are no other cameras."""
        q, self.R, _ = views_of(pair.q)
        self.p = np.linalg.pinv(self.unknowns.M) @ (q - self.unknowns.origin)
        self.sigma_px, self.scatter = pair.sigma_px.value, pair.scatter_m.value
        self.outlying = np.isin(self.frames, pair.frames[pair.outlying])
        self._evaluate(np.where(self.outlying, 0.0, np.inf))
        self.cost, self.steps, self.converged = pair.cost, pair.steps, True

    def _within(self, first: int) -> BoolArray:
        """(k,): the free parameters among a camera's `first` ones: 3 rotations, 6 of the pose."""
        places = np.arange(len(self.unknowns.origin)) % EACH < first
        places[-1] = False
        return np.asarray(self.unknowns.M[places].any(axis=0))
