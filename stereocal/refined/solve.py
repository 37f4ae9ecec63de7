"""The solve of the refined method for a pair of cameras."""

import numpy as np

from stereocal.refined.distortion import lens_terms
from stereocal.refined.robust import ESTIMATED, RobustFit
from stereocal.refined.two_views import views_of
from stereocal.refined.unknowns import ANGLES, RefineSettings, Unknowns, unknowns_of
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import BoolArray, FloatArray
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Pose
from stereocal.rig.tracks import TimeOffset


class Solve(RobustFit):
    """A solve of two cameras, from one initial pose; units are `Correspondences.parts`."""

    def __init__(
        self, dataset: Dataset, start: Pose, settings: RefineSettings, rows: BoolArray | None = None
    ) -> None:
        self.dataset, self.settings = dataset, settings
        table = dataset.correspondences
        kept = np.ones(len(table), dtype=np.bool_) if rows is None else rows
        bars = kept[table.bars].all(axis=1)
        unknowns = unknowns_of(dataset, start, settings, bool(bars.any()))
        part, place = (own[kept] for own in table.parts)
        _, first, at = np.unique(part, return_index=True, return_inverse=True)
        self.frames, self.frame_of = np.unique(table.frame[kept][first], return_inverse=True)
        n = len(first)
        self.pixels, self.rays = np.full((n, 2, 2, 2), np.nan), np.full((n, 2, 2, 2), np.nan)
        self.pixels[at, place, 0] = table.primary[kept]
        self.pixels[at, place, 1] = table.secondary[kept]
        self.rays[at, place] = dataset.rays[:, kept].T.reshape(-1, 2, 2)
        self.motion = np.zeros((0, 2, 2, 3))
        if settings.time_offset or settings.time_drift:
            offset = dataset.time_offset or TimeOffset()
            self.motion = np.zeros((n, 2, 2, 3))
            self.motion[at, place, 1, :2] = np.nan_to_num(table.motion[kept, :2])
            self.motion[at, place, 1, 2] = table.time_frame[kept] - offset.reference
        self.pixel_variance = np.ones((len(self.frames), len(table.names)))
        of_rows = self.frame_of[at], table.target[kept]
        self.pixel_variance[of_rows] = 0.5 + 0.5 * np.nan_to_num(table.motion[kept, 2], nan=1.0)
        self.distances = np.full(n, np.nan)
        of_bars = at[np.searchsorted(np.flatnonzero(kept), table.bars[bars, 0])]
        self.distances[of_bars] = dataset.bar_distances_m[bars]
        self.lenses = lenses_of_cameras(dataset.primary, dataset.secondary)
        self.R, self.baselines = np.empty((2, 3, 3)), np.empty((0, 4))
        self._begin(unknowns, dataset.target_distance_m)
        if settings.rest is not None:
            self.p = settings.rest.start(unknowns)

    def views(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        return views_of(q)

    def start_near(
        self, unknowns: Unknowns, p: FloatArray, sigma_px: float, scatter_m: float
    ) -> bool:
        """Start where another fit ended, with its noise; False if its unknowns are others."""
        if unknowns.names != self.unknowns.names:
            return False
        self.p[len(ANGLES) :] = p[len(ANGLES) :]  # the angles are in the initial pose
        if self.source_px == ESTIMATED:
            self.sigma_px = sigma_px
        if self.source_scatter == ESTIMATED:
            self.scatter = scatter_m
        self._evaluate(self.limit)
        self.outlying = ~(self.chi_squares <= self.limit)
        self.is_near = self.settings.loss == "robust" and not self.outlying.all()
        return self.is_near

    def chi_squares_for(
        self, unknowns: Unknowns, p: FloatArray, sigma_px: float, scatter_m: float
    ) -> FloatArray:
        """(f,): the chi-squares of the frames with another fit's parameters and noise."""
        self.start_with(unknowns, p)
        self.sigma_px, self.scatter = sigma_px, scatter_m
        self._evaluate(self.limit)
        return self.chi_squares

    def better_than(self, other: "Solve") -> bool:
        """Whether the frames fit better here, both measured with the smaller noise."""
        noise = min(self.sigma_px, other.sigma_px)
        own, its = (
            float(np.minimum(a.chi_squares * (a.sigma_px / noise) ** 2, a.limit).sum())
            for a in (self, other)
        )
        return own < its


def lenses_of_cameras(*cameras: Camera) -> FloatArray:
    """(c, 23): skew and `lens_terms` of cameras."""
    return np.array([np.append(c.K[0, 1], lens_terms(c)) for c in cameras])
