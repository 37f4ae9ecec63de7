"""Points seen through windows: matched, measured and brought into step as those in air are."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest

from stereocal.field.world.find import find_world
from stereocal.field.world.frame import Line, Survey, Throw
from stereocal.fit.about_rig import AboutRig
from stereocal.fit.errors.uncertainty import point_errors
from stereocal.fit.least_squares.small_steps import (
    camera_at,
    derivatives_by_rig,
    moved,
    pose_at,
    pose_places,
    rig_at,
    window_places,
)
from stereocal.fit.least_squares.views import DISTORTION, EACH, LENS
from stereocal.fit.rig_file import RigFile
from stereocal.matching.in_step import SHIFT, points_in_step
from stereocal.matching.matching import match_points, nearest_errors, refuse_different_rigs
from stereocal.matching.pairs_of_rig import pairs_of
from stereocal.matching.reconstruction import midpoints
from stereocal.matching.threshold import choose_threshold
from stereocal.matching.view_groups import ViewFitter, match_views
from stereocal.rig.camera import Camera
from stereocal.rig.epipolar_curve import epipolar_curve
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import RigParameters
from stereocal.rig.tracks import MeasuredOffset
from stereocal.system.array_types import FloatArray
from tests.refused import refused
from tests.rigs.behind_glass import Submerged, Tank, submerged

NOISE = 0.2
TANKS = {
    "one wall": Tank(tilt_deg=5.0),
    "two housings": Tank(each=True, wall_m=0.03),
    "one in air": Tank(each=True, wall_m=0.03),
}


@cache
def drawn(name: str) -> tuple[RigParameters, FloatArray]:
    """The true rig, and points (n, 3) in its volume."""
    truth = submerged(TANKS[name], np.random.default_rng(3), 200)
    (one, other), pose = truth.cameras.values(), truth.true_poses[1]
    if name == "one in air":
        other = replace(other, window=None)
    rig = RigParameters(one, other, pose, "refined", 0.0, {}, {}, noise_px=NOISE)
    points = truth.ends_m.reshape(-1, 3)
    return rig, points[one.sees(points) & other.sees(pose.apply(points))]


def images(rig: RigParameters, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    return rig.primary.project(points), rig.secondary.project(rig.pose.apply(points))


def frames_of(
    rig: RigParameters, points: FloatArray, rng: np.random.Generator
) -> list[tuple[FloatArray, FloatArray]]:
    """15 points a frame with their noise, and in each image 3 more of nothing; those of the
    secondary in the opposite order."""
    frames = []
    for rows in np.split(rng.permutation(len(points))[: len(points) // 15 * 15], len(points) // 15):
        of_nothing = rng.uniform(0.0, rig.primary.image_size, (2, 3, 2))
        seen = images(rig, points[rows])
        noisy = [px + rng.normal(0.0, NOISE, px.shape) for px in seen]
        primary, secondary = (np.vstack(both) for both in zip(noisy, of_nothing, strict=True))
        frames.append((primary, secondary[::-1]))
    return frames


@pytest.mark.parametrize("name", TANKS)
class TestPairs:
    def test_errors_of_all_pairs_are_those_of_the_rig(self, name: str) -> None:
        rig, points = drawn(name)
        first, second = images(rig, np.resize(points, (300, 3)))
        i, j = np.divmod(np.arange(300 * 300), 300)
        table = rig.reprojection_errors(first[i], second[j]).mean(axis=1).reshape(300, 300)
        near, far = np.quantile(points[:, 2], (0.1, 0.9))
        depth = rig.reconstruct(first[i], second[j])[:, 2].reshape(300, 300)
        table[~((depth >= near) & (depth <= far))] = np.nan
        rays = rig.primary.rays_of(first), rig.secondary.rays_of(second)
        row, column, px, of_first, of_second = pairs_of(rig, *rays, 20.0, near, far)
        np.testing.assert_array_equal((row, column), np.nonzero(table <= 20.0))
        # Sums in another order; measured: 3e-9 px, of rays that are nearly parallel.
        np.testing.assert_allclose(px, table[row, column], rtol=0, atol=1e-8)
        filled = np.where(np.isnan(table), np.inf, table)
        np.testing.assert_allclose(of_first, np.sort(filled, axis=1)[:, :2], atol=1e-8)
        np.testing.assert_allclose(of_second, np.sort(filled, axis=0)[:2].T, atol=1e-8)
        nearest = nearest_errors(rig, [(first, second)], (near, far))
        np.testing.assert_array_equal(nearest, of_first)

    def test_partners_are_found_and_others_are_not(self, name: str) -> None:
        rig, points = drawn(name)
        frames = frames_of(rig, points, np.random.default_rng(4))
        choice = choose_threshold(rig, frames)
        assert choice.noise is not None and choice.noise.source == "estimated"
        # 26 frames of 15: a standard error of 4 %; measured: 4 to 6 % above.
        assert choice.noise.sigma_px == pytest.approx(NOISE, rel=0.15)
        found = [match_points(rig, *frame, choice.threshold_px) for frame in frames]
        right = np.concatenate([m.secondary == 17 - m.primary for m in found])
        true = np.concatenate([m.primary < 15 for m in found]) & right
        assert true.sum() >= 0.97 * 15 * len(frames)  # measured: 98.7 %
        # By chance a point of nothing is near the line of another; measured: 98.7 %.
        assert right.mean() >= 0.95
        px = np.concatenate([m.error_px for m in found])[true]
        # Both cameras have half of the error across, whose mean is sqrt(2 / pi) of its deviation;
        # measured: 4 to 6 % above.
        assert px.mean() == pytest.approx(np.sqrt(1 / np.pi) * NOISE, rel=0.15)

    def test_exact_points_are_measured_exactly(self, name: str) -> None:
        rig, points = drawn(name)
        pixels = np.stack(images(rig, points), axis=1)
        measured = midpoints(rig, pixels, None)
        # Of the inverse of the distortion; measured: 1e-14 m.
        np.testing.assert_allclose(measured.xyz, points, rtol=0, atol=1e-9)
        assert measured.error_px.max() < 1e-6
        assert measured.errors.shared.shape == (43, 43)

    def test_derivatives_of_points_by_the_windows_too(self, name: str) -> None:
        rig, points = drawn(name)
        pixels, steps = images(rig, points[:20]), 1e-5 * np.eye(len(rig_at(rig).q))
        if name == "one in air":  # which has no window to move
            steps[:, window_places(1, 2)] = 0.0
        by_rig = derivatives_by_rig(lambda of: of.reconstruct(*pixels).ravel(), rig, steps)
        _, jacobian = point_errors(rig_at(rig), 1.0, points[:20])
        # Without the reference's pose, which a rig has at the origin, and what is of time.
        others = np.setdiff1d(np.arange(42), [*range(6), 14, 15, 30, 31])
        expected, by_rig = 1e-5 * jacobian.reshape(60, -1)[:, others], by_rig[:, others]
        # The square of the steps; measured: 1e-9 of the largest.
        assert np.abs(by_rig - expected).max() < 1e-7 * np.abs(expected).max()

    def test_the_epipolar_curve_passes_through_the_image(self, name: str) -> None:
        rig, points = drawn(name)
        for first, second in zip(*images(rig, points[:40]), strict=True):
            curve = epipolar_curve(rig, "primary", "secondary", first)
            begin, along = curve[:-1], np.diff(curve, axis=0)
            part = np.sum((second - begin) * along, axis=1) / np.square(along).sum(axis=1)
            off = second - begin - np.clip(part, 0.0, 1.0)[:, None] * along
            # Of straight parts between 320 points; measured: 0.0006 px.
            assert np.linalg.norm(off, axis=1).min() < 0.01

    def test_points_are_brought_into_step(self, name: str) -> None:
        rig, points = drawn(name)
        late = replace(rig, time_offset=MeasuredOffset(0.4, sigma=0.001))
        middle, frames = points.mean(axis=0), np.arange(120.0)

        def path(times: FloatArray) -> FloatArray:
            turn = np.stack([np.sin(0.21 * times), np.cos(0.17 * times), np.sin(0.13 * times)])
            return np.asarray(middle + 0.04 * turn.T)

        first, second = images(rig, path(frames))[0], images(rig, path(frames + 0.55))[1]
        tables = {
            camera: pd.DataFrame({"frame": frames.astype(int), "u": px[:, 0], "v": px[:, 1]})
            for camera, px in (("primary", first), ("secondary", second))
        }
        in_step, _ = points_in_step(late, tables)
        # By interpolation; measured: 0.55000, and the file says 0.4.
        assert in_step["secondary"][SHIFT].median() == pytest.approx(0.55, abs=1e-3)


@cache
def three() -> Submerged:
    return submerged(Tank(cameras=3), np.random.default_rng(6), 250)


def rig_file_of(
    cameras: Mapping[str, Camera], poses: Mapping[str, Pose], covariance: FloatArray
) -> RigFile:
    late = dict.fromkeys(cameras, 0.0)
    return RigFile(cameras, poses, late, covariance, NOISE, AboutRig(pairs={}))


class TestThreeCamerasAtOneWall:
    def test_exact_images_give_the_points_and_belong_together(self) -> None:
        truth = three()
        fitter = ViewFitter(rig_file_of(truth.cameras, truth.poses, np.zeros((49, 49))))
        assert fitter.covariance.shape == (64, 64)
        points = truth.ends_m.reshape(-1, 3)
        pixels = self.seen(list(truth.cameras.values()), truth.true_poses, points)
        fitted = fitter.fit(pixels, fitter.rays(pixels))
        # Of points of the least squares; measured: 2e-15 m.
        np.testing.assert_allclose(fitted.xyz, points, rtol=0, atol=1e-9)
        rng, wrong = np.random.default_rng(7), 0
        for rows in np.split(rng.permutation(500), 10):
            noisy = pixels[rows] + rng.normal(0.0, NOISE, (50, 3, 2))
            seen = [np.flatnonzero(np.isfinite(noisy[:, c, 0])) for c in range(3)]
            found = match_views(fitter, [noisy[of, c] for c, of in enumerate(seen)], NOISE)
            assert len(found) >= 48  # measured: 49 or 50
            for group in found.images[found.views == 3]:
                wrong += len({int(seen[c][k]) for c, k in enumerate(group)}) > 1
        assert wrong <= 5  # of 458 with all views; measured: 0

    def test_errors_of_points_scatter_as_stated(self) -> None:
        """Cameras and windows off by their covariance, 100 times, for five points each."""
        truth, rng = three(), np.random.default_rng(8)
        sigmas = np.zeros(64)
        for c in range(3):
            first = EACH * c
            sigmas[pose_places(c)] = [2e-4] * 3 + [3e-4] * 3 if c else 0.0
            sigmas[first + LENS : first + LENS + 4] = 0.5
            sigmas[first + DISTORTION : first + DISTORTION + 4] = [1e-3, 1e-3, 1e-4, 1e-4]
            sigmas[window_places(c, 3)] = [2e-3, 2e-3, 1e-3, 1e-3, 1e-3]
        fitter = ViewFitter(rig_file_of(truth.cameras, truth.poses, np.diag(sigmas**2)))
        z = []
        for points in np.split(truth.ends_m.reshape(-1, 3), 100):
            at = moved(fitter.at, rng.normal(0.0, sigmas))
            cameras = [camera_at(lens, at, c) for c, lens in enumerate(fitter.cameras)]
            pixels = self.seen(cameras, [pose_at(at, c) for c in range(3)], points)
            pixels += rng.normal(0.0, NOISE, pixels.shape)
            fitted = fitter.fit(pixels, fitter.rays(pixels), NOISE)
            variances = np.diagonal(fitted.errors.covariances, axis1=1, axis2=2)
            z.append((fitted.xyz - points) / np.sqrt(variances))
        # About 100 independent draws: a standard error of 0.07. Measured with six seeds: 0.92 to
        # 1.07; without the cameras' errors it would be 4.
        rms = np.sqrt(np.mean(np.square(np.concatenate(z)), axis=0))
        assert (rms > 0.8).all() and (rms < 1.25).all()

    @staticmethod
    def seen(cameras: list[Camera], poses: list[Pose], points: FloatArray) -> FloatArray:
        """(n, 3, 2): NaN outside the images."""
        pixels = np.full((len(points), 3, 2), np.nan)
        for c, (camera, pose) in enumerate(zip(cameras, poses, strict=True)):
            there = camera.sees(pose.apply(points))
            pixels[there, c] = camera.project(pose.apply(points[there]))
        return pixels


def test_a_world_of_surveyed_points_and_no_other() -> None:
    rig, points = drawn("one wall")
    world, pixels = Pose(np.eye(3)[[2, 0, 1]], np.array([1.0, 2.0, 3.0])), images(rig, points[:8])
    names, nowhere = tuple("ABCDEFGH"), np.full((8, 3), np.nan)
    survey = Survey(names, world.apply(points[:8]), np.hstack(pixels), nowhere)
    found = find_world(rig, survey).pose
    # Exact points; measured: 1e-15 m.
    np.testing.assert_allclose(found.apply(points), world.apply(points), rtol=0, atol=1e-9)
    line = Line("L", "plumb", (pixels[0], pixels[1]))
    with refused("window", "survey"):
        find_world(rig, [line])
    with refused("water", "survey"):
        find_world(rig, Throw(("",) * 8, np.arange(8), np.hstack(pixels), 100.0))


def test_files_of_which_one_has_a_window_are_of_different_rigs() -> None:
    rig, _ = drawn("two housings")
    with refused("primary", "window"):
        refuse_different_rigs(rig, replace(rig, primary=replace(rig.primary, window=None)))
