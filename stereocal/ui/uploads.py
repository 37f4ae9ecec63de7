"""Memory of uploads: freed once they are stored, too old, or too large together.

Streamlit keeps every upload until some minutes after its session ends: twelve unused files of
100 MB held 1.5 GB.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterable
from typing import Protocol

import streamlit as st
from streamlit import runtime
from streamlit.runtime.memory_uploaded_file_manager import MemoryUploadedFileManager
from streamlit.runtime.scriptrunner import get_script_run_ctx

from stereocal.errors import StereocalError
from stereocal.projects.server_settings import ServerSettings
from stereocal.system.limits import MB

IDLE_S = 300.0
"""Uploads of a session are dropped this long after its last one."""
LOOK_EVERY_S = 1.0
_LOG = logging.getLogger(__name__)


class Upload(Protocol):
    """An uploaded file as Streamlit passes it."""

    name: str
    file_id: str
    size: int

    def getvalue(self) -> bytes:
        """The content."""


class Watch:
    """Drops uploads that no page has stored."""

    def __init__(self, files: MemoryUploadedFileManager, most_bytes: float) -> None:
        self.files, self.most_bytes = files, most_bytes
        self._latest: dict[str, tuple[frozenset[str], float]] = {}
        self._dropped: set[str] = set()

    def look(self, now: float) -> None:
        """Drop uploads that are too old or too large together; `now` is a monotonic time."""
        sizes = {
            session: {file: len(record.data) for file, record in list(held.items())}
            for session, held in list(self.files.file_storage.items())
        }
        for session, held in sizes.items():
            before, since = self._latest.get(session, (frozenset(), now))
            arrived = frozenset(held) - before
            self._latest[session] = (frozenset(held), now if arrived else since)
            if held and now - self._latest[session][1] >= IDLE_S:
                self._drop(session, held)
        self._latest = {session: self._latest[session] for session in sizes}
        self._dropped &= set(sizes)
        while sum(sum(held.values()) for held in sizes.values()) > self.most_bytes:
            most = max(sizes, key=lambda session: sum(sizes[session].values()))
            self._drop(most, sizes.pop(most))

    def has_dropped(self, session: str) -> bool:
        """Whether uploads of this session were dropped; True only once."""
        found = session in self._dropped
        self._dropped.discard(session)
        return found

    def _drop(self, session: str, held: Iterable[str]) -> None:
        for file in held:
            self.files.remove_file(session, file)
        self._dropped.add(session)


@st.cache_resource(show_spinner=False)
def watch_uploads() -> Watch | None:
    """Start the watch, once per server; None without a server, as in a test."""
    if not runtime.exists():
        return None
    files = runtime.get_instance().uploaded_file_mgr
    if not isinstance(files, MemoryUploadedFileManager):
        return None
    watch = Watch(files, ServerSettings.from_environment().uploads_mb * MB)
    threading.Thread(target=_look, args=(watch,), daemon=True, name="uploads").start()
    return watch


def _look(watch: Watch) -> None:
    while True:
        try:
            watch.look(time.monotonic())
        except Exception:
            _LOG.exception("Uploads could not be looked at.")
        time.sleep(LOOK_EVERY_S)


def check_dropped() -> None:
    """Report uploads that were dropped."""
    watch, run = watch_uploads(), get_script_run_ctx()
    if watch is not None and run is not None and watch.has_dropped(run.session_id):
        raise StereocalError(
            "The server has dropped uploaded files before they could be stored: together they "
            f"were more than {watch.most_bytes / MB:g} MB (STEREOCAL_UPLOADS_MB), or the next one "
            f"took longer than {IDLE_S / 60:g} minutes. Give them in smaller parts."
        )


def free_memory(uploads: Iterable[Upload]) -> None:
    """Free the memory of uploads that are stored."""
    run = get_script_run_ctx()
    if run is not None and isinstance(run.uploaded_file_mgr, MemoryUploadedFileManager):
        for upload in uploads:
            run.uploaded_file_mgr.remove_file(run.session_id, upload.file_id)
