"""Every file of a full project damaged in five ways, and every page opened after each.

python -m benchmarks.damage
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import pytest

from stereocal.ui.frame import TITLES
from tests.pages.conftest import run_by_the_app
from tests.pages.damage import DAMAGES, files_of_full, look_after


def main() -> None:
    """Damage, look, and say what each page said in red."""
    opened = silent = 0
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        run_by_the_app(patch)
        files = files_of_full(Path(folder) / "list")
        for file in files:
            for damage in DAMAGES:
                with tempfile.TemporaryDirectory() as home:
                    os.environ["STEREOCAL_HOME"] = home
                    said = look_after(Path(home), file, damage, list(TITLES))
                opened += len(said)
                red = {page: words for page, (words, _) in said.items() if words}
                silent += not red
                print(f"{file}, {damage}: {red}", flush=True)
    print(
        f"{len(files)} files, {len(DAMAGES)} damages, {opened} pages opened; said nothing: {silent}"
    )


if __name__ == "__main__":
    main()
