"""A project with all that a project can hold, made by the acts of its pages."""

from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from stereocal.formats.dataset_files import parse_recording
from stereocal.frames.decided_pairs import PairRow
from stereocal.frames.pairing import Motion, Pairing
from stereocal.frames.proposal import Choice
from stereocal.frames.review import use_frame
from stereocal.matching.clicks import Click
from stereocal.projects import jobs
from stereocal.projects.application import ProjectApplication, ProjectCheck
from stereocal.projects.clicks import Act, ProjectClicks
from stereocal.projects.contents import ANY, CONTENTS, Key
from stereocal.projects.data import RESULTS
from stereocal.projects.given import ProjectGiven
from stereocal.projects.lens import ProjectLens
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import change_review
from stereocal.rig.parameters import RigParameters
from tests.hostile_projects import dataset_zip
from tests.pages.stored_projects import FULL, placed
from tests.projects.test_project import FIELD, XYPTS
from tests.projects.test_recording import given, rig_text

Rows = dict[Key, list[tuple[Any, ...]]]
SURVEY = FIELD.parent / "world" / "survey.csv"
PARAMETERS = FIELD.parent / "world" / "parameters_3d.json"


def whole_project(home: Path) -> Project:
    """All tables, parts and values of `contents.CONTENTS`, also of a pair and of pages."""
    project = placed(FULL, home)
    calibration, evaluation, inputs = project.calibration, project.evaluation, project.inputs
    assert calibration is not None and evaluation is not None
    project.keep_calibration(calibration, inputs)
    project.keep_evaluation(evaluation, of_calibration=True)
    project.keep_recommended("2d", "3d")
    project.add_dataset("more.zip", dataset_zip())
    project.keep_settings({"delta": 0.002})

    of_two = {kind: project.database.result(kind) for kind in RESULTS}
    project.give_recording(parse_recording(given(), "rig"), given())
    for kind, content in of_two.items():
        project.database.keep_result(kind, content)
    project.keep_rig(rig_text(), b"zip", {"points": ["digest"]})
    project.of_pair("1-2").keep_recommended("2d", "3d")
    for content in (b"first", b"second"):
        ProjectGiven(project).add_parts({"camera.yaml": content})

    photographs = ProjectPhotographs(project)
    frames = photographs.frames
    assert frames is not None
    photographs.keep_boards(
        calibration.dataset, "7 boards", {3: "far off"}, None, {"what": "boards"}
    )
    photographs.keep_found(frames, photographs.photographs, {"what": "bars"})
    change_review(photographs, lambda now: use_frame(now, frames[0].frame, not frames[0].use))
    pairs = [row.pair for row in photographs.rows]
    photographs.choose(Choice("order", without=(pairs[0].primary,), exchanged=True))
    photographs.choose(Choice("motion", heard={"secondary": 0.25}))
    found = Motion({"primary": 0, "secondary": 2}, {}, frozenset(), "The swing says it.")
    photographs.settle(Pairing({}, motion=found))
    photographs.keep_rows([PairRow(pair, pair is not pairs[0]) for pair in pairs])
    known = {"primary": (0.001, 2.0)}
    project.give({}, lens_known=known, planned=["baseline_m"], step_notes=["by a flash"])
    project.exchange_targets(2)
    project.leave_out(3)

    secondary, primary = ProjectLens(project, "secondary"), ProjectLens(project, "primary")
    secondary.add(primary.photographs)
    assert primary.search is not None and primary.calibration is not None
    secondary.keep_search(primary.search)
    secondary.keep_calibration(primary.calibration)

    apply, check = ProjectApplication(project), ProjectCheck(project)
    apply.keep_world(SURVEY.name, SURVEY.read_bytes(), RigParameters.load(PARAMETERS))
    apply.offer_points("primary", "xypts.csv", XYPTS)
    check.keep_parameters(PARAMETERS.name, PARAMETERS.read_bytes())
    check.keep_images("bars.zip", dataset_zip())

    click = Click(3, "primary", "head", 10.25, 20.5, "snapped")
    clicks = ProjectClicks(project)
    clicks.act(Act([click], pictures=["photographs"]))
    clicks.act(Act([], [click.key]))
    for pages in (clicks.of_pictures, ProjectCheck(project).of_images):
        store = ProjectPhotographs(pages)
        store.add({name: store.keep(name, name.encode()) for name in ("l/1.jpg", "r/1.jpg")})
        store.choose(Choice("order", exchanged=True))

    jobs.begin(project.database, "evaluation")
    jobs.FoundBefore(project.database, "photographs", str).keep("a", "A")
    return project


def rows_of(project: Project) -> Rows:
    """The rows of all tables but `content`, by their entry in the list.

    Files and corrections are in their order; contents without a name are left out.
    """
    found: Rows = defaultdict(list)
    with project.database.reading() as db:
        made = "SELECT name FROM sqlite_master WHERE type = 'table'"
        tables = {name for (name,) in db.execute(made)}
        assert tables == {table for table, *_ in CONTENTS} | {"content"}
        named = {sha for (sha,) in db.execute("SELECT sha256 FROM named")}
        assert named <= {sha for (sha,) in db.execute("SELECT sha256 FROM content")}
        for table in sorted(tables - {"content"}):
            asked = db.execute(f"SELECT * FROM {table} ORDER BY rowid")
            columns = [each[0] for each in asked.description]
            for row in asked.fetchall():
                of = dict(zip(columns, row, strict=True))
                if table != "file" or of["sha256"] in named:
                    found[_entry(table, of)].append(row)
    return {key: _sorted(key, rows) for key, rows in found.items()}


def _entry(table: str, of: dict[str, Any]) -> Key:
    """The one entry of the list that a row belongs to."""
    scoped = str(of.get("part", of.get("kind"))).rpartition("/")[2]
    part = scoped if table in ("value", "named", "result") else ""
    (key,) = (
        key for key in CONTENTS if key[:2] == (table, part) and key[2] in (ANY, of.get("name"))
    )
    return key


def _sorted(key: Key, rows: Iterable[tuple[Any, ...]]) -> list[tuple[Any, ...]]:
    """By part, which is the first column; files of a part and corrections in their order."""
    if key[0] in ("named", "edit"):
        return sorted(rows, key=lambda row: str(row[0]) if key[0] == "named" else "")
    return sorted(rows)


def differing(before: Rows, after: Rows) -> set[Key]:
    """The entries of the list of which two projects have other rows; of the days, for the files
    that both have."""
    days: Key = ("file", "", ANY)
    every = {key for key in before | after if before.get(key) != after.get(key)} - {days}
    first: dict[str, float] = dict(before[days])
    same = all(first.get(sha, stored) == stored for sha, stored in after[days])
    return every | (set() if same else {days})
