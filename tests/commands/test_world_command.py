"""The command world, and reconstruct with what it writes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from stereocal.cli import main
from stereocal.rig.geometry import Pose
from tests.field.world_tables import PIXELS, lines_csv
from tests.rigs.worlds import Place, known_places, plumb_lines


@pytest.fixture
def place(tmp_path: Path) -> Place:
    """A rig whose parameters are in `rig.json`."""
    found = next(known_places(1, 21))
    found.rig.save(tmp_path / "rig.json")
    return found


def run(folder: Path, table: str, *more: str) -> int:
    parameters = str(folder / "rig.json")
    arguments = [str(folder / table), "--parameters", parameters, "--out", str(folder / "w.json")]
    return main(["world", *arguments, *more])


def written(folder: Path) -> tuple[Pose, dict[str, object]]:
    data = json.loads((folder / "w.json").read_text())
    table = np.array(data["world_from_primary"])
    return Pose(table[:3, :3], table[:3, 3]), data


def test_plumb_lines_and_points_in_the_world(
    place: Place, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "plumb.csv").write_bytes(lines_csv(plumb_lines(place)))
    assert run(tmp_path, "plumb.csv") == 0
    printed = capsys.readouterr().out
    assert "World frame of 4 plumb lines: the vertical is known within" in printed
    pose, data = written(tmp_path)
    assert data["source"] == "plumb"
    assert np.degrees(np.arccos(pose.R[2] @ place.up)) < 0.15
    points = np.array([[0.0, 0.0, 6.0], [0.1, 0.2, 7.0]])
    pairs = pd.DataFrame(place.images(points, 0.0), columns=PIXELS)
    pairs.insert(0, "frame", [1, 2])
    pairs.to_csv(tmp_path / "pairs.csv", index=False)
    files = ["--parameters", str(tmp_path / "rig.json"), "--out", str(tmp_path / "points.csv")]
    world = ["--world", str(tmp_path / "w.json")]
    assert main(["reconstruct", str(tmp_path / "pairs.csv"), *files, *world]) == 0
    table = pd.read_csv(tmp_path / "points.csv")
    np.testing.assert_allclose(table[["x", "y", "z"]], pose.apply(points), atol=1e-6)
    assert (table["coordinates"] == data["name"]).all()
    assert main(["reconstruct", str(tmp_path / "pairs.csv"), *files]) == 0
    assert "coordinates" not in pd.read_csv(tmp_path / "points.csv")
