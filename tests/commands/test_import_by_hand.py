"""`stereocal import` of tables whose frames are each camera's own count."""

import io
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from stereocal.cli import main
from stereocal.formats.dataset_files import read_dataset
from stereocal.rig.pair import Pair
from stereocal.simulation.simulate import field_rig
from stereocal.system.array_types import FloatArray
from tests.files import write
from tests.rigs.moving_bar import counted_by_themselves

FRAMES, LATER = 400, 137
LENGTHS = ("--baseline", "4.5", "--distance", "0.9")
Tables = dict[str, pd.DataFrame]


@pytest.fixture(scope="module")
def recorded() -> tuple[dict[str, bytes], Pair]:
    return counted_by_themselves(LATER, FRAMES)


def as_written(files: dict[str, bytes], how: str) -> Tables:
    """The same points in tables of other kinds."""
    tables = {n: pd.read_csv(io.BytesIO(files[n])) for n in ("left.csv", "right.csv")}
    own = {"frame": "camera_frame", "x": "u", "y": "v"}
    if how == "long":
        return {"long.csv": pd.concat([table.assign(camera=n) for n, table in tables.items()])}
    for number, (name, table) in enumerate(tables.items()):
        if how == "tracks":
            wide = table.pivot_table(index="frame", columns="target", values=["x", "y"])
            wide.columns = wide.columns.map("{0[1]}_{0[0]}".format)
            tables[name] = wide.reset_index()
        elif how != "frame":
            tables[name] = table.rename(columns=own)
        if how == "beside":  # rows that no two cameras share
            tables[name].insert(0, "frame", 10_000 * number + np.arange(len(table)))
    return tables


def given(files: dict[str, bytes], tables: Tables, folder: Path) -> list[str]:
    """The paths of the tables and of the camera files."""
    lenses = {name: content for name, content in files.items() if name.endswith(".json")}
    written = {n: table.to_csv(index=False).encode() for n, table in tables.items()}
    write(lenses | written, folder)
    return [str(folder / name) for name in (*written, *lenses)]


def degrees(one: FloatArray, other: FloatArray) -> float:
    return float(np.degrees(np.arccos(one @ other / np.linalg.norm(one) / np.linalg.norm(other))))


@pytest.mark.parametrize(
    ("how", "stated"),
    [
        ("frame", ["--frames", "own"]),
        ("tracks", ["--frames", "own"]),
        ("long", ["--frames", "own"]),
        ("beside", ["--frames", "own"]),
        ("own", []),
    ],
)
def test_they_are_brought_into_step_and_calibrated(
    recorded: tuple[dict[str, bytes], Pair], tmp_path: Path, how: str, stated: list[str]
) -> None:
    """Measured of the 2D set: 0.09 degrees from the true rotation, 0.08 from the direction."""
    (files, truth), pose = recorded, field_rig(4.5).pose
    paths, out = given(files, as_written(files, how), tmp_path), tmp_path / "set"
    assert main(["import", *paths, *LENGTHS, *stated, "--out", str(out)]) == 0
    data, true = read_dataset(out), truth.correspondences
    assert data.start_frame == LATER
    both = true.where((true.time_frame >= LATER) & (true.time_frame < FRAMES - LATER))
    rows = data.correspondences
    order, order_true = (np.lexsort([t.target, t.time_frame]) for t in (rows, both))
    np.testing.assert_array_equal(rows.frame[order], both.time_frame[order_true])
    np.testing.assert_allclose(rows.secondary[order], both.secondary[order_true])
    if how != "frame":
        return
    assert main(["calibrate", str(out), "--out", str(tmp_path)]) == 0
    for method in ("2d", "3d"):
        found = json.loads((tmp_path / f"parameters_{method}.json").read_text())
        assert found["start_frames"] == {"primary": 0, "secondary": LATER}
        if method == "2d":
            R, T = np.array(found["R"]), np.array(found["T"]).ravel()
            off = np.degrees(np.arccos((np.trace(R.T @ pose.R) - 1) / 2))
            assert max(off, degrees(T, pose.T)) < 0.2


@pytest.mark.parametrize("how", ["frame", "tracks", "long"])
def test_unasked_they_are_not_taken_for_in_step(
    recorded: tuple[dict[str, bytes], Pair],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    how: str,
) -> None:
    paths, out = given(recorded[0], as_written(recorded[0], how), tmp_path), tmp_path / "set"
    assert main(["import", *paths, *LENGTHS, "--out", str(out)]) == 2
    told = capsys.readouterr().err
    assert "137.00" in told and "--frames own" in told and not out.exists()
    # What is stated is done.
    assert main(["import", *paths, *LENGTHS, "--frames", "common", "--out", str(out)]) == 0
    assert read_dataset(out).start_frame == 0


def test_tables_in_step_are_read_unasked(tmp_path: Path) -> None:
    files, truth = counted_by_themselves(later=0, frames=120)
    paths, out = given(files, as_written(files, "frame"), tmp_path), tmp_path / "set"
    assert main(["import", *paths, *LENGTHS, "--out", str(out)]) == 0
    assert len(read_dataset(out).correspondences) == len(truth.correspondences)
    few = {n: table[table["frame"] < 12] for n, table in as_written(files, "frame").items()}
    assert main(["import", *given(files, few, tmp_path), *LENGTHS, "--out", str(out)]) == 0
    assert len(read_dataset(out).correspondences.frames) == 12


def test_no_frame_in_common_is_told_with_the_option(
    recorded: tuple[dict[str, bytes], Pair], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tables = as_written(recorded[0], "frame")
    tables["right.csv"]["frame"] += 5000
    paths, out = given(recorded[0], tables, tmp_path), tmp_path / "set"
    assert main(["import", *paths, *LENGTHS, "--out", str(out)]) == 2
    assert "--frames own" in capsys.readouterr().err
    assert main(["import", *paths, *LENGTHS, "--frames", "own", "--out", str(out)]) == 0
    assert read_dataset(out).start_frame == LATER - 5000


def test_a_row_of_both_cameras_cannot_be_counted_twice(
    recorded: tuple[dict[str, bytes], Pair], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both = pd.DataFrame({"frame": [1, 1], "target": ["A", "B"], "left_x": [5, 9], "left_y": [5, 9]})
    tables = {"both.csv": both.assign(right_x=both["left_x"], right_y=both["left_y"])}
    paths = given(recorded[0], tables, tmp_path)
    assert main(["import", *paths, *LENGTHS, "--frames", "own", "--out", str(tmp_path)]) == 2
    assert "both.csv" in capsys.readouterr().err
