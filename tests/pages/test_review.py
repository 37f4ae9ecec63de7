"""The review of one frame on the Data page, without a browser: all but the photographs."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.frames.frame import Centre, Frame
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import read_review
from stereocal.ui.picker import Pick
from stereocal.ui.review import take_back, take_pick
from tests.pages.stored_projects import page_of, told
from tests.photographs.bars import bar_set

BARS = bar_set(7)


@cache
def found_frames(store: ProjectPhotographs) -> tuple[Frame, ...]:
    """The frames as detection finds them; frame 3 and 5 are made to need a person."""
    frames = BARS.frames_of(store)
    assert all(frame.state == "found" for frame in frames)
    frames[2] = replace(frames[2], state="doubtful", reason="Look at it.", use=False)
    hidden = replace(frames[4], state="refused", reason="Secondary: one target.", use=False)
    frames[4] = hidden.moved(1, 0, None)
    return tuple(frames)


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> ProjectPhotographs:
    return new_store(tmp_path_factory.mktemp("first"))


def new_store(home: Path) -> ProjectPhotographs:
    project = Project.create(home)
    store = ProjectPhotographs(project)
    store.add({name: store.keep(name, content) for name, content in BARS.files().items()})
    project.give(BARS.cameras, baseline_m=2.0, target_distance_m=0.9)
    return store


@pytest.fixture
def store(
    first: ProjectPhotographs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> ProjectPhotographs:
    monkeypatch.setenv("STEREOCAL_HOME", str(tmp_path))
    made = new_store(tmp_path)
    made.keep_corrected(found_frames(first))
    return made


@pytest.fixture
def app(store: ProjectPhotographs) -> Iterator[AppTest]:
    started = page_of(store.project, "data")
    started.segmented_control(key="frames_view").set_value("One frame").run()
    yield started
    assert not started.exception


def press(app: AppTest, key: str) -> None:
    app.button(key=key).click().run()
    assert not app.exception


def test_walk_through_the_doubtful_frames(app: AppTest, store: ProjectPhotographs) -> None:
    assert app.selectbox(key="review_frame").value == 1
    assert app.button(key="review_p").disabled
    assert app.button(key="review_d").label == "Next to decide (2 left)"
    press(app, "review_d")
    assert app.selectbox(key="review_frame").value == 3
    assert "doubtful] It is left out. Please decide" in told(app) and "Look at it." in told(app)
    press(app, "review_t")
    assert read_review(store).frame(3).use
    assert app.button(key="review_d").label == "Next to decide (1 left)"
    press(app, "review_d")
    assert app.selectbox(key="review_frame").value == 5
    press(app, "review_x")
    assert app.button(key="review_d").disabled
    press(app, "review_n")
    assert app.selectbox(key="review_frame").value == 6
    press(app, "review_u")
    assert app.selectbox(key="review_frame").value == 5
    assert "The last change is undone." in told(app)
    assert not read_review(store).frame(5).reviewed


def test_swap_and_the_table(app: AppTest, store: ProjectPhotographs) -> None:
    before = read_review(store).frame(1).centres[1]
    assert "other frames: A 0.0" in told(app)
    press(app, "swap_secondary")
    assert read_review(store).frame(1).centres[1] == before[::-1]
    a, b = before
    assert a and b
    assert app.table[0].value.loc["A secondary", "u, px"] == f"{b.u:.2f}"
    assert "A and B are exchanged in the secondary photograph." in told(app)
    # The bars are not level: exchanged targets are far from their lines.
    assert "other frames: A 0.0" not in told(app)
    press(app, "review_u")
    assert "other frames: A 0.0" in told(app)


def test_from_the_sheet_to_one_frame_and_an_edit_of_the_sheet_is_undone(
    app: AppTest, store: ProjectPhotographs
) -> None:
    app.segmented_control(key="frames_view").set_value("All frames").run()
    app.segmented_control(key="sheet_kind").set_value("All").run()
    app.checkbox(key="use_frame_2").set_value(False).run()
    assert not read_review(store).frame(2).use
    press(app, "look_2")
    assert app.selectbox(key="review_frame").value == 2
    press(app, "review_u")
    assert read_review(store).frame(2).use


def test_doubtful_frames_that_agree_are_used_by_one_press(
    app: AppTest, store: ProjectPhotographs
) -> None:
    app.segmented_control(key="frames_view").set_value("All frames").run()
    press(app, "use_agreeing")
    assert "5 frames with both targets are used; at least 6" in told(app)
    store.keep_corrected([*BARS.frames_of(store)[:6], *read_review(store).frames[6:]])
    frame = read_review(store).frame(3)
    doubtful = replace(frame, state="doubtful", use=False)
    frames = [doubtful if f.frame == 3 else f for f in read_review(store).frames]
    store.keep_corrected(frames)
    app.run()
    press(app, "use_agreeing")
    assert "1 of 1 doubtful frame is now used" in told(app)
    assert read_review(store).frame(3).use and read_review(store).acts == 1
    press(app, "sheet_undo")
    assert not read_review(store).frame(3).use
    assert app.segmented_control(key="frames_view").value == "All frames"


class TestClick:
    """The callback of a click, which AppTest cannot send."""

    state: dict[str, object]

    @pytest.fixture(autouse=True)
    def session(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.state = {}
        monkeypatch.setattr("stereocal.ui.review.st.session_state", self.state)

    def click(self, store: ProjectPhotographs, number: int, u: float, v: float, raw: bool) -> str:
        frame = read_review(store).frame(number)
        digest = store.photographs[frame.files[0]].name
        take_pick(store, number, 0, Pick(digest, u, v, raw))
        outcome = self.state["review_said"]
        assert isinstance(outcome, tuple) and outcome[0] == number
        return str(outcome[1])

    def centre(self, store: ProjectPhotographs, target: int) -> Centre:
        found = read_review(store).frame(1).centres[0][target]
        assert found
        return found

    def test_nearest_goes_to_the_corner(self, store: ProjectPhotographs) -> None:
        u, v = BARS.pairs[0].centres_primary[0]
        before = [self.centre(store, target) for target in (0, 1)]
        target = int(abs(before[1].u - u) < abs(before[0].u - u))
        sentence = self.click(store, 1, u + 3.0, v - 3.0, False)
        assert f"{'AB'[target]} in the primary photograph is now at the fitted corner" in sentence
        after = self.centre(store, target)
        assert after.source == "corrected"
        assert abs(after.u - u) < 0.02 and abs(after.v - v) < 0.02
        assert self.centre(store, 1 - target) == before[1 - target]
        take_back(store)
        assert self.centre(store, target) == before[target]

    @pytest.mark.parametrize(("switch", "shift"), [(True, False), (False, True)])
    def test_raw_click_of_a_chosen_target(
        self, store: ProjectPhotographs, switch: bool, shift: bool
    ) -> None:
        store.project.keep_settings({"review_target": "B", "review_raw": switch})
        sentence = self.click(store, 1, 10.25, 20.5, shift)
        assert sentence == "B in the primary photograph is now where you clicked, (10.25, 20.50)."
        assert self.centre(store, 1) == Centre(10.25, 20.5, None, "manual")


def test_what_several_frames_share_is_said_once_above_their_pictures(
    store: ProjectPhotographs, first: ProjectPhotographs
) -> None:
    frames = [*found_frames(first)]
    for k in (1, 5, 6):
        blurred = f"In the primary: The target at ({k}, 9) is blurred: its edges are {k} px wide."
        frames[k] = replace(frames[k], state="doubtful", reason=blurred, use=False)
    store.keep_corrected(frames)
    app = page_of(store.project, "data")
    shown = told(app)
    assert shown.count("blurred") == 1 and "Frames 2, 6, 7" in shown
    assert "Look at it." in [str(each.value) for each in app.caption]
    app.segmented_control(key="frames_view").set_value("One frame").run()
    app.selectbox(key="review_frame").set_value(6).run()
    assert "its edges are 5 px wide" in told(app)
    assert not app.exception
