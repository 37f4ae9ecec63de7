"""How soon the figure of Validate follows its sliders, in Chromium on a server of its own.

Each slider is moved by a key as a person would, on an idle machine and beside processes that keep
all cores busy. Timed in the browser from the key to the first frame with another figure, and to the
figure of all runs; Streamlit itself waits 0.2 s after the last move of a slider.
"""

import argparse
import multiprocessing
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, sync_playwright

from stereocal.projects.project import Project
from tests.browser.conftest import FLAGS, chromium, serve
from tests.browser.work import a_project

ROOT = Path(__file__).parents[1]
SLIDERS = {"delta": "Delta", "acceptance": "acceptance ratio", "validate_frames": "split"}
WATCH = """() => new Promise(resolve => {
  const drawn = () => JSON.stringify([...document.querySelectorAll('.js-plotly-plot')]
    .filter(each => each.offsetParent).map(each => each.data.map(one => one.y)))
  const before = drawn(), start = performance.now()
  const look = () => {
    const now = drawn()
    if (now !== before && now !== '[]') resolve([performance.now() - start, now.length])
    else if (performance.now() - start > 60000) resolve([NaN, 0])
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


def move(page: Page, key: str, way: str) -> tuple[float, float, str]:
    """Seconds from a key on a slider to another figure and to all runs, and what was said first."""
    page.locator(f"[class*=st-key-{key}] input").first.focus()
    page.evaluate(f"() => {{ window.followed = ({WATCH})() }}")
    start = time.perf_counter()
    page.keyboard.press(way)
    first, _ = page.evaluate("window.followed")
    said = page.locator(".st-key-runs_so_far").all_inner_texts()
    page.wait_for_timeout(300)
    page.wait_for_function(
        "!document.querySelector('.st-key-runs_so_far')"
        " && document.querySelector('[data-test-script-state=notRunning]')",
        timeout=120_000,
    )
    return first / 1000, time.perf_counter() - start, " ".join(said).split("\n")[0]


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moves", type=int, default=6)
    parser.add_argument("--data", type=Path, default=ROOT / "sample_data" / "recording")
    parser.add_argument("--refined", action="store_true", help="with a row of the refined method")
    given = parser.parse_args()
    home = Path(tempfile.mkdtemp())
    project: Project = a_project(home, given.data)
    project.keep_settings({"with_refined": given.refined})
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
                    found, words = [], ""
                    for at in range(given.moves):
                        way = "ArrowRight" if at % 4 < 2 else "ArrowLeft"
                        *times, words = move(page, key, way)
                        found.append(times)
                        page.wait_for_timeout(500)
                    row = [
                        f"{np.median(own):.2f} ({own.min():.2f} to {own.max():.2f})"
                        for own in np.transpose(found)
                    ]
                    print(f"| {name}, {processes} others | {' | '.join(row)} |", words, flush=True)
        browser.close()


if __name__ == "__main__":
    main()
