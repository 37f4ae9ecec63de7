"""Many people at once on one shared server: does everyone get the numbers of their own data?

    python -m benchmarks.sessions --sessions 20

Each session has a rig of its own. A third gives photographs and has the targets found, the others
give a table; all give cameras and lengths, calibrate, validate and download. All begin at the same
moment and nobody pauses. What comes down is compared with what the library gives for the same data.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
import tempfile
import threading
import time
import traceback
from collections import defaultdict
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from tests.browser.client import Session
from tests.browser.server import MemoryWatch, Server

from stereocal.calibration.methods import CalibrationSettings
from stereocal.evaluation.evaluate import EvaluationSettings, evaluate
from stereocal.evaluation.summary import summarise, summarise_all
from stereocal.formats.camera_file import read_camera, write_camera
from stereocal.formats.correspondences_csv import read_table, write_table
from stereocal.formats.evaluation_files import summary_json, validation_figures
from stereocal.frames.frame import correspondences_of
from stereocal.frames.pairing import pair_names
from stereocal.frames.search import detect_frames
from stereocal.projects.photographs import TABLE_LABEL
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.dataset import Dataset
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import FIELD_BAR_M, field_rig, observe, place_bars
from stereocal.workflow import calibrate
from tests.bar_photographs import BOARD_M, DEPTHS_M, small
from tools.photographs.bars import BarSettings, photograph_bars, place_visible_bars
from tools.photographs.rendering import PhotographSettings

FRAMES, PHOTOGRAPHED = 25, 14
LABELS = re.compile(r"(?:points|primary|secondary|left|right)_(\d\d)")
Downloads = Mapping[str, Any]


@dataclass(frozen=True)
class Person:
    """What one visitor brings: all files and lengths follow from the number."""

    number: int

    @property
    def has_photographs(self) -> bool:
        """Every third one."""
        return self.number % 3 == 0

    @cached_property
    def rig(self) -> Rig:
        """Small cameras for photographs, so that rendering them all takes a minute."""
        rig = field_rig((2.0 if self.has_photographs else 4.0) + 0.037 * self.number)
        if not self.has_photographs:
            return rig
        return Rig(small(rig.primary), small(rig.secondary), rig.pose)

    @property
    def bar_m(self) -> float:
        """Distance of the targets."""
        return FIELD_BAR_M + 0.001 * self.number

    @property
    def name(self) -> str:
        """Of the data set."""
        return TABLE_LABEL if self.has_photographs else f"points_{self.number:02}"

    @cached_property
    def cameras(self) -> dict[str, bytes]:
        """The camera files."""
        return {
            "primary": write_camera(self.rig.primary),
            "secondary": write_camera(self.rig.secondary),
        }

    @cached_property
    def table(self) -> bytes:
        """The table of points, for those without photographs."""
        rng = np.random.default_rng([self.number, 5])
        scene = place_bars(self.rig, rng, FRAMES, self.bar_m)
        return write_table(observe(scene, rng, 0.15, self.name).correspondences)

    @cached_property
    def photographs(self) -> list[tuple[str, bytes]]:
        """Pairs of 584 x 432 px."""
        rng = np.random.default_rng([self.number, 6])
        scene = place_visible_bars(
            self.rig, rng, PHOTOGRAPHED, self.bar_m, BOARD_M, depths_m=DEPTHS_M, margin_px=40.0
        )
        files = []
        bar = BarSettings(board_m=BOARD_M)
        for pair in photograph_bars(scene, (110.0, 110.0), bar, PhotographSettings(), rng):
            for side, image in (("left", pair.primary), ("right", pair.secondary)):
                content = cv2.imencode(".png", image)[1].tobytes()
                files.append((f"{side}_{self.number:02}_{pair.frame:03}.png", content))
        return files

    def expected(self) -> Downloads:
        """What the library gives for these data."""
        dataset = self._dataset()
        calibration = calibrate(dataset, CalibrationSettings())
        frames = len(dataset.correspondences.frames)
        settings = EvaluationSettings(CalibrationSettings(), 100, 4 * frames // 5, RefineSettings())
        with ThreadPoolExecutor(1) as executor:
            runs = evaluate([dataset], settings, executor)
        assert runs is not None
        figures = validation_figures(summarise(runs), settings)
        pooled, single = summarise_all([dataset.name], runs, 0.1)
        summary = summary_json(pooled, single, [dataset], settings)
        return {
            "2d": json.loads(calibration.parameters("2d", figures["2d"]).dumps()),
            "3d": json.loads(calibration.parameters("3d", figures["3d"]).dumps()),
            "summary": json.loads(summary),
        }

    def _dataset(self) -> Dataset:
        table = self._found() if self.has_photographs else self.table
        return Dataset(
            self.name,
            read_camera(self.cameras["primary"], "primary"),
            read_camera(self.cameras["secondary"], "secondary"),
            read_table(table, self.name).strict(self.name),
            self.rig.pose.baseline,
            self.bar_m,
        )

    def _found(self) -> bytes:
        with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(1) as executor:
            paths = {name: Path(folder) / name for name, _ in self.photographs}
            for name, content in self.photographs:
                paths[name].write_bytes(content)
            frames = detect_frames(
                pair_names(paths).pairs,
                paths,
                (self.rig.primary, self.rig.secondary),
                executor,
                lambda _stage: None,
                lambda _done, _total: None,
            )
        assert frames is not None
        return write_table(correspondences_of(frames))


@dataclass
class Visit:
    """What came of a session."""

    person: Person
    downloads: Downloads
    project: str | None
    timings: list[tuple[str, float]]
    seconds: float
    strangers: set[str]
    """Numbers of others that were seen on a page."""
    failure: str = ""


def visit(url: str, person: Person, start: threading.Barrier) -> Visit:
    """Everything one person does, without a pause."""
    start.wait()
    begun, downloads = time.monotonic(), dict[str, Any]()
    strangers: set[str] = set()
    failure, project = "", None
    session = Session(url)

    def look() -> None:
        strangers.update(set(LABELS.findall(session.text)) - {f"{person.number:02}"})

    try:
        session.open("data")
        _give(session, person)
        look()
        project = session.project
        session.go("calibrate")
        session.press("run", "calibrate")
        session.wait_for("for both")
        look()
        before = time.monotonic()
        session.go("validate")
        session.wait_for("Made with: ")
        session.timings.append(("validate 100 runs", time.monotonic() - before))
        look()
        downloads["summary"] = json.loads(session.download("download_summary"))
        report = session.download("download_report").decode()
        strangers |= set(LABELS.findall(report)) - {f"{person.number:02}"}
        downloads["report"] = report[:200_000]
        session.go("calibrate")
        for method in ("2d", "3d"):
            downloads[method] = json.loads(session.download(f"download_{method}"))
        look()
    except Exception:
        failure = traceback.format_exc()
    seconds = time.monotonic() - begun
    session.close()
    return Visit(person, downloads, project, session.timings, seconds, strangers, failure)


def _give(session: Session, person: Person) -> None:
    number = f"{person.number:02}"
    if person.has_photographs:
        session.choose("data_how", "Photographs", "choose the kind of data")
        session.upload("upload_photographs_", person.photographs, "upload 28 photographs")
        session.wait_for("28 photographs.")
    else:
        table = (f"points_{number}.csv", person.table)
        session.upload("upload_correspondences", [table], "upload a table")
        session.wait_for(f"In use: points_{number}.csv")
    for slot, content in person.cameras.items():
        session.upload(f"upload_{slot}", [(f"{slot}_{number}.json", content)], "upload a camera")
        session.wait_for(f"In use: {slot}_{number}.json")
    session.type_number("baseline_m_value", person.rig.pose.baseline, "type a length")
    session.type_number("target_distance_m_value", person.bar_m, "type a length")
    if person.has_photographs:
        begun = time.monotonic()
        session.press("find_targets", "press Find the targets")
        session.wait_for(f"{PHOTOGRAPHED} frames: ")
        session.timings.append(("find the targets, 28 photographs", time.monotonic() - begun))
    session.wait_for("pairs of points in")


def differences(visit: Visit, expected: Downloads) -> list[str]:
    """Where what came down is not what the library gives; bit by bit, but for the date."""
    found = []
    for what, wanted in expected.items():
        got = visit.downloads.get(what)
        if got is None:
            found.append(f"{what}: missing")
            continue
        for content in (got, wanted):
            content.pop("created", None)
        if got != wanted:
            found.extend(_paths(got, wanted, what))
    if visit.person.name not in visit.downloads.get("report", ""):
        found.append("report: another name")
    return found


def _paths(got: Any, wanted: Any, where: str) -> list[str]:
    if isinstance(got, dict) and isinstance(wanted, dict) and got.keys() == wanted.keys():
        return [text for key in got for text in _paths(got[key], wanted[key], f"{where}.{key}")]
    if isinstance(got, list) and isinstance(wanted, list) and len(got) == len(wanted):
        pairs = zip(got, wanted, strict=True)
        return [text for n, (a, b) in enumerate(pairs) for text in _paths(a, b, f"{where}[{n}]")]
    return [] if got == wanted else [f"{where}: {str(got)[:60]}, not {str(wanted)[:60]}"]


def table_of(visits: list[Visit]) -> str:
    """Each kind of interaction: how often, median, 95 %, slowest."""
    by_kind: dict[str, list[float]] = defaultdict(list)
    for one in visits:
        for what, seconds in one.timings:
            by_kind[what].append(seconds)
    lines = ["| interaction | n | median | 95 % | slowest |", "|---|---|---|---|---|"]
    for what, values in sorted(by_kind.items(), key=lambda item: -max(item[1])):
        middle, high = np.percentile(values, [50, 95])
        lines.append(f"| {what} | {len(values)} | {middle:.2f} | {high:.2f} | {max(values):.2f} |")
    return "\n".join(lines)


def main() -> int:
    """Run it, print the tables; 1 if anything was not as it must be."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--sessions", type=int, default=20)
    parser.add_argument("--log", type=Path, help="where the server's output goes")
    options = parser.parse_args()
    people = [Person(number) for number in range(options.sessions)]
    for person in people:  # before the clock runs
        _ = person.photographs if person.has_photographs else person.table
    with tempfile.TemporaryDirectory() as home:
        server = Server(Path(home), {"STEREOCAL_SHARED": "1"}, options.log)
        memory = MemoryWatch(server)
        load, begun = os.getloadavg()[0], time.monotonic()
        start = threading.Barrier(len(people))
        with ThreadPoolExecutor(len(people)) as executor:
            visits = list(executor.map(lambda person: visit(server.url, person, start), people))
        seconds = time.monotonic() - begun
        memory.stop()
        server.stop()
    failed = 0
    for one in visits:
        problems = [one.failure] if one.failure else differences(one, one.person.expected())
        if one.strangers:
            problems.append(f"saw what belongs to {sorted(one.strangers)}")
        if problems:
            failed += 1
            print(f"Session {one.person.number}:", *problems[:8], sep="\n  ", file=sys.stderr)
    projects = {one.project for one in visits}
    print(
        f"{len(visits)} sessions, {len(projects)} projects, {len(visits) - failed} with the "
        f"library's numbers to the last bit; all in {seconds:.1f} s, one session "
        f"{min(one.seconds for one in visits):.1f} to {max(one.seconds for one in visits):.1f} s; "
        f"load {load:.1f} before, {os.getloadavg()[0]:.1f} after; server at most "
        f"{memory.peak_mb:.0f} MB at a moment, {memory.high_water_mb:.0f} MB as the kernel counts."
    )
    print(table_of(visits))
    return int(bool(failed) or len(projects) != len(visits))


if __name__ == "__main__":
    sys.exit(main())
