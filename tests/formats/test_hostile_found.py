"""What fuzzing has found, one of each kind: each ended in another error, or in a long wait."""

import io
import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stereocal.errors import StereocalError
from stereocal.system.arrays import read_arrays
from tests.files import zipped
from tests.soak.readers import readers
from tests.soak.seeds import image, parquet

HUGE = 10**400
HEAD_OF_ONE = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1,), }\n"
DLT = b"14803e5,32\n0,-55\n811400,28\n811.4,-84\n%b,-2.8\n1502.7,37\n577.2,19\n577.2,16\n"


def array(head: bytes, data: bytes = bytes(8)) -> bytes:
    """An array by its head."""
    return zipped({"head.npy": b"\x93NUMPY\1\0" + struct.pack("<H", len(head)) + head + data})


def sound(reader: str) -> bytes:
    return readers()[reader].seeds()[0]


CASES: list[tuple[str, bytes | Callable[[Any], object]]] = [
    ("points, deeplabcut", b"scorer,n,n\nbodyparts,b,b\ncoords,x,y\n1e300,1,2\n"),
    ("points, trackmate", b"POSITION_X,POSITION_Y,FRAME\nLabel\n"),
    ("points, wand", b",".join([b"1"] * 15_000) + b"\n" * 2),
    ("points, long table", b"time,x,y,bird,more\n1,1,2\n2,3,4\n"),
    ("table of points", b"frame,u,v\n1,2,3,4\n"),
    ("table of points", b'frame;u;v\n";",";"\n";",";"\n";",";"\n";";"\n'),
    ("table of points", b"frame,u,v\n" + b"x,1\n" * 99_000),
    ("dlt, dlt.csv", b"1" * 200_000),
    ("dlt, dlt.csv", DLT % b"1e308" + b"0,-0.79\n0,-0.13\n1000000,3.15\n"),
    ("world, JSON", json.dumps([[HUGE] * 4] * 4).encode()),
    ("aniposelib, calibration.toml", b"a = " + b"9" * 5000),
    ("kalibr, camchain.yaml", b"a:\n " * 100_000),
    ("camera, OpenCV YAML", b"%YAML:1.0\n---\n" + b"- " * 120_000),
    ("camera, OpenCV YAML", b"%YAML:1.0\n---\n" + b"{a: " * 60_000),
    ("camera, ours", lambda c: c["K"][0].__setitem__(0, 1e-320)),
    ("camera, ours", lambda c: c.update(image_size=[HUGE, HUGE])),
    ("colmap, rigs.txt", b"1 2 CAMERA 1 CAMERA 2 1 1e300 0 0 0 1 0 0\n"),
    ("parameters", lambda c: c.update(T=[1e300, 0, 0])),
    ("parameters", lambda c: c.update(validation=-float("inf"))),
    ("data set, zip", zipped({"": b"x"})),
    ("photograph, TIFF", b"II+\0\x08\0\0\0" + b"\xff" * 8 + bytes(40)),
    ("photograph, PGM", b"P6" + b"\r\n" * 60),
    ("photograph, JPEG", image(".jpg")[:-2] + b"\xff" * 300_000),
    ("project, project.json", b"[" * 100_000),
    ("project, project.json", lambda c: c.update(edits=[7])),
    ("project, project.json", lambda c: c["values"]["input"].update(name="\ud800")),
    ("project, calibration.json", lambda c: c["methods"].pop("2d")),
    ("project, frames.json", lambda c: c["frames"][0]["centres"][0][0].update(v=1e308)),
    ("project, boards.npz", zipped({"head": b"{}"})),
]
"""What is read, or what is changed in a sound JSON file of the kind."""


@pytest.mark.parametrize("number", range(len(CASES)))
def test_it_is_refused_now(number: int, tmp_path: Path) -> None:
    name, case = CASES[number]
    if callable(case):
        content = json.loads(sound(name))
        case(content)
        case = json.dumps(content).encode()
    with pytest.raises(StereocalError):
        readers()[name].read(case, tmp_path)


@pytest.mark.parametrize(
    "content",
    [
        array(HEAD_OF_ONE.replace(b"(1,)", b"(100000000000,)")),
        array(HEAD_OF_ONE.replace(b"(1,)", b"(-1,)")),
        array(HEAD_OF_ONE.replace(b"<f8", b"|O")),
        array(HEAD_OF_ONE, b"\0" * 6 + b"\xf0\x7f"),
        array(b"{'descr': 1L, 'shape': (\n"),
        zipped({"head.npy": b"not an array"}),
        zipped({"head.npy": bytes(range(256)) * 9})[:45] + bytes(60),
    ],
)
def test_arrays_that_are_none(content: bytes) -> None:
    with pytest.raises(StereocalError):
        read_arrays(content, "lens.npz")


def test_a_signalling_nan_is_a_plain_one() -> None:
    signalling = struct.pack("<Q", 0x7FF0000000000001)
    found = read_arrays(array(HEAD_OF_ONE, signalling), "x")["head"]
    assert np.isnan(found - 1).all()  # a RuntimeWarning otherwise


@pytest.mark.parametrize("name", ["counts0", "lengths0"])
def test_a_validation_of_nothing_but_zeros_has_no_share(name: str, tmp_path: Path) -> None:
    arrays = read_arrays(sound("project, evaluation.npz"), "x")
    out = io.BytesIO()
    arrays[name] = np.zeros_like(arrays[name])
    np.savez(out, **arrays)  # type: ignore[arg-type]
    readers()["project, evaluation.npz"].read(out.getvalue(), tmp_path)  # no RuntimeWarning


@pytest.mark.parametrize("number", range(len(parquet())))
def test_columns_of_kinds_that_nobody_expects(number: int, tmp_path: Path) -> None:
    try:
        readers()["Parquet"].read(parquet()[number], tmp_path)
    except StereocalError as error:
        assert "t.parquet" in str(error)
