"""The marks in the menu follow the project; text of files is shown as it is, never as markup."""

import re
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import chain, zip_longest
from pathlib import Path

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereocal.calibration.methods import CalibrationSettings
from stereocal.evaluation.evaluate import EvaluationSettings, evaluate
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.formats.dataset_files import pack_dataset, read_dataset
from stereocal.formats.evaluation_files import Evaluation
from stereocal.library.calibrations import calibrate
from stereocal.projects.home import find_projects
from stereocal.projects.project import Project
from stereocal.ui.forms import form_values, refine_settings
from stereocal.ui.intake import give_dataset
from stereocal.ui.page_states import page_states
from stereocal.ui.texts import escape_markdown, escaped_table
from stereocal.ui.validation import MINE, PAPER, chosen_data

FIELD = Path(__file__).parents[2] / "sample_data" / "field"


def marks(project: Project) -> dict[str, str]:
    return {name: state.mark for name, state in page_states(project).items()}


def new_project(home: Path) -> Project:
    project = Project.create(home)
    give_dataset(project, pack_dataset(read_dataset(FIELD)), "the field")
    return project


@pytest.fixture(scope="module")
def home_of_finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With a project that is calibrated and validated with what its forms say."""
    home = tmp_path_factory.mktemp("home")
    project = new_project(home)
    dataset = project.dataset
    assert dataset is not None
    settings = CalibrationSettings.from_json(form_values(project, dataset))
    found = calibrate(dataset, settings)
    project.keep_calibration(found, project.inputs)
    own = EvaluationSettings(settings, 10, 20, refined=refine_settings(project, dataset))
    with ThreadPoolExecutor(1) as executor:
        runs = evaluate([found.screening.dataset], own, executor)
    project.keep_settings({"validate_runs": 10})
    project.keep_evaluation(Evaluation(runs, own, [dataset.name], [dataset.sha256]))
    return home


@pytest.fixture
def finished(home_of_finished: Path, tmp_path: Path) -> Project:
    shutil.copytree(home_of_finished, tmp_path, dirs_exist_ok=True)
    return Project.open(tmp_path, *find_projects(tmp_path))


def test_what_was_done_is_marked(finished: Project, tmp_path: Path) -> None:
    before = marks(new_project(tmp_path / "new"))
    assert before["cameras"] == before["data"] == "done"
    assert before["calibrate"] == before["validate"] == "missing"
    after = marks(finished)
    assert {name for name, mark in after.items() if mark == "done"} == set(after) - {
        "apply",
        "check",
    }


def test_a_changed_length_makes_the_results_stale(finished: Project) -> None:
    finished.give({}, baseline_m=4.6)
    found = marks(finished)
    assert found["calibrate"] == found["validate"] == "stale"
    finished.give({}, baseline_m=4.5)
    assert marks(finished)["calibrate"] == "done"


@pytest.mark.parametrize(
    ("setting", "stale"),
    [
        ({"delta": 2e-3}, {"calibrate", "validate"}),
        ({"validate_runs": 20}, {"validate"}),
        ({"validate_frames": 15}, {"validate"}),
        ({"validate_splits": "frames"}, {"validate"}),
        ({"refine_sigma_px": 0.3}, {"calibrate", "validate"}),
        ({"validate_on": PAPER}, {"validate"}),
        ({"calibration_frames": 20}, {"calibrate"}),
        # A number of frames that other data had is not in the form: it shows the usual one.
        ({"validate_frames": 999}, set()),
    ],
)
def test_a_changed_setting_makes_its_results_stale(
    setting: dict[str, float], stale: set[str], finished: Project
) -> None:
    finished.keep_settings(setting)
    assert {name for name, mark in marks(finished).items() if mark == "stale"} == stale


def test_a_look_at_the_nineteen_rigs_changes_no_result(finished: Project) -> None:
    """While they are chosen their validation is shown, then again that of the calibration."""
    evaluation = finished.evaluation
    assert evaluation is not None and finished.dataset is not None
    finished.keep_evaluation(evaluation, of_calibration=True)
    finished.keep_settings({"validate_on": PAPER})
    sets = chosen_data(finished, finished.dataset)
    own = replace(evaluation.settings, refined=RefineSettings())
    digests = [each.sha256 for each in sets]
    finished.keep_evaluation(Evaluation(list(evaluation.runs) * 19, own, ["rig"] * 19, digests))
    assert "stale" not in marks(finished).values()
    finished.keep_settings({"validate_on": MINE})
    assert "stale" not in marks(finished).values()


@pytest.mark.parametrize(
    ("text", "safe"),
    [
        ("left 07.png", "left 07.png"),
        ("a*b_c", r"a\*b\_c"),
        ("www.x.org.csv: line 3", "`www.x.org.csv:` line 3"),
        ("(HTTP://x.org) and me@x.org!", "`(HTTP://x.org)` and `me@x.org!`"),
        ("`www.x.org``y", "``` `www.x.org``y ```"),
    ],
)
def test_words_that_would_be_links_are_code(text: str, safe: str) -> None:
    assert escape_markdown(text) == safe


LINK = re.compile(r"\S*(?:://|www\.|@)\S*", re.IGNORECASE)


PIECES = ["www.", "wWw.", "://", "@", "ab", "*", "`", "_", " ", "\n", "\t", "\u00a0", "\u2028", "é"]


@given(st.lists(st.sampled_from(PIECES), max_size=12).map("".join))
def test_the_words_that_are_code_are_those_of_one_pattern(text: str) -> None:
    between, words = LINK.split(text), LINK.findall(text)
    escaped, code = (list(map(escape_markdown, each)) for each in (between, words))
    assert [re.sub(r"\\(.)", r"\1", each) for each in escaped] == between
    assert all(each[0] == "`" and word in each for word, each in zip(words, code, strict=True))
    together = chain.from_iterable(zip_longest(escaped, code, fillvalue=""))
    assert escape_markdown(text) == "".join(together)


def test_a_text_of_two_million_characters_without_a_blank_is_escaped() -> None:
    """In one pass; the one pattern above would take ten hours."""
    assert escape_markdown("w" * 2_000_000 + "*") == "w" * 2_000_000 + r"\*"


def test_tables() -> None:
    table = escaped_table(pd.DataFrame({"a@x.org": ["www.x.org", 3]}, index=["*", "b"]))
    assert list(table.columns) == ["`a@x.org`"]
    assert list(table.index) == [r"\*", "b"]
    assert list(table["`a@x.org`"]) == ["`www.x.org`", 3]
