"""Camera files of many programs, from one asymmetric truth: lenses, sizes, pose, and refusals."""

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stereocal.cli import main
from stereocal.formats.archives.archive import Archive
from stereocal.formats.archives.gather import gather
from stereocal.formats.camera_file import ImageSizeError, read_camera
from stereocal.formats.described import PROGRAMS
from stereocal.formats.exchange.exchange import import_files
from stereocal.formats.exchange.options import ExchangeOptions, UnitError
from stereocal.formats.recognition import recognise
from stereocal.rig.parameters import RigParameters
from tests.archives import CASES, case
from tests.refused import refused

K1 = [[1500.0, 0.0, 965.0], [0.0, 1502.0, 531.0], [0.0, 0.0, 1.0]]
K2 = [[1510.0, 0.0, 952.0], [0.0, 1508.0, 548.0], [0.0, 0.0, 1.0]]
D1, D2 = [-0.11, 0.08, 0.0006, -0.0004, -0.01], [-0.09, 0.06, -0.0005, 0.0007, -0.005]
TURN = [0.02, -0.22, 0.015]
R = Rotation.from_rotvec(TURN).as_matrix()
BASELINE_M = 1.2176
T = -BASELINE_M * R @ np.array([1.2, 0.05, 0.2]) / np.linalg.norm([1.2, 0.05, 0.2])
SIZE = (1920, 1080)
POSE = {"R": R.tolist(), "T": T.tolist(), "unit": "m"}
SIZED = {"image_size": [*SIZE]}
BOTH = {**POSE, **SIZED}


def check(found: Archive, exact_lens: bool = True) -> None:
    """The lenses of the truth, of which some files have four coefficients only."""
    for camera, K, lens in ((found.primary, K1, D1), (found.secondary, K2, D2)):
        assert camera is not None and camera.image_size == SIZE and not camera.is_fisheye
        np.testing.assert_allclose(camera.K, K, rtol=0, atol=1e-9)
        known = lens[: len(camera.distortion)] if not exact_lens else lens
        np.testing.assert_allclose(camera.distortion[:5], known, rtol=0, atol=1e-12)
        assert not camera.distortion[5:].any()


def gathered(files: Mapping[str, bytes], known: bool = False, **said: Any) -> Archive:
    return gather(files, ExchangeOptions(**said), baseline_known=known)


def as_json(tree: object) -> dict[str, bytes]:
    return {"a.json": json.dumps(tree).encode()}


class TestCases:
    @pytest.mark.parametrize(
        ("program", "files"),
        [
            ("oak", case("oak_json", "calib.json")),
            ("viame", case("viame_json", "camera_rig.json")),
            ("orbslam3", case("orbslam3_yaml", "rig.yaml")),
            ("euroc", case("slam_yaml", "cam0.yaml", "cam1.yaml")),
            ("mrcal", case("other_lenses", "left.cameramodel", "right.cameramodel")),
            ("kitti", case("text_camera_files", "calib_cam_to_cam.txt")),
            ("openlpt", case("text_camera_files", "cam1.txt", "cam2.txt")),
        ],
    )
    def test_lenses_and_pose(self, program: str, files: dict[str, bytes]) -> None:
        found = gathered(files)
        check(found, exact_lens=program != "euroc")
        assert found.baseline_m == pytest.approx(BASELINE_M, abs=2e-6)  # seven digits in KITTI's
        pose = import_files(files, program).pose
        np.testing.assert_allclose(pose.R, R, rtol=0, atol=2e-6)
        np.testing.assert_allclose(pose.T, T, rtol=0, atol=2e-6)
        assert all(recognise(name, files[name]).kind in ("camera", "cameras") for name in files)

    @pytest.mark.parametrize(
        ("files", "size"),
        [
            (case("zed_conf", "SN0000.conf"), None),
            (case("text_camera_files", "results-cam.txt"), SIZE),
        ],
    )
    def test_lenses_alone(self, files: dict[str, bytes], size: tuple[int, int] | None) -> None:
        found = gathered(files, image_sizes=(size, size))
        check(found, exact_lens=size is None)
        assert found.baseline_m is None and found.no_baseline

    def test_rectified_images(self) -> None:
        files = case("text_camera_files", "calib.txt")
        with refused("calib.txt", by=ImageSizeError):
            gathered(files)
        found = gathered(files, image_sizes=(SIZE, SIZE))
        assert found.baseline_m == pytest.approx(1.2176, abs=1e-4)
        assert found.primary is not None and not found.primary.distortion.any()
        assert any("rectified" in remark for remark in found.remarks)

    @pytest.mark.parametrize("name", ["b.json", "stereo.npz"])
    def test_of_scripts(self, name: str) -> None:
        found = gathered(case("nested_json", name), unit="m", image_sizes=(SIZE, SIZE))
        check(found)
        assert found.baseline_m == pytest.approx(BASELINE_M, abs=1e-9)

    @pytest.mark.parametrize("name", ["inches.yml", "feet.yml"])
    def test_unit_of_the_file(self, name: str, tmp_path: Path) -> None:
        out = str(tmp_path / "p.json")
        given = str(CASES / "unit_key" / name)
        assert main(["convert", "--from", "opencv", given, "--out", out]) == 0
        assert RigParameters.load(out).pose.baseline == pytest.approx(1.2176, abs=1e-9)

    def test_beside_a_table(self, tmp_path: Path) -> None:
        """Text files of cameras are no tables."""
        folder = CASES / "text_camera_files"
        table = str(folder / "bars.csv")
        for files in (["cam1.txt", "cam2.txt"], ["calib_cam_to_cam.txt"], ["results-cam.txt"]):
            out = tmp_path / files[0]
            words = ["--baseline", "1.2176", "--distance", "0.5", "--image-size", "1920x1080"]
            given = [str(folder / name) for name in files]
            assert main(["import", table, *given, *words, "--out", str(out)]) == 0
            lens = read_camera((out / "secondary.json").read_bytes())
            np.testing.assert_allclose(lens.K, K2, rtol=0, atol=1e-9)

    def test_folder_of_convert(self, tmp_path: Path) -> None:
        """EuRoC's file of each camera lies in a folder of its own, as sensor.yaml."""
        for k in (0, 1):
            folder = tmp_path / "rig" / f"cam{k}"
            folder.mkdir(parents=True)
            (folder / "sensor.yaml").write_bytes(case("slam_yaml", f"cam{k}.yaml")[f"cam{k}.yaml"])
        out = tmp_path / "p.json"
        for words, first in ((), 1500), (("--cameras", "cam1/sensor,cam0/sensor"), 1510):
            given = ["convert", str(tmp_path / "rig"), "--from", "euroc", "--out", str(out), *words]
            assert main(given) == 0
            read = RigParameters.load(out)
            assert read.primary.K[0, 0] == first
            assert read.pose.baseline == pytest.approx(BASELINE_M, abs=1e-9)
            out.unlink()


def metashape(K: list[list[float]], D: list[float], **more: float) -> bytes:
    """u = w/2 + cx + f x' + b1 x', where the first centre is (0.5, 0.5); P1 is OpenCV's p2."""
    k1, k2, p1, p2, k3 = D
    values = {
        **{"width": SIZE[0], "height": SIZE[1], "f": K[1][1], "b1": K[0][0] - K[1][1]},
        **{"cx": K[0][2] + 0.5 - SIZE[0] / 2, "cy": K[1][2] + 0.5 - SIZE[1] / 2},
        **{"k1": k1, "k2": k2, "k3": k3, "p1": p2, "p2": p1, **more},
    }
    tags = "".join(f"  <{name}>{value}</{name}>\n" for name, value in values.items())
    return f"<calibration>\n  <projection>frame</projection>\n{tags}</calibration>\n".encode()


def calib_io(K: list[list[float]], D: list[float], turn: Any, shift: Any) -> dict[str, Any]:
    values = dict(zip(("k1", "k2", "p1", "p2", "k3"), D, strict=True))
    values |= dict.fromkeys(("k4", "k5", "k6", "s1", "s2", "s3", "s4", "tauX", "tauY"), 0.0)
    values |= {"f": K[0][0], "ar": K[1][1] / K[0][0], "cx": K[0][2], "cy": K[1][2]}
    data = {
        "CameraModelCRT": {"CameraModelBase": {"imageSize": {"width": SIZE[0], "height": SIZE[1]}}},
        "parameters": {name: {"val": value, "state": 1} for name, value in values.items()},
    }
    moved = {
        "rotation": dict(zip(("rx", "ry", "rz"), turn, strict=True)),
        "translation": dict(zip("xyz", shift, strict=True)),
    }
    return {"model": {"polymorphic_id": 1, "ptr_wrapper": {"data": data}}, "transform": moved}


def opensfm(K: list[list[float]], D: list[float]) -> dict[str, Any]:
    """c_x = (u + 0.5 - w/2) / max(w, h)."""
    return {
        **{"projection_type": "brown", "width": SIZE[0], "height": SIZE[1]},
        **{"focal_x": K[0][0] / SIZE[0], "focal_y": K[1][1] / SIZE[0]},
        **{"c_x": (K[0][2] + 0.5 - 960) / 1920, "c_y": (K[1][2] + 0.5 - 540) / 1920},
        **dict(zip(("k1", "k2", "p1", "p2", "k3"), D, strict=True)),
    }


ZERO = [0.0, 0.0, 0.0]
SENSOR = (
    '<sensor id="{k}" label="{name}" type="frame"><calibration type="frame" class="initial">'
    '<f>1</f></calibration><calibration type="frame" class="adjusted"><resolution width="1920" '
    'height="1080"/>{tags}</calibration></sensor>'
)


def zed(*modes: tuple[str, float]) -> dict[str, bytes]:
    """The newer kind, whose lenses have a section of their own."""
    text = ""
    for side, K, D in (("LEFT", K1, D1), ("RIGHT", K2, D2)):
        for mode, scale in modes:
            focal = zip(("fx", "fy", "cx", "cy"), (K[0][0], K[1][1], K[0][2], K[1][2]), strict=True)
            text += f"[{side}_CAM_{mode}]\n" + "".join(f"{k}={v * scale}\n" for k, v in focal)
        lens = zip(("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"), [*D, 0, 0, 0], strict=True)
        text += f"[{side}_DISTO]\n" + "".join(f"{name} = {value}\n" for name, value in lens)
    return {"SN1.conf": f"{text}[STEREO]\nBaseline=119.9\n".encode()}


class TestPrograms:
    def test_metashape(self) -> None:
        """Whose files of a project have a sensor for each camera."""
        two = metashape(K1, D1), metashape(K2, D2)
        check(gathered({"l.xml": two[0], "r.xml": two[1]}, known=True))
        check_tags = [content.decode().split("frame</projection>")[1][:-16] for content in two]
        sensors = "".join(
            SENSOR.format(k=k, name=name, tags=tags)
            for k, (name, tags) in enumerate(zip(("GoPro L", "GoPro R"), check_tags, strict=True))
        )
        document = f"<document><chunk><sensors next_id='2'>{sensors}</sensors></chunk></document>"
        found = gathered({"cameras.xml": document.encode()}, known=True)
        check(found)
        assert "GoPro L and GoPro R" in found.notes[0]
        for name in ("k4", "p3"):
            with refused("l.xml", "Metashape", "k4", "p3"):
                gathered({"l.xml": metashape(K1, D1, **{name: 0.1})})
        fisheye = two[0].replace(b">frame<", b">fisheye<")
        with refused("l.xml", "fisheye", "OpenCV"):
            gathered({"l.xml": fisheye})

    def test_calib_io(self) -> None:
        both = [calib_io(K1, D1, ZERO, ZERO), calib_io(K2, D2, TURN, T)]
        files = as_json({"Calibration": {"cameras": both}})
        check(gathered(files))
        pose = import_files(files, "calibio").pose
        np.testing.assert_allclose(pose.T, T, rtol=0, atol=1e-12)
        np.testing.assert_allclose(pose.R, R, rtol=0, atol=1e-12)

    def test_opensfm(self) -> None:
        files = as_json({"v2 left brown": opensfm(K1, D1), "v2 right brown": opensfm(K2, D2)})
        check(gathered(files, known=True))
        one = opensfm(K1, [0.1, 0.01, 0.0, 0.0, 0.0]) | {"projection_type": "fisheye"}
        camera = read_camera(as_json({"v2": one})["a.json"], "a.json")
        assert camera.is_fisheye and [*camera.distortion] == [0.1, 0.01, 0, 0]
        with refused("a.json", "OpenSfM", "spherical"):
            gathered(as_json({"v2": {**one, "projection_type": "spherical"}}))

    def test_zed_of_several_sizes(self) -> None:
        files = zed(("2K", 1.1), ("FHD", 1.0), ("VGA", 0.35))
        check(gathered(files, known=True, image_sizes=(SIZE, SIZE)))
        for said in dict[str, Any](), {"image_sizes": ((640, 480),) * 2}:
            with refused("SN1.conf", "2208x1242", "1920x1080", "672x376", by=ImageSizeError):
                gathered(files, **said)
        check(gathered(zed(("FHD", 1.0)), known=True))

    def test_orbslam3_of_before(self) -> None:
        """`LEFT.K` has no pose, and Kannala and Brandt's lens is a fisheye."""
        text = "%YAML:1.0\n"
        for side, K, D in (("LEFT", K1, D1), ("RIGHT", K2, D2)):
            text += f"{side}.width: 1920\n{side}.height: 1080\n{side}.K: {np.ravel(K).tolist()}\n"
            text += f"{side}.D: {D}\n{side}.R: {np.eye(3).ravel().tolist()}\n"
        found = gathered({"s.yaml": text.encode()}, known=True)
        check(found)
        assert "Stereo.T_c1_c2" in found.no_baseline
        (content,) = case("orbslam3_yaml", "rig.yaml").values()
        fisheye = content.replace(b'"PinHole"', b'"KannalaBrandt8"')
        for k in (b"1", b"2"):
            for old, new in ((b".p1", b".k3"), (b".p2", b".k4"), (b".k3: -", b".k9: -")):
                fisheye = fisheye.replace(b"Camera" + k + old, b"Camera" + k + new, 1)
        fisheye = b"\n".join(line for line in fisheye.splitlines() if b".k9" not in line)
        read = import_files({"rig.yaml": fisheye}, "orbslam3")
        assert read.primary.is_fisheye and [*read.primary.distortion[:2]] == D1[:2]

    def test_oak_of_three(self) -> None:
        """Left and right are taken, and a pose is a chain over the sockets between."""
        (content,) = case("oak_json", "calib.json").values()
        tree = json.loads(content)
        (_, left), (_, right) = tree["cameraData"]
        third = {**left, "extrinsics": {**left["extrinsics"], "toCameraSocket": 1}}
        third["extrinsics"] |= {"translation": {"x": 5.0, "y": 1.0, "z": 2.0}}
        tree["cameraData"] = [[0, third], [1, left], [2, right], [3, {**left, "width": 0}]]
        nested = as_json({"eepromData": tree})
        found = gathered(nested)
        check(found)
        assert "3 cameras (left, right, rgb)" in found.remarks[0]
        pose = import_files(nested, "oak", ExchangeOptions(cameras=("rgb", "right"))).pose
        np.testing.assert_allclose(pose.R, R @ R, rtol=0, atol=1e-9)
        np.testing.assert_allclose(pose.T, R @ [0.05, 0.01, 0.02] + T, rtol=0, atol=1e-9)
        left["extrinsics"]["toCameraSocket"] = 0
        with refused("a.json", "circle"):
            import_files(as_json(tree), "oak", ExchangeOptions(cameras=("rgb", "right")))

    @pytest.mark.parametrize(
        ("name", "content", "said"),
        [
            ("a.xcp", b'<Cameras><Camera TYPE="x" DEVICEID="1"/></Cameras>', ("Vicon", '"K"')),
            (
                "a.cameramodel",
                b"{'lensmodel': 'LENSMODEL_SPLINED_STEREOGRAPHIC_order=3', 'intrinsics': [1]}",
                ("mrcal", "SPLINED", "mrcal-convert-lensmodel"),
            ),
            ("cam1.txt", b"# Camera Model: (P/P)\nPOLYNOMIAL\n", ("OpenLPT", "POLYNOMIAL")),
            ("s.conf", b"[LEFT_CAM_HD]\nfx=1\nfy=1\ncx=2\n", ("ZED", "cy")),
            ("a.json", b'{"cameraData": [[1, 2, 3]]}', ("OAK",)),
            ("a.yaml", b"T_BS: 1\ncamera_model: omni\n", ("omni", "pinhole")),
        ],
    )
    def test_what_is_not_read_is_named(self, name: str, content: bytes, said: Any) -> None:
        for read in (lambda: gathered({name: content}), lambda: read_camera(content, name)):
            with refused(name, *said):
                read()

    def test_a_file_of_two_is_none_of_one(self) -> None:
        for files in (case("oak_json", "calib.json"), case("nested_json", "b.json")):
            ((name, content),) = files.items()
            with refused(name, "2 (left, right)"):
                read_camera(content, name)

    def test_every_program_has_what_its_row_needs(self) -> None:
        for program in PROGRAMS.values():
            assert program.pose or program.no_pose or "not read" in program.note


def pair(k1: str, d1: str, k2: str, d2: str, **more: object) -> dict[str, bytes]:
    return as_json({k1: K1, d1: D1, k2: K2, d2: D2, **POSE, **SIZED, **more})


class TestNames:
    @pytest.mark.parametrize(
        "files",
        [
            pair("Kl", "Dl", "Kr", "Dr"),
            pair("M_l", "D_l", "M_r", "D_r"),
            pair("CM1", "dist1", "CM2", "dist2"),
            pair("mtxL", "distL", "mtxR", "distR"),
            pair("A1", "k1", "A2", "k2"),
            pair("K_left", "kc_left", "K_right", "kc_right"),
            pair("cameraMatrix1", "distCoeffs1", "CAMERA_MATRIX_2", "dist-coeffs-2"),
            pair("camera_left_matrix", "left_dist", "camera_right_matrix", "right_dist"),
            pair("K0", "D0", "K1", "D1"),
            pair("cam0_K", "cam0_D", "cam1_K", "cam1_D"),
            pair("StereoRectifier.K_left", "LEFT.D", "RIGHT.K", "RIGHT.D"),
            as_json({"right": {"K": K2, "D": D2}, "left": {"K": K1, "D": D1}, **POSE, **SIZED}),
            as_json({"a1": {"mtx": K1, "dist": [D1]}, "b1": {"mtx": K2, "dist": [D2]}, **BOTH}),
            as_json({"K": {"left": K1, "right": K2}, "D": {"left": D1, "right": D2}, **BOTH}),
            as_json(
                {
                    "cameras": [
                        {"name": "a", "matrix": K1, "distortions": D1, "size": SIZE},
                        {"name": "b", "matrix": K2, "distortions": D2, "size": SIZE},
                    ],
                    "extrinsics": POSE,
                }
            ),
            as_json([{"K": K1, "D": D1, **SIZED}, {"K": K2, "D": D2, **SIZED, **{"unit": "m"}}]),
        ],
    )  # fmt: skip
    def test_of_both_sides(self, files: dict[str, bytes]) -> None:
        found = gathered(files)
        check(found)
        listed = files["a.json"].startswith(b"[")
        assert found.baseline_m == (None if listed else pytest.approx(BASELINE_M, abs=1e-9))

    @pytest.mark.parametrize("turn", [TURN, [[x] for x in TURN], [TURN]])
    @pytest.mark.parametrize("name", ["R", "om", "rvec", "Rot"])
    def test_rotation_vectors(self, name: str, turn: object) -> None:
        tree = {"K1": K1, "D1": D1, "K2": K2, "D2": D2, name: turn, "T": T.tolist(), **SIZED}
        pose = import_files(as_json(tree), "opencv", ExchangeOptions(unit="m")).pose
        np.testing.assert_allclose(pose.R, R, rtol=0, atol=1e-12)
        degrees = {**tree, name: np.degrees(TURN).tolist()}
        with refused("12.68", "rad"):
            import_files(as_json(degrees), "opencv", ExchangeOptions(unit="m"))

    def test_three_counted_from_zero(self) -> None:
        tree = {"K0": K1, "D0": D1, "K1": K2, "D1": D2, "K2": K1, "D2": D2}
        files = as_json({**tree, **BOTH})
        found = gathered(files, known=True)
        check(found)
        assert "3 cameras (0, 1, 2)" in found.remarks[0]
        with refused("3 (0, 1, 2)"):
            import_files(files, "opencv")
        chosen = gathered(files, known=True, cameras=("cam0", "cam2"))
        assert chosen.secondary is not None and [*chosen.secondary.distortion] == D2
        assert chosen.baseline_m is None and "which two cameras" in chosen.no_baseline

    def test_the_pose_is_of_the_order_chosen(self) -> None:
        files = case("nested_json", "b.json")
        turned = import_files(files, "opencv", ExchangeOptions(unit="m", cameras=("right", "left")))
        np.testing.assert_allclose(turned.pose.inverse().T, T, rtol=0, atol=1e-12)
        assert turned.primary.K[0, 0] == 1510

    def test_several_sizes_are_not_mixed(self) -> None:
        two = {"left": {"K": K1, "D": D1}, "right": {"K": K2, "D": D2}}
        found = gathered(as_json({"hd": two, "vga": two, **SIZED}), known=True)
        assert "4 cameras (hd.left, hd.right, vga.left, vga.right)" in found.remarks[0]

    def test_a_pose_that_is_not_needed(self) -> None:
        lenses = {"K1": K1, "D1": D1, "K2": K2, "D2": D2, **SIZED}
        for pose in (
            {"R": [[1, 2, 3]] * 3, "T": [1, 0, 0]},
            {"R": "x", "T": 1},
            {"R": np.eye(3).tolist()},
        ):
            found = gathered(as_json({**lenses, **pose}), known=True)
            check(found)
            assert found.remarks or "T missing" in found.no_baseline
            with refused("R" if "T" in pose else "T missing"):
                import_files(as_json({**lenses, **pose}), "opencv")

    @pytest.mark.parametrize(
        ("unit", "scale"),
        [
            ("in", 0.0254),
            ("Inches", 0.0254),
            ("ft", 0.3048),
            ("foot", 0.3048),
            ("mm", 1e-3),
            ("Meters", 1.0),
        ],
    )
    @pytest.mark.parametrize("key", ["unit", "units", "length_unit", "lengthUnit"])
    def test_units(self, key: str, unit: str, scale: float) -> None:
        tree = {"left": {"K": K1, "D": D1}, "right": {"K": K2, "D": D2}, **SIZED, key: unit}
        moved = {"R": R.tolist(), "T": (T / scale).tolist()}
        assert gathered(as_json({**tree, **moved})).baseline_m == pytest.approx(BASELINE_M)
        with refused("feet (", by=UnitError):
            gathered(as_json({**tree, **moved, "T": (T / 0.3048).tolist(), key: "px"}))

    @pytest.mark.parametrize(
        ("name", "content"),
        [
            ("a.json", b'{"CM9x": [1], "Rot": 2, "foo": {"bar": 1}}'),
            ("a.yaml", b"CM9x: [1]\nRot: 2\nfoo: 3\n"),
            ("a.xml", b"<a><CM9x>1</CM9x><Rot>2</Rot><foo>3</foo></a>"),
        ],
    )
    def test_what_is_not_known_is_answered_by_what_it_holds(
        self, name: str, content: bytes
    ) -> None:
        for read in (lambda: gathered({name: content}), lambda: read_camera(content, name)):
            with refused(name, "keys: CM9x, Rot, foo; no image size"):
                read()
        with refused("a.json", "keys: CM1, CM2, Rot, Trans; no image size"):
            gathered(as_json({"CM1": K1, "CM2": K2, "Rot": R.tolist(), "Trans": T.tolist()}))


class TestNumpy:
    def written(self, **arrays: Any) -> bytes:
        file = io.BytesIO()
        np.savez_compressed(file, **arrays)
        return file.getvalue()

    def test_other_arrays_are_left_out(self) -> None:
        """Corners of a board, and objects that only a pickle can have."""
        content = self.written(
            **{"mtxL": np.array(K1), "distL": np.array([D1]), "R": R, "T": T[:, None]},
            **{"mtxR": np.array(K2), "distR": np.array([D2]), "imgsz": np.array(SIZE)},
            **{"image_size": np.array(SIZE), "objpoints": np.zeros((90_000, 3))},
            **{"pickled": np.array({"a": print}, dtype=object), "unit": np.array("m")},
        )
        assert recognise("s.npz", content).kind == "cameras"
        found = gathered({"s.npz": content})
        check(found)
        assert found.baseline_m == pytest.approx(BASELINE_M)
        assert recognise("s.npz", content[:700]).kind == "camera"
        with refused("s.npz"):
            gathered({"s.npz": content[:700]})

    def test_one_camera(self) -> None:
        content = self.written(mtx=np.array(K1), dist=np.array([D1]), rvecs=np.zeros((9, 3, 1)))
        assert recognise("l.npz", content).kind == "camera"
        np.testing.assert_array_equal(read_camera(content, "l.npz", image_size=SIZE).K, K1)
        with refused("l.npz", by=ImageSizeError):
            read_camera(content, "l.npz")

    def test_what_it_claims_is_not_believed(self) -> None:
        """A header of 80 TB in front of eight bytes."""
        import zipfile

        head = b"{'descr': '<f8', 'fortran_order': False, 'shape': (10000000000000,), }\n"
        array = b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + bytes(8)
        file = io.BytesIO()
        with zipfile.ZipFile(file, "w") as packed:
            packed.writestr("K1.npy", array)
        with refused("a.npz", "keys: none"):
            gathered({"a.npz": file.getvalue()})
