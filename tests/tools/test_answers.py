"""What commands answer: kept twice it is the same, and what differs is found and named."""

import re
import shutil
import zipfile
from pathlib import Path

import pytest

from tests.further import of_a_whole_soak
from tools.answers.__main__ import main
from tools.answers.comparing import difference

CASE, REFUSED = "convert-opencv", "match-lost"


@of_a_whole_soak  # processes of commands; what is compared is below
def test_a_case_with_another_date_is_the_same_and_a_changed_digit_is_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old, new = tmp_path / "old", tmp_path / "new"
    assert main(["keep", str(old), "--only", CASE, REFUSED]) == 0
    shutil.copytree(old, new)
    assert (new / REFUSED / "exit").read_text() == "2\n"
    assert "none.csv" in (new / REFUSED / "stderr").read_text()
    assert (new / CASE / "exit").read_text() == "0\n"
    assert "wrote parameters.json" in (new / CASE / "stdout").read_text()
    (old / "inputs" / "of_another_case").mkdir()
    (old / "inputs" / "of_another_case" / "table.csv").write_text("frame\n")
    file = new / CASE / "parameters.json"
    text = file.read_text()
    (created,) = re.findall(r'"created": "(.*)"', text)
    file.write_text(text.replace(created, "2001-02-03T04:05:06+00:00"))
    assert main(["compare", str(old), str(new)]) == 0
    (angle,) = re.findall(r'"yaw": (\S+),', text)
    file.write_text(text.replace(angle, str(float(angle) + 0.25)))
    capsys.readouterr()
    assert main(["compare", str(old), str(new)]) == 1
    line, count = capsys.readouterr().out.splitlines()
    assert line.startswith(f"{CASE}/parameters.json: ")
    assert "most by 0.25" in line and "yaw" in line
    assert count.startswith("1 of ")
    file.unlink()
    assert main(["compare", str(old), str(new), "--only", CASE]) == 1


def test_texts_differ_by_numbers_words_and_lines() -> None:
    found = difference("a 1.5, b 1e-9\nc 2", "a 1.5, b 3e-9\nc 2.5", 0.0)
    assert found and "2 numbers, most by 0.25: 2 is now 2.5 (line 2" in found
    assert "1e-9 is now 3e-9 (line 1" in found
    assert difference("a 100", "a 100.5", 0.01) is None
    assert difference("a 1.0", "a 1.00", 0.0)
    assert "line 2" in (difference("a 1\nwas 2", "a 1\nis 2", 0.0) or "")
    assert "3 lines, not 2" in (difference("a\nb", "a\nb\nc", 0.0) or "")
    stage = "9 runs: done in {} s\nleft 1 s".format
    assert difference(stage(1), stage(12), 0.0) is None
    assert difference('{"numpy": "1.2"}', '{"numpy": "2.0"}', 0.0) is None
    of_methods = "2d  0.15  517    {}  converged".format
    assert difference(of_methods("0.002"), of_methods("0.105"), 0.0) is None
    assert difference(f"{of_methods('0.002')}", of_methods("0.002").replace("15", "16"), 0.0)


def test_a_file_in_an_archive_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, digit in (("old", "1"), ("new", "2")):
        (tmp_path / name / "case").mkdir(parents=True)
        with zipfile.ZipFile(tmp_path / name / "case" / "kit.zip", "w") as archive:
            archive.writestr("table.csv", f"x\n{digit}\n")
    assert main(["compare", str(tmp_path / "old"), str(tmp_path / "new")]) == 1
    assert "case/kit.zip/table.csv: 1 numbers, most by 1:" in capsys.readouterr().out
