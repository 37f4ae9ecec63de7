"""What is refused: by reader, the file, and the names and numbers that the message must hold.

Of what fuzzing has found, one of each kind: each ended in another error, or in a long wait.
"""

import io
import json
import re
import struct
import tomllib
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stereocal.errors import StereocalError
from stereocal.formats import point_text as point_text_module
from stereocal.formats.archives.gather import gather
from stereocal.formats.camera_file import read_camera, write_camera
from stereocal.formats.correspondences_csv import read_table
from stereocal.formats.dataset_files import pack_dataset, parse_recording
from stereocal.formats.evaluation_files import unpack_evaluation
from stereocal.formats.exchange.exchange import camera_names, export_files, import_files
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.exchange.text_formats import MOST_DOTS, read_toml
from stereocal.formats.point_layouts import propose_layout
from stereocal.formats.point_text import point_text
from stereocal.system.arrays import read_arrays
from stereocal.system.guarded import Reader
from stereocal.system.json_text import DEEPEST, MOST_VALUES, read_json
from tests import deadly
from tests.archives import PLAIN, easywand_fields, kalibr_chain, mat, stereo_struct, wand_csv
from tests.files import zipped
from tests.formats.test_exchange import FULL, RICHEST, SIZES
from tests.formats.test_formats import (
    HEADER,
    NODES,
    NOISY,
    ROW,
    SUFFIXES,
    table,
    with_storage,
    with_times,
)
from tests.formats.test_other_programs_points import hdf5
from tests.formats.test_recording_files import FILES, changed
from tests.refused import refused
from tests.rigs.known_rig import BAR_M, BASELINE_M, PRIMARY
from tests.soak.readers import readers
from tests.soak.seeds import image, parquet

PAIR = pack_dataset(NOISY)


def exchanged(name: str, change: tuple[str, str]) -> None:
    """A file that we wrote, with the matches of a pattern replaced."""
    ((file, content),) = export_files(RICHEST[name], name).items()
    text = re.sub(*change, content.decode(), flags=re.DOTALL)
    import_files({file: text.encode()}, name, SIZES)


READ: dict[str, Callable[[Any], object]] = {
    "table": lambda content: read_table(content, "f").strict("f"),
    "camera": lambda content: read_camera(content, "f"),
    "points": lambda content: propose_layout(content, "f"),
    "data set": lambda files: parse_recording({**PAIR, **files}, "f"),
    "no member": lambda name: parse_recording({k: PAIR[k] for k in PAIR if k != name}, "f"),
    "row": lambda row: parse_recording({**FILES, "points.csv": FILES["points.csv"] + row}, "f"),
    "recording": lambda keys: parse_recording(changed(**keys), "f"),
    "bars and lenses": lambda files: gather(files, ExchangeOptions()),
    "ros": lambda files: import_files(files, "ros"),
    "parameters, OpenCV": lambda files: import_files(files, "opencv"),
    "parameters, Kalibr": lambda files: import_files(files, "kalibr"),
    "parameters, MATLAB": lambda files: import_files(files, "matlab"),
    "arrays": lambda content: read_arrays(content, "f"),
    "HDF5": lambda content: point_text(content, "f"),
    "evaluation": unpack_evaluation,
    **{name: partial(exchanged, name) for name in ("kalibr", "aniposelib", "matlab")},
}
"""Further ones are of `readers`; each names the file f."""

UNSOUND: list[tuple[dict[str, Any], tuple[str, ...]]] = [
    ({"camera_matrix": np.zeros((3, 3))}, ("K", "fx = 0")),
    ({"camera_matrix": np.eye(4)}, ("K", "(4, 4)")),
    ({"camera_matrix": NODES["camera_matrix"].T.copy()}, ("K", "[[fx, skew, cx]")),
    ({"camera_matrix": 5}, ("camera_matrix",)),
    ({"camera_matrix": "K"}, ("camera_matrix",)),
    ({"distortion_coefficients": np.zeros((1, 3))}, ("3 distortion",)),
    ({"image_width": "wide"}, ("image size", "wide")),
    ({"image_width": 0}, ("0x1024",)),
    ({"image_height": -5}, ("1280x-5",)),
]
"""Nodes of a camera file of OpenCV."""
INI = b"# of a stereo camera\n\n[left camera]\nfx=700.8\nfy=700.7\n\n[STEREO]\nBaseline=119.9\n"
MAT = b"MATLAB 5.0 MAT-file, Platform: GLNXA64, Created on: Mon".ljust(124) + b"\x00\x01IM" * 40
TWICE = write_camera(PRIMARY).rstrip()[:-1] + b',\n"image_size": [640, 480]\n}\n'
YAML = b"%YAML:1.0\n---\n"
ROS = export_files(FULL, "ros")["primary.yaml"]
BARE = stereo_struct()
del BARE["RotationOfCamera2"], BARE["TranslationOfCamera2"]
SOUND_MAT = mat({"easyWandData": easywand_fields()}, compressed=False)
TWO_PROGRAMS = {"a.json": write_camera(PRIMARY), "b.yaml": b"cam0: {}\ncam1: {}\n"}
LENSES = dict.fromkeys(("a", "b-c", "a-b", "c"), "camera_1.json")
AROUND = (("", " = 1"), ("[", "]"), ("b = { ", " = 1 }"), ("# x\nb = [1.5, {", " = 1}]"))
"""A key of TOML."""
HUGE = 10**400
HEAD_OF_ONE = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1,), }\n"
DLT = b"14803e5,32\n0,-55\n811400,28\n811.4,-84\n%b,-2.8\n1502.7,37\n577.2,19\n577.2,16\n"


def array(head: bytes, data: bytes = bytes(8)) -> bytes:
    """An array by its head."""
    return zipped({"head.npy": b"\x93NUMPY\1\0" + struct.pack("<H", len(head)) + head + data})


def in_units(first: str, second: str) -> bytes:
    struct = stereo_struct()
    for k, unit in enumerate((first, second), start=1):
        struct[f"CameraParameters{k}"]["WorldUnits"] = unit
    return mat({"s": struct})


def cameras(name: str) -> dict[str, Any]:
    return {"cameras": {name: "camera_1.json", "right": "camera_2.json"}}


def target(name: str, *place: float) -> dict[str, Any]:
    return {"object": {"A": [0, 0, 0], name: list(place)}}


def described(text: str) -> dict[str, bytes]:
    return {"dataset.json": text.encode()}


CASES: list[tuple[Any, ...]] = [
    *(("table", content, "f: ") for content in (b"", b" \n\r\n\t\n", table(), table("", ""))),
    ("table", table(ROW, header="frame,target,u_primary"), "v_primary, u_secondary"),
    ("table", table(ROW, header=HEADER.replace("frame", "time")), "column frame"),
    ("table", table(ROW, header=HEADER + ",frame"), "column frame"),
    *(("table", content, "CSV") for content in (b"\xfff,\x81r\n\xe4", b"\x00\x01\x02")),
    *(("table", with_times(times), "time_frame") for times in ("7 8 12 12", "7 7 7 7")),
    ("table", with_times("7 7 x 12"), "line 4", "time_frame"),
    *(
        ("camera", with_storage(suffix, **{**NODES, **change}), "f: ", *said)
        for suffix in SUFFIXES
        for change, said in UNSOUND
    ),
    ("camera", b"%YAML:1.0\na: &x [1]\nb: [*x, *x]\n", "f: ", "YAML", "aliases"),
    ("camera", b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "f: ", "XML"),
    ("camera", b"%YAML:1.0\nimage_width: 3\nimage_width: 4\n", "f: ", '"image_width"', "line 2"),
    ("camera", b"<?xml version='1.0'?><a><K>1</K><K>2</K></a>", "f: ", "<a>"),
    ("camera", b'%YAML:1.0\na: !!int ""\n', "f: ", "YAML"),
    ("camera", b"\xff\xd8\xff\xe0", "f: ", "camera_matrix", "image_width"),
    ("camera", TWICE, "f: ", '"image_size"', "lines 27 and 32"),
    *(("camera", YAML + b, "f: ") for b in (b"[" * 2000, b"- " * 120_000, b"? " * 2000)),
    ("camera", YAML + b"{a: " * 60_000, "f: "),
    ("camera", b"<?xml version='1.0'?>" + b"<a>" * 1000 + b"</a>" * 1000, "f: "),
    *(
        (reader, {"f": content} if "," in reader else content, "f: ", *said)
        for content, *said in ((INI, "INI", "left camera", '"K"'), (MAT, "MATLAB", "jsonencode"))
        for reader in ("camera", "parameters, OpenCV", "parameters, Kalibr")
    ),
    ("parameters, MATLAB", {"f": INI}, "f: ", "left camera"),
    *(("points", own, "f: ") for own in (b"", b"frame,u,v\n", b"\x00\x01\x02\n\x03")),
    *(("points", own, "f: ", "DLTdv") for own in (b"name,size\nx,1\n", b"1,2,3\n4,5,6\n")),
    *(("no member", name, "f: ", name) for name in PAIR),
    *(("data set", described(each), "f: dataset.json") for each in ("", "{", "[]", "null", "7")),
    *(("data set", described(each), "f: dataset.json") for each in ('"x"', "\x00", "[" * 100_000)),
    ("data set", described('{"format": "other/1"}'), "f: dataset.json", "stereocal-dataset/1"),
    ("data set", {"dataset.json": PAIR["dataset.json"].replace(b" 2.37", b' "2.37"')}, "2.37"),
    *(
        ("data set", {"correspondences.csv": PAIR["correspondences.csv"] + row}, *said)
        for row, *said in (
            (b"99,A,1,2,3,x\n", "f: correspondences.csv: 1 row", "line 14", "v_secondary"),
            (b"99,A,1599.6,2,3,4\n", "correspondences.csv: 1 row", "frame 99", "1600x1200"),
        )
    ),
    *(
        ("row", row, "f: points.csv: 1 row", "line 103: ", *said)
        for row, *said in (
            (b"1,left,A,1,2\n", "frame 1", "left", "target A", "line 2"),
            (b"99,lefd,A,1,2\n", "camera", '"lefd"', "left, right, top"),
            (b"99,left,C,1,2\n", "target", '"C"', "A, B"),
            (b"99,left,A,1\n", "v is"),
            (b"99,left,A,x,2\n", 'u is "x"'),
            (b"99,right,B,9999,2\n", "frame 99", "right", "target B"),
            (b"9.5,left,A,1,2\n", "9.5"),
        )
    ),
    ("recording", {"cameras": {"left": "camera_1.json"}}, "f: dataset.json"),
    ("recording", {"cameras": ["camera_1.json"]}, "f: dataset.json"),
    ("recording", {"cameras": {"left": "camera_1.json", "right": "no.json"}}, "right", "'no.json'"),
    *(("recording", cameras(name), "f: ", "camera") for name in ("../../x", "/x", "a/b", "a\\b")),
    *(("recording", cameras(name), "f: ", "camera") for name in (".x", "", " x", "x\0", "x:y")),
    ("recording", cameras(65 * "x"), "f: ", "camera"),
    ("recording", {"cameras": LENSES}, "f: ", "a and b-c", "a-b and c"),
    ("recording", {"object": ...}, "f: dataset.json", '"object"'),
    ("recording", {"object": {"A": [0, 0, 0]}}, "f: ", "2 to 10000"),
    *(("recording", target(name, 0.9, 0, 0), "target") for name in ("", "B ", "\tB", "B\nC")),
    *(("recording", target(name, 0.9, 0, 0), "target") for name in ("B\ud800", 201 * "B")),
    ("recording", target("B", 0, 0, 0), "A and B"),
    ("recording", target("B", 0.9, 0), "'B'"),
    ("recording", target("B", 9000, 0, 0), "9000"),
    ("recording", {"object": {"board": {"columns": 9, "rows": 6}}}, "board", "`square_m`"),
    ("recording", {"object": {"board": {"columns": 9.5, "rows": 6, "square_m": 1}}}, "`int`"),
    ("recording", {"object_sigma_m": 0.5}, "f: ", "object"),
    ("recording", {"baselines_m": {"left-up": 4.5}}, "'left-up'"),
    ("recording", {"baselines_m": {"left-right": -1}}, "f: ", "0"),
    ("recording", {"baselines_m": {"left-right": 4.5, "right-left": 4.6}}, "f: ", "left"),
    ("recording", {"baselines_m": [4.5]}, "f: dataset.json", "baselines_m"),
    ("recording", {"format": "stereocal-dataset/3"}, "stereocal-dataset/2"),
    ("recording", {"basline_sigma_m": 0.01}, '"baseline_sigma_m"'),
    ("bars and lenses", {"x.dat": b"abc"}, "x.dat", "CSV"),
    ("bars and lenses", {"a.csv": wand_csv(), "b.csv": wand_csv()}, "a.csv, b.csv", "2 tables"),
    ("bars and lenses", {"a.json": b"{}"}, "a.json", "easyWandData.mat"),
    *(("bars and lenses", {"a.toml": b}, "a.toml", "TOML") for b in (b"[x]\ny = 1\n", b"x = [")),
    ("bars and lenses", {"a.yaml": b"cam0: 1\n"}, "a.yaml", "has 1"),
    ("bars and lenses", {"a.csv": b"frame,u,v\n1,2,3\n"}, "a.csv", "both ends"),
    ("bars and lenses", TWO_PROGRAMS, "a.json (camera)", "b.yaml (kalibr)"),
    ("bars and lenses", {"e.mat": SOUND_MAT, "a.csv": wand_csv()}, "e.mat: "),
    ("bars and lenses", {"a.mat": SOUND_MAT[:-50]}, "a.mat: ", "-v7"),
    ("bars and lenses", {"a.mat": b"MATLAB 7.3 MAT-file, HDF5 schema".ljust(512)}, "a.mat", "7.3"),
    ("bars and lenses", {"a.mat": b"\x89HDF\r\n\x1a\n" + bytes(500)}, "a.mat: ", "HDF5", "-v7"),
    ("bars and lenses", {"a.mat": mat({"x": np.ones(3)})}, "a.mat: ", "x (double)"),
    ("bars and lenses", {"a.mat": mat({"x": {"y": 1.0}})}, "a.mat: ", "toStruct"),
    *(
        ("bars and lenses", {"wand.csv": wand_csv(), name: text}, name, "K")
        for name, text in (
            ("cameras.txt", b"# Camera list\n1 OPENCV 1920 1080 1500 1500 966 534 0 0 0 0\n"),
            ("rig.qca.txt", b'<?xml version="1.0"?>\n<calibration created="x">\n</calibration>\n'),
        )
    ),
    ("parameters, OpenCV", {"i.yml": export_files(PLAIN, "opencv")["intrinsics.yml"]}, "R, T"),
    ("parameters, Kalibr", {"c.yaml": kalibr_chain()}, "3 (cam0, cam1, cam2)"),
    ("parameters, MATLAB", {"s.mat": mat({"s": BARE})}, "RotationOfCamera2", "PoseCamera2"),
    ("parameters, MATLAB", {"s.mat": in_units("yard", "yard")}, "s.mat: ", "WorldUnits", "yard"),
    ("parameters, MATLAB", {"s.mat": in_units("mm", "inches")}, "WorldUnits", "inches, mm"),
    ("kalibr", ("radtan", "fov"), "camchain.yaml, cam0", "fov", "radtan"),
    ("kalibr", ("cam1:", "cam2:"), "camchain.yaml", "cam0, cam2"),
    ("kalibr", (r"\[1600, 1200\]", "[1600]"), "camchain.yaml, cam0", "image size"),
    ("kalibr", ("T_cn_cnm1", "T_other"), "camchain.yaml", "T_cn_cnm1"),
    ("kalibr", ("^", "a: &x [1]\nb: *x\n"), "camchain.yaml", "aliases"),
    ("aniposelib", (r"\[cam_1\]", "[cam_1]\nfisheye = true"), "calibration.toml", "fisheye"),
    ("aniposelib", (r"\[cam_1\].*", ""), "calibration.toml", "has 1"),
    ("matlab", ("K2 = ", "L2 = "), "stereo_parameters.m: K2"),
    ("matlab", ("-0.21", "zero"), "stereo_parameters.m", "RadialDistortion1"),
    ("ros", {"0.yaml": ROS}, "camera_info", "1"),
    ("ros", {"0.yaml": ROS, "1.yaml": ROS}, "projection"),
    ("HDF5", hdf5(**{"df_with_missing/table": np.zeros(3)}), "f: ", "DeepLabCut", "CSV"),
    *(("evaluation", b, "validation") for b in (b"", b"PK", b"no archive", bytes(9))),
    *(
        ("arrays", content, "f")
        for content in (
            array(HEAD_OF_ONE.replace(b"(1,)", b"(100000000000,)")),
            array(HEAD_OF_ONE.replace(b"(1,)", b"(-1,)")),
            array(HEAD_OF_ONE.replace(b"<f8", b"|O")),
            array(HEAD_OF_ONE, b"\0" * 6 + b"\xf0\x7f"),
            array(b"{'descr': 1L, 'shape': (\n"),
            zipped({"head.npy": b"not an array"}),
            zipped({"head.npy": bytes(range(256)) * 9})[:45] + bytes(60),
        )
    ),
    # Found by fuzzing.
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
"""The reader, what it is given (or what is changed in a sound JSON file), what is said."""


@pytest.mark.parametrize("number", range(len(CASES)))
def test_it_is_refused(number: int, tmp_path: Path) -> None:
    reader, case, *said = CASES[number]
    if callable(case):
        content = json.loads(readers()[reader].seeds()[0])
        case(content)
        case = json.dumps(content).encode()
    with refused(*said):
        READ[reader](case) if reader in READ else readers()[reader].read(case, tmp_path)


def _not_to_be_called(*_: Any, **__: Any) -> Any:
    raise AssertionError("the parser was reached")


DEEP_KEY, NESTED = "a" + ".a" * 20_000, f"line 1 is nested more than {DEEPEST}"
TOO_MUCH = [
    *((f"{before}{DEEP_KEY}{after}", "TOML", f"{MOST_DOTS} parts") for before, after in AROUND),
    ("[a" + ' . "a"' * 5000 + "]", "TOML", f"{MOST_DOTS} parts"),
    *((text, "JSON", NESTED) for text in ("[" * 900, '{"a":' * 900, '["\\"[", ' + "[" * 900)),
    ("[" + "{}," * MOST_VALUES + "1]", "JSON", f"{MOST_VALUES:,} values"),
]


@pytest.mark.parametrize("number", range(len(TOO_MUCH)))
def test_what_would_cost_its_parser_memory_never_reaches_it(
    number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A key of 20,000 parts took that of TOML 6 s and 1.5 GB."""
    text, kind, said = TOO_MUCH[number]
    monkeypatch.setattr(tomllib, "loads", _not_to_be_called)
    monkeypatch.setattr(json, "loads", _not_to_be_called)
    with refused("f", said):
        camera_names("f.toml", text.encode()) if kind == "TOML" else read_json(text, "f")


def test_usual_keys_and_many_numbers_of_toml_are_read() -> None:
    numbers = ", ".join(["0.25"] * 3 * MOST_DOTS)
    found = read_toml(f'[a.b.c]\n"d.e" = [{numbers}]\nf = """\n1.0\n"""\n', "c.toml")
    assert len(found["a"]["b"]["c"]["d.e"]) == 3 * MOST_DOTS


@pytest.mark.parametrize(("read", "said"), [(deadly.abort, "its decoder"), (deadly.eat, "memory")])
def test_an_hdf5_file_that_kills_its_decoder(
    read: Reader, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(point_text_module, "analysis_table", read)
    with refused("a.h5: ", said):
        point_text(b"\x89HDF\r\n\x1a\n", "a.h5")


def test_a_mat_file_that_expands_is_refused_before_it_is_read(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("STEREOCAL_MOST_FILE_MB", "20")
    bomb = mat({"easyWandData": {"wandPts": np.zeros((500_000, 8))}})
    assert len(bomb) < 100_000
    with refused("a.mat: ", "STEREOCAL_MOST_RATIO"):
        gather({"a.mat": bomb}, ExchangeOptions())


def test_a_damaged_mat_file_is_refused_or_read() -> None:
    damaged = bytearray(SOUND_MAT)
    rng = np.random.default_rng(0)
    for at in rng.integers(128, len(damaged), 6):
        damaged[at] = rng.integers(256)
    with suppress(StereocalError):
        gather({"a.mat": bytes(damaged)}, ExchangeOptions()).dataset("x", BASELINE_M, BAR_M)


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
    reader.read(out.getvalue(), tmp_path)  # no RuntimeWarning


@pytest.mark.parametrize("number", range(len(parquet())))
def test_columns_of_kinds_that_nobody_expects(number: int, tmp_path: Path) -> None:
    try:
        readers()["Parquet"].read(parquet()[number], tmp_path)
    except StereocalError as error:
        assert "t.parquet" in str(error)
