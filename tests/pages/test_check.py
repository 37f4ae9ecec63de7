"""The Check page, without a browser."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from streamlit.testing.v1 import AppTest

from stereocal.field.checking.repair import REPAIRED
from stereocal.formats.correspondences_csv import read_table, write_table
from stereocal.formats.dataset_files import pack_dataset
from stereocal.projects.application import (
    IMAGES,
    PARAMETERS,
    USES,
    ProjectApplication,
    ProjectCheck,
)
from stereocal.projects.archive import pack_project, unpack_project
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import place_bars
from stereocal.system.zip_files import pack_zip
from tests.docs.pages import CANNOT_TELL
from tests.pages.stored_projects import again, drop, go, project_of, told
from tests.pages.test_once import counted
from tests.rigs.bumps import Case, bumped, cases, seen_by
from tests.rigs.refined_rigs import BAR_M, DEPTHS_M


@dataclass(frozen=True)
class Files:
    """A parameter file, and new bars of the unmoved and of a moved rig, as zips and as a table."""

    parameters: bytes
    same: bytes
    moved: bytes
    table: bytes


@pytest.fixture(scope="module")
def files() -> Files:
    case: Case = next(cases(1, 45))

    def five(rig: Rig) -> dict[str, bytes]:
        return pack_dataset(seen_by(case, place_bars(rig, case.rng, 5, BAR_M, DEPTHS_M)))

    moved = five(bumped(case, np.radians(0.5)))
    return Files(
        case.prior.rig.dumps().encode(),
        pack_zip(five(case.truth)),
        pack_zip(moved),
        moved["correspondences.csv"],
    )


@pytest.fixture
def begun(app: AppTest) -> AppTest:
    app.switch_page("pages/check.py").run()
    assert "it needs the parameters of the rig" in told(app)
    app.button(key="check_begin").click().run()
    return app


def test_files_alone_give_the_answer(begun: AppTest, files: Files) -> None:
    assert "Still missing: the parameters" in told(begun, "info")
    known = RigParameters.loads(files.parameters, "p.json")
    bare = replace(known, uncertainties=None).dumps().encode()
    drop(begun, {"bare.json": bare}, "upload_check_parameters")
    assert "Still missing: new bars" in told(begun, "info")
    drop(begun, {"moved.zip": files.moved}, "upload_check_images")
    assert "bare.json: the file does not state the covariance" in told(begun)
    drop(begun, {"p.json": files.parameters}, "upload_check_parameters")
    assert told(begun, "warning").startswith("Moved: ")
    assert begun.session_state["page_states"]["check"].mark == "done"
    # The next session shows the same.
    tab = again(begun, "check")
    assert told(tab, "warning") == told(begun, "warning")
    drop(begun, {"same.zip": files.same}, "upload_check_images")
    assert "Cannot tell with 5 bars" in told(begun, "info")
    begun.number_input(key="check_turn_deg").set_value(1.0).run()
    begun.number_input(key="check_baseline_percent").set_value(5.0).run()
    assert "Same: no movement" in told(begun, "success")


def test_a_check_is_computed_once(
    begun: AppTest, files: Files, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = counted(monkeypatch, "stereocal.field.checking.to_check.recheck")
    drop(begun, {"p.json": files.parameters}, "upload_check_parameters")
    drop(begun, {"once.zip": files.moved}, "upload_check_images")
    again(begun, "check")
    assert len(calls) == 1
    begun.number_input(key="check_turn_deg").set_value(2.0).run()
    assert len(calls) == 2
    # The same numbers under another name, which messages have.
    drop(begun, {"renamed.zip": files.moved}, "upload_check_images")
    assert len(calls) == 3


def test_a_table_of_bars_is_kept_and_the_repaired_parameters_are_used_by_one_press(
    begun: AppTest, home: Path, files: Files, tmp_path_factory: pytest.TempPathFactory
) -> None:
    drop(begun, {"p.json": files.parameters}, "upload_check_parameters")
    drop(begun, {"bars.csv": files.table}, "upload_check_images")
    assert told(begun, "warning").startswith("Moved: ")
    packed = tmp_path_factory.mktemp("elsewhere") / "packed.zip"
    pack_project(project_of(begun, home), packed)
    check = ProjectCheck(unpack_project(packed, packed.name, packed.parent))
    for name, content in ((PARAMETERS, files.parameters), (IMAGES, files.table)):
        kept = check.file(name)
        assert kept is not None and kept.read_bytes() == content
    assert begun.button(key="use_repaired").proto.type == "primary"
    begun.button(key="use_repaired").click().run()
    assert begun.button(key="use_repaired").proto.type == "secondary"  # nothing is left to press
    assert "In use: Apply matches and measures with the repaired" in told(begun, "caption")
    store = ProjectApplication(project_of(begun, home))
    old = RigParameters.loads(files.parameters, "p.json")
    for use in USES:
        found = store.set_of(use)
        assert found is not None and found[0] == REPAIRED
        turn = (found[1].pose @ old.pose.inverse()).R
        angle = np.degrees(np.arccos((np.trace(turn) - 1) / 2))
        assert angle == pytest.approx(0.5, abs=0.05)  # by which the camera was turned
    assert f"In use: {REPAIRED}" in told(go(begun, "apply"), "caption")
    # The repair of other images has the same name, and is not in use yet.
    bars = read_table(files.table, "bars.csv").correspondences
    few = write_table(bars.of_frames(bars.frames[:4]))
    drop(go(begun, "check"), {"p.csv": few}, "upload_check_images")
    assert begun.button(key="use_repaired").proto.type == "primary"


def test_the_results_of_the_project_are_checked(pressed: AppTest, home: Path) -> None:
    app = go(go(pressed, "apply"), "check")
    assert "this project's refined set" in told(app, "caption")
    dataset = project_of(app, home).dataset
    assert dataset is not None
    few = dataset.of_frames(dataset.correspondences.frames[:5])
    drop(app, {"few.csv": write_table(few.correspondences)}, "upload_check_images")
    assert "Cannot tell with 5 bars" in told(app, "info")
    app.selectbox(key="check_images").set_value("The pairs of Apply").run()
    assert "matched points alone do not show" in told(app, "caption").lower()
    assert CANNOT_TELL.split("°")[1] in told(app, "info")
