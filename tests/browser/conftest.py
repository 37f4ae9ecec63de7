"""A real server and a real Chromium for the walks."""

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Error, Locator, Page, expect, sync_playwright

from stereocal.projects.home import duplicate
from stereocal.projects.project import Project
from tests.browser.work import finished_project

ROOT = Path(__file__).parents[2]
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
LONGEST_MS = 120_000
"""The first calibration on a fresh machine compiles; on a busy one that took 40 s."""


expect.set_options(timeout=20_000)  # a busy machine is no fault of a page

HEALTH = {"STREAMLIT_SERVER_SCRIPT_HEALTH_CHECK_ENABLED": "true"}
"""As the container has it (Dockerfile)."""
FROM_CHECKOUT = ("-m", "streamlit", "run", "app.py", "--server.headless", "true", "--server.port")


@contextmanager
def serve(home: Path, **environment: str) -> Iterator[str]:
    """A dashboard on a free port, with its projects below `home`."""
    with served(home, environment) as (_, url):
        yield url


@contextmanager
def served(
    home: Path,
    environment: Mapping[str, str] | None = None,
    command: Sequence[str] = FROM_CHECKOUT,
    folder: Path = ROOT,
) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """As `serve`, with the process, which may be killed.

    Args:
        command: what Python is called with, before the port.
        folder: the current one of the process.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    url = f"http://127.0.0.1:{port}"
    with log_of(home).open("ab") as log:
        server = subprocess.Popen(
            [sys.executable, *command, str(port)],
            cwd=folder,
            env={**os.environ, "STEREOCAL_HOME": str(home), **(environment or {})},
            stdout=subprocess.DEVNULL,
            stderr=log,
            start_new_session=True,
        )
    try:
        for _ in range(600):
            try:
                with urllib.request.urlopen(f"{url}/_stcore/health", timeout=1):
                    break
            except OSError:
                time.sleep(0.1)
        else:
            pytest.fail("the dashboard did not start within a minute")
        yield server, url
    finally:
        if server.poll() is None:
            os.killpg(server.pid, signal.SIGTERM)
        server.wait(20)


def log_of(home: Path) -> Path:
    """What servers with these projects say, all of it an error."""
    return home.with_name(f"{home.name}.log")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """With a walk that failed, tell what was on its page, and what its server said."""
    report = yield
    used: dict[str, Any] = getattr(item, "funcargs", {})
    if report.failed and "page" in used:
        with suppress(Error):
            app = used["page"].get_by_test_id("stApp")
            state = app.get_attribute("data-test-script-state", timeout=1000)
            report.sections.append((f"page: {state}", app.inner_text(timeout=1000)))
        for home in (used.get("home"), used.get("tmp_path", Path()) / "home"):
            if home is not None and (log := log_of(home)).exists():
                report.sections.append((f"server: {home.name}", log.read_text()[-5000:]))
    return report


def chromium() -> str | None:
    """The browser's program; None without one."""
    return os.environ.get("CHROMIUM") or shutil.which("chromium")


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    program = chromium()
    if program is None:
        if os.environ.get("STEREOCAL_BROWSER_REQUIRED"):
            pytest.fail("Chromium is required here and was not found")
        pytest.skip("no Chromium on this machine")
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=program, args=FLAGS)
        yield started
        started.close()


@pytest.fixture(scope="session")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("home")


@pytest.fixture(scope="session")
def app_url(home: Path) -> Iterator[str]:
    with serve(home, **HEALTH) as url:
        yield url


@pytest.fixture(scope="session")
def finished_once(home: Path) -> Project:
    return finished_project(home)


@pytest.fixture
def finished(home: Path, finished_once: Project) -> Project:
    """A project with results of everything, in which no other walk chose a view."""
    return duplicate(home, finished_once.id)


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 1400, "height": 1000}, accept_downloads=True)
    context.set_default_timeout(60_000)
    yield context.new_page()
    context.close()


DRAWN = """longest => {
  const app = document.querySelector("[data-testid=stApp]")
  const main = document.querySelector("[data-testid=stMain]")
  const figures = [...document.querySelectorAll("[data-testid=stPlotlyChart]")]
  const whole = app?.dataset.testScriptState === "notRunning" && document.querySelector("h1")
    && figures.every((one) => !one.offsetParent || one.querySelector(".main-svg"))
  const now = whole && `${main.scrollHeight} ${main.querySelectorAll("*").length}`
  if (now !== window.drawn) [window.drawn, window.drawnSince] = [now, performance.now()]
  return whole && performance.now() - window.drawnSince > longest
}"""
"""Whether a page has been whole for some time: between two runs it rests for a moment, too, and
Plotly draws and folds open after it."""
GAP_MS = 250


def settle(page: Page) -> None:
    """Wait until the server has drawn the page whole, and the browser what it was sent."""
    page.evaluate("delete window.drawn")
    page.wait_for_function(DRAWN, arg=GAP_MS, timeout=LONGEST_MS)


def open_folds(page: Page) -> None:
    """Open all that is folded."""
    page.evaluate(OPEN)
    settle(page)


OPEN = """[...document.querySelectorAll(
  "[data-testid=stExpander] details:not([open]) > summary")].forEach(each => each.click())"""


def visit(page: Page, url: str, name: str, project: Project) -> None:
    """Open a page of a project."""
    page.goto(f"{url}/{'' if name == 'start' else name}?project={project.id}")
    settle(page)


def project_of(page: Page, home: Path) -> Project:
    """The project of a page's address."""
    return Project.open(home, page.url.split("project=")[1][:32])


def one_of(page: Page, name: str) -> Locator:
    """What is chosen among others: a button, or a radio button."""
    button = page.get_by_role("button", name=name, exact=True)
    return page.get_by_role("radio", name=name, exact=True).or_(button).first


def results_shown(page: Page, longest_ms: int = LONGEST_MS) -> None:
    """Wait for all that *Calibrate* computes; the page is drawn anew at the end, menus closed."""
    expect(page.locator(".st-key-download_2d button").first).to_be_visible(timeout=longest_ms)
    expect(page.get_by_text("held out here: not yet")).to_have_count(0, timeout=longest_ms)
    # Two while the page is drawn anew.
    expect(page.locator(".st-key-download_2d button")).to_have_count(1, timeout=longest_ms)


def download(page: Page, key: str, folder: Path) -> Path:
    """Press the button of a key; the file, under the name that the browser was told."""
    with page.expect_download() as event:
        page.locator(f"[class*='st-key-{key}'] button").first.click()
    path = folder / event.value.suggested_filename
    event.value.save_as(path)
    return path


def choose(page: Page, key: str, option: str) -> None:
    """Choose from the menu of a widget; again if a page drawn anew closed it meanwhile."""
    field = page.locator(f".st-key-{key} input")
    field.scroll_into_view_if_needed()
    for _ in range(5):
        page.wait_for_timeout(300)  # the end of the scroll would close the menu
        with suppress(Error, AssertionError):
            field.click()
            page.get_by_role("option", name=option, exact=True).click(timeout=5000)
            expect(field).to_have_value(option, timeout=5000)
            return
    raise AssertionError(f"{option} could not be chosen")
