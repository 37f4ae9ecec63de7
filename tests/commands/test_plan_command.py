"""`stereocal plan` from the command line: its two files, its answer, bad plans."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from stereocal.cli import main
from stereocal.field.planning.forecast import forecast
from stereocal.formats.plan_file import read_plan
from tests.field.plans import contents

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
