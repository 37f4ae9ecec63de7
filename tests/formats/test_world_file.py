"""`world.json`, 4x4 tables, and the tables that a world frame is found from."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from stereocal.errors import StereocalError
from stereocal.formats.world_file import read_world
from stereocal.rig.geometry import Angles, Pose

WORLD = Pose.from_angles(Angles(0.3, -0.4, 1.2, 0.1, 0.2), 5.0)


class TestWorldFile:
    table = np.vstack([np.column_stack([WORLD.R, WORLD.T]), [0, 0, 0, 1]])

    @pytest.mark.parametrize("name", ["w.json", "w.csv"])
    def test_json_and_csv(self, tmp_path: Path, name: str) -> None:
        text = json.dumps(self.table.tolist())
        if name.endswith("csv"):
            text = "\n".join(",".join(map(repr, row)) for row in self.table.tolist())
        (tmp_path / name).write_text(text)
        np.testing.assert_array_equal(read_world(tmp_path / name).R, WORLD.R)
        np.testing.assert_array_equal(read_world(tmp_path / name).T, WORLD.T)

    @pytest.mark.parametrize(
        ("text", "says"),
        [
            ("", "last row is 0 0 0 1|not a 4x4|not valid JSON"),
            ("[[1,2],[3,4]]", "needs a 4x4"),
            ('{"R": 1}', "the format is 'None'"),
            (json.dumps((2 * np.eye(4)).tolist()), "last row"),
            (json.dumps(np.diag([2.0, 2, 2, 1]).tolist()), "must be a rotation and a translation"),
            (json.dumps(np.diag([1.0, 1, -1, 1]).tolist()), "must be a rotation and a translation"),
            (json.dumps(np.full((4, 4), np.nan).tolist()), "last row"),
        ],
    )
    def test_what_is_no_frame(self, tmp_path: Path, text: str, says: str) -> None:
        (tmp_path / "w.json").write_text(text)
        with pytest.raises(StereocalError, match=says):
            read_world(tmp_path / "w.json")

    def test_no_such_file(self, tmp_path: Path) -> None:
        with pytest.raises(StereocalError, match="cannot be read"):
            read_world(tmp_path / "none.json")
