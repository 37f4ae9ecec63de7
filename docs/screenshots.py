"""The pictures of all pages and of the story, for README and docs: `make pictures`.

A real server and a real browser open the recording that comes with the program, calibrate it, and
take every page as a whole at 1400 and 420 px, light and dark. The photographs are those of the
second sample. The figures of the story on the Start page are taken by themselves, on white.
"""

import argparse
import io
import json
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import Literal

import plotly.graph_objects as go
from PIL import Image
from playwright.sync_api import Browser, Page, expect, sync_playwright

from stereocal.figures.story import (
    Story,
    plot_story_lengths,
    plot_story_lines,
    plot_two_rays,
    read_story,
)
from stereocal.matching.clicks import Click
from stereocal.projects.clicks import Act, ProjectClicks
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from stereocal.ui.apply_points import CLICKED
from tests.browser.conftest import FLAGS, LONGEST_MS, ROOT, chromium, results_shown, serve
from tests.browser.conftest import settle as drawn

FLIGHT = ROOT / "sample_data" / "flight"
PICTURES = ROOT / "docs" / "pictures"
PAGES = ("start", "data", "calibrate", "validate", "apply", "check", "plan", "cameras")
STORY: Mapping[str, Callable[[Story], go.Figure]] = {
    "story_lengths": plot_story_lengths,
    "story_lines": plot_story_lines,
    "story_rays": plot_two_rays,
}
WIDTHS = (1400, 420)
THEMES: tuple[Literal["light", "dark"], ...] = ("light", "dark")
SECOND = 1000
SETTLE_MS = 2 * SECOND
"""Until figures have been drawn, after the server has ended."""
COLOURS = 256
"""Of a picture: a third of the size of all colours."""


def settle(page: Page) -> None:
    """Wait until the page is whole and no job runs."""
    drawn(page)
    expect(page.get_by_role("button", name="Cancel")).to_have_count(0, timeout=10 * LONGEST_MS)
    drawn(page)
    page.wait_for_timeout(SETTLE_MS)


def keep(screenshot: bytes, path: Path) -> None:
    """Save a picture in few colours."""
    picture = Image.open(io.BytesIO(screenshot)).convert("RGB")
    path.parent.mkdir(parents=True, exist_ok=True)
    # Without k-means, it moves the colours of large areas by some levels.
    few = picture.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, 5, dither=Image.Dither.NONE)
    few.save(path, optimize=True)
    print(path)


def take(page: Page, path: Path) -> None:
    """The whole page, however long it is."""
    size = page.viewport_size
    assert size is not None
    height = page.evaluate("document.querySelector('[data-testid=stMain]').scrollHeight")
    page.set_viewport_size({"width": size["width"], "height": int(height)})
    page.wait_for_timeout(SETTLE_MS)
    keep(page.screenshot(), path)
    page.set_viewport_size(size)


@contextmanager
def visitor(
    browser: Browser, width: int, theme: Literal["light", "dark"] = "light"
) -> Iterator[Page]:
    """A page of this width."""
    context = browser.new_context(
        viewport={"width": width, "height": 1000}, color_scheme=theme, reduced_motion="reduce"
    )
    context.set_default_timeout(LONGEST_MS)
    yield context.new_page()
    context.close()


def open_sample(page: Page, url: str, button: str) -> str:
    """Press a button of Start that opens a sample; the query of the project's addresses."""
    page.goto(url)
    settle(page)
    page.get_by_role("button", name=button).click()
    page.wait_for_url("**project=**")
    settle(page)
    return page.url.split("?")[1]


def project_of_recording(page: Page, url: str) -> str:
    """Open the recording and calibrate it; the query of its addresses."""
    query = open_sample(page, url, "Open the real recording")
    page.goto(f"{url}/calibrate?{query}")
    settle(page)
    page.get_by_role("button", name="Calibrate", exact=True).click()
    results_shown(page, 10 * LONGEST_MS)
    settle(page)
    return query


def project_of_photographs(page: Page, url: str) -> str:
    """Open the sample photographs and find the targets; the query of its addresses."""
    query = open_sample(page, url, "Sample photographs")
    page.get_by_role("button", name="Find the targets").click()
    expect(page.get_by_text("25 frames:").first).to_be_visible(timeout=10 * LONGEST_MS)
    settle(page)
    return query


def project_of_flight(page: Page, url: str, home: Path, query: str) -> None:
    """Calibrate the sample photographs, and click what flies in five frames of its videos."""
    page.goto(f"{url}/calibrate?{query}")
    settle(page)
    page.get_by_role("button", name="Calibrate", exact=True).click()
    results_shown(page, 10 * LONGEST_MS)
    project = Project.open(home, query.split("project=")[1][:32])
    project.keep_settings({"apply_points": CLICKED, "clicks_track": "tail", "clicks_frame": 6})
    page.goto(f"{url}/apply?{query}")
    settle(page)
    page.get_by_text("Pictures: ").first.click()
    uploader = page.locator("[class*=st-key-upload_footage] input[type=file]")
    uploader.set_input_files([FLIGHT / f"{camera}.mp4" for camera in CAMERAS])
    expect(page.get_by_text("primary.mp4, secondary.mp4, 10 frames")).to_be_visible()
    truth = json.loads((FLIGHT / "truth.json").read_text())
    for frame, camera, end in product(range(1, 6), CAMERAS, (0, 1)):
        click = Click(frame, camera, ("head", "tail")[end], *truth[camera][frame - 1][end])
        names = [f"{each}.mp4" for each in CAMERAS]
        ProjectClicks(project).act(Act([click], [], names))
    click = Click(6, "primary", "tail", *truth["primary"][5][1])
    ProjectClicks(project).act(Act([click], [], names))


def draw_story(folder: Path) -> None:
    """The figures of the story, 560 px wide at twice the resolution."""
    story = read_story(ROOT / "assets" / "story.json")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=FLAGS)
        page = browser.new_page(viewport={"width": 576, "height": 400}, device_scale_factor=2)
        for name, plot in STORY.items():
            figure = plot(story).update_layout(width=560, margin={"l": 24, "r": 24})
            page.set_content(figure.to_html(config={"staticPlot": True}))
            drawn = page.locator(".plot-container")
            expect(drawn).to_be_visible(timeout=LONGEST_MS)
            keep(drawn.screenshot(), folder / f"{name}.png")
        browser.close()


def take_pages(folder: Path) -> None:
    """All pages, `PAGE_WIDTH_THEME.png`."""
    with (
        tempfile.TemporaryDirectory() as home,
        serve(Path(home)) as url,
        sync_playwright() as playwright,
    ):
        browser = playwright.chromium.launch(executable_path=chromium(), args=FLAGS)
        with visitor(browser, WIDTHS[0]) as page:
            photographs = project_of_photographs(page, url)
            project_of_flight(page, url, Path(home), photographs)
            recording = project_of_recording(page, url)
        for theme in THEMES:
            for width in WIDTHS:
                with visitor(browser, width, theme) as page:
                    for name in PAGES:
                        page.goto(f"{url}/{'' if name == 'start' else name}?{recording}")
                        settle(page)
                        take(page, folder / f"{name}_{width}_{theme}.png")
                    page.goto(f"{url}/data?{photographs}")
                    settle(page)
                    take(page, folder / f"photographs_{width}_{theme}.png")
                    page.get_by_text("One frame", exact=True).click()
                    settle(page)
                    take(page, folder / f"review_{width}_{theme}.png")
                    page.goto(f"{url}/apply?{photographs}")
                    settle(page)
                    take(page, folder / f"clicks_{width}_{theme}.png")
        browser.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=PICTURES)
    parser.add_argument("--story", action="store_true", help="only the figures of the story")
    given = parser.parse_args()
    draw_story(given.out)
    if not given.story:
        take_pages(given.out)
