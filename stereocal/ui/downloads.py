"""Downloads that are made when they are asked for, and held until the browser has fetched them.

Streamlit drops such a file as soon as two more runs of any session have ended: with 20 people at
work within 0.1 s, and the browser got "404 not found" (8 of 20).
"""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable

from streamlit import runtime

HELD_S = 60.0
_PLACES = itertools.cycle(range(100))


def on_demand(make: Callable[[], bytes | str], name: str, mime: str) -> Callable[[], bytes]:
    """The `data` of a download button: `make` is called when the button is pressed."""

    def data() -> bytes:
        made = make()
        content = made.encode() if isinstance(made, str) else made
        _hold(content, name, mime)
        return content

    return data


def _hold(content: bytes, name: str, mime: str) -> None:
    """Have Streamlit's store of files count a file as used for a while."""
    if not runtime.exists():  # a test without a server
        return
    files = runtime.get_instance().media_file_mgr
    place = f"download {next(_PLACES)}"
    files.add(content, mime, place, file_name=name, is_for_static_download=True)
    release = threading.Timer(HELD_S, files.add, (b" ", "text/plain", place))
    release.daemon = True
    release.start()
