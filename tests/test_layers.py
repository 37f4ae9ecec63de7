"""Who may import what: imports of the package run one way, and the pages compute nothing."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "stereocal"
ORDER = (
    "errors",
    "system",
    "rig",
    "calibration",
    "refined",
    "evaluation",
    "simulation",
    "verdict",
    "detection",
    "frames",
    "intrinsics",
    "matching",
    "field",
    "formats",
    "figures",
    "workflow",
    "paper_kit",
    "projects",
    "commands",
    "cli",
    "ui",
)
"""Each room imports from itself and from those before it, never from one after it."""
MODULES = sorted(
    path for path in PACKAGE.rglob("*.py") if path.parent != PACKAGE or path.stem in ORDER
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


def upward(source: str, module: str) -> set[str]:
    """What a module imports of rooms after its own; the package's version is free."""
    _, room, *_ = module.split(".")
    found = set()
    for name in imported(source, module):
        package, _, rest = name.partition(".")
        if package != "stereocal" or rest in ("", "__version__"):
            continue
        other = rest.split(".")[0]
        if other not in ORDER or ORDER.index(other) > ORDER.index(room):
            found.add(name)
    return found


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_run_one_way(path: Path) -> None:
    module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    source = path.read_text(encoding="utf-8")
    assert not upward(source, module)
    if module.split(".")[1] != "ui":
        assert not forbidden(source, ("streamlit",), module)


def test_every_room_has_its_place() -> None:
    """Beside the rooms stand only the package's own face and the command line's."""
    rooms = {
        path.stem
        for path in PACKAGE.iterdir()
        if path.suffix == ".py" or (path / "__init__.py").is_file()
    }
    assert rooms == {*ORDER, "__init__", "__main__"}
    assert len(MODULES) > 100


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


@pytest.mark.parametrize(
    "source",
    [
        "from stereocal.verdict import tradeoff",
        "import stereocal.ui.forms",
        "from stereocal import workflow",
        "from stereocal import calibrate",
        "from ..verdict import tradeoff",
        "def f():\n    from stereocal.verdict.tradeoff import pareto",
        "import importlib\nimportlib.import_module('stereocal.figures')",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from stereocal.workflow import x",
    ],
)
def test_an_import_upward_is_seen(source: str) -> None:
    assert upward(source, "stereocal.evaluation.summary")


def test_imports_downward_pass() -> None:
    source = "from stereocal import __version__\nfrom stereocal.rig import camera\nimport numpy"
    assert not upward(source, "stereocal.evaluation.summary")


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
