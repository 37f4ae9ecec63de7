"""Long work on pages: a job does it, the page follows, and what ended with its server goes on."""

import threading
from pathlib import Path
from typing import Any

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.evaluation.evaluate import evaluate_runs
from stereocal.projects import jobs as stored_jobs
from stereocal.projects.home import copy_database
from stereocal.ui import jobs, refined, results, screening, validation
from tests.pages.stored_projects import SLOW, ended, messages, project_of
from tests.pages.test_pages import open_sample
from tests.projects.test_checkpoints import bits

STOPPED = "The server stopped while this ran"


@pytest.fixture
def validating(app: AppTest, monkeypatch: pytest.MonkeyPatch) -> AppTest:
    """The Validate page, where 40 runs are a job."""
    monkeypatch.setattr(validation, "INSTANT", 10)
    open_sample(app).switch_page("pages/validate.py").run()
    return app.slider(key="validate_runs").set_value(40).run()


def keys(app: AppTest) -> set[str]:
    return {str(button.key) for button in app.button}


@pytest.fixture
def interrupted(validating: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch) -> AppTest:
    """A validation whose project is as it was when half of it was finished."""
    monkeypatch.setattr(stored_jobs, "WRITE_EVERY_S", 0.0)
    half, release = threading.Event(), threading.Event()
    progress = jobs.Job.progress

    def then_hold(job: jobs.Job, done: int, total: int) -> None:
        """The job goes no further than half, however long the page takes."""
        progress(job, done, total)
        if done >= 20:
            half.set()
            assert release.wait(SLOW)

    app = validating
    project = project_of(app, home)
    with monkeypatch.context() as patch:
        patch.setattr(jobs.Job, "progress", then_hold)
        app.button(key="validate").click().run()
        job = jobs.job_of(project, "evaluation")
        assert job is not None and half.wait(SLOW)
        copy_database(project.database, home / "as_it_was")
        job.cancelled = True
        release.set()
        assert ended(project, "evaluation").state == "cancelled"
    (home / "as_it_was").replace(project.database.path)
    jobs._jobs().clear()
    return app.run()


def test_it_goes_on_to_the_same_result(
    interrupted: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    app, project = interrupted, project_of(interrupted, home)
    assert STOPPED in messages(app) and "20 of 40 runs were finished." in messages(app)
    assert "started again" not in messages(app)
    assert "validate" not in keys(app)
    computed: list[int] = []

    def counted(*arguments: object) -> object:
        computed.append(len(arguments[3]))  # type: ignore[arg-type]
        return evaluate_runs(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr("stereocal.evaluation.evaluate.evaluate_runs", counted)
    app.button(key="go_on_evaluation").click().run()
    assert ended(project, "evaluation").state == "done"
    # Blocks that end at once are all stored before the first of them counts as progress.
    assert 0 < sum(computed) <= 20
    app.run()
    assert STOPPED not in messages(app) and not app.error
    found = project.evaluation
    assert found is not None and found.settings.runs == 40
    dataset = project.dataset
    assert dataset is not None
    assert bits(list(found.runs[0])) == bits(evaluate_runs(dataset, found.settings, 0, range(40)))


def test_a_job_of_another_server_is_shown_and_can_be_stopped(
    validating: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    app, project = validating, project_of(validating, home)
    other = stored_jobs.begin(project.database, "evaluation", ("runs",), {})
    assert other is not None
    other.progress(0, 30, 300)
    app.run()
    assert "validate" not in keys(app) and STOPPED not in messages(app)
    app.button(key="stop_evaluation").click().run()
    monkeypatch.setattr(stored_jobs, "WRITE_EVERY_S", 0.0)
    assert not other.progress(0, 40, 300)
    other.end()
    app.run()
    assert "validate" in keys(app)


def test_an_unforeseen_error_is_a_calm_sentence_and_stands_in_the_log(
    validating: AppTest,
    home: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("the secret reason")

    monkeypatch.setattr("stereocal.evaluation.evaluate.evaluate_runs", fail)
    app, project = validating, project_of(validating, home)
    app.button(key="validate").click().run()
    ended(project, "evaluation")
    app.run()
    said = messages(app)
    assert "Unexpected error. Earlier results are unchanged" in said and "secret" not in said
    assert "the secret reason" in caplog.text
    # Also to a server that has been started since.
    jobs._jobs().clear()
    assert "Unexpected error. Earlier results are unchanged" in messages(app.run())


COMPUTING = (
    (screening, "screened"),
    (refined, "refine"),
    (refined, "trade_off"),
    (refined, "calibrate"),
    (refined, "outlook_of"),
    (refined, "answer"),
    (results, "pack_dataset"),
)


@pytest.fixture
def long(app: AppTest, monkeypatch: pytest.MonkeyPatch) -> AppTest:
    """The sample, as if its frames were many, on a server that has computed nothing yet."""
    monkeypatch.setattr(screening, "MOST_AT_ONCE", 10)
    open_sample(app)
    forget()
    return app


def forget() -> None:
    """What a server that starts has not in memory."""
    for cache in (screening._screened, refined.refined_of, refined.outlook_for, refined._made):
        cache.clear()
    jobs._jobs().clear()


def forbid(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let everything fail that takes long with many frames."""

    def called(*_: Any, **__: Any) -> None:
        raise AssertionError("computed while the page was drawn")

    for module, name in COMPUTING:
        monkeypatch.setattr(module, name, called)


@pytest.mark.parametrize("name", ["data", "calibrate", "validate", "one_set"])
def test_no_page_computes_before_the_press(
    name: str, long: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project_of(long, home).keep_settings({"validate_runs": 500})  # as long as of many frames
    forbid(monkeypatch)
    long.switch_page(f"pages/{name}.py").run()
    assert not long.exception
    if name == "one_set":
        assert "press Calibrate first" in messages(long)


def test_the_press_and_a_restart(
    long: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = project_of(long, home)
    project.keep_settings({"validate_runs": 10, "one_set_view": "The refined set"})
    long.switch_page("pages/calibrate.py").run()
    long.button(key="run").click().run()
    assert ended(project, "calibration").state == "done"
    with monkeypatch.context() as patch:
        forbid(patch)
        long.run()
        assert "Use the refined set for both" in messages(long)
        for name in ("validate", "one_set"):
            long.switch_page(f"pages/{name}.py").run()
            assert not long.exception
            assert "Use the refined set for both" in messages(long) or name == "validate"
    forget()  # the server starts again
    pages = ("calibrate", "one_set", "apply", "check")
    begun: list[jobs.Work] = []
    with monkeypatch.context() as patch:
        patch.setattr(jobs, "start", begun.append)
        forbid(patch)
        for name in pages:
            long.switch_page(f"pages/{name}.py").run()
            assert not long.exception
    assert [work.kind for work in begun] == ["answer"] * len(pages)
    jobs.start(begun[0])
    assert ended(project, "answer").state == "done"
    for name in pages:
        long.switch_page(f"pages/{name}.py").run()
        assert not long.exception
        assert "Use the refined set for both" in messages(long) or name in ("apply", "check")
