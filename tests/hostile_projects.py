"""A whole project on disk; one of its files becomes hostile, and all of it is read."""

import atexit
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np

from stereocal.calibration.methods import CalibrationSettings, errors_of
from stereocal.errors import StereocalError
from stereocal.evaluation.evaluate import EvaluationSettings, evaluate
from stereocal.evaluation.summary import summarise
from stereocal.formats.camera_file import write_camera
from stereocal.formats.correspondences_csv import write_table
from stereocal.formats.dataset_files import pack_dataset
from stereocal.formats.evaluation_files import Evaluation
from stereocal.frames.frame import Centre, Frame
from stereocal.frames.review import place_target
from stereocal.intrinsics.boards import BoardSearch
from stereocal.intrinsics.calibrate_lens import calibrate_lens
from stereocal.intrinsics.lens_fit import LensSettings
from stereocal.library.calibrations import calibrate
from stereocal.matching.application import Application, Points
from stereocal.matching.pairs import Stated
from stereocal.projects.application import USES, ProjectApplication
from stereocal.projects.archive import pack_project, unpack_project
from stereocal.projects.home import recent_projects
from stereocal.projects.lens import ProjectLens
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import change_review, read_review, thumbnail
from stereocal.rig.camera import CAMERAS
from stereocal.rig.correspondences import SOURCES
from stereocal.rig.dataset import Dataset
from stereocal.rig.parameters import RigParameters
from stereocal.system.zip_files import pack_zip, unzip
from tests.files import encoded
from tests.known_rig import BAR_M, BASELINE_M, PRIMARY, SECONDARY, correspondences
from tests.lens import PATTERN, AtOnce, views

FRAMES = 8


@dataclass(frozen=True)
class Inner:
    """A file of a project's zip."""

    kind: str
    member: str

    def seeds(self) -> Sequence[bytes]:
        """The sound file."""
        return [_members()[self.member]]


FILES = {
    "project.json": Inner("json", "project.json"),
    "camera": Inner("json", "inputs/primary.json"),
    "points": Inner("text", "inputs/correspondences.csv"),
    "more": Inner("zip", "datasets/000000.zip"),
    "calibration.json": Inner("json", "results/calibration.json"),
    "evaluation.npz": Inner("npz", "results/evaluation.npz"),
    "frames.json": Inner("json", "results/frames.json"),
    "boards.npz": Inner("npz", "results/boards_primary.npz"),
    "lens.npz": Inner("npz", "results/lens_primary.npz"),
    "result.json": Inner("json", "results/applied.json"),
}


def dataset() -> Dataset:
    """A small one."""
    return Dataset("small", PRIMARY, SECONDARY, correspondences(FRAMES, 0.1), BASELINE_M, BAR_M)


def dataset_zip() -> bytes:
    """The small one as a person gives it."""
    return pack_zip(pack_dataset(dataset()))


@cache
def project_zip() -> bytes:
    """The template, carried."""
    target = Path(tempfile.mkdtemp()) / "project.zip"
    pack_project(template(), target)
    content = target.read_bytes()
    shutil.rmtree(target.parent)
    return content


def read_project_zip(content: bytes, folder: Path) -> None:
    """Open a project's zip and read all of it, as the pages would."""
    project = unpack_project(content, "p.zip", folder)
    try:
        recent_projects(folder)
        read_whole(project)
    finally:
        shutil.rmtree(folder / "projects", ignore_errors=True)


def read_inner(name: str, content: bytes) -> None:
    """Open the project's zip with another content of one of its files, and read all of it."""
    with tempfile.TemporaryDirectory() as folder:
        changed = pack_zip({**_members(), FILES[name].member: content})
        project = unpack_project(changed, "p.zip", Path(folder))
        read_whole(project)
        if name == "evaluation.npz" and (evaluation := project.evaluation):
            summarise(evaluation.runs)


def read_whole(project: Project) -> None:
    """All that pages read of a project, and the first that they do with it.

    Raises:
        StereocalError: the last of what was refused; all else has been read all the same.
    """
    refused: StereocalError | None = None
    for read in _reads(project):
        try:
            read()
        except StereocalError as error:
            refused = error
    if refused is not None:
        raise refused


def _reads(project: Project) -> Iterator[Callable[[], object]]:
    photographs, apply = ProjectPhotographs(project), ProjectApplication(project)
    yield lambda: Project.open(project.database.path.parents[1], project.id)
    yield lambda: (project.inputs.missing, project.settings, project.table, project.cameras)
    yield lambda: project.dataset
    yield lambda: project.more_datasets
    yield lambda: _use_calibration(project)
    yield lambda: project.evaluation
    yield lambda: (photographs.photographs, photographs.proposal.pairing.sentence, photographs.rows)
    yield lambda: [
        thumbnail(photographs, frame.files, frame.centres)
        for frame in (photographs.frames or [])[:1]
    ]
    yield lambda: read_review(photographs)
    for which in CAMERAS:
        lens = ProjectLens(project, which)
        yield from (
            partial(getattr, lens, name)
            for name in ("photographs", "search", "calibration", "is_used")
        )
    for side in CAMERAS:
        yield from (partial(apply.points, side), partial(apply.asking, side))
    yield from (partial(apply.set_of, use) for use in USES)
    yield lambda: apply.result


def _use_calibration(project: Project) -> None:
    calibration = project.calibration
    if calibration is not None:
        for method in ("2d", "3d"):
            calibration.parameters(method).dumps()
        for found in calibration.methods.values():
            errors_of(calibration.dataset, found.pose)


@cache
def _members() -> dict[str, bytes]:
    """The files of the template's zip."""
    return unzip(project_zip(), "p.zip")


@cache
def template() -> Project:
    """A project with all that a project can have."""
    home = Path(tempfile.mkdtemp(prefix="stereocal-hostile-"))
    atexit.register(shutil.rmtree, home, ignore_errors=True)
    project = Project.create(home)
    _give_results(project)
    _give_photographs(project)
    _give_boards(project)
    _give_points(project)
    return project


def _give_results(project: Project) -> None:
    own = dataset()
    project.give(
        {
            "primary": ("primary.json", write_camera(PRIMARY)),
            "secondary": ("secondary.json", write_camera(SECONDARY)),
            "correspondences": ("points.csv", write_table(own.correspondences)),
        },
        name="small",
        baseline_m=BASELINE_M,
        target_distance_m=BAR_M,
    )
    project.add_dataset("more.zip", dataset_zip())
    project.keep_settings({"delta": 0.001, "runs": 3})
    project.keep_calibration(calibrate(own, CalibrationSettings(), trace=False), project.inputs)
    settings = EvaluationSettings(runs=2, calibration_frames=5)
    with ThreadPoolExecutor(1) as executor:
        runs = evaluate([own], settings, executor)
    project.keep_evaluation(Evaluation(runs, settings, ["small"], [own.sha256]))


def _give_photographs(project: Project) -> None:
    store = ProjectPhotographs(project)
    names = [f"{side}{k}.png" for k in (1, 2) for side in ("left", "right")]
    found = {}
    for at, name in enumerate(names):
        image = np.full((1024, 1600), at, np.uint8)
        found[name] = store.keep(name, encoded(image))
    store.add(found)
    store.keep_rows(store.rows)
    frames = [
        Frame(
            k,
            (f"left{k}.png", f"right{k}.png"),
            (
                (Centre(800, 600, 0.1), Centre(900, 610, 0.1)),
                (Centre(600, 500, 0.1), Centre(700, 520, 0.1)),
            ),
            "found",
        )
        for k in (1, 2)
    ]
    table = project.table
    assert table is not None
    store.keep_corrected(frames)
    change_review(
        store, lambda review: place_target(review, 1, 0, 0, Centre(805, 600, None, SOURCES[-1]))
    )
    project.give({"correspondences": table})


def _give_boards(project: Project) -> None:
    store = ProjectLens(project, "primary")
    seen = views(6, 1)
    search = BoardSearch(PATTERN, seen, ())
    found = {}
    for at, view in enumerate(seen):
        image = np.full((48, 64), at, np.uint8)
        content = encoded(image)
        found[view.name] = store.keep("a.png", content)
    store.add(found)
    store.keep_search(search)
    lens = calibrate_lens(search, LensSettings(subset=5, repeats=2), AtOnce())
    store.keep_calibration(lens)


def _give_points(project: Project) -> None:
    store = ProjectApplication(project)
    calibration = project.calibration
    assert calibration is not None
    rigs: list[RigParameters] = [calibration.parameters("2d"), calibration.parameters("3d")]
    for use, rig in zip(USES, rigs, strict=True):
        store.keep_set(use, "p.json", rig.dumps().encode())
    for side in CAMERAS:
        pixels = getattr(dataset().correspondences, side)
        rows = [f"{k // 2},{u!r},{v!r}" for k, (u, v) in enumerate(pixels.tolist())]
        store.offer_points(side, f"{side}.csv", ("frame,u,v\n" + "\n".join(rows)).encode())
    store.ask("bars", "wand.csv", b"1,2,3,4,5,6,7,8\n1,2,3,4,5,6,7,8\n")
    points: dict[str, Points] = {
        side: given for side in CAMERAS if (given := store.points(side)) is not None
    }
    store.run(Application(points, rigs[0], rigs[1], Stated(1.0)))
