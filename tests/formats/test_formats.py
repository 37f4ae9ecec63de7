"""Files in and out: tables, camera files and data sets, sound, broken and hostile."""

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields, replace
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from stereocal.errors import RefusedRowsError, StereocalError
from stereocal.formats.camera_file import read_camera, write_camera, write_opencv_camera
from stereocal.formats.correspondences_csv import TEMPLATE, read_table, write_table
from stereocal.formats.dataset_files import (
    pack_dataset,
    parse_recording,
    read_dataset,
    read_recording,
)
from stereocal.formats.recognition import recognise
from stereocal.rig.camera import CAMERAS, Camera, LensUncertainty
from stereocal.rig.correspondences import Correspondences
from stereocal.rig.tracks import TimeOffset
from stereocal.system.zip_files import unzip
from tests.files import write, zipped
from tests.refused import refused
from tests.rigs.fisheye_rig import fisheye
from tests.rigs.known_rig import PRIMARY, SECONDARY, dataset

HEADER = "frame,target,u_primary,v_primary,u_secondary,v_secondary"
ROW = "1,A,100.5,200,300,400.25"
NOISY = dataset(6, noise_px=0.3)


def table(*rows: str, header: str = HEADER, end: str = "\n") -> bytes:
    return (end.join([header, *rows]) + end).encode()


def problems_of(content: bytes) -> list[tuple[int, str]]:
    return [(problem.line, problem.reason) for problem in read_table(content, "t.csv").problems]


class TestTable:
    def test_template(self) -> None:
        rows = read_table(TEMPLATE.encode(), "t.csv").strict("t.csv")
        np.testing.assert_array_equal(rows.frame, [1, 1, 2, 2])
        np.testing.assert_array_equal(rows.target, [0, 1, 0, 1])
        np.testing.assert_array_equal(rows.primary[1], [1303.84, 702.15])
        np.testing.assert_array_equal(rows.secondary[2], [540.08, 812.57])
        np.testing.assert_array_equal(rows.line, [2, 3, 4, 5])
        assert np.isnan(rows.distance_m).all()

    @pytest.mark.parametrize(("end", "blank"), [("\n", 1), ("\r\n", 1), ("\r", 0)])
    @pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
    def test_blank_lines_and_any_ends_keep_the_line_numbers(
        self, end: str, blank: int, mark: bytes
    ) -> None:
        gap = blank * ["", ",,,,,"]
        rows = table(*gap, ROW, *gap, "1,B,x,2,3,4", *gap, "3,A,1,2,3,4", end=end)
        read = read_table(mark + (blank * end).encode() + rows, "t.csv")
        assert [problem.line for problem in read.problems] == [3 + 5 * blank]
        np.testing.assert_array_equal(read.correspondences.line, [2 + 3 * blank, 4 + 7 * blank])

    @pytest.mark.parametrize(
        ("delimiter", "point"), [*product(";\t| ", ".,"), (",", "."), ('","', ",")]
    )
    @pytest.mark.parametrize("above", ["", "\n", "sep={}\n", '"sep={}"\r\n'])
    @pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
    def test_delimiters_decimal_signs_columns_in_any_order_and_further_ones(
        self, delimiter: str, point: str, above: str, encoding: str
    ) -> None:
        header = "note;V_Secondary;target;u_secondary;v_primary;u_primary;frame"
        row = f"hello;1204{point}5;b;3{point}25;2;1;17"
        content = table(f"{row}\n", header=f"{header}").decode().replace(";", delimiter)
        if '"' in delimiter:
            content = "\n".join(f'"{line}"' * (line != "") for line in content.split("\n"))
        content = above.format(delimiter.strip('"')) + content
        rows = read_table(content.encode(encoding), "t.csv").strict("t.csv")
        assert (rows.frame[0], rows.target[0]) == (17, 1)
        np.testing.assert_array_equal(rows.primary, [[1, 2]])
        np.testing.assert_array_equal(rows.secondary, [[3.25, 1204.5]])

    @pytest.mark.parametrize(
        ("row", "says"),
        [
            ("2,A,x,2,3,4", 'u_primary is "x"'),
            ("2,A,1,2,3,1;5", "v_secondary is"),
            ("2,A,1,nan,3,4", "v_primary is nan"),
            ("2,A,1,2,inf,4", "u_secondary is inf"),
            ("2,A,1,2,1e999,4", "u_secondary"),
            ("2,A,1,2,,4", "u_secondary"),
            ("2,A,1,2", "u_secondary"),
            (",A,1,2,3,4", "frame"),
            ("2.5,A,1,2,3,4", "frame is 2.5"),
            ("1e300,A,1,2,3,4", "frame is 1e300"),
            ("2,C,1,2,3,4", 'target is "C"'),
            ("2,,1,2,3,4", 'target is ""'),
            ("1,A,1,2,3,4", "frame 1 has target A already, in line 2"),
            ('2,A,"1,215",200,300,400', 'u_primary is "1,215"'),
            ("2,A,1,2,3,4,7.5", "7 cells instead of 6"),
        ],
    )
    def test_refused_rows(self, row: str, says: str) -> None:
        content = table(ROW, row, "3,B,1,2,3,4")
        read = read_table(content, "t.csv")
        ((line, reason),) = problems_of(content)
        assert line == 3
        assert says in reason
        np.testing.assert_array_equal(read.correspondences.frame, [1, 3])
        with refused("t.csv: 1 row ", "line 3: ", by=RefusedRowsError):
            read.strict("t.csv")
        mixed = table("1;A;100.5;200;300;400", "1;B;1,215;2;3;4", header=HEADER.replace(",", ";"))
        assert [line for line, _ in problems_of(mixed)] == [3]  # no decimal comma beside points

    def test_distances(self) -> None:
        keys = ("1,A", "1,B", "2,A", "2,B", "3,A", "3,B", "4,A", "5,A", "6,A")
        stated = (0.9, "", 0.5, 0.5, 0.5, 0.6, 0, -0.9, "nan")
        written = [f"{key},1,2,3,4,{own}" for key, own in zip(keys, stated, strict=True)]
        content = table(*written, header=f"{HEADER},distance_m")
        rows = read_table(content, "t.csv").correspondences
        np.testing.assert_array_equal(rows.distance_m, [0.9, np.nan, 0.5, 0.5, 0.5])
        lines, reasons = zip(*problems_of(content), strict=True)
        assert lines == (7, 8, 9, 10)
        assert "frame 3" in reasons[0]
        assert all("distance_m" in reason for reason in reasons[1:])

    finite = st.floats(allow_nan=False, allow_infinity=False)

    keys = st.tuples(st.integers(1 - 2**53, 2**53 - 1), st.sampled_from("AB"))

    @given(st.lists(keys, min_size=1, max_size=8, unique=True), st.data())
    @settings(max_examples=25)
    def test_there_and_back(self, keys: list[tuple[int, str]], data: st.DataObject) -> None:
        n = len(keys)
        places = npst.arrays(np.float64, (n, 2), elements=self.finite)
        known = st.none() | npst.arrays(np.float64, (n, 3), elements=self.finite | st.just(np.nan))
        sigma = st.floats(1e-6, 1e6) | st.just(np.nan)
        sigmas = st.none() | npst.arrays(np.float64, n, elements=sigma)
        word = st.sampled_from(["", "detected", "corrected", "manual"])
        sources = st.none() | st.lists(word, min_size=n, max_size=n)
        own = {frame: data.draw(st.just(np.nan) | st.floats(1e-3, 1e3)) for frame, _ in keys}
        frames, targets = zip(*keys, strict=True)
        points, distances = (data.draw(places), data.draw(places)), [own[each] for each in frames]
        rest: Any = map(data.draw, (known, sigmas, sigmas, sources))
        rows = Correspondences.from_arrays(frames, targets, *points, distances, *rest)
        back = read_table(write_table(rows), "t.csv").strict("t.csv")
        for field in fields(rows):
            if field.name != "line":
                np.testing.assert_array_equal(getattr(back, field.name), getattr(rows, field.name))


def with_times(times: str) -> bytes:
    first, *rows = TEMPLATE.splitlines()
    timed = [",".join(pair) for pair in zip(rows, times.split(), strict=True)]
    return "\n".join([f"{first},time_frame", *timed]).encode()


def test_times_are_read_and_written_back_and_are_the_frames_without_them() -> None:
    rows = read_table(with_times("7 7 12 12"), "t").strict("t")
    for each in (rows, read_table(write_table(rows), "t").strict("t")):
        assert each.time_frame.tolist() == [7, 7, 12, 12]
    rows = read_table(TEMPLATE.encode(), "t").strict("t")
    assert rows.time_frame.tolist() == rows.frame.tolist()
    assert b"time_frame" not in write_table(rows)


def test_a_shifted_data_set_is_written_as_recorded_and_has_the_same_digest() -> None:
    data = dataset(12)
    shifted = data.shifted(TimeOffset(0.01))
    assert shifted.sha256 == data.sha256
    assert write_table(shifted.correspondences) == write_table(data.correspondences)
    times = replace(data.correspondences, time_frame=data.correspondences.frame + 3)
    assert data.changed(correspondences=times).sha256 != data.sha256
    assert np.isnan(data.correspondences.motion).all()


def with_storage(suffix: str, **nodes: Any) -> bytes:
    """A file as OpenCV itself writes it."""
    storage = cv2.FileStorage(suffix, cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for name, value in nodes.items():
        storage.write(name, value)
    return str(storage.releaseAndGetString()).encode()


SUFFIXES = [".yaml", ".xml", ".json"]
NODES: Mapping[str, Any] = {
    "image_width": 1280,
    "image_height": 1024,
    "camera_matrix": np.array(SECONDARY.K),
    "distortion_coefficients": np.array(SECONDARY.distortion)[None],
}
OTHER_TOOL = b"""%YAML:1.0
camera_name: left.yaml
image_width: 1280
image_height: 1024
camera_matrix: !!opencv-matrix
  rows: 3
  cols: 3
  dt: d
  data: [1260.82, 0, 638.87, 0, 1259.69, 517.35, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients: !!opencv-matrix
  rows: 1
  cols: 5
  dt: d
  data: [-0.2253355, 0.2519776, 0.0005334135, -0.0004274737, -0.2372552]
extrinsics: {rows: 3, cols: 4, dt: d, data: [0.47, 0.57, -0.66, 2621.9, -0.49, 0.8, 0.34, -1151.4]}
"""


def equal(first: Camera, second: Camera) -> bool:
    return first.to_json() == second.to_json()


class TestCameraFile:
    def test_ours_there_and_back(self) -> None:
        known = LensUncertainty(0.5, 0.6, 0.7, 0.8, np.array([1e-3, 2e-3, 3e-5, 4e-5, 5e-3]))
        for camera in (fisheye(120.0), SECONDARY, replace(PRIMARY, uncertainty=known)):
            back = read_camera(write_camera(camera, {"method": "test"}), "c.json")
            assert equal(back, camera)
        assert back.uncertainty is not None and back.uncertainty.to_json() == known.to_json()

    def test_numbers_by_name(self) -> None:
        """A file as a person writes it."""
        (fx, _, cx), (_, fy, cy), _ = PRIMARY.K.tolist()
        names = ("k1", "k2", "p1", "p2", "k3")
        lens = dict(zip(names, PRIMARY.distortion.tolist(), strict=True))
        size = dict(zip(("width", "height"), PRIMARY.image_size, strict=True))
        content = {"fx": fx, "fy": fy, "cx": cx, "cy": cy, **lens, **size}
        assert equal(read_camera(json.dumps(content).encode(), "c.json"), PRIMARY)
        assert recognise("c.json", json.dumps(content).encode()).kind == "camera"
        bare = {"fx": fx, "fy": fy, "cx": cx, "cy": cy, **size}
        for own, values, model in (
            ({"k1": -0.3, "k2": 0.1, "k4": 0.2, "p1": 0.01}, [-0.3, 0.1, 0.01, 0, 0, 0.2, 0, 0], 0),
            ({"k1": -0.3}, [-0.3, 0, 0, 0, 0], 0),
            ({"k1": 0.1, "k2": 0.2, "k3": 0.3, "k4": 0.4}, [0.1, 0.2, 0.3, 0.4], 1),
        ):
            found = read_camera(json.dumps({**bare, **own}).encode(), "c.json")
            np.testing.assert_array_equal(found.distortion, values)
            assert found.is_fisheye == bool(model)

    def test_opencv_reads_what_is_written_for_it(self, tmp_path: Path) -> None:
        path = tmp_path / "camera.yml"
        path.write_bytes(write_opencv_camera(PRIMARY))
        assert path.read_bytes().startswith(b"%YAML:1.0")
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        np.testing.assert_array_equal(storage.getNode("camera_matrix").mat(), PRIMARY.K)
        distortion = np.ravel(storage.getNode("distortion_coefficients").mat())
        np.testing.assert_array_equal(distortion, PRIMARY.distortion)
        storage.release()
        for camera in (PRIMARY, fisheye(120.0)):
            assert equal(read_camera(write_opencv_camera(camera), "camera.yml"), camera)

    @pytest.mark.parametrize("suffix", SUFFIXES)
    @pytest.mark.parametrize(
        "names",
        [
            "camera_matrix distortion_coefficients image_width image_height",
            "K D width height",
            "cameraMatrix distCoeffs width height",
            "Camera_Matrix dist_coeffs width height",
        ],
    )
    def test_what_opencv_writes(self, suffix: str, names: str) -> None:
        """In a column, too."""
        K, D, width, height = names.split()
        lens = NODES["distortion_coefficients"]
        nodes = {K: NODES["camera_matrix"], D: lens.T.copy() if K == "K" else lens}
        content = with_storage(suffix, **nodes, **{width: 1280, height: 1024})
        assert equal(read_camera(content, "c", "brown"), SECONDARY)

    def test_nodes_of_other_tools_do_no_harm(self) -> None:
        read = read_camera(OTHER_TOOL, "primary.yaml")
        assert read.K[0, 0] == 1260.82
        assert read.distortion[4] == -0.2372552
        assert read.image_size == (1280, 1024)

    @pytest.mark.parametrize("number", ["1e-05", "1.e-5", "1E-5", "+1.0e-05", "0.00001", ".00001"])
    def test_small_numbers_as_programs_write_them(self, number: str) -> None:
        content = OTHER_TOOL.replace(b"0.0005334135", number.encode())
        assert read_camera(content, "c").distortion[2] == 1e-5


class TestDatasetFiles:
    files = pack_dataset(NOISY)

    def test_there_and_back(self) -> None:
        full = NOISY.changed(
            baseline_sigma_m=0.01, target_distance_sigma_m=2e-3, notes="windy", name="Ä b"
        )
        back = parse_recording(pack_dataset(full), "x").pair(*CAMERAS)
        assert back.sha256 == NOISY.sha256
        lengths = ("baseline_m", "target_distance_m", "baseline_sigma_m", "target_distance_sigma_m")
        for name in ("name", "notes", *lengths):
            assert getattr(back, name) == getattr(full, name)

    @pytest.mark.parametrize("inside", ["", "survey/", "a/b/c/"])
    def test_zip_and_folder_with_the_same_digest(self, tmp_path: Path, inside: str) -> None:
        files = {inside + name: content for name, content in self.files.items()}
        (tmp_path / "survey.zip").write_bytes(zipped(files))
        assert read_dataset(tmp_path / "survey.zip").sha256 == NOISY.sha256
        if inside != "a/b/c/":  # of a folder, direct subfolders are read
            write({**self.files, "notes.txt": b"\xff"}, tmp_path / "folder" / inside)
            assert read_dataset(tmp_path / "folder").sha256 == NOISY.sha256

    @pytest.mark.parametrize("packed", [False, True])
    def test_photographs_and_no_table_yet(self, tmp_path: Path, packed: bool) -> None:
        files = {k: v for k, v in self.files.items() if k != "correspondences.csv"}
        files |= {f"{camera}/1.png": b"x" for camera in ("primary", "secondary")}
        source = tmp_path / "survey"
        write({"survey": zipped(files)} if packed else files, tmp_path if packed else source)
        with refused(str(source), "correspondences.csv", "detect"):
            read_dataset(source)
        known, whole = read_recording(source, with_points=False), NOISY.recording
        assert (known.name, known.baselines_m) == (whole.name, whole.baselines_m)
        assert all(equal(known.cameras[which], camera) for which, camera in whole.cameras.items())
        assert (known.object.points == whole.object.points).all()


def test_a_bomb_is_not_unpacked_and_a_size_that_lies_does_not_swell() -> None:
    """The directory says 10 bytes, the stream has 40 million: damaged, or cut to 10."""
    bomb = zipped({"a.csv": bytes(40_000_000)})
    assert len(bomb) < 100_000
    with refused("40000000", "STEREOCAL_MOST_RATIO"):
        unzip(bomb, "z")
    lie = bomb.replace((40_000_000).to_bytes(4, "little"), (10).to_bytes(4, "little"))
    assert lie != bomb
    with suppress(StereocalError):
        assert len(unzip(lie, "z")["a.csv"]) <= 10
