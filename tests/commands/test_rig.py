"""`stereocal rig`."""

import io
import json
import shutil
from contextlib import chdir, redirect_stdout
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stereocal.cli import main
from stereocal.fit.rig_file import RigFile
from stereocal.formats.camera_file import write_camera
from stereocal.formats.dataset_files import pack_recording, read_dataset, read_recording
from stereocal.formats.exchange.exchange import read_camera_pair
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.rig.correspondences import Correspondences
from stereocal.rig.parameters import RigParameters
from stereocal.simulation.rigs import simulated_rig
from stereocal.system.array_types import FloatArray
from stereocal.workflow.run import FORECAST
from tests.archives import kalibr_chain, wand_csv
from tests.files import write


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dataset")
    truth = simulated_rig(np.random.default_rng(30), 3, 60)
    write(pack_recording(truth.recording), folder)
    return folder


@pytest.fixture(scope="module")
def written(dataset: Path) -> tuple[Path, str]:
    """What `rig` writes, and what it prints."""
    out, printed = dataset.with_name("rig"), io.StringIO()
    with redirect_stdout(printed):
        assert main(["rig", str(dataset), "--out", str(out)]) == 0
    return out, printed.getvalue()


def test_rig_writes_its_files(
    dataset: Path, written: tuple[Path, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig, of_rig = written
    assert main(["calibrate", str(dataset), "--out", str(tmp_path)]) == 0
    told = capsys.readouterr().out
    assert "One rig of 3 cameras" in told
    assert told.replace(str(tmp_path), "") == of_rig.replace(str(rig), "")
    for name in ("rig.json", "c1-c2_refined.json"):
        once, again = (json.loads((at / name).read_text()) for at in (tmp_path, rig))
        assert once | {"created": ""} == again | {"created": ""}
    assert RigFile.load(tmp_path / "rig.json").names == ["c1", "c2", "c3"]
    report = (tmp_path / "report.html").read_text()
    assert "One rig of 3 cameras" in report
    digest = read_recording(dataset).sha256
    assert digest in report
    assert RigFile.load(tmp_path / "rig.json").about.inputs["sha256"] == digest
    pairs = [tmp_path / f"{pair}_refined.json" for pair in ("c1-c2", "c1-c3", "c2-c3")]
    for file in pairs:
        assert RigParameters.load(file).method == "refined"
        assert RigParameters.load(file).inputs["sha256"] == digest
    for given in ([*map(str, pairs)], [str(pairs[0])], [str(dataset), str(dataset)]):
        assert main(["rig", *given, "--out", str(tmp_path / "again")]) == 2
        (told,) = capsys.readouterr().err.splitlines()
        assert "recording" in told and "one data set" in told
    assert not (tmp_path / "again").exists()


def test_rig_with_the_sets_of_the_paper(dataset: Path, tmp_path: Path) -> None:
    assert main(["rig", str(dataset), "--out", str(tmp_path), "--pairs"]) == 0
    for pair in ("c1-c2", "c1-c3", "c2-c3"):
        figures = json.loads((tmp_path / "rig.json").read_text())["pairs"][pair]
        for method in ("2d", "3d", "refined"):
            own = RigParameters.load(tmp_path / f"{pair}_{method}.json")
            assert own.method == method
            assert own.camera_names == tuple(pair.split("-"))
        for figure in FORECAST:  # of the refined set
            assert figures[figure] == (own.predicted or {})[figure]
        assert 0 <= figures["fcp_reprojection"]["value"] < 0.2
        assert figures["threshold_px"]["value"] > 0


def test_wrong_input(dataset: Path, tmp_path: Path) -> None:
    assert main(["rig", str(tmp_path / "none"), "--out", str(tmp_path / "out")]) == 2
    description = json.loads((dataset / "dataset.json").read_text())
    first, *others = description["cameras"].items()
    description["cameras"] = {"../../outside": first[1], **dict(others)}
    shutil.copytree(dataset, tmp_path / "escaping")
    (tmp_path / "escaping/dataset.json").write_text(json.dumps(description))
    before = {*tmp_path.rglob("*")}
    of_pair = ["calibrate", str(dataset), "--pair", "c1-c3", "--out", str(tmp_path / "out")]
    assert main([*of_pair, "--leave-out", "999"]) == 2
    assert main(["rig", str(tmp_path / "escaping"), "--out", str(tmp_path / "a/out")]) == 2
    assert {*tmp_path.rglob("*")} == before


@pytest.mark.parametrize(
    ("command", "option"),
    [
        ("match a=a.csv b=b.csv --rig rig.json", "--depth 1 9"),
        ("match a=a.csv b=b.csv --rig rig.json", "--cameras 1,2"),
        ("match a=a.csv b=b.csv --rig rig.json", "--threshold 2"),
        ("reconstruct tracks.csv --rig rig.json", "--matched-with parameters_2d.json"),
        ("reconstruct tracks.csv --rig rig.json", "--workers 2"),
        ("check rig.json new", "--sigma-px 0.5"),
        ("check rig.json new", "--pair a-b"),
        ("check rig.json new", "--baseline-sigma 0.01"),
        ("detect new", "--every 5"),
        ("detect new", "--clock-ahead 0.1"),
    ],
)
def test_options_without_effect_are_rejected(
    command: str, option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "rig.json").write_text('{"format": "stereocal-rig/1"}')
    with chdir(tmp_path):
        assert main([*command.split(), *option.split(), "--out", "out"]) == 2
    assert capsys.readouterr().err.startswith(f"stereocal: {option.split()[0]} is for ")


@pytest.mark.parametrize("option", ["--runs 3", "--no-refined", "--leave-out 3", "--delta 0.002"])
def test_options_of_two_cameras_are_rejected_for_more(
    option: str, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["calibrate", str(dataset), *option.split(), "--out", str(out)]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"stereocal: {option.split()[0]} is for ") and "--pair" in told
    assert not out.exists()


def test_a_rig_is_written_for_other_programs(written: tuple[Path, str], tmp_path: Path) -> None:
    file = written[0] / "rig.json"
    rig = RigFile.load(file)
    for name in ("aniposelib", "caliscope", "kalibr"):
        out = tmp_path / ("out.yaml" if name == "kalibr" else "out.toml")
        assert main(["convert", str(file), "--to", name, "--out", str(out)]) == 0
        options = ExchangeOptions(cameras=("1", "3"))
        pair = read_camera_pair({out.name: out.read_bytes()}, options)
        assert pair.pose is not None
        assert pytest.approx(rig.poses["c3"].T, abs=1e-9) == pair.pose.T
        assert pytest.approx(rig.poses["c3"].R, abs=1e-9) == pair.pose.R
        assert pytest.approx(rig.cameras["c3"].K, rel=1e-9) == pair.secondary.K
    table = str(tmp_path / "dlt.csv")
    assert main(["convert", str(file), "--to", "dlt", "--out", table]) == 0
    L = np.loadtxt(table, delimiter=",")
    assert L.shape == (11, 3)
    point = np.array([0.1, -0.2, 6.0, 1.0])
    for number, name in enumerate(rig.names):
        P = np.append(L[:, number], 1.0).reshape(3, 4)
        u, v, w = P @ (point + np.array([0.0, 0.0, -1e-6, 0.0]))
        plain = replace(rig.cameras[name], distortion=np.zeros(0))
        expected = plain.project(rig.poses[name].apply(point[None, :3]))[0]
        assert [u / w, v / w] == pytest.approx(expected, abs=1e-4)
    assert main(["convert", str(file), "--to", "ros", "--out", table]) == 2


def sorted_pixels(rows: Correspondences) -> FloatArray:
    """(n, 4): pixels of both cameras."""
    pixels = np.column_stack([rows.primary, rows.secondary])
    return np.asarray(pixels[np.lexsort(pixels.T)])


def test_all_cameras_of_another_program(tmp_path: Path) -> None:
    (tmp_path / "camchain.yaml").write_bytes(kalibr_chain())
    # the third camera sees what the second sees
    lines = [line.split(",") for line in wand_csv().decode().split()]
    rows = [[*row[:4], *row[2:4], *row[4:], *row[6:]] for row in lines[1:]]
    head = [f"cam{k}_{axis}" for _ in "AB" for k in range(3) for axis in "xy"]
    (tmp_path / "wand.csv").write_text("\n".join(map(",".join, [head, *rows])) + "\n")
    (tmp_path / "two.csv").write_bytes(wand_csv())
    files = [str(tmp_path / name) for name in ("camchain.yaml", "wand.csv")]
    out = tmp_path / "every"
    words = ["import", *files, "--distance", "0.5", "--cameras", "all", "--out", str(out)]
    assert main(words) == 0
    recording = read_recording(out)
    assert list(recording.cameras) == ["1", "2", "3"]
    # the same points as of each pair
    assert main([*words[:-3], "1,2", "--out", str(tmp_path / "asked")]) == 2  # cam1, or the first?
    for pair, chosen in (("1,2", "cam0,cam1"), ("2,3", "2,3")):
        own = str(tmp_path / pair)
        words = ["import", *files, "--distance", "0.5", "--cameras", chosen, "--out", own]
        assert main([*words, "--baseline", "1"]) == 0
        expected = read_dataset(own).correspondences
        first, second = pair.split(",")
        found = recording.pair(first, second).correspondences
        for one, other in zip(*(sorted_pixels(each) for each in (found, expected)), strict=True):
            assert one == pytest.approx(other)
    # the same with a file of each camera, and with our table
    for name, camera in recording.cameras.items():
        (tmp_path / f"camera_{name}.json").write_bytes(write_camera(camera))
    single = [str(tmp_path / f"camera_{name}.json") for name in "123"]
    for table in (files[1], str(out / "points.csv")):
        again = ["--distance", "0.5", "--cameras", "all", "--out", str(tmp_path / "again")]
        assert main(["import", table, *single, *again]) == 0
        copy = read_recording(tmp_path / "again")
        assert list(copy.cameras) == ["1", "2", "3"]
        assert copy.points == pytest.approx(recording.points)
        assert np.array_equal(copy.camera, recording.camera)
    none = ["--distance", "0.5", "--cameras", "all", "--out", str(tmp_path / "none")]
    assert main(["import", files[1], *none]) == 2
    assert main(["import", files[0], str(tmp_path / "two.csv"), *none]) == 2
    assert not (tmp_path / "none").exists()
