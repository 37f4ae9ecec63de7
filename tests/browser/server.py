"""The real server for the benchmarks: started on a free port, watched, stopped or killed."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from pathlib import Path

ROOT = Path(__file__).parents[1]
START_S = 60.0


class Server:
    """`streamlit run app.py` with its projects below `home`; ready when this returns.

    Args:
        environment: further variables, such as STEREOCAL_SHARED.
        log: where its output goes.
    """

    def __init__(
        self, home: Path, environment: dict[str, str] | None = None, log: Path | None = None
    ) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self.url = f"http://127.0.0.1:{port}"
        output = subprocess.DEVNULL if log is None else log.open("ab")
        self._process = subprocess.Popen(
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
            cwd=ROOT,
            env={**os.environ, "STEREOCAL_HOME": str(home), **(environment or {})},
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        end = time.monotonic() + START_S
        while True:
            try:
                with urllib.request.urlopen(f"{self.url}/_stcore/health", timeout=5):
                    return
            except OSError:
                if time.monotonic() > end or self._process.poll() is not None:
                    self.kill()
                    raise
                time.sleep(0.02)

    @property
    def processes(self) -> list[int]:
        """The server and everything it has started."""
        group, found = self._process.pid, []
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit():
                try:
                    fields = (entry / "stat").read_text().rpartition(")")[2].split()
                except OSError:
                    continue
                if int(fields[2]) == group and fields[0] != "Z":
                    found.append(int(entry.name))
        return found

    def kill(self) -> None:
        """SIGKILL for the server alone: nothing of it can tidy up."""
        self._process.kill()
        self._process.wait()

    def kill_left(self) -> int:
        """End what the killed server has left running; how many there were after 2 s."""
        end = time.monotonic() + 2.0
        while (left := self.processes) and time.monotonic() < end:
            time.sleep(0.02)
        for process in left:
            os.kill(process, signal.SIGKILL)
        return len(left)

    def stop(self) -> None:
        """Ask it to end, as the one who runs it does."""
        self._process.terminate()
        try:
            self._process.wait(20)
        except subprocess.TimeoutExpired:
            self.kill()
        self.kill_left()


class MemoryWatch:
    """Looks at the memory of a server and its children all the time (Linux).

    `peak_mb`: the largest sum of what they held at one moment, looked at every 0.2 s.
    `high_water_mb`: the sum of what each held at most, as the kernel counted: never less.
    """

    def __init__(self, server: Server) -> None:
        self._server = server
        self._most: dict[int, float] = {}
        self.peak_mb = 0.0
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    @property
    def high_water_mb(self) -> float:
        """Sum of each process's VmHWM."""
        return sum(self._most.values())

    def stop(self) -> None:
        """Look once more, and no longer."""
        self._end.set()
        self._thread.join()
        self._look()

    def _watch(self) -> None:
        while not self._end.wait(0.2):
            self._look()

    def _look(self) -> None:
        held = 0.0
        for process in self._server.processes:
            try:
                lines = Path(f"/proc/{process}/status").read_text().splitlines()
            except OSError:
                continue
            kb = {name: value for name, _, value in (line.partition(":") for line in lines)}
            if "VmRSS" in kb:
                held += int(kb["VmRSS"].split()[0]) / 1024
                self._most[process] = int(kb["VmHWM"].split()[0]) / 1024
        self.peak_mb = max(self.peak_mb, held)
