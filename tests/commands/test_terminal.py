"""Commands at a terminal: Ctrl-C, a closed pipe, and signs that the terminal does not know."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from stereocal.__main__ import CLOSED_PIPE, INTERRUPTED
from stereocal.commands.console import in_stages, say
from tests.further import further
from tests.terminal import FIELD, LONGEST_S, ROOT, command, sentences, started, tables

PHOTOGRAPHS = ROOT / "sample_data" / "photographs"
BOARDS = f"{PHOTOGRAPHS / 'boards_primary'} --board 18x12 --square 0.03"
INTERRUPTED_COMMANDS: dict[str, tuple[str, str]] = {
    # The command, and what it says when it has begun; compiling, nothing is compiled yet.
    "calibrate": (f"calibrate {FIELD} --out OUT", "Compiling"),
    "evaluate": (f"evaluate {FIELD} --out OUT", "Compiling"),
    "in processes": (f"evaluate {FIELD} --out OUT --workers 2 --runs 100000", "100000 runs"),
    "detect": (f"detect {PHOTOGRAPHS} --out OUT/table.csv", "Compiling"),
    "intrinsics": (f"intrinsics {BOARDS} --out OUT/c.json --repeats 10000", "photographs searched"),
    "match": (
        "match IN/primary.csv IN/secondary.csv --parameters IN/parameters_2d.json --threshold 1 "
        "--out OUT/pairs.csv --unmatched OUT/unmatched.csv",
        "Compiling",
    ),
    "reconstruct": (
        "reconstruct IN/pairs.csv --parameters IN/parameters_2d.json --out OUT/points.csv",
        "Compiling",
    ),
    "compile": ("compile", "functions compiled"),
}
FEW = ("calibrate", "match")
"""One that computes, one with processes of its own, one with half a file; the rest in the soak."""


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with parameters and tables of points."""
    folder = tmp_path_factory.mktemp("given")
    tables(folder)
    return folder


def said_until(process: subprocess.Popen[bytes], words: str) -> str:
    """Wait until the command has said this on stderr."""
    assert process.stderr is not None
    said = b""
    while words.encode() not in said:
        more = os.read(process.stderr.fileno(), 1000)
        assert more, f"it ended with {process.wait()} and said {said.decode()}"
        said += more
    return said.decode()


def interrupted(process: subprocess.Popen[bytes]) -> str:
    """Ctrl-C, as a terminal sends it, to all processes of the command; what they say then."""
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=LONGEST_S)
    return said.decode()


def files_below(*folders: Path) -> list[Path]:
    return [path for folder in folders for path in folder.rglob("*") if path.is_file()]


@pytest.mark.parametrize(
    "name",
    [
        name if name in FEW else pytest.param(name, marks=pytest.mark.soak)
        for name in INTERRUPTED_COMMANDS
    ],
)
def test_ctrl_c_is_one_line_and_leaves_nothing(name: str, given: Path, tmp_path: Path) -> None:
    arguments, words = INTERRUPTED_COMMANDS[name]
    cold = "compil" in words.lower()
    out, temporary, cache = (tmp_path / folder for folder in ("out", "temporary", "cache"))
    temporary.mkdir()
    own = [word.replace("OUT", f"{out}").replace("IN/", f"{given}/") for word in arguments.split()]
    environment = {"TMPDIR": f"{temporary}", **({"NUMBA_CACHE_DIR": f"{cache}"} if cold else {})}
    with started(*own, **environment) as process:
        said = said_until(process, words) + interrupted(process)
    assert process.returncode == INTERRUPTED, said
    after = said.split(words)[-1].splitlines()[1:]
    assert [line for line in after if line and "[" not in line] == ["stereocal: interrupted."], said
    assert files_below(out, temporary) == []
    # Processes that were ended may take a moment.
    for _ in range(int(LONGEST_S / 0.05)):
        try:
            os.killpg(process.pid, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    pytest.fail("A process of the command stays.")


def test_a_stage_is_one_line_of_a_log(capsys: pytest.CaptureFixture[str]) -> None:
    """Where stderr is no terminal: no bar that is drawn again and again."""

    def work(begin: Callable[[str], None], show: Callable[[int, int], None]) -> None:
        for stage in ("photographs searched", "runs", "draws"):
            begin(stage)
            for done in range(1, 1001):
                show(done, 1000)
                if (stage, done) == ("runs", 500):
                    say("A message.")
                if (stage, done) == ("draws", 500):
                    return

    in_stages(work)
    assert re.sub(r"\d+ s", "S", capsys.readouterr().err).splitlines(keepends=True) == [
        "1000 photographs searched: done in S\n",
        "1000 runs: \n",
        "A message.\n",
        "1000 draws: \n",
    ]


def read_by_nobody(words: list[str], both: bool = True) -> "subprocess.CompletedProcess[bytes]":
    """A process with its output in a pipe that nobody reads, and its messages too or kept."""
    reader, writer = os.pipe()
    os.close(reader)
    errors, env = writer if both else subprocess.PIPE, {**os.environ, "PYTHONUNBUFFERED": ""}
    how: dict[str, Any] = {"cwd": ROOT, "env": env, "check": False, "timeout": LONGEST_S}
    ended = subprocess.run(words, stdout=writer, stderr=errors, **how)
    os.close(writer)
    assert ended.returncode == CLOSED_PIPE, ended.stderr
    return ended


def test_a_pipe_that_nobody_reads_after_a_line_to_each_stream() -> None:
    """Python ended with its own status, 120, where stderr kept a line that could not be written."""
    run = "main._run = lambda: print('found') or say('told') or 0"
    code = (
        "import sys; from stereocal import __main__ as main; "
        f"from stereocal.commands.console import say; {run}; sys.exit(main.main())"
    )
    read_by_nobody([sys.executable, "-c", code])


@pytest.mark.parametrize("both", [True, False])
@pytest.mark.parametrize("arguments", ["--help", *further("calibrate")])
def test_a_pipe_that_nobody_reads(arguments: str, both: bool, tmp_path: Path) -> None:
    words = ["--help"]
    if arguments == "calibrate":
        words = ["calibrate", f"{FIELD}", "--out", f"{tmp_path}", "--runs", "0"]
    ended = read_by_nobody(command(*words), both)
    assert sentences((ended.stderr or b"").decode()) == []
    names = ["parameters_2d.json", "parameters_3d.json", "parameters_refined.json"]
    assert sorted(path.name for path in files_below(tmp_path)) == names * (words != ["--help"])
