"""Poses, angles, residuals and triangulation, against OpenCV, SciPy and explicit matrices."""

import cv2
import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stereocal.errors import StereocalError
from stereocal.rig.camera import Camera, pixel_scales
from stereocal.rig.geometry import (
    Angles,
    Pose,
    reprojection_errors_of_rays,
    residuals,
    stack_rays,
    triangulate,
    triangulate_rays,
)
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray
from tests.refused import refused
from tests.rigs.known_rig import (
    ANY_ANGLES,
    PRIMARY,
    RIG,
    SECONDARY,
    SEEDS,
    bar_ends,
    random_rig,
    rays_of,
)

POINTS = bar_ends(20)
P, Q = rays_of(RIG, POINTS)[:2].T, rays_of(RIG, POINTS)[2:].T


def cross_matrix(t: FloatArray) -> FloatArray:
    """The matrix whose product with v is t x v, by NumPy's cross product."""
    return np.cross(np.eye(3), t)


def fundamental(primary: Camera, secondary: Camera, pose: Pose) -> FloatArray:
    F: FloatArray = np.linalg.inv(secondary.K).T @ pose.essential @ np.linalg.inv(primary.K)
    return F


def pixels(camera: Camera, rays: FloatArray) -> FloatArray:
    """Undistorted pixels of normalised points, with the whole of K."""
    homogeneous = np.column_stack([rays, np.ones(len(rays))]) @ camera.K.T
    return np.asarray(homogeneous[:, :2])


class TestAngles:
    @given(ANY_ANGLES, st.floats(0.01, 100.0))
    def test_there_and_back(self, angles: Angles, baseline: float) -> None:
        pose = Pose.from_angles(angles, baseline)
        # cos(1.5) = 0.07 magnifies the rounding of 1e-16 to 2e-15; measured: 1e-16.
        np.testing.assert_allclose(pose.angles, angles, rtol=0, atol=1e-13)
        assert pose.baseline == pytest.approx(baseline, rel=1e-13)

    @given(ANY_ANGLES)
    def test_rotation_is_Ry_Rx_Rz(self, angles: Angles) -> None:
        """A positive yaw turns z towards x, a pitch y towards z, a roll x towards y."""
        (cy, sy), (cx, sx), (cz, sz) = ((np.cos(a), np.sin(a)) for a in angles[:3])
        Ry = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        Rx = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
        Rz = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
        R = Pose.from_angles(angles, 1.0).R
        # Sums of products of numbers up to 1: a few roundings of 1e-16; measured: 1e-16,
        # and 3e-16 by SciPy's quaternions.
        np.testing.assert_allclose(R, Ry @ Rx @ Rz, rtol=0, atol=1e-13)
        peer = Rotation.from_euler("YXZ", angles[:3]).as_matrix()
        np.testing.assert_allclose(R, peer, rtol=0, atol=1e-13)

    @given(ANY_ANGLES, st.floats(0.01, 100.0))
    def test_direction_of_the_baseline(self, angles: Angles, baseline: float) -> None:
        d, e = angles.delta, angles.epsilon
        t = np.array([np.cos(d) * np.cos(e), np.cos(d) * np.sin(e), np.sin(d)])
        T = Pose.from_angles(angles, baseline).T
        np.testing.assert_allclose(T / baseline, t, rtol=0, atol=1e-13)

    @pytest.mark.parametrize(
        "angles",
        [
            Angles(0.1, np.pi / 2, 0.2, 0.1, 0.3),
            Angles(0.1, -np.pi / 2, 0.2, 0.1, 0.3),
            Angles(0.1, 0.2, 0.3, np.pi / 2, 0.0),
        ],
    )
    def test_degenerate_angles_are_refused(self, angles: Angles) -> None:
        with refused("five angles", "90 degrees"):
            _ = Pose.from_angles(angles, 2.0).angles


class TestPose:
    @pytest.mark.parametrize(
        ("R", "T"),
        [
            (np.diag([1.0, 1.0, -1.0]), np.ones(3)),
            (1.001 * np.eye(3), np.ones(3)),
            (np.eye(3) + 2e-4 * np.eye(3, k=1), np.ones(3)),
            (np.full((3, 3), np.nan), np.ones(3)),
            (np.eye(3), np.array([1.0, np.inf, 0.0])),
            (np.eye(4), np.ones(3)),
            (np.eye(3), np.ones((3, 1))),
        ],
    )
    def test_non_poses_are_refused(self, R: FloatArray, T: FloatArray) -> None:
        with pytest.raises(StereocalError):
            Pose(R, T)

    @given(ANY_ANGLES, ANY_ANGLES, SEEDS)
    def test_names_cancel(self, first: Angles, second: Angles, seed: int) -> None:
        b_from_a, c_from_b = Pose.from_angles(first, 1.3), Pose.from_angles(second, 0.6)
        in_a = np.random.default_rng(seed).uniform(-5, 5, (4, 3))
        in_c = (c_from_b @ b_from_a).apply(in_a)
        # Coordinates up to 10 m, two products: 1e-15 each; measured: 3e-15.
        np.testing.assert_allclose(in_c, c_from_b.apply(b_from_a.apply(in_a)), rtol=0, atol=1e-13)
        four = np.eye(4), np.eye(4)
        for matrix, pose in zip(four, (b_from_a, c_from_b), strict=True):
            matrix[:3, :3], matrix[:3, 3] = pose.R, pose.T
        product = four[1] @ four[0]
        both = c_from_b @ b_from_a
        np.testing.assert_allclose(both.R, product[:3, :3], rtol=0, atol=1e-13)
        np.testing.assert_allclose(both.T, product[:3, 3], rtol=0, atol=1e-13)
        np.testing.assert_allclose(
            b_from_a.inverse().apply(b_from_a.apply(in_a)), in_a, rtol=0, atol=1e-13
        )


class TestEssential:
    @given(ANY_ANGLES, st.floats(0.01, 100.0))
    def test_is_t_cross_R(self, angles: Angles, baseline: float) -> None:
        pose = Pose.from_angles(angles, baseline)
        expected = cross_matrix(pose.T / baseline) @ pose.R
        np.testing.assert_allclose(pose.essential, expected, rtol=0, atol=1e-13)
        singular = np.linalg.svd(pose.essential, compute_uv=False)
        np.testing.assert_allclose(singular, [1, 1, 0], rtol=0, atol=1e-13)

    def test_opencv_takes_it_apart_to_our_pose(self) -> None:
        R1, R2, t = cv2.decomposeEssentialMat(RIG.essential)
        nearest = min(np.abs(np.asarray(R) - RIG.R).max() for R in (R1, R2))
        assert nearest < 1e-12
        unit = RIG.T / RIG.baseline
        assert min(np.abs(s * np.ravel(t) - unit).max() for s in (1, -1)) < 1e-12

    def test_residual_is_the_secondary_times_E_times_the_primary(self) -> None:
        E = np.arange(9.0).reshape(3, 3)
        p, q = np.array([0.3, -0.2]), np.array([-0.1, 0.7])
        expected = np.array([*q, 1.0]) @ E @ np.array([*p, 1.0])
        assert residuals(E, p[None], q[None])[0] == pytest.approx(expected, rel=1e-13)


class TestEpipolarDistances:
    F = fundamental(PRIMARY, SECONDARY, RIG)
    rig = Rig(
        Camera(PRIMARY.K, np.empty(0), PRIMARY.image_size),
        Camera(SECONDARY.K, np.empty(0), SECONDARY.image_size),
        RIG,
    )
    first = pixels(PRIMARY, P) + np.random.default_rng(1).normal(size=P.shape)
    second = pixels(SECONDARY, Q) + np.random.default_rng(2).normal(size=Q.shape)

    def test_agrees_with_opencvs_lines(self) -> None:
        found = self.rig.epipolar_distances(self.first, self.second)
        for column, own, other, image in (
            (0, self.first, self.second, 2),
            (1, self.second, self.first, 1),
        ):
            lines = np.asarray(cv2.computeCorrespondEpilines(other[:, None], image, self.F))
            a, b, c = lines.reshape(-1, 3).T.astype(np.float64)
            expected = np.abs(a * own[:, 0] + b * own[:, 1] + c) / np.hypot(a, b)
            # 1e-16 of 1000 px, and a few times that; measured: 4e-13 px.
            np.testing.assert_allclose(found[:, column], expected, rtol=0, atol=1e-10)
        assert np.median(found) > 0.3

    def test_agrees_with_opencvs_sampson_distance(self) -> None:
        found = self.rig.epipolar_distances(self.first, self.second)
        # v^2 / (n1^2 + n2^2) of d1 = |v| / n1 and d2 = |v| / n2.
        ours = 1.0 / (1.0 / found**2).sum(axis=1)
        homogeneous = (
            np.column_stack([points, np.ones(len(points))]) for points in (self.first, self.second)
        )
        peer = [cv2.sampsonDistance(p, q, self.F) for p, q in zip(*homogeneous, strict=True)]
        # Both lose digits in the sum of terms of 1e3 that cancel to 1; measured: 1e-12 relative.
        np.testing.assert_allclose(ours, peer, rtol=1e-8)


class TestTriangulation:
    @given(SEEDS)
    @settings(max_examples=50)
    def test_exact_rays_give_the_points(self, seed: int) -> None:
        pose, points = random_rig(seed, 12)
        found = triangulate_rays(pose.R, pose.T, rays_of(pose, points))
        # Depth loses (depth / baseline)^2, up to 1e4 and more when the ray runs along the baseline;
        # measured over 1000 rigs: 3e-14 of that.
        spread = np.linalg.norm(points, axis=1) ** 2 / pose.baseline
        off = np.linalg.norm(found - points, axis=1)
        sine = np.linalg.norm(np.cross(points, pose.inverse().T), axis=1) / (
            np.linalg.norm(points, axis=1) * pose.baseline
        )
        assert (off * sine < 1e-12 * spread + 1e-12).all()

    @given(SEEDS)
    @settings(max_examples=50)
    def test_midpoint_is_the_point_nearest_to_both_rays(self, seed: int) -> None:
        """SciPy's least squares on the distance from two skew lines, in the primary's frame."""
        pose, points = random_rig(seed, 3)
        rays = rays_of(pose, points) + np.random.default_rng(seed).normal(0, 1e-3, (4, 3))
        found = triangulate_rays(pose.R, pose.T, rays)
        centre = pose.inverse().T
        for k in range(3):
            lines = [(np.zeros(3), np.array([*rays[:2, k], 1.0]))]
            lines.append((centre, pose.R.T @ np.array([*rays[2:, k], 1.0])))
            projectors, offsets = [], []
            for start, along in lines:
                away = np.eye(3) - np.outer(along, along) / (along @ along)
                projectors.append(away)
                offsets.append(away @ start)
            A, b = np.vstack(projectors), np.concatenate(offsets)
            peer, *_ = scipy.linalg.lstsq(A, b)
            depths = (np.array(peer)[2], pose.apply(np.array(peer))[2])
            if np.linalg.cond(A) > 1e4:
                continue  # nearly parallel: the depth of both has lost its digits
            if min(depths) <= 0:
                assert np.isnan(found[k]).all()
            else:
                # Condition below 1e4 on points up to 1e3 m: 1e-16 * 1e4 and some; measured: 2e-12.
                np.testing.assert_allclose(found[k], peer, rtol=0, atol=1e-9 * max(1, *depths))

    def test_R_and_T_go_straight_into_opencv(self) -> None:
        projections = np.hstack([np.eye(3), np.zeros((3, 1))]), np.column_stack([RIG.R, RIG.T])
        found = np.asarray(cv2.triangulatePoints(*projections, P.T.copy(), Q.T.copy()))
        peer = (found[:3] / found[3]).T
        ours = triangulate(RIG, P, Q)
        # Points at 6 to 11 m on a baseline of 2.37 m; measured: 6e-14 m.
        np.testing.assert_allclose(ours, POINTS, rtol=0, atol=1e-12)
        np.testing.assert_allclose(peer, POINTS, rtol=0, atol=1e-11)

    def test_parallel_rays_have_no_point(self) -> None:
        """The same direction in space, seen from both cameras."""
        towards = RIG.R @ np.array([0.1, -0.2, 1.0])
        rays = stack_rays([[0.1, -0.2]], [towards[:2] / towards[2]])
        assert np.isnan(triangulate_rays(RIG.R, RIG.T, rays)).all()

    def test_diverging_rays_have_no_point(self) -> None:
        """Lines that cross behind the cameras: images of the mirrored points."""
        pose = Pose(np.eye(3), np.array([-1.0, 0.1, 0.05]))
        behind = np.array([[0.2, 0.1, -5.0]])
        rays = rays_of(pose, behind)
        assert np.isnan(triangulate_rays(pose.R, pose.T, rays)).all()

    @pytest.mark.parametrize("which", ["primary", "secondary"])
    def test_behind_one_camera_only_has_no_point(self, which: str) -> None:
        forward = Pose(np.eye(3), np.array([0.2, 0.1, -3.0 if which == "secondary" else 3.0]))
        # Depth 1.5 in one camera and -1.5 in the other.
        point = np.array([[0.4, 0.3, 1.5 if which == "secondary" else -1.5]])
        depths = point[0, 2], forward.apply(point)[0, 2]
        assert sorted(np.sign(depths)) == [-1, 1]
        assert np.isnan(triangulate_rays(forward.R, forward.T, rays_of(forward, point))).all()


def test_reprojection_errors_are_pixels_between_image_and_projected_midpoint() -> None:
    """With the whole of K, skew too: project the midpoint in both cameras and measure."""
    noise = np.random.default_rng(5).normal(0, 1e-3, (4, len(POINTS)))
    rays = rays_of(RIG, POINTS) + noise
    scale = pixel_scales((PRIMARY, SECONDARY))
    found = reprojection_errors_of_rays(RIG.R, RIG.T, rays, scale)
    middle = triangulate_rays(RIG.R, RIG.T, rays)
    for column, camera, points, seen in (
        (0, PRIMARY, middle, rays[:2].T),
        (1, SECONDARY, RIG.apply(middle), rays[2:].T),
    ):
        shift = pixels(camera, points[:, :2] / points[:, 2:]) - pixels(camera, seen)
        # 1e-16 of 1000 px lost in the difference; measured: 1.4e-13 px.
        np.testing.assert_allclose(found[:, column], np.hypot(*shift.T), rtol=0, atol=1e-11)
    assert np.median(found) > 0.1
