"""Commands sample, plan, print and world; and one sentence for bad input in all commands."""

import json
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from stereocal.cli import main
from stereocal.commands.sample import MADE_OF, SAMPLES
from stereocal.field.planning.forecast import forecast
from stereocal.field.printing.paper import PAPERS
from stereocal.field.printing.sheet import field_sheet
from stereocal.formats.plan_file import read_plan, write_plan
from stereocal.rig.geometry import Pose
from stereocal.system.resources import ROOT
from tests.field.plans import contents, plan
from tests.field.world_tables import PIXELS, lines_csv
from tests.rigs.worlds import Place, known_places, plumb_lines


@pytest.mark.parametrize("name", sorted(SAMPLES.keys() - MADE_OF))
def test_its_files_are_written(name: str, tmp_path: Path) -> None:
    assert main(["sample", name, "--out", str(tmp_path / "new" / "here")]) == 0
    source = ROOT / "sample_data" / name
    wanted = [path.relative_to(source) for path in source.rglob("*") if path.is_file()]
    assert len(wanted) > 2
    for path in wanted:
        assert (tmp_path / "new" / "here" / path).read_bytes() == (source / path).read_bytes()


RIGS = 32


def plan_file(folder: Path, **changes: Any) -> Path:
    path = folder / "plan.json"
    path.write_text(json.dumps(contents(**changes)))
    return path


def test_forecast_and_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = plan_file(tmp_path), tmp_path / "out"
    assert main(["plan", str(path), "--out", str(out), "--rigs", str(RIGS)]) == 0
    printed = capsys.readouterr().out
    assert "Limited by" in printed and "wrote" in printed
    written = (out / "forecast.json").read_bytes()
    assert written == forecast(read_plan(path), rigs=RIGS).dumps()
    report = (out / "report.html").read_text(encoding="utf-8")
    assert "Forecast of the plan field" in report and "What would help most" in report
    assert "cdn.plot.ly" not in report.replace("https://cdn.plot.ly/un", "")


PRIMARY = str(ROOT / "sample_data" / "field" / "primary.json")


@pytest.mark.parametrize("suffix", ["pdf", "SVG"])
@pytest.mark.parametrize(
    "asked",
    [
        "target --side 0.18",
        "target --focal 7120 --far 25 --near 8",
        f"target --camera {PRIMARY} --far 25 --paper a3",
        "board --board 18x12 --square 0.02 --paper A3",
        "board --board 8x6 --square 0.02 --charuco DICT_4X4_50 --marker 0.015",
    ],
)
def test_prints_are_written(
    asked: str, suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / f"print.{suffix}"
    assert main(["print", *asked.split(), "--out", str(out)]) == 0
    assert out.read_bytes().startswith(b"%PDF" if suffix == "pdf" else b"<?xml")
    said = capsys.readouterr().out
    assert f"wrote {out}: print it at 100 % on A" in said
    assert ("px across at 25 m" in said) == ("--far" in asked)


def test_the_field_sheet_of_a_plan_is_written(tmp_path: Path) -> None:
    (tmp_path / "plan.json").write_bytes(write_plan(plan()))
    out = tmp_path / "sheet.pdf"
    asked = ["print", "sheet", str(tmp_path / "plan.json"), "--paper", "Letter", "--out", str(out)]
    assert main(asked) == 0
    assert out.read_bytes() == field_sheet(plan(), PAPERS["Letter"])


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


COMMANDS = (
    *("calibrate {}", "evaluate {} --runs 2", "import {}", "detect {}", "plan {}"),
    *("match {0} {0} --parameters {0}", "intrinsics {} --board 9x6 --square 0.03", "check {0} {0}"),
    *(f"{command} {{0}} --parameters {{0}}" for command in ("reconstruct", "world")),
    *("convert {} --to kalibr", "convert {} --from kalibr"),
)


@pytest.mark.parametrize("name", ["nothing_there.csv", "damaged.csv", "empty.csv"])
@pytest.mark.parametrize("command", COMMANDS)
def test_one_sentence_exit_2_and_no_file(
    command: str, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "damaged.csv").write_bytes(b"\x00\xff{[\n" * 9)
    (tmp_path / "empty.csv").touch()
    with chdir(tmp_path):
        assert main([*command.format(name).split(), "--out", "new"]) == 2
    said = capsys.readouterr()
    (sentence,) = (line for line in said.err.splitlines() if line.startswith("stereocal"))
    assert name.split(".")[0] in sentence and "Traceback" not in said.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["damaged.csv", "empty.csv"]


def test_a_photograph_to_leave_out_must_exist(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    boards = str(ROOT / "sample_data" / "boards")
    words = ["intrinsics", boards, "--board", "9x6", "--square", "0.03", "--out", f"{tmp_path}/c"]
    assert main([*words, "--leave-out", "left01.jpg", "left10.jpg"]) == 2
    assert "no photograph left10.jpg; there are left01.jpg," in capsys.readouterr().err
