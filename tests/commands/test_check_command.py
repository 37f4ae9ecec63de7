"""`stereocal check`: what it writes, and one sentence with exit 2 for each bad input."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from stereocal.cli import main
from stereocal.formats.dataset_files import pack_dataset
from stereocal.rig.dataset import Dataset
from stereocal.rig.parameters import RigParameters
from stereocal.simulation.simulate import place_bars
from stereocal.system.atomic_files import write_all
from tests.rigs.bumps import Case, bumped, cases, seen_by
from tests.rigs.refined_rigs import BAR_M, DEPTHS_M


@dataclass(frozen=True)
class Work:
    """A parameter file, a data set of an unmoved rig and one of a moved rig, and matched points."""

    parameters: Path
    same: Path
    moved: Path
    pairs: Path
    out: Path

    def check(self, *arguments: object) -> int:
        return main(["check", *map(str, arguments), "--out", str(self.out)])

    @property
    def answer(self) -> dict[str, object]:
        found = json.loads((self.out / "check.json").read_text())
        assert isinstance(found, dict)
        return found


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Work:
    folder = tmp_path_factory.mktemp("check")
    case: Case = next(cases(1, 44))
    case.prior.rig.save(folder / "parameters_refined.json")
    moved = bumped(case, np.radians(0.5))
    data = {
        name: seen_by(case, place_bars(rig, case.rng, 25, BAR_M, DEPTHS_M))
        for name, rig in (("same", case.truth), ("moved", moved))
    }
    for name, each in data.items():
        few = each.of_frames(each.correspondences.frames[:5])
        write_all({folder / name / file: text for file, text in pack_dataset(few).items()})
    (folder / "pairs.csv").write_text(pairs_of(data["moved"]))
    return Work(
        folder / "parameters_refined.json",
        folder / "same",
        folder / "moved",
        folder / "pairs.csv",
        folder / "out",
    )


@pytest.fixture
def work(made: Work, tmp_path: Path) -> Work:
    """A copy that a test may spoil."""
    folder = Path(shutil.copytree(made.parameters.parent, tmp_path / "work"))
    return Work(*(folder / getattr(made, name).name for name in vars(made)))


def pairs_of(dataset: Dataset) -> str:
    rows = dataset.correspondences
    lines = ["frame,u_primary,v_primary,u_secondary,v_secondary"]
    pixels = np.column_stack([rows.primary, rows.secondary])
    lines += [
        ",".join([str(frame), *(f"{x:.4f}" for x in row)])
        for frame, row in zip(rows.frame, pixels, strict=True)
    ]
    return "\n".join(lines) + "\n"


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
