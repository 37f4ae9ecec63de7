"""What people do while the server is killed (`kills`), and what each page acknowledged.

An activity goes on until its session breaks off. It notes before each act what the project will
then hold, and after the page's answer that it must hold it from now on, whatever happens.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import count
from pathlib import Path
from threading import Event
from typing import Any

import cv2
import numpy as np

from stereocal.formats.camera_file import write_camera
from stereocal.formats.correspondences_csv import write_table
from stereocal.formats.dataset_files import DESCRIPTION, pack_dataset
from stereocal.frames.frame import Centre, Frame
from stereocal.frames.review import Review, choose, place, swap, target_meant, undo
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import read_review
from stereocal.rig.dataset import Dataset
from stereocal.simulation.simulate import FIELD_BAR_M, field_rig, observe, place_bars
from stereocal.system.zip_files import pack_zip
from tests.bar_photographs import bar_set
from tests.browser.client import Session

Item = tuple[str, ...]
PHOTOGRAPHED = 7
LONG_RUNS = 500


@dataclass
class Ledger:
    """What a project must hold: what pages have acknowledged, or what was under way instead."""

    home: Path
    project: str = ""
    found: Any = None
    """What the search for targets finds in the prepared photographs."""
    kept: dict[Item, Any] = field(default_factory=dict)
    doing: dict[Item, Any] = field(default_factory=dict)
    acknowledged: int = 0
    started: Event = field(default_factory=Event)
    """Set when the first act begins."""

    def begin(self, **items: Any) -> None:
        """From now on each may be so."""
        self.doing = {(name,): value for name, value in items.items()}
        self.started.set()

    def done(self) -> None:
        """A page has shown it: from now on all must be so."""
        self.kept |= self.doing
        self.acknowledged += len(self.doing)
        self.doing = {}


Act = Callable[[Session, Ledger], None]


@cache
def dataset(seed: int, frames: int = 25) -> Dataset:
    """A small rig's table of points."""
    rng = np.random.default_rng(seed)
    scene = place_bars(field_rig(4.5 + 0.01 * seed), rng, frames, FIELD_BAR_M)
    return observe(scene, rng, 0.15, f"zip_{seed}")


@cache
def photographs(first: int = 0) -> dict[str, bytes]:
    """Pairs of the bar by name, the numbers from `first`."""
    found = {}
    for pair in bar_set(PHOTOGRAPHED).pairs:
        for side, image in (("left", pair.primary), ("right", pair.secondary)):
            content = cv2.imencode(".png", image)[1].tobytes()
            found[f"{side}{first + pair.frame:03}.png"] = content
    return found


def digest(content: bytes) -> str:
    """Of a file's content."""
    return hashlib.sha256(content).hexdigest()


def value_of(project: Project, item: Item) -> Any:
    """What a project on disk holds of an item, read by the library."""
    (name,) = item
    inputs = project.inputs
    if name in ("baseline_m", "target_distance_m"):
        return getattr(inputs, name)
    if name in ("correspondences", "primary", "secondary"):
        if name not in inputs.files:
            return None
        return inputs.labels[name], inputs.files[name]
    if name == "zip":
        there = ProjectPhotographs(project).photographs
        names = ",".join(sorted(there)) or ("points" if project.table else "nothing")
        return inputs.name, inputs.baseline_m, names
    if name.startswith("photograph "):
        photograph = ProjectPhotographs(project).photographs.get(name.split(" ")[1])
        return photograph and digest(photograph.read_bytes())
    if name == "review":
        frames = ProjectPhotographs(project).frames
        return frames and frames_of(frames)
    if name == "calibration":
        found = project.calibration
        return found and found.settings.search.seed
    if name == "evaluation":
        last = project.evaluation
        return last and (last.settings.runs, last.settings.calibration.search.seed)
    return project.settings.get(name)


def frames_of(frames: Sequence[Frame]) -> list[Any]:
    """What a review has made of the frames."""
    return [
        (frame.frame, frame.use, [[c and (c.u, c.v) for c in row] for row in frame.centres])
        for frame in frames
    ]


# Uploads


def tables(session: Session, ledger: Ledger) -> None:
    """One table after the other, into the same project."""
    session.open("data")
    for seed in count():
        label, content = f"table_{seed}.csv", write_table(dataset(seed).correspondences)
        ledger.begin(correspondences=(label, digest(content)))
        session.upload("upload_correspondences", [(label, content)])
        ledger.project = session.project or ledger.project
        session.wait_for(f"In use: {label}")
        ledger.done()


def cameras(session: Session, ledger: Ledger) -> None:
    """Camera files by turns."""
    session.open("data")
    for seed in count():
        for slot in ("primary", "secondary"):
            camera = getattr(field_rig(4.5), slot)
            content = write_camera(camera) + b"\n" * seed
            label = f"{slot}_{seed}.json"
            ledger.begin(**{slot: (label, digest(content))})
            session.upload(f"upload_{slot}", [(label, content)])
            ledger.project = session.project or ledger.project
            session.wait_for(f"In use: {label}")
            ledger.done()


def lengths(session: Session, ledger: Ledger) -> None:
    """The two lengths by turns."""
    session.open("data")
    for number in count(1):
        for name, value in (("baseline_m", 4.0 + number / 64), ("target_distance_m", number / 64)):
            ledger.begin(**{name: value})
            session.type_number(f"{name}_value", value, f"type {name}")
            ledger.project = session.project or ledger.project
            ledger.done()


def batches(session: Session, ledger: Ledger) -> None:
    """Photographs, a few at a time."""
    session.open("data")
    session.choose("data_how", "Photographs")
    there = 0
    for first in count(0, PHOTOGRAPHED):
        files = list(photographs(first).items())
        for start in range(0, len(files), 5):
            batch = files[start : start + 5]
            ledger.begin(**{f"photograph {name}": digest(content) for name, content in batch})
            session.upload("upload_photographs_", batch)
            ledger.project = session.project or ledger.project
            there += len(batch)
            session.wait_for(f"{there} photographs.")
            ledger.done()


def zips(session: Session, ledger: Ledger) -> None:
    """Zips by turns, with points and with photographs; each takes the place of the last."""
    session.open("data")
    for seed in count():
        session.choose("data_how", "A zip")
        files, names = pack_dataset(dataset(seed)), "points"
        if seed % 2:
            files = {name: files[name] for name in (DESCRIPTION, "primary.json", "secondary.json")}
            shown = photographs(100 * seed)
            names = ",".join(sorted(shown))
            files |= shown
        baseline = dataset(seed).baseline_m
        ledger.begin(zip=(f"zip_{seed}", baseline, names))
        session.upload("upload_zip", [(f"zip_{seed}.zip", pack_zip(files))])
        ledger.project = session.project or ledger.project
        session.wait_for("14 photographs." if seed % 2 else "50 pairs of points")
        ledger.done()


# Corrections


def corrections(session: Session, ledger: Ledger) -> None:
    """Clicks, exchanges, choices and undos in the review of photographs."""
    store = ProjectPhotographs(Project.open(ledger.home, ledger.project))
    session.open("data", f"project={ledger.project}")
    session.choose("frames_view", "One frame")
    numbers = sorted(frame.frame for frame in store.frames or [])
    for turn in count():
        number = numbers[turn % len(numbers)]
        for edit in _edits(store, session, number, turn):
            after = edit.change(read_review(store))
            ledger.begin(review=frames_of(after.frames))
            edit.act()
            session.wait_for(edit.said)
            ledger.done()
        session.press("review_previous" if number == numbers[-1] else "review_next")
        if number == numbers[-1]:
            for _ in numbers[2:]:
                session.press("review_previous")


@dataclass(frozen=True)
class _Edit:
    act: Callable[[], None]
    said: str
    change: Callable[[Review], Review]


def _edits(store: ProjectPhotographs, session: Session, number: int, turn: int) -> Iterator[_Edit]:
    u, v = 100.0 + turn / 8, 60.0
    raw = Centre(u, v, None, "manual")
    (name, _) = read_review(store).frame(number).files
    click = {"id": store.photographs[name].name, "u": u, "v": v, "raw": True}
    yield _Edit(
        lambda: session.click("pick_primary", "picked", click, "click in a photograph"),
        f"is now where you clicked, ({u:.2f}, {v:.2f})",
        lambda now: place(now, number, 0, target_meant(now.frame(number), 0, raw), raw),
    )
    yield _Edit(
        lambda: session.press("swap_secondary"),
        "A and B are exchanged in the secondary photograph.",
        lambda now: swap(now, number, 1),
    )
    yield _Edit(
        lambda: session.press("review_leave"),
        "It is left out.",
        lambda now: choose(now, number, False),
    )
    if turn % 2:
        yield _Edit(lambda: session.press("review_undo"), "The last change is undone.", undo)


# Long work


def calibration(session: Session, ledger: Ledger) -> None:
    """One calibration after the other, each with its own seed."""
    session.open("calibrate", f"project={ledger.project}")
    for seed in count(1):
        _setting(session, ledger, "seed", seed)
        ledger.begin(calibration=seed)
        session.press("run", "calibrate")
        session.wait_for(f"seed {seed}, essential")
        ledger.done()


def validation(session: Session, ledger: Ledger) -> None:
    """Short validations, which follow the slider."""
    ledger.begin(evaluation=(100, 0))
    session.open("validate", f"project={ledger.project}")
    session.wait_for("100 runs, 20 calibration")
    ledger.done()
    for turn in count():
        runs = 10 + 10 * (turn % 9)
        ledger.begin(validate_runs=runs, evaluation=(runs, 0))
        session.slide("validate_runs", runs)
        session.wait_for(f"{runs} runs, 20 calibration")
        ledger.done()


def long_validation(session: Session, ledger: Ledger) -> None:
    """Validations that run beside the page."""
    Project.open(ledger.home, ledger.project).keep_settings({"validate_runs": LONG_RUNS})
    session.open("validate", f"project={ledger.project}")
    for seed in count(1):
        _setting(session, ledger, "seed", seed)
        ledger.begin(evaluation=(LONG_RUNS, seed))
        session.press("validate")
        session.wait_for(f"{LONG_RUNS} runs, 20 calibration")
        session.wait_for(f"seed {seed}, essential")
        ledger.done()


def detection(session: Session, ledger: Ledger) -> None:
    """The search for targets, again and again."""
    session.open("data", f"project={ledger.project}")
    for _ in count():
        ledger.begin(review=ledger.found)
        session.press("find_targets")
        while session.has("cancel_photographs"):
            session.rest(0.2)
        session.wait_for(f"{PHOTOGRAPHED} frames: ")
        ledger.done()


def _setting(session: Session, ledger: Ledger, key: str, value: int) -> None:
    ledger.begin(**{key: value})
    session.type_number(key, value)
    ledger.done()


@dataclass(frozen=True)
class Activity:
    """What is done, where, and with what."""

    act: Act
    page: str
    base: str
    """Which prepared project it goes on with; empty for a new one."""
    longest_s: float
    """It is killed at a random moment within so many seconds of its first act."""
    job: str = ""
    """The kind of long work that it begins."""


ACTIVITIES = {
    "upload a table": Activity(tables, "data", "", 2.5),
    "upload cameras": Activity(cameras, "data", "", 4.0),
    "type lengths": Activity(lengths, "data", "", 2.0),
    "upload photographs": Activity(batches, "data", "", 8.0),
    "upload zips": Activity(zips, "data", "", 10.0),
    "correct targets": Activity(corrections, "data", "found", 3.0),
    "calibrate": Activity(calibration, "calibrate", "points", 2.0),
    "validate": Activity(validation, "validate", "points", 6.0),
    "validate, long": Activity(long_validation, "validate", "points", 8.0, "evaluation"),
    "find targets": Activity(detection, "data", "unfound", 8.0, "photographs"),
}
