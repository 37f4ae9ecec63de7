"""What is printed comes out of the pages: made when its button is pressed, with what is chosen."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Page

from stereocal.field.printing.paper import PAPERS
from stereocal.field.printing.print_board import print_board
from stereocal.intrinsics.board_pattern import BoardPattern
from tests.browser.conftest import choose

pytestmark = pytest.mark.browser


def downloaded(page: Page, button: str) -> bytes:
    with page.expect_download() as event:
        page.get_by_role("button", name=button).click()
    return Path(event.value.path()).read_bytes()


def test_the_board_of_the_chosen_paper(
    app_url: str, page: Page, settled: Callable[[Page], None]
) -> None:
    page.goto(f"{app_url}/cameras")
    page.get_by_text("Print a chessboard", exact=True).click()
    choose(page, "print_paper_board", "A3")
    settled(page)
    page.get_by_text("the largest on A3").wait_for()
    board = print_board(BoardPattern(18, 12, 0.02), PAPERS["A3"])
    assert downloaded(page, "board.pdf") == board.pdf()
    assert downloaded(page, "board.svg") == board.svg().encode()


def test_targets_and_field_sheet_of_a_plan(
    app_url: str, page: Page, settled: Callable[[Page], None]
) -> None:
    page.goto(f"{app_url}/plan")
    settled(page)
    assert downloaded(page, "Field sheet (PDF)").startswith(b"%PDF")
    page.get_by_text("Print the targets", exact=True).click()
    assert b"175 mm" in downloaded(page, "target.svg")
