"""What a server gives away, and to whom: other hosts, forged requests, addresses, errors."""

import re
import socket
from pathlib import Path

import pytest
import requests
from playwright.sync_api import Page, expect
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from stereocal.ui.menu import TITLES
from tests.browser.conftest import LONGEST_MS, serve, settle

pytestmark = pytest.mark.browser
PATHS = ["" if name == "start" else name for name in TITLES]
VIEWS = {
    "plan": ["Position error"],
    "cameras": ["Photograph by photograph", "What the lens leaves", "Without distortion"],
    "data": ["One frame"],
    "calibrate": ["Why two sets", "How accurate, where", "Residuals by place", "Searches"],
}
"""Figures that stand on the page only when somebody asks for them."""
FIGURES = {"plan": 3, "cameras": 1, "data": 1, "calibrate": 1, "validate": 1, "apply": 3}


def visit(page: Page, url: str, path: str, project: str) -> None:
    """Open a page and look at everything on it."""
    page.goto(f"{url}/{path}?project={project}")
    settle(page)
    figures = page.locator(".js-plotly-plot:visible")
    if path in FIGURES:
        expect(figures.nth(FIGURES[path] - 1)).to_be_visible(timeout=LONGEST_MS)
    for view in VIEWS.get(path, []):
        control = page.get_by_role("radio", name=view, exact=True).or_(
            page.get_by_role("button", name=view, exact=True)
        )
        if path == "calibrate" and not control.count():
            page.get_by_role("button", name=re.compile("^More")).click()
        control.first.click()
        page.wait_for_timeout(300)
        settle(page)


def test_no_page_fetches_anything_from_another_host(
    page: Page, app_url: str, finished: str, tmp_path: Path
) -> None:
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("websocket", lambda socket: asked.append(socket.url))
    for path in PATHS:
        visit(page, app_url, path, finished)
        if path == "validate":
            with page.expect_download() as event:
                page.locator(".st-key-download_report button").click()
            event.value.save_as(tmp_path / "report.html")
    own = (app_url, app_url.replace("http", "ws", 1), "data:", "blob:")
    assert any(url.startswith("ws") for url in asked) and len(asked) > 50
    assert [url for url in asked if not url.startswith(own)] == []

    asked.clear()
    page.goto((tmp_path / "report.html").as_uri())
    expect(page.locator(".js-plotly-plot .main-svg").first).to_be_visible()
    page.wait_for_timeout(500)
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []


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


def test_server_for_others_is_reached_by_its_own_name(tmp_path: Path) -> None:
    with serve(
        tmp_path / "home", STREAMLIT_SERVER_ALLOWED_HOSTS="lab.example other.example"
    ) as url:
        port = int(url.rsplit(":", 1)[1])
        for host, allowed in (("lab.example", True), ("other.example", True), ("evil", False)):
            way = socket.create_connection(("127.0.0.1", port))
            address = f"ws://{host}:{port}/_stcore/stream"
            try:
                with connect(address, origin=Origin(f"https://{host}:{port}"), sock=way):
                    assert allowed
            except InvalidStatus:
                assert not allowed


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
