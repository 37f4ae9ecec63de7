"""Files whose numbers can mean two things: what is asked, what is refused, what is read then."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from stereocal.cli import main
from stereocal.errors import RefusedRowsError
from stereocal.formats.camera_file import FourCoefficientsError, read_camera
from stereocal.formats.correspondences_csv import read_table
from stereocal.formats.dataset_files import pack_dataset
from stereocal.formats.exchange.exchange import FORMATS, export_files, import_files
from stereocal.formats.exchange.options import UNITS, ExchangeOptions, Unit
from stereocal.formats.inputs import read_input
from stereocal.formats.world_file import read_observed
from stereocal.matching.point_table import PointTable
from stereocal.rig.camera import CAMERAS, LensModel
from stereocal.rig.correspondences import PIXELS
from stereocal.rig.geometry import Pose
from tests.files import write
from tests.formats.test_exchange import PLAIN, RICHEST, SIZES
from tests.formats.test_formats import NODES, with_storage
from tests.refused import refused
from tests.rigs.known_rig import BASELINE_M, PRIMARY, RIG, SECONDARY, dataset

UNSTATED = ("opencv", "matlab", "aniposelib", "colmap")
"""Formats whose files may be in any unit."""
FOUR = SECONDARY.distortion
"""k1 k2 p1 p2, all different."""


def in_unit(name: str, unit: Unit, said: str = "") -> dict[str, bytes]:
    """Files as another program writes them: lengths in this unit, and no word of ours about it."""
    rig, ours = RICHEST[name], b", 'WorldUnits', 'm'"
    scaled = replace(rig, pose=Pose(rig.pose.R, rig.pose.T / UNITS[unit]))
    return {
        file: content.replace(b"lengths in metres", b"").replace(ours, said.encode())
        for file, content in export_files(scaled, name).items()
    }


class TestUnits:
    @pytest.mark.parametrize("unit", UNITS)
    @pytest.mark.parametrize("name", UNSTATED)
    def test_a_file_that_does_not_say_it_needs_an_answer(self, name: str, unit: Unit) -> None:
        files = in_unit(name, unit)
        with refused("unit", f"{unit} ({BASELINE_M:g} m)"):
            import_files(files, name)
        read = import_files(files, name, ExchangeOptions(unit=unit))
        # Measured: T exact, R 7e-16.
        np.testing.assert_allclose(read.pose.T, RIG.T, rtol=0, atol=1e-12)
        np.testing.assert_allclose(read.pose.R, RIG.R, rtol=0, atol=1e-12)

    @pytest.mark.parametrize("name", FORMATS)
    def test_our_own_files_say_it(self, name: str) -> None:
        files = export_files(RICHEST[name], name)
        for unit in (None, "m"):
            read = import_files(files, name, replace(SIZES, unit=unit))
            np.testing.assert_allclose(read.pose.T, RIG.T, rtol=0, atol=1e-9)
        with refused("unit", " m,", "mm"):
            import_files(files, name, replace(SIZES, unit="mm"))

    @pytest.mark.parametrize("name", ["kalibr", "ros"])
    def test_formats_in_metres_by_custom(self, name: str) -> None:
        read = import_files(in_unit(name, "m"), name)
        np.testing.assert_allclose(read.pose.T, RIG.T, rtol=0, atol=1e-9)
        for unit in ("cm", "mm"):
            with refused("unit", f"{unit} (2.37 m)"):
                import_files(in_unit(name, unit), name)
            read = import_files(in_unit(name, unit), name, ExchangeOptions(unit=unit))
            np.testing.assert_allclose(read.pose.T, RIG.T, rtol=0, atol=1e-9)

    @pytest.mark.parametrize(
        "said", ["mm", "millimeters", "Millimetres", "centimeters", "m", "inches", "in"]
    )
    def test_matlabs_world_units(self, said: str) -> None:
        units: dict[str, Unit] = {"mm": "mm", "mi": "mm", "ce": "cm", "m": "m", "in": "inch"}
        files = in_unit("matlab", units[said[:2].lower()], f", 'WorldUnits', '{said}'")
        read = import_files(files, "matlab")
        np.testing.assert_allclose(read.pose.T, RIG.T, rtol=0, atol=1e-12)


def opencv_camera(lens: Any, **more: Any) -> bytes:
    return with_storage(".yml", **{**NODES, "distortion_coefficients": np.array([lens]), **more})


def four(name: str) -> dict[str, bytes]:
    """A rig with four coefficients, and no word of what they are."""
    files = export_files(PLAIN, name)
    if name != "opencv":
        fifth = re.compile(rb"distortion_model: plumb_bob\n|, 0.0(?=\]\n(rectification|rotation))")
        return {file: fifth.sub(b"", content) for file, content in files.items()}
    five = files["intrinsics.yml"]
    for k in (b"D1:", b"D2:"):
        head, tail = five.split(k)
        tail = tail.replace(b"cols: 5", b"cols: 4", 1).replace(b", 0.0 ]", b" ]", 1)
        five = head + k + tail
    return {**files, "intrinsics.yml": five}


class TestFourCoefficients:
    def test_a_camera_file(self) -> None:
        content = opencv_camera(FOUR)
        with pytest.raises(FourCoefficientsError):  # the model of a camera is not that of its lens
            read_camera(opencv_camera(FOUR, model=9), "c.yml")
        with refused("c.yml", "k1 k2 p1 p2", "k1 k2 k3 k4", by=FourCoefficientsError):
            read_camera(content, "c.yml")
        np.testing.assert_array_equal(read_camera(content, "c.yml", "brown").distortion, FOUR)
        assert read_camera(content, "c.yml", "brown").model == "brown"
        assert read_camera(content, "c.yml", "fisheye").model == "fisheye"

    @pytest.mark.parametrize(
        ("stated", "model"),
        [
            ({"distortion_model": "plumb_bob"}, "brown"),
            ({"fisheye_model": 0}, "brown"),
            ({"distortion_model": "equidistant"}, "fisheye"),
            ({"fisheye_model": 1}, "fisheye"),
        ],
    )
    def test_a_file_that_says_it(self, stated: dict[str, Any], model: str) -> None:
        """Whatever a person says of a fisheye that names its model."""
        givens: tuple[LensModel | None, ...] = (None, "brown") if model == "fisheye" else (None,)
        for given in givens:
            read = read_camera(opencv_camera(FOUR, **stated), "c.yml", given)
            assert read.model == model
            np.testing.assert_array_equal(read.distortion, FOUR)

    @pytest.mark.parametrize("name", ["opencv", "ros", "aniposelib"])
    def test_parameters(self, name: str) -> None:
        files = four(name)
        with pytest.raises(FourCoefficientsError):
            import_files(files, name)
        read = import_files(files, name, ExchangeOptions(lens_model="brown"))
        np.testing.assert_array_equal(read.secondary.distortion, FOUR)
        read = import_files(files, name, ExchangeOptions(lens_model="fisheye"))
        assert read.primary.model == read.secondary.model == "fisheye"

    def test_a_data_set_on_the_command_line(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        sound = dataset(8)
        files = pack_dataset(sound)
        description = json.loads(files["dataset.json"])
        description["cameras"]["secondary"] = "right.yml"
        files |= {
            "dataset.json": json.dumps(description).encode(),
            "right.yml": opencv_camera(FOUR),
        }
        write(files, tmp_path)
        for command in ("calibrate", "evaluate", "detect"):
            assert main([command, str(tmp_path), "--out", str(tmp_path / "out")]) == 2
            printed = capsys.readouterr().err
            assert "right.yml" in printed and "--lens-model" in printed
        assert read_input(tmp_path, "brown").pair(*CAMERAS).sha256 == sound.sha256


SEQUENCES = (
    "M1: [[1480.3, 0, 811.4], [0, 1502.7, 577.2], [0, 0, 1]]\n"
    "M2: [1190.6, 2.3, 612.8, 0, 1171.9, 530.1, 0, 0, 1]\n"
    "D1: [-0.21, 0.17, 0.0009, -0.0013, -0.06]\nD2:\n  - 0.08\n  - -0.11\n  - -0.0007\n"
    "  - 0.0016\n  - 0\nimage_size_1: [1600, 1200]\nimage_size_2: [1280, 1024]\n"
)


class TestPlainNumbers:
    @pytest.mark.parametrize("head", ["%YAML:1.0\n---\n", "%YAML 1.2\n---\n", ""])
    @pytest.mark.parametrize("column", [False, True])
    def test_sequences_in_opencvs_yaml(self, head: str, column: bool) -> None:
        T: Any = [[value] for value in RIG.T.tolist()] if column else RIG.T.tolist()
        text = f"{head}{SEQUENCES}R: {RIG.R.tolist()}\nT: {T}\n"
        read = import_files({"s.yml": text.encode()}, "opencv", ExchangeOptions(unit="m"))
        np.testing.assert_array_equal(read.pose.T, RIG.T)
        np.testing.assert_array_equal(read.pose.R, RIG.R)
        np.testing.assert_array_equal(read.primary.K, PRIMARY.K)
        np.testing.assert_array_equal(read.secondary.K, SECONDARY.K)
        np.testing.assert_array_equal(read.secondary.distortion, [*FOUR, 0])

    @pytest.mark.parametrize(
        "names",
        [("K", "distortion"), ("camera_matrix", "distortion_coefficients"), ("K", "dist_coeffs")],
    )
    @pytest.mark.parametrize(
        "size",
        [
            {"image_size": [1600, 1200]},
            {"image_width": 1600, "image_height": 1200},
            {"imageWidth": 1600, "imageHeight": 1200},
            {"cameraResolution": [1600, 1200]},
            {"Image_Size": "1600x1200"},
            {"resolution": {"width": 1600, "height": 1200}},
            {"img_size": [1600.0, 1200.0]},
        ],
    )
    def test_a_camera_as_nested_lists(self, names: tuple[str, str], size: dict[str, Any]) -> None:
        """As the line of MATLAB writes it that a message gives, too."""
        lens = dict(zip(names, (PRIMARY.K.tolist(), PRIMARY.distortion.tolist()), strict=True))
        read = read_camera(json.dumps({**lens, **size}).encode(), "c.json")
        assert read.to_json() == PRIMARY.to_json()


@pytest.mark.parametrize("suffix", ["bars", ".csv", ".parquet"])
@pytest.mark.parametrize("beyond", [2**53 + 1, -(2**53) - 1, 2**63 - 1, 2**63])
def test_a_frame_beyond_what_a_float_holds(beyond: int, suffix: str, tmp_path: Path) -> None:
    """2^53 + 1 was read as 2^53. The largest one that is read is 2^63 - 1."""
    path = tmp_path / f"points{suffix}"
    frames = [2**53 - 1, beyond] if beyond > 0 else [beyond, 1 - 2**53]
    table = pd.DataFrame({"frame": frames, "target": "A"} | dict.fromkeys(PIXELS, 100.5))
    content = table.to_csv(index=False).encode()
    if suffix == ".parquet":
        table.to_parquet(path)
    else:
        path.write_bytes(content)

    def read() -> list[int]:
        if suffix == "bars":
            return [*map(int, read_table(content, "t.csv").strict("t.csv").frame)]
        return [*map(int, PointTable(path, PIXELS).check().frames)]

    if beyond < 2**63:
        assert read() == frames
        return
    with refused(f"frame is {beyond}", by=RefusedRowsError) as error:
        read()
    with refused("frame is 9007199254740992", by=RefusedRowsError):  # of which one at a rate
        read_observed(content.replace(str(frames[0]).encode(), b"%d" % 2**53), "t.csv", 50.0)
    row_of = 2 if suffix == ".parquet" else 3  # without a line that names the columns
    assert isinstance(error.value, RefusedRowsError)
    assert [problem.line for problem in error.value.problems] == [row_of]
