"""Everything that is done to projects on disk, each as one action, and what a home then holds."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

from stereocal.formats.dataset_files import pack_dataset, read_dataset
from stereocal.formats.evaluation_files import Evaluation
from stereocal.formats.point_answers import first_answers, layout_of
from stereocal.frames.review import choose, undo
from stereocal.matching.application import Application, unlabelled
from stereocal.projects.application import SIDES, ProjectApplication
from stereocal.projects.archive import pack_project, unpack_project
from stereocal.projects.folders import private_folder
from stereocal.projects.home import DAY_S, STATES, bring_back, duplicate, folders_in, remove, sweep
from stereocal.projects.inputs import Slot
from stereocal.projects.lens import WHICH, ProjectLens
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import change_review, read_review
from stereocal.refined.results import Calibration
from stereocal.rig.dataset import Dataset
from stereocal.system.photograph_files import keep_photograph
from stereocal.system.zip_files import pack_zip
from tests.pages.stored_projects import FULL, placed

FIELD = Path(__file__).parents[1] / "sample_data" / "field"
Action = Callable[[Project], object]
TRACKS = b"TRACK_ID,FRAME,POSITION_X,POSITION_Y\n0,0,10.5,20.5\n0,1,11.5,21.5\n1,0,30.5,40.5\n"


def home_of(project: Project) -> Path:
    """The home of a project."""
    return project.folder.parents[1]


@cache
def more_data() -> bytes:
    """A further data set."""
    return pack_zip(pack_dataset(read_dataset(FIELD)))


def _photographs(project: Project) -> None:
    store = ProjectPhotographs(project)
    names = ("primary/left7.jpg", "secondary/right7.jpg")
    store.add({name: keep_photograph([name.encode()], name, store.files) for name in names})


def replace_one(project: Project) -> str:
    """Another photograph under the name of one in which targets were corrected; the name."""
    store = ProjectPhotographs(project)
    name = next(frame for frame in store.frames or [] if frame.reviewed).files[0]
    store.add({name: keep_photograph([b"another"], name, store.files)})
    return name


def _found_anew(project: Project) -> Action:
    found = ProjectPhotographs(project).frames
    assert found is not None
    replace_one(project)
    other = [replace(frame.swapped(0).swapped(1), reviewed=False) for frame in found]

    def act(project: Project) -> None:
        store = ProjectPhotographs(project)
        store.keep_found(other, store.photographs)

    return act


def _boards(project: Project) -> None:
    store = ProjectLens(project, "primary")
    store.add({"08.jpg": keep_photograph([b"board"], "08.jpg", store.files)})


def _camera_files() -> dict[Slot, tuple[str, bytes]]:
    return {name: (f"{name}.json", (FIELD / f"{name}.json").read_bytes()) for name in WHICH}


def _give(project: Project) -> None:
    points = (FIELD / "correspondences.csv").read_bytes()
    files = _camera_files() | {"correspondences": ("points.csv", points)}
    project.give(files, baseline_m=3.0)


def _give_all(project: Project) -> None:
    """A data set with photographs, in place of another."""
    store = ProjectPhotographs(project)
    names = ("left8.jpg", "right8.jpg")
    found = {name: keep_photograph([name.encode()], name, store.files) for name in names}
    store.give(_camera_files(), found, name="Another", baseline_m=3.0, target_distance_m=0.5)


def _calibration(project: Project) -> Callable[[Project], object]:
    found = project.calibration
    assert found is not None
    inputs, other = project.inputs, replace(found, warnings=("Another.",))
    return lambda project: project.keep_calibration(other, inputs)


def _evaluation(project: Project) -> Callable[[Project], object]:
    found = project.evaluation
    assert found is not None
    other = Evaluation(found.runs, found.settings, ["Another"], found.sha256)
    return lambda project: project.keep_evaluation(other)


def _search(project: Project) -> Callable[[Project], object]:
    found = ProjectLens(project, "primary").search
    assert found is not None
    other = found.without([found.views[0].name])
    return lambda project: ProjectLens(project, "primary").keep_search(other)


def _lens(project: Project) -> Callable[[Project], object]:
    found = ProjectLens(project, "primary").calibration
    assert found is not None
    other = replace(found, of_all=found.of_all + 1.0)
    return lambda project: ProjectLens(project, "primary").keep_calibration(other)


def _found(project: Project) -> Callable[[Project], object]:
    frames = ProjectPhotographs(project).frames
    assert frames is not None
    other = [frame.swapped(0).swapped(1) for frame in frames]
    return lambda project: ProjectPhotographs(project).keep_found(
        other, ProjectPhotographs(project).photographs
    )


def _run(project: Project) -> Callable[[Project], object]:
    calibration, dataset = project.calibration, project.dataset
    assert calibration is not None and dataset is not None
    tables = unlabelled(dataset.correspondences)
    sets = calibration.parameters("2d"), calibration.parameters("3d")

    def act(project: Project) -> None:
        store = ProjectApplication(project)
        sides = [
            store.own_points(table, f"{side} points")
            for side, table in zip(SIDES, tables, strict=True)
        ]
        store.run(Application(sides[0], sides[1], *sets, 2.0))

    return act


def _rows(project: Project) -> None:
    store = ProjectPhotographs(project)
    rows = store.rows
    store.change_rows(rows, [replace(rows[0], use=False), *rows[1:]])


def _offered(project: Project) -> None:
    ProjectApplication(project).offer_points("primary", "p.csv", b"frame,u,v\n1,2.5,3.5\n")


def _asked(project: Project) -> None:
    ProjectApplication(project).ask("primary", "tracks.csv", TRACKS)


def _answered(project: Project) -> Action:
    _asked(project)
    answers = first_answers(layout_of(TRACKS, "tracks.csv"), 0)
    return lambda project: ProjectApplication(project).answer("primary", answers)


def _asked_again(project: Project) -> Action:
    _answered(project)(project)
    return lambda project: ProjectApplication(project).ask_again("primary")


def _forgotten(project: Project) -> Action:
    _asked(project)
    return lambda project: ProjectApplication(project).forget_question("primary")


def _set(project: Project) -> Action:
    calibration = project.calibration
    assert calibration is not None
    content = replace(calibration.parameters("2d"), matching_threshold_px=0.5).dumps().encode()
    return lambda project: ProjectApplication(project).keep_set("measuring", "o.json", content)


def _dropped(project: Project) -> Action:
    project.add_dataset("more.zip", more_data())
    return lambda project: project.drop_datasets()


def _reviewed(project: Project) -> None:
    change_review(ProjectPhotographs(project), lambda now: choose(now, 2, False))


def _undone(project: Project) -> None:
    change_review(ProjectPhotographs(project), undo)


def _carried(project: Project) -> None:
    home = home_of(project)
    pack_project(project, home / "carried.zip")
    unpack_project(home / "carried.zip", "carried.zip", home)


def _removed(project: Project) -> Action:
    remove(home_of(project), project.id)
    return lambda project: bring_back(home_of(project), project.id)


def _swept(project: Project) -> None:
    home = home_of(project)
    now = project.folder.stat().st_mtime
    for day in (400, 402):
        sweep(home, 30, 90, lambda day=day: now + day * DAY_S)  # type: ignore[misc]


AT_ONCE: Mapping[str, Action] = {
    "Project.create": lambda project: Project.create(home_of(project)),
    "Project.give": _give,
    "Project.rename": lambda project: project.rename("Another"),
    "Project.keep_settings": lambda project: project.keep_settings({"seed": 7}),
    "Project.add_dataset": lambda project: project.add_dataset("more.zip", more_data()),
    "ProjectPhotographs.add": _photographs,
    "ProjectPhotographs.add, in place of another": replace_one,
    "ProjectPhotographs.give": _give_all,
    "ProjectPhotographs.clear": lambda project: ProjectPhotographs(project).clear(),
    "ProjectPhotographs.change_rows": _rows,
    "ProjectPhotographs.keep_rows": lambda project: ProjectPhotographs(project).keep_rows(None),
    "ProjectLens.add": _boards,
    "ProjectLens.clear": lambda project: ProjectLens(project, "primary").clear(),
    "ProjectLens.use": lambda project: ProjectLens(project, "primary").use(),
    "ProjectApplication.offer_points": _offered,
    "ProjectApplication.ask": _asked,
    "change_review": _reviewed,
    "change_review, undo": _undone,
    "duplicate": lambda project: duplicate(home_of(project), project.id),
    "remove": lambda project: remove(home_of(project), project.id),
    "pack_project, unpack_project": _carried,
    "sweep": _swept,
}
"""Actions as they stand."""
PREPARED: Mapping[str, Callable[[Project], Action]] = {
    "Project.keep_calibration": _calibration,
    "Project.keep_evaluation": _evaluation,
    "ProjectPhotographs.keep_found, keep_frames": _found,
    "ProjectLens.keep_search": _search,
    "ProjectLens.keep_calibration": _lens,
    "ProjectApplication.own_points, run": _run,
    "ProjectApplication.answer": _answered,
    "ProjectApplication.ask_again": _asked_again,
    "ProjectApplication.forget_question": _forgotten,
    "ProjectApplication.keep_set": _set,
    "Project.drop_datasets": _dropped,
    "bring_back": _removed,
}
"""Actions that need something before, which is done to the project as it is given."""
IN_STEPS: Mapping[str, Callable[[Project], Action]] = {
    "ProjectPhotographs.keep_found, of others": _found_anew,
}
"""The same, of which a part may be done: what each leaves has a test of its own."""


def kept(home: Path) -> list[dict[str, str]]:
    """What a home holds: of every project its state, whatever the ids and the names of folders."""
    found = [
        {"where": where, **state_of(folder)}
        for where in ("projects", "removed")
        for folder in folders_in(home / where)
    ]
    return sorted(found, key=lambda state: json.dumps(state, sort_keys=True))


def state_of(folder: Path) -> dict[str, str]:
    """The files of a project that are replaced, each by a digest of its content."""
    state = {}
    for below in STATES:
        for path in sorted((folder / below).glob("*")):
            if path.is_file() and not path.name.startswith("."):
                content = re.sub(rb'"folder": "[^"]*"', b"", path.read_bytes())
                place = path.relative_to(folder).as_posix()
                state[place] = hashlib.sha256(content).hexdigest()[:12]
    return state


def check_whole(folder: Path) -> None:
    """Everything that a project names is there, and nothing of it is damaged."""
    project = Project(folder)
    _ = project.settings, project.calibration, project.evaluation, project.more_datasets
    assert project.inputs.missing or isinstance(project.dataset, Dataset)
    assert project.calibration is None or isinstance(project.calibration, Calibration)
    photographs, lens = ProjectPhotographs(project), ProjectLens(project, "primary")
    for path in (*photographs.photographs.values(), *lens.photographs.values()):
        assert hashlib.sha256(path.read_bytes()).hexdigest().startswith(path.stem), path
    _ = photographs.rows, lens.search, lens.calibration
    if photographs.photographs and photographs.frames is not None:
        read_review(photographs)
    store = ProjectApplication(project)
    for side in SIDES:
        points = store.points(side)
        assert points is None or points.path.is_file()
        store.asking(side)
    _ = store.set_of("matching"), store.set_of("measuring"), store.result


def left_over(home: Path) -> list[str]:
    """Temporary files and folders that an action should have taken with it."""
    return [path.relative_to(home).as_posix() for path in home.rglob(".*") if path.name != ".lock"]


def placed_full(home: Path) -> Project:
    """The full project, alone in a home."""
    private_folder(home / "removed")
    return placed(FULL, home)
