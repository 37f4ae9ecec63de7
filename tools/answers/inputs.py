"""The inputs that are neither samples nor made by a command."""

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from stereocal.formats.camera_file import write_camera
from stereocal.formats.dataset_files import pack_dataset, pack_recording, read_recording
from stereocal.rig.tracks import TimeOffset
from stereocal.simulation.rigs import simulated_rig
from stereocal.simulation.simulate import field_rig
from tests.docs.pages import code_of
from tests.docs.prepared import videos
from tests.files import description, write
from tests.photographs.small_rig import BAR_M, PRIMARY, RIG, SECONDARY, TAGS, photographed_bars
from tests.rigs.fisheye_rig import recording
from tests.rigs.mistakes import bumped_from
from tests.rigs.moving_bar import move_bar, record
from tests.rigs.moving_wand import wave_wand

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


def _rigs(folder: Path) -> None:
    """The thirds of the real recording of three cameras; and simulated ones: four cameras of which
    each is late and one drifts, nine, and three of which one is turned by half a degree midway."""
    real = read_recording(ROOT / "sample_data" / "rig")
    frames = np.unique(real.frame)
    thirds = zip(("first", "second", "third"), np.array_split(frames, 3), strict=True)
    made = {name: real.where(np.isin(real.frame, own)) for name, own in thirds}
    late = np.array([0.0, 0.3, -0.2, 0.4])
    made["four"] = wave_wand(3, late, frames=150, drift=2e-4)[1]
    made["nine"] = simulated_rig(np.random.default_rng(9), 9, 80).recording
    made["moved"] = bumped_from(simulated_rig(np.random.default_rng(5)), "c2", 0.5, 75)
    for name, each in made.items():
        write(pack_recording(each), folder / name)


def _plan(folder: Path) -> None:
    """The plan that a page of the documentation shows."""
    for code in code_of(ROOT / "docs" / "howto" / "plan.md"):
        if code.language == "json":
            (folder / "plan.json").write_text(code.text, encoding="utf-8")


def _scripts(folder: Path) -> None:
    for name in ("library.py", "library_rig.py"):
        shutil.copy(Path(__file__).with_name(name), folder)


def _cases(folder: Path) -> None:
    shutil.copytree(ROOT / "tests" / "cases", folder, dirs_exist_ok=True)


MADE: Mapping[str, Callable[[Path], None]] = {
    "cases": _cases,
    "fisheye": _fisheye,
    "moving": _moving,
    "plan": _plan,
    "rigs": _rigs,
    "scripts": _scripts,
    "tags": _tags,
    "videos": videos,
}
"""How each is written into its empty folder."""
