"""Uploads do not stay in the server's memory: taken, too old or too much, they are let go."""

from __future__ import annotations

import pytest
from streamlit.runtime.memory_uploaded_file_manager import MemoryUploadedFileManager
from streamlit.runtime.uploaded_file_manager import UploadedFileRec
from streamlit.testing.v1 import AppTest

from stereocal.formats.dataset_files import pack_dataset, read_dataset
from stereocal.ui import intake
from stereocal.ui.uploads import IDLE_S, Watch
from tests.pages.test_pages import FIELD, zipped

MOST = 1000


@pytest.fixture
def files() -> MemoryUploadedFileManager:
    return MemoryUploadedFileManager("/upload")


def put(files: MemoryUploadedFileManager, session: str, name: str, size: int) -> None:
    files.add_file(session, UploadedFileRec(name, name, "text/csv", bytes(size)))


def held(files: MemoryUploadedFileManager) -> dict[str, set[str]]:
    return {session: set(own) for session, own in files.file_storage.items() if own}


def test_what_no_page_takes_goes_when_its_session_has_been_idle(
    files: MemoryUploadedFileManager,
) -> None:
    watch = Watch(files, MOST)
    put(files, "slow", "1", 10)
    put(files, "gone", "1", 10)
    watch.look(0.0)
    put(files, "slow", "2", 10)
    watch.look(IDLE_S - 1)
    assert held(files) == {"slow": {"1", "2"}, "gone": {"1"}}
    watch.look(IDLE_S)
    assert held(files) == {"slow": {"1", "2"}}  # which may still send more
    watch.look(2 * IDLE_S - 1)
    assert held(files) == {}


def test_what_a_page_has_taken_is_let_go(app: AppTest, monkeypatch: pytest.MonkeyPatch) -> None:
    gone: list[str] = []
    monkeypatch.setattr(
        intake, "free_memory", lambda uploads: gone.extend(upload.name for upload in uploads)
    )
    app.switch_page("pages/data.py").run()
    app.segmented_control(key="data_how").set_value("A zip").run()
    packed = zipped({k: bytes(v) for k, v in pack_dataset(read_dataset(FIELD)).items()})
    app.file_uploader(key="upload_zip").upload("rig.zip", packed, "application/zip").run()
    app.file_uploader(key="upload_zip").upload("bad.zip", b"no zip", "application/zip").run()
    assert gone == ["rig.zip", "bad.zip"]  # also what was refused
