"""A decoder that crashes, hangs or eats the memory leaves a sentence, and the next file is read."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereocal.errors import StereocalError
from stereocal.formats.camera_file import write_camera, write_opencv_camera
from stereocal.system.guarded import Guard
from tests.known_rig import PRIMARY

SLOW = 60.0
"""Seconds that nothing takes unless it hangs, on a busy machine either."""


@pytest.fixture(scope="module")
def guard() -> Iterator[Guard]:
    made = Guard("tests.deadly", least_seconds=SLOW)
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
        ("exit", "makes its decoder fail"),
        ("raise", "makes its decoder fail"),
        ("hang", "takes too long to be decoded, more than 1 s"),
        ("spin", "takes too long to be decoded, more than 1 s"),
        ("eat", "needs too much memory"),
    ],
)
def test_a_deadly_file_leaves_a_sentence_and_the_next_one_is_read(
    guard: Guard, file: Path, kind: str, sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for _ in range(2):  # it is not remembered as sound
        with (
            monkeypatch.context() as patch,
            pytest.raises(StereocalError, match=f"^left.png: the file {sentence}.*save it anew"),
        ):
            if kind in ("hang", "spin"):
                patch.setattr(guard, "_least_seconds", 1.0)
            guard.check(kind, file, "left.png")
        guard.check("print", file, "left.png")
        guard.check("fine", file, "left.png")


def test_a_damaged_file_is_survived_and_a_sound_one_tried_once(guard: Guard, file: Path) -> None:
    guard.check("refuse", file, "a")
    for _ in range(3):
        guard.check("count", file, "a")
    other = file.with_name("b.bin")
    other.write_bytes(file.read_bytes())
    guard.check("count", other, "a")
    assert file.with_suffix(".count").read_text() == "x"
    assert not other.with_suffix(".count").exists()
    other.write_bytes(b"another content")
    guard.check("count", other, "a")
    assert other.with_suffix(".count").read_text() == "x"
    with pytest.raises(StereocalError, match="gone cannot be read"):
        guard.check("fine", file.with_name("none"), "gone")


def test_a_slow_file_does_not_hold_up_the_others(guard: Guard, file: Path) -> None:
    slow = threading.Thread(target=lambda: guard.refused("wait", {"a": file}))
    slow.start()
    wait_until(file.with_suffix(".begun").exists)
    for at in range(20):
        file.with_name(f"{at}").write_bytes(str(at).encode())
        guard.check("fine", file.with_name(f"{at}"), "a")
    assert slow.is_alive()
    file.with_suffix(".go_on").touch()
    slow.join(SLOW)
    assert not slow.is_alive()


def test_a_server_that_can_start_no_process_says_so(file: Path) -> None:
    with pytest.raises(StereocalError, match="cannot start the process that tries files"):
        Guard("tests.no_such_module").check("fine", file, "a")


def test_many_at_once(guard: Guard, tmp_path: Path) -> None:
    files = {}
    for at in range(6):
        files[f"{at}.png"] = tmp_path / f"{at}"
        files[f"{at}.png"].write_bytes(bytes([at]))
    assert guard.refused("fine", files) == {}
    refused = guard.refused("abort", files)
    assert list(refused) == list(files)
    assert "5.png: the file makes its decoder fail" in str(refused["5.png"])


SERVER = """
import sys, threading
from pathlib import Path
from stereocal.system.guarded import Guard
guard = Guard("tests.deadly", least_seconds=60)
guard.check("fine", Path(sys.argv[1]), "a")
child = guard._free.get()
print(child._process.pid, flush=True)
guard._free.put(child)
guard.check(sys.argv[2], Path(sys.argv[1]), "a")
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="this system kills otherwise")
@pytest.mark.parametrize("kind", ["hang", "spin"])
def test_the_child_ends_with_a_server_that_is_killed(file: Path, kind: str) -> None:
    server = subprocess.Popen(
        [sys.executable, "-c", SERVER, str(file), kind],
        stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2],
    )  # fmt: skip
    assert server.stdout is not None
    child = int(server.stdout.readline())
    wait_until(file.with_suffix(".begun").exists)
    os.kill(child, 0)
    server.send_signal(signal.SIGKILL)
    server.wait()
    server.stdout.close()
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
    guard = Guard(children=1)
    files = {}
    for name, content in contents.items():
        files[name] = tmp_path / name
        files[name].write_bytes(content)
    assert guard.refused("photograph", files) == {}
    for content in (write_camera(PRIMARY), write_opencv_camera(PRIMARY), b"%YAML:1.0\n--- ["):
        guard.check_content("camera", content, "camera.yml")
    guard.check_content("dataset", b"PK\x05\x06", "a.zip")
    guard.check_content("table", b"PAR1 is none", "a.parquet", ".parquet")
    guard.close()


def test_a_large_photograph_after_a_small_one(tmp_path: Path) -> None:
    done, content = cv2.imencode(".png", np.zeros((50, 60), np.uint8))
    assert done
    small, large = tmp_path / "small.png", tmp_path / "large.png"
    small.write_bytes(content.tobytes())
    large.write_bytes(content.tobytes())
    os.truncate(large, 390_000_000)  # below the largest upload; holes, not data
    guard = Guard(children=1)
    try:
        guard.check("photograph", small, "small.png")
        guard.check("photograph", large, "large.png")
    finally:
        guard.close()
