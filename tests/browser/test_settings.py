"""What a person has set stands on every form, whichever way its page was come to."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Sequence
from contextlib import closing
from itertools import pairwise, permutations
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from stereocal.projects.project import Project
from stereocal.ui.menu import TITLES
from tests.browser.conftest import LONGEST_MS
from tests.browser.work import finished_project

pytestmark = pytest.mark.browser
Settled = Callable[[Page], None]

SET: dict[str, dict[str, Any]] = {
    "data": {
        "baseline_m_unit": "cm",
        "target_distance_m_unit": "mm",
        "frames_view": "One frame",
        "review_target": "B",
        "review_raw": True,
        "baseline_m_known": "Tape",
        "target_distance_m_known": "Typed",
    },
    "plan": {
        "plan_name": "pond",
        "plan_alike": False,
        "plan_baseline_m": 5.0,
        "plan_toe_in_deg": 11.5,
        "plan_near_m": 9.0,
        "plan_far_m": 22.0,
        "plan_bar_m": 1.1,
        "plan_frames": 30,
        "plan_noise_px": 0.35,
    },
    "cameras": {
        "board_kind": "ChArUco",
        "board_columns": 9,
        "board_rows": 7,
        "board_square_mm": 25.0,
        "board_marker_mm": 18.5,
        "board_dictionary": "DICT_5X5_100",
        "lens_subset": 9,
        "lens_repeats": 13,
        "lens_seed": 4,
        "lens_fix_k3": True,
        "lens_zero_tangential": True,
    },
    "calibrate": {
        "calibration_frames": 11,
        "delta": 0.002,
        "delta_min": 3e-6,
        "acceptance": 0.25,
        "shrink": 0.8,
        "minimum_moves": 25,
        "seed": 5,
        "essential": "linear",
        "view": "Parameters",
        "rig_method": "2d",
        "rig_view": "Side",
        "format_file": "3d",
        "format": "dlt",
        "dlt_corner_3d": "lower-left",
        "dlt_first_3d": 0.5,
    },
    "validate": {
        "delta": 0.002,
        "delta_min": 3e-6,
        "acceptance": 0.25,
        "shrink": 0.8,
        "minimum_moves": 25,
        "seed": 5,
        "essential": "linear",
        "validate_runs": 40,
        "validate_frames": 9,
        "bin_width": 0.2,
        "with_refined": False,
        "columns": "Residual",
    },
    "one_set": {"curve": "As given", "along": 30},
    "apply": {
        "apply_matching": "3d",
        "apply_measuring": "2d",
        "apply_only_depths": True,
        "apply_near": 1.5,
        "apply_far": 60.0,
        "apply_threshold": 2.5,
        "apply_view": "Threshold and depths",
    },
    "check": {"check_turn_deg": 0.2, "check_baseline_percent": 0.5},
}
"""Of each page, by the key of the widget; none is the usual value, none its least."""
SHOWN = {
    **{key: value for values in SET.values() for key, value in values.items()},
    **{
        key: "true" if value else "false"
        for key, value in (
            ("review_raw", True),
            ("lens_fix_k3", True),
            ("lens_zero_tangential", True),
            ("with_refined", False),
            ("apply_only_depths", True),
            ("plan_alike", False),
        )
    },
    "plan_toe_in_deg": "11.50",
    "delta_min": "0.000003",
    "board_square_mm": "25",
    "apply_far": "60",
    "dlt_first_3d": "0.50",
    "rig_method": "2D set",
    "dlt_corner_3d": "lower left",
    "apply_matching": "3D set",
    "apply_measuring": "2D set",
    "format_file": "3D set",
    "format": "DLT coefficients (DLTdv, easyWand, Argus)",
}
"""As the browser shows it."""

STATED: dict[str, Any] = {
    "baseline_sigma_m": 0.005,
    "target_distance_sigma_m": 0.0007,
    "lens_known": {"primary": [0.004, 6.0]},
}
"""What the Data page's fields of how well things are known write."""
STATED_SHOWN = {
    "review_frame": "5",
    "baseline_m_known": "Tape: ± 5 mm",
    "target_distance_m_known": "Typed, in mm",
    "target_distance_m_sigma_mm": "0.7",
    "lens_primary_known": "Typed",
    "lens_primary_focal_percent": "0.4",
    "lens_primary_centre_px": "6",
    "lens_secondary_known": "Not stated",
}

READ = """() => Object.fromEntries(
  [...document.querySelectorAll('[data-testid=stMain] [class*="st-key-"]')].flatMap(box => {
    const key = [...box.classList].find(name => name.startsWith('st-key-')).slice(7);
    const seen = [
      ...[...box.querySelectorAll('input:not([type=checkbox]):not([type=radio])')]
        .map(input => input.getAttribute('aria-valuetext') || input.value),
      ...[...box.querySelectorAll('[role=radio][aria-checked=true]')].map(one => one.textContent),
      ...[...box.querySelectorAll('input[type=checkbox]')].map(tick => `${tick.checked}`),
      ...[...box.querySelectorAll('[data-baseweb=select]')].map(menu => menu.innerText.trim()),
    ];
    return seen.length ? [[key, seen.join(' | ')]] : [];
  }))"""
"""What every keyed widget of the page shows."""


def forms(page: Page, wanted: dict[str, str]) -> dict[str, str]:
    """What the forms of the page say: `wanted`, as soon as they do, or what they say in the end."""
    ready = page.locator("[data-testid=stApp][data-test-script-state=notRunning]")
    for _ in range(100):
        expect(ready).to_be_attached(timeout=LONGEST_MS)
        found: dict[str, str] = page.evaluate(READ)
        if found.items() >= wanted.items():
            break
        page.wait_for_timeout(150)
    expect(page.locator("[data-testid=stException]")).to_have_count(0)
    expect(page.locator("[data-testid=stAlertContentError]")).to_have_count(0)
    return {key: found.get(key, "not there") for key in wanted}


def arrive(page: Page, name: str, settled: Settled) -> None:
    """Wait until a page's own title stands there, not the last one's."""
    title = "Two cameras, a bar, two lengths" if name == "start" else TITLES[name]
    expect(page.get_by_test_id("stMain").locator("h1")).to_have_text(title, timeout=LONGEST_MS)
    settled(page)


def all_pairs(names: Sequence[str]) -> list[str]:
    """A walk in which each name is followed once by each other one (Hierholzer)."""
    ahead = {name: [other for other in names if other != name] for name in names}
    walk, path = [], [names[0]]
    while path:
        if left := ahead[path[-1]]:
            path.append(left.pop())
        else:
            walk.append(path.pop())
    return walk[::-1]


def content(project: Project) -> list[object]:
    """What a person has given, set and corrected; results are computed as pages are opened."""
    with closing(sqlite3.connect(project.database.path)) as db:
        return [db.execute(f"SELECT * FROM {table}").fetchall() for table in ("value", "edit")]


def test_settings_survive_every_way_from_page_to_page(
    page: Page, app_url: str, home: Path, settled: Settled
) -> None:
    project = Project.open(home, finished_project(home))
    for values in SET.values():
        project.keep_settings(values)
    project.keep_settings({"frame": 5})  # one value for the frame fields of all pages
    project.give({}, **STATED)
    stored = content(project)
    walk = all_pairs(list(TITLES))
    assert sorted(pairwise(walk)) == sorted(permutations(TITLES, 2))

    page.goto(f"{app_url}/?project={project.id}")
    arrive(page, "start", settled)
    for before, name in pairwise(walk):
        # The page before was drawn for its address, by F5: that starts a session anew.
        page.get_by_test_id("stSidebar").get_by_role("link", name=TITLES[name], exact=True).click()
        arrive(page, name, settled)
        wanted = {key: str(SHOWN[key]) for key in SET.get(name, {})}
        if name == "data":
            wanted |= STATED_SHOWN
        assert forms(page, wanted) == wanted, (before, name, "by the menu")
        page.reload()
        arrive(page, name, settled)
        assert forms(page, wanted) == wanted, (before, name, "F5")
    assert content(project) == stored  # a draw writes nothing


@pytest.mark.parametrize("wait_ms", [0, 30, 100, 300])
def test_a_sample_is_whole_though_start_is_left_at_once(
    page: Page, app_url: str, home: Path, settled: Settled, wait_ms: int
) -> None:
    page.goto(app_url)
    arrive(page, "start", settled)
    page.locator(".st-key-demo button").click()
    page.wait_for_timeout(wait_ms)
    page.get_by_test_id("stSidebar").get_by_role("link", name="Calibrate").click()
    arrive(page, "calibrate", settled)
    expect(page.locator(".st-key-run button")).to_be_visible()
    expect(page.get_by_text("it needs")).to_have_count(0)
    project = Project.open(home, page.url.rsplit("=", 1)[1])
    assert project.dataset is not None
