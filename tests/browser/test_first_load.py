"""What stands on the screen from the first moment of a new server on, and of a warm one."""

from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from stereocal.ui.menu import TITLES
from tests.browser.conftest import LONGEST_MS, serve, settle

pytestmark = pytest.mark.browser
WATCH = """
window.seen = []
let last = ''
setInterval(() => {
    const texts = (all) => [...document.querySelectorAll(all)].map((one) => one.innerText.trim())
    const now = { menu: texts('[data-testid=stSidebarNavLink] span:last-of-type'),
        titles: texts('h1'), bars: texts('[data-testid=stProgress]').length,
        asked: !!document.querySelector('[data-test-script-state=running]') }
    if (JSON.stringify(now) === last) return
    last = JSON.stringify(now)
    window.seen.push({ ...now, ms: performance.now() })
}, 10)
"""


def seen(page: Page) -> list[dict[str, Any]]:
    return list(page.evaluate("window.seen"))


@pytest.mark.parametrize(("path", "first"), [("", "stereocal"), ("apply", "Apply")])
def test_a_new_server_shows_a_title_and_our_menu_and_nothing_else(
    page: Page, tmp_path: Path, path: str, first: str
) -> None:
    """The first request imports the package for 3 s: the title and the menu stand before."""
    page.add_init_script(WATCH)
    with serve(tmp_path) as url:
        page.goto(f"{url}/{path}")
        expect(page.get_by_text("Starting …").first).to_be_visible(timeout=LONGEST_MS)
        assert seen(page)[-1]["titles"] == [first]
        settle(page)
        expect(page.get_by_text("Starting …")).to_have_count(0)
        menus = [now["menu"] for now in seen(page) if now["menu"]]
        assert menus and all(menu == list(TITLES.values()) for menu in menus)
        assert all(len(now["titles"]) <= 1 for now in seen(page))
