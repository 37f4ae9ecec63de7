"""The folds with what is to be printed, without a browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def app(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[AppTest]:
    monkeypatch.setenv("STEREOCAL_HOME", str(tmp_path))
    started = AppTest.from_file(str(ROOT / "app.py"), default_timeout=120).run()
    yield started
    assert not started.exception


def shown(app: AppTest) -> str:
    return " ".join(str(item.value) for kind in (app.markdown, app.info) for item in kind)


def test_the_board_is_as_large_as_the_paper_allows(app: AppTest) -> None:
    app.switch_page("pages/cameras.py").run()
    assert "Squares of **13 mm**, the largest on A4" in shown(app)
    app.selectbox(key="print_paper_board").set_value("A3").run()
    assert "Squares of **20 mm**, the largest on A3" in shown(app)
    app.number_input(key="print_columns").set_value(9).run()
    assert "Squares of **28 mm**, the largest on A3" in shown(app)
    app.selectbox(key="print_paper_board").set_value("A4").run()
    app.number_input(key="print_rows").set_value(100).run()
    assert "Squares of **2 mm**, the largest on A4" in shown(app)


def test_targets_are_offered_with_photographs(app: AppTest) -> None:
    app.switch_page("pages/data.py").run()
    app.segmented_control(key="data_how").set_value("Photographs").run()
    assert "Print at 100 %" in shown(app)
    app.number_input(key="print_side_mm").set_value(300.0).run()
    assert "does not fit on A4, which holds 185 mm: print it on A2" in shown(app)


def test_a_plan_offers_targets_of_the_size_it_needs(app: AppTest) -> None:
    app.switch_page("pages/plan.py").run()
    assert "A target of 175 mm is 50 px across at 25 m and 156 px at 8 m." in shown(app)
    app.select_slider(key="plan_far_m").set_value(50.0).run()
    assert "A target of 350 mm does not fit on A4" in shown(app)
    app.selectbox(key="print_paper_targets").set_value("A2").run()
    assert "A target of 350 mm is 50 px across at 50 m" in shown(app)
    app.number_input(key="print_px").set_value(20.0).run()
    assert "A target of 140 mm is 20 px across at 50 m" in shown(app)
