"""A decoder that crashes, hangs or eats the memory leaves a sentence, and the next file is read."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereocal.errors import StereocalError
from stereocal.system.guarded import Guard
from stereocal.ui.decoding import READERS, server_guard
from tests import deadly

SLOW = 60.0
"""Seconds that nothing takes unless it hangs, on a busy machine either."""


@pytest.fixture(scope="module")
def guard() -> Iterator[Guard]:
    made = Guard(deadly.READERS, least_seconds=SLOW)
    yield made
    made.close()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "a.bin"
    path.write_bytes(tmp_path.name.encode())  # no other test's content
    return path


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        ("abort", "makes its decoder fail"),
        ("raise", "makes its decoder fail"),
        ("hang", "takes too long to be decoded, more than 1 s"),
        ("spin", "takes too long to be decoded, more than 1 s"),
        ("eat", "needs too much memory"),
    ],
)
def test_a_deadly_file_leaves_a_sentence_and_the_next_one_is_read(
    guard: Guard, file: Path, kind: str, sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        monkeypatch.context() as patch,
        pytest.raises(StereocalError, match=f"^left.png: the file {sentence}.*save it again"),
    ):
        if kind in ("hang", "spin"):
            patch.setattr(guard, "_least_seconds", 1.0)
        guard.check(kind, file, "left.png")
    guard.check("fine", file, "left.png")


def test_a_damaged_file_is_survived(
    guard: Guard, file: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    guard.check("refuse", file, "a")
    guard.check("print", file, "a")
    assert capfd.readouterr() == ("", "")
    with pytest.raises(StereocalError, match="gone cannot be read"):
        guard.check("fine", file.with_name("none"), "gone")


SERVER = """
import sys
from pathlib import Path
from stereocal.system.guarded import Guard
from tests import deadly
Guard(deadly.READERS, least_seconds=1).check(sys.argv[2], Path(sys.argv[1]), "a")
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="this system kills otherwise")
@pytest.mark.soak
@pytest.mark.parametrize("kind", ["hang", "spin"])
def test_the_child_ends_with_a_server_that_is_killed(file: Path, kind: str) -> None:
    server = subprocess.Popen(
        [sys.executable, "-c", SERVER, str(file), kind], cwd=Path(__file__).parents[2]
    )
    begun = file.with_suffix(".begun")
    wait_until(lambda: begun.exists() and begun.read_text() != "")
    child = int(begun.read_text())
    os.kill(child, 0)
    server.send_signal(signal.SIGKILL)
    server.wait()
    wait_until(lambda: not _runs(child))


def wait_until(done: Callable[[], bool]) -> None:
    end = time.monotonic() + SLOW / 2  # a child ends itself some seconds after its time is over
    while not done():
        assert time.monotonic() < end
        time.sleep(0.01)


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
        stat = Path(f"/proc/{process}/stat")
        # Nobody waits for it where the tests run as the first process.
        return not (stat.exists() and stat.read_text().split()[2] == "Z")
    except (ProcessLookupError, FileNotFoundError):
        return False


def test_the_real_readers_in_the_child(tmp_path: Path) -> None:
    """Sound files and damaged ones are survived; the room suffices for the largest kinds."""
    rng = np.random.default_rng(1)
    grey = rng.integers(0, 255, (900, 1400)).astype(np.uint8)
    deep = rng.integers(0, 65535, (900, 1400, 4)).astype(np.uint16)
    contents = {
        "a.png": cv2.imencode(".png", grey)[1].tobytes(),
        "b.png": cv2.imencode(".png", deep)[1].tobytes(),
        "c.tif": cv2.imencode(".tif", deep[:, :, :3])[1].tobytes(),
        "d.jpg": cv2.imencode(".jpg", grey)[1].tobytes(),
        "e.bmp": cv2.imencode(".bmp", grey)[1].tobytes(),
    }
    contents |= {f"cut_{name}": content[:-2000] for name, content in contents.items()}
    guard = Guard(READERS, children=1)
    files = {}
    for name, content in contents.items():
        files[name] = tmp_path / name
        files[name].write_bytes(content)
    try:
        assert guard.refused("photograph", files) == {}
        guard.check_content("table", b"PAR1 is none", "a.parquet", ".parquet")
    finally:
        guard.close()


def test_files_are_tried_on_a_shared_server_only(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = Guard(deadly.READERS, children=0)
    own.check("abort", file, "a")
    own.check_content("abort", b"a", "a")
    assert own.refused("abort", {"a": file}) == {}
    for shared, children in (("", 0), ("1", 2)):
        monkeypatch.setenv("STEREOCAL_SHARED", shared)
        assert server_guard()._children == children
        assert server_guard() is server_guard()
