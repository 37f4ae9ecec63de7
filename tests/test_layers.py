"""Who may import what: the science knows no screen, and the pages compute nothing."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SCIENCE = sorted(
    path
    for path in (ROOT / "stereocal").rglob("*.py")
    if "ui" not in path.relative_to(ROOT / "stereocal").parts
)
PAGES = sorted((ROOT / "pages").glob("*.py"))
NUMERICS = ("numpy", "scipy", "cv2", "numba")
MOST_LINES = 80


def imported(source: str, module: str = "") -> set[str]:
    """Full names of all that a source imports, wherever in it, by name or by `importlib`.

    Args:
        module: the source's own name, for relative imports.
    """
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            parents = module.split(".")[: -node.level] if node.level else []
            base = ".".join([*parents, *([node.module] if node.module else [])])
            found |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else None
            name = node.func.id if isinstance(node.func, ast.Name) else name
            first = node.args[0] if node.args else None
            if name in ("import_module", "__import__") and isinstance(first, ast.Constant):
                found.add(str(first.value))
    return found


def forbidden(source: str, banned: tuple[str, ...], module: str = "") -> set[str]:
    """What a source imports of the banned packages."""
    return {
        name
        for name in imported(source, module)
        if any(name == ban or name.startswith(ban + ".") for ban in banned)
    }


@pytest.mark.parametrize("path", SCIENCE, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_science_knows_no_screen(path: Path) -> None:
    module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    assert not forbidden(path.read_text(encoding="utf-8"), ("streamlit", "stereocal.ui"), module)


def test_the_science_was_found() -> None:
    names = {path.name for path in SCIENCE}
    assert {"geometry.py", "costs.py", "camera_file.py"} <= names
    assert not any("ui" in path.parts[len(ROOT.parts) :] for path in SCIENCE)


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_pages_are_short_and_compute_nothing(path: Path) -> None:
    source = path.read_text(encoding="utf-8")
    assert len(source.splitlines()) <= MOST_LINES
    assert not forbidden(source, NUMERICS)


def test_pages_were_found() -> None:
    assert len(PAGES) >= 3


@pytest.mark.parametrize(
    "source",
    [
        "import streamlit",
        "import streamlit as st",
        "import numpy, streamlit.components.v1",
        "from streamlit import session_state",
        "def f():\n    from streamlit.testing.v1 import AppTest",
        "try:\n    import streamlit\nexcept ImportError:\n    pass",
        "import importlib\nimportlib.import_module('streamlit')",
        "__import__('streamlit')",
        "from stereocal import ui",
        "from stereocal.ui.forms import x",
        "from . import ui",
        "from .ui import forms",
    ],
)
def test_the_guard_bites(source: str) -> None:
    assert forbidden(source, ("streamlit", "stereocal.ui"), "stereocal.x")


def test_the_guard_lets_others_pass() -> None:
    source = "import streamlit_tools\nfrom stereocal import geometry\nx = 'import streamlit'"
    assert not forbidden(source, ("streamlit", "stereocal.ui"), "stereocal.x")


@pytest.mark.parametrize(
    ("name", "caught"), [("stereocal/x.py", True), ("pages/x.py", False), ("app.py", False)]
)
def test_the_linter_bites_too(name: str, caught: bool) -> None:
    run = subprocess.run(
        [sys.executable, "-m", "ruff", "check", "--no-cache", "--stdin-filename", name, "-"],
        input="import streamlit\n\nstreamlit.write()\n",
        text=True,
        capture_output=True,
        cwd=ROOT,
        check=False,
    )
    assert ("TID251" in run.stdout) == caught
    assert (run.returncode != 0) == caught
