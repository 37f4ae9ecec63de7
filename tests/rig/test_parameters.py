"""The parameter files: their keys, there and back, and what is refused."""

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.parameters import RigParameters
from tests.refused import refused
from tests.rigs.known_rig import (
    ANGLES,
    ANY_ANGLES,
    BASELINE_M,
    PRIMARY,
    RIG,
    SECONDARY,
    bar_ends,
    images,
)

SETTINGS, INPUTS = {"delta": 1e-3, "seed": 0}, {"sha256": "0" * 64}
PARAMETERS = RigParameters(PRIMARY, SECONDARY, RIG, "3d", 0.0123, SETTINGS, INPUTS)
HEAD = ["format", "purpose", "method", "convention", "units", "pixel_origin", "cameras"]
POSE = ["R", "T", "E", "angles", "baseline_m", "triangulation", "matching_threshold_px", "cost"]
REST = ["validation", "settings", "inputs", "frames_left_out", "noise_px", "volume", "software"]
KEYS = [*HEAD, *POSE, *REST, "created"]


def damaged(change: Callable[[dict[str, Any]], object]) -> str:
    """The text of the file after a change to its content."""
    data = json.loads(PARAMETERS.dumps())
    change(data)
    return json.dumps(data)


def put(*path: str | int, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(data: Any) -> None:
        for step in path[:-1]:
            data = data[step]
        data[path[-1]] = value

    return change


class TestFile:
    def test_keys_are_those_of_the_design(self) -> None:
        data = json.loads(PARAMETERS.dumps())
        assert list(data) == KEYS
        assert list(data["angles"]) == ["yaw", "pitch", "roll", "delta", "epsilon"]
        assert list(data["cameras"]) == ["primary", "secondary"]
        for camera in data["cameras"].values():
            assert list(camera) == ["K", "distortion", "image_size"]

    def test_a_reader_with_json_and_numpy_alone_gets_it_right(self) -> None:
        """Project a point by the file's numbers: the lens apart, it is what our cameras see."""
        data = json.loads(PARAMETERS.dumps())
        point = np.array([0.4, -0.3, 7.0])
        moved = np.array(data["R"]) @ point + np.array(data["T"])
        pixel = np.array(data["cameras"]["secondary"]["K"]) @ moved
        ray = SECONDARY.undistort(SECONDARY.project(RIG.apply(point[None])))
        expected = SECONDARY.K @ np.array([*ray[0], 1.0])
        np.testing.assert_allclose(pixel[:2] / pixel[2], expected[:2], rtol=0, atol=1e-9)
        unit = np.array(data["T"]) / data["baseline_m"]
        np.testing.assert_allclose(
            np.array(data["E"]), np.cross(unit, np.array(data["R"]), axisb=0, axisc=0), atol=1e-15
        )

    def test_there_and_back(self, tmp_path: Path) -> None:
        full = replace(
            PARAMETERS, matching_threshold_px=1.25, validation={"fcp": 0.02}, method="2d"
        )
        full.save(tmp_path / "p.json")
        back = RigParameters.load(tmp_path / "p.json")
        without = [
            {k: v for k, v in each.to_json().items() if k != "created"} for each in (full, back)
        ]
        assert without[0] == without[1]

    @given(ANY_ANGLES, st.floats(1e-3, 500.0))
    @settings(max_examples=40)
    def test_any_rig_there_and_back(self, angles: Angles, baseline: float) -> None:
        pose = Pose.from_angles(angles, baseline)
        back = RigParameters.loads(replace(PARAMETERS, pose=pose).dumps())
        np.testing.assert_array_equal(back.pose.R, pose.R)
        np.testing.assert_array_equal(back.pose.T, pose.T)


class TestRefusals:
    @pytest.mark.parametrize(
        ("change", "said"),
        [
            (put("format", value="stereocal-parameters/2"), ["stereocal-parameters/2"]),
            (put("convention", value="x_primary = R @ x_secondary + T"), ["x_primary = "]),
            (put("triangulation", value="dlt"), ["triangulation", "dlt"]),
            (put("method", value="5d"), ["method", "5d"]),
            (put("R", value=np.diag([1, 1, -1.0]).tolist()), ["R ", "+1"]),
            (put("R", 0, 0, value=float("nan")), ["pose", "NaN"]),
            (put("T", 1, value=float("inf")), ["pose", "NaN"]),
            (put("R", value=np.eye(4).tolist()), ["(3, 3)", "(4, 4)"]),
            (put("T", value=[0.0, 0.0, 0.0]), ["T ", "baseline_m"]),
            (put("baseline_m", value=BASELINE_M * 1.001), ["T ", "baseline_m"]),
            (put("angles", "yaw", value=ANGLES.yaw + 1e-3), ["angles", "R, T"]),
            (put("angles", "yaw", value=float("nan")), ["pose", "NaN"]),
            (put("cost", value=float("nan")), ["cost"]),
            (put("matching_threshold_px", value=-1.0), ["matching threshold", "-1.0 px"]),
            (put("noise_px", value=-0.1), ["noise", "-0.1 px"]),
            (put("volume", value={"z_m": [3.0, 8.0]}), ["volume", "x/z", "z_m"]),
            (put("cameras", "primary", "K", 0, 0, value=-5.0), ["primary: ", "fx = -5 "]),
            (put("cameras", "secondary", "distortion", value=[1.0]), ["secondary: ", " 1 "]),
        ],
    )
    def test_unsound(self, change: Callable[[dict[str, Any]], None], said: list[str]) -> None:
        with refused("test: ", *said):
            RigParameters.loads(damaged(change), "test")

    def test_a_file_that_is_not_there_or_of_another_kind(self, tmp_path: Path) -> None:
        with refused("none.json", os.strerror(2)):
            RigParameters.load(tmp_path / "none.json")
        for content in (b"\xff\xfe\x00", b"%YAML:1.0\nM1: 1", b"[cam_0]\n", b'{"K": []}'):
            (tmp_path / "other").write_bytes(content)
            with refused("other: ", "convert --from"):
                RigParameters.load(tmp_path / "other")
        with refused(tmp_path, "folder", "convert --from"):
            RigParameters.load(tmp_path)

    def test_nan_is_never_written(self) -> None:
        with refused("cost"):
            replace(PARAMETERS, cost=float("nan"))


class TestWriting:
    def test_a_failure_leaves_the_old_file_and_nothing_else(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        path = tmp_path / "p.json"
        PARAMETERS.save(path)
        before = path.read_bytes()

        def full_disk(_: int) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(os, "fsync", full_disk)
        with refused("p.json", "No space left on device"):
            replace(PARAMETERS, cost=9.0).save(path)
        assert path.read_bytes() == before
        assert [file.name for file in tmp_path.iterdir()] == ["p.json"]


class TestAtWork:
    points = bar_ends(12)
    pixels = images(points)

    def test_exact_pairs_give_back_the_points_and_have_no_error(self) -> None:
        # Newton's 1e-13 on the rays, times depth^2 / baseline = 50; measured: 7e-14 m.
        found = PARAMETERS.reconstruct(*self.pixels)
        np.testing.assert_allclose(found, self.points, rtol=0, atol=1e-10)
        # The same in pixels; measured: 2e-12 px, 3e-13 px and 2e-16.
        assert PARAMETERS.reprojection_errors(*self.pixels).max() < 1e-9
        assert PARAMETERS.epipolar_distances(*self.pixels).max() < 1e-9
        assert np.abs(PARAMETERS.residuals(*self.pixels)).max() < 1e-12

    def test_errors_are_in_the_pixels_of_each_camera(self) -> None:
        """Moved across its epipolar line by a known number of undistorted pixels."""
        first, second = self.pixels
        F = np.linalg.inv(SECONDARY.K).T @ RIG.essential @ np.linalg.inv(PRIMARY.K)
        flat = np.column_stack([PRIMARY.undistort_to_pixels(first), np.ones(len(first))])
        across = (flat @ F.T)[:, :2]
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        moved = SECONDARY.undistort_to_pixels(second) + 3.0 * across
        rays = (moved - SECONDARY.K[:2, 2]) @ np.linalg.inv(SECONDARY.K[:2, :2]).T
        distances = PARAMETERS.epipolar_distances(first, SECONDARY.distort(rays))
        np.testing.assert_allclose(distances[:, 1], 3.0, rtol=0, atol=1e-8)
        errors = PARAMETERS.reprojection_errors(first, SECONDARY.distort(rays))
        # The midpoint shares the 3 px between the cameras: each sees about half.
        assert (errors > 0.5).all()
        assert (errors < 3.0).all()
