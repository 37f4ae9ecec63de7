"""Whatever a file holds, its reader gives a value or a sentence: fuzzing, and what it has found.

`python -m benchmarks.hostile` does the same a thousand times longer, within limits of memory.
"""

from __future__ import annotations

import pkgutil
from pathlib import Path
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import stereocal
from stereocal.errors import LONGEST, StereocalError
from tests.hostile import Reader, readers
from tests.hostile_mutations import from_nothing, mutated

EXAMPLES = 100
SLOW_EXAMPLES = 30
"""Of readers that open a whole project."""
NO_READERS = {
    "arrays": "read through `lens` and the evaluation of a project",
    "lens_fit": "fits numbers",
    "lens_model": "looks at a name and a count that `camera_file` has read",
    **dict.fromkeys(
        ("calibration_files", "database", "files", "given", "inputs", "project"),
        "read through the project's zip",
    ),
    **dict.fromkeys(
        ("home", "jobs", "journal", "refusals", "reserve", "salvage", "servers"),
        "read nothing that is carried",
    ),
    "evaluation_files": "read through the project's zip",
    "guarded_readers": "lists readers",
    "options": "asks",
    "simulated": "writes",
    "table_writer": "writes",
    "units": "multiplies",
}
"""Modules of formats/ and projects/ that read nothing of strangers by themselves, and why."""


def outcome(reader: Reader, content: bytes, folder: Path) -> str:
    """The sentence, or nothing where the file was accepted; any other error goes through."""
    try:
        reader.read(content, folder)
    except StereocalError as error:
        text = str(error)
        assert text and len(text) <= LONGEST and text.isprintable()
        return text
    return ""


def test_every_module_that_reads_is_fuzzed() -> None:
    everywhere = [each.name for each in pkgutil.walk_packages(stereocal.__path__, "stereocal.")]
    reading = ("stereocal.formats.", "stereocal.projects.")
    there = {name.split(".")[-1] for name in everywhere if name.startswith(reading)}
    fuzzed = {module for reader in readers().values() for module in reader.modules}
    assert there - (fuzzed | set(NO_READERS)) == set()
    assert (fuzzed | set(NO_READERS)) - {name.split(".")[-1] for name in everywhere} == set()
    assert fuzzed.isdisjoint(NO_READERS)


@pytest.mark.parametrize("name", readers())
def test_a_sound_file_is_accepted(name: str, tmp_path: Path) -> None:
    """Else the fuzzing would end at the reader's door."""
    reader = readers()[name]
    if name not in ("address", "dlt, dlt.csv"):  # none of the two is whole in itself
        assert any(outcome(reader, content, tmp_path) == "" for content in reader.seeds())


@pytest.mark.parametrize("name", readers())
def test_mutated_files(name: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    reader, folder = readers()[name], tmp_path_factory.mktemp("scratch")
    sound = reader.seeds()
    slow = name.startswith(("project", "points"))

    which = st.sampled_from(range(len(sound)))

    @settings(max_examples=SLOW_EXAMPLES if slow else EXAMPLES, database=None)
    @given(st.integers(0, 2**64), which, which)
    def never_another_error(number: int, seed: int, other: int) -> None:
        outcome(reader, mutated(reader.kind, Random(number), sound[seed], sound[other]), folder)

    never_another_error()


@pytest.mark.parametrize("name", readers())
def test_files_that_were_never_sound(name: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    reader, folder = readers()[name], tmp_path_factory.mktemp("scratch")
    made = st.integers(0, 2**64).map(lambda number: from_nothing(reader.kind, Random(number)))

    @settings(max_examples=10, database=None)
    @given(st.binary(max_size=2000) | st.text(max_size=500).map(str.encode) | made)
    def never_another_error(content: bytes) -> None:
        outcome(reader, content, folder)

    never_another_error()
