"""`stereocal print`: files to print, and one sentence for what cannot be printed."""

from __future__ import annotations

from pathlib import Path

import pytest

from stereocal.cli import main
from stereocal.field.printing.paper import PAPERS
from stereocal.field.printing.sheet import field_sheet
from stereocal.formats.plan_file import write_plan
from tests.field.plans import plan

ROOT = Path(__file__).parents[2]
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
