"""Whatever a file holds, its reader gives a value or a sentence.

`python -m benchmarks.hostile` does the same a thousand times longer, within limits of memory.
"""

from __future__ import annotations

import pkgutil
from pathlib import Path
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import stereocal.formats
from stereocal.errors import LONGEST, StereocalError
from tests.soak import repeats
from tests.soak.mutations import from_nothing, mutated
from tests.soak.readers import Reader, readers

FEW, MANY = 3, repeats(100, 400)
NO_READERS = {
    "evaluation_files": "read as a file of a project",
    "lens_fit": "fits numbers",
    "lens_model": "looks at a name and a count that `camera_file` has read",
    "matlab_file": "reads in a child process, which SciPy may crash",
    "options": "what a person says of the exchange formats",
    "simulated": "writes",
    "units": "multiplies",
}
"""Modules of formats/ that read no untrusted file by themselves, and why."""


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
    walked = pkgutil.walk_packages(stereocal.formats.__path__, "stereocal.formats.")
    there = {each.name.rsplit(".", 1)[1] for each in walked if not each.ispkg}
    fuzzed = {module for reader in readers().values() for module in reader.modules}
    assert there <= fuzzed | set(NO_READERS)


@pytest.mark.parametrize("name", readers())
def test_a_sound_file_is_accepted(name: str, tmp_path: Path) -> None:
    """Else the fuzzing would end at the reader's door."""
    reader = readers()[name]
    if name not in ("address", "dlt, dlt.csv"):  # none of the two is whole in itself
        assert any(outcome(reader, content, tmp_path) == "" for content in reader.seeds())


@pytest.mark.parametrize("examples", [FEW, pytest.param(MANY, marks=pytest.mark.soak)])
@pytest.mark.parametrize("name", readers())
def test_unsound_files(name: str, examples: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Sound files changed at random; one of six was never sound."""
    reader, folder = readers()[name], tmp_path_factory.mktemp("scratch")
    sound = reader.seeds()
    which = st.sampled_from(range(len(sound)))
    numbers = st.integers(0, 2**64)

    @settings(max_examples=examples, database=None)
    @given(numbers, which, which)
    def changed(number: int, seed: int, other: int) -> None:
        outcome(reader, mutated(reader.kind, Random(number), sound[seed], sound[other]), folder)

    made = numbers.map(lambda number: from_nothing(reader.kind, Random(number)))

    @settings(max_examples=max(2, examples // 6), database=None)
    @given(st.binary(max_size=2000) | st.text(max_size=500).map(str.encode) | made)
    def never_sound(content: bytes) -> None:
        outcome(reader, content, folder)

    changed()
    never_sound()
