"""What takes how long: compiled code against NumPy and SciPy, Validate, its page, a project's file.

    python -m benchmarks.speed [costs|searches|protocol|refine|growth|sliders|store] [--trials N]

Sides that are compared are measured in turn in one run, and their ratio within each turn: a slow
moment of the computer slows both. Shown are the median and the middle 80 % of the turns.

- costs, searches: one evaluation of 40 correspondences, and a whole search on 25 frames, compiled
  and as fast as NumPy goes, on the sample field, with the same random numbers;
- protocol: 100 runs of one data set and of the nineteen, and 4 runs of 25, 250 and 2,500 frames;
- refine: the joint fit of 2, 3 and 4 cameras, and one `least_squares` in SciPy from the same start
  (`benchmarks.rigs`); both must predict the same images;
- growth: the refined set of 25, 250 and 2,500 frames, CPU time;
- sliders: from a key on a slider of Validate to another figure, in Chromium, with nothing else to
  do and beside processes that keep all cores busy (`--data FOLDER`);
- store: photographs into a project's file and out, settings, 501 projects, a value of 900 MB, a
  disk that fills (a small tmpfs, which needs the rights to mount one); `--folder` is on the disk
  that holds the projects.
"""

import hashlib
import multiprocessing
import os
import resource
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.rigs import against_scipy
from benchmarks.studies import SAMPLES, Asked, run_studies, spread
from stereocal.calibration import costs
from stereocal.calibration.essential import Solver, calibrate_essential
from stereocal.calibration.methods import CalibrationSettings
from stereocal.calibration.montecarlo import Problem, SearchSettings, minimise
from stereocal.errors import StereocalError
from stereocal.evaluation.evaluate import EvaluationSettings, evaluate, evaluate_runs
from stereocal.evaluation.summary import summarise
from stereocal.fit.refine import refine
from stereocal.projects.database import DiskFullError
from stereocal.projects.files import LARGEST
from stereocal.projects.home import delete, recent_projects, remove, sweep
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.rig.compiled import compiled
from stereocal.rig.geometry import Pose, fill_pose
from stereocal.simulation.nineteen import simulate_nineteen
from stereocal.simulation.simulate import simulate_field
from stereocal.system.array_types import FloatArray
from tests.rigs.refined_rigs import Misjudged, random_scene, stated

COST_FRAMES = 20
"""40 correspondences, as the paper calibrates with."""
START_SHIFT = 1e-3 * np.array([0.7, -1.3, 0.9, -1.1, 1.2])
"""The searches start so far (rad) from the essential result: from it, most moves are refused."""
SETTINGS = SearchSettings()
LOOP = 30_000
ROUNDING = 1e-6
"""Relative difference that rounding may make: a length is a small difference of long ones."""
PlainCost = Callable[[FloatArray, FloatArray], float]


def triangulate(R: FloatArray, T: FloatArray, rays: FloatArray) -> FloatArray:
    """Midpoints in the primary frame, shape (3, n); NaN for parallel rays or behind a camera."""
    p, q = np.ones((3, rays.shape[1])), np.ones((3, rays.shape[1]))
    p[:2], q[:2] = rays[:2], rays[2:]
    d = R @ p
    pp, qq, pq = (p * p).sum(axis=0), (q * q).sum(axis=0), (d * q).sum(axis=0)
    pt, qt = T @ d, T @ q
    sine_squared = pp * qq - pq * pq
    s = (pq * qt - qq * pt) / sine_squared
    r = (pp * qt - pq * pt) / sine_squared
    in_secondary = 0.5 * (T[:, None] + s * d + r * q)
    points: FloatArray = R.T @ (in_secondary - T[:, None])
    lost = (sine_squared < 1e-14 * pp * qq) | (points[2] <= 0.0) | (in_secondary[2] <= 0.0)
    if lost.any():
        points[:, lost] = np.nan
    return points


@dataclass(frozen=True, eq=False)
class Case:
    """One cost on one data set, and the pose where it is computed or the search begins."""

    name: str
    problem: Problem
    pose: Pose

    def plain(self, R: FloatArray, T: FloatArray) -> float:
        """The cost in NumPy, a row of numbers at a time: `tests.calibration.reference` is written
        to be right, and a ratio against it would flatter the compiled code."""
        _, rays, given, scale = self.problem
        points = triangulate(R, T, rays)
        if self.name == "3d":
            along = points[:, : given.shape[1]] - points[:, given.shape[1] :]
            return float(np.abs(given[0] - np.sqrt((along * along).sum(axis=0))).sum())
        if self.name == "points":
            off = points - given
            return float(np.sqrt((off * off).sum(axis=0)).sum())
        moved, total = R @ points + T[:, None], 0.0
        for at, seen, (a, b, c) in ((points, rays[:2], scale[0]), (moved, rays[2:], scale[1])):
            shift = at[:2] / at[2] - seen
            u, v = a * shift[0] + b * shift[1], c * shift[1]
            total += float(np.sqrt(u * u + v * v).sum())
        return total

    def compiled_loop(self) -> float:
        """The sum of `LOOP` costs, as the search computes them: no call from Python."""
        return repeat_cost(self.problem, self.pose.R, self.pose.T.copy(), LOOP)

    def plain_cost(self) -> float:
        """The cost in NumPy."""
        return self.plain(self.pose.R, self.pose.T)

    def compiled_search(self) -> tuple[float, int]:
        """A whole search: its last cost and the number of evaluations."""
        found = minimise(self.problem, self.pose, SETTINGS)
        return found.cost, found.evaluations

    def plain_search(self) -> tuple[float, int]:
        """`montecarlo.search` line by line in Python, with the same random numbers; the rotation
        matrix is compiled here too, so that the ratio is that of the cost."""
        rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence(SETTINGS.seed)))
        angles, delta = np.array(self.pose.angles), SETTINGS.delta
        R, T = np.empty((3, 3)), np.empty(3)
        fill_pose(angles, self.pose.baseline, R, T)
        best = self.plain(R, T)
        tried = accepted = moves = 0
        while delta >= SETTINGS.delta_min and moves < SETTINGS.maximum_moves:
            draw = int(rng.integers(0, 10))
            before = angles[draw >> 1]
            angles[draw >> 1] = before + (delta if draw & 1 else -delta)
            fill_pose(angles, self.pose.baseline, R, T)
            candidate = self.plain(R, T)
            tried, moves = tried + 1, moves + 1
            if candidate < best:
                best, accepted = candidate, accepted + 1
            else:
                angles[draw >> 1] = before
            if tried >= SETTINGS.minimum_moves and accepted < SETTINGS.acceptance * tried:
                tried = accepted = 0
                delta *= SETTINGS.shrink
        return best, moves + 1


@compiled
def repeat_cost(problem: Problem, R: FloatArray, T: FloatArray, times: int) -> float:
    """Sum of `times` costs; T moves by 1e-9 m each time, so that no evaluation can be left out."""
    kind, rays, given, pixel_scale = problem
    total = 0.0
    for _ in range(times):
        T[0] += 1e-9
        total += costs.cost(kind, R, T, rays, given, pixel_scale)
    return total


def cases(frames: int, at_truth: bool) -> list[Case]:
    """The three costs of the sample field, at the true pose or beside the essential result."""
    scene, dataset = simulate_field(0)
    start = calibrate_essential(dataset.rays, dataset.baseline_m).pose
    angles = type(start.angles)(*(start.angles + START_SHIFT))
    pose = scene.rig.pose if at_truth else Pose.from_angles(angles, start.baseline)
    rays = np.ascontiguousarray(dataset.rays[:, : 2 * frames])
    ends = np.ascontiguousarray(np.hstack([rays[:, 0::2], rays[:, 1::2]]))  # all A, then all B
    lengths = np.full((1, frames), dataset.target_distance_m)
    points = np.ascontiguousarray(scene.points_m[0][: 2 * frames].T)
    scale = dataset.pixel_scale
    return [
        Case("2d", Problem(costs.REPROJECTION, rays, np.empty((0, 0)), scale), pose),
        Case("3d", Problem(costs.DISTANCE, ends, lengths, scale), pose),
        Case("points", Problem(costs.POINTS, rays, points, scale), pose),
    ]


def seconds_of(act: Callable[[], object], calls: int = 1) -> float:
    """Mean time of one call, in seconds."""
    started = time.perf_counter()
    for _ in range(calls):
        act()
    return (time.perf_counter() - started) / calls


def print_turns(name: str, sides: list[Callable[[], float]], turns: int, unit: float) -> None:
    """A row of the medians of all sides, and the last side's time over those of the others."""
    for side in sides:
        side()  # compiles
    seconds = np.array([[side() for side in sides] for _ in range(turns)])
    times = " | ".join(f"{value:.3g}" for value in np.median(seconds, axis=0) / unit)
    ratios = (spread(seconds[:, -1] / own, 80) for own in seconds.T[:-1])
    print(f"| {name} | {times} | {' | '.join(ratios)} |", flush=True)


def check_same(name: str, first: float, other: float) -> None:
    """Both sides must compute the same, or their times mean nothing.

    Raises:
        RuntimeError: they do not.
    """
    if not np.allclose(other, first, rtol=ROUNDING, atol=0):
        raise RuntimeError(f"{name}: compiled gives {first}, NumPy {other}.")


def print_costs(asked: Asked) -> None:
    """One evaluation in a compiled loop, and called from Python, against NumPy."""
    print("| cost | in a loop, us | called, us | NumPy, us | ratio | ratio, called |")
    for case in cases(COST_FRAMES, at_truth=True):
        own = partial(case.problem.cost, case.pose)
        check_same(case.name, own(), case.plain_cost())
        sides: list[Callable[[], float]] = [
            lambda case=case: seconds_of(case.compiled_loop) / LOOP,  # type: ignore[misc]
            partial(seconds_of, own, 5000),
            partial(seconds_of, case.plain_cost, 100),
        ]
        print_turns(case.name, sides, asked.trials, 1e-6)


def print_searches(asked: Asked) -> None:
    """One whole search against the same search in Python, with the NumPy cost."""
    print("| search | compiled, ms | Python and NumPy, ms | ratio |")
    for case in cases(25, at_truth=False):
        (cost, evaluations), plain = case.compiled_search(), case.plain_search()
        check_same(case.name, cost, plain[0])
        check_same(case.name, float(evaluations), float(plain[1]))
        sides: list[Callable[[], float]] = [
            partial(seconds_of, case.compiled_search, 5),
            partial(seconds_of, case.plain_search),
        ]
        print_turns(f"{case.name}, {evaluations} evaluations", sides, asked.trials, 1e-3)


def print_protocol(asked: Asked) -> None:
    """Seconds of all runs with all that is stated of them, and how they grow with the frames."""
    datasets = [dataset for _, dataset in simulate_nineteen(0)]
    solvers: tuple[Solver, ...] = ("linear", "constrained")
    for threads in (1, 2):
        with ThreadPoolExecutor(threads) as executor:

            def act(data: list[object], settings: EvaluationSettings) -> None:
                summarise(evaluate(data, settings, executor) or [])  # type: ignore[arg-type]

            act([*datasets[:2]], EvaluationSettings(runs=20))  # compiles
            for solver in solvers:
                settings = EvaluationSettings(CalibrationSettings(essential=solver))
                one, many = (
                    [seconds_of(partial(act, [*some], settings)) for _ in range(asked.trials)]
                    for some in (datasets[3:4], datasets)
                )
                print(
                    f"  {threads} threads, {solver}: one {spread(one, 100)} s, nineteen "
                    f"{spread(many, 100)} s",
                    flush=True,
                )
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"  peak memory {memory:.0f} MB")
    for frames in (25, 250, 2500):
        dataset = simulate_nineteen(0, datasets=1, frames=frames)[0][1]
        settings = EvaluationSettings(runs=4, calibration_frames=frames * 4 // 5)
        four = partial(evaluate_runs, dataset, settings, 0, range(settings.runs))
        four()
        taken = [seconds_of(four) for _ in range(asked.trials)]
        print(f"  {frames} frames, 4 runs: {spread(taken, 100)} s", flush=True)


def print_refine(asked: Asked) -> None:
    """Ours and SciPy's, of two cameras and more."""
    for cameras, frames in ((2, 25), (2, 100), (3, 60), (4, 100)):
        against_scipy(asked.numbers, cameras, frames)


def print_growth(asked: Asked) -> None:
    """One refined set, noise estimated."""
    for frames in (25, 250, 2500):
        rng = np.random.default_rng(frames)
        data = stated(random_scene(rng, frames), rng, Misjudged())
        refine(data)
        spent = []
        for _ in range(asked.trials):
            started = time.thread_time()
            refine(data)
            spent.append(1e3 * (time.thread_time() - started))
        print(f"  {frames} frames: {spread(spent, 100)} ms", flush=True)


SLIDERS = {"delta": "Delta", "acceptance": "acceptance ratio", "validate_frames": "split"}
WATCH = """() => new Promise(resolve => {
  const drawn = () => JSON.stringify([...document.querySelectorAll('.js-plotly-plot')]
    .filter(each => each.offsetParent).map(each => each.data.map(one => one.y)))
  const before = drawn(), start = performance.now()
  const look = () => {
    const now = drawn()
    if (now !== before && now !== '[]') resolve(performance.now() - start)
    else if (performance.now() - start > 60000) resolve(NaN)
    else requestAnimationFrame(look)
  }
  requestAnimationFrame(look)
})"""


def spin() -> None:
    """Keep a core busy."""
    while True:
        sum(range(10_000))


@contextmanager
def busy(processes: int) -> Iterator[None]:
    """Beside processes that do nothing but compute."""
    context = multiprocessing.get_context("spawn")
    others = [context.Process(target=spin, daemon=True) for _ in range(processes)]
    for each in others:
        each.start()
    try:
        yield
    finally:
        for each in others:
            each.terminate()


def print_sliders(asked: Asked) -> None:
    """Streamlit itself waits 0.2 s after the last move of a slider."""
    from playwright.sync_api import sync_playwright

    from tests.browser.conftest import FLAGS, chromium, serve
    from tests.browser.work import a_project

    home = Path(tempfile.mkdtemp())
    project = a_project(home, Path(asked.data))
    with serve(home) as url, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=FLAGS)
        page = browser.new_page(viewport={"width": 1400, "height": 1400})
        page.goto(f"{url}/validate?project={project.id}")
        start = page.locator(".st-key-validate button")
        page.locator(".js-plotly-plot").first.or_(start).wait_for(timeout=120_000, state="attached")
        page.wait_for_timeout(3000)
        for processes in (0, os.cpu_count() or 2):
            with busy(processes):
                page.wait_for_timeout(2000)
                for key, name in SLIDERS.items():
                    figures, wholes = [], []
                    for at in range(asked.trials):
                        page.locator(f"[class*=st-key-{key}] input").first.focus()
                        page.evaluate(f"() => {{ window.followed = ({WATCH})() }}")
                        began = time.perf_counter()
                        page.keyboard.press("ArrowRight" if at % 4 < 2 else "ArrowLeft")
                        figures.append(page.evaluate("window.followed") / 1000)
                        page.wait_for_timeout(300)
                        page.wait_for_function(
                            "!document.querySelector('.st-key-runs_so_far')"
                            " && document.querySelector('[data-test-script-state=notRunning]')",
                            timeout=120_000,
                        )
                        wholes.append(time.perf_counter() - began)
                        page.wait_for_timeout(500)
                    print(
                        f"| {name}, {processes} others | {spread(figures, 100)} s | all runs "
                        f"{spread(wholes, 100)} s |",
                        flush=True,
                    )
        browser.close()


MB = 1_000_000
LARGE, SIZE, PHOTOGRAPHS, DISK = 900 * MB, 4 * MB, 50, 96 * MB


@contextmanager
def timed(what: str) -> Iterator[None]:
    """Print how long something takes."""
    begun = time.perf_counter()
    yield
    print(f"  {what}: {time.perf_counter() - begun:.2f} s", flush=True)


def print_store(asked: Asked) -> None:
    """What goes into a project's file, and what it costs to be sure that it is there."""
    with tempfile.TemporaryDirectory(dir=asked.folder or None) as folder:
        small_values(Path(folder) / "speed")
        large_value(Path(folder) / "large")
        full_disk(Path(folder) / "full")


def small_values(home: Path) -> None:
    """Photographs in and out, settings, and a list of 501 projects."""
    store = ProjectPhotographs(Project.create(home))
    contents = [os.urandom(SIZE) for _ in range(PHOTOGRAPHS)]
    with timed(f"{PHOTOGRAPHS} photographs of {SIZE // MB} MB in"):
        store.add({f"{at}.png": store.keep("", content) for at, content in enumerate(contents)})
    with timed("and out"):
        assert [file.read_bytes() for file in store.photographs.values()] == contents
    with timed("200 settings kept"):
        for at in range(200):
            store.project.keep_settings({"delta": at})
    with timed("200 times all settings read"):
        for _ in range(200):
            _ = store.project.settings
    with timed("the photographs removed"):
        store.clear()
    print(f"  which leaves a file of {store.database.path.stat().st_size} bytes")
    for _ in range(500):
        Project.create(home)
    with timed("the list of 501 projects"):
        assert len(recent_projects(home)) == 501
    with timed("a sweep of them"):
        sweep(home, 30.0)


def large_value(home: Path) -> None:
    """A value of 900 MB, and one that is too large."""
    database = Project.create(home).database
    path = home / "large.csv"
    with path.open("wb") as file:
        for _ in range(LARGE // SIZE):
            file.write(os.urandom(SIZE))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with timed(f"{LARGE // MB} MB in"):
        stored = database.keep_file(path, path.name)
        database.name_files("applied", {path.name: stored})
    with timed("and out"):
        stored.copy_to(home / "out.csv")
    more = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1000
    with (home / "out.csv").open("rb") as file:
        same = hashlib.file_digest(file, "sha256").hexdigest() == stored.sha256
    print(f"  the same: {same}; {more} MB more memory", flush=True)
    with path.open("r+b") as file:
        file.truncate(LARGEST + 1)
    size = database.path.stat().st_size
    try:
        database.keep_file(path, path.name)
    except StereocalError as error:
        print(f"  {error} The file grew by {database.path.stat().st_size - size} bytes.")


def full_disk(place: Path) -> None:
    """A disk that fills: what was accepted stays, and a deleted project gives its room back."""
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={DISK}", "none", str(place)]
    if subprocess.run(mount, check=False, capture_output=True).returncode:
        print("  full disk: not tried, since no tmpfs can be mounted here")
        return
    try:
        store, kept = ProjectPhotographs(Project.create(place)), {}
        try:
            for at in range(1000):
                file = store.keep(f"{at}.png", os.urandom(MB))
                store.add({f"{at}.png": file})
                kept[f"{at}.png"] = file
        except DiskFullError as error:
            print(f"  after {len(kept)} photographs of 1 MB: {error}")
        with (place / "filler").open("wb", buffering=0) as filler:
            try:
                while filler.write(bytes(4096)):
                    pass
            except OSError:
                print("  then filled to the last byte")
        assert store.photographs == kept and all(file.read_bytes() for file in kept.values())
        assert store.database.rows("PRAGMA integrity_check") == [("ok",)]
        remove(place, store.project.id)
        before = os.statvfs(place).f_bavail
        delete(place, store.project.id)
        found = os.statvfs(place)
        more = (found.f_bavail - before) * found.f_frsize
        print(f"  the project removed and deleted: {more} bytes more are free")
    finally:
        subprocess.run(["umount", str(place)], check=True)


if __name__ == "__main__":
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    run_studies(
        {
            "costs": (print_costs, 31),
            "searches": (print_searches, 11),
            "protocol": (print_protocol, 3),
            "refine": (print_refine, 5),
            "growth": (print_growth, 9),
            "sliders": (print_sliders, 4),
            "store": (print_store, 1),
        },
        __doc__,
        data=str(SAMPLES / "recording"),
        folder="",
    )
