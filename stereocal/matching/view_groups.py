"""Match and reconstruct the points of three cameras and more.

Two views are compared first: pairs whose rays meet. Every such pair predicts where the other
cameras should see the point, and a point found there joins. A group of views is sound if the
chi-square of its pixels about the point of least squares is; of groups that share an image the one
with more views is taken, then the one that fits better.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import chdtri

from stereocal.errors import StereocalError
from stereocal.fit.least_squares.small_steps import cameras_at
from stereocal.fit.least_squares.views import fit_points, jacobians_of
from stereocal.fit.rig_file import Parameters
from stereocal.matching.pairs_of_rig import pairs_of
from stereocal.matching.reconstruction import Measured, PointErrors, covariance_of
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import AT_ORIGIN
from stereocal.rig.rig import Rig
from stereocal.system.array_types import BoolArray, FloatArray, IntArray

LOST = 0.005
"""Share of correct groups whose chi-square is above the limit."""
PAIR_SIGMAS = 2.1
"""Of the mean reprojection error of a pair over the noise of a coordinate: 99.7 % are below."""
REACH = 4.0
"""Standard deviations from its prediction within which an image joins a pair."""
MOST_GROUPS = 200_000
DECOY_FRAMES = 40
FAR_PX = 1e6
"""More than any image measures."""
NONE = -1


@dataclass(frozen=True, eq=False)
class ViewGroups:
    """The points found in one frame."""

    images: IntArray
    """(k, c): row of each camera's points; -1 where it does not see the point."""
    error_px: FloatArray
    chi_square: FloatArray
    """(k,): as of `Measured`."""
    ambiguous: BoolArray
    """(k,): whether another group with one of its images, and as many of them, is sound too."""

    def __len__(self) -> int:
        return len(self.images)

    @property
    def views(self) -> IntArray:
        """(k,): number of cameras."""
        return np.asarray((self.images >= 0).sum(axis=1))


class ViewFitter:
    """Points of the least sum of squared distances to their images."""

    def __init__(self, rig: Parameters) -> None:
        self.rig, self.names = rig, list(rig.placed)
        self.cameras = [placed.camera for placed in rig.placed.values()]
        self.poses = [placed.pose for placed in rig.placed.values()]
        self.at, self.covariance = cameras_at(self.cameras, self.poses), covariance_of(rig)

    def rays(self, pixels: FloatArray) -> FloatArray:
        """(n, c, 2): undistorted, of pixels (n, c, 2); NaN where not seen."""
        return np.stack(
            [camera.rays_of(pixels[:, c]) for c, camera in enumerate(self.cameras)], axis=1
        )

    def fit(self, pixels: FloatArray, rays: FloatArray, sigma_px: float | None = None) -> Measured:
        """The points of images (n, c, 2); with the noise `sigma_px` all of their errors."""
        noise_px = 1.0 if sigma_px is None else max(sigma_px, 1e-6)
        fitted = fit_points(self.at, pixels, rays, derivatives=sigma_px is not None)
        points, residuals, covariances, by_shared = fitted
        distances = np.linalg.norm(residuals, axis=2)
        views = np.isfinite(distances).sum(axis=1)
        error = np.nansum(distances, axis=1) / np.maximum(views, 1)
        lost = ~np.isfinite(points[:, 0])
        chi_square = np.nansum(np.square(distances), axis=1)
        error[lost], chi_square[lost] = np.nan, np.inf
        errors = PointErrors(noise_px**2 * covariances, by_shared, self.covariance)
        return Measured(points, error, errors, chi_square)


def match_views(
    fitter: ViewFitter,
    points: Sequence[FloatArray],
    sigma_px: float,
    names: Sequence[IntArray] | None = None,
) -> ViewGroups:
    """Match the points of one frame.

    Args:
        points: of each camera (n, 2) raw pixels, in the order of the rig's cameras.
        sigma_px: noise of a pixel coordinate.
        names: of each camera (n,): only points of one number belong together; None: all may.
    """
    if names is None:
        names = [np.zeros(len(pixels), dtype=np.int64) for pixels in points]
    rays = [camera.rays_of(pixels) for camera, pixels in zip(fitter.cameras, points, strict=True)]
    frame = _Frame(fitter, points, rays, names, sigma_px)
    return _chosen(*_sound(frame, _joined(frame, _pairs(frame))))


class _Frame(NamedTuple):
    """The points of one frame, as of `match_views`."""

    fitter: ViewFitter
    points: Sequence[FloatArray]
    rays: Sequence[FloatArray]
    names: Sequence[IntArray]
    sigma: float


def expected_wrong(
    fitter: ViewFitter,
    frames: Sequence[Sequence[FloatArray]],
    sigma_px: float,
    names: Sequence[Sequence[IntArray]],
) -> dict[int, float]:
    """The share of wrong ones among groups of each number of views, at most about.

    The cameras' points are taken from different frames, so that every group found is wrong. (Where
    all points move little between the frames, correct groups are among them, and the share is too
    large; not of points with names, which are taken under different ones.) `names`: as of
    `match_views`, by frame.
    """
    most = max((numbers.max(initial=0) for frame in names for numbers in frame), default=0)
    count, cameras = len(frames), len(fitter.cameras)
    counts, left = np.zeros((2, cameras + 1)), []
    step = max(count // max(cameras, 2), 1)
    for number in range(0, count, max(count // DECOY_FRAMES, 1)):
        of_one, mixed = [number] * cameras, [(number + c * step) % count for c in range(cameras)]
        for row, chosen in enumerate((of_one, mixed)):
            pixels = [frames[frame][c] for c, frame in enumerate(chosen)]
            called = [_turned(names[frame][c], c * row, most) for c, frame in enumerate(chosen)]
            groups = match_views(fitter, pixels, sigma_px, called)
            counts[row] += np.bincount(groups.views, minlength=cameras + 1)
            if not row:
                several = groups.images[groups.views > 2]
                left += [1 - (several >= 0).sum() / max(sum(map(len, pixels)), 1)]
    real, decoy = counts
    decoy[2] *= np.square(np.mean(left))  # only images that are not in larger groups are free
    return {
        views: float(min(decoy[views] / real[views], 1.0))
        for views in range(2, cameras + 1)
        if real[views]
    }


def _turned(names: IntArray, by: int, most: int) -> IntArray:
    """Other names in place of those from 1 to `most`."""
    return np.where(names > 0, (names - 1 + by) % max(most, 1) + 1, 0)


def images_of_groups(groups: IntArray, points: Sequence[FloatArray]) -> FloatArray:
    """(k, c, 2): the pixels, or rays, of groups; NaN where not seen."""
    images = np.full((*groups.shape, 2), np.nan)
    for c, pixels in enumerate(points):
        seen = groups[:, c] >= 0
        images[seen, c] = pixels[groups[seen, c]]
    return images


def _pairs(frame: _Frame) -> IntArray:
    """Groups (k, c) of the two views of each pair of one name whose rays meet."""
    fitter, points, rays, names, sigma = frame
    parts = list[IntArray]()
    for a, b in combinations(range(len(points)), 2):
        if not (len(points[a]) and len(points[b])):
            continue
        pose = fitter.poses[b] @ fitter.poses[a].inverse()
        rig = Rig(fitter.cameras[a], fitter.cameras[b], pose)
        one, other, *_ = pairs_of(rig, rays[a], rays[b], PAIR_SIGMAS * sigma, 0.0, float("inf"))
        same = names[a][one] == names[b][other]
        one, other = one[same], other[same]
        groups = np.full((len(one), len(points)), NONE, dtype=np.int64)
        groups[:, a], groups[:, b] = one, other
        parts.append(groups)
    together = np.concatenate(parts) if parts else np.empty((0, len(points)), np.int64)
    if len(together) > MOST_GROUPS:
        raise StereocalError(
            f"A frame has {len(together)} pairs of points that could belong together: state the "
            "noise of the points, or leave out points that are none.",
            option="--sigma-px",
        )
    return together


def _joined(frame: _Frame, pairs: IntArray) -> IntArray:
    """Pairs with the nearest image of their name in every other camera near its prediction."""
    fitter, points, rays, names, sigma = frame
    images = images_of_groups(pairs, points)
    measured = fitter.fit(images, images_of_groups(pairs, rays))
    groups, poses = pairs.copy(), fitter.poses
    called = _names_of(pairs, names)
    for c, pixels in enumerate(points):
        free = np.flatnonzero((pairs[:, c] < 0) & np.isfinite(measured.xyz[:, 0]))
        if not (len(pixels) and len(free)):
            continue
        seen = poses[c].apply(measured.xyz[free])
        predicted = fitter.cameras[c].project(seen)
        known = np.isfinite(predicted[:, 0])
        free, predicted, seen = free[known], predicted[known], seen[known]
        # how far off the prediction is, from the noise of the two images
        spread = poses[c].R @ measured.errors.own[free] @ poses[c].R.T
        J = _by_point(fitter.cameras[c], seen)
        variance = np.einsum("nij,njk,nik->ni", J, spread, J).max(axis=1)
        # the name is a third coordinate, in which other names are out of reach
        tree = cKDTree(np.column_stack([pixels, FAR_PX * names[c]]))
        distance, nearest = tree.query(np.column_stack([predicted, FAR_PX * called[free]]))
        near = distance <= REACH * sigma * np.sqrt(1.0 + variance)
        groups[free[near], c] = np.asarray(nearest)[near]
    return np.unique(np.concatenate([groups, pairs]), axis=0)


def _by_point(camera: Camera, points: FloatArray) -> FloatArray:
    """(n, 2, 3): derivatives of the pixels of points (n, 3), in the camera's frame, by these."""
    if camera.window is not None:
        return jacobians_of(cameras_at([camera], [AT_ORIGIN]), points)[0][:, 0]
    on_plane = points[:, :2] / points[:, 2:]
    J = np.zeros((len(points), 2, 3))
    J[:, 0, 0] = J[:, 1, 1] = 1.0 / points[:, 2]
    J[:, :, 2] = -on_plane / points[:, 2:]
    return np.asarray(camera.pixel_jacobians(on_plane) @ J)


def _names_of(groups: IntArray, names: Sequence[IntArray]) -> IntArray:
    """(k,): the name of each group's images, which is one."""
    group_names = np.zeros(len(groups), dtype=np.int64)
    for c, numbers in enumerate(names):
        seen = groups[:, c] >= 0
        group_names[seen] = numbers[groups[seen, c]]
    return group_names


def _sound(frame: _Frame, groups: IntArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """The groups whose pixels agree, their errors and chi-squares."""
    fitter, points, rays, _, sigma = frame
    images = images_of_groups(groups, points)
    measured = fitter.fit(images, images_of_groups(groups, rays))
    limits = np.append([0.0, 0.0], chdtri(2.0 * np.arange(2, len(points) + 1) - 3.0, LOST))
    views = np.asarray((groups >= 0).sum(axis=1))
    sound = measured.chi_square <= sigma**2 * limits[views]
    return groups[sound], measured.error_px[sound], measured.chi_square[sound]


def _chosen(groups: IntArray, error_px: FloatArray, chi_square: FloatArray) -> ViewGroups:
    """Groups that share no image: first those with more views, then those that fit better."""
    views = (groups >= 0).sum(axis=1)
    freedom = np.maximum(2 * views - 3, 1)
    order = np.lexsort((chi_square / freedom, -views))
    taken: dict[tuple[int, int], int] = {}
    chosen, rivals = list[int](), dict[int, int]()
    for k in order.tolist():
        images = [(c, image) for c, image in enumerate(groups[k].tolist()) if image >= 0]
        owners = {taken[image] for image in images if image in taken}
        for owner in owners:
            # a part of a group is no rival of it
            part = all(taken.get(image) == owner for image in images)
            if not part:
                rivals[owner] = max(rivals.get(owner, 0), len(images))
        if not owners:
            chosen.append(k)
            taken.update(dict.fromkeys(images, k))
    picked = np.array(chosen, dtype=np.int64)
    ambiguous = [rivals.get(k, 0) >= int((groups[k] >= 0).sum()) for k in chosen]
    flags = np.array(ambiguous, bool)
    return ViewGroups(groups[picked], error_px[picked], chi_square[picked], flags)
