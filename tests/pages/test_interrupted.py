"""Long work on pages: a job does it, the page follows, and what was interrupted can begin again."""

import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.evaluation.evaluate import RunCounts, evaluate_runs
from stereocal.projects import jobs as stored_jobs
from stereocal.projects.home import bring_back, remove
from stereocal.projects.project import Project
from stereocal.system import latest
from stereocal.system.tasks import StoppedError
from stereocal.ui import data_read, jobs, screening
from stereocal.ui.warm_up import WARM_UP
from stereocal.workflow import answer, pair_run
from tests.pages.stored_projects import FEW, SLOW, ended, go, messages, project_of, told, wait_until
from tests.pages.test_pages import open_sample
from tests.projects.test_found_before import bits
from tests.projects.test_jobs import killed

STOPPED = "The server stopped while this ran"


@pytest.fixture
def pressing(app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch) -> AppTest:
    """The Calibrate page."""
    monkeypatch.setattr(jobs, "WAIT_S", 0.0)
    project_of(open_sample(app), home).keep_settings(FEW)
    return app.switch_page("pages/calibrate.py").run()


def keys(app: AppTest) -> set[str]:
    return {str(button.key) for button in app.button}


def test_a_removed_project_stops_its_job(pressing: AppTest, home: Path) -> None:
    project, begun = project_of(pressing, home), threading.Event()

    def until_cancelled(job: jobs.Job) -> None:
        while True:
            job.progress(0, 1)
            begun.set()

    jobs.start(jobs.PageWork(project, "calibration", ("runs",), until_cancelled))
    assert begun.wait(SLOW)
    remove(home, project.id)
    assert ended(project, "calibration").state == "cancelled"
    bring_back(home, project.id)
    assert STOPPED in messages(pressing.run()) and "run" in keys(pressing)


def test_a_job_cancelled_while_it_looks_for_its_project_ends(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = Project.create(home)
    job = jobs.Job(jobs.PageWork(project, "evaluation", ("runs",), lambda _: None), jobs.pool())

    def another_page_cancels(_path: Path) -> bool:
        job.cancelled = True
        return False

    monkeypatch.setattr(Path, "exists", another_page_cancels)
    with pytest.raises(StoppedError):
        job.progress(1, 2)


def test_a_job_that_waits_for_the_compilation_can_be_cancelled(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(WARM_UP, "over", threading.Event())
    project, run = Project.create(home), list[jobs.Job]()
    job = jobs.start(jobs.PageWork(project, "calibration", ("runs",), run.append))
    jobs.abandon(project, "calibration")
    assert ended(project, "calibration").state == "cancelled" and job.cancelled and not run


def test_a_server_that_ends_leaves_its_jobs_interrupted(
    pressing: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not failed, though they can hand in no more tasks."""
    project, closed = project_of(pressing, home), ThreadPoolExecutor(1)
    closed.shutdown()
    with monkeypatch.context() as patch:
        patch.setattr(jobs, "pool", lambda: closed)
        patch.setattr(jobs, "in_background", lambda drive, job: drive(job))
        work = jobs.PageWork(
            project, "calibration", ("runs",), lambda _: bool(jobs.compute(abs, 1))
        )
        assert jobs.start(work).state == "running"
    jobs.JOBS.clear()
    assert STOPPED in messages(pressing.run())


def test_an_unforeseen_error_is_a_calm_sentence_and_stands_in_the_log(
    app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("the secret reason")

    project_of(open_sample(app), home).keep_settings(FEW)
    with monkeypatch.context() as patch:
        patch.setattr("stereocal.evaluation.evaluate.evaluate_runs", fail)
        go(app, "validate")
        ended(project_of(app, home), "evaluation")
        said = messages(app.run())
        assert "Unexpected error. Earlier results are unchanged" in said and "secret" not in said
        assert "the secret reason" in caplog.text
    app.button(key="validate").click().run()
    assert ended(project_of(app, home), "evaluation").state == "done"
    assert not app.run().error


def test_the_figure_follows_the_sliders_and_says_of_how_many_runs(
    app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the others, which wait here, will add is stored only whole, and of the last settings."""
    others = threading.Event()

    def first_at_once(*given: Any) -> list[RunCounts]:
        assert 0 in given[3] or others.wait(SLOW)
        return evaluate_runs(*given)

    monkeypatch.setattr("stereocal.evaluation.evaluate.evaluate_runs", first_at_once)
    with ThreadPoolExecutor(20) as threads, monkeypatch.context() as patch:
        patch.setattr(jobs, "pool", lambda: threads)
        project = project_of(open_sample(app), home)
        project.keep_settings({"validate_runs": 20})
        seen, before = [], None
        try:
            for acceptance in (0.2, 0.3):
                project.keep_settings({"acceptance": acceptance})
                go(app, "validate")
                job = jobs.job_of(project, "evaluation")
                assert job is not None and job is not before
                wait_until(lambda: "10 of 20 runs" in told(app.run(), "caption"))
                seen.append([figure.proto.spec for figure in app.get("plotly_chart")])
                assert seen[-1] and not app.get("download_button")
                before = before or job
        finally:
            others.set()
        assert before is not None and ended(project, "evaluation").state == "done"
        wait_until(lambda: before.state != "running")
    found, dataset = project.evaluation, project.dataset
    assert before.state == "cancelled" and seen[0] != seen[1]
    assert found is not None and dataset is not None
    assert found.settings.calibration.search.acceptance == 0.3
    runs = evaluate_runs(dataset, found.settings, 0, range(20))
    assert bits(list(found.runs[0])) == bits(runs)
    assert "of 20 runs" not in told(app.run(), "caption") and app.get("download_button")


COMPUTING = (
    (screening, "screened"),
    *((pair_run, name) for name in ("screened", "refine", "two_searches", "forecast_files")),
    *((pair_run, name) for name in ("misfit_of", "accuracy_map")),
    (answer, "recommend"),
    (data_read, "pack_dataset"),
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
    latest.forget()
    jobs.JOBS.clear()


def forbid(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let everything fail that takes long with many frames."""

    def called(*_: Any, **__: Any) -> None:
        raise AssertionError("computed while the page was drawn")

    for module, name in COMPUTING:
        monkeypatch.setattr(module, name, called)


@pytest.mark.parametrize("name", ["data", "calibrate", "validate"])
def test_no_page_computes_before_the_press(
    name: str, long: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project_of(long, home).keep_settings({"validate_runs": 500})  # as long as of many frames
    forbid(monkeypatch)
    long.switch_page(f"pages/{name}.py").run()
    assert not long.exception


def test_the_press_and_a_restart(
    long: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What ended with its server is said, and is begun again or discarded."""
    project = project_of(long, home)
    project.keep_settings(FEW)
    stored_jobs.begin(project.database, "calibration")
    killed(project.database)
    assert STOPPED in messages(go(long, "calibrate"))
    long.button(key="run").click().run()
    assert ended(project, "calibration").state == "done"
    assert STOPPED not in messages(long.run()) and not long.error
    assert project.calibration_evaluation is not None
    stored_jobs.begin(project.database, "calibration")
    killed(project.database)
    long.run().button(key="discard_calibration").click().run()
    assert STOPPED not in messages(long)
    with monkeypatch.context() as patch:
        forbid(patch)
        long.run()
        assert "Use the refined set for both" in messages(long)
        long.switch_page("pages/validate.py").run()
        assert not long.exception
    forget()  # the server starts again
    pages = ("calibrate", "apply", "check")
    begun: list[jobs.PageWork] = []
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
