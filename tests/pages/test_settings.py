"""What a person has set stands on every form of a new tab, and a draw writes nothing."""

import re
from pathlib import Path
from typing import Any

import pytest

from tests.pages.stored_projects import FULL, ended, page_of, placed

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
        "calibration_frames": 5,
        "delta": 0.002,
        "delta_min": 3e-6,
        "essential": "linear",
        "view": "Stated and estimated",
        "rig_method": "2d",
        "refine_sigma_px": 0.3,
    },
    "validate": {
        "delta": 0.002,
        "validate_runs": 20,
        "validate_frames": 3,
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
"""Of each page, by the key of the widget; none is the usual value."""
STATED: dict[str, Any] = {
    "baseline_sigma_m": 0.005,
    "target_distance_sigma_m": 0.0007,
    "lens_known": {"primary": [0.004, 6.0]},
}
"""What the Data page's fields of how well things are known write."""
STATED_SHOWN = {
    "review_frame": 5,
    "target_distance_m_known": "Typed",
    "target_distance_m_sigma_mm": 0.7,
    "lens_primary_known": "Typed",
    "lens_primary_focal_percent": 0.4,
    "lens_primary_centre_px": 6.0,
    "lens_secondary_known": "Not stated",
}
KINDS = ("number_input", "segmented_control", "select_slider", "selectbox", "slider", "text_input")


@pytest.mark.parametrize("name", SET)
def test_what_was_set_stands_on_its_page(name: str, home: Path) -> None:
    project = placed(FULL, home)
    for values in SET.values():
        project.keep_settings(values)
    project.keep_settings({"frame": 5})  # one value for the frame fields of all pages
    project.give({}, **STATED)
    stored = project.settings, project.inputs
    app = page_of(project, name)
    if name == "validate":
        assert ended(project, "evaluation").state == "done"
        app.run()
    assert not app.exception and not app.error
    wanted = SET[name] | (STATED_SHOWN if name == "data" else {})
    widgets = [each for kind in (*KINDS, "toggle") for each in getattr(app, kind)]
    # The keys of sliders end in their ends.
    shown = {re.sub(r"_\d+_\d+$", "", str(each.key)): each.value for each in widgets}
    assert {key: shown.get(key) for key in wanted} == wanted
    assert (project.settings, project.inputs) == stored
