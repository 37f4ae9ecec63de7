"""Names that a person gave are never links, wherever they stand."""

from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from stereocal.formats.dataset_files import pack_dataset, read_dataset
from stereocal.library.calibrations import calibrate
from stereocal.projects.home import duplicate, remove
from stereocal.projects.project import Project
from stereocal.system.zip_files import pack_zip
from stereocal.ui.menu import TITLES
from tests.browser.conftest import LONGEST_MS, ROOT, settle
from tests.browser.work import FILES, a_project

pytestmark = pytest.mark.browser
FIELD = ROOT / "sample_data" / "field"
FILE = "www.evil.example me@evil.example"
NAME = f"http://evil.example/x https://evil.example {FILE}"


def a_project_of_links(home: Path) -> Project:
    """Every name in it would be a link."""
    project = a_project(home, FIELD, NAME)
    field = read_dataset(FIELD)
    for slot, name in FILES.items():
        project.give({slot: (f"{slot} {FILE}.csv", (FIELD / name).read_bytes())})
    more = pack_zip(pack_dataset(field.changed(name=NAME)))
    project.add_dataset(f"{FILE}.zip", more)
    project.keep_settings({"validate_on": "All my data sets", "validate_runs": 10})
    dataset = project.dataset
    assert dataset is not None
    project.keep_calibration(calibrate(dataset), project.inputs)
    remove(home, duplicate(home, project.id).id)
    return project


def links(page: Page) -> list[str]:
    found: list[str] = page.locator("a").evaluate_all("links => links.map(link => link.href)")
    return [link for link in found if "evil" in link]


def test_names_are_not_links(page: Page, app_url: str, home: Path, tmp_path: Path) -> None:
    project = a_project_of_links(home)
    said = 0
    for name in TITLES:
        path = "" if name == "start" else name
        page.goto(f"{app_url}/{path}?project={project.id}")
        expect(page.get_by_test_id("stMain").locator("h1")).to_be_visible(timeout=LONGEST_MS)
        page.wait_for_timeout(500)
        settle(page)
        for summary in page.locator("summary").all():
            summary.click()
        page.wait_for_timeout(300)
        said += page.get_by_test_id("stMain").inner_text().count("evil.example")
        assert links(page) == [], name
    assert said > 10  # the names do stand there, as they are

    page.goto(f"{app_url}/data?project={project.id}")
    bad = tmp_path / f"{FILE}.csv"
    bad.write_text("frame,target,u_primary,v_primary,u_secondary,v_secondary\n1,A,x,2,3,4\n")
    page.locator("[class*=st-key-upload_data_] input[type=file]").set_input_files(bad)
    alert = page.get_by_test_id("stAlert").filter(has_text="What was loaded before is unchanged")
    expect(alert).to_contain_text(f"{FILE}.csv")
    assert links(page) == []
