"""The wheel is whole, and works where there is no checkout."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

import stereocal
from tests.wheel import ROOT, installed_in

BESIDE = ("pages", "assets", "sample_data")
MOST_BYTES = 13_000_000


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return installed_in(tmp_path_factory.mktemp("wheel"))


def run(environment: dict[str, str], *command: str) -> str:
    """What Python says, in a folder that is no checkout."""
    site = Path(environment["PYTHONPATH"])
    done = subprocess.run(
        [sys.executable, *command],
        cwd=site.parent,
        env=environment,
        check=False,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_it_has_every_file_of_the_program(environment: dict[str, str]) -> None:
    site = Path(environment["PYTHONPATH"])
    listed = subprocess.run(
        ["git", "ls-files", "stereocal", "app.py", ".streamlit", *BESIDE],
        cwd=ROOT,
        check=False,
        capture_output=True,
        text=True,
    )
    if listed.returncode:
        pytest.skip("not a clone")
    for name in listed.stdout.splitlines():
        at = site / name if name.startswith("stereocal/") else site / "stereocal/dashboard" / name
        assert at.is_file(), name


def test_it_is_small_and_has_the_documentation(environment: dict[str, str]) -> None:
    site = Path(environment["PYTHONPATH"])
    packed = sum(path.stat().st_size for path in site.parent.glob("*.whl"))
    assert 0 < packed < MOST_BYTES  # measured: 12.0 MB, of which 11.2 are photographs
    found = run(environment, "-c", "from stereocal.ui.help import *; print(len(topics()), DOCS)")
    number, folder = found.split()
    assert int(number) > 25
    assert Path(folder).is_relative_to(site)
    assert (Path(folder) / "pictures" / "guide" / "bar.svg").is_file()


def test_its_metadata_are_those_of_the_program(environment: dict[str, str]) -> None:
    (about,) = Path(environment["PYTHONPATH"]).glob("*.dist-info")
    metadata = (about / "METADATA").read_text(encoding="utf-8")
    assert f"\nVersion: {stereocal.__version__}\n" in metadata
    assert "stereocal = stereocal.__main__:main" in (about / "entry_points.txt").read_text()


def test_the_wheel_with_its_extra_needs_what_the_checkout_needs() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    needed = project["dependencies"] + project["optional-dependencies"]["dashboard"]
    assert sorted(needed) == sorted((ROOT / "requirements.txt").read_text().split())


def test_the_citation_is_of_this_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == stereocal.__version__
    assert citation["license"] in (ROOT / "LICENSE").read_text()
    assert len(citation["preferred-citation"]["authors"]) == 5


def test_commands_work_there(environment: dict[str, str]) -> None:
    assert run(environment, "-m", "stereocal", "--version").strip() == stereocal.__version__
    assert "--port" in run(environment, "-m", "stereocal", "serve", "--help")
