"""The list of projects on the Start page."""

from __future__ import annotations

import os
from datetime import datetime
from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.calibration.methods import Method
from stereocal.projects.archive import pack_project
from stereocal.projects.home import DAY_S, delete, recent_projects, remove
from stereocal.projects.project import Project
from stereocal.rig.parameters import RigParameters
from stereocal.verdict.in_words import percent
from tests.pages.stored_projects import ROOT, SLOW, messages
from tests.pages.test_pages import open_sample, project_of


def start(app: AppTest) -> AppTest:
    return app.switch_page("pages/start.py").run()


def keys_in_order(app: AppTest) -> list[str]:
    return [str(button.key) for button in app.button]


def keys(app: AppTest) -> set[str]:
    return set(keys_in_order(app))


def test_an_empty_server_shows_no_list_and_says_what_is_kept(app: AppTest, home: Path) -> None:
    text = " ".join(str(item.value) for item in app.markdown)
    assert "What you need" in text and "Your projects" not in text
    assert str(home) in text
    assert "brought back for 30 days, from the list of removed projects" in text


def test_a_card_says_what_a_project_holds_and_its_key_result(app: AppTest, home: Path) -> None:
    def card() -> str:
        (text,) = [each.value for each in start(app).caption if each.value.startswith("20")]
        return str(text)

    project = project_of(open_sample(app), home)
    assert "25 frames" in card() and "not calibrated" in card()
    app.switch_page("pages/calibrate.py").run()
    app.button(key="run").click().run()
    found = project.calibration_evaluation
    assert found is not None

    def said(name: str, measuring: Method) -> bool:
        length = found.summaries[measuring].to_json()["median_error_3d"]
        words = f"{name}, held out: lengths {percent(length)} %, wrong pairs "
        return words in card().replace("\\", "")

    assert said("Refined set", "refined")  # as Calibrate recommends
    project.keep_recommended("2d", "3d")
    assert said("2D set and 3D set", "3d")
    project.give({}, baseline_m=None)
    assert "points, data incomplete" in card()
    project.give({}, drop=["correspondences"])
    assert "no points yet" in card()


def test_every_one_of_many_projects_is_reached_by_page_and_by_name(
    app: AppTest, home: Path
) -> None:
    projects = [Project.create(home) for _ in range(20)]
    for days, project in enumerate(projects):
        project.rename(f"Bats {days}")
        os.utime(project.database.path, (DAY_S * (1 + days),) * 2)

    def shown() -> list[str]:
        return [key.removeprefix("open_") for key in keys_in_order(app) if key[:5] == "open_"]

    newest = [project.id for project in reversed(projects)]
    start(app)
    seen = shown()
    for page in (2, 3):
        app.session_state["projects_page"] = page
        app.session_state["fields_shown"] |= {"projects_page ": page}
        app.run()
        seen += shown()
    assert seen == newest
    app.text_input(key="projects_search").set_value(" bATS 1").run()
    # Of eleven that match: the search begins at its first page.
    assert shown() == [projects[days].id for days in (19, 18, 17, 16, 15, 14, 13, 12, 11)]
    app.text_input(key="projects_search").set_value("swifts").run()
    assert not shown() and "No project has “swifts” in its name" in messages(app)
    app.text_input(key="projects_search").set_value("Bats 3").run()
    app.button(key=f"open_{projects[3].id}").click().run()
    assert app.session_state["project_id"] == projects[3].id
    assert "Nothing is loaded yet" in messages(app)


def test_a_project_without_a_name_has_that_of_its_data_and_its_day(
    app: AppTest, home: Path
) -> None:
    project = project_of(open_sample(app), home)
    project.rename("")
    noon = datetime(2026, 3, 14, 12).timestamp()
    with project.database.transaction() as db:
        db.execute("UPDATE file SET stored = ?", [noon])
    title = "**correspondences, 2026-03-14**"
    assert title in " ".join(item.value for item in start(app).markdown)
    (named,) = [each for each in app.sidebar.text_input if each.key == "project_name"]
    assert (named.value, named.placeholder) == ("", "correspondences, 2026-03-14")
    project.give({}, drop=["correspondences"])
    assert "**primary.json, 2026-03-14**" in " ".join(item.value for item in start(app).markdown)


def test_rename_duplicate_remove_and_undo(app: AppTest, home: Path) -> None:
    project = project_of(open_sample(app), home)
    start(app).text_input(key=f"name_{project.id}").set_value(" Swifts <i>2026</i> ").run()
    assert project.inputs.name == "Swifts <i>2026</i>"
    app.button(key=f"duplicate_{project.id}").click().run()
    listed = recent_projects(home)
    assert [one.title for one in listed] == ["Swifts <i>2026</i> (copy)", "Swifts <i>2026</i>"]
    app.button(key=f"remove_{listed[0].id}").click().run()
    assert f"open_{listed[0].id}" not in keys(app)
    assert "was removed" in messages(app)
    app.button(key="undo_remove").click().run()
    assert {one.id for one in recent_projects(home)} == {one.id for one in listed}
    assert "undo_remove" not in keys(app)


def test_open_goes_to_the_data_of_that_project(app: AppTest, home: Path) -> None:
    first = project_of(open_sample(app), home)
    second = project_of(open_sample(start(app)), home)
    assert first.id != second.id
    first.give({}, baseline_m=7.25)
    start(app).button(key=f"open_{first.id}").click().run()
    assert app.session_state["project_id"] == first.id
    assert app.number_input(key="baseline_m_value").value == 7.25


def test_what_went_meanwhile_is_said(app: AppTest, home: Path) -> None:
    project = project_of(open_sample(app), home)
    start(app)
    project.database.path.unlink()
    app.button(key=f"duplicate_{project.id}").click().run()
    assert "no project at this address" in messages(app)


def test_a_shared_server_lists_nothing(
    app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = project_of(open_sample(app), home)
    other = Project.create(home)
    monkeypatch.setenv("STEREOCAL_SHARED", "1")
    monkeypatch.setenv("STEREOCAL_KEEP_DAYS", "90")
    assert not any(other.id in key for key in keys(start(app)))
    text = " ".join(str(item.value) for item in app.markdown)
    assert "90 days" in text
    assert str(home) not in text
    assert "brought back for 30 days, by its address." in text
    assert Project.open(home, project.id).dataset is not None


def test_on_a_shared_server_the_open_project_is_renamed_copied_and_removed(
    app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = project_of(open_sample(app), home)
    monkeypatch.setenv("STEREOCAL_SHARED", "1")
    start(app).text_input(key=f"name_{project.id}").set_value("Swifts").run()
    assert Project.open(home, project.id).inputs.name == "Swifts"
    app.button(key=f"duplicate_{project.id}").click().run()
    copy = project_of(app, home)
    assert copy.id != project.id and copy.inputs.name == "Swifts (copy)"
    assert f"remove_{copy.id}" in keys(app) and not any(project.id in key for key in keys(app))
    app.button(key=f"remove_{copy.id}").click().run()
    assert not app.exception and "bring_it_back" in keys(app)
    assert not any(copy.id in key for key in keys(app))
    assert {one.id for one in recent_projects(home)} == {project.id}


def test_a_project_too_large_for_the_servers_memory_is_not_packed(
    app: AppTest, monkeypatch: pytest.MonkeyPatch
) -> None:
    open_sample(app)
    monkeypatch.setenv("STEREOCAL_DOWNLOAD_MB", "0.001")
    monkeypatch.setattr("stereocal.ui.projects.pack_project", None)
    start(app).button(key="pack").click().run()
    assert "at most 0.001 MB (`STEREOCAL_DOWNLOAD_MB`) are packed" in messages(app)
    assert not app.exception


def test_a_zip_that_no_page_takes_is_told(app: AppTest, monkeypatch: pytest.MonkeyPatch) -> None:
    open_sample(app)
    start(app).button(key="pack").click().run()
    assert "takes zips of" not in " ".join(item.value for item in app.caption)
    monkeypatch.setattr("stereocal.ui.projects.st.get_option", lambda _name: 0.001)
    app.button(key="pack").click().run()
    assert "takes zips of 0.001 MB at most" in " ".join(item.value for item in app.caption)


def test_a_new_session_brings_back_from_the_list(app: AppTest, home: Path) -> None:
    project = project_of(open_sample(app), home)
    project.rename("Swifts <i>")
    assert "Removed projects" not in [each.label for each in start(app).expander]
    app.button(key=f"remove_{project.id}").click().run()
    assert "undo_remove" not in keys(app) and "bring_it_back" in keys(app)

    again = AppTest.from_file(str(ROOT / "app.py"), default_timeout=SLOW).run()
    (listed,) = [each for each in again.expander if each.label == "Removed projects"]
    assert "Swifts" in listed.markdown[0].value and "removed 20" in listed.markdown[0].value
    again.button(key=f"bring_back_{project.id}").click().run()
    assert not again.exception
    assert [one.id for one in recent_projects(home)] == [project.id]
    assert "Removed projects" not in [each.label for each in again.expander]
    assert not {"undo_remove", "bring_it_back"} & keys(app.run())


def test_what_cannot_be_brought_back_is_said(app: AppTest, home: Path) -> None:
    project = project_of(open_sample(app), home)
    start(app).button(key=f"remove_{project.id}").click().run()
    delete(home, project.id)
    app.button(key=f"bring_back_{project.id}").click().run()
    assert "removed for good" in messages(app)


@pytest.mark.parametrize("shared", ["0", "1"])
@pytest.mark.parametrize("page", ["start", "data"])
def test_who_has_the_address_brings_a_removed_project_back(
    app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch, shared: str, page: str
) -> None:
    project = project_of(open_sample(app), home)
    monkeypatch.setenv("STEREOCAL_SHARED", shared)
    remove(home, project.id)
    noon = datetime(2026, 3, 14, 12).timestamp()
    os.utime(project.database.marker, (noon, noon))

    stranger = AppTest.from_file(str(ROOT / "app.py"), default_timeout=SLOW).run()
    assert "was removed" not in messages(stranger)
    assert any(project.id in key for key in keys(stranger)) == (shared == "0")

    owner = AppTest.from_file(str(ROOT / "app.py"), default_timeout=SLOW)
    owner.query_params["project"] = project.id
    owner.run().switch_page(f"pages/{page}.py").run()
    assert "This project was removed on 2026-03-14." in messages(owner)
    assert "Start a new project" in [button.label for button in owner.button]
    owner.button(key="bring_it_back").click().run()
    assert not owner.exception
    assert project.dataset is not None
    assert "was removed" not in messages(owner)
    assert "50 pairs of points" in messages(owner.switch_page("pages/data.py").run())


def test_a_project_goes_out_as_a_zip_and_comes_in_again(
    app: AppTest, home: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    project = project_of(open_sample(app), home)
    project.give({}, baseline_m=6.5)
    zipped = tmp_path_factory.mktemp("elsewhere") / "field.zip"
    pack_project(project, zipped)
    start(app).button(key="pack").click().run()
    app.file_uploader(key="upload_project").upload(
        "field.zip", zipped.read_bytes(), "application/zip"
    ).run()
    opened = project_of(app, home)
    assert opened.id != project.id
    assert opened.inputs.baseline_m == 6.5


def test_the_zip_has_the_parameter_files_that_are_offered(
    app: AppTest, monkeypatch: pytest.MonkeyPatch
) -> None:
    packed: list[list[RigParameters]] = []

    def pack(_: Project, target: Path, files: dict[str, bytes]) -> None:
        names = (f"parameters_{name}.json" for name in ("2d", "3d", "refined"))
        packed.append([RigParameters.loads(files[name].decode()) for name in names])
        target.write_bytes(b"zip")

    monkeypatch.setattr("stereocal.ui.projects.pack_project", pack)
    open_sample(app)
    app.switch_page("pages/calibrate.py").run()
    app.button(key="run").click().run()
    start(app).button(key="pack").click().run()
    (rigs,) = packed
    for rig in rigs:
        assert rig.matching_threshold_px and rig.validation and rig.recommendation
    assert [rig.method for rig in rigs] == ["2d", "3d", "refined"]


def test_a_zip_without_a_project_is_said(app: AppTest, home: Path) -> None:
    app.file_uploader(key="upload_project").upload("odd.zip", b"PK", "application/zip").run()
    assert "odd.zip" in messages(app)
    assert not (home / "projects").exists() or not list((home / "projects").iterdir())
