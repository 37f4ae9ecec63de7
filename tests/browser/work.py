"""A project with results of everything, for walks that only look."""

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from stereocal.formats.dataset_description import TABLE
from stereocal.formats.dataset_files import pack_dataset
from stereocal.intrinsics.calibrate_lens import calibrate_lens
from stereocal.intrinsics.lens_fit import LensSettings
from stereocal.projects.home import duplicate, remove
from stereocal.projects.inputs import Slot
from stereocal.projects.lens import ProjectLens
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.system.zip_files import pack_zip
from stereocal.ui import jobs
from stereocal.ui.press import Press
from tests.files import encoded
from tests.hostile_projects import dataset
from tests.pages.stored_projects import FEW, ended
from tests.photographs.bars import BAR_M, bar_set
from tests.photographs.lens import facing, photographed, search

FRAMES, BOARDS = 14, 12
FILE = "www.evil.example me@evil.example"
NAME = f"http://evil.example/x https://evil.example {FILE}"
"""Would be links if names were read as text with links."""
FILES: dict[Slot, str] = {
    "correspondences": TABLE,
    "primary": "primary.json",
    "secondary": "secondary.json",
}


def a_project(home: Path, folder: Path, name: str = "") -> Project:
    """A project with the files and lengths of a data set, not yet calibrated."""
    about = json.loads((folder / "dataset.json").read_text())
    project = Project.create(home)
    project.give(
        {slot: (file, (folder / file).read_bytes()) for slot, file in FILES.items()},
        name=name or about["name"],
        baseline_m=about["baseline_m"],
        target_distance_m=about["target_distance_m"],
    )
    return project


def finished_project(home: Path) -> Project:
    """Photographs, found targets, lengths, a calibration with its validation, a lens, and a further
    data set, all named `NAME` or `FILE`; a second project of that name was removed."""
    project = Project.create(home)
    bars = bar_set(FRAMES)
    store = ProjectPhotographs(project)
    store.add({name.split("/")[1]: store.keep(name, own) for name, own in bars.files().items()})
    named = {slot: (f"{slot} {FILE}.json", own) for slot, (_, own) in bars.cameras.items()}
    baseline_m = bars.rig.pose.baseline
    project.give(named, name=NAME, baseline_m=baseline_m, target_distance_m=BAR_M)
    store.keep_corrected(bars.frames_of(store))
    with ThreadPoolExecutor(2) as executor:
        lens = calibrate_lens(search(BOARDS, 1), LensSettings(subset=8, repeats=12), executor)
    assert lens is not None
    boards = ProjectLens(project, "primary")
    boards.add({"00.png": boards.keep("00.png", encoded(photographed(facing())))})
    boards.keep_search(lens.search)
    boards.keep_calibration(lens)
    project.keep_settings(FEW)
    jobs.start(Press.of(project).work)
    assert ended(project, "calibration").state == "done"
    project.add_dataset(f"{FILE}.zip", pack_zip(pack_dataset(dataset().changed(name=NAME))))
    remove(home, duplicate(home, project.id).id)
    return project
