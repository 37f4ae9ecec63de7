"""Files appear complete or not at all, whenever Ctrl-C comes."""

import sys
from itertools import count
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from stereocal.system import atomic_files
from stereocal.system.atomic_files import write_all, write_in_parts


def write_two(folder: Path) -> None:
    write_all({folder / "a.json": b"{}", folder / "b.json": b"[]"})


def write_parts(folder: Path) -> None:
    with write_in_parts(folder / "a.json") as part:
        part.write_bytes(b"{}")


@pytest.mark.filterwarnings(
    "ignore::pytest.PytestUnraisableExceptionWarning"
)  # left to the collector
@pytest.mark.parametrize("write", [write_two, write_parts])
def test_ctrl_c_at_any_line(tmp_path: Path, write: Any) -> None:
    for line in count():
        folder = tmp_path / str(line)
        folder.mkdir()
        if not interrupted_at(line, lambda folder=folder: write(folder)):
            break
        names = {path.name for path in folder.iterdir()}
        assert names <= {"a.json", "b.json"}, (line, names)
    assert line > 10


def interrupted_at(line: int, run: Any) -> bool:
    """Raise KeyboardInterrupt before the module's `line`-th line; False if it runs fewer."""
    lines = iter(range(line))

    def trace(frame: FrameType, event: str, _argument: Any) -> Any:
        if frame.f_code.co_filename != atomic_files.__file__:
            return None
        if event == "line" and next(lines, None) is None:
            sys.settrace(None)
            raise KeyboardInterrupt
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        run()
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(before)
    return False
