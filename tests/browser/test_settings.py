"""What a person has set stands on every form, whichever way its page was come to."""

from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from stereocal.projects.project import Project
from stereocal.ui.menu import TITLES
from tests.browser.conftest import LONGEST_MS, settle
from tests.browser.work import finished_project

pytestmark = pytest.mark.browser

SET: dict[str, dict[str, Any]] = {
    "data": {
        "baseline_m_unit": "cm",
        "frames_view": "One frame",
        "review_target": "B",
        "baseline_m_known": "Tape",
    },
    "plan": {
        "plan_name": "pond",
        "plan_alike": False,
        "plan_baseline_m": 5.0,
        "plan_near_m": 9.0,
        "plan_frames": 30,
    },
    "cameras": {
        "board_kind": "ChArUco",
        "board_columns": 9,
        "board_square_mm": 25.0,
        "lens_seed": 4,
        "lens_fix_k3": True,
    },
    "calibrate": {
        "calibration_frames": 11,
        "delta": 0.002,
        "delta_min": 3e-6,
        "essential": "linear",
        "view": "Parameters",
        "rig_method": "2d",
        "refine_sigma_px": 0.3,
    },
    "validate": {
        "delta": 0.002,
        "validate_runs": 40,
        "validate_frames": 9,
        "bin_width": 0.2,
        "with_refined": False,
        "columns": "Residual",
    },
    "apply": {
        "apply_matching": "3d",
        "apply_only_depths": True,
        "apply_near": 1.5,
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
            ("lens_fix_k3", True),
            ("with_refined", False),
            ("apply_only_depths", True),
            ("plan_alike", False),
        )
    },
    "delta_min": "0.000003",
    "board_square_mm": "25",
    "essential": "Linear",
    "rig_method": "2D set",
    "apply_matching": "3D set",
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
    const name = [...box.classList].find(name => name.startsWith('st-key-'));
    const key = name.slice(7).replace(/_\\d+_\\d+$/, '');
    const seen = [
      ...[...box.querySelectorAll('input:not([type=checkbox]):not([type=radio])')]
        .map(input => input.getAttribute('aria-valuetext') || input.value),
      ...[...box.querySelectorAll('[role=radio][aria-checked=true]')].map(one => one.textContent),
      ...[...box.querySelectorAll('input[type=checkbox]')].map(tick => `${tick.checked}`),
      ...[...box.querySelectorAll('[data-baseweb=select]')].map(menu => menu.innerText.trim()),
    ];
    return seen.length ? [[key, seen.join(' | ')]] : [];
  }))"""
"""What every keyed widget of the page shows; sliders have their ends in their keys."""


def forms(page: Page, wanted: dict[str, str]) -> dict[str, str]:
    """What the forms of the page say: `wanted`, as soon as they do, or what they say in the end."""
    for _ in range(100):
        settle(page)
        found: dict[str, str] = page.evaluate(READ)
        if found.items() >= wanted.items():
            break
        page.wait_for_timeout(150)
    expect(page.locator("[data-testid=stException]")).to_have_count(0)
    expect(page.locator("[data-testid=stAlertContentError]")).to_have_count(0)
    return {key: found.get(key, "not there") for key in wanted}


def arrive(page: Page, name: str) -> None:
    """Wait until a page's own title stands there, not the last one's."""
    title = "Two cameras, a bar, two lengths" if name == "start" else TITLES[name]
    expect(page.get_by_test_id("stMain").locator("h1")).to_have_text(title, timeout=LONGEST_MS)
    settle(page)


def test_settings_survive_the_menu_f5_and_addresses(page: Page, app_url: str, home: Path) -> None:
    project = Project.open(home, finished_project(home))
    for values in SET.values():
        project.keep_settings(values)
    project.keep_settings({"frame": 5})  # one value for the frame fields of all pages
    project.give({}, **STATED)
    stored = project.settings, project.inputs
    page.goto(f"{app_url}/?project={project.id}")
    arrive(page, "start")
    for name in reversed(TITLES):
        wanted = {key: str(SHOWN[key]) for key in SET.get(name, {})}
        wanted |= STATED_SHOWN if name == "data" else {}
        # The page before was drawn for its address, by F5: that starts a session anew.
        page.get_by_test_id("stSidebar").get_by_role("link", name=TITLES[name], exact=True).click()
        arrive(page, name)
        assert forms(page, wanted) == wanted, (name, "by the menu")
        page.reload()
        arrive(page, name)
        assert forms(page, wanted) == wanted, (name, "F5")
    project = Project.open(home, project.id)
    assert (project.settings, project.inputs) == stored  # a draw writes nothing
