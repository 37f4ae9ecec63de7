"""Library and command line without what the extra `dashboard` brings."""

import subprocess
import sys
from pathlib import Path

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


def script(folder: Path, text: str) -> subprocess.CompletedProcess[str]:
    """Run a script with `main`, in a process that has none of `WITHOUT`."""
    whole = f"{BLOCKED}from stereocal.cli import main\n{text}"
    return subprocess.run(
        [sys.executable, "-c", whole], cwd=folder, capture_output=True, text=True, check=False
    )


def run(folder: Path, *lines: str) -> subprocess.CompletedProcess[str]:
    """Run each line as a command, in one process."""
    return script(folder, "".join(f"if main({line.split()}): sys.exit(2)\n" for line in lines))


def test_the_commands_of_the_core(tmp_path: Path) -> None:
    (tmp_path / "field").symlink_to(FIELD)
    rows = [line.split(",") for line in (FIELD / "correspondences.csv").read_text().split()[1:]]
    for name, at in (("primary", 2), ("secondary", 4)):
        points = [f"{row[0]},{row[at]},{row[at + 1]}" for row in rows]
        (tmp_path / f"{name}.csv").write_text("\n".join(["frame,u,v", *points]))
    done = run(
        tmp_path,
        "calibrate field --out out --runs 6",
        "match primary.csv secondary.csv --parameters out/parameters_2d.json --out pairs.csv",
        "reconstruct pairs.csv --parameters out/parameters_3d.json --out points.csv",
        "check out/parameters_refined.json field --out checked",
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "points.csv").is_file() and (tmp_path / "checked/check.json").is_file()


def test_the_library_of_the_core(tmp_path: Path) -> None:
    """All but figures; these say what they need."""
    (tmp_path / "field").symlink_to(FIELD)
    done = script(
        tmp_path,
        "import stereocal\nrun = stereocal.calibrate(stereocal.read('field'))\n"
        "print(run.evaluate(runs=2), run, sep='\\n')\n"
        "try:\n    run.plot()\nexcept stereocal.StereocalError as error:\n    print(error)\n",
    )
    assert done.returncode == 0, done.stderr
    assert "plotly" in done.stdout and "2 runs" in done.stdout


def test_commands_of_the_extra_say_so(tmp_path: Path) -> None:
    (tmp_path / "field").symlink_to(FIELD)
    needed = {
        "evaluate field --out out": "plotly",
        "plan plan.json --out out": "plotly",
        "print target --side 0.1 --out a.pdf": "reportlab",
        "calibrate field --out out --kit": "matplotlib",
        "serve": "streamlit",
    }
    calls = (f"print('=', main({line.split()}), file=sys.stderr)\n" for line in needed)
    done = script(tmp_path, "".join(calls))
    assert done.returncode == 0, done.stderr
    *told, rest = done.stderr.split("= 2\n")
    assert len(told) == len(needed) and not rest
    for one, package in zip(told, needed.values(), strict=True):
        assert package in one and "stereocal[dashboard]" in one
    assert [path.name for path in tmp_path.iterdir()] == ["field"]


def test_help_lists_all_commands(tmp_path: Path) -> None:
    shown = run(tmp_path, "--help").stdout
    assert "calibrate" in shown and "evaluate" in shown and "stereocal[dashboard]" in shown
