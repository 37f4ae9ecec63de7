"""Peak memory of the detection in 50 and in 500 photographs, with threads and with processes.

python -m benchmarks.memory

Each line is a fresh process. The photographs are 20 files of 2336x1728 px under many names.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from stereocal.frames.series import detect_series
from stereocal.simulation.simulate import field_rig
from stereocal.system.executors import engine
from tools.photographs.backgrounds import outdoors
from tools.photographs.bars import BarSettings, photograph_bars, place_visible_bars
from tools.photographs.rendering import PhotographSettings

COUNTS = (50, 500)
ENGINES = {"threads": None, "processes": 2}
"""Workers as `engine` takes them."""


def render(folder: Path) -> list[Path]:
    """20 photographs of ten frames, as PNG."""
    rng, rig = np.random.default_rng(6), field_rig()
    scene = place_visible_bars(rig, rng, 10, 0.9)
    files = []
    settings = PhotographSettings()
    for pair in photograph_bars(scene, outdoors(rig, rng), BarSettings(), settings, rng):
        for which, image in enumerate((pair.primary, pair.secondary)):
            files.append(folder / f"{pair.frame}_{which}.png")
            cv2.imwrite(str(files[-1]), image)
    return files


def peak_mb(_: int = 0) -> float:
    """Largest resident size of this process so far (Linux).

    Not getrusage's: that starts from the size of the process that started this one.
    """
    status = Path("/proc/self/status").read_text()
    return float(status.split("VmHWM:")[1].split()[0]) / 1024


def one_run(folder: Path, name: str) -> None:
    """Detect in all photographs of a folder and print the peak of this process and its workers."""
    photographs = {path.name: path for path in sorted(folder.iterdir())}
    began = time.perf_counter()
    with engine(ENGINES[name]) as executor:
        found = detect_series(photographs, executor)
        workers = max(executor.map(peak_mb, range(20)))
    assert found is not None and len(found) == len(photographs)
    seconds = time.perf_counter() - began
    right = sum(detection.state == "found" for detection in found.values())
    print(
        f"{name}, {len(photographs)} photographs ({right} found): peak {peak_mb():.0f} MB, "
        f"of a worker {workers:.0f} MB; {seconds:.0f} s, load {os.getloadavg()[0]:.1f}",
        flush=True,
    )


def main() -> None:
    """Measure and print."""
    if len(sys.argv) > 2:
        one_run(Path(sys.argv[1]), sys.argv[2])
        return
    with TemporaryDirectory() as name:
        files = Path(name, "files")
        files.mkdir()
        rendered = render(files)
        for count in COUNTS:
            folder = Path(name, str(count))
            folder.mkdir()
            for i in range(count):
                (folder / f"{i:04d}.png").hardlink_to(rendered[i % len(rendered)])
            for workers in ENGINES:
                command = [sys.executable, "-m", "benchmarks.memory", str(folder), workers]
                subprocess.run(command, check=True)


if __name__ == "__main__":
    main()
