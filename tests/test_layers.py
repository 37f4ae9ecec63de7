"""Imports of the package run one way, the science imports no Streamlit, the pages compute nothing.

The contracts stand in pyproject.toml and pages/ruff.toml: seen here to hold and to fail.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LINTER = Path(sys.executable).with_name("lint-imports")


def broken(folder: Path) -> str:
    """What import-linter says of the package in a folder; empty if all contracts are kept."""
    run = subprocess.run(
        [LINTER, "--no-cache", "--no-logo", "--config", ROOT / "pyproject.toml"],
        capture_output=True,
        text=True,
        cwd=folder,
        env={"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"},
        check=False,
    )
    assert "Contracts: " in run.stdout, run.stdout + run.stderr
    return run.stdout if run.returncode else ""


def test_imports_run_one_way() -> None:
    assert not broken(ROOT)


@pytest.mark.parametrize(
    ("contract", "source"),
    [
        ("one way", "from stereocal.verdict import tradeoff"),
        ("one way", "from stereocal import calibrate"),
        ("one way", "from ..verdict import tradeoff"),
        ("one way", "def f():\n    from stereocal.verdict.tradeoff import pareto"),
        ("screen", "import streamlit as st"),
        ("screen", "def f():\n    from streamlit.testing.v1 import AppTest"),
    ],
)
def test_the_contracts_fail(contract: str, source: str, tmp_path: Path) -> None:
    shutil.copytree(
        ROOT / "stereocal", tmp_path / "stereocal", ignore=shutil.ignore_patterns("__pycache__")
    )
    (tmp_path / "stereocal" / "evaluation" / "new.py").write_text(f"{source}\n")
    found = broken(tmp_path)
    kept = {"one way": "Imports run one way KEPT", "screen": "The science knows no screen KEPT"}
    assert found and kept[contract] not in found


def test_a_new_folder_needs_a_place(tmp_path: Path) -> None:
    shutil.copytree(
        ROOT / "stereocal", tmp_path / "stereocal", ignore=shutil.ignore_patterns("__pycache__")
    )
    (tmp_path / "stereocal" / "new.py").write_text("")
    assert "Imports run one way BROKEN" in broken(tmp_path)


@pytest.mark.parametrize(
    ("name", "module", "caught"),
    [
        ("stereocal/x.py", "streamlit", True),
        ("pages/x.py", "streamlit", False),
        ("app.py", "streamlit", False),
        ("stereocal/x.py", "numpy", False),
        *(("pages/x.py", module, True) for module in ("numpy", "scipy", "cv2", "numba")),
    ],
)
def test_the_linter_knows_pages_from_science(name: str, module: str, caught: bool) -> None:
    run = subprocess.run(
        [sys.executable, "-m", "ruff", "check", "--no-cache", "--stdin-filename", name, "-"],
        input=f"import {module}\n\n{module}.write()\n",
        text=True,
        capture_output=True,
        cwd=ROOT,
        check=False,
    )
    assert ("TID251" in run.stdout) == caught
    assert (run.returncode != 0) == caught
