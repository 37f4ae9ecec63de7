"""Work that ended with its server: what its page says, and that it goes on to the same result."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.evaluation.evaluate import evaluate_runs
from stereocal.projects import jobs as stored_jobs
from stereocal.projects.home import copy_database
from stereocal.ui import jobs, validation
from tests.pages.stored_projects import SLOW, messages, project_of
from tests.pages.test_pages import open_sample
from tests.pages.waiting import ended
from tests.projects.test_checkpoints import bits

STOPPED = "The server stopped while this ran"


@pytest.fixture(autouse=True)
def few_runs_are_a_job(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(validation, "INSTANT", 10)


def long_validation(app: AppTest) -> AppTest:
    open_sample(app).switch_page("pages/validate.py").run()
    return app.slider(key="validate_runs").set_value(40).run()


def keys(app: AppTest) -> set[str]:
    return {str(button.key) for button in app.button}


@pytest.fixture
def interrupted(app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch) -> AppTest:
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

    long_validation(app)
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


def test_a_job_of_another_server_is_shown_and_can_be_stopped(app: AppTest, home: Path) -> None:
    project = project_of(long_validation(app), home)
    other = stored_jobs.begin(project.database, "evaluation", ("runs",), {})
    assert other is not None
    other.progress(0, 30, 300)
    app.run()
    assert "validate" not in keys(app) and STOPPED not in messages(app)
    app.button(key="stop_evaluation").click().run()
    stored_jobs.WRITE_EVERY_S, before = 0.0, stored_jobs.WRITE_EVERY_S
    try:
        assert not other.progress(0, 40, 300)
    finally:
        stored_jobs.WRITE_EVERY_S = before
    other.end()
    app.run()
    assert "validate" in keys(app)


def test_an_unforeseen_error_is_a_calm_sentence_and_stands_in_the_log(
    app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("the secret reason")

    monkeypatch.setattr("stereocal.evaluation.evaluate.evaluate_runs", fail)
    project = project_of(long_validation(app), home)
    app.button(key="validate").click().run()
    ended(project, "evaluation")
    app.run()
    said = messages(app)
    assert "Unexpected error. Earlier results are unchanged" in said and "secret" not in said
    assert "the secret reason" in caplog.text
    # Also to a server that has been started since.
    jobs._jobs().clear()
    assert "Unexpected error. Earlier results are unchanged" in messages(app.run())
