"""What a server gives away, and to whom: other hosts, forged requests, addresses, errors."""

import re
import shutil
import socket
from pathlib import Path

import pytest
import requests
from playwright.sync_api import Page, expect
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from tests.browser.conftest import HEALTH, ROOT, served, settle

pytestmark = pytest.mark.browser


def test_uploads_without_the_token_of_the_page_are_refused(
    page: Page, app_url: str, home: Path
) -> None:
    page.goto(f"{app_url}/data")
    settle(page)
    with page.expect_request(lambda asked: asked.method == "PUT") as sent:
        page.locator("[class*=st-key-upload_data_] input[type=file]").set_input_files(
            {"name": "points.csv", "mimeType": "text/csv", "buffer": b"frame,target\n"}
        )
    expect(
        page.get_by_text("What was loaded before is unchanged")
        .or_(page.get_by_text("points.csv"))
        .first
    ).to_be_visible()
    page.wait_for_timeout(1000)  # the browser names the file before the server has stored it
    settle(page)
    place, token = sent.value.url, sent.value.headers["x-xsrftoken"]
    body = {"file": ("points.csv", b"frame,target\n")}
    refused: list[tuple[dict[str, str], dict[str, str]]] = [
        ({}, {}),
        ({"X-Xsrftoken": token}, {}),
        ({}, {"_streamlit_xsrf": token}),
        ({"X-Xsrftoken": "2|00|00|0"}, {"_streamlit_xsrf": token}),
        ({"Origin": "http://evil.example"}, {"_streamlit_xsrf": token}),
    ]
    before = sorted((home / "projects").glob("[!.]*.sqlite"))
    for headers, cookies in refused:
        for method in ("PUT", "DELETE"):
            given = body if method == "PUT" else None
            answer = requests.request(
                method, place, headers=headers, cookies=cookies, files=given, timeout=10
            )
            assert answer.status_code == 403, (headers, method)
    assert sorted((home / "projects").glob("[!.]*.sqlite")) == before
    right = {"headers": {"X-Xsrftoken": token}, "cookies": {"_streamlit_xsrf": token}}
    assert requests.put(place, files=body, timeout=10, **right).status_code == 204  # type: ignore[arg-type]
    # Nor does a token open the session of somebody else, whose name nobody is told.
    elsewhere = re.sub(r"upload_file/[^/]+/", f"upload_file/{'0' * 36}/", place)
    assert requests.put(elsewhere, files=body, timeout=10, **right).status_code == 400  # type: ignore[arg-type]


def test_websockets_of_other_pages_are_refused(app_url: str) -> None:
    port = int(app_url.rsplit(":", 1)[1])
    for origin, host in (
        ("http://evil.example", "127.0.0.1"),
        ("null", "127.0.0.1"),
        # A name that its owner points at this computer (DNS rebinding).
        (f"http://evil.example:{port}", "evil.example"),
    ):
        way = socket.create_connection(("127.0.0.1", port))
        address = f"ws://{host}:{port}/_stcore/stream"
        with (
            pytest.raises(InvalidStatus, match="403"),
            connect(address, origin=Origin(origin), sock=way),
        ):
            pass


def test_server_for_others_is_reached_by_its_name_and_the_health_check_sees_bad_imports(
    app_url: str, tmp_path: Path
) -> None:
    """As the container asks it (Dockerfile)."""
    program, check = tmp_path / "program", "_stcore/script-health-check"
    for name in ("stereocal", "pages", "assets", ".streamlit"):
        shutil.copytree(ROOT / name, program / name)
    shutil.copy(ROOT / "app.py", program)
    (program / "stereocal/ui/navigation.py").write_text("import nothing_of_that_name\n")
    others = {**HEALTH, "STREAMLIT_SERVER_ALLOWED_HOSTS": "lab.example other.example"}
    with served(tmp_path / "home", others, folder=program) as (_, url):
        port = int(url.rsplit(":", 1)[1])
        for host, allowed in (("lab.example", True), ("other.example", True), ("evil", False)):
            way = socket.create_connection(("127.0.0.1", port))
            address = f"ws://{host}:{port}/_stcore/stream"
            try:
                with connect(address, origin=Origin(f"https://{host}:{port}"), sock=way):
                    assert allowed
            except InvalidStatus:
                assert not allowed
        assert requests.get(f"{url}/{check}", timeout=300).status_code == 503
    assert requests.get(f"{app_url}/{check}", timeout=300).status_code == 200


def test_nothing_drives_the_app_but_its_page(app_url: str) -> None:
    for path in ("interact", "mcp", "openapi.json"):
        answer = requests.post(f"{app_url}/_stcore/agent/{path}", json={}, timeout=10)
        assert answer.status_code >= 400
    page = requests.get(app_url, timeout=10).text
    odd = ["/app.py", "/app/static/app.py", "/media/../app.py", "/media/%2e%2e/app.py"]
    odd += ["/%2e%2e/%2e%2e/etc/passwd", f"/media/{'0' * 32}", "/.streamlit/config.toml"]
    for path in odd:
        answer = requests.get(app_url + path, timeout=10)
        # Addresses that are none get the page, which then says that there is no such page.
        assert answer.status_code in (400, 404) or answer.text == page, path
