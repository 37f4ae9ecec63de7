"""`stereocal sample`: write sample data to try the commands with."""

import argparse

from stereocal.commands.console import Options
from stereocal.errors import StereocalError
from stereocal.system.atomic_files import write_all
from stereocal.system.resources import ROOT

SAMPLES = {
    "recording": "a real recording: a data set, and points to match",
    "photographs": "photographs of a bar and of a chessboard",
    "boards": "OpenCV's photographs of a chessboard by two cameras",
    "balls": "simulated photographs of a bar with a red and a yellow ball",
    "flight": "simulated videos of something that flies, by the cameras of photographs",
    "rig": "a real recording of three cameras",
    "field": "a simulated data set",
    "archives": "files of easyWand, Argus and Kalibr",
    "bump": "bars of the real recording after a camera turned by 0.2 degrees",
    "world": "a survey, plumb lines and a throw, with parameters",
}
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
    source = ROOT / "sample_data" / parsed.name
    files = {
        parsed.out / path.relative_to(source): path.read_bytes()
        for path in sorted(source.rglob("*"))
        if path.is_file()
    }
    if not files:
        raise StereocalError(f"This installation is incomplete: {source} is missing. Reinstall it.")
    for path, content in files.items():
        if path.exists() and not (path.is_file() and path.read_bytes() == content):
            raise StereocalError(
                f"{path} exists already, with other content: choose another --out."
            )
    write_all(files)
    print(f"wrote {len(files)} files to {parsed.out}")
