"""What is not there or damaged gives one sentence, exit status 2 and no file, in every command."""

from __future__ import annotations

from pathlib import Path

import pytest

from stereocal.cli import main

COMMANDS = (
    "calibrate {}",
    "evaluate {} --runs 2",
    "import {}",
    "detect {}",
    "intrinsics {} --board 9x6 --square 0.03",
    "match {0} {0} --parameters {0}",
    "reconstruct {0} --parameters {0}",
    "convert {} --to kalibr",
    "convert {} --from kalibr",
    "check {0} {0}",
    "world {0} --parameters {0}",
    "plan {}",
    "reproduce {}",
)


@pytest.mark.parametrize("name", ["nothing_there.csv", "damaged.csv", "empty.csv"])
@pytest.mark.parametrize("command", COMMANDS)
def test_one_sentence_exit_2_and_no_file(
    command: str,
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("damaged.csv").write_bytes(b"\x00\xff{[\n" * 9)
    Path("empty.csv").touch()
    assert main([*command.format(name).split(), "--out", "new"]) == 2
    said = capsys.readouterr()
    (sentence,) = (line for line in said.err.splitlines() if line.startswith("stereocal"))
    assert name.split(".")[0] in sentence and "Traceback" not in said.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["damaged.csv", "empty.csv"]
