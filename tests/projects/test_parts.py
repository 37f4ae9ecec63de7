"""Finished parts on disk: the same to the last bit, whatever was damaged or cut off."""

from __future__ import annotations

import errno
import json
import os
from dataclasses import fields
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereocal.detection.detect import Detection, detect_targets, refusal
from stereocal.detection.fit import Corner
from stereocal.errors import StereocalError
from stereocal.evaluation.evaluate import EvaluationSettings, Run, evaluate_runs
from stereocal.formats.evaluation_files import pack_runs, unpack_runs
from stereocal.frames.detection_file import pack_detection, unpack_detection
from stereocal.intrinsics.board_pattern import BoardPattern
from stereocal.intrinsics.boards import BoardView, Refused, find_board
from stereocal.intrinsics.files import pack_board, pack_draws, unpack_board, unpack_draws
from stereocal.matching.blocks import TableBlock, pack_block, unpack_block
from stereocal.refined.unknowns import RefineSettings
from stereocal.store.parts import Parts
from stereocal.system.photograph import read_photograph
from tests import known_rig as rig

SAMPLES = Path(__file__).parents[2] / "sample_data" / "photographs"


def texts(path: Path) -> Parts[str]:
    return Parts(path, str.encode, bytes.decode)


def filled(path: Path, count: int = 5) -> dict[str, str]:
    parts = texts(path)
    content = {f"key {i}": f"value {i} ä" * (i + 1) for i in range(count)}
    for key, value in content.items():
        parts.keep(key, value)
    parts.close()
    return content


def test_what_was_kept_is_there_again(tmp_path: Path) -> None:
    content = filled(tmp_path / "a")
    parts = texts(tmp_path / "a")
    assert {key: parts.get(key) for key in content} == content
    assert parts.get("another") is None
    parts.keep("another", "new")
    parts.keep("key 0", "replaced")
    assert parts.get("key 0") == "replaced"
    parts.close()
    again = texts(tmp_path / "a")
    assert (again.get("another"), again.get("key 0"), len(again)) == ("new", "replaced", 6)
    again.close()


def test_a_file_cut_off_anywhere_keeps_its_whole_parts(tmp_path: Path) -> None:
    path = tmp_path / "a"
    content = filled(path)
    whole = path.read_bytes()
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        parts = texts(path)
        found = [parts.get(key) for key in content]
        sound = sum(value is not None for value in found)
        assert found[:sound] == list(content.values())[:sound]
        assert sound < len(content)
        parts.keep("after", "wards")
        parts.close()
        again = texts(path)
        assert again.get("after") == "wards"
        assert len(again) == sound + 1
        again.close()


@given(at=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_a_flipped_bit_never_gives_another_value(
    at: float, bit: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("parts") / "a"
    content = filled(path)
    damaged = bytearray(path.read_bytes())
    damaged[int(at * len(damaged))] ^= 1 << bit
    path.write_bytes(damaged)
    parts = texts(path)
    found = {key: parts.get(key) for key in content}
    assert all(value in (None, content[key]) for key, value in found.items())
    assert None in found.values()
    for key, value in content.items():
        parts.keep(key, value)
        assert parts.get(key) == value
    parts.close()


@given(content=st.binary(max_size=300))
def test_any_bytes_are_a_file_without_parts(
    content: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("parts") / "a"
    path.write_bytes(content)
    parts = texts(path)
    assert len(parts) == 0
    parts.close()


def test_a_part_that_does_not_unpack_is_computed_again(tmp_path: Path) -> None:
    filled(tmp_path / "a")
    parts = Parts(tmp_path / "a", pack_runs, unpack_runs)
    assert parts.get("key 0") is None
    parts.close()


def test_on_a_full_disk_the_job_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    content = filled(tmp_path / "a")
    parts, write = texts(tmp_path / "a"), os.write

    def full(handle: int, data: bytes) -> int:
        if len(data) < 5:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(handle, data[:5])

    monkeypatch.setattr(os, "write", full)
    parts.keep("more", "of it")
    monkeypatch.undo()
    assert parts.get("more") is None
    parts.keep("more", "of it")  # it has given up
    assert parts.get("more") is None
    parts.close()
    again = texts(tmp_path / "a")
    assert {key: again.get(key) for key in content} == content
    again.close()


def test_a_folder_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(StereocalError, match="cannot be written to"):
        texts(tmp_path / "no" / "a")


def same_runs(first: list[Run], second: list[Run]) -> bool:
    return len(first) == len(second) and all(
        getattr(a, name).dtype == getattr(b, name).dtype
        and getattr(a, name).tobytes() == getattr(b, name).tobytes()
        and getattr(a, name).shape == getattr(b, name).shape
        for a, b in zip(first, second, strict=True)
        for name in ("counts", "nans", "lengths", "angles", "correct_px")
    )


def test_runs_come_back_to_the_last_bit() -> None:
    settings = EvaluationSettings(calibration_frames=14, refined=RefineSettings())
    runs = evaluate_runs(rig.dataset(20, 0.3), settings, 0, range(3))
    assert same_runs(unpack_runs(pack_runs(runs)), runs)


def same_detections(first: Detection, second: Detection) -> bool:
    assert (first.targets is None) == (second.targets is None)
    for one, other in zip(first.targets or (), second.targets or (), strict=True):
        for field in fields(Corner):
            a, b = (np.asarray(getattr(corner, field.name)) for corner in (one, other))
            if a.tobytes() != b.tobytes() or a.dtype != b.dtype:
                return False
    for choice, its in zip(first.alternatives, second.alternatives, strict=True):
        if not same_detections(choice, its):
            return False
    own = ("targets", "alternatives")
    rest = [field.name for field in fields(Detection) if field.name not in own]
    return all(getattr(first, name) == getattr(second, name) for name in rest)


def test_detections_come_back_to_the_last_bit() -> None:
    image = read_photograph(SAMPLES / "primary" / "0001.jpg")
    for found in (
        detect_targets(image),
        detect_targets(image[:400, :400]),
        refusal((3, 2), "blurred", "x"),
    ):
        packed = pack_detection(found)
        assert packed is not None
        back = unpack_detection(packed)
        assert same_detections(back, found)
    assert pack_detection(refusal((0, 0), "unreadable", "x")) is None
    assert packed is not None
    with pytest.raises(ValueError, match="magic"):
        unpack_detection(json.dumps({**json.loads(packed), "reason": "magic"}).encode())


def test_boards_come_back_to_the_last_bit() -> None:
    image = read_photograph(SAMPLES / "boards_primary" / "0001.jpg")
    found = find_board(image, BoardPattern(18, 12, 0.03), "é")
    assert isinstance(found, BoardView)
    packed = pack_board(found)
    assert packed is not None
    back = unpack_board(packed)
    assert isinstance(back, BoardView)
    assert (back.name, back.image_size, back.turned) == (found.name, found.image_size, found.turned)
    for name in ("ids", "corners"):
        assert getattr(back, name).tobytes() == np.ascontiguousarray(getattr(found, name)).tobytes()
    refused = Refused("a", "no board", (3, 4))
    content = pack_board(refused)
    assert content is not None and unpack_board(content) == refused
    assert pack_board(Refused("a", "it cannot be read")) is None


@given(st.lists(st.floats(), min_size=9, max_size=9))
def test_draws_come_back_to_the_last_bit(values: list[float]) -> None:
    draws = np.array([values])
    back = unpack_draws(pack_draws(draws))
    assert np.array_equal(back, draws, equal_nan=True) and back.dtype == draws.dtype


@given(
    rows=st.lists(st.tuples(st.integers(), st.floats(), st.booleans(), st.text(max_size=9))),
    numbers=st.lists(st.floats()),
)
def test_lines_of_a_table_come_back_to_the_last_bit(
    rows: list[tuple[int, float, bool, str]], numbers: list[float]
) -> None:
    table = pd.DataFrame(rows, columns=["frame", "u", "ambiguous", "name"])
    block = TableBlock(table, np.array(numbers)).as_lines(["frame", "u", "ambiguous", "name"])
    try:
        packed = pack_block(block)
    except UnicodeEncodeError:
        return  # half of a character, which no file has
    assert packed is not None
    back = unpack_block(packed)
    assert back.rows == block.rows
    assert back.numbers.tobytes() == block.numbers.tobytes()
    assert pack_block(TableBlock(table, np.array(numbers))) is None
