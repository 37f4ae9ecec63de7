"""`stereocal check`: what it writes, and one sentence with exit 2 for each bad input."""

import json
import re
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from stereocal.calibration.corrections import with_pixels
from stereocal.cli import main
from stereocal.fit.parameter_file import refined_parameters
from stereocal.fit.refine import refine
from stereocal.fit.screening.screen import screen
from stereocal.formats.dataset_files import (
    pack_dataset,
    pack_recording,
    read_dataset,
    read_recording,
)
from stereocal.rig.camera import CAMERAS
from stereocal.rig.parameters import RigParameters
from stereocal.simulation.simulate import place_bars
from tests.files import write
from tests.further import further
from tests.rigs.bumps import Case, bumped, cases, seen_by
from tests.rigs.mistakes import in_images
from tests.rigs.refined_rigs import BAR_M, DEPTHS_M


@dataclass(frozen=True)
class Work:
    """A parameter file and a data set of the rig after it moved."""

    parameters: Path
    moved: Path
    out: Path

    def check(self, *arguments: object) -> int:
        return main(["check", *map(str, arguments), "--out", str(self.out)])

    @property
    def answer(self) -> dict[str, object]:
        found = json.loads((self.out / "check.json").read_text())
        assert isinstance(found, dict)
        return found


@pytest.fixture
def work(tmp_path: Path) -> Work:
    case: Case = next(cases(1, 44))
    found = Work(tmp_path / "parameters_refined.json", tmp_path / "moved", tmp_path / "out")
    case.prior.rig.save(found.parameters)
    rig = bumped(case, np.radians(0.5))
    moved = seen_by(case, place_bars(rig, case.rng, 5, BAR_M, DEPTHS_M))
    write(pack_dataset(moved), found.moved)
    return found


def test_a_moved_camera_and_repaired_parameters(
    work: Work, capsys: pytest.CaptureFixture[str]
) -> None:
    assert work.check(work.parameters, work.moved) == 0
    assert capsys.readouterr().out.startswith("Moved: ")
    first = work.answer
    assert first["verdict"] == "moved"
    assert first["repaired"] == "parameters_repaired.json"
    repaired = RigParameters.load(work.out / "parameters_repaired.json")
    assert "repaired_from" in repaired.inputs
    work.out.rename(work.out.with_name("before"))
    before = work.out.with_name("before") / "parameters_repaired.json"
    assert work.check(before, work.moved) == 0
    assert work.answer["verdict"] == "cannot tell"
    assert not (work.out / "parameters_repaired.json").exists()


def test_a_file_without_covariance_uses_the_refined_file_beside_it(
    work: Work, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = RigParameters.load(work.parameters)
    bare = work.parameters.with_name("parameters_2d.json")
    replace(rig, method="2d", uncertainties=None).save(bare)
    assert work.check(bare, work.moved) == 0
    assert "parameters_refined.json was checked instead" in capsys.readouterr().out
    work.parameters.unlink()
    shutil.rmtree(work.out)
    assert work.check(bare, work.moved) == 2
    assert "does not state the covariance" in capsys.readouterr().err
    assert not work.out.exists()


CASES = Path(__file__).parents[1] / "cases"


@pytest.mark.parametrize("stated", ["check_bar_data", "check_bar_inch"])
def test_another_bar_is_no_movement(stated: str, tmp_path: Path) -> None:
    """A bar of 0.5 m, stated as 0.4 and 0.508 m: nothing moved. Before, the baseline was 20 %
    shorter, or both lenses refocused."""
    folder = CASES / "check_other_bar"
    given = [str(folder / "parameters_refined.json"), str(folder / stated)]
    assert main(["check", *given, "--out", str(tmp_path)]) == 0
    answer = json.loads((tmp_path / "check.json").read_text())
    assert answer["verdict"] != "moved" and answer["repaired"] is None
    assert answer["baseline_m"]["value"] == pytest.approx(1.2176, abs=0.01)
    (note,) = (note for note in answer["notes"] if "The bar seems" in note)
    assert "0.4992 m by these images" in note
    assert [file.name for file in tmp_path.iterdir()] == ["check.json"]


@pytest.mark.parametrize(
    ("cropped", "cut_px"),
    [
        (["secondary"], (0.0, 100.0)),
        *further((["secondary"], (80.0, 0.0)), ([*CAMERAS], (60.0, 40.0))),
    ],
)
def test_a_crop_is_no_movement(
    cropped: list[str], cut_px: tuple[float, float], tmp_path: Path
) -> None:
    """Before: a turn by 3.8 degrees and a baseline 3 % shorter, or focal lengths 2 % longer."""
    given = read_recording(CASES / "check_other_bar" / "check_bar_data")
    held = replace(given.object, points=given.object.points / 0.8)  # 0.5 m, as it was
    cut = with_pixels(given, cropped, lambda points, _: points - cut_px)
    write(pack_recording(in_images(replace(cut, object=held))), tmp_path / "new")
    parameters = CASES / "check_other_bar" / "parameters_refined.json"
    assert main(["check", str(parameters), str(tmp_path / "new"), "--out", str(tmp_path)]) == 0
    answer = json.loads((tmp_path / "check.json").read_text())
    assert answer["verdict"] != "moved" and answer["repaired"] is None
    (note,) = (note for note in answer["notes"] if "cropped" in note)
    found = [float(value) for value in re.findall(r"(-?\d+) px", note)]
    assert found == pytest.approx(cut_px, abs=3.0)  # 1 and 100, 81 and 0, 62 and 39
    assert ("both" in note) == (len(cropped) == 2)


def test_points_of_before_do_not_belong_to_repaired_parameters(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They scatter by 1.5 px, the bars of the repair by 0.23, and are matched below 20 px."""
    folder, out = CASES.parents[1] / "sample_data" / "recording", str(tmp_path / "pairs.csv")
    points = [str(folder / f"points_{name}.csv") for name in CAMERAS]
    before = tmp_path / "parameters_refined.json"
    refined = refined_parameters(refine(screen(read_dataset(folder)).dataset))
    replace(refined, matching_threshold_px=0.91).save(before)
    bump = CASES.parents[1] / "sample_data" / "bump"
    assert main(["check", str(before), str(bump), "--out", str(tmp_path)]) == 0
    capsys.readouterr()
    repaired = str(tmp_path / "parameters_repaired.json")
    assert main(["match", *points, "--parameters", repaired, "--out", out]) == 0
    printed = capsys.readouterr().out
    assert "With the repaired parameters your points scatter by 1.5 px, the images of" in printed
    assert "by 0.23 px. Match points recorded before the movement with the param" in printed
    assert main(["match", *points, "--parameters", str(before), "--out", out]) == 0
    assert "repaired" not in capsys.readouterr().out


def test_a_turn_of_17_degrees_is_told_and_repaired(tmp_path: Path) -> None:
    """With the old parameters no point is in front of both cameras: that was a warning of NumPy,
    "none px" and no repair. True: 17.2 degrees."""
    folder = CASES / "check_turn_17"
    given = [str(folder / "parameters_refined.json"), str(folder / "check_zoom_turned17deg")]
    assert main(["check", *given, "--out", str(tmp_path)]) == 0
    answer = json.loads((tmp_path / "check.json").read_text())
    turn = answer["rotation_rad"]
    assert turn["low"] < np.radians(17.2) < turn["high"]
    assert answer["repaired"] and "none" not in answer["reason"]
