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
        ["target", "--side", "0.18"],
        ["target", "--focal", "7120", "--far", "25", "--near", "8"],
        ["target", "--camera", PRIMARY, "--far", "25", "--paper", "a3"],
        ["board", "--board", "18x12", "--square", "0.02", "--paper", "A3"],
        [
            "board",
            "--board",
            "8x6",
            "--square",
            "0.02",
            "--charuco",
            "DICT_4X4_50",
            "--marker",
            "0.015",
        ],
    ],
)
def test_prints_are_written(
    asked: list[str], suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / f"print.{suffix}"
    assert main(["print", *asked, "--out", str(out)]) == 0
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


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        ("target --side 0.18 --out print.png", '"print.png" must end in .pdf or .svg'),
        ("target --side 0.4 --out print.pdf", "does not fit on A4, which holds 185 mm"),
        ("target --focal 7120 --out print.pdf", "State --far, the largest distance"),
        ("target --camera no.json --far 9 --out print.pdf", "no.json cannot be read"),
        ("sheet no.json --out sheet.pdf", "no.json: there is no such file"),
        ("sheet no.json --out sheet.svg", '"sheet.svg" must end in .pdf'),
        ("board --board 18 --square 0.02 --out print.pdf", 'The size of the board is "18"'),
        ("board --board 18x12 --square 0.03 --out print.pdf", "at most 13 mm, or print it on A2"),
        ("board --board 8x6 --square 0.02 --paper B5 --out print.pdf", 'The paper "B5"'),
    ],
)
def test_what_cannot_be_printed_gives_one_sentence(
    asked: str,
    sentence: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["print", *asked.split()]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert len(said.splitlines()) == 1
    assert not list(tmp_path.iterdir())
