"""What a person reads when something unforeseen happens: no traceback, no path of the server."""

from __future__ import annotations

import ast
import secrets
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from streamlit import config
from streamlit.testing.v1 import AppTest

from stereocal.calibration.methods import CalibrationSettings
from stereocal.formats.dataset_files import read_dataset
from stereocal.projects import data_folder
from stereocal.projects.project import Project
from stereocal.refined.unknowns import RefineSettings
from stereocal.ui.menu import TITLES
from stereocal.ui.refined import calibrated, refined_of
from stereocal.ui.screening import screenings_of
from tests.browser.work import finished_project

ROOT = Path(__file__).parents[2]
SECRET = "/srv/secret/place"


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    home = tmp_path_factory.mktemp("home")
    return home, finished_project(home)


@pytest.mark.parametrize("page", list(TITLES))
def test_unforeseen_error_tells_its_kind_and_no_more(
    page: str, finished: tuple[Path, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    home, project_id = finished
    monkeypatch.setenv("STEREOCAL_HOME", str(home))
    app = AppTest.from_file(str(ROOT / "app.py"), default_timeout=120)
    app.query_params["project"] = project_id
    app.run()
    assert not app.exception
    # What the file of settings says, as the server has it; tests of pages do not read it.
    assert 'showErrorDetails = "type"' in (ROOT / ".streamlit/config.toml").read_text()
    monkeypatch.setattr(config, "get_option", _as_on_the_server(config.get_option))

    def fails(*_args: object, **_kwargs: object) -> None:
        raise RuntimeError(f"{SECRET} is gone")

    monkeypatch.setattr("streamlit.title", fails)
    app.switch_page(f"pages/{page}.py").run()
    (shown,) = app.exception
    proto = shown.proto
    assert proto.type == "RuntimeError"
    assert SECRET not in str(proto) and str(ROOT) not in str(proto) and str(home) not in str(proto)
    assert not proto.stack_trace


def _as_on_the_server(option: Callable[[str], Any]) -> Callable[[str], Any]:
    return lambda key: "type" if key == "client.showErrorDetails" else option(key)


def test_ids_are_random_bits_of_the_operating_system(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int | None] = []
    given = secrets.token_hex

    def counted(count: int | None = None) -> str:
        asked.append(count)
        return given(count)

    monkeypatch.setattr(secrets, "token_hex", counted)
    ids = {Project.create(tmp_path).id for _ in range(20)}
    assert asked == [16] * 20  # bytes: 128 bits
    assert len(ids) == 20 and all(data_folder.is_id(one) for one in ids)
    bits = "".join(f"{int(one, 16):0128b}" for one in ids)
    assert 0.45 < bits.count("1") / len(bits) < 0.55  # 2560 bits: 5 standard deviations


def test_same_numbers_under_another_name_are_not_shared() -> None:
    """The caches of pages are the server's: a key must hold all that a result tells."""
    mine = read_dataset(ROOT / "sample_data/field")
    other = replace(mine, name="somebody else's", notes="and what they wrote")
    settings = RefineSettings()
    for dataset in (mine, other, mine):
        assert refined_of(dataset, settings).dataset.name == dataset.name
        assert refined_of(dataset, settings).dataset.notes == dataset.notes
        assert calibrated(dataset, CalibrationSettings()).dataset.name == dataset.name


def test_stated_uncertainties_belong_to_a_screening() -> None:
    data = read_dataset(ROOT / "sample_data/field")
    settings = CalibrationSettings()
    for sigma in (None, 0.001, 0.01):
        stated = replace(data, baseline_sigma_m=sigma)
        (found,) = screenings_of([stated], settings)
        assert found.dataset.baseline_sigma_m == sigma


CACHES = {
    "jobs.pool": "threads, which know no project",
    "jobs._cluster": "threads of a cluster, which know no project",
    "jobs._jobs": "by the project's id",
    "project_cards._card": "by the project's id",
    "validation_results._summaries": "by the digest of the evaluation",
    "story._story": "a file of the program, which knows no project",
    "screening._screened": "by all numbers, the name, the notes and the settings",
    "uploads.watch_uploads": "by the session's id, which the server gives out",
    "warm_up.warm_up": "a thread, which knows no project",
    "review._shown": "by the digest of the photograph's content",
    "apply_threshold._table": "by the digest of the table's content",
    "apply_threshold._sampled": "by the digests of the tables' contents, and the time offset",
    "apply_threshold._chosen": "by the digests of the tables' contents, and the whole set",
    "apply_frames._frames": "by the digests of the tables' contents",
    "apply_frames._track_columns": "by the digest of the table's content",
    "apply_frames._tracks": "by the digest of the table's content, and the column",
    "apply_results._read": "by the digest of the table's content",
    "plan._forecasts": "by the whole plan, as its file",
    "world._world": "by all numbers of the set, the digest of the file and all settings",
    "check._checked": "by all numbers of both files, and their name",
    "check._images_of": "by the digest of the whole set, the name and the content of the file",
    "chosen_frame._decoded": "by the digest of the photograph",
    **{
        f"refined.{name}": "by all numbers, the name, the notes and the settings"
        for name in (
            "_refined",
            "_calibrated",
            "_answers",
            "_outlook",
            "_maps",
            "_traced",
        )
    },
}


def test_every_cache_of_the_pages_has_been_looked_at() -> None:
    """All sessions share them. A new one belongs into the list, with what keeps sessions apart."""
    found = set()
    for path in (ROOT / "stereocal/ui").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and any(
                "cache_" in ast.unparse(decorator) for decorator in node.decorator_list
            ):
                found.add(f"{path.stem}.{node.name}")
    assert found <= CACHES.keys(), found - CACHES.keys()
