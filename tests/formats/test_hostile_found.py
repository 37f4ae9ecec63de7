"""What fuzzing has found, each once more: every case ended in another error, or in a long wait."""

from __future__ import annotations

import io
import json
import re
import struct
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stereocal.errors import StereocalError
from stereocal.system.arrays import read_arrays
from tests.hostile_projects import FILES
from tests.soak.readers import readers
from tests.soak.seeds import parquet

HUGE = 10**400
NAN, INFINITE = float("nan"), float("inf")
DEEP = b"[" * 100_000
HEAD_OF_ONE = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1,), }\n"
LAYOUT_ROWS = b"scorer,net,net,net\nbodyparts,nose,nose,nose\ncoords,x,y,likelihood\n"


def _set(key: str, value: object, content: dict[str, Any]) -> None:
    content[key] = value


def _nested(levels: bytes) -> bytes:
    return b"%YAML:1.0\n---\n" + levels + levels[-2:] * 60_000 + levels * 60_000


def inner(name: str, edit: Callable[[dict], object]) -> bytes:  # type: ignore[type-arg]
    """A JSON file of a project with something else in it."""
    content = json.loads(FILES[name].seeds()[0])
    edit(content)
    return json.dumps(content).encode()


def packed(name: str, content: bytes) -> bytes:
    """A zip of one file."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
    return out.getvalue()


def array(head: bytes, data: bytes = bytes(8)) -> bytes:
    """An array by its head."""
    return packed("head.npy", b"\x93NUMPY\1\0" + struct.pack("<H", len(head)) + head + data)


def damaged_data() -> bytes:
    """A zip whose packed data are none."""
    out = packed("head.npy", bytes(range(256)) * 9)
    return out[:45] + bytes(30) + out[75:]


PARAMETERS = {
    "a validation without an end": {"validation": -INFINITE},
    "settings without an end": {"settings": {"a": [INFINITE]}},
    "settings are no object": {"settings": 5},
    "a shift that has no length": {"T": [1e300, 0, 0]},
    "a rotation of huge numbers": {"R": [[1e200, 0, 0], [0, 1, 0], [0, 0, 1]]},
}
CASES: dict[str, tuple[str, Callable[[], bytes]]] = {
    "no x at all": ("points, deeplabcut", lambda: b"scorer,a\nbodyparts,b\ncoords,y\n1,2\n"),
    "short label rows": (
        "points, deeplabcut",
        lambda: b"scorer,n,n,n\nbodyparts\ncoords,x,y,likelihood\n0,1,2,3\n",
    ),
    "no likelihood in the rows": ("points, deeplabcut", lambda: LAYOUT_ROWS + b"0,1,2\n"),
    "a frame of 300 digits": ("points, deeplabcut", lambda: LAYOUT_ROWS + b"1e300,1,2,1\n"),
    "short spots": ("points, trackmate", lambda: b"POSITION_X,POSITION_Y,FRAME\nLabel\n"),
    "15,000 columns": ("points, wand", lambda: b",".join([b"1"] * 15_000) + b"\n" * 2),
    "rows shorter than the names": (
        "points, long table",
        lambda: b"time,x,y,bird,more\n1,1,2\n2,3,4\n",
    ),
    "rows longer than the names": ("table of points", lambda: b"frame,u,v\n1,2,3,4\n"),
    "an endless field in DLT": ("dlt, dlt.csv", lambda: b"1" * 200_000),
    "coefficients of very different size": (
        "dlt, dlt.csv",
        lambda: (
            b"1480300000.0,3249\n0,-552\n811400000,2852\n811.4,-8424\n1e308,-2.8\n1502700000,3710\n"
            b"577200000,1938\n577.2,1617\n0,-0.79\n0,-0.13\n1000000,3.15\n"
        ),
    ),
    "a huge coefficient": (
        "dlt, dlt.csv",
        lambda: (
            b"1480300000,3249\n0,-552\n811400000,2852\n811.4,-8424\n0,-2.8\n1502700000,3710\n"
            b"577200000,1e308\n577.2,1617\n0,-0.79\n0,-0.13\n1000000,3.15\n"
        ),
    ),
    "a lone return in DLT": ("dlt, dlt.csv", lambda: b"1,2\r3,4\n"),
    "an endless field in a world": ("world, table", lambda: b"1" * 200_000),
    "a huge number in a world": ("world, JSON", lambda: json.dumps([[HUGE] * 4] * 4).encode()),
    "too many digits in TOML": ("aniposelib, calibration.toml", lambda: b"a = " + b"9" * 5000),
    "a long YAML": ("kalibr, camchain.yaml", lambda: b"a:\n " * 100_000),
    "an image of 400 digits": (
        "camera, ours",
        lambda: json.dumps(
            {
                "format": "stereocal-camera/1",
                "K": np.eye(3).tolist(),
                "distortion": [],
                "image_size": [HUGE, HUGE],
            }
        ).encode(),
    ),
    "a file without a name in a zip": ("data set, zip", lambda: packed("", b"x")),
    "a TIFF page beyond all addresses": (
        "photograph, TIFF",
        lambda: b"II+\0\x08\0\0\0" + b"\xff" * 8 + bytes(40),
    ),
    "a quaternion of huge numbers": (
        "colmap, rigs.txt",
        lambda: b"1 2 CAMERA 1 CAMERA 2 1 1e300 0 0 0 1 0 0\n",
    ),
    "a deep project": ("project, project.json", lambda: DEEP),
    "a deep calibration": ("project, calibration.json", lambda: DEEP),
    "a project that is a number": ("project, project.json", lambda: b"7"),
    "no further method": (
        "project, calibration.json",
        lambda: inner("calibration.json", lambda c: c["methods"].pop("2d")),
    ),
    "known points that are no number": (
        "project, calibration.json",
        lambda: inner("calibration.json", lambda c: c["settings"].update(known_points=NAN)),
    ),
    "frames that are no number": (
        "project, calibration.json",
        lambda: inner("calibration.json", lambda c: c["settings"].update(calibration_frames=NAN)),
    ),
    "endless evaluations": (
        "project, calibration.json",
        lambda: inner("calibration.json", lambda c: c["methods"]["2d"].update(evaluations=1e999)),
    ),
    "a target far away": (
        "project, frames.json",
        lambda: inner("frames.json", lambda c: c["frames"][0]["centres"][0][0].update(v=1e308)),
    ),
    "a name that no disk takes": (
        "project, result.json",
        lambda: inner("result.json", lambda c: c.update(folder="é" * 300)),
    ),
    "an unknown pair": (
        "project, project.json",
        lambda: inner("project.json", lambda c: c["values"]["bar"]["pairs"][0]["pair"].update(x=1)),
    ),
    "half a sign in a name": (
        "project, project.json",
        lambda: inner("project.json", lambda c: c["values"]["input"].update(name="\ud800")),
    ),
    "a number for a name": (
        "project, calibration.json",
        lambda: inner("calibration.json", lambda c: c["inputs"].update(name=float("nan"))),
    ),
    "a baseline of 400 digits": (
        "project, project.json",
        lambda: inner("project.json", lambda c: c["values"]["input"].update(baseline_m=HUGE)),
    ),
    "pairs that are no list": (
        "project, project.json",
        lambda: inner("project.json", lambda c: c["values"]["bar"].update(pairs=False)),
    ),
    **{
        f"{part} of a project that are {given!r}": (
            "project, project.json",
            partial(inner, "project.json", partial(_set, part, given)),
        )
        for part in ("files", "edits")
        for given in (5, {"a": 1}, [7])
    },
    "a lens that magnifies nothing": (
        "camera, ours",
        lambda: readers()["camera, ours"].seeds()[0].replace(b"1480.3", b"1e-320"),
    ),
    "a rectification of huge numbers": (
        "ros, secondary.yaml",
        lambda: re.sub(
            rb"(rectification_matrix:.*?data: \[)[^\]]*",
            rb"\g<1>" + b", ".join([b"1e308"] * 9),
            readers()["ros, secondary.yaml"].seeds()[0],
            flags=re.DOTALL,
        ),
    ),
    "a target that is no number": (
        "project, frames.json",
        lambda: inner("frames.json", lambda c: c["frames"][0]["centres"][0][0].update(v=NAN)),
    ),
    "a quoted cell that goes on in the next line": (
        "table of points",
        lambda: b'frame;u;v\n";",";"\n";",";"\n";",";"\n";";"\n',
    ),
    "a PGM of blanks": ("photograph, PGM", lambda: b"P6" + b"\r\n" * 60),
    "a JPEG that ends in marks": (
        "photograph, JPEG",
        lambda: readers()["photograph, JPEG"].seeds()[0][:-2] + b"\xff" * 300_000,
    ),
    "a script of blank lines": (
        "matlab, stereo_parameters.m",
        lambda: readers()["matlab, stereo_parameters.m"].seeds()[0] + b"\n" * 300_000,
    ),
    "a script of dots": (
        "matlab, stereo_parameters.m",
        lambda: readers()["matlab, stereo_parameters.m"].seeds()[0] + b"." * 300_000,
    ),
    "a table of rows that cannot be used": (
        "table of points",
        lambda: b"frame,u,v\n" + b"x,1\n" * 99_000,
    ),
    **{
        f"a camera file of {levels!r}": (
            "camera, OpenCV YAML",
            partial(_nested, levels),
        )
        for levels in (b"a: ", b"-", b"- ", b"[", b"{a: ", b"x: !!a - ")
    },
    "boards without arrays": ("project, boards.npz", lambda: packed("head", b"{}")),
    **{
        name: (
            "parameters",
            lambda change=change: json.dumps(  # type: ignore[misc]
                {**json.loads(readers()["parameters"].seeds()[0]), **change}
            ).encode(),
        )
        for name, change in PARAMETERS.items()
    },
}
READ_ANOTHER_WAY = (
    "no x at all",
    "short label rows",
    "a script of blank lines",
    "a script of dots",
)
"""As a table whose columns a person chooses; blanks are allowed."""


@pytest.mark.parametrize("case", CASES)
def test_it_is_refused_now(case: str, tmp_path: Path) -> None:
    name, content = CASES[case]
    refused = False
    try:
        readers()[name].read(content(), tmp_path)
    except StereocalError:
        refused = True
    assert refused or case in READ_ANOTHER_WAY


@pytest.mark.parametrize(
    "content",
    [
        array(b"{'descr': '<f8', 'fortran_order': False, 'shape': (100000000000,), }\n"),
        array(b"{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }\n"),
        array(b"{'descr': '|O', 'fortran_order': False, 'shape': (1,), }\n"),
        array(b"{'descr': '<U2', 'fortran_order': False, 'shape': (1,), }\n"),
        array(HEAD_OF_ONE, b"\0" * 6 + b"\xf0\x7f"),
        array(b"{'descr': (\n"),
        array(b"{'descr': 1L, 'shape': (\n"),
        packed("head.npy", b"not an array"),
        damaged_data(),
        packed("head.npy", b"\x93NUMPY\1\0v\0").replace(b"PK\x01\x02\x14", b"PK\x01\x02\xff"),
    ],
)
def test_arrays_that_are_none(content: bytes) -> None:
    with pytest.raises(StereocalError):
        read_arrays(content, "lens.npz")


def test_arrays_come_back() -> None:
    out = io.BytesIO()
    made = {"a": np.arange(6.0).reshape(2, 3), "b": np.asfortranarray(np.ones((2, 3), np.int32))}
    np.savez_compressed(out, **made)  # type: ignore[arg-type]
    found = read_arrays(out.getvalue(), "x")
    for name, array in made.items():
        np.testing.assert_array_equal(found[name], array)
        assert found[name].dtype == array.dtype


def test_a_signalling_nan_is_a_plain_one() -> None:
    signalling = struct.pack("<Q", 0x7FF0000000000001)
    found = read_arrays(array(HEAD_OF_ONE, signalling), "x")["head"]
    assert np.isnan(found - 1).all()  # a RuntimeWarning otherwise


@pytest.mark.parametrize("name", ["counts0", "lengths0"])
def test_a_validation_of_nothing_but_zeros_has_no_share(name: str, tmp_path: Path) -> None:
    reader = readers()["project, evaluation.npz"]
    arrays = read_arrays(reader.seeds()[0], "x")
    out = io.BytesIO()
    arrays[name] = np.zeros_like(arrays[name])
    np.savez(out, **arrays)  # type: ignore[arg-type]
    reader.read(out.getvalue(), tmp_path)  # a RuntimeWarning otherwise


@pytest.mark.parametrize("number", range(len(parquet())))
def test_columns_of_kinds_that_nobody_expects(number: int, tmp_path: Path) -> None:
    try:
        readers()["Parquet"].read(parquet()[number], tmp_path)
    except StereocalError as error:
        assert "t.parquet" in str(error)


def test_a_click_of_400_digits_is_none(tmp_path: Path) -> None:
    click = json.dumps({"id": "a", "u": HUGE, "v": 1, "raw": False}).encode()
    assert readers()["click"].read(click, tmp_path) is None
