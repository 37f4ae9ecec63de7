"""The command line: what it writes, and one sentence with exit 2 for each bad input."""

import io
import json
import re
import shutil
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import pytest

from stereocal.calibration.methods import CalibrationSettings
from stereocal.cli import main
from stereocal.errors import StereocalError
from stereocal.formats.dataset_files import pack_dataset, read_dataset
from stereocal.rig.parameters import RigParameters
from stereocal.verdict.in_words import digits, refuse_unknown_frames
from tests.files import write
from tests.fit.test_time_offset import moving
from tests.terminal import sentences

FIELD = Path(__file__).parents[2] / "sample_data" / "field"


@pytest.fixture
def field(tmp_path: Path) -> Path:
    """A copy of the sample data set that a test may spoil."""
    return Path(shutil.copytree(FIELD, tmp_path / "field"))


def without_date(path: Path) -> str:
    text, replaced = re.subn(r'"created": "[^"]+"', "", path.read_text())
    assert replaced == 1
    return text


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """What `calibrate` writes for the sample, and what it prints."""
    out, printed = tmp_path_factory.mktemp("calibrated") / "new" / "out", io.StringIO()
    with redirect_stdout(printed):
        assert main(["calibrate", str(FIELD), "--out", str(out), "--runs", "5"]) == 0
    return out, printed.getvalue()


def test_calibrate_prints_the_methods_and_writes_three_files(calibrated: tuple[Path, str]) -> None:
    out, printed = calibrated
    for word in ("essential", "2d", "3d", "50 pairs", "25 bars", "the step fell below"):
        assert word in printed
    assert "refined: noise 0.1" in printed
    assert "Use the refined set for both: match below" in printed
    assert "One set does both jobs here (more than 99 % sure)" in printed
    assert "Forecast for similar bars" in printed
    assert "Checked on held-out frames" not in printed  # said where it does not hold
    names = [f"parameters_{method}.json" for method in ("2d", "3d", "refined")]
    assert sorted(path.name for path in out.iterdir()) == names
    files = [RigParameters.load(out / name) for name in names]
    assert [own.purpose for own in files] == ["matching", "reconstruction", "both"]
    assert json.loads((out / "parameters_3d.json").read_text())["settings"]["delta"] == 1e-3
    in_files = {}
    for own in files:
        assert own.matching_threshold_px is not None
        in_files[own.method] = digits(own.matching_threshold_px, 2)
    told = dict(re.findall(r"^(\w+) .*, threshold ([\d.]+) px$", printed, re.MULTILINE))
    assert told == in_files  # and no other threshold of a file
    assert f"for both: match below {in_files['refined']} px" in printed


def test_same_seed_same_bytes_but_for_the_date(
    calibrated: tuple[Path, str], field: Path, tmp_path: Path
) -> None:
    folders = calibrated[0], tmp_path / "again", tmp_path / "other"
    for out, options in zip(
        folders[1:], ("--runs 5 --seed 0", "--runs 0 --seed 6 --no-refined"), strict=True
    ):
        assert main(["calibrate", str(field), "--out", str(out), *options.split()]) == 0
    refined = [without_date(out / "parameters_refined.json") for out in folders[:2]]
    assert refined[0] == refined[1]
    for name in ("parameters_2d.json", "parameters_3d.json"):
        one, again, other = (without_date(out / name) for out in folders)
        assert one == again
        assert one.replace('"seed": 0', "") != other.replace('"seed": 6', "")


def test_settings_reach_the_result_and_bad_frames_are_named(
    field: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell(9, 3, "1200")(field)
    frame = (field / "correspondences.csv").read_text().splitlines()[8].split(",")[0]
    expected: dict[str, object] = {"delta": 0.002, "delta_min": 1e-5, "acceptance": 0.3}
    expected |= {"shrink": 0.5, "minimum_moves": 1, "essential": "linear", "calibration_frames": 20}
    flat = [word for k, v in expected.items() for word in (f"--{k.replace('_', '-')}", str(v))]
    command = ["calibrate", str(field), "--out", str(tmp_path), "--runs", "3", *flat]
    assert main(command) == 0
    printed = capsys.readouterr().out
    assert f"Left out: frame {frame}, which contradicts the others." in printed
    assert "Recommendation: " in printed  # decided without enough splits
    written = json.loads((tmp_path / "parameters_2d.json").read_text())
    assert expected.items() <= written["settings"].items()
    assert len(written["inputs"]["frames"]) == 20


def table(edit: Callable[[list[str]], list[str]]) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        path = folder / "correspondences.csv"
        path.write_text("\n".join(edit(path.read_text().splitlines())) + "\n")

    return spoil


def cell(line: int, column: int, value: str) -> Callable[[Path], None]:
    def edit(lines: list[str]) -> list[str]:
        cells = lines[line - 1].split(",")
        cells[column] = value
        lines[line - 1] = ",".join(cells)
        return lines

    return table(edit)


def described(**values: Any) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        path = folder / "dataset.json"
        path.write_text(json.dumps({**json.loads(path.read_text()), **values}))

    return spoil


def copied(lines: list[str]) -> list[str]:
    """The first frame under all numbers."""
    first = [row.split(",")[2:] for row in lines[1:3]]
    rows = [row.split(",")[:2] for row in lines[1:]]
    return [lines[0], *(",".join([*row, *first[at % 2]]) for at, row in enumerate(rows))]


def ends_exchanged(lines: list[str]) -> list[str]:
    """In the secondary camera, A is called B and B is called A, in all frames."""
    rows = [line.split(",") for line in lines[1:]]
    for a, b in zip(rows[::2], rows[1::2], strict=True):
        a[4:6], b[4:6] = b[4:6], a[4:6]
    return [lines[0], *(",".join(row) for row in rows)]


BAD: dict[str, tuple[Callable[[Path], None], *tuple[str, ...]]] = {
    "text in a number": (cell(7, 2, "abc"), "line 7: u_primary", "abc"),
    "copies": (table(copied), "2 pairs of points"),
    "baseline in mm": (described(baseline_m=4500), "4500 m", "millimetres"),
    "camera missing": (lambda folder: (folder / "secondary.json").unlink(), "'secondary.json'"),
    "ends exchanged": (table(ends_exchanged), "A and B", "exchanged"),
}
"""One of each place where input is checked; `formats/test_refused.py` has all that is wrong."""


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_sentence_exit_2_and_no_file(
    name: str, field: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil, *said = BAD[name]
    spoil(field)
    out = tmp_path / "out"
    assert main(["calibrate", str(field), "--out", str(out)]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert all(word in printed.err for word in said), printed.err
    assert len(sentences(printed.err)) == 1
    assert not out.exists() or not any(out.iterdir())


REMOVED = table(lambda lines: [line for line in lines if not line.startswith(("7,", "9,"))])


@pytest.mark.parametrize("command", ["calibrate", "evaluate"])
@pytest.mark.parametrize("option", ["--leave-out", "--put-back"])
def test_frames_that_do_not_exist_are_named_with_those_that_do(
    command: str, option: str, field: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    REMOVED(field)
    out = tmp_path / "out"
    assert main([command, str(field), "--out", str(out), option, "3", "9", "999"]) == 2
    (said,) = sentences(capsys.readouterr().err)
    assert "no frames 9 and 999" in said
    assert "1 to 6, 8 and 10 to 25." in said
    assert option in said
    assert not out.exists()


def test_a_frame_of_one_data_set_of_several_exists(field: Path) -> None:
    REMOVED(field)
    settings, one = CalibrationSettings(frames_left_out=(9,)), read_dataset(field)
    refuse_unknown_frames(settings, [read_dataset(FIELD), one])
    with pytest.raises(StereocalError):
        refuse_unknown_frames(settings, [one])


def test_the_time_offset_is_found_and_applied(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    late, out = str(tmp_path / "late"), tmp_path / "out"
    write(pack_dataset(moving(0.7)), tmp_path / "late")
    options = ["--time-offset", "--no-refined", "--runs", "0"]
    assert main(["calibrate", late, "--out", str(out), *options]) == 0
    assert "frame intervals later than the primary" in capsys.readouterr().out
    entry = json.loads((out / "parameters_2d.json").read_text())["time_offset_frames"]
    assert entry["value"] == pytest.approx(0.7, abs=0.02)
    evaluated = ["--time-drift", "--runs", "2", "--no-refined", "--out", str(out)]
    assert main(["evaluate", late, *evaluated]) == 0
    assert "drifting by" in capsys.readouterr().out
    (about,) = json.loads((out / "summary.json").read_text())["datasets"]
    assert about["time_offset_frames"]["value"] == pytest.approx(0.7, abs=0.02)
    assert about["frames_left_out"]
