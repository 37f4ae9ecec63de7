"""How much is read of strangers' files: each limit bites before decoding, and names its setting."""

import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from stereocal.errors import LONGEST, StereocalError
from stereocal.formats.correspondences_csv import TEMPLATE, read_table
from stereocal.formats.dataset_files import read_dataset
from stereocal.formats.point_files import read_points
from stereocal.formats.point_layouts import propose_layout
from stereocal.matching.point_table import PointTable
from stereocal.system.photograph import read_photograph
from stereocal.system.photograph_files import photographs_in
from stereocal.system.zip_files import open_zip
from tests.files import encoded, zipped
from tests.refused import refused


def bomb(count: int, size: int = 10) -> bytes:
    return zipped({f"{at}.csv": bytes(size) for at in range(count)})


POINTS = b"frame,u,v\n" + b"1,2,3\n" * 30


def _open(source: bytes | Path) -> None:
    with open_zip(source, "a.zip"):
        pass


def _points(content: bytes) -> None:
    layout = propose_layout(content, "t.csv")
    read_points(content, layout, "cam1", source="t.csv")


def _table(content: bytes, folder: Path) -> None:
    path = folder / "t.csv"
    path.write_bytes(content)
    PointTable(path, ("u", "v")).check()


def _photograph(folder: Path) -> None:
    path = folder / "p.png"
    path.write_bytes(encoded(np.zeros((1100, 1000), np.uint8)))
    read_photograph(path)


def _photographs(folder: Path) -> None:
    for at in range(4):
        (folder / f"{at}.png").write_bytes(b"x")
    photographs_in(folder, folder)


def _dataset(folder: Path) -> None:
    (folder / "dataset.json").write_bytes(b" " * 1_100_000)
    read_dataset(folder)


@pytest.mark.parametrize(
    ("name", "value", "read", "found"),
    [
        ("FILES", "3", lambda _: _open(bomb(4)), ("4 files", "at most 3")),
        ("FILES", "3", _photographs, ("4 files", "at most 3")),
        ("UNPACKED_MB", "1", lambda _: _open(bomb(2, 600_000)), ("1.2 MB", "at most 1 MB")),
        ("FILE_MB", "1", lambda _: _open(bomb(1, 1_200_000)), ("0.csv: ", "1.2 MB")),
        ("FILE_MB", "1", _dataset, ("1.1 MB", "at most 1 MB")),
        ("FILE_MB", "1", lambda d: _table(b"frame,u,v\n" + b"\n" * 1_500_000, d), ("1.5 MB",)),
        ("FILE_MB", "1", lambda _: read_table(b"a" * 2_000_000, "t"), ("t: ", "2.0 MB")),
        ("RATIO", "5", lambda _: _open(bomb(1, 10_900_000)), ("10900000", "times")),
        ("MEGAPIXELS", "1", _photograph, ("1000x1100", "1.1 mega")),
        ("PAIRS", "3", lambda _: read_table(TEMPLATE.encode(), "t"), ("t: ",)),
        ("ROWS", "20", lambda d: _table(POINTS, d), ("t.csv: ", "30")),
        ("ROWS", "20", lambda _: _points(POINTS), ("t.csv: ", "31")),
    ],
)
def test_each_limit_says_what_was_found_and_what_to_change(
    name: str,
    value: str,
    read: Callable[[Path], object],
    found: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    variable = f"STEREOCAL_MOST_{name}"
    monkeypatch.setenv(variable, value)
    with refused(*found, variable):
        read(tmp_path)


def test_a_zip_with_a_long_list_is_refused_before_the_list_is_held(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("STEREOCAL_MOST_FILES", "50")
    content = bomb(200)
    path = tmp_path / "a.zip"
    path.write_bytes(content)

    def never(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr(zipfile, "ZipFile", never)
    for source in (content, path):
        with refused("200 files"):
            _open(source)


def test_a_sentence_is_short_and_can_be_shown_whatever_it_quotes() -> None:
    told = str(StereocalError(f"a.json: {'x' * 1_000_000} is none; give a number."))
    assert len(told) <= LONGEST
    assert told.startswith("a.json: xxx") and told.endswith("xxx is none; give a number.")
    assert str(StereocalError("a\ud800\x00\n\u202eb")) == "a    b"
