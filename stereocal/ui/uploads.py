"""Uploaded files, whose memory is freed once they are stored."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from streamlit.runtime.memory_uploaded_file_manager import MemoryUploadedFileManager
from streamlit.runtime.scriptrunner import get_script_run_ctx


class Upload(Protocol):
    """An uploaded file as Streamlit passes it."""

    name: str
    file_id: str
    size: int

    def getvalue(self) -> bytes:
        """The content."""


def free_memory(uploads: Iterable[Upload]) -> None:
    """Free the memory of uploads that are stored; Streamlit would keep it for the session."""
    run = get_script_run_ctx()
    if run is not None and isinstance(run.uploaded_file_mgr, MemoryUploadedFileManager):
        for upload in uploads:
            run.uploaded_file_mgr.remove_file(run.session_id, upload.file_id)
