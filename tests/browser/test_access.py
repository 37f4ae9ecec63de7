"""On a narrow screen, in light and dark, and by keyboard alone."""

import json
import re
from collections.abc import Mapping
from functools import partial
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, ConsoleMessage, Page, expect

from stereocal.projects.project import Project
from stereocal.ui.menu import TITLES
from tests.browser.conftest import LONGEST_MS, one_of, open_folds, settle, visit

pytestmark = pytest.mark.browser

CUT = """() => {
    const wide = []
    for (const element of document.querySelectorAll('[data-testid=stMain] *')) {
        const style = getComputedStyle(element)
        const own = [...element.childNodes].some(
            (node) => node.nodeType === 3 && node.textContent.trim())
        if (!own || !element.clientWidth || style.display === 'inline') continue
        if (element.closest('.js-plotly-plot, [data-testid=stDataFrame]')) continue
        if (element.closest('[data-testid=stCode], pre')) continue
        const box = element.getBoundingClientRect()
        if (!box.height || style.visibility === 'hidden' || style.opacity === '0') continue
        if (element.closest('[aria-hidden=true]')) continue
        if (box.width <= 1 || box.height <= 1) continue // for screen readers alone
        const hides = ['hidden', 'clip'].includes(style.overflowX)
        if ((hides && element.scrollWidth > element.clientWidth + 1) || box.right > innerWidth + 1)
            wide.push(`${element.tagName} ${element.textContent.trim().slice(0, 60)}`)
    }
    return wide
}"""
"""Texts that do not fit: cut off by their own box, or beyond the screen."""

UNNAMED = "[data-testid=stPlotlyChart]:not([role=figure][aria-label])"
RULES = {"runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"], "resultTypes": ["violations"]}
"""What axe looks for: names of controls, contrast, labels, roles, languages."""
NOT_OURS: Mapping[str, str] = {
    "list": "stSidebarNavItems",
    "listitem": '<li class="st-emotion',
    "scrollable-region-focusable": '<pre class="st-emotion',
}
"""Rules that Streamlit's own elements break, and where."""


def keep_error(errors: list[str], line: ConsoleMessage) -> None:
    """Streamlit looks for its server below the address of the page first: that is not ours."""
    if line.type == "error" and "_stcore" not in line.location["url"]:
        errors.append(line.text)


def violations(page: Page) -> list[str]:
    found = Axe().run(page, options=RULES).response["violations"]
    return [
        f"{each['id']}: {node['html'][:150]} {node['any'][:1]}"
        for each in found
        for node in each["nodes"]
        if each["id"] not in NOT_OURS or NOT_OURS[each["id"]] not in node["html"]
    ]


LABELS = """() => [...document.querySelectorAll('.textpoint text')].map((text) => {
    const grey = (colour) => Math.max(...colour.match(/\\d+/g).slice(0, 3).map(Number))
    const style = getComputedStyle(text)
    const inner = text.querySelector('tspan') ?? text
    return [grey(getComputedStyle(inner).fill), style.stroke === 'none' ? null : grey(style.stroke)]
})"""
"""How light the labels of points are, and their rims; 0 to 255."""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_pages_fit_a_narrow_screen_and_axe_finds_nothing(
    browser: Browser, app_url: str, finished: Project, scheme: Any
) -> None:
    """And labels of points are read on any photograph: label and rim are far apart."""
    context = browser.new_context(viewport={"width": 420, "height": 900}, color_scheme=scheme)
    page = context.new_page()
    problems: dict[str, list[str]] = {}
    errors: list[str] = []
    page.on("console", partial(keep_error, errors))
    for name in TITLES:
        visit(page, app_url, name, finished)
        if name in ("calibrate", "plan"):
            expect(page.locator(".textpoint text").first).to_be_attached(timeout=LONGEST_MS)
            for label, rim in page.evaluate(LABELS):
                assert rim is not None and abs(label - rim) > 150, (name, label, rim)
        open_folds(page)
        width = page.evaluate("document.documentElement.scrollWidth")
        main = page.evaluate("document.querySelector('[data-testid=stMain]').scrollWidth")
        found = [f"{width} px wide"] * (max(width, main) > 420)
        found += ["a figure without words"] * page.locator(UNNAMED).count()
        problems[name] = found + page.evaluate(CUT) + violations(page)
        background = page.evaluate(
            "getComputedStyle(document.querySelector('.stApp')).backgroundColor"
        )
        assert background == ("rgb(18, 24, 30)" if scheme == "dark" else "rgb(255, 255, 255)")
        if name == "validate" and scheme == "light":
            check_validation(page)
    context.close()
    problems["console"] = errors
    assert not any(problems.values()), json.dumps(problems, indent=1)


def check_validation(page: Page) -> None:
    """Three panels scrolled sideways there, out of sight, and the legend with them."""
    for column in ("residual", "reprojection", "reconstruction"):
        figure = page.locator(f".st-key-validation_{column}")
        expect(figure.locator(".legend text").first).to_be_visible(timeout=LONGEST_MS)
        for text in figure.locator(".legend text").all():
            box = text.bounding_box()
            assert box is not None and box["x"] >= 0 and box["x"] + box["width"] <= 420
    expect(page.locator(".st-key-validation")).to_have_count(0)
    page.set_viewport_size({"width": 1400, "height": 900})
    expect(page.locator(".st-key-validation .legend").first).to_be_visible()
    expect(page.locator(".st-key-validation_residual")).to_have_count(0)
    page.set_viewport_size({"width": 420, "height": 900})


FOCUSED = """async () => {
    let element = document.activeElement
    if (!element || element === document.body) return null
    while (element.shadowRoot && element.shadowRoot.activeElement)
        element = element.shadowRoot.activeElement
    const words = (at) => {  // without the names of icons
        const copy = at.cloneNode(true)
        copy.querySelectorAll('[data-testid=stIconMaterial]').forEach((icon) => icon.remove())
        return copy.textContent || ''
    }
    const above = (at) => at.parentElement ?? at.getRootNode().host ?? null
    const look = () => {
        const seen = [element.tagName === 'CANVAS' ? element.toDataURL() : '']
        for (let at = element, up = 0; at && up < 6; at = above(at), up += 1) {
            const style = getComputedStyle(at)
            const lined = style.outlineStyle !== 'none' && style.outlineWidth !== '0px'
            seen.push(lined ? style.outline : '', style.boxShadow, style.borderColor,
                style.backgroundColor, style.opacity, style.clip, style.transform)
        }
        return JSON.stringify(seen)
    }
    // The table of pairs draws its focus itself, in a frame of its own, which may come late.
    const wait = element.tagName === 'CANVAS' ? 400 : 25
    const drawn = () => new Promise((done) => setTimeout(done, wait))
    const outer = element.getRootNode().host ?? element
    const box = element.getBoundingClientRect()
    const found = {
        tag: element.tagName,
        text: (element.getAttribute('aria-label') || words(element)).trim().slice(0, 60),
        key: [...(outer.closest('[class*=st-key-]')?.classList ?? [])]
            .find((name) => name.startsWith('st-key-'))?.slice(7) ?? '',
        inside: box.bottom > 0 && box.top < innerHeight && box.right > 0 && box.left < innerWidth,
    }
    // The scroll area of the page takes the focus too, for the arrow keys: it is no control.
    if (found.tag === 'MAIN') return { ...found, visible: true, inside: true }
    await drawn()
    const focused = look()
    element.blur()
    await drawn()
    const blurred = look()
    element.focus({ preventScroll: true, focusVisible: true })
    return { ...found, visible: focused !== blurred }
}"""
"""What has the focus, and whether anything on the screen shows it."""
LONGEST_WALK = 140
STILL = "*, *::before, *::after { transition: none !important; animation: none !important; }"
"""What shows the focus may come slowly; it is looked at once."""


MOST_STOPS = 4
"""From *Skip to main content* to the first button of Start. Measured: 3; with the toolbars of the
figures and the links of headings 23."""


@pytest.mark.parametrize("name", ["start", "data", "calibrate", "apply"])
def test_tab_goes_through_a_page_and_out(
    page: Page, app_url: str, finished: Project, name: str
) -> None:
    """The table of pairs and the photographs to pick in hold nobody."""
    visit(page, app_url, name, finished)
    if name == "data":
        page.get_by_text("The pairs as a table").click()
        one_of(page, "One frame").click()
        expect(page.locator(".st-key-pick_secondary canvas")).to_have_attribute(
            "data-ready", re.compile(".")
        )
        page.mouse.click(700, 20)
    settle(page)
    page.add_style_tag(content=STILL)
    page.keyboard.press("Tab")
    seen: list[dict[str, Any] | None] = [page.evaluate(FOCUSED)]
    if name == "start":
        # Buttons are drawn by a script that comes later where many projects are listed.
        page.locator(".st-key-recording button").wait_for()
        assert seen[0] and seen[0]["text"] == "Skip to main content"
        page.keyboard.press("Enter")
    while len(seen) < LONGEST_WALK and seen.count(None) < 2:
        page.keyboard.press("Tab")
        seen.append(page.evaluate(FOCUSED))
    assert seen.count(None) == 2, "Tab does not come to an end"
    if name == "start":
        assert "recording" in {now["key"] for now in seen[: 1 + MOST_STOPS] if now}
    first, second = (at for at, now in enumerate(seen) if now is None)
    through = [now for now in seen[first + 1 : second] if now]
    # Streamlit's table draws its focus itself, and not at once: that is not ours to look at.
    ours = [now for now in through if now["tag"] != "CANVAS" or not now["key"].startswith("pairs_")]
    lost = [now for now in ours if not (now["visible"] and now["inside"])]
    assert not lost, json.dumps(lost)
    words = {now["text"] for now in seen if now}
    assert {"Start", "Data", "Apply"} <= words  # the menu, and with it a way to every page
    if name == "data":
        pickers = [now for now in through if now["text"].startswith("Photograph of the")]
        assert len(pickers) == 2 and any(now["tag"] == "CANVAS" for now in through)
        assert {"As they were found", "Zoom in", "Go to target A"} <= words


FOCUS = "document.activeElement.matches('[data-testid=stMain]')"


def test_the_focus_goes_with_the_page(page: Page, app_url: str, finished: Project) -> None:
    """From a button to the top of the page that it opens; a link of the menu keeps it."""
    visit(page, app_url, "plan", finished)
    for key in ("cameras", "data"):
        page.locator(".st-key-next button").press("Enter")
        expect(page).to_have_url(re.compile(f"/{key}"))
        settle(page)
        assert page.evaluate(FOCUS)
    link = page.get_by_test_id("stSidebar").get_by_role("link", name="Calibrate", exact=False)
    link.press("Enter")
    expect(page.get_by_role("heading", name="Calibrate", exact=True).first).to_be_visible()
    settle(page)
    expect(link).to_be_focused()
    page.locator(".st-key-run").wait_for()
    page.reload()  # begins at the top, as every new page does
    settle(page)
    page.keyboard.press("Tab")
    assert page.evaluate(FOCUSED)["text"] == "Skip to main content"


def test_frames_play_and_stop_by_keyboard(page: Page, app_url: str, finished: Project) -> None:
    visit(page, app_url, "apply", finished)
    expect(page.get_by_text(" in 14 frames, none").first).to_be_visible(timeout=LONGEST_MS)
    settle(page)
    slider = page.locator("[class*=st-key-apply_frame_] input")
    slider.focus()
    page.keyboard.press("ArrowRight")
    expect(page.get_by_text(re.compile("^Frame 2: ")).first).to_be_visible()
    play = page.locator(".st-key-apply_play button")
    play.press("Enter")
    expect(page.get_by_text(re.compile(r"^Frame ([4-9]|\d\d+): "))).to_be_visible(
        timeout=LONGEST_MS
    )
    play.press("Enter")
    expect(play).to_contain_text("Play", timeout=LONGEST_MS)
    page.wait_for_timeout(1000)  # a step that was under way
    settle(page)
    stopped = slider.get_attribute("aria-valuetext")
    page.wait_for_timeout(2000)  # four frames, if it went on
    assert slider.get_attribute("aria-valuetext") == stopped
