"""Plans whose cameras look through a window."""

import json
from pathlib import Path

import numpy as np
import pytest

from stereocal.cli import main
from stereocal.field.planning.plan import AimedPose, Plan, PlannedWindow, SensorLens, Uncertainty
from stereocal.field.planning.through_window import WindowForecast, forecast_through_window
from stereocal.fit.calibrate import calibrate_rig
from stereocal.formats.plan_file import parse_plan, write_plan
from stereocal.rig.window import WATER
from tests.refused import refused
from tests.rigs.behind_glass import LENS_ERRORS, Tank, further, submerged

LENS = SensorLens(13.1, (13.0, 10.4), (1280, 1024))
KNOWN = Uncertainty(*LENS_ERRORS, 0.002, 2e-5)
WINDOW = PlannedWindow(0.4, 0.01)
TANK = Plan("tank", LENS, LENS, AimedPose(0.5, 20.0), 0.55, 1.05, 0.1, 80, 0.2, KNOWN, 0.02, WINDOW)


@pytest.fixture(scope="module")
def planned() -> WindowForecast:
    return forecast_through_window(TANK, days=4)


def test_it_expects_what_recordings_of_such_a_tank_give(planned: WindowForecast) -> None:
    measured = []
    for seed in range(4):
        rng = np.random.default_rng([40, seed])
        scene = submerged(Tank(), rng)
        rig = calibrate_rig(scene.asked()).pair("c1", "c2")
        rows = further(scene, rng, 100).recording.pair("c1", "c2").correspondences
        ends = rig.reconstruct(rows.primary, rows.secondary)[rows.bars]
        lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
        measured.append(float(np.percentile(np.abs(lengths / scene.tank.bar_m - 1.0), 95)))
    expected = planned.length_p95
    assert expected.low / 1.5 < np.median(measured) < 1.5 * expected.high
    assert planned.answer.startswith("Yes, it reaches what you need: 95 % of lengths are within 0.")
    assert "an index of the medium that is 0.002 too large, lengths become 0.0" in planned.answer


def test_the_cost_of_a_wrong_index_grows_with_the_error_of_the_depth(
    planned: WindowForecast,
) -> None:
    # Behind a window alone, a depth is seen at 1/m of itself: lengths change by at most dm/m.
    assert 0 < abs(planned.of_wrong_index) < 0.002 / WATER


def test_a_plan_file_states_the_window_and_the_command_writes_the_report(tmp_path: Path) -> None:
    content = write_plan(TANK)
    assert write_plan(parse_plan(content, "plan", str.encode)) == content
    path, out = tmp_path / "plan.json", tmp_path / "out"
    path.write_bytes(content)
    assert main(["plan", str(path), "--out", str(out)]) == 0
    forecast = json.loads((out / "forecast.json").read_text(encoding="utf-8"))
    assert forecast["length_error_p95"]["low"] <= forecast["length_error_p95"]["value"]
    assert "Window" in (out / "report.html").read_text(encoding="utf-8")


def test_a_window_that_cannot_be_is_refused() -> None:
    data = json.loads(write_plan(TANK))
    for wrong in ({"distance_m": 2.0}, {"distance_m": 0.4, "medium": 9.0}, {"thickness_m": 0.01}):
        with refused("plan"):
            parse_plan(json.dumps({**data, "window": wrong}).encode(), "plan", str.encode)
