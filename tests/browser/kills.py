"""The real server is killed at random moments while people work: is anything lost?

    python -m tests.browser.kills --kills 200 --seed 0

Each time, a session does one thing over and over (`kill_activities`) on a server that gets SIGKILL
at a random moment. Then, on the same disk: the library opens the project and finds everything that
a page had acknowledged; a new server starts, and the project opens on its page without an error. At
the end all projects are opened once more.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
import tempfile
import threading
import time
import traceback
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.camera_file import write_camera
from stereocal.projects.home import duplicate, recent_projects
from stereocal.projects.project import Project
from tests.bar_photographs import BAR_M, bar_set
from tests.browser.client import PageError, Session
from tests.browser.kill_activities import (
    ACTIVITIES,
    PHOTOGRAPHED,
    Activity,
    Ledger,
    photographs,
    value_of,
)
from tests.browser.server import Server

WRONG = ("cannot be read", "damaged", "another version", "no project at this address", "unforeseen")
COLUMNS = (
    "kills",
    "acknowledged",
    "lost",
    "not opening",
    "page errors",
    "shown as interrupted",
    "of them with parts",
    "gone on to the end",
    "offered though done",
    "processes left",
)


class Trial:
    """A home on disk, the servers on it one after the other, and what came of each kill."""

    def __init__(self, home: Path, seed: int, log: Path | None) -> None:
        self.home, self.log = home, log
        self.rng = np.random.default_rng(seed)
        self.counts: dict[str, Counter[str]] = defaultdict(Counter)
        self.ledgers: list[tuple[str, Ledger]] = []
        self.problems: list[str] = []
        self.server = Server(home, log=log)
        self.bases = self._prepare()

    def _prepare(self) -> dict[str, str]:
        """Projects to go on with, made through the pages."""
        session = Session(self.server.url)
        session.open()
        session.press("demo")
        session.wait_for("50 pairs of points")
        bases = {"points": str(session.project)}
        session.close()
        session = Session(self.server.url)
        session.open("data")
        session.choose("data_how", "Photographs")
        session.upload("upload_photographs_", list(photographs().items()))
        for slot in ("primary", "secondary"):
            camera = write_camera(getattr(bar_set(PHOTOGRAPHED).rig, slot))
            session.upload(f"upload_{slot}", [(f"{slot}.json", camera)])
        session.type_number("baseline_m_value", 2.0)
        session.type_number("target_distance_m_value", BAR_M)
        bases["unfound"] = duplicate(self.home, str(session.project)).id
        session.press("find_targets")
        session.wait_for(f"{PHOTOGRAPHED} frames: ")
        bases["found"] = str(session.project)
        self.found = value_of(Project.open(self.home, bases["found"]), ("review",))
        session.close()
        return bases

    def kill_during(self, name: str) -> None:
        """One kill while `name` is done; then a new server, and the project on its page."""
        activity = ACTIVITIES[name]
        ledger = Ledger(self.home, found=self.found)
        if activity.base:
            ledger.project = duplicate(self.home, self.bases[activity.base]).id
        broken: list[str] = []
        thread = threading.Thread(target=_work, args=(self.server.url, activity, ledger, broken))
        moment = self.rng.uniform(0.0, activity.longest_s)
        thread.start()
        ledger.started.wait(30)
        time.sleep(moment)
        self.server.kill()
        thread.join(60)
        count = self.counts[name]
        count["kills"] += 1
        count["processes left"] += self.server.kill_left()
        count["acknowledged"] += ledger.acknowledged
        for text in broken:
            self._wrong(name, "page errors", ledger, text)
        self.ledgers.append((name, ledger))
        self.check_disk(name, ledger)
        self.server = Server(self.home, log=self.log)
        self.check_page(name, ledger)

    def check_disk(self, name: str, ledger: Ledger) -> None:
        """Everything that was acknowledged is there, and all of the project can be read."""
        if not ledger.project:
            return
        try:
            project = Project.open(self.home, ledger.project)
            _ = project.dataset, project.calibration, project.evaluation
            (found,) = project.database.rows("PRAGMA integrity_check")
            if found != ("ok",):
                self._wrong(name, "not opening", ledger, str(found))
        except StereocalError as error:
            self._wrong(name, "not opening", ledger, str(error))
            return
        for item in ledger.kept.keys() | ledger.doing.keys():
            value = value_of(project, item)
            either = [ledger.kept.get(item)]
            either += [ledger.doing[item]] if item in ledger.doing else []
            if value not in either:
                self._wrong(name, "lost", ledger, f"{item} is {value}, not {either}"[:600])

    def check_page(self, name: str, ledger: Ledger) -> None:
        """The project opens on the page of the new server."""
        if not ledger.project:
            return
        session = Session(self.server.url)
        try:
            session.open(ACTIVITIES[name].page, f"project={ledger.project}")
            text = session.text
            for said in WRONG:
                if said in text:
                    self._wrong(name, "not opening", ledger, text)
            for missing in _unseen(session, ledger):
                self._wrong(name, "lost", ledger, f"{missing} is not on the page:\n{text}")
            self._go_on(name, ledger, session)
        except PageError as error:
            self._wrong(name, "not opening", ledger, str(error))
        finally:
            session.close()

    def _go_on(self, name: str, ledger: Ledger, session: Session) -> None:
        """A job that was interrupted says so and can be finished with what it had."""
        kind = ACTIVITIES[name].job
        if not kind or not session.has(f"go_on_{kind}"):
            return
        item = next((item for item in ledger.doing if item[0] in ("evaluation", "review")), None)
        if item is None:  # it was there, and its server was killed before the job was struck off
            self.counts[name]["offered though done"] += 1
            return
        found = re.search(r"(\d+) of \d+", session.text)
        self.counts[name]["shown as interrupted"] += 1
        self.counts[name]["of them with parts"] += bool(found and int(found[1]))
        session.press(f"go_on_{kind}")
        end = time.monotonic() + 60
        project = Project.open(self.home, ledger.project)
        while value_of(project, item) != ledger.doing[item]:
            if time.monotonic() > end:
                self._wrong(name, "lost", ledger, f"not finished:\n{session.text}")
                return
            session.rest(0.2)
        ledger.done()
        self.counts[name]["gone on to the end"] += 1

    def _wrong(self, name: str, column: str, ledger: Ledger, text: str) -> None:
        self.counts[name][column] += 1
        self.problems.append(f"{name}, {column}, project {ledger.project}: {text}")
        print(self.problems[-1], file=sys.stderr)

    def finish(self) -> str:
        """All projects once more, and what lies about."""
        for name, ledger in self.ledgers:
            self.check_disk(name, ledger)
            self.check_page(name, ledger)
        self.server.stop()
        files = list((self.home / "projects").glob("[!.]*.sqlite"))
        known = {ledger.project for _, ledger in self.ledgers} | set(self.bases.values())
        listed = {one.id for one in recent_projects(self.home)}
        others = {path for path in self.home.rglob("*") if path.is_file()} - set(files)
        kinds = Counter(re.sub("[0-9a-f]{16,}", "*", path.name) for path in others)
        return (
            f"{len(files)} projects, {len(listed)} in the list of recent projects; of the "
            f"{len(known - {''})} whose address somebody knew, {len(known - {''} - listed)} are "
            f"not in the list. Other files: {dict(kinds)}."
        )


def _work(url: str, activity: Activity, ledger: Ledger, broken: list[str]) -> None:
    session = None
    try:
        session = Session(url)
        activity.act(session, ledger)
    except (PageError, StereocalError, AssertionError, KeyError, IndexError):
        broken.append(traceback.format_exc())
    except Exception:
        return  # the server is gone, which is what this is about
    finally:
        if session is not None:
            session.close()


def _unseen(session: Session, ledger: Ledger) -> Iterator[str]:
    """What was acknowledged and stands on the page no more."""
    for (name,), value in ledger.kept.items():
        if (name,) in ledger.doing:
            continue
        if name in ("correspondences", "primary", "secondary"):
            words = f"In use: {value[0]}"
        elif name == "calibration":
            words = f"seed {value}, essential"
        elif name == "evaluation":
            words = f"{value[0]} runs, "
        else:
            continue
        if words not in session.text:
            yield words


def table_of(counts: dict[str, Counter[str]]) -> str:
    """A line for each activity, and their sum."""
    lines = [f"| while | {' | '.join(COLUMNS)} |", "|---" * (len(COLUMNS) + 1) + "|"]
    total: Counter[str] = Counter()
    for name, count in counts.items():
        total.update(count)
        lines.append(f"| {name} | {' | '.join(str(count[column]) for column in COLUMNS)} |")
    lines.append(f"| all | {' | '.join(str(total[column]) for column in COLUMNS)} |")
    return "\n".join(lines)


def main() -> int:
    """Kill, check, print; 1 if anything was lost."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=list(ACTIVITIES))
    parser.add_argument("--log", type=Path, help="where the servers' output goes")
    options = parser.parse_args()
    names = [options.only] if options.only else list(ACTIVITIES)
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as home:
        trial = Trial(Path(home), options.seed, options.log)
        for at in range(options.kills):
            trial.kill_during(names[at % len(names)])
            if at % 20 == 19:
                print(f"{at + 1} kills:\n{table_of(trial.counts)}", flush=True)
        left = trial.finish()
    print(
        f"{options.kills} kills, seed {options.seed}, in {time.monotonic() - begun:.0f} s; load "
        f"{os.getloadavg()[0]:.1f} at the end."
    )
    print(table_of(trial.counts))
    print(left)
    return int(bool(trial.problems))


if __name__ == "__main__":
    sys.exit(main())
