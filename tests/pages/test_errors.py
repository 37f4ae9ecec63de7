"""What a person reads when something unforeseen happens: no traceback, no path of the server."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from streamlit import config
from streamlit.testing.v1 import AppTest

from tests.pages.stored_projects import ROOT, SLOW

SECRET = "/srv/secret/place"


def test_unforeseen_error_tells_its_kind_and_no_more(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    app = AppTest.from_file(str(ROOT / "app.py"), default_timeout=SLOW).run()
    assert not app.exception
    # What the file of settings says, as the server has it; tests of pages do not read it.
    assert 'showErrorDetails = "type"' in (ROOT / ".streamlit/config.toml").read_text()
    monkeypatch.setattr(config, "get_option", _as_on_the_server(config.get_option))

    def fails(*_args: object, **_kwargs: object) -> None:
        raise RuntimeError(f"{SECRET} is gone")

    monkeypatch.setattr("streamlit.title", fails)
    app.switch_page("pages/calibrate.py").run()
    (shown,) = app.exception
    proto = shown.proto
    assert proto.type == "RuntimeError"
    assert SECRET not in str(proto) and str(ROOT) not in str(proto) and str(home) not in str(proto)
    assert not proto.stack_trace


def _as_on_the_server(option: Callable[[str], Any]) -> Callable[[str], Any]:
    return lambda key: "type" if key == "client.showErrorDetails" else option(key)
