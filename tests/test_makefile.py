"""The steps of `make run`, with commands in place of Python and Streamlit that only note them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.terminal import ROOT

if shutil.which("make") is None:
    pytest.skip("no make on this computer", allow_module_level=True)

NOTED = """#!/bin/sh
echo "$(basename $0) $*" >> "$NOTES"
case "$*" in
  -c*) exec {python} "$@" ;;
  *venv*) mkdir -p .venv/bin && cp "$0" .venv/bin/python && cp "$0" .venv/bin/streamlit ;;
esac
"""


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """The Makefile and a source, and a Python that notes what it is called with."""
    for name in ("Makefile", "requirements.txt", "stereocal/cli.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    (tmp_path / "python").write_text(NOTED.format(python=sys.executable))
    (tmp_path / "python").chmod(0o755)
    return tmp_path


def steps(clone: Path) -> tuple[list[str], str]:
    """What `make run` calls, a line each, and what it says."""
    notes = clone / "notes"
    notes.write_text("")
    run = subprocess.run(
        ["make", "run", f"PYTHON={clone / 'python'}"],
        cwd=clone,
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "NOTES": str(notes)},
    )
    return [line for line in notes.read_text().splitlines() if " -c " not in line], run.stdout


def test_it_installs_in_view_then_compiles_then_serves(clone: Path) -> None:
    found, said = steps(clone)
    venv, pip, compiled, served = found
    assert venv.endswith("-m venv .venv")
    assert "pip install" in pip and "requirements.txt" in pip
    assert "--quiet" not in pip and "-q" not in pip.split()
    assert compiled == "python -m stereocal compile"
    assert served == "streamlit run app.py"
    assert "MB" in said.split("-m venv")[0]  # before it begins


def test_what_is_done_is_not_done_again_until_the_sources_change(clone: Path) -> None:
    steps(clone)
    assert steps(clone)[0] == ["streamlit run app.py"]
    later = (clone / ".venv/.compiled").stat().st_mtime + 10
    os.utime(clone / "stereocal/cli.py", (later, later))
    assert steps(clone)[0] == ["python -m stereocal compile", "streamlit run app.py"]
