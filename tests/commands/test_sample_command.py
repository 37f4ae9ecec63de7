"""`stereocal sample`: every sample is written, and nothing that differs is overwritten."""

from __future__ import annotations

from pathlib import Path

import pytest

from stereocal.cli import main
from stereocal.commands.sample import SAMPLES
from stereocal.system.resources import ROOT


@pytest.mark.parametrize("name", SAMPLES)
def test_its_files_are_written(name: str, tmp_path: Path) -> None:
    assert main(["sample", name, "--out", str(tmp_path / "new" / "here")]) == 0
    source = ROOT / "sample_data" / name
    wanted = [path.relative_to(source) for path in source.rglob("*") if path.is_file()]
    assert len(wanted) > 2
    for path in wanted:
        assert (tmp_path / "new" / "here" / path).read_bytes() == (source / path).read_bytes()
