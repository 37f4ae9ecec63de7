"""A decoder that crashes, hangs or eats the memory leaves a sentence, and the next file is read."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from stereocal.system.guarded import Guard, Reader
from stereocal.system.tasks import StoppedError
from tests import deadly
from tests.refused import refused

SLOW = 60.0
"""Seconds that nothing takes unless it hangs, on a busy machine either."""


@pytest.fixture(scope="module")
def guard() -> Iterator[Guard]:
    made = Guard([deadly.say], least_seconds=SLOW)
    yield made
    made.close()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "a.bin"
    path.write_bytes(tmp_path.name.encode())  # no other test's content
    return path


@pytest.mark.parametrize(
    ("read", "said"),
    [
        (deadly.abort, "its decoder"),
        (deadly.divide, "its decoder"),
        (deadly.hang, "1 s"),
        (deadly.spin, "1 s"),
        (deadly.eat, "memory"),
    ],
)
def test_a_deadly_file_leaves_a_sentence_and_the_next_one_is_read(
    guard: Guard,
    file: Path,
    read: Reader,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    with monkeypatch.context() as patch, refused("left.png: ", said):
        if read in (deadly.hang, deadly.spin):
            patch.setattr(guard, "_least_seconds", 1.0)
        guard.read(read, file, "left.png")
    assert guard.read(deadly.say, file, "left.png") == 17
    assert capfd.readouterr() == ("", "")


def test_a_damaged_file_is_survived(guard: Guard, file: Path) -> None:
    with refused("damaged"):
        guard.read(deadly.refuse, file, "a")
    with refused("gone"):
        guard.read(deadly.say, file.with_name("none"), "gone")


def test_files_are_read_together_until_it_is_cancelled(guard: Guard, file: Path) -> None:
    """Then the children end too, which would be busy for a minute."""
    files, begun = [(file, "a"), (file.with_name("none"), "b")], time.monotonic()

    def cancel() -> None:
        raise StoppedError

    with refused("b "):
        guard.read_all(deadly.say, files)
    files[1] = file, "b"
    with pytest.raises(StoppedError):
        guard.read_all(deadly.hang, files, cancel)
    assert guard.read_all(deadly.say, files) == [17, 17]
    assert time.monotonic() - begun < SLOW / 2


SERVER = """
import sys
from pathlib import Path
from stereocal.system.guarded import Guard
from tests import deadly
read = getattr(deadly, sys.argv[2])
Guard([read], least_seconds=1).read(read, Path(sys.argv[1]), "a")
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
