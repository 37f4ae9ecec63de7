"""A project with results of everything, for walks that only look."""

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from stereocal.formats.dataset_description import TABLE
from stereocal.intrinsics.calibrate_lens import calibrate_lens
from stereocal.intrinsics.lens_fit import LensSettings
from stereocal.library.calibrations import calibrate
from stereocal.projects.inputs import Slot
from stereocal.projects.lens import ProjectLens
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from tests.bar_photographs import BAR_M, bar_set
from tests.files import encoded
from tests.lens import facing, photographed, search

FRAMES, BOARDS = 14, 12
NAME = "Meadow of the survey"
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


def finished_project(home: Path) -> str:
    """Photographs, found targets, lengths, a calibration and a lens; its id."""
    project = Project.create(home)
    bars = bar_set(FRAMES)
    store = ProjectPhotographs(project)
    files = {
        name.split("/")[1]: store.keep(name, content) for name, content in bars.files().items()
    }
    store.add(files)
    baseline_m = bars.rig.pose.baseline
    project.give(bars.cameras, name=NAME, baseline_m=baseline_m, target_distance_m=BAR_M)
    store.keep_corrected(bars.frames_of(store))
    with ThreadPoolExecutor(2) as executor:
        lens = calibrate_lens(search(BOARDS, 1), LensSettings(subset=8, repeats=12), executor)
    assert lens is not None
    boards = ProjectLens(project, "primary")
    first = encoded(photographed(facing()))
    boards.add({"00.png": boards.keep("00.png", first)})
    boards.keep_search(lens.search)
    boards.keep_calibration(lens)
    dataset = project.dataset
    assert dataset is not None
    project.keep_calibration(calibrate(dataset, trace=True), project.inputs)
    return project.id
