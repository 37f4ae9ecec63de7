"""Frames left out, on the pages: named, put back, exchanged, and the exchange taken back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.formats.dataset_files import pack_dataset, read_dataset
from stereocal.projects.project import Project
from stereocal.projects.review import read_review
from stereocal.ui.screening import exchange
from tests.pages.stored_projects import messages
from tests.pages.test_pages import FIELD, project_of, zipped
from tests.pages.test_review import found_frames, new_store
from tests.pages.waiting import ended

BAD = 7


@pytest.fixture
def project(app: AppTest, home: Path) -> Project:
    """The field's data with A and B exchanged in the secondary image of one frame."""
    dataset = read_dataset(FIELD).with_targets_exchanged([BAD])
    packed = zipped({name: bytes(content) for name, content in pack_dataset(dataset).items()})
    app.switch_page("pages/data.py").run()
    app.segmented_control(key="data_how").set_value("A zip").run()
    app.file_uploader(key="upload_zip").upload("field.zip", packed, "application/zip").run()
    app.switch_page("pages/calibrate.py").run()
    app.button(key="run").click().run()
    return project_of(app, home)


def left_out(project: Project) -> tuple[int, ...]:
    calibration = project.calibration
    assert calibration is not None
    return calibration.screening.left_out


def test_a_bad_frame_is_named_and_the_result_stands(app: AppTest, project: Project) -> None:
    assert left_out(project) == (BAD,)
    said = messages(app)
    assert f"frame {BAD}" in said
    assert "exchanged in one camera" in said
    assert app.success


def test_exchanging_it_brings_it_back_at_once(app: AppTest, project: Project) -> None:
    app.button(key=f"exchange_{BAD}").click().run()
    assert project.inputs.exchanged == [BAD]
    assert left_out(project) == ()
    assert ended(project, "calibration").state == "done"
    calibration = project.calibration
    assert calibration is not None and BAD in calibration.frames
    sound = read_dataset(FIELD)
    assert calibration.dataset.correspondences.secondary.tolist() == (
        sound.correspondences.secondary.tolist()
    )
    # The other pages go by it too, and it can be taken back.
    app.switch_page("pages/validate.py").run()
    assert f"frame {BAD}" not in messages(app)
    app.switch_page("pages/calibrate.py").run()
    app.button(key=f"unexchange_{BAD}").click().run()
    assert ended(project, "calibration").state == "done"
    assert project.inputs.exchanged == []
    assert left_out(project) == (BAD,)


def test_a_new_table_has_nothing_exchanged(app: AppTest, project: Project) -> None:
    app.button(key=f"exchange_{BAD}").click().run()
    table = project.table
    assert table is not None
    project.give({"correspondences": table})
    assert project.inputs.exchanged == []


def test_a_frame_put_back_is_used_and_what_it_does_is_said(app: AppTest, project: Project) -> None:
    app.button(key="look_left_out").click().run()
    assert app.selectbox(key="chosen_frame").value == BAD
    app.button(key="frame_put_back").click().run()
    assert project.inputs.put_back == [BAD]
    # It contradicts the others so much that nothing fits; the last good result stays.
    assert f"({BAD})" in messages(app)
    assert left_out(project) == (BAD,)
    app.button(key="frame_leave_out").click().run()
    assert left_out(project) == (BAD,)
    assert (project.inputs.put_back, project.inputs.left_out) == ([], [BAD])
    assert not app.error


def test_validation_is_without_it(app: AppTest, project: Project) -> None:
    app.switch_page("pages/validate.py").run()
    evaluation = project.evaluation
    assert evaluation is not None
    assert f"frame {BAD}" in messages(app)
    assert app.slider(key="validate_frames").max == 22  # 24 frames, 2 to test with


def test_of_photographs_the_review_exchanges_it(home: Path) -> None:
    """So it is undone there, and the contact sheet shows it."""
    store = new_store(home)
    frames = found_frames(store)
    store.keep_frames(frames[:2])
    before = read_review(store).frame(frames[0].frame)
    exchange(store.project, before.frame)
    review = read_review(store)
    assert review.frame(before.frame) == replace(before.swapped(1), reviewed=True, corrected=True)
    assert len(review.edits) == 1
    assert store.project.inputs.exchanged == []
