"""Downloads that are made when they are asked for, and held until the browser has fetched them.

Streamlit drops such a file as soon as two more runs of any session have ended: with 20 people at
work within 0.1 s, and the browser got "404 not found" (8 of 20).
"""

import itertools
import mimetypes
import threading
from collections.abc import Callable
from typing import Any

import streamlit as st
from streamlit import runtime
from streamlit.delta_generator import DeltaGenerator

HELD_S = 60.0
_PLACES = itertools.cycle(range(100))


def offer(
    label: str,
    content: bytes | str | Callable[[], bytes | str] | None,
    name: str,
    key: str,
    *,
    primary: bool = False,
    place: DeltaGenerator | None = None,
    **button: Any,
) -> None:
    """A download button.

    Args:
        content: made when the button is pressed, if it is a function; None while there is none.
        name: of the file.
        place: where the button stands; None: here.
        button: passed on to `st.download_button`.
    """
    draw: Any = place or st
    options = {"icon": ":material/download:", **button}
    if content is None:
        draw.button(label, disabled=True, key=f"no_{key}", **options)
        return
    mime = mimetypes.guess_type(name)[0] or "text/plain"
    kind = "primary" if primary else "secondary"

    def data() -> bytes:
        result = content() if callable(content) else content
        packed = result.encode() if isinstance(result, str) else result
        _hold(packed, name, mime)
        return packed

    sent = data if callable(content) else content
    draw.download_button(label, sent, name, mime, key=key, on_click="ignore", type=kind, **options)


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
