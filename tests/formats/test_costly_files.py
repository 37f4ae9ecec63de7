"""Files made to cost their parser memory, time or the process."""

import json
import tomllib
import tracemalloc
from typing import Any

import numpy as np
import pytest

from stereocal.errors import StereocalError
from stereocal.formats import point_text as point_text_module
from stereocal.formats.exchange.exchange import camera_names
from stereocal.formats.exchange.text_formats import MOST_DOTS, read_toml
from stereocal.formats.file_storage import read_storage, read_yaml
from stereocal.formats.point_text import point_text
from stereocal.rig.rigid_object import BoardPattern, RigidObject
from stereocal.system.guarded import Reader
from stereocal.system.json_text import DEEPEST, MOST_VALUES, read_json
from stereocal.system.latest import read_once
from tests import deadly


class TestToml:
    @pytest.mark.parametrize(
        "text",
        [
            "a" + ".a" * 20_000 + " = 1",
            "[a" + ".a" * 20_000 + "]",
            "[a" + ' . "a"' * 5000 + "]",
            "b = { a" + ".a" * 20_000 + " = 1 }",
            "# a comment\nb = [1.5, {a" + ".a" * 20_000 + " = 1}]",
        ],
    )
    def test_a_key_of_many_parts_never_reaches_the_parser(
        self, text: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """20,000 parts took it 6 s and 1.5 GB."""
        monkeypatch.setattr(tomllib, "loads", _not_to_be_called)
        with pytest.raises(StereocalError, match=r"^c\.toml: a key has more than"):
            camera_names("c.toml", text.encode())

    def test_usual_keys_and_many_numbers_are_read(self) -> None:
        numbers = ", ".join(["0.25"] * 3 * MOST_DOTS)
        found = read_toml(f'[a.b.c]\n"d.e" = [{numbers}]\nf = """\n1.0\n"""\n', "c.toml")
        assert len(found["a"]["b"]["c"]["d.e"]) == 3 * MOST_DOTS


class TestJson:
    @pytest.mark.parametrize("text", ["[" * 900, '{"a":' * 900, '["\\"[", ' + "[" * 900])
    def test_nested_too_deeply(self, text: str, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(json, "loads", _not_to_be_called)
        with pytest.raises(StereocalError, match=rf"line 1 is nested more than {DEEPEST} levels"):
            read_json(text, "a.json")

    def test_too_many_values(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(json, "loads", _not_to_be_called)
        with pytest.raises(StereocalError, match="more than 1,000,000 values"):
            read_json("[" + "{}," * MOST_VALUES + "1]", "a.json")


def test_xml_and_yaml_nested_too_deeply() -> None:
    with pytest.raises(StereocalError, match="nested too deeply"):
        read_storage("<a>" * 1000 + "</a>" * 1000, "a.xml")
    for text in ("[" * 2000, "- " * 2000, "? " * 2000):
        with pytest.raises(StereocalError, match="not valid YAML"):
            read_yaml(text, "a.yaml")


def test_a_board_of_ten_thousand_corners_costs_what_was_seen() -> None:
    """Distances between all its corners took 800 MB each time, 6.5 GB in all."""
    tracemalloc.start()
    board = RigidObject.of_board(BoardPattern(100, 100, 0.01))
    assert board.half_turn.tolist() == [*range(10_000)][::-1]
    assert board.pairs_among(range(10_000)).tolist() == [[0, 9999], [99, 9900]]
    assert board.longest_m == pytest.approx(0.99 * np.sqrt(2))
    assert tracemalloc.get_traced_memory()[1] < 20e6  # measured 2.4 MB
    tracemalloc.stop()


@pytest.mark.parametrize(
    ("read", "message"), [(deadly.abort, "makes its decoder fail"), (deadly.eat, "too much memory")]
)
def test_an_hdf5_file_that_kills_its_decoder(
    read: Reader, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(point_text_module, "analysis_table", read)
    with pytest.raises(StereocalError, match=f"^a.h5: the file .*{message}"):
        point_text(b"\x89HDF\r\n\x1a\n", "a.h5")


def test_a_file_is_read_once_for_all_draws_of_a_page() -> None:
    calls = []

    def read(content: bytes, label: str, refuse: bool = False) -> int:
        calls.append(label)
        if refuse:
            raise StereocalError(f"{label} is damaged")
        return len(content)

    for _ in range(3):
        assert read_once(read, b"abc", "a") == 3
        with pytest.raises(StereocalError, match="b is damaged"):
            read_once(read, b"abc", "b", refuse=True)
    assert calls == ["a", "b"]
    assert read_once(read, b"abcd", "a") == 4
    assert read_once(read, b"abc", "c") == 3


def _not_to_be_called(*_: Any, **__: Any) -> Any:
    raise AssertionError("the parser was reached")
