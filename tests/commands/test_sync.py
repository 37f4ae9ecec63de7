"""`stereocal sync`, and data sets whose cameras count their own frames."""

import json
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pandas as pd
import pytest

from stereocal.cli import main
from stereocal.fit.rig_file import RigFile
from stereocal.fit.timing.to_calibrate import in_step, pair_to_calibrate
from stereocal.formats.dataset_files import read_recording
from stereocal.rig.recording import Recording
from stereocal.workflow.given import recording_in
from tests.files import write
from tests.refused import refused


@pytest.fixture(scope="module")
def by_hand(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("by_hand")
    assert main(["sample", "by_hand", "--out", str(folder)]) == 0
    table = pd.read_csv(folder / "points.csv")
    kept = table[(table["camera"] < 3) & (table["camera_frame"] < 200)]
    kept.to_csv(folder / "points.csv", index=False)
    described = json.loads((folder / "dataset.json").read_text())
    del described["cameras"]["3"]
    (folder / "dataset.json").write_text(json.dumps({**described, "baselines_m": {}}))
    return folder


@pytest.fixture(scope="module")
def stepped(by_hand: Path) -> Recording:
    return in_step(read_recording(by_hand))


def test_sync_writes_a_data_set_in_step(
    by_hand: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sync", str(by_hand), "--out", str(tmp_path)]) == 0
    assert "one frame off" in capsys.readouterr().out
    assert json.loads((tmp_path / "dataset.json").read_text())["start_frames"] == {"1": 0, "2": 41}
    written = pd.read_csv(tmp_path / "points.csv")
    of_second = written[written["camera"] == 2]
    assert (of_second["frame"] - of_second["camera_frame"] == 41).all()
    in_step = read_recording(tmp_path)
    assert in_step.start_frames == {"1": 0, "2": 41}
    assert not in_step.step_notes
    assert main(["sync", str(tmp_path), "--out", str(tmp_path / "again")]) == 0
    np.testing.assert_array_equal(read_recording(tmp_path / "again").frame, in_step.frame)


def test_cameras_that_count_their_own_frames_are_brought_into_step_unasked(
    by_hand: Path, stepped: Recording
) -> None:
    counted = read_recording(by_hand)
    with refused("frames"):
        counted.pair("1", "2")
    assert stepped.start_frames == {"1": 0, "2": 41}
    assert any("one frame off" in note for note in stepped.step_notes)
    pair = pair_to_calibrate(counted)
    assert (pair.start_frame, pair.recording.step_notes) == (41, stepped.step_notes)


def test_a_table_to_check_a_rig_with_is_brought_into_step(by_hand: Path) -> None:
    known = read_recording(by_hand, as_counted=True)
    rig = cast(RigFile, SimpleNamespace(object=known.object, cameras=known.cameras))
    found = recording_in((by_hand / "points.csv").read_bytes(), "points.csv", rig)
    assert found.start_frames == {"1": 0, "2": 41}


def test_a_pair_needs_no_third_camera(by_hand: Path, tmp_path: Path) -> None:
    """Camera 3 saw one frame only, which tells nothing."""
    files = {path.name: path.read_bytes() for path in by_hand.iterdir()}
    described = json.loads(files["dataset.json"])
    described["cameras"]["3"] = described["cameras"]["1"]
    files["dataset.json"] = json.dumps(described).encode()
    files["points.csv"] += b"7,3,A,400,300\n"
    write(files, tmp_path)
    whole = read_recording(tmp_path)
    with refused("3"):
        in_step(whole)
    assert pair_to_calibrate(whole, "1-2").start_frame == 41


def test_a_table_for_each_camera_is_read(by_hand: Path, stepped: Recording, tmp_path: Path) -> None:
    table = pd.read_csv(by_hand / "points.csv")
    described = json.loads((by_hand / "dataset.json").read_text())
    for number, rows in table.groupby("camera"):
        rows.drop(columns="camera").to_csv(tmp_path / f"of_{number}.csv", index=False)
        shutil.copy(by_hand / f"camera_{number}.yaml", tmp_path)
    described["points"] = {"1": "of_1.csv", "2": "of_2.csv"}
    (tmp_path / "dataset.json").write_text(json.dumps({**described, "start_frames": {"1": 0}}))
    with refused("start_frames"):
        read_recording(tmp_path)
    known = {"start_frames": {"1": 0, "2": 41}}
    (tmp_path / "dataset.json").write_text(json.dumps({**described, **known}))
    found, by_camera = read_recording(tmp_path), np.argsort(stepped.camera, kind="stable")
    np.testing.assert_array_equal(found.frame, stepped.frame[by_camera])
    np.testing.assert_array_equal(found.points, stepped.points[by_camera])


def test_frame_rates_that_are_stated_are_used(
    by_hand: Path, stepped: Recording, tmp_path: Path
) -> None:
    """Camera 2 took every second frame; the common count is its own."""
    for name in ("camera_1.yaml", "camera_2.yaml"):
        shutil.copy(by_hand / name, tmp_path)
    table = pd.read_csv(by_hand / "points.csv")
    counted, second = table["camera_frame"], table["camera"] == 2
    own = counted.where(~second, counted // 2)
    table = table[~second | (counted % 2 == 1)].assign(camera_frame=own)
    table.to_csv(tmp_path / "points.csv", index=False)
    described = json.loads((by_hand / "dataset.json").read_text())
    stated = {"frame_rates": {"1": 60, "2": 30}, "start_frames": {"1": 0, "2": 21}}
    (tmp_path / "dataset.json").write_text(json.dumps({**described, **stated}))
    found, expected = read_recording(tmp_path), stepped.where(stepped.frame % 2 == 0)
    np.testing.assert_array_equal(2 * found.frame, expected.frame)
    np.testing.assert_array_equal(found.points, expected.points)
    assert any("of 1 frame 2 k" in note for note in found.step_notes)
    for wrong in ({"1": 60}, {"1": 60, "2": 0}, {"1": 60, "2": "fast"}, 60):
        described["frame_rates"] = wrong
        (tmp_path / "dataset.json").write_text(json.dumps(described))
        with refused("frame_rates"):
            read_recording(tmp_path)


def test_a_table_of_both_cameras_is_in_step_already(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sync", "sample_data/recording", "--out", str(tmp_path)]) == 2
    assert "in step already" in capsys.readouterr().err
