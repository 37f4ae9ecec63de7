"""The inputs that are neither samples nor made by a command."""

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from stereocal.formats.camera_file import write_camera
from stereocal.formats.dataset_files import pack_dataset
from stereocal.rig.tracks import TimeOffset
from stereocal.simulation.simulate import field_rig
from tests.docs.pages import code_of
from tests.docs.prepared import videos
from tests.files import description, write
from tests.fisheye_rig import recording
from tests.photographed_rig import BAR_M, PRIMARY, RIG, SECONDARY, TAGS, photographed_bars
from tests.rigs.moving_bar import move_bar, record

ROOT = Path(__file__).parents[2]


def _fisheye(folder: Path) -> None:
    write(pack_dataset(recording(120.0, seed=1)[0]), folder)


def _moving(folder: Path) -> None:
    """A bar moved by hand; the secondary camera is 0.3 frames late."""
    rng = np.random.default_rng(7)
    bar = move_bar(field_rig(4.5), rng, frames=120, length_m=0.9)
    write(pack_dataset(record(bar, rng, 0.15, "moving", offset=TimeOffset(0.3))), folder)


def _tags(folder: Path) -> None:
    given = {"dataset.json": description("tags", RIG.pose.baseline, BAR_M)}
    for which, side, camera in (("primary", "left", PRIMARY), ("secondary", "right", SECONDARY)):
        given[f"{which}.json"] = write_camera(camera)
        given |= {
            name.replace(side, which): content
            for name, content in photographed_bars(TAGS, 5)[0].items()
            if name.startswith(side)
        }
    write(given, folder)


def _plan(folder: Path) -> None:
    """The plan that a page of the documentation shows."""
    for code in code_of(ROOT / "docs" / "howto" / "plan.md"):
        if code.language == "json":
            (folder / "plan.json").write_text(code.text, encoding="utf-8")


def _scripts(folder: Path) -> None:
    shutil.copy(Path(__file__).with_name("library.py"), folder)


def _cases(folder: Path) -> None:
    shutil.copytree(ROOT / "tests" / "cases", folder, dirs_exist_ok=True)


MADE: Mapping[str, Callable[[Path], None]] = {
    "cases": _cases,
    "fisheye": _fisheye,
    "moving": _moving,
    "plan": _plan,
    "scripts": _scripts,
    "tags": _tags,
    "videos": videos,
}
"""How each is written into its empty folder."""
