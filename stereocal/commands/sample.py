"""`stereocal sample`: write sample data to try the commands with."""

import argparse
import io
import json

import pandas as pd

from stereocal.commands.console import Options
from stereocal.errors import StereocalError
from stereocal.system.atomic_files import write_all
from stereocal.system.resources import ROOT

SAMPLES = {
    "recording": "a real recording: a data set, and points to match",
    "photographs": "photographs of a bar and of a chessboard",
    "boards": "OpenCV's photographs of a chessboard by two cameras",
    "balls": "simulated photographs of a bar with a red and a yellow ball",
    "tank": "simulated photographs of a bar in water, through the wall of a tank",
    "flight": "simulated videos of something that flies, by the cameras of photographs",
    "rig": "a real recording of three cameras",
    "by_hand": "the same, as if each camera had been started by hand",
    "field": "a simulated data set",
    "archives": "files of easyWand, Argus and Kalibr",
    "bump": "bars of the real recording after a camera turned by 0.2 degrees",
    "world": "a survey, plumb lines and a throw, with parameters",
}
MADE_OF = {"by_hand": "rig"}
STARTED = {"1": 0, "2": 41, "3": -118}
"""The first camera's frame at which each camera was started."""
OPTIONS: Options = {
    "name SAMPLE": {
        "type": str,
        "choices": SAMPLES,
        "help": "; ".join(f"{name}: {what}" for name, what in SAMPLES.items()),
    },
    "--out DIR": "folder for it",
}


def run(parsed: argparse.Namespace) -> None:
    """Copy the sample; files that are there already are kept if they are the same."""
    source = ROOT / "sample_data" / MADE_OF.get(parsed.name, parsed.name)
    files = {
        parsed.out / path.relative_to(source): path.read_bytes()
        for path in sorted(source.rglob("*"))
        if path.is_file()
    }
    if not files:
        raise StereocalError(f"This installation is incomplete: {source} is missing. Reinstall it.")
    if parsed.name == "by_hand":
        files = {path: by_own_counts(path.name, content) for path, content in files.items()}
        files = {path: content for path, content in files.items() if content}
    for path, content in files.items():
        if path.exists() and not (path.is_file() and path.read_bytes() == content):
            raise StereocalError(
                f"{path} exists already, with other content: choose another --out."
            )
    write_all(files)
    print(f"wrote {len(files)} files to {parsed.out}")


def by_own_counts(name: str, content: bytes) -> bytes:
    """A file of the recording of three cameras, as if they had been started by hand (`STARTED`);
    empty if it is left out."""
    if name == "dataset.json":
        described = {**json.loads(content), "frames": "own", "name": "Cameras started by hand"}
        return (json.dumps(described, indent=1) + "\n").encode()
    if name == "points.csv":
        table = pd.read_csv(io.BytesIO(content), dtype=str)
        counted = table["frame"].astype(int) - table["camera"].map(STARTED)
        table = table.assign(frame=counted).rename(columns={"frame": "camera_frame"})
        return table[counted >= 0].to_csv(index=False, lineterminator="\n").encode()
    return b"" if name.startswith("points_") else content
