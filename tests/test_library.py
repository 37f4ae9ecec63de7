"""What a script gets from `import stereocal`, and that the documented script runs."""

import ast
import copy
import json
import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import pytest

import stereocal
from stereocal.library.calibrations import CalibratedRig, CalibrationRun, Look
from stereocal.matching.application import points_by_camera
from stereocal.rig.parameters import RigParameters
from stereocal.system.answers import MOST_LINES, Answer, answering
from tests.files import write
from tests.photographs.bars import bar_set
from tests.refused import refused
from tests.sample_field import calibrated_field

ROOT = Path(__file__).parents[1]


def test_the_documented_script_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (script,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs/library.md").read_text(), re.S)
    lines = [line for line in script.splitlines() if line.strip() and not line.startswith("#")]
    assert len(lines) <= 20
    (tmp_path / "field").symlink_to(ROOT / "sample_data" / "field")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(script.replace("runs=100", "runs=3"), "library.md", "exec"), names)
    pairs, points = names["pairs"], names["points"]
    assert len(pairs) == len(points) > 45  # type: ignore[arg-type]  # of 50
    assert np.isfinite(points[["x", "y", "z", "sigma_z"]].to_numpy()).all()  # type: ignore[index]
    assert RigParameters.load("calibration/parameters_3d.json").purpose == "reconstruction"
    assert Path("calibration/opencv/extrinsics.yml").is_file()
    assert "error_px" in capsys.readouterr().out


def test_the_notebook_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten cells; what stands last in a cell says its answer, or is a figure."""
    monkeypatch.chdir(tmp_path)
    cells = json.loads((ROOT / "docs" / "notebook.ipynb").read_text())["cells"]
    names: dict[str, object] = {}
    codes = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert len(codes) == 10
    for number, code in enumerate(codes):
        # As many runs as written take 20 s; the cells are otherwise as they are.
        tree = ast.parse(re.sub(r"runs=\d+", "runs=3", code))
        last = tree.body[-1]
        ends = isinstance(last, ast.Expr) and number < len(codes) - 1
        before = ast.Module(tree.body[:-1] if ends else tree.body, [])
        exec(compile(before, f"cell {number}", "exec"), names)
        if ends:
            assert isinstance(last, ast.Expr)
            shown = eval(compile(ast.Expression(last.value), f"cell {number}", "eval"), names)
            if isinstance(shown, Answer):
                assert 1 <= len(repr(shown).splitlines()) <= MOST_LINES
                assert "<p>" in shown._repr_html_()
            else:
                assert isinstance(shown, go.Figure | pd.DataFrame)
    assert sorted(path.name for path in Path("calibration").iterdir()) == [
        "opencv",
        "parameters_2d.json",
        "parameters_3d.json",
        "parameters_refined.json",
    ]


@pytest.fixture(scope="module")
def run() -> CalibrationRun:
    return answering(CalibrationRun, calibrated_field())


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_results_can_be_kept_and_copied(run: CalibrationRun, copied: Callable[[Any], Any]) -> None:
    """With all that was computed: a copy says the same, and computes on."""
    repr(run)
    primary, secondary = points_by_camera(run.dataset.recording).values()
    pairs = stereocal.match(run.sets["2d"], primary, secondary)
    points = stereocal.reconstruct(run.sets["3d"], pairs)
    checked = stereocal.check(run.sets["refined"], run.dataset)
    everything: list[Any] = [run, run.dataset, run.recommendation, *run.sets.values()]
    for value in (*everything, pairs, points, checked):
        again = copied(value)
        assert type(again) is type(value)
        assert repr(again) == repr(value)
    again = copied(run)
    assert again.evaluate(runs=2).to_dataframe().equals(run.evaluate(runs=2).to_dataframe())


def test_a_validation_reaches_recommendation_and_sets(run: CalibrationRun) -> None:
    fresh = answering(CalibrationRun, run)
    assert fresh.sets["2d"].to_json()["validation"] is None
    whose = re.compile(r"below [\d.]+\s+px\s+\((.*?)\)", re.S)
    assert {*whose.findall(repr(fresh))} == {"forecast"}
    found = fresh.evaluate(runs=5)
    assert {" ".join(of.split()) for of in whose.findall(repr(fresh))} == {"held-out frames"}
    told = fresh.sets["2d"].validation
    assert told is not None
    assert told["runs"] == 5
    assert fresh.sets["2d"].matching_threshold_px == told["threshold_px"]
    assert found.to_dataframe().loc[("all", "2d"), "threshold_px"] == told["threshold_px"]
    with refused("validation"):
        answering(CalibrationRun, run).plot("validation")


def test_a_rig_is_calibrated_matched_and_checked() -> None:
    recording = stereocal.read(ROOT / "sample_data" / "rig")
    assert isinstance(recording, stereocal.Recording)
    with refused("3 cameras", "recording.pair"):
        stereocal.calibrate(recording, refined=None)
    some = recording.where(recording.frame % 20 == 0)
    found = stereocal.calibrate_rig(some)
    alike = stereocal.calibrate(some)
    assert isinstance(alike, CalibratedRig)
    assert np.array_equal(alike.covariance, found.covariance)
    assert len(repr(found).splitlines()) <= MOST_LINES
    assert "<table" in found._repr_html_()
    tracks = stereocal.match(found, points_by_camera(some))
    points = stereocal.reconstruct(found, tracks)
    assert len(points) == len(tracks)
    assert np.nanmedian(points["error_px"]) < 0.5  # 0.2 px
    checked = stereocal.check(found, some)
    assert checked.verdict in ("same", "cannot tell") and checked.repaired is None
    figures = [found.plot(), found.plot("cameras"), tracks.plot(), points.plot()]
    figures += [checked.plot(pair) for pair in checked.residuals]
    assert len(figures) == 7
    assert all(len(figure.data) > 0 for figure in figures)
    assert repr(pickle.loads(pickle.dumps(found))) == repr(found)


@pytest.mark.parametrize("look", get_args(Look))
def test_every_look_is_drawn(run: CalibrationRun, look: Look) -> None:
    if look == "validation":
        run.evaluate(runs=2)
    assert len(run.plot(look).data) > 0


def test_tables_in_memory_are_a_recording(run: CalibrationRun) -> None:
    """Long and wide tables give what the files give."""
    dataset = run.dataset
    cameras = {"primary": dataset.primary, "secondary": dataset.secondary}
    about = cameras, 0.9, dataset.baseline_m
    wide = stereocal.Recording.from_dataframe(dataset.to_dataframe(), *about)
    long = stereocal.Recording.from_dataframe(wide.to_dataframe(), *about)
    for recording in (wide, long):
        again = recording.pair("primary", "secondary")
        assert again.to_dataframe()[["frame", "target", "u_primary", "v_secondary"]].equals(
            dataset.to_dataframe()[["frame", "target", "u_primary", "v_secondary"]]
        )
        assert (again.baseline_m, again.target_distance_m) == (dataset.baseline_m, 0.9)
    # A pair whose baseline nobody measured is calibrated as the command does it: it is found.
    free = replace(wide, baselines_m={}).pair("primary", "secondary")
    found = stereocal.calibrate(free).dataset.baseline_m
    assert free.baseline_is_to_be_found and found == pytest.approx(dataset.baseline_m, rel=0.01)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"target": "C"}, "C"),
        ({"frame": 1.5}, "whole"),
        ({"frame": 1}, "twice"),
        ({"u_primary": 99_999.0}, "outside"),
        ({"u_primary": "x"}, "number"),
        ({"frame": "x"}, "number"),
    ],
)
def test_a_wrong_table_is_refused(run: CalibrationRun, changes: dict[str, Any], said: str) -> None:
    cameras = {"primary": run.dataset.primary, "secondary": run.dataset.secondary}
    table = run.dataset.to_dataframe().assign(**changes)
    with refused(said):
        stereocal.Recording.from_dataframe(table, cameras, 0.9, 4.5)


def test_frames_without_common_points_match_nothing(run: CalibrationRun) -> None:
    primary, secondary = points_by_camera(run.dataset.recording).values()
    pairs = stereocal.match(run.sets["2d"], primary.iloc[:0], secondary)
    assert len(pairs) == 0
    assert "u_primary" in pairs
    assert len(stereocal.reconstruct(run.sets["3d"], pairs)) == 0
    # Of rows without a point, as of those in a file.
    lost = pd.concat([primary, primary[:1].assign(u=np.nan, v=np.nan)])
    pairs = stereocal.match(run.sets["2d"], lost, secondary)
    assert len(pairs) > 0 and "1 row without a point left out" in repr(pairs)


def test_points_counted_apart_are_matched_without_a_common_number(run: CalibrationRun) -> None:
    """Frames of cameras started by hand may have no number in common at all."""
    primary, secondary = points_by_camera(run.dataset.recording).values()
    later = int(primary["frame"].max()) + 100
    rig = replace(run.sets["2d"], start_frame=-later)
    pairs = stereocal.match(rig, primary, secondary.assign(frame=secondary["frame"] + later))
    assert len(pairs) == len(stereocal.match(run.sets["2d"], primary, secondary)) > 0
    assert len(stereocal.match(rig, primary.iloc[:0], secondary)) == 0


def test_cameras_are_read_from_paths_and_called_by_numbers(tmp_path: Path) -> None:
    """As a table of pandas has them: whole numbers, and NumPy's lengths."""
    path = ROOT / "sample_data" / "field" / "primary.json"
    camera = stereocal.read_camera(path)
    assert np.array_equal(camera.K, stereocal.read_camera(path.read_bytes(), "lens").K)
    with refused("nothing.json"):
        stereocal.read_camera(tmp_path / "nothing.json")
    table = pd.DataFrame({"frame": 0, "camera": [1, 2], "target": "A", "u": 9.0, "v": 9.0})
    cameras: dict[Any, Any] = {1: camera, 2: camera}
    apart: Any = np.float32(4.5)
    found = stereocal.Recording.from_dataframe(table, cameras, 0.9, apart)
    assert [*found.cameras] == ["1", "2"]
    with refused("read_camera"):
        stereocal.Recording.from_dataframe(table, cameras | {2: path}, 0.9)


def test_cameras_started_by_hand_are_brought_into_step() -> None:
    recording = stereocal.read(ROOT / "sample_data" / "rig")
    assert isinstance(recording, stereocal.Recording)
    two = recording.of_cameras(["1", "2"])
    some = two.where(two.frame < 100)
    shifted = some.camera == 1
    found = stereocal.sync(replace(some, frame=some.frame - 41 * shifted))
    np.testing.assert_array_equal(found.recording.frame, some.frame)
    assert found.to_dataframe()["frames"].to_numpy() == pytest.approx([41.0], abs=0.1)
    assert len(found.plot().data) > 0


def test_targets_found_are_calibrated(tmp_path: Path) -> None:
    bars = bar_set(6)
    write(bars.files() | bars.described, tmp_path)
    found = stereocal.detect(tmp_path)
    assert len(found.frames) == 6
    assert isinstance(found.recording, stereocal.Pair)
    assert len(found.to_dataframe()) == 2 * sum(frame.use for frame in found.frames)
    assert len(found.plot().data) > 0


def test_calibrate_gives_the_refined_set_unless_told_not_to(run: CalibrationRun) -> None:
    dataset, refined = run.dataset, run.parameters("refined")
    assert (refined.method, refined.purpose) == ("refined", "both")
    # The lenses as given are off; the refined set finds them again (sample_data/README.md).
    assert refined.primary.K[0, 0] != dataset.primary.K[0, 0]
    with refused("refined"):
        stereocal.calibrate(dataset, refined=None).parameters("refined")


def test_every_name_is_there() -> None:
    assert sorted(stereocal.__all__) == dir(stereocal)
    for name in stereocal.__all__:
        assert getattr(stereocal, name).__name__ == name
    with pytest.raises(AttributeError, match="nothing"):
        _ = stereocal.nothing


def test_importing_alone_is_quick() -> None:
    """It brings none of the large packages."""
    large = {"numpy", "numba", "cv2", "scipy"}
    code = f"import stereocal, sys; print(sorted({large} & set(sys.modules)))"
    run = subprocess.run(
        [sys.executable, "-c", code], check=True, cwd=ROOT, capture_output=True, text=True
    )
    assert run.stdout.strip() == "[]"
