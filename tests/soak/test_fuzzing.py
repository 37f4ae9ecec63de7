"""Whatever a file holds, its reader gives a value or a sentence."""

import resource
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import pytest
from hypothesis import given, settings

from stereocal.errors import LONGEST, StereocalError
from tests.soak import repeats
from tests.soak.damage import damaged, never_sound
from tests.soak.readers import Reader, readers

EXAMPLES = repeats(15, 2000)
ROOM = 2_000_000_000
"""Bytes of addresses that a reader may take beyond those of the process before it."""


@pytest.fixture
def bounded_memory() -> Iterator[None]:
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (now + ROOM, hard))
    yield
    resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def outcome(reader: Reader, content: bytes, folder: Path) -> str:
    """The sentence, or nothing where the file was accepted; any other error goes through."""
    try:
        reader.read(content, folder)
    except StereocalError as error:
        text = str(error)
        assert text and len(text) <= LONGEST and text.isprintable()
        return text
    return ""


@pytest.mark.parametrize("name", readers())
def test_a_sound_file_is_accepted(name: str, tmp_path: Path) -> None:
    """Else the fuzzing would end at the reader's door."""
    reader = readers()[name]
    if name not in ("address", "dlt, dlt.csv"):  # none of the two is whole in itself
        assert any(outcome(reader, content, tmp_path) == "" for content in reader.seeds())


@pytest.mark.soak
@pytest.mark.parametrize("name", readers())
@pytest.mark.usefixtures("bounded_memory")
def test_unsound_files(name: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    reader, folder = readers()[name], tmp_path_factory.mktemp("scratch")

    @settings(max_examples=EXAMPLES, database=None, deadline=timedelta(seconds=5))
    @given(damaged(reader.kind, reader.seeds()) | never_sound())
    def read(content: bytes) -> None:
        outcome(reader, content, folder)

    read()
