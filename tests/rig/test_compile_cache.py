"""Where compiled code is kept: beside the sources, or where it can be written to."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.terminal import LONGEST_S, ROOT

if os.name == "nt":
    pytest.skip("folders have no mode there", allow_module_level=True)

WITHOUT_RIGHTS = ["setpriv", "--bounding-set=-dac_override,-dac_read_search"]
"""Root writes into any folder; this way it is held to their modes, as any user is."""
AS_A_USER = WITHOUT_RIGHTS if os.geteuid() == 0 else []
if AS_A_USER and shutil.which(AS_A_USER[0]) is None:
    pytest.skip("root writes into any folder", allow_module_level=True)

CACHE = "import stereocal, os; print(os.environ.get('NUMBA_CACHE_DIR', 'beside'))"


@pytest.fixture
def installed(tmp_path: Path) -> Iterator[Path]:
    """A copy of the program that cannot be written to."""
    folder = tmp_path / "installed"
    shutil.copytree(
        ROOT / "stereocal", folder / "stereocal", ignore=shutil.ignore_patterns("__pycache__")
    )
    for below in [folder, *folder.rglob("*")]:
        below.chmod(0o555 if below.is_dir() else 0o444)
    yield folder
    for below in [folder, *folder.rglob("*")]:
        below.chmod(0o755)


def folder(made: Path, mode: int = 0o755) -> Path:
    made.mkdir()
    made.chmod(mode)
    return made


@pytest.mark.parametrize("trap", ["others can write", "a link"])
def test_a_folder_that_others_prepared_is_not_used(
    trap: str, installed: Path, tmp_path: Path
) -> None:
    """What is read from there is run: anybody can make a folder of that name before."""
    home, temporary = folder(tmp_path / "home", 0o555), folder(tmp_path / "temporary")
    prepared = temporary / f"stereocal-compiled-{os.getuid()}"
    if trap == "a link":
        prepared.symlink_to(folder(tmp_path / "theirs", 0o700))
    else:
        folder(prepared, 0o777)
    unset = ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "PYTHONPATH")
    usual = {name: value for name, value in os.environ.items() if name not in unset}
    run = subprocess.run(
        [*AS_A_USER, sys.executable, "-c", CACHE],
        cwd=installed,
        env={**usual, "HOME": str(home), "TMPDIR": str(temporary)},
        capture_output=True,
        text=True,
        check=False,
        timeout=LONGEST_S,
    )
    found = Path(run.stdout.strip())
    assert found != prepared
    assert found.parent == temporary
    assert found.stat().st_mode & 0o777 == 0o700
