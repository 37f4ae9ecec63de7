"""Server time of one draw of each page, on the sample field with all results.

    python -m benchmarks.pages
    python -m benchmarks.pages --browser

`first` is the first draw after a new result, `again` the median of 7 more, each in seconds of CPU
time of all threads and, in brackets, of wall time: on a machine with other work the first is the
one to compare. The last lines are a slider of Validate, from its move to the new figure, with 100
runs of 25 frames, and the press of Calibrate.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import expect, sync_playwright
from streamlit.testing.v1 import AppTest

from docs.screenshots import settle
from stereocal.ui.menu import TITLES
from tests.browser.conftest import FLAGS, chromium, serve
from tests.browser.work import finished_project
from tests.pages.conftest import as_in_a_server

ROOT = Path(__file__).parents[1]
PAGES = ("start", "plan", "data", "calibrate", "validate", "one_set", "apply", "check", "cameras")
LONGEST_S = 600
DRAWN = """() => document.querySelector('[data-test-script-state=notRunning]')
    && ![...document.querySelectorAll('[data-testid=stPlotlyChart]')]
        .some((chart) => !chart.querySelector('.main-svg'))
    && !document.querySelector('[data-stale=true]')"""
"""Whether the server has ended and each figure has been drawn."""


def timed(act: Callable[[], object]) -> tuple[float, float]:
    """Seconds of CPU and of wall time."""
    cpu, wall = time.process_time(), time.perf_counter()
    act()
    return time.process_time() - cpu, time.perf_counter() - wall


def show(name: str, *each: tuple[float, float]) -> None:
    """One line."""
    cells = "   ".join(f"{cpu:6.2f} ({wall:5.2f})" for cpu, wall in each)
    print(f"{name:24s} {cells}", flush=True)


def median(turns: list[tuple[float, float]]) -> tuple[float, float]:
    """Of both times."""
    cpu, wall = np.median(turns, axis=0)
    return float(cpu), float(wall)


def finished() -> AppTest:
    """The field sample, calibrated; all that a first page of a server loads has been loaded."""
    app = AppTest.from_file(str(ROOT / "app.py"), default_timeout=LONGEST_S).run()
    app.button(key="demo").click().run()
    app.switch_page("pages/calibrate.py").run()
    app.button(key="run").click().run()
    for page in PAGES:
        app.switch_page(f"pages/{page}.py").run()
    return app


def new_result(app: AppTest, seed: int) -> tuple[float, float]:
    """Press Calibrate with another seed."""
    app.switch_page("pages/calibrate.py").run()
    app.number_input(key="seed").set_value(seed).run()
    return timed(app.button(key="run").click().run)


def switches(home: Path) -> None:
    """Each page by the menu, from the one before it, in a real browser."""
    with serve(home) as url, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=FLAGS)
        page = browser.new_page(viewport={"width": 1400, "height": 1000})
        project = finished_project(home)
        taken: dict[str, list[float]] = {}
        for turn in range(6):
            page.goto(f"{url}/?project={project}")
            settle(page)
            for name, title in list(TITLES.items())[1:]:
                link = page.get_by_test_id("stSidebar").get_by_role("link", name=title, exact=True)
                started = time.perf_counter()
                link.click()
                expect(page.get_by_test_id("stMain").locator("h1")).to_have_text(title)
                page.wait_for_function(DRAWN, polling=20)
                if turn:
                    taken.setdefault(name, []).append(time.perf_counter() - started)
                settle(page)
        browser.close()
    for name, seconds in taken.items():
        print(f"{name:24s} {np.median(seconds):5.2f} ({max(seconds):5.2f})")


def main() -> None:
    """All pages."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--browser", action="store_true")
    if parser.parse_args().browser:
        with tempfile.TemporaryDirectory() as folder:
            switches(Path(folder))
        return
    patch = pytest.MonkeyPatch()
    as_in_a_server(patch)
    with tempfile.TemporaryDirectory() as home:
        os.environ["STEREOCAL_HOME"] = home
        app = finished()
        presses = [new_result(app, seed) for seed in (1, 2, 3)]
        for page in PAGES:
            first = timed(app.switch_page(f"pages/{page}.py").run)
            again = [timed(app.run) for _ in range(7)]
            assert not app.exception
            show(page, first, median(again))
        app.switch_page("pages/validate.py").run()
        moves = [
            timed(app.slider(key="acceptance").set_value(value).run)
            for value in (0.3, 0.25, 0.35, 0.4, 0.15)
        ]
        show("slider of Validate", median(moves))
        show("press of Calibrate", median(presses))
    patch.undo()


if __name__ == "__main__":
    main()
