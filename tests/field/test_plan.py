"""Plans: the pose of aimed cameras, the file, and plans that cannot work."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from stereocal.errors import StereocalError
from stereocal.field.planning.plan import AimedPose
from stereocal.formats.camera_file import write_camera
from stereocal.formats.plan_file import read_plan, write_plan
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
