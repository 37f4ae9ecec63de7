"""Camera files of other programs, a row for each: how a file is known, where its lenses are, and
what its pose means.

A new program is a row of `PROGRAMS` and a function that gives the nodes of each of its cameras
under the names of `lens_nodes`, here with OpenCV's pixels, whose first centre is (0, 0).
"""

import configparser
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal

from stereocal.errors import StereocalError, damaged
from stereocal.formats.file_storage import (
    LARGEST_BYTES,
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

    title: str
    files: str
    known_by: str
    """A pattern that none but its files contain."""
    cameras: Callable[[ForeignFile], Cameras]
    """The nodes of each camera: of its lens, R and T (or `M`, 4x4) if the pose is each camera's,
    `to`, the camera that these lead to, if it is not one world, and a `remark` for the user."""
    pose: Direction | None = None
    of_pair: Callable[[ForeignFile], Storage] | None = None
    """The nodes R and T (or `M`) of the pair."""
    no_pose: str = ""
    """Why none is read."""
    unit: Literal["m", "cm", "mm"] | None = None
    one_camera: bool = False
    note: str = ""
    """For the documentation."""

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


def described(file: ForeignFile) -> Program | None:
    """The program whose camera file it is; None if it is of none of these."""
    return next((program for program in PROGRAMS.values() if program.knows(file)), None)


def only_camera(file: ForeignFile) -> Storage | None:
    """The nodes of the only camera in a file; None if it is of no program here.

    Raises:
        StereocalError: it has several.
    """
    if (program := described(file)) is None:
        return None
    cameras = program.cameras_of(file)
    if len(cameras) > 1:
        raise several(cameras, f"{file.name} ({program.title})")
    return next(iter(cameras.values()))


def several(cameras: Iterable[str], source: str) -> StereocalError:
    """The error of a file of several cameras in place of one camera's."""
    names = [*cameras]
    return StereocalError(
        f"a file of one camera is expected; this has {len(names)} ({', '.join(names)[:200]}): give "
        "it as the file of both cameras.",
        source,
    )


def _unread(file: ForeignFile, what: str, remedy: str) -> StereocalError:
    return StereocalError(
        f"{what} is not read: {remedy}; or write its numbers into a JSON file, {OUR_JSON}.",
        file.name,
    )


BROWN = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tauX", "tauY")
KANNALA = ("k1", "k2", "k3", "k4")


def _lens(
    focal: Sequence[Any], lens: Any, size: Sequence[Any] | None = None, **more: Any
) -> dict[str, Any]:
    """The nodes of a camera.

    Args:
        focal: fx fy cx cy, and skew if there is one.
        lens: the coefficients in OpenCV's order, or by name: k1 k2 k3 k4 alone are a fisheye's.
        size: width and height.
    """
    fx, fy, cx, cy, *skew = map(float, focal)
    K = [[fx, skew[0] if skew else 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
    sized = {} if size is None else {"image_size": [int(float(side)) for side in size]}
    if isinstance(lens, dict):
        fisheye = "k4" in lens and not {"p1", "k5"} & lens.keys()
        more["distortion_model"] = "fisheye" if fisheye else "rational"
        lens = [lens.get(key, 0.0) for key in (KANNALA if fisheye else BROWN)]
    if more.get("distortion_model") == "rational":  # without zeros behind
        lens = next(lens[:n] for n in (5, 8, 12, 14) if not any(lens[n:]))
    return {"camera_matrix": K, "distortion_coefficients": [*lens], **sized, **more}


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
    cameras: dict[str, dict[str, Any]] = {}
    for name, section in sections.items():
        side, _, mode = name.partition("_CAM_")
        if side not in ("LEFT", "RIGHT") or mode not in ZED_SIZES:
            continue
        section |= sections.get(f"{side}_DISTO", {})
        values = {key: float(text) for key, text in section.items()}
        focal = [values[key] for key in ("fx", "fy", "cx", "cy")]
        modes = cameras.setdefault(side.lower(), {"modes": {}})["modes"]
        modes[ZED_SIZES[mode]] = _lens(focal, values, ZED_SIZES[mode])
    return cameras


SOCKETS = {"0": "rgb", "1": "left", "2": "right"}


def _oak(file: ForeignFile) -> Cameras:
    entries = _within(file.storage, "cameraData")
    entries = entries.items() if isinstance(entries, dict) else entries
    cameras = {}
    for socket, camera in entries:
        if not camera.get("width") or not any(map(any, camera["intrinsicMatrix"])):
            continue  # not calibrated
        kind, lens = camera.get("cameraType", 0), camera["distortionCoeff"]
        if kind not in (0, 1):
            raise _unread(file, "a lens of OAK that is neither perspective nor fisheye", "refit it")
        (fx, skew, cx), (_, fy, cy), _ = camera["intrinsicMatrix"]
        moved = camera.get("extrinsics", {})
        cameras[_socket(socket)] = _lens(
            (fx, fy, cx, cy, skew),
            lens[:4] if kind else lens,
            (camera["width"], camera["height"]),
            distortion_model="fisheye" if kind else "rational",
            R=moved.get("rotationMatrix"),
            T=[moved.get("translation", {}).get(axis) for axis in "xyz"],
            to=_socket(moved.get("toCameraSocket", -1)),
        )
    return dict(sorted(cameras.items(), key=lambda item: item[0] not in ("left", "right")))


def _within(node: Any, key: str, deepest: int = 5) -> Any:
    """The first node with this name; a `LookupError` if there is none."""
    if isinstance(node, dict) and deepest:
        if key in node:
            return node[key]
        for inner in node.values():
            with suppress(LookupError):
                return _within(inner, key, deepest - 1)
    raise LookupError(key)


def _socket(number: Any) -> str:
    return SOCKETS.get(str(number), f"CAM_{number}")


def _calib_io(file: ForeignFile) -> Cameras:
    cameras = {}
    for k, camera in enumerate(_within(file.storage, "cameras")):
        data = camera["model"]["ptr_wrapper"]["data"]
        base = data.get("CameraModelCRT", data)["CameraModelBase"]
        size = base.get("imageSize", base)
        sides = [size.get(side.lower(), size.get(f"image{side}")) for side in ("Width", "Height")]
        values = {key: entry["val"] for key, entry in data["parameters"].items()}
        f, moved = values["f"], camera.get("transform", {})
        turned, shift = moved.get("rotation", {}), moved.get("translation", {})
        cameras[str(k)] = _lens(
            (f, f * values.get("ar", 1.0), values["cx"], values["cy"], values.get("skew", 0.0)),
            values,
            sides,
            R=[turned.get(key) for key in ("rx", "ry", "rz")],
            T=[shift.get(key) for key in "xyz"],
        )
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
            raise _unread(file, f"a lens of the type {kind[:40]} of Metashape", AS_OPENCV)
        v = {key: float(texts.get(key, 0.0)) for key in METASHAPE}
        if v["k4"] or v["p3"] or v["p4"]:
            raise _unread(file, "a lens of Metashape with k4, p3 or p4", "fit it without them")
        stated = lens.find("resolution") if lens.find("resolution") is not None else None
        sides = texts if stated is None else stated.attrib
        width, height = float(sides["width"]), float(sides["height"])
        label = sensor.get("label", "")
        cameras[label if label and label not in cameras else str(k)] = _lens(
            (
                *(v["f"] + v["b1"], v["f"]),
                *(width / 2 + v["cx"] - 0.5, height / 2 + v["cy"] - 0.5, v["b2"]),
            ),
            (v["k1"], v["k2"], v["p2"], v["p1"], v["k3"]),
            (width, height),
        )
    return cameras


METASHAPE = ("f", "cx", "cy", "b1", "b2", "k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4")
AS_OPENCV = "in Tools, Camera Calibration, save it as OpenCV"


def _euroc(file: ForeignFile) -> Cameras:
    node = file.storage
    if (model := node.get("camera_model")) != "pinhole":
        raise _unread(file, f"a camera of the model {str(model)[:40]}", "calibrate it as pinhole")
    camera = _lens(
        node["intrinsics"],
        node["distortion_coefficients"],
        node["resolution"],
        distortion_model=node["distortion_model"],
        M=node["T_BS"]["data"] if isinstance(node["T_BS"], dict) else node["T_BS"],
    )
    return {"camera": camera}


def _orbslam(file: ForeignFile) -> Cameras:
    kind = str(file.storage.get("Camera.type", "PinHole"))
    if kind not in ("PinHole", "Pinhole", "KannalaBrandt8"):
        raise _unread(file, f"a camera of ORB-SLAM3's type {kind[:40]}", "its images are rectified")
    model = {"distortion_model": "fisheye"} if kind == "KannalaBrandt8" else {}
    return {name: {**node, **model} for name, node in cameras_among(file.storage).items()}


def _orbslam_pair(file: ForeignFile) -> Storage:
    node = file.storage.get("Stereo.T_c1_c2", file.storage.get("Tlr"))
    if node is None:
        raise StereocalError("Stereo.T_c1_c2, the pose of the cameras, is missing.", file.name)
    values = list(node["data"] if isinstance(node, dict) else node)
    return {"M": values if len(values) != 12 else [*values, 0.0, 0.0, 0.0, 1.0]}


_LINE = re.compile(r"^(\w+):[ \t]*([-+.\deE \t]+)$", re.MULTILINE)


def _kitti(file: ForeignFile) -> Cameras:
    """`calib_cam_to_cam.txt`, or `calib.txt` of images that are undistorted and rectified."""
    lines = _LINE.findall(file.text.replace("\r", ""))
    rows = {key: [*map(float, numbers.split())] for key, numbers in lines}
    cameras = {}
    for k in map(str, range(10)):
        K, P = rows.get(f"K_0{k}"), rows.get(f"P{k}")
        if K is not None:
            size, moved = rows.get(f"S_0{k}"), {key: rows.get(f"{key}_0{k}") for key in "RT"}
            cameras[k] = _lens((K[0], K[4], K[2], K[5]), rows[f"D_0{k}"], size, **moved)
        elif P is not None and "K_00" not in rows:
            fx, _, cx, x, _, fy, cy, y, _, _, _, z = P
            T = [(x - cx * z) / fx, (y - cy * z) / fy, z]
            cameras[k] = _lens((fx, fy, cx, cy), [0.0] * 5, R=[0.0, 0.0, 0.0], T=T)
            cameras[k]["remark"] = (
                f"The lenses of {file.name} are those of its rectified images: points of other "
                "images do not fit them."
            )
    return cameras


_RESULT = re.compile(
    r"^[ \t]*(cam\d+) [^\n]*\n\s*type: ([^\n]*)\n\s*distortion: \[([^\]\n]*)\][^\n]*\n"
    r"\s*projection: \[([^\]\n]*)\]",
    re.MULTILINE,
)


def _kalibr_results(file: ForeignFile) -> Cameras:
    check_text_length(file.text, file.name)
    cameras = {}
    for name, kind, lens, focal in _RESULT.findall(file.text.replace("\r", "")):
        fisheye = "EquidistantDistortedPinhole" in kind
        if not fisheye and "'aslam_cv.libaslam_cv_python.DistortedPinhole" not in kind:
            what = f"a camera of Kalibr's type {kind[:80]}"
            raise _unread(file, what, "calibrate with --models pinhole-radtan or pinhole-equi")
        model = "fisheye" if fisheye else "plumb_bob"
        cameras[name] = _lens(focal.split(), map(float, lens.split()), distortion_model=model)
    return cameras


_TITLE = re.compile(r"^#[ \t]*([^:\n]*):.*$", re.MULTILINE)


def _openlpt(file: ForeignFile) -> Cameras:
    check_text_length(file.text, file.name)
    _, *parts = _TITLE.split(file.text.replace("\r", ""))
    texts = dict(zip(map(str.strip, parts[::2]), map(str.strip, parts[1::2]), strict=True))
    if (model := texts["Camera Model"]) != "PINHOLE":
        raise _unread(file, f"a camera of OpenLPT's model {model[:40]}", "calibrate it as PINHOLE")
    size, K, lens, R, T = (
        [float(word) for word in texts[title].replace(",", " ").split()]
        for title in (
            *("Image Size", "Camera Matrix", "Distortion Coefficients", "Rotation Matrix"),
            "Translation Vector",
        )
    )
    focal = K[0], K[4], K[2], K[5]
    return {"camera": _lens(focal, lens, size[::-1], distortion_model="plumb_bob", R=R, T=T)}


def _mrcal(file: ForeignFile) -> Cameras:
    """A dictionary of Python, which is YAML too."""
    node = read_yaml(file.text, file.name)
    model = str(node["lensmodel"])
    if re.fullmatch(r"LENSMODEL_(OPENCV(4|5|8|12)|PINHOLE)", model) is None:
        what = f"a lens of mrcal's model {model[:60]}"
        raise _unread(file, what, "mrcal-convert-lensmodel LENSMODEL_OPENCV8 writes one that is")
    numbers = node["intrinsics"]
    moved = node["extrinsics"] if "extrinsics" in node else node["rt_cam_ref"]
    more = {"distortion_model": "plumb_bob", "R": moved[:3], "T": moved[3:]}
    return {"camera": _lens(numbers[:4], numbers[4:] or [0.0] * 5, node["imagersize"], **more)}


def _vicon(file: ForeignFile) -> Cameras:
    raise _unread(file, "Vicon's model of lenses", "calibrate from photographs of a board")


def _opensfm(file: ForeignFile) -> Cameras:
    """Lengths are of the longer side of the images; c_x, c_y count from their middle."""
    cameras = {}
    for name, node in file.storage.items():
        kind = node["projection_type"]
        if kind not in ("perspective", "brown", "fisheye", "fisheye_opencv"):
            what = f"a camera of OpenSfM's type {str(kind)[:40]}"
            raise _unread(file, what, "use perspective, brown or fisheye")
        size = width, height = node["width"], node["height"]
        longer, fisheye = max(size), kind.startswith("fisheye")
        fx, fy = (longer * node.get(f"focal_{axis}", node.get("focal")) for axis in "xy")
        cx = longer * node.get("c_x", 0.0) + width / 2 - 0.5
        cy = longer * node.get("c_y", 0.0) + height / 2 - 0.5
        lens = [node.get(key, 0.0) for key in (KANNALA if fisheye else BROWN[:5])]
        model = "fisheye" if fisheye else "plumb_bob"
        cameras[name] = _lens((fx, fy, cx, cy), lens, size, distortion_model=model)
    return cameras


PROGRAMS: Mapping[str, Program] = {
    "zed": Program(
        "ZED",
        "`SN*.conf`",
        r"^\[(LEFT|RIGHT)_CAM_\w+\]",
        _zed,
        no_pose="the directions of a ZED's rotation and translation are not documented",
        note="lenses for several resolutions: taken by the size of the images",
    ),
    "oak": Program(
        "OAK (depthai)",
        "calibration JSON",
        r'"cameraData"\s*:',
        _oak,
        "world_from_camera",
        unit="cm",
        note="left and right are sockets 1 and 2; the pose leads to `toCameraSocket`",
    ),
    "calibio": Program(
        "calib.io", "project JSON", r'"ptr_wrapper"\s*:', _calib_io, "camera_from_world", unit="m"
    ),
    "viame": Program(
        "VIAME",
        "`camera_rig.json`",
        r'"fx_left"\s*:',
        lambda file: cameras_among(file.storage),
        "secondary_from_primary",
        lambda file: nodes_of_all(file.storage),
        unit="mm",
    ),
    "metashape": Program(
        "Metashape",
        "calibration XML",
        r"<projection>\w+</projection>",
        _metashape,
        no_pose="a lens of Metashape has no pose",
        one_camera=True,
        note="cx, cy from the images' middle; P1 and P2 are p2 and p1; k4 must be 0",
    ),
    "metashape-project": Program(
        "Metashape",
        "cameras XML",
        r"<sensors\b[^>]*>",
        _metashape,
        no_pose="Metashape's poses are those of single photographs",
        note="its sensors are the cameras",
    ),
    "euroc": Program(
        "EuRoC",
        "`sensor.yaml` of each camera",
        r"^T_BS:",
        _euroc,
        "world_from_camera",
        unit="m",
        one_camera=True,
    ),
    "orbslam3": Program(
        "ORB-SLAM3",
        "settings YAML",
        r"^(Camera1\.fx|LEFT\.(K|width|height)) *:",
        _orbslam,
        "primary_from_secondary",
        _orbslam_pair,
        unit="m",
        note="`Camera1.fx`, `Stereo.T_c1_c2`; or the older `LEFT.K`",
    ),
    "kitti": Program(
        "KITTI",
        "`calib_cam_to_cam.txt`, `calib.txt`",
        r"^(K_0\d|P0): *[-+.\d]",
        _kitti,
        "camera_from_world",
        unit="m",
        note="`calib.txt` is of rectified images, and does not state their size",
    ),
    "kalibr-results": Program(
        "Kalibr",
        "`results-cam.txt`",
        r"^\s*projection: \[[^\]]*\] \+- \[",
        _kalibr_results,
        no_pose="the pose of Kalibr is read of its camchain.yaml",
        note="it does not state the size of the images: `camchain.yaml` does",
    ),
    "openlpt": Program(
        "OpenLPT",
        "`cam1.txt`",
        r"^# *Camera Model: *\(",
        _openlpt,
        "camera_from_world",
        unit="mm",
        one_camera=True,
    ),
    "mrcal": Program(
        "mrcal",
        "`.cameramodel` of OpenCV's lens models",
        r"['\"]lensmodel['\"]\s*:",
        _mrcal,
        "camera_from_world",
        unit="m",
        one_camera=True,
        note="others: `mrcal-convert-lensmodel LENSMODEL_OPENCV8`",
    ),
    "vicon": Program(
        "Vicon",
        "`.xcp`",
        r"<Camera\b[^>]*\bDEVICEID=",
        _vicon,
        note="not read: its lens is of Vicon's own model",
    ),
    "opensfm": Program(
        "OpenSfM",
        "`camera_models.json`",
        r'"projection_type"\s*:',
        _opensfm,
        no_pose="camera_models.json has no poses",
    ),
}
