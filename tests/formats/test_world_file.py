"""`world.json`, 4x4 tables, and the tables that a world frame is found from."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from stereocal.errors import StereocalError
from stereocal.field.world.frame import WorldFrame
from stereocal.field.world.observed import Survey, Throw
from stereocal.formats.world_file import WORLD_FORMAT, read_world, write_world
from stereocal.formats.world_tables import (
    read_observed,
)
from stereocal.matching.reconstruction import name_of_world
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.parameters import RigParameters
from tests.known_rig import PRIMARY, RIG, SECONDARY

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

    def test_world_json_is_read_back_exactly(self, tmp_path: Path) -> None:
        frame = WorldFrame(WORLD, "plumb", {"vertical_deg": 0.1}, "Found.", ("a note",))
        rig = RigParameters(PRIMARY, SECONDARY, RIG, "2d", 1.0, {}, {"sha256": "ab"})
        content = write_world(frame, rig)
        (tmp_path / "w.json").write_bytes(content)
        read = read_world(tmp_path / "w.json")
        np.testing.assert_array_equal(np.column_stack([read.R, read.T]), self.table[:3])
        data = json.loads(content)
        assert data["format"] == WORLD_FORMAT
        assert data["world_from_primary"] == self.table.tolist()
        assert data["source"] == "plumb"
        assert data["uncertainty"] == {"vertical_deg": 0.1}
        assert data["name"] == name_of_world(read)


SURVEY = (
    "point,x,y,z,u_primary,v_primary,u_secondary,v_secondary\n"
    "P1,0,0,0,10,20,30,40\nP2,1,0,0,11,21,31,41\n"
)
LINES = (
    "line,kind,u_primary,v_primary,u_secondary,v_secondary\n"
    "a,plumb,1,2,3,4\na,plumb,5,6,,\nsea,horizon,7,8,,\nb,,1,2,3,4\n"
)
THROW = (
    "frame,u_primary,v_primary,u_secondary,v_secondary,throw\n"
    "7,1,2,3,4,one\n8,1,2,,,one\n9,5,6,7,8,one\n"
)


class TestTables:
    def test_a_survey(self) -> None:
        found = read_observed(SURVEY.encode(), "s.csv")
        assert isinstance(found, Survey)
        assert found.names == ("P1", "P2")
        np.testing.assert_array_equal(found.pixels[1], [11, 21, 31, 41])
        assert np.isnan(found.measured_m).all()
        text = "point;x;y;z;x_primary;y_primary;z_primary\nA;0;0;0;1,5;2;3\n"
        measured = read_observed(text.encode(), "s.csv")
        assert isinstance(measured, Survey)
        np.testing.assert_array_equal(measured.measured_m, [[1.5, 2, 3]])

    def test_lines(self) -> None:
        found = read_observed(LINES.encode(), "p.csv")
        assert isinstance(found, tuple)
        assert [(line.name, line.kind) for line in found] == [
            ("a", "plumb"),
            ("sea", "horizon"),
            ("b", "plumb"),
        ]
        assert [len(side) for side in found[0].pixels] == [2, 1]
        assert [len(side) for side in found[1].pixels] == [1, 0]

    def test_a_throw(self) -> None:
        found = read_observed(THROW.encode(), "t.csv", 50.0)
        assert isinstance(found, Throw)
        np.testing.assert_array_equal(found.frames, [7, 9])
        assert found.tracks == ("one", "one")
        with pytest.raises(StereocalError, match="needs the frame rate"):
            read_observed(THROW.encode(), "t.csv")

    @pytest.mark.parametrize(
        ("text", "says"),
        [
            ("", "empty"),
            ("a,b\n1,2\n", "has a column point"),
            ("point,x,y\nA,1,2\n", "column z is missing"),
            ("point,x,y,z\n", "no rows"),
            ("point,x,y,z\nA,1,2,3\n", "line 2: u_primary, .* are not all given"),
            ("point,x,x,y,z\nA,1,2,3,4\n", "names the column x twice"),
            (SURVEY.replace("P2,1", "P2,nan"), "line 3: x is empty"),
            (SURVEY.replace("P2,1", "P2,inf"), "not a finite number"),
            (SURVEY.replace("P2,1", "P2,1e99"), "too far away"),
            (SURVEY.replace("P2,1", "P2,one"), "not a number"),
            (SURVEY.replace("P2", "P1"), "P1 has other coordinates in an earlier row"),
            (SURVEY.replace("P2", " "), "the point has no name"),
            (SURVEY.replace("41", "41,42"), "9 cells instead of 8"),
            (SURVEY.replace("31", ""), "are not all given"),
            (LINES.replace("horizon", "vertical"), 'kind is "vertical"; it must be plumb'),
            (LINES.replace("sea", "a"), "a is a plumb line in an earlier row"),
            (LINES.replace("7,8,,", "7,,,"), "one of u and v is empty"),
            (LINES.replace("sea", ""), "the line has no name"),
            (THROW.replace("9,5", "9.5,5"), "not a whole number"),
            (THROW.replace("9,5", "1e30,5"), r"up to 2\^53"),
            ("frame,u_primary,v_primary,u_secondary,v_secondary\n1,2,3,,\n", "no frame has"),
            ("line," + "x," * 3000 + "y\n", "too many"),
            ("point\0", "not a text file"),
        ],
    )
    def test_what_is_refused(self, text: str, says: str) -> None:
        with pytest.raises(StereocalError, match=says):
            read_observed(text.encode(), "t.csv", 100.0)
