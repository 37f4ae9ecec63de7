"""Camera files of other programs, a row for each: how a file is known, where its lenses are, and
what its pose means.

A new program is a row of `PROGRAMS` and a function that gives the nodes of each of its cameras
under the names of `lens_nodes`, here with OpenCV's pixels, whose first centre is (0, 0).
"""

import configparser
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal

from stereocal.errors import StereocalError, damaged
from stereocal.formats.file_storage import (
    LARGEST_BYTES,
    OF_FISHEYE,
    OF_LENS,
    ForeignFile,
    Storage,
    check_text_length,
    parse_xml,
    read_yaml,
)
from stereocal.formats.lens_nodes import cameras_among, nodes_of_all
from stereocal.formats.other_files import OUR_JSON

Direction = Literal[
    "secondary_from_primary", "primary_from_secondary", "camera_from_world", "world_from_camera"
]
"""What R and T take to what: of a pair, or of each camera."""
Cameras = Mapping[str, Storage]


@dataclass(frozen=True)
class Program:
    """The camera files of a program."""

    known_as: str
    """The program, and in brackets its files."""
    known_by: str
    """A pattern that none but its files contain."""
    cameras: Callable[[ForeignFile], Cameras]
    """The nodes of each camera: of its lens, R and T (or `M`, 4x4) if the pose is each camera's,
    `to`, the camera that these lead to, if it is not one world, and a `remark` for the user."""
    pose: Direction | None = None
    unit: Literal["m", "cm", "mm"] | None = None
    of_pair: Callable[[ForeignFile], Storage] | None = None
    """The nodes R and T (or `M`) of the pair."""
    no_pose: str = ""
    """Why none is read."""
    one_camera: bool = False
    note: str = ""
    """For the documentation."""

    @property
    def title(self) -> str:
        return self.known_as.split(" (")[0]

    def knows(self, file: ForeignFile) -> bool:
        known = re.compile(self.known_by.encode(), re.MULTILINE)
        return len(file.content) <= LARGEST_BYTES and known.search(file.content) is not None

    def cameras_of(self, file: ForeignFile) -> Cameras:
        """The nodes of each camera in a file, by its name."""
        broken = f"this is a camera file of {self.title} that cannot be read"
        with damaged(f"{broken}.", source=file.name, keep=True):
            try:
                cameras = self.cameras(file)
            except KeyError as error:
                raise StereocalError(f"{broken}: {error} is missing.", file.name) from error
        if not cameras:
            raise StereocalError(f"there is no lens in this file of {self.title}.", file.name)
        return cameras


def only_camera(file: ForeignFile) -> Storage | None:
    """The nodes of the only camera in a file; None if it is of no program here.

    Raises:
        StereocalError: it has several.
    """
    for program in PROGRAMS.values():
        if program.knows(file):
            return only_of(program.cameras_of(file), f"{file.name} ({program.title})")
    return None


def only_of(cameras: Cameras, source: str) -> Storage:
    """The nodes of the only camera in a file, which is refused if it has several."""
    if len(cameras) > 1:
        raise StereocalError(
            f"a file of one camera is expected; this has {len(cameras)} "
            f"({', '.join(cameras)[:200]}): give it as the file of both cameras.",
            source,
        )
    return next(iter(cameras.values()))


def _unread(file: ForeignFile, what: object, remedy: str) -> StereocalError:
    by_hand = f"or write its numbers into a JSON file, {OUR_JSON}"
    return StereocalError(f"{str(what)[:80]} is not read: {remedy}; {by_hand}.", file.name)


BROWN = (*OF_LENS, "s1", "s2", "s3", "s4", "tauX", "tauY")


def _lens(
    focal: Sequence[Any], lens: Storage, size: Sequence[Any], fisheye: bool | None = None
) -> dict[str, Any]:
    """The nodes of a camera.

    Args:
        focal: fx fy cx cy, and skew if there is one.
        lens: coefficients by name, with 0 for those that are missing.
        fisheye: None: of k1 k2 k3 k4 alone.
    """
    fx, fy, cx, cy, skew = map(float, (*focal, 0.0)[:5])
    if fisheye is None:
        fisheye = "k4" in lens and not {"p1", "k5"} & lens.keys()
    D = [lens.get(key, 0.0) for key in (OF_FISHEYE if fisheye else BROWN)]
    return {
        "camera_matrix": [[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]],
        "distortion_coefficients": D if fisheye else _without_zeros(D),
        "distortion_model": "fisheye" if fisheye else "rational",
        "image_size": [int(float(side)) for side in size],
    }


def _without_zeros(D: list[Any]) -> list[Any]:
    """The coefficients of the shortest of OpenCV's lenses that has them."""
    return next(D[:n] for n in (5, 8, 12, len(D)) if not any(D[n:]))


def _within(node: Any, key: str, deepest: int = 5) -> Any:
    """The first node with this name; a `KeyError` if there is none."""
    if isinstance(node, dict) and deepest:
        if key in node:
            return node[key]
        for inner in node.values():
            with suppress(KeyError):
                return _within(inner, key, deepest - 1)
    raise KeyError(key)


def _words(text: str) -> list[float]:
    return [float(word) for word in text.replace(",", " ").split()]


ZED_SIZES = {
    "2K": (2208, 1242), "FHD": (1920, 1080), "FHD1200": (1920, 1200), "HD": (1280, 720),
    "HD1200": (1920, 1200), "SVGA": (960, 600), "VGA": (672, 376), "QHDPLUS": (3200, 1800),
    "4K": (3840, 2160),
}  # fmt: skip
"""Of the ZED SDK's resolutions, ZED X's among them."""


def _zed(file: ForeignFile) -> Cameras:
    """A section for each camera and resolution; newer files have the lens in `LEFT_DISTO`."""
    check_text_length(file.text, file.name)
    parser = configparser.ConfigParser(interpolation=None, strict=False)
    try:
        parser.read_string(file.text)
    except configparser.Error as error:
        raise StereocalError(f"this is not valid INI ({error}).", file.name) from error
    sections = {name.upper(): dict(parser[name]) for name in parser.sections()}
    cameras: dict[str, dict[Any, Any]] = {"left": {}, "right": {}}
    for name, section in sections.items():
        side, _, mode = name.partition("_CAM_")
        if side in ("LEFT", "RIGHT") and mode in ZED_SIZES:
            texts = {**section, **sections.get(f"{side}_DISTO", {})}
            values = {key: float(text) for key, text in texts.items()}
            focal = [values[key] for key in ("fx", "fy", "cx", "cy")]
            cameras[side.lower()][ZED_SIZES[mode]] = _lens(focal, values, ZED_SIZES[mode])
    return {side: {"modes": modes} for side, modes in cameras.items() if modes}


SOCKETS = {"0": "rgb", "1": "left", "2": "right"}


def _oak(file: ForeignFile) -> Cameras:
    """`extrinsics` take a camera's points to those of `toCameraSocket`."""
    entries = _within(file.storage, "cameraData")
    cameras = {}
    for socket, camera in entries.items() if isinstance(entries, dict) else entries:
        if not camera["width"]:
            continue  # not calibrated
        if (kind := camera.get("cameraType", 0)) not in (0, 1):
            raise _unread(file, f"a lens of OAK's cameraType {kind}", "0 and 1 are")
        D, moved = camera["distortionCoeff"], camera["extrinsics"]
        cameras[_socket(socket)] = {
            "camera_matrix": camera["intrinsicMatrix"],
            "distortion_coefficients": D[:4] if kind else _without_zeros(D),
            "distortion_model": "fisheye" if kind else "rational",
            "image_size": [camera["width"], camera["height"]],
            "R": moved["rotationMatrix"],
            "T": [moved["translation"][axis] for axis in "xyz"],
            "to": _socket(moved["toCameraSocket"]),
        }
    return dict(sorted(cameras.items(), key=lambda item: item[0] not in ("left", "right")))


def _socket(number: Any) -> str:
    return SOCKETS.get(str(number), f"CAM_{number}")


def _calib_io(file: ForeignFile) -> Cameras:
    cameras = {}
    for k, camera in enumerate(_within(file.storage, "cameras")):
        base = _within(camera, "CameraModelBase")
        size = base.get("imageSize", base)
        sides = [size.get(side.lower(), size.get(f"image{side}")) for side in ("Width", "Height")]
        values = {key: node["val"] for key, node in _within(camera, "parameters").items()}
        f, fy = values["f"], values["f"] * values.get("ar", 1.0)
        focal = f, fy, values["cx"], values["cy"], values.get("skew", 0.0)
        moved = camera.get("transform", {"rotation": {}, "translation": {}})
        cameras[str(k)] = _lens(focal, values, sides) | {
            "R": [moved["rotation"].get(key) for key in ("rx", "ry", "rz")],
            "T": [moved["translation"].get(key) for key in "xyz"],
        }
    return cameras


def _metashape(file: ForeignFile) -> Cameras:
    """Metashape's manual, appendix D: u = w/2 + cx + f x' + b1 x' + b2 y', where the first centre
    is (0.5, 0.5), and x' = x (1 + k1 r^2 + ...) + p1 (r^2 + 2 x^2) + 2 p2 x y."""
    root = parse_xml(file.text, file.name)
    cameras = {}
    for k, sensor in enumerate([*root.iter("sensor")] or [root]):
        fitted = [sensor] if sensor is root else sensor.findall("calibration")
        if not fitted:
            continue
        lens = next((lens for lens in fitted if lens.get("class") == "adjusted"), fitted[0])
        texts = {child.tag: (child.text or "").strip() or "0" for child in lens}
        kind = lens.get("type", texts.get("projection", "frame"))
        if kind != "frame":
            how = "in Tools, Camera Calibration, save it as OpenCV"
            raise _unread(file, f"a lens of Metashape's type {kind}", how)
        sides = next((size.attrib for size in lens.iter("resolution")), texts)
        w, h = float(sides["width"]), float(sides["height"])
        v = {key: float(text) for key, text in texts.items() if len(key) < 3}
        if any(v.get(key) for key in ("k4", "p3", "p4")):
            raise _unread(file, "a lens of Metashape with k4, p3 or p4", "fit it without them")
        centre = w / 2 + v.get("cx", 0.0) - 0.5, h / 2 + v.get("cy", 0.0) - 0.5
        focal = v["f"] + v.get("b1", 0.0), v["f"], *centre, v.get("b2", 0.0)
        swapped = {**v, "p1": v.get("p2", 0.0), "p2": v.get("p1", 0.0)}
        label = sensor.get("label", "")
        name = label if label and label not in cameras else str(k)
        cameras[name] = _lens(focal, swapped, (w, h), fisheye=False)
    return cameras


def _euroc(file: ForeignFile) -> Cameras:
    if (model := file.storage.get("camera_model")) != "pinhole":
        raise _unread(file, f"a camera of the model {model}", "calibrate it as pinhole")
    moved = file.storage["T_BS"]
    return {"camera": {**file.storage, "M": moved["data"] if isinstance(moved, dict) else moved}}


def _orbslam(file: ForeignFile) -> Cameras:
    kind = str(file.storage.get("Camera.type", "PinHole"))
    if kind not in ("PinHole", "Pinhole", "KannalaBrandt8"):
        raise _unread(file, f"a camera of ORB-SLAM3's type {kind}", "its images are rectified")
    model = {"distortion_model": "fisheye"} if kind == "KannalaBrandt8" else {}
    return {name: {**node, **model} for name, node in cameras_among(file.storage).items()}


def _orbslam_pair(file: ForeignFile) -> Storage:
    node = file.storage.get("Stereo.T_c1_c2", file.storage.get("Tlr"))
    if node is None:
        raise StereocalError("Stereo.T_c1_c2, the pose of the cameras, is missing.", file.name)
    values = list(node["data"] if isinstance(node, dict) else node)
    return {"M": values if len(values) != 12 else [*values, 0.0, 0.0, 0.0, 1.0]}


_LINE = re.compile(r"^(\w+):[ \t]*([-+.\deE \t]+)\r?$", re.MULTILINE)


def _kitti(file: ForeignFile) -> Cameras:
    """`calib_cam_to_cam.txt`, or `calib.txt` of images that are undistorted and rectified."""
    rows: dict[str, list[float]] = {}
    for key, text in _LINE.findall(file.text):
        rows[key.replace("S_", "image_size_") if key.startswith("S_0") else key] = _words(text)
    if cameras := cameras_among(rows):
        return cameras
    return {key[1:]: _rectified(P, file) for key, P in rows.items() if re.fullmatch(r"P\d", key)}


def _rectified(P: Sequence[float], file: ForeignFile) -> Storage:
    fx, _, cx, x, _, fy, cy, y, _, _, _, z = P
    return {
        **{"fx": fx, "fy": fy, "cx": cx, "cy": cy, "D": [0.0] * 5, "R": [0.0] * 3},
        "T": [(x - cx * z) / fx, (y - cy * z) / fy, z],
        "remark": f"The lenses of {file.name} are those of its rectified images: points of other "
        "images do not fit them.",
    }


_RESULT = re.compile(
    r"^[ \t]*(cam\d+) [^\n]*\n\s*type: ([^\n]*)\n\s*distortion: \[([^\]\n]*)\][^\n]*\n"
    r"\s*projection: \[([^\]\n]*)\]",
    re.MULTILINE,
)
_TYPE = re.compile(r"\.(Equidistant)?DistortedPinhole")


def _kalibr_results(file: ForeignFile) -> Cameras:
    check_text_length(file.text, file.name)
    cameras = {}
    for name, kind, lens, focal in _RESULT.findall(file.text.replace("\r", "")):
        if (match := _TYPE.search(kind)) is None:
            how = "calibrate with --models pinhole-radtan or pinhole-equi"
            raise _unread(file, f"a camera of Kalibr's type {kind}", how)
        model = "fisheye" if match[1] else "plumb_bob"
        numbers = {"intrinsics": _words(focal), "D": _words(lens)}
        cameras[name] = {**numbers, "distortion_model": model}
    return cameras


_TITLE = re.compile(r"^#[ \t]*([^:\n]*):.*$", re.MULTILINE)


def _openlpt(file: ForeignFile) -> Cameras:
    """Its titles are known names; the image's rows come before its columns."""
    check_text_length(file.text, file.name)
    _, *parts = _TITLE.split(file.text)
    texts = dict(zip(map(str.strip, parts[::2]), map(str.strip, parts[1::2]), strict=True))
    if (model := texts["Camera Model"]) != "PINHOLE":
        raise _unread(file, f"a camera of OpenLPT's model {model}", "calibrate it as PINHOLE")
    titles = "Camera Matrix", "Distortion Coefficients", "Rotation Matrix", "Translation Vector"
    node: dict[str, Any] = {title: _words(texts[title]) for title in titles}
    size = _words(texts["Image Size"])[::-1]
    return {"camera": {**node, "image_size": size, "distortion_model": "plumb_bob"}}


def _mrcal(file: ForeignFile) -> Cameras:
    """A dictionary of Python, which is YAML too."""
    node = read_yaml(file.text, file.name)
    if re.fullmatch(r"LENSMODEL_(OPENCV(4|5|8|12)|PINHOLE)", str(node["lensmodel"])) is None:
        how = "mrcal-convert-lensmodel LENSMODEL_OPENCV8 writes one that is"
        raise _unread(file, f"a lens of mrcal's {node['lensmodel']}", how)
    values, moved = node["intrinsics"], node.get("extrinsics", node.get("rt_cam_ref"))
    lens = {"intrinsics": values[:4], "D": values[4:] or [0.0] * 5}
    size = {"image_size": node["imagersize"], "distortion_model": "plumb_bob"}
    pose = {} if moved is None else {"R": moved[:3], "T": moved[3:]}
    return {"camera": {**lens, **size, **pose}}


def _vicon(file: ForeignFile) -> Cameras:
    raise _unread(file, "Vicon's model of lenses", "calibrate from photographs of a board")


def _opensfm(file: ForeignFile) -> Cameras:
    """Lengths are of the longer side of the images; c_x, c_y count from their middle."""
    cameras = {}
    for name, node in file.storage.items():
        kind, w, h = node["projection_type"], node["width"], node["height"]
        if kind not in ("perspective", "brown", "fisheye", "fisheye_opencv"):
            how = "perspective, brown, fisheye and fisheye_opencv are"
            raise _unread(file, f"a camera of OpenSfM's type {kind}", how)
        longer = max(w, h)
        fx, fy = (longer * node.get(f"focal_{axis}", node.get("focal")) for axis in "xy")
        cx, cy = (longer * node.get(f"c_{axis}", 0.0) for axis in "xy")
        focal = fx, fy, cx + w / 2 - 0.5, cy + h / 2 - 0.5
        cameras[name] = _lens(focal, node, (w, h), fisheye=kind.startswith("fisheye"))
    return cameras


PROGRAMS: Mapping[str, Program] = {
    "zed": Program(
        "ZED (`SN*.conf`)", r"^\[(LEFT|RIGHT)_CAM_\w+\]", _zed,
        no_pose="the directions of a ZED's rotation and translation are not documented",
        note="lenses for several resolutions: taken by the size of the images",
    ),
    "oak": Program(
        "OAK (depthai's calibration JSON)", r'"cameraData"\s*:', _oak, "world_from_camera", "cm",
        note="left and right are sockets 1 and 2; the pose leads to `toCameraSocket`",
    ),
    "calibio": Program(
        "calib.io (project JSON)", r'"ptr_wrapper"\s*:', _calib_io, "camera_from_world", "m"
    ),
    "viame": Program(
        "VIAME (`camera_rig.json`)", r'"fx_left"\s*:', lambda file: cameras_among(file.storage),
        "secondary_from_primary", "mm", lambda file: nodes_of_all(file.storage),
    ),
    "metashape": Program(
        "Metashape (calibration XML)", r"<projection>\w+</projection>", _metashape,
        no_pose="a lens of Metashape has no pose", one_camera=True,
        note="cx, cy from the images' middle; P1 and P2 are p2 and p1; k4 must be 0",
    ),
    "metashape-project": Program(
        "Metashape (cameras XML)", r"<sensors\b[^>]*>", _metashape,
        no_pose="Metashape's poses are those of single photographs",
        note="its sensors are the cameras",
    ),
    "euroc": Program(
        "EuRoC (`sensor.yaml` of each camera)", r"^T_BS:", _euroc, "world_from_camera", "m",
        one_camera=True,
    ),
    "orbslam3": Program(
        "ORB-SLAM3 (settings YAML)", r"^(Camera1\.fx|LEFT\.(K|width|height)) *:", _orbslam,
        "primary_from_secondary", "m", _orbslam_pair,
        note="`Camera1.fx`, `Stereo.T_c1_c2`; or the older `LEFT.K`, without a pose",
    ),
    "kitti": Program(
        "KITTI (`calib_cam_to_cam.txt`, `calib.txt`)", r"^(K_0\d|P0): *[-+.\d]", _kitti,
        "camera_from_world", "m",
        note="`calib.txt` is of rectified images, and does not state their size",
    ),
    "kalibr-results": Program(
        "Kalibr (`results-cam.txt`)", r"^\s*projection: \[[^\]\n]*\] \+- \[", _kalibr_results,
        no_pose="the pose of Kalibr is read of its camchain.yaml",
        note="it does not state the size of the images: `camchain.yaml` does",
    ),
    "openlpt": Program(
        "OpenLPT (`cam1.txt`)", r"^# *Camera Model: *\(", _openlpt, "camera_from_world", "mm",
        one_camera=True,
    ),
    "mrcal": Program(
        "mrcal (`.cameramodel` of OpenCV's lens models)", r"['\"]lensmodel['\"]\s*:", _mrcal,
        "camera_from_world", "m", one_camera=True,
        note="others: `mrcal-convert-lensmodel LENSMODEL_OPENCV8`",
    ),
    "vicon": Program(
        "Vicon (`.xcp`)", r"<Camera\b[^>]*\bDEVICEID=", _vicon,
        note="not read: its lens is of Vicon's own model",
    ),
    "opensfm": Program(
        "OpenSfM (`camera_models.json`)", r'"projection_type"\s*:', _opensfm,
        no_pose="camera_models.json has no poses",
    ),
}  # fmt: skip
