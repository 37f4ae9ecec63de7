"""What the container's health check asks of a real server."""

from __future__ import annotations

import os
import re
import shutil
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.terminal import ROOT

DOCKERFILE = (ROOT / "Dockerfile").read_text()


@contextmanager
def server(folder: Path, home: Path) -> Iterator[str]:
    """A server of the program in `folder`, with the container's settings; its address."""
    (setting,) = re.findall(r"STREAMLIT_SERVER_SCRIPT_HEALTH_CHECK_ENABLED=(\w+)", DOCKERFILE)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "streamlit",
            "run",
            "app.py",
            "--server.headless",
            "true",
            "--server.port",
            str(port),
        ],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={
            **os.environ,
            "STEREOCAL_HOME": str(home),
            "STREAMLIT_SERVER_SCRIPT_HEALTH_CHECK_ENABLED": setting,
        },
    )
    try:
        while status(f"http://127.0.0.1:{port}/_stcore/health") != 200:
            assert process.poll() is None, "the server has ended"
            time.sleep(0.1)
        yield f"http://127.0.0.1:{port}"
    finally:
        process.kill()
        process.wait()


def status(url: str) -> int | None:
    """Of the answer; None where nobody answers yet."""
    try:
        with urllib.request.urlopen(url, timeout=300) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        return error.code
    except OSError:
        return None


def copy_of_the_program(folder: Path) -> Path:
    for name in ("stereocal", "pages", "assets", ".streamlit"):
        shutil.copytree(ROOT / name, folder / name)
    shutil.copy(ROOT / "app.py", folder)
    return folder


@pytest.mark.parametrize(("broken", "expected"), [(None, 200), ("stereocal/ui/navigation.py", 503)])
def test_the_health_check_sees_what_cannot_be_imported(
    broken: str | None, expected: int, tmp_path: Path
) -> None:
    program = copy_of_the_program(tmp_path / "program")
    if broken is not None:
        (program / broken).write_text("import nothing_of_that_name\n")
    (asked,) = re.findall(r"http://127\.0\.0\.1:8501(/\S+)', timeout=", DOCKERFILE)
    with server(program, tmp_path / "home") as url:
        assert status(url + asked) == expected
        assert status(url + "/_stcore/health") == 200
