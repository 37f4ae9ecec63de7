"""Library and command line without what the extra `dashboard` brings."""

import re
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.terminal import FIELD, ROOT

WITHOUT = ("streamlit", "plotly", "pebble", "reportlab", "sqlite3")
BLOCKED = f"""
import sys
class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {WITHOUT}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Blocked())
sys.path.insert(0, {str(ROOT)!r})
"""


COMMANDS = (
    "calibrate field --out out --runs 2 --kit",
    "match primary.csv secondary.csv --parameters out/parameters_2d.json --out pairs.csv",
    "reconstruct pairs.csv --parameters out/parameters_3d.json --out points.csv",
    "check out/parameters_refined.json field --out checked",
)
NEEDED = {
    "evaluate field --out out": "plotly",
    "plan plan.json --out out": "plotly",
    "print target --side 0.1 --out a.pdf": "reportlab",
    "serve": "streamlit",
}
LIBRARY = """
print("of the library")
import stereocal
run = stereocal.calibrate(stereocal.read("field"))
print(run.evaluate(runs=2), run, sep="\\n")
try:
    run.plot()
except stereocal.StereocalError as error:
    print(error)
"""


def script(folder: Path, text: str) -> subprocess.CompletedProcess[str]:
    """Run a script with `main`, in a process that has none of `WITHOUT`."""
    whole = f"{BLOCKED}from stereocal.cli import main\n{text}"
    return subprocess.run(
        [sys.executable, "-c", whole], cwd=folder, capture_output=True, text=True, check=False
    )


def as_script(commands: Iterable[str]) -> str:
    """Run each as a command, and say with which exit status it ended."""
    return "".join(f"print('ended', main({line.split()}), file=sys.stderr)\n" for line in commands)


@dataclass(frozen=True)
class Core:
    """What all of it did, in one process."""

    commands: Path
    extra: Path
    """The folders in which commands were run."""
    told: list[str]
    """By each command, with its exit status."""
    of_library: str


@pytest.fixture(scope="module")
def core(tmp_path_factory: pytest.TempPathFactory) -> Core:
    commands, extra = (tmp_path_factory.mktemp(name) for name in ("core", "extra"))
    for folder in (commands, extra):
        (folder / "field").symlink_to(FIELD)
    rows = [line.split(",") for line in (FIELD / "correspondences.csv").read_text().split()[1:]]
    for name, at in (("primary", 2), ("secondary", 4)):
        points = [f"{row[0]},{row[at]},{row[at + 1]}" for row in rows]
        (commands / f"{name}.csv").write_text("\n".join(["frame,u,v", *points]))
    elsewhere = f"import os\nos.chdir({str(extra)!r})\n"
    done = script(commands, as_script(COMMANDS) + LIBRARY + elsewhere + as_script(NEEDED))
    assert done.returncode == 0, done.stderr
    told = re.findall(r"(?s).*?ended \d+\n", done.stderr)
    assert "".join(told) == done.stderr
    return Core(commands, extra, told, done.stdout.partition("of the library\n")[2])


def test_the_commands_of_the_core(core: Core) -> None:
    told = core.told[: len(COMMANDS)]
    assert all(one.endswith("ended 0\n") for one in told), told
    assert (core.commands / "points.csv").is_file()
    assert (core.commands / "checked/check.json").is_file()


def test_the_library_of_the_core(core: Core) -> None:
    """All but figures; these say what they need."""
    assert "plotly" in core.of_library and "2 runs" in core.of_library


def test_commands_of_the_extra_say_so(core: Core) -> None:
    told = core.told[len(COMMANDS) :]
    for one, package in zip(told, NEEDED.values(), strict=True):
        assert one.endswith("ended 2\n")
        assert package in one and "stereocal[dashboard]" in one
    assert [path.name for path in core.extra.iterdir()] == ["field"]


def test_help_lists_all_commands(tmp_path: Path) -> None:
    shown = script(tmp_path, "main(['--help'])").stdout
    assert "calibrate" in shown and "evaluate" in shown and "stereocal[dashboard]" in shown
