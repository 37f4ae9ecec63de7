"""Camera files as other programs write them: the pose, the lens and the size that they state."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stereocal.cli import main
from stereocal.formats.archives.gather import gather
from stereocal.formats.camera_file import ImageSizeError, read_camera
from stereocal.formats.exchange.camera_format import numbers
from stereocal.formats.exchange.exchange import export_files, import_files
from stereocal.formats.exchange.options import CORNERS, ExchangeOptions, OriginError
from stereocal.rig.geometry import AT_ORIGIN, Angles, Pose
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import PlacedCamera, Rig, SeveralCameras
from stereocal.system.array_types import FloatArray
from tests.archives import CASES, PLAIN, case, focal
from tests.refused import refused
from tests.rigs.known_rig import BASELINE_M, PRIMARY, RIG, SECONDARY

TRUE_R = np.array(
    [
        [0.939793423488, 0.0, 0.341743063087],
        [-0.00486568679641, 0.999898636663, 0.0133806386901],
        [-0.341708422869, -0.0142378509529, 0.939698162891],
    ]
)
TRUE_T = np.array([-1.1961007208, -0.0468322354155, 0.222822367413])
"""Of the cases; the baseline is 1.21758 m."""
HD = ((1920, 1080), (1920, 1080))


def same_pose(pose: Pose, tolerance: float, R: FloatArray = TRUE_R, T: FloatArray = TRUE_T) -> None:
    np.testing.assert_allclose(pose.R, R, rtol=0, atol=tolerance)
    np.testing.assert_allclose(pose.T, T, rtol=0, atol=tolerance)
    np.testing.assert_allclose(pose.R @ pose.R.T, np.eye(3), rtol=0, atol=1e-6)


def camera_info(k: int, P: FloatArray, R: FloatArray) -> bytes:
    """A camera_info file of the known rig without a distortion model."""
    camera = (PRIMARY, SECONDARY)[k]
    text = f"image_width: {camera.image_size[0]}\nimage_height: {camera.image_size[1]}\n"
    lens = np.append(camera.distortion, 0.0)[None, :5]
    tables = {"camera": camera.K, "rectification": R, "projection": P}
    named = {f"{name}_matrix": table for name, table in tables.items()}
    for name, table in (named | {"distortion_coefficients": lens}).items():
        rows, cols = table.shape
        text += f"{name}:\n  rows: {rows}\n  cols: {cols}\n  data: {numbers(table)}\n"
    return text.encode()


def message(file: bytes, keys: str, stamp: int = 7) -> str:
    """The same as a ROS message is printed: its keys are D K R P, or d k r p with lists in rows."""
    text = file.decode()
    width, height = re.findall(r"image_\w+: (\d+)", text)
    order = re.findall(r"^(\w+):\n  rows.*\n  cols.*\n  data: (.*)", text, re.MULTILINE)
    wanted = "KDRP" if keys.isupper() else "kdrp"
    named = dict(zip(wanted, (data for _, data in order), strict=True))
    lines = ["header:", "  stamp:", f"    sec: {stamp}", f"height: {height}", f"width: {width}"]
    for key, data in named.items():
        rows = "\n".join(f"- {value}" for value in json.loads(data))
        lines.append(f"{key}: {data}" if keys.isupper() else f"{key}:\n{rows}")
    return "\n".join([*lines, "binning_x: 0", "roi:", "  x_offset: 0", "  width: 0"]) + "\n"


class TestRosPose:
    def test_k_r_t(self) -> None:
        read = import_files(case("ros_p_is_k_r_t", "left.yaml", "right.yaml"), "ros")
        same_pose(read.pose, 2e-6)  # P has six decimals; measured: 4e-7
        assert any("K [R | t]" in note for note in read.inputs["notes"])

    @pytest.mark.parametrize("seed", range(5))
    def test_k_r_t_of_a_world_of_its_own(self, seed: int) -> None:
        turn = Rotation.random(random_state=seed).as_matrix()
        first = Pose(turn, np.array([0.3, -0.2, 1.7]))
        poses = (first, RIG @ first)
        files = {
            f"{k}.yaml": camera_info(k, K @ np.column_stack([pose.R, pose.T]), np.eye(3))
            for k, (K, pose) in enumerate(zip((PRIMARY.K, SECONDARY.K), poses, strict=True))
        }
        same_pose(import_files(files, "ros").pose, 1e-9, RIG.R, RIG.T)

    def test_two_rotations_and_numbers_in_columns_are_no_pose(self) -> None:
        P = SECONDARY.K @ np.column_stack([RIG.R, RIG.T])
        still = np.column_stack([PRIMARY.K, np.zeros(3)])
        for P2, R2, says in (
            (P, RIG.R, "rectification matrix"),
            (P.ravel(order="F").reshape(3, 4), np.eye(3), "K [R | t]"),
        ):
            files = {"l.yaml": camera_info(0, still, np.eye(3)), "r.yaml": camera_info(1, P2, R2)}
            with refused("r.yaml", says):
                import_files(files, "ros")
            found = gather(files, ExchangeOptions())
            assert found.baseline_m is None  # and why is said where it is missed
            assert any(says in line.origin for line in found.missing(None, 1.0))

    @pytest.mark.parametrize("decimals", [3, 4, 5, 6])
    def test_few_decimals(self, decimals: int) -> None:
        """The nearest rotation; with three, that is said, with four where it is off by 1e-4."""
        files = {
            name: re.sub(rb"-?\d+\.\d+", lambda own: b"%.*f" % (decimals, float(own[0])), content)
            for name, content in export_files(PLAIN, "ros").items()
        }
        back = import_files(files, "ros")
        # Measured, of T: 1.9e-3, 1.3e-4, 3e-5 and 2e-6.
        same_pose(back.pose, 5 * 10**-decimals, RIG.R, RIG.T)
        said = [note for note in back.inputs["notes"] if "nearest was taken" in note]
        assert len(said) == (decimals == 3)

    def test_six_decimals_of_camera_calibration(self) -> None:
        files = case("ros_six_decimals", "left.yaml", "right.yaml")
        same_pose(import_files(files, "ros").pose, 5e-6)  # measured: 2e-6
        found = gather(files, ExchangeOptions())
        assert found.baseline_m == pytest.approx(1.21758, abs=1e-5)

    def test_rotations_in_other_files(self) -> None:
        rough = np.round(RIG.R, 4)
        script = export_files(PLAIN, "matlab")["stereo_parameters.m"].decode()
        body = "\n".join(" ".join(map(str, row)) for row in rough.T)
        script = re.sub(r"RotationOfCamera2 = \[[^\]]*", f"RotationOfCamera2 = [\n{body}", script)
        read = import_files({"s.m": script.encode()}, "matlab")
        same_pose(read.pose, 1e-4, RIG.R, RIG.T)
        with refused("R ", "0.001"):
            Pose(np.round(RIG.R, 3), RIG.T)
        with refused("R ", "det +1"):
            Pose.nearest(np.round(RIG.R, 1), RIG.T)


class TestRosFiles:
    def test_the_order_given_is_kept_and_said(self) -> None:
        right, left = case("ros_order_ignored", "right.yaml", "left.yaml").items()
        found = gather(dict([right, left]), ExchangeOptions())
        assert focal(found) == (2000, 1500)
        assert ["right.yaml" in found.taken[0].origin, "left.yaml" in found.taken[1].origin]
        assert focal(gather(dict([left, right]), ExchangeOptions())) == (1500, 2000)
        for cameras in (("2", "1"), ("left", "right")):
            chosen = gather(dict([right, left]), ExchangeOptions(cameras=cameras))
            assert focal(chosen) == (1500, 2000)

    def test_the_pose_is_of_the_order(self, tmp_path: Path) -> None:
        """A folder has no order: there, the left camera is the primary, and that is said."""
        folder = str(CASES / "ros_order_ignored")
        out = tmp_path / "p.json"
        for words, secondary_first in (((), False), (("--cameras", "right,left"), True)):
            assert main(["convert", folder, "--from", "ros", *words, "--out", str(out)]) == 0
            read = RigParameters.load(out)
            pose = read.pose.inverse() if secondary_first else read.pose
            same_pose(pose, 1e-6)
            assert read.primary.K[0, 0] == (2000 if secondary_first else 1500)
            assert "primary camera" in read.inputs["notes"][0]

    @pytest.mark.parametrize("names", [("left.yaml", "right.yaml"), ("l2.yaml", "r2.yaml")])
    def test_printed_messages(self, names: tuple[str, str]) -> None:
        files = case("ros_topic_echo", *names)
        same_pose(import_files(files, "ros").pose, 1e-9)
        found = gather(files, ExchangeOptions())
        assert focal(found) == (1500, 1510)
        assert found.baseline_m == pytest.approx(1.21758, abs=1e-5)
        for file, content in files.items():  # a camera on its own, as the page Data reads it
            assert read_camera(content, file).image_size == (1920, 1080)

    @pytest.mark.parametrize("keys", ["DKRP", "dkrp"])
    @pytest.mark.parametrize("suffix", ["yaml", "txt"])
    def test_a_stream_of_messages(self, keys: str, suffix: str) -> None:
        """The last one is cut, as it is where the program was stopped."""
        files = {}
        for side, file in zip("lr", export_files(PLAIN, "ros").values(), strict=True):
            three = [message(file, keys, stamp) for stamp in (1, 2, 3)]
            files[f"{side}.{suffix}"] = "---\n".join([*three, three[0][:200]]).encode()
        found = gather(files, ExchangeOptions(lens_model="brown"))
        assert found.baseline_m == pytest.approx(BASELINE_M)
        assert focal(found) == (PRIMARY.K[0, 0], SECONDARY.K[0, 0])
        windows = {name: content.replace(b"\n", b"\r\n") for name, content in files.items()}
        assert gather(windows, ExchangeOptions(lens_model="brown")).baseline_m == found.baseline_m
        wide = files[f"l.{suffix}"].decode().encode("utf-16")  # of PowerShell
        assert read_camera(wide, "l", "brown").K[0, 0] == PRIMARY.K[0, 0]
        two = {"both.yaml": b"---\n".join(files.values())}
        with refused("both.yaml", "YAML"):
            gather(two, ExchangeOptions())

    def test_of_a_part_of_the_sensor(self) -> None:
        content = message(export_files(PLAIN, "ros")["primary.yaml"], "DKRP")
        for change in (("binning_x: 0", "binning_x: 2"), ("x_offset: 0", "x_offset: 64")):
            with refused("l.yaml", "binning_x", "roi"):
                read_camera(content.replace(*change).encode(), "l.yaml")

    def test_without_a_distortion_model(self) -> None:
        files = export_files(Rig(PRIMARY, SECONDARY, RIG), "ros")
        for model in (b"", b"distortion_model: ''\n"):
            plain = {
                name: re.sub(rb"distortion_model: \w+\n", model, content)
                for name, content in files.items()
            }
            found = gather(plain, ExchangeOptions())
            assert found.baseline_m == pytest.approx(BASELINE_M)
            assert found.secondary is not None and found.secondary.model == "brown"
        other = {name: c.replace(b"plumb_bob", b"omnidirectional") for name, c in files.items()}
        with refused("primary.yaml", "omnidirectional"):
            gather(other, ExchangeOptions())


class TestImageSize:
    @pytest.mark.parametrize("name", ["l.yml", "l.json"])
    def test_as_the_user_says(self, name: str) -> None:
        files = case("image_size_option_ignored", name)
        with refused(name, "image_width", by=ImageSizeError):
            gather(files, ExchangeOptions())
        found = gather(files, ExchangeOptions(HD))
        assert found.primary is not None and found.primary.image_size == (1920, 1080)

    def test_files_that_say_it(self) -> None:
        for name in ("l.xml", "stereo.yml"):
            files = case("opencv_size_not_seen", name)
            found = gather(files, ExchangeOptions(unit="m"))
            assert found.primary is not None and found.secondary is not None
            assert found.primary.image_size == found.secondary.image_size == (1920, 1080)
            with refused("1920x1080", "640x480"):
                gather(files, ExchangeOptions(((640, 480), (640, 480)), unit="m"))

    def test_a_size_for_each_camera_of_a_pair(self) -> None:
        files = export_files(PLAIN, "opencv")
        plain = files["intrinsics.yml"].decode()
        for k, camera in ((1, PRIMARY), (2, SECONDARY)):
            width, height = camera.image_size
            own = f"imageWidth{k}: {width}\nimageHeight{k}: {height}"
            plain = re.sub(rf"image_size_{k}: .*", own, plain)
        read = import_files({**files, "intrinsics.yml": plain.encode()}, "opencv")
        assert (read.primary.image_size, read.secondary.image_size) == ((1600, 1200), (1280, 1024))


class TestOpencv:
    @pytest.mark.parametrize("head", ["", "---\n", "# of the left camera\n%YAML:1.0\n---\n"])
    def test_without_its_head(self, head: str) -> None:
        (content,) = case("image_size_option_ignored", "l.yml").values()
        whole = head.encode() + content.split(b"---\n")[1]
        assert read_camera(whole, "l.yml", image_size=HD[0]).K[0, 0] == 1500
        assert focal(gather({"l.yml": whole}, ExchangeOptions(HD))) == (1500, 1500)
        xml = b"".join(case("opencv_size_not_seen", "l.xml").values()).partition(b"?>")[2]
        assert read_camera(xml, "l.xml").K[0, 0] == 1500

    @pytest.mark.parametrize(
        ("K", "D"),
        [("mtx_left", "dist_left"), ("K_left", "D_left"), ("left_K", "left_dist_coeffs")],
    )
    def test_pairs_by_other_names(self, K: str, D: str) -> None:
        nodes: dict[str, object] = {"R": RIG.R.tolist(), "T": RIG.T.tolist()}
        nodes["image_size"] = [1600, 1200]
        for side, camera in (("left", PLAIN.primary), ("right", PLAIN.secondary)):
            nodes[K.replace("left", side)] = camera.K.tolist()
            nodes[D.replace("left", side)] = camera.distortion.tolist()
        files = {"stereo.json": json.dumps(nodes).encode()}
        found = gather(files, ExchangeOptions(unit="m", lens_model="brown"))
        assert focal(found) == (PRIMARY.K[0, 0], SECONDARY.K[0, 0])
        assert found.baseline_m == pytest.approx(BASELINE_M)


class TestMatlab:
    def test_inches(self) -> None:
        files = case("matlab_inches", "stereo.mat")
        same_pose(import_files(files, "matlab").pose, 1e-6)
        assert gather(files, ExchangeOptions()).baseline_m == pytest.approx(1.21758, abs=1e-5)
        for unit in ("m", "cm", "mm"):
            with refused("inch", f"is {unit}"):
                import_files(files, "matlab", ExchangeOptions(unit=unit))


class TestDlt:
    def text(self, between: str = ",", corner: str = "upper-left", cameras: int = 2) -> bytes:
        """Coefficients of two cameras, or of three with another in their middle."""
        middle = PlacedCamera(PRIMARY, Pose.from_angles(Angles(0.1, 0.0, 0.0, 0.1, 3.1), 1.2))
        between_them = {f"b{number}": middle for number in range(cameras - 2)}
        first, last = PlacedCamera(PRIMARY, AT_ORIGIN), PlacedCamera(SECONDARY, RIG)
        placed = SeveralCameras({"a": first, **between_them, "c": last})
        in_front = Pose(np.eye(3), np.array([0.0, 0.0, -8.0]))
        options = ExchangeOptions(corner=corner, world=in_front)  # type: ignore[arg-type]
        return export_files(placed, "dlt", options)["dlt.csv"].replace(b",", between.encode())

    def read(self, *texts: bytes, **said: object) -> RigParameters:
        """The rig of one file, or of a file of each camera."""
        options = ExchangeOptions((PRIMARY.image_size, SECONDARY.image_size), unit="m", **said)  # type: ignore[arg-type]
        return import_files({f"{k}.csv": text for k, text in enumerate(texts)}, "dlt", options)

    def test_counted_from_below(self) -> None:
        files, options = (
            case("dlt_counted_from_below", "dltcoefs.csv"),
            ExchangeOptions(HD, unit="m"),
        )
        with refused("dltcoefs.csv", "lower left", by=OriginError):
            import_files(files, "dlt", options)
        below = import_files(files, "dlt", replace(options, corner="lower-left"))
        same_pose(below.pose, 1e-6)

    @pytest.mark.parametrize("corner", CORNERS)
    def test_what_is_stated_is_taken(self, corner: str) -> None:
        """Where it puts the world's origin behind the cameras, that is said."""
        text = self.text(corner=corner)
        for said in CORNERS:
            found = self.read(text, corner=said)
            notes = found.inputs.get("notes", ())
            assert any("origin lies behind" in note for note in notes) == (said != corner)
            if said == corner:
                same_pose(found.pose, 1e-9, RIG.R, RIG.T)

    def test_our_own_files_from_below(self) -> None:
        """The primary is at the world's origin, and the secondary may be in front of it."""
        below = ExchangeOptions(corner="lower-left")
        for pose in (RIG, Pose(RIG.R, RIG.T * [1, 1, -1])):
            text = export_files(Rig(PRIMARY, SECONDARY, pose), "dlt", below)["dlt.csv"]
            with pytest.raises(OriginError):
                self.read(text)
            same_pose(self.read(text, corner="lower-left").pose, 1e-9, pose.R, pose.T)

    def test_separators_headers_and_rows(self) -> None:
        plain = self.text().decode()
        european = plain.replace(",", ";").replace(".", ",")
        labelled = "\n".join(f"L{k + 1},{row}" for k, row in enumerate(plain.splitlines()))
        across = [*zip(*(row.split(",") for row in plain.splitlines()), strict=True)]
        for text in (
            european,
            european.replace(";", "\t"),
            plain.replace(",", "  "),
            plain.replace(",", " , "),
            plain.replace("\n", ",\n"),
            plain.replace("\n", "\n\n"),
            f"left,right\n{plain}",
            f"coefficient,left,right\n{labelled}",
            "% of DLTdv\n" + plain,
            plain + "1,1\n",
            "\n".join(",".join(row) for row in across),
        ):
            same_pose(self.read(text.encode()).pose, 1e-9, RIG.R, RIG.T)
        both = self.read(*("\n".join(row).encode() for row in across))
        same_pose(both.pose, 1e-9, RIG.R, RIG.T)

    def test_three_cameras(self, tmp_path: Path) -> None:
        with refused("3 (cam1, cam2, cam3)"):
            self.read(self.text(cameras=3))
        (tmp_path / "dlt.csv").write_bytes(self.text(cameras=3))
        sizes = ["--image-size-primary", "1280x1024", "--image-size-secondary", "1600x1200"]
        words = ["--unit", "m", "--cameras", "3,1", *sizes, "--out", str(tmp_path / "p.json")]
        assert main(["convert", str(tmp_path / "dlt.csv"), "--from", "dlt", *words]) == 0
        back = RigParameters.load(tmp_path / "p.json")
        same_pose(back.pose.inverse(), 1e-9, RIG.R, RIG.T)
        named = b"a,b,c\n" + self.text(cameras=3)
        same_pose(self.read(named, cameras=("a", "c")).pose, 1e-9, RIG.R, RIG.T)

    @pytest.mark.parametrize(
        ("old", "new", "says"), [(b"0.", b"NaN", '"NaN'), (b".", b",", "decimal")]
    )
    def test_what_is_no_table(self, old: bytes, new: bytes, says: str) -> None:
        with refused("0.csv", says):
            self.read(self.text().replace(old, new))
