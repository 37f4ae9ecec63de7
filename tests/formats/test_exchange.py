"""Exchange formats: written, read back, read by their own programs, and what they cannot hold."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stereocal.cli import main
from stereocal.formats.camera_file import write_opencv_camera
from stereocal.formats.exchange.camera_format import fewer_coefficients
from stereocal.formats.exchange.exchange import (
    FORMATS,
    export,
    export_files,
    export_notes,
    import_files,
    import_parameters,
)
from stereocal.formats.exchange.options import ExchangeOptions, Flip
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.parameters import RigParameters
from stereocal.rig.window import Window
from stereocal.system.array_types import FloatArray
from tests.refused import refused
from tests.rigs.fisheye_rig import fisheye_rig
from tests.rigs.known_rig import ANY_ANGLES, PRIMARY, RIG, SECONDARY, bar_ends, images

POINTS = bar_ends(30)
FULL = RigParameters(PRIMARY, SECONDARY, RIG, "3d", 0.1, {}, {})
"""Skew, k3: what some formats cannot hold."""
STRAIGHT = replace(SECONDARY, K=SECONDARY.K * [[1, 0, 1], [1, 1, 1], [1, 1, 1]])
NO_SKEW = replace(FULL, secondary=STRAIGHT)
PLAIN = replace(NO_SKEW, primary=Camera(PRIMARY.K, PRIMARY.distortion[:4], PRIMARY.image_size))
SIZES = ExchangeOptions((PRIMARY.image_size, SECONDARY.image_size))
RICHEST = {**dict.fromkeys(FORMATS, FULL), "kalibr": PLAIN, "colmap": NO_SKEW}
"""The rig with all that the format holds."""


def views(rig: RigParameters, lens: bool = True) -> FloatArray:
    """Pixels of the points in both cameras, (2, n, 2)."""
    cameras = [rig.primary, rig.secondary]
    if not lens:
        cameras = [Camera(camera.K, np.zeros(0), camera.image_size) for camera in cameras]
    return np.stack([cameras[0].project(POINTS), cameras[1].project(rig.pose.apply(POINTS))])


@pytest.mark.parametrize("name", FORMATS)
class TestThereAndBack:
    def test_same_points_to_a_millionth_of_a_pixel(self, name: str, tmp_path: Path) -> None:
        """On disk and on the command line."""
        rig, out = RICHEST[name], str(tmp_path / "out")
        rig.save(tmp_path / "p.json")
        assert main(["convert", str(tmp_path / "p.json"), "--to", name, "--out", out]) == 0
        sizes = ["--image-size-primary", "1600x1200", "--image-size-secondary", "1280x1024"]
        back_to = ["--from", name, "--out", str(tmp_path / "b.json")]
        assert main(["convert", out, *back_to, *sizes]) == 0
        back = RigParameters.load(tmp_path / "b.json")
        # Measured: 1e-12 px at most.
        np.testing.assert_allclose(views(back), views(rig, lens=name != "dlt"), rtol=0, atol=1e-6)
        np.testing.assert_allclose(back.pose.T, rig.pose.T, rtol=0, atol=1e-9)
        assert (back.method, back.purpose, back.cost) == ("imported", "both", None)
        assert back.primary.image_size == (1600, 1200)
        assert back.inputs["format"] == name

    @given(ANY_ANGLES, st.floats(0.01, 50.0))
    @settings(max_examples=10)
    def test_any_pose(self, name: str, angles: Angles, baseline: float) -> None:
        pose = Pose.from_angles(angles, baseline)
        rig = replace(PLAIN, pose=pose)
        back = import_files(export_files(rig, name), name, SIZES)
        # Measured: 2e-15 and 4e-15; a rectified pair far apart in depth, 1e-12 (ROS).
        np.testing.assert_allclose(back.pose.R, pose.R, rtol=0, atol=1e-9)
        np.testing.assert_allclose(back.pose.T / baseline, pose.T / baseline, rtol=0, atol=1e-9)


class TestPeers:
    """The other side's own reader, where it can be installed."""

    def test_opencv(self, tmp_path: Path) -> None:
        export(NO_SKEW, "opencv", tmp_path)
        found = {}
        for file in ("intrinsics.yml", "extrinsics.yml"):
            storage = cv2.FileStorage(str(tmp_path / file), cv2.FILE_STORAGE_READ)
            for key in storage.root().keys():  # noqa: SIM118  # no mapping
                if not key.startswith("image_size"):
                    found[key] = storage.getNode(key).mat()
            storage.release()
        poses = (np.zeros(3), np.zeros(3)), (cv2.Rodrigues(found["R"])[0], found["T"])
        seen = [
            cv2.projectPoints(POINTS, *pose, found[f"M{k}"], found[f"D{k}"])[0].reshape(-1, 2)
            for k, pose in enumerate(poses, 1)
        ]
        np.testing.assert_allclose(seen, views(NO_SKEW), rtol=0, atol=1e-6)
        # Rectified, both see a point in the same row, and Q gives its place back.
        exact = (3, 100, 1e-14)
        rectified = []
        for k, view in enumerate(seen, 1):
            lens, turned = (found[f"M{k}"], found[f"D{k}"]), (found[f"R{k}"], found[f"P{k}"])
            own = cv2.undistortPoints(view[:, None], *lens, None, *turned, exact)
            rectified.append(own.reshape(-1, 2))
        np.testing.assert_allclose(rectified[0][:, 1], rectified[1][:, 1], rtol=0, atol=1e-5)
        u, v = rectified[0].T
        places = np.stack([u, v, u - rectified[1][:, 0], np.ones_like(u)]).T @ found["Q"].T
        np.testing.assert_allclose(
            places[:, :3] / places[:, 3:], POINTS @ found["R1"].T, rtol=0, atol=1e-5
        )

    def test_aniposelib(self, tmp_path: Path) -> None:
        cameras = pytest.importorskip("aniposelib.cameras")
        export(NO_SKEW, "aniposelib", tmp_path / "calibration.toml")
        group = cameras.CameraGroup.load(str(tmp_path / "calibration.toml"))
        assert group.get_names() == ["primary", "secondary"]
        np.testing.assert_allclose(
            group.project(POINTS).reshape(2, -1, 2), views(NO_SKEW), rtol=0, atol=1e-6
        )

    def test_caliscope(self, tmp_path: Path) -> None:
        cameras = pytest.importorskip("caliscope.cameras.camera_array")
        export(NO_SKEW, "caliscope", tmp_path / "camera_array.toml")
        found = cameras.CameraArray.from_toml(tmp_path / "camera_array.toml").cameras
        for number, seen in enumerate(views(NO_SKEW)):
            own = found[number]
            lens = Camera(own.matrix, own.distortions, own.size)
            moved = Pose(own.rotation, own.translation).apply(POINTS)
            np.testing.assert_allclose(lens.project(moved), seen, rtol=0, atol=1e-6)

    def test_colmap(self, tmp_path: Path) -> None:
        colmap = pytest.importorskip("pycolmap")
        export(NO_SKEW, "colmap", tmp_path)
        model = colmap.Reconstruction()
        model.read_text(str(tmp_path))
        (rig,) = model.rigs.values()
        moved = rig.sensor_from_rig(model.cameras[2].sensor_id)
        inside = (POINTS, RIG.apply(POINTS))
        np.testing.assert_allclose(
            np.array([moved * point for point in POINTS]), inside[1], rtol=0, atol=1e-9
        )
        seen = [model.cameras[k + 1].img_from_cam(inside[k]) for k in (0, 1)]
        np.testing.assert_allclose(np.array(seen) - 0.5, views(NO_SKEW), rtol=0, atol=1e-6)
        (config,) = colmap.read_rig_config(str(tmp_path / "rig_config.json"))
        np.testing.assert_allclose(
            config.cameras[1].cam_from_rig.matrix(), np.column_stack([RIG.R, RIG.T]), atol=1e-12
        )


def test_rows_times_the_matrix() -> None:
    """As MATLAB computes: points are rows, and the first pixel is (1, 1)."""
    text = export_files(FULL, "matlab")["stereo_parameters.m"].decode()
    given: dict[str, FloatArray] = {}
    for part in text.split("];")[:-1]:
        name, _, body = part.rpartition("= [")
        given[name.split()[-1]] = np.array(
            [row.split() for row in body.strip().splitlines()], dtype=float
        )
    moved = POINTS @ given["RotationOfCamera2"] + given["TranslationOfCamera2"]
    np.testing.assert_allclose(moved, RIG.apply(POINTS), rtol=0, atol=1e-12)
    ray = SECONDARY.undistort(SECONDARY.project(moved))
    pixels = np.column_stack([ray, np.ones(len(ray))]) @ given["K2"].T
    undistorted = SECONDARY.undistort_to_pixels(SECONDARY.project(moved))
    np.testing.assert_allclose(pixels[:, :2], undistorted + 1, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(given["ImageSize2"], [[1024, 1280]])


def solve_dlt(table: FloatArray, views_of: list[FloatArray]) -> FloatArray:
    """Places by linear least squares, as DLTdv does."""
    L = np.vstack([table, np.ones(2)]).T.reshape(2, 3, 4)
    rows = np.stack(
        [
            pixels[:, axis, None] * of[2] - of[axis]
            for of, pixels in zip(L, views_of, strict=True)
            for axis in (0, 1)
        ],
        axis=1,
    )
    return np.array([np.linalg.lstsq(row[:, :3], -row[:, 3], rcond=None)[0] for row in rows])


class TestDlt:
    undistorted = (
        PRIMARY.undistort_to_pixels(images(POINTS)[0]),
        SECONDARY.undistort_to_pixels(images(POINTS)[1]),
    )
    heights = (1200, 1024)

    def table(self, options: ExchangeOptions) -> FloatArray:
        text = export_files(FULL, "dlt", options)["dlt.csv"].decode()
        found = np.array([row.split(",") for row in text.splitlines()], dtype=np.float64)
        assert found.shape == (11, 2)
        return found

    @pytest.mark.parametrize(("flip", "more"), [("h", 0), ("h-1", -1), ("h+1", 1)])
    def test_flipped_points_give_the_same_places(self, flip: Flip, more: int) -> None:
        upper = solve_dlt(self.table(ExchangeOptions()), list(self.undistorted))
        flipped = [
            np.column_stack([view[:, 0], h + more - view[:, 1]])
            for view, h in zip(self.undistorted, self.heights, strict=True)
        ]
        options = ExchangeOptions(corner="lower-left", flip=flip)
        lower = solve_dlt(self.table(options), flipped)
        # The world's origin stands 1e-6 m off; measured beyond it: 1e-9 m.
        np.testing.assert_allclose(lower, upper, rtol=0, atol=1e-7)
        np.testing.assert_allclose(lower, POINTS, rtol=0, atol=1.2e-6)

    def test_a_world_of_ones_own(self) -> None:
        world = Pose.from_angles(Angles(0.2, 1.1, -0.4, 0.3, 1.0), 9.0)
        places = solve_dlt(self.table(ExchangeOptions(world=world)), list(self.undistorted))
        np.testing.assert_allclose(places, world.apply(POINTS), rtol=0, atol=1e-9)

    def test_the_default_world_costs_no_accuracy(self) -> None:
        """Its rows weigh the primary's equations far more; that must not spoil noisy points."""
        rng = np.random.default_rng(0)
        noisy = [view + 0.3 * rng.standard_normal(view.shape) for view in self.undistorted]
        world = Pose(np.eye(3), np.array([0.0, 0.0, -8.0]))
        own = solve_dlt(self.table(ExchangeOptions()), noisy) - POINTS
        middle = solve_dlt(self.table(ExchangeOptions(world=world)), noisy) - world.apply(POINTS)
        # Measured: 1.01.
        assert np.sqrt((own**2).mean()) < 1.1 * np.sqrt((middle**2).mean())

    def test_what_is_asked_for(self) -> None:
        world = Pose(np.eye(3), np.array([1.0, 0.0, 0.0]))  # its origin in a camera's plane
        with refused("DLT", "origin"):
            export_files(FULL, "dlt", ExchangeOptions(world=world))
        with refused("dlt.csv", "primary", "image_width"):
            import_files(export_files(FULL, "dlt"), "dlt")


class TestWhatAFormatCannotHold:
    def test_k3_that_matters_is_refused(self) -> None:
        with refused("Kalibr", "k3 = -0.06", "1.3 px"):
            export_files(NO_SKEW, "kalibr")

    def test_k3_that_nobody_sees_is_fitted_away(self) -> None:
        faint = Camera(PRIMARY.K, [-0.21, 0.17, 0.0009, -0.0013, -0.0005], PRIMARY.image_size)  # type: ignore[arg-type]
        rig = replace(PLAIN, primary=faint)
        back = import_files(export_files(rig, "kalibr"), "kalibr")
        away = np.abs(views(back) - views(rig)).max()
        _, worst = fewer_coefficients(faint, 4)
        assert 1e-4 < away <= worst <= 0.02
        assert any(f"{worst:.2g} px at most" in note for note in export_notes(rig, "kalibr"))

    @pytest.mark.parametrize("name", ["kalibr", "colmap"])
    def test_skew_is_refused(self, name: str) -> None:
        rig = replace(PLAIN, secondary=SECONDARY)
        with refused("skew", "secondary", "2.3 px"):
            export_files(rig, name)

    @pytest.mark.parametrize("name", ["opencv", "ros", "aniposelib"])
    def test_skew_that_their_functions_ignore_is_said(self, name: str) -> None:
        assert any("skew" in note for note in export_notes(FULL, name))
        assert export_notes(NO_SKEW, name) == []

    def test_a_rational_lens(self) -> None:
        lens = [-0.2, 0.1, 1e-4, -2e-4, 0.3, 0.1, -0.3, 0.2]
        rig = replace(PLAIN, primary=Camera(PRIMARY.K, lens, PRIMARY.image_size))  # type: ignore[arg-type]
        for name in ("opencv", "ros", "colmap"):
            back = import_files(export_files(rig, name), name)
            np.testing.assert_allclose(views(back), views(rig), rtol=0, atol=1e-6)
        with refused("MATLAB", "k4 = 0.1"):
            export_files(rig, "matlab")


class TestFisheye:
    rig = fisheye_rig(120.0)

    @pytest.mark.parametrize(
        "name", ["opencv", "kalibr", "ros", "aniposelib", "caliscope", "colmap"]
    )
    def test_there_and_back(self, name: str) -> None:
        read = import_files(export_files(self.rig, name), name)
        for which in CAMERAS:
            ours, theirs = getattr(self.rig, which), getattr(read, which)
            assert theirs.model == "fisheye"
            # As written, with 12 digits or more.
            np.testing.assert_allclose(theirs.K, ours.K, rtol=1e-9)
            np.testing.assert_allclose(theirs.distortion, ours.distortion, rtol=1e-9)
        np.testing.assert_allclose(read.pose.R, self.rig.pose.R, rtol=0, atol=1e-9)
        np.testing.assert_allclose(read.pose.T, self.rig.pose.T, rtol=0, atol=1e-9)

    def test_matlab_has_none(self) -> None:
        with refused("MATLAB", "fisheye", "primary"):
            export_files(self.rig, "matlab")

    def test_opencv_has_one_model_for_both(self) -> None:
        mixed = replace(self.rig, primary=RICHEST["opencv"].primary)
        with refused("OpenCV", "fisheye"):
            export_files(mixed, "opencv")
        assert import_files(export_files(mixed, "ros"), "ros").primary.model == "brown"


@pytest.mark.parametrize("name", FORMATS)
def test_a_window_is_refused_and_nothing_written(name: str, tmp_path: Path) -> None:
    primary = replace(PRIMARY, window=Window((0.0, 0.0, 1.0), 0.4))
    with refused("The primary camera looks through a window", FORMATS[name].title):
        export(replace(RICHEST[name], primary=primary), name, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    with refused("looks through a window", "OpenCV"):
        write_opencv_camera(primary)


def test_a_size_with_the_height_first_is_told() -> None:
    """The centre (965, 531) is that of 1920x1080 px; it was written as 1080x1920 px, silently."""
    path = Path(__file__).parents[1] / "cases" / "size_height_width" / "stereo.yml"
    (note,) = import_parameters(path, "opencv", ExchangeOptions(unit="m")).inputs["notes"]
    assert "height and width" in note and "1920x1080" in note
