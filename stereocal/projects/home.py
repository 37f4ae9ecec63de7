"""The projects of a server: list, copy, remove, bring back, delete old ones; and what each holds.

<home>/projects/<id>.sqlite     a project
<home>/projects/<id>.removed    marks it as removed, at the time of this file
"""

import math
import os
import shutil
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from stereocal.calibration.methods import METHOD_NAMES, PAPER_SETS
from stereocal.errors import StereocalError, disk_errors
from stereocal.fit.in_words import rig_errors_in_words
from stereocal.projects.contents import CONTENTS, PARTS, POINT_FILES
from stereocal.projects.database import (
    NOT_THERE,
    REMOVED,
    WAITING,
    DamagedError,
    remove_database,
    set_journal,
)
from stereocal.projects.files import SUFFIX, Store, is_id, new_database, private_folder, store_of
from stereocal.projects.jobs import has_interrupted
from stereocal.projects.photographs import (
    BOARDS_LABEL,
    FOUND_LABELS,
    TABLE_LABEL,
    ProjectPhotographs,
)
from stereocal.projects.project import Project
from stereocal.projects.server_settings import check_quota
from stereocal.system.atomic_files import flush_folder
from stereocal.system.latest import once
from stereocal.system.numbers import count, rounded
from stereocal.verdict.file_figures import bar_known, figures_of
from stereocal.verdict.in_words import percent

DAY_S = 86_400.0
AGAIN = "This project was brought back already, or it was removed for good."


@dataclass(frozen=True)
class Listed:
    """A project in a list of projects."""

    id: str
    title: str
    """What `title_of` returns; empty if the project cannot be read."""
    changed: float
    """Seconds since 1970; of a removed project, when it was removed."""
    interrupted: bool = False
    damaged: bool = False
    unreadable: str = ""
    """Why it cannot be read though it is not damaged: it is of a newer version."""


def find_projects(home: Path, search: str = "") -> list[str]:
    dated = [(changed_at(s.path), s.path) for s in _stores(home) if not s.marker.exists()]
    wanted, newest_first = search.strip().casefold(), sorted(dated, reverse=True)
    return [
        path.stem
        for changed, path in newest_first
        if not wanted or wanted in _title(path, changed).casefold()
    ]


def recent_projects(home: Path, ids: Iterable[str] | None = None) -> list[Listed]:
    """The entries of these projects, or of all, newest first."""
    wanted = find_projects(home) if ids is None else ids
    return [entry_of(Project(store_of(home, project_id))) for project_id in wanted]


def entry_of(project: Project) -> Listed:
    changed = changed_at(project.database.path)
    try:
        return Listed(project.id, title_of(project), changed, has_interrupted(project.database))
    except DamagedError:
        return Listed(project.id, "", changed, damaged=True)
    except StereocalError as error:
        return Listed(project.id, "", changed, unreadable=str(error))


def removed_projects(home: Path) -> list[Listed]:
    """The removed projects, the one removed last first, damaged ones included."""
    dated = [(removed_at(home, store.path.stem), store.path) for store in _stores(home)]
    removed = sorted(((when, path) for when, path in dated if when is not None), reverse=True)
    return [Listed(path.stem, _title(path, changed_at(path)), when) for when, path in removed]


def removed_at(home: Path, project_id: str) -> float | None:
    """When a project was removed, in seconds since 1970; None if it was not."""
    try:
        store = store_of(home, project_id)
        return store.marker.stat().st_mtime if store.path.exists() else None
    except (OSError, StereocalError):
        return None


def changed_at(path: Path) -> float:
    """When a project's file was last changed, in seconds since 1970; 0 if it is gone."""
    newest = 0.0
    for name in (path.name, f"{path.name}-wal"):
        with suppress(OSError):
            newest = max(newest, path.with_name(name).stat().st_mtime)
    return newest


def duplicate(home: Path, project_id: str) -> Project:
    """A copy under a new id, with all that travels."""
    source = Project.open(home, project_id)
    check_quota(source.database.size)

    def fill(database: Store) -> None:
        with database.transaction():
            for key, entry in CONTENTS.items():
                if entry.stays:
                    database.forget_all(key)
        Project(database).rename(f"{title_of(source)} (copy)")

    return Project(new_database(home, fill, lambda path: copy_database(source.database, path)))


def copy_database(database: Store, path: Path) -> None:
    """Back up a project to another file. Copying an open file would not be safe."""
    with database.reading() as db:
        db.execute("ROLLBACK")
        db.execute("VACUUM INTO ?", [str(path)])
    set_journal(path)


def remove(home: Path, project_id: str) -> None:
    """Mark a project as removed, even a damaged one; `bring_back` undoes it."""
    store = store_of(home, project_id)
    if not store.path.exists() or store.marker.exists():
        raise StereocalError(NOT_THERE)
    with disk_errors("The project cannot be removed"):
        store.marker.touch()
        flush_folder(store.path.parent)


def bring_back(home: Path, project_id: str) -> Project:
    if removed_at(home, project_id) is None:
        raise StereocalError(AGAIN)
    store = store_of(home, project_id)
    with suppress(OSError):
        os.utime(store.path)  # else the sweep would remove it again as unused
        store.marker.unlink(missing_ok=True)
        flush_folder(store.path.parent)
    return Project.open(home, project_id)


def delete(home: Path, project_id: str) -> None:
    """Delete a removed project for good."""
    if removed_at(home, project_id) is None:
        raise StereocalError(AGAIN)
    store = store_of(home, project_id)
    with disk_errors("The project cannot be deleted"):
        remove_database(store.path)
        store.marker.unlink(missing_ok=True)


def sweep(home: Path, removed_days: float, unused_days: float = math.inf) -> int:
    """Delete projects removed `removed_days` ago; remove those unchanged for `unused_days`.

    Unused contents and files left by killed servers are deleted once they are a day old.

    Returns:
        The number of projects removed or deleted.
    """
    now, count = time.time(), 0
    folder = private_folder(home / "projects")
    for store in _stores(home):
        removed, changed = removed_at(home, store.path.stem), changed_at(store.path)
        since, days, act = (
            (changed, unused_days, remove) if removed is None else (removed, removed_days, delete)
        )
        with suppress(StereocalError):
            if now - since > days * DAY_S:
                act(home, store.path.stem)
                count += 1
            elif removed is None:
                store.free_unnamed(now - DAY_S)
    shutil.rmtree(home / "servers", ignore_errors=True)  # locks of an earlier version
    for path in folder.iterdir():
        alone = path.suffix == REMOVED and not path.with_suffix(SUFFIX).exists()
        with suppress(OSError):
            if (alone or path.name.startswith(WAITING)) and path.stat().st_mtime < now - DAY_S:
                path.unlink()
    return count


def _stores(home: Path) -> list[Store]:
    """The stores of all projects, removed ones included; none if the folder cannot be read."""
    try:
        paths = (home / "projects").glob(f"*{SUFFIX}")
        return [Store(path) for path in paths if is_id(path.stem)]
    except OSError:
        return []


def _title(path: Path, changed: float) -> str:
    """The title of a project as it was at that change; empty if it cannot be read."""

    def read() -> str:
        try:
            return title_of(Project(Store(path)))
        except StereocalError:
            return ""

    return once("title", f"{path} {changed}", read)


@dataclass(frozen=True)
class Card:
    """A project in two lines."""

    data: str
    result: str


def card_of(project: Project) -> Card:
    if project.is_rig:
        return Card(f"{project.camera_count} cameras", _rig_of(project))
    dataset = project.dataset
    if dataset is not None:
        data = count(len(dataset.correspondences.frames), "frame")
    else:
        has_points = "correspondences" in project.inputs.files
        usual = "points, data incomplete" if has_points else "no points yet"
        data = _photographs_of(project) or usual
    return Card(data, _result_of(project))


def _rig_of(project: Project) -> str:
    """The errors of three cameras and more."""
    if (rig := project.rig) is None:
        return "not calibrated"
    figures, pairs = rig.about.figures, rig.about.pairs
    assert figures is not None, "a project's rig has a recording"
    noise = [(pair.noise_px, name) for name, pair in pairs.items() if pair.noise_px is not None]
    worst, name = max(noise, default=(0.0, ""))
    worst_pair = f", worst pair {name} with {rounded(worst)} px" if name else ""
    metric = figures.metric_error_p95
    metres = "" if metric is None else f", lengths in metres to {percent(metric)} % (95 %)"
    return f"One rig: {rig_errors_in_words(figures)}{metres}{worst_pair}"


def title_of(project: Project) -> str:
    """The user's name for a project; without one, its data and the day of its first file."""
    with project.database.reading():
        inputs = project.inputs
        if inputs.name:
            return inputs.name
        name = Path(inputs.labels.get("correspondences", TABLE_LABEL)).stem
        if name in FOUND_LABELS:
            points = [file.label for file in project.database.files(POINT_FILES).values()]
            files = [*points, *inputs.labels.values(), *project.database.files(PARTS)]
            given_labels = (label for label in files if label not in FOUND_LABELS)
            name = _photographs_of(project) or next(given_labels, "Nothing yet")
        ((first_stored,),) = project.database.rows("SELECT min(stored) FROM file")
    begun = datetime.fromtimestamp(first_stored or project.database.path.stat().st_mtime)
    return f"{name}, {begun.astimezone().strftime('%Y-%m-%d')}"


def _photographs_of(project: Project) -> str:
    photographs = len(ProjectPhotographs(project).photographs)
    of_what = "of a board" if BOARDS_LABEL in project.inputs.labels.values() else ""
    return f"{count(photographs, 'photograph')} {of_what}".rstrip() if photographs else ""


def _result_of(project: Project) -> str:
    """The errors of the sets to use, each at its own job, on held-out frames."""
    if (answer := project.answer) is None:
        return "not calibrated"
    if answer.evaluation is None:
        return "calibrated, not validated"
    to_use = project.recommended or PAPER_SETS
    match, measure = (
        figures_of(method, answer.run.calibration, None, answer.validation) for method in to_use
    )
    lengths, wrong = (
        "unknown" if value is None else f"{percent(value)} %"
        for value in (measure.metric_p95.held_out, match.wrong_let_in.held_out)
    )
    names = " and ".join(dict.fromkeys(METHOD_NAMES[file.method] for file in (match, measure)))
    bar, metric = bar_known(answer.run.calibration, None), measure.metric_p95.held_out
    mostly = f", mostly by the {bar.word}" if metric and 2 * bar.p95**2 > metric**2 else ""
    within = f"95 % of lengths in metres within {lengths}{mostly}"
    return f"{names}, held out: {within}, {wrong} of wrong pairs accepted"
