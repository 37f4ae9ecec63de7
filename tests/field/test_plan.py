"""Plans: the pose of aimed cameras, the file, and plans that cannot work."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stereocal.errors import StereocalError
from stereocal.field.planning.plan import AimedPose, SensorLens
from stereocal.formats.camera_file import write_camera
from stereocal.formats.plan_file import parse_plan, read_plan, write_plan
from stereocal.rig.geometry import triangulate
from tests import known_rig
from tests.field.plans import FIELD, LENS, contents, plan


@pytest.mark.parametrize("height", [0.0, 0.7, -0.4])
def test_both_axes_meet_where_the_toe_in_says(height: float) -> None:
    pose = AimedPose(4.0, 12.0, height).pose
    centre = np.zeros((1, 2))
    meeting = triangulate(pose, centre, centre)[0]
    assert np.isclose(pose.baseline, 4.0)
    # From the primary, along its own axis: half the baseline over the sine of the toe-in.
    assert np.allclose(meeting, [0.0, 0.0, 2.0 / np.sin(np.radians(12.0))], atol=1e-9)
    camera = -pose.R.T @ pose.T
    assert camera[0] > 0  # the secondary is on the right
    assert np.isclose(-camera[1], height, atol=0.15 * abs(height) + 1e-12)  # y points down


def test_a_lens_from_its_data_sheet() -> None:
    lens = SensorLens(50.0, (36.0, 24.0), (6000, 4000))
    assert np.allclose(np.diag(lens.camera.K), [8333.333, 8333.333, 1.0])
    assert np.allclose(lens.camera.K[:2, 2], [2999.5, 1999.5])


def test_the_file_is_read_back(tmp_path: Path) -> None:
    known = plan(stated_primary=known_rig.PRIMARY, stated_secondary=LENS, stated_pose=FIELD.pose)
    for one in (FIELD, known):
        path = tmp_path / "plan.json"
        path.write_bytes(write_plan(one))
        read = read_plan(path)
        assert write_plan(read) == write_plan(one)
        assert np.allclose(read.primary.K, one.primary.K)
        assert np.allclose(read.pose.R, one.pose.R)


def test_camera_files_stand_beside_the_plan(tmp_path: Path) -> None:
    (tmp_path / "lens.json").write_bytes(write_camera(known_rig.PRIMARY))
    cameras = {"primary": "lens.json", "secondary": contents()["cameras"]["secondary"]}
    (tmp_path / "plan.json").write_text(json.dumps(contents(cameras=cameras)))
    read = read_plan(tmp_path / "plan.json")
    assert np.array_equal(read.primary.K, known_rig.PRIMARY.K)
    (tmp_path / "lens.json").unlink()
    with pytest.raises(StereocalError, match=r"lens.json: there is no such file"):
        read_plan(tmp_path / "plan.json")


AWAY = {"R": [[-1, 0, 0], [0, 1, 0], [0, 0, -1]], "T": [1.0, 0.0, -2.0], "pose": None}
BAD: list[tuple[dict[str, Any], str]] = [
    ({"format": "stereocal-plan/9"}, "stereocal-plan/1"),
    ({"cameras": None}, '"cameras" is missing'),
    ({"cameras": {"primary": contents()["cameras"]["primary"]}}, 'no "secondary"'),
    ({"cameras": {"primary": 3, "secondary": 3}}, "not a camera"),
    ({"volume": {"near_m": 8.0}}, "far_m is missing"),
    ({"volume": {"near_m": 25.0, "far_m": 8.0}}, "near_m must be the smaller"),
    ({"volume": {"near_m": -8.0, "far_m": 8.0}}, "behind the camera"),
    ({"pose": None}, '"R" and "T"'),
    ({"pose": contents()["pose"], "R": np.eye(3).tolist(), "T": [1, 0, 0]}, "either"),
    ({"pose": {"baseline_m": 0.0, "toe_in_deg": 0.0}}, "baseline is 0 m"),
    ({"R": np.eye(3).tolist(), "T": [0, 0, 0], "pose": None}, "baseline is 0 m"),
    ({"R": np.eye(3).tolist(), "T": [0, 0, -1], "pose": None}, "straight ahead"),
    ({"R": "no", "T": [0, 0, -1], "pose": None}, "3 rows"),
    ({"R": np.ones((3, 3)).tolist(), "T": [0, 0, -1], "pose": None}, "not a rotation"),
    ({"pose": {"baseline_m": 4.5, "toe_in_deg": -40.0}}, "nothing in common"),
    (AWAY, "behind the secondary"),
    ({"bar_m": 30.0}, "larger than what both cameras see"),
    ({"bar_m": None}, "bar_m is missing"),
    ({"bar_m": "long"}, "must be a number"),
    ({"frames": 2}, "from 5 to"),
    ({"frames": 20.5}, "whole number"),
    ({"noise_px": 0}, "above 0"),
    ({"noise_px": float("nan")}, "must be a number"),
    ({"uncertainty": None}, '"uncertainty" is missing'),
    ({"uncertainty": contents()["uncertainty"] | {"focal": 3.0}}, "fraction"),
    ({"uncertainty": contents()["uncertainty"] | {"baseline_m": 5}}, "in metres"),
    ({"uncertainty": contents()["uncertainty"] | {"bar_m": -1}}, "0 or more"),
]


@pytest.mark.parametrize(("changes", "message"), BAD, ids=[message for _, message in BAD])
def test_plans_that_cannot_work(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(StereocalError, match=message) as caught:
        parse_plan(json.dumps(contents(**changes)).encode(), "plan.json", str.encode)
    assert str(caught.value).startswith("plan.json: ")
    assert str(caught.value).count("plan.json") == 1
