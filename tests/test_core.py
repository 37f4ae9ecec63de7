"""Library and command line without what the extra `dashboard` brings."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.terminal import FIELD, ROOT

WITHOUT = ("streamlit", "plotly", "pebble", "reportlab", "matplotlib", "sqlite3")
BLOCKED = f"""
import sys
class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {WITHOUT}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Blocked())
sys.path.insert(0, {str(ROOT)!r})
"""


def run(folder: Path, *lines: str) -> subprocess.CompletedProcess[str]:
    """Run each line as a command, in one process that has none of `WITHOUT`."""
    script = f"{BLOCKED}from stereocal.cli import main\n"
    script += "".join(f"if main({line.split()}): sys.exit(2)\n" for line in lines)
    return subprocess.run(
        [sys.executable, "-c", script], cwd=folder, capture_output=True, text=True, check=False
    )


def test_the_commands_of_the_core(tmp_path: Path) -> None:
    (tmp_path / "field").symlink_to(FIELD)
    rows = [line.split(",") for line in (FIELD / "correspondences.csv").read_text().split()[1:]]
    for name, at in (("primary", 2), ("secondary", 4)):
        points = [f"{row[0]},{row[at]},{row[at + 1]}" for row in rows]
        (tmp_path / f"{name}.csv").write_text("\n".join(["frame,u,v", *points]))
    done = run(
        tmp_path,
        "calibrate field --out out",
        "match primary.csv secondary.csv --parameters out/parameters_2d.json --out pairs.csv",
        "reconstruct pairs.csv --parameters out/parameters_3d.json --out points.csv",
        "check out/parameters_refined.json field --out checked",
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "points.csv").is_file() and (tmp_path / "checked/check.json").is_file()


@pytest.mark.parametrize(
    ("line", "needed"),
    [
        ("evaluate field --out out", "plotly"),
        ("plan plan.json --out out", "plotly"),
        ("print target --side 0.1 --out a.pdf", "reportlab"),
        ("calibrate field --out out --kit", "matplotlib"),
        ("serve", "streamlit"),
    ],
)
def test_a_command_of_the_extra_says_so(line: str, needed: str, tmp_path: Path) -> None:
    (tmp_path / "field").symlink_to(FIELD)
    done = run(tmp_path, line)
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert needed in done.stderr and "stereocal[dashboard]" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["field"]


def test_help_lists_all_commands(tmp_path: Path) -> None:
    shown = run(tmp_path, "--help").stdout
    assert "calibrate" in shown and "evaluate" in shown and "stereocal[dashboard]" in shown
