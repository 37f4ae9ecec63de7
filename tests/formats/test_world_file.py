"""`world.json`, 4x4 tables, and the tables that a world frame is found from."""

import json
from pathlib import Path

import numpy as np

from stereocal.field.world.frame import Survey, Throw, WorldFrame
from stereocal.formats.world_file import WORLD_FORMAT, read_observed, read_world, write_world
from stereocal.matching.reconstruction import name_of_world
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.parameters import RigParameters
from tests.refused import refused
from tests.rigs.known_rig import PRIMARY, RIG, SECONDARY

WORLD = Pose.from_angles(Angles(0.3, -0.4, 1.2, 0.1, 0.2), 5.0)


TABLE = np.vstack([np.column_stack([WORLD.R, WORLD.T]), [0, 0, 0, 1]])


def test_tables_and_world_json_are_read_exactly(tmp_path: Path) -> None:
    frame = WorldFrame(WORLD, "plumb", {"vertical_deg": 0.1}, "Found.", ("a note",))
    rig = RigParameters(PRIMARY, SECONDARY, RIG, "2d", 1.0, {}, {"sha256": "ab"})
    content = write_world(frame, rig)
    csv = "\n".join(",".join(map(repr, row)) for row in TABLE.tolist())
    texts = {"w.json": content.decode(), "t.json": json.dumps(TABLE.tolist()), "t.csv": csv}
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
        read = read_world(tmp_path / name)
        np.testing.assert_array_equal(np.column_stack([read.R, read.T]), TABLE[:3])
    data = json.loads(content)
    assert (data["format"], data["source"]) == (WORLD_FORMAT, "plumb")
    assert data["world_from_primary"] == TABLE.tolist()
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
        kinds = {line.name: line.kind for line in found}
        assert kinds == {"a": "plumb", "sea": "horizon", "b": "plumb"}
        assert [len(side) for line in found[:2] for side in line.pixels] == [2, 1, 1, 0]

    def test_a_throw(self) -> None:
        found = read_observed(THROW.encode(), "t.csv", 50.0)
        assert isinstance(found, Throw)
        np.testing.assert_array_equal(found.frames, [7, 9])
        assert found.tracks == ("one", "one")
        with refused("t.csv", "frame rate"):
            read_observed(THROW.encode(), "t.csv")
