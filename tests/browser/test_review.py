"""A person corrects found targets in a real browser: clicks, keys, fingers."""

import csv
import json
import math
import re
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from stereocal.calibration.methods import CalibrationSettings
from stereocal.frames.frame import Centre
from stereocal.library.calibrations import calibrate
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from tests.browser.conftest import download, settle, visit

pytestmark = pytest.mark.browser


class Photograph:
    """A picker on the page."""

    def __init__(self, page: Page, camera: str, of: str = "pick_") -> None:
        self.page = page
        self.whole: Locator = page.locator(f".st-key-{of}{camera}")
        self.canvas = self.whole.locator("canvas")
        self.ready()

    def ready(self) -> None:
        expect(self.canvas).to_have_attribute("data-ready", re.compile("."))

    @property
    def view(self) -> dict[str, float]:
        """Scale, and the image point in the middle."""
        seen: dict[str, float] = json.loads(self.canvas.get_attribute("data-view") or "{}")
        return seen

    def screen(self, u: float, v: float) -> tuple[float, float]:
        """Where an image point is on the screen."""
        self.canvas.scroll_into_view_if_needed()
        box, view = self.canvas.bounding_box(), self.view
        assert box is not None
        return (
            box["x"] + box["width"] / 2 + (u - view["u"]) * view["scale"],
            box["y"] + box["height"] / 2 + (v - view["v"]) * view["scale"],
        )

    def zoom(self, factor: float, u: float, v: float) -> None:
        """Turn the wheel over an image point."""
        self.page.mouse.move(*self.screen(u, v))
        self.page.mouse.wheel(0, -500 * math.log(factor))


def centre(store: ProjectPhotographs, number: int, camera: int, target: int) -> Centre:
    (frame,) = (frame for frame in store.frames or [] if frame.frame == number)
    found = frame.centres[camera][target]
    assert found
    return found


@pytest.fixture
def store(page: Page, app_url: str, finished: Project) -> ProjectPhotographs:
    """A project whose targets have been found, with frame 1 on the page."""
    finished.keep_settings({"frames_view": "All frames"})
    visit(page, app_url, "data", finished)
    page.locator(".st-key-look_1 button").click()
    Photograph(page, "primary")
    return ProjectPhotographs(finished)


def table(page: Page, folder: Path) -> list[dict[str, str]]:
    path = download(page, "download_correspondences", folder)
    return list(csv.DictReader(path.read_text().splitlines()))


def test_clicks_corrections_and_the_table(
    page: Page, store: ProjectPhotographs, tmp_path: Path
) -> None:
    primary = Photograph(page, "primary")
    before = centre(store, 1, 0, 0)
    primary.zoom(6.0, before.u, before.v)
    zoomed = primary.view
    assert zoomed["scale"] > 3

    # Near the target: the centre goes to the corner, and the view stays.
    page.mouse.click(*primary.screen(before.u + 3, before.v + 2))
    expect(
        page.get_by_text("A in the primary photograph is now at the fitted").first
    ).to_be_visible()
    corrected = centre(store, 1, 0, 0)
    assert corrected.source == "corrected"
    assert math.dist((corrected.u, corrected.v), (before.u, before.v)) < 0.02
    assert primary.view == zoomed

    # With shift the click is kept; a pixel is 3 px on the screen, and the mouse hits whole ones.
    page.keyboard.down("Shift")
    page.mouse.click(*primary.screen(before.u - 4, before.v + 4))
    page.keyboard.up("Shift")
    expect(page.get_by_text("A in the primary photograph is now where you").first).to_be_visible()
    manual = centre(store, 1, 0, 0)
    assert manual.source == "manual"
    assert math.dist((manual.u, manual.v), (before.u - 4, before.v + 4)) < 0.5

    # Far from all targets nothing is fitted and nothing is lost.
    page.mouse.click(*primary.screen(zoomed["u"], zoomed["v"] + 30))
    expect(page.get_by_text("There is no corner of four squares near").first).to_be_visible()
    assert centre(store, 1, 0, 0) == manual

    page.locator(".st-key-swap_secondary button").click()
    expect(page.get_by_text("A and B are exchanged in the secondary").first).to_be_visible()
    page.keyboard.press("n")
    expect(page.get_by_label("Photograph of the primary camera, frame 2").first).to_be_visible()
    page.keyboard.press("x")
    expect(page.get_by_text("It is left out.").first).to_be_visible()
    settle(page)
    rows = table(page, tmp_path)
    assert [(row["frame"], row["target"], row["source"]) for row in rows[:3]] == [
        ("1", "A", "manual"),
        ("1", "B", "detected"),
        ("3", "A", "detected"),
    ]
    assert float(rows[0]["u_primary"]) == manual.u and rows[0]["sigma_primary_px"] == ""
    b = centre(store, 1, 1, 0)
    assert (float(rows[0]["u_secondary"]), float(rows[0]["v_secondary"])) == (b.u, b.v)

    page.reload()
    expect(page.get_by_role("button", name="Undo (4)").first).to_be_visible()
    page.keyboard.press("u")
    expect(page.get_by_role("button", name="Undo (3)").first).to_be_visible()


def test_view_by_mouse_and_keys(page: Page, store: ProjectPhotographs) -> None:
    primary = Photograph(page, "primary")
    a = centre(store, 1, 0, 0)
    whole = primary.view
    # The wheel keeps the point beneath it where it is. It turns at whole px: up to 3 times one off.
    at = primary.screen(a.u, a.v)
    primary.zoom(4.0, a.u, a.v)
    assert primary.view["scale"] == pytest.approx(4 * whole["scale"], rel=1e-3)
    assert primary.screen(a.u, a.v) == pytest.approx(at, abs=3.0)
    # A drag moves the photograph with the mouse, and is no click.
    at = primary.screen(a.u, a.v)
    page.mouse.move(*at)
    page.mouse.down()
    page.mouse.move(at[0] + 40, at[1] - 25, steps=4)
    page.mouse.up()
    assert primary.screen(a.u, a.v) == pytest.approx((at[0] + 40, at[1] - 25), abs=1.0)

    # With the keyboard alone: to target B, closer, to the side and back, and pick.
    primary.canvas.focus()
    page.keyboard.press("b")
    b = centre(store, 1, 0, 1)
    seen = primary.view
    assert (seen["u"], seen["v"]) == pytest.approx((b.u, b.v))
    page.keyboard.press("+")
    assert primary.view["scale"] == pytest.approx(1.25 * seen["scale"])
    page.keyboard.press("Shift+ArrowRight")
    page.keyboard.press("Shift+ArrowDown")
    moved = primary.view
    assert moved["u"] > b.u and moved["v"] > b.v
    page.keyboard.press("Shift+Enter")
    expect(page.get_by_text("B in the primary photograph is now where you").first).to_be_visible()
    placed = centre(store, 1, 0, 1)
    assert (placed.u, placed.v) == pytest.approx((moved["u"], moved["v"]))
    page.keyboard.press("Enter")
    expect(
        page.get_by_text("B in the primary photograph is now at the fitted").first
    ).to_be_visible()
    assert math.dist((centre(store, 1, 0, 1).u, centre(store, 1, 0, 1).v), (b.u, b.v)) < 0.02
    page.keyboard.press("0")
    assert primary.view == whole


AT_THE_TOP = """part => {
    const top = document.querySelector(part)?.getBoundingClientRect().top
    return top > 0 && top < 100
}"""


def test_what_a_press_opens_is_scrolled_to(page: Page, app_url: str, finished: Project) -> None:
    def is_at_the_top(part: str) -> None:
        """Below the header of the page; what stands above comes later, and scrolling follows it."""
        page.wait_for_function(AT_THE_TOP, arg=f".st-key-{part}")
        settle(page)
        assert page.evaluate(AT_THE_TOP, f".st-key-{part}")

    finished.keep_settings({"frames_view": "All frames"})
    finished.leave_out(9)
    dataset = finished.dataset
    assert dataset
    settings = CalibrationSettings(frames_left_out=(9,))
    finished.keep_calibration(calibrate(dataset, settings), finished.inputs)
    page.set_viewport_size({"width": 420, "height": 900})
    visit(page, app_url, "data", finished)
    for number in (9, 10):
        page.locator(f".st-key-look_{number}").get_by_role("button").click()
        Photograph(page, "primary")
        is_at_the_top("one_frame")
        page.locator(".st-key-frames_view").get_by_text("All frames").click()
        settle(page)
    visit(page, app_url, "calibrate", finished)
    page.get_by_role("button", name="Look at frame 9").click()
    expect(page.get_by_text("Frame 9 was left out by you.").first).to_be_visible()
    is_at_the_top("opened_frame")
    page.get_by_role("button", name="Correct it").click()
    Photograph(page, "primary")
    is_at_the_top("one_frame")


def test_by_touch_on_a_narrow_screen(
    browser: Browser, page: Page, store: ProjectPhotographs
) -> None:
    narrow = browser.new_context(
        viewport={"width": 420, "height": 900},
        has_touch=True,
        is_mobile=True,
        device_scale_factor=2,
        user_agent="Mozilla/5.0 (Linux; Android 10; K) Chrome/156.0.0.0 Mobile Safari/537.36",
    )
    phone = narrow.new_page()
    phone.goto(page.url)
    settle(phone)
    primary = Photograph(phone, "primary")
    # Sharp: as many pixels as the screen has.
    width = primary.canvas.evaluate("canvas => [canvas.width, canvas.clientWidth]")
    assert width[0] == 2 * width[1] and width[1] > 300
    assert phone.evaluate("document.documentElement.scrollWidth") <= 420
    a = centre(store, 1, 0, 0)
    primary.whole.locator("[data-act=A]").tap()
    whole, touch = primary.view, narrow.new_cdp_session(phone)
    x, y = primary.screen(a.u, a.v)

    def fingers(kind: str, *points: tuple[float, float]) -> None:
        places = [{"x": px, "y": py, "id": i} for i, (px, py) in enumerate(points)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": places})

    fingers("touchStart", (x - 30, y), (x + 30, y))
    for apart in (40, 50, 60):
        fingers("touchMove", (x - apart, y), (x + apart, y))
    fingers("touchEnd")
    assert primary.view["scale"] == pytest.approx(2 * whole["scale"], rel=0.02)
    assert primary.screen(a.u, a.v) == pytest.approx((x, y), abs=2.0)
    phone.touchscreen.tap(*primary.screen(a.u + 1, a.v + 1))
    expect(
        phone.get_by_text("A in the primary photograph is now at the fitted").first
    ).to_be_visible()
    assert centre(store, 1, 0, 0).source == "corrected"
    narrow.close()
