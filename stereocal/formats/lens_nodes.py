"""Lenses and poses among the nodes of a file, by the names that programs and scripts give them."""

import re
from collections.abc import Iterator
from itertools import islice
from typing import Any

from stereocal.errors import StereocalError, naming
from stereocal.formats.file_storage import Storage, find_node, is_numeric, plain_name, with_matrices
from stereocal.system.names import word_list

K_NAMES = word_list("camera_matrix K M k mtx intrinsic_matrix")
DISTORTION_NAMES = word_list(
    "distortion_coefficients dist_coeffs dist_coeff dist_coefs distortion_coeffs distortion dist D "
    "d"
)
SIZE_NAMES = word_list(
    "image_size camera_resolution resolution image_resolution frame_size img_size size"
)
WIDTH_NAMES = word_list("image_width img_width frame_width width")
HEIGHT_NAMES = word_list("image_height img_height frame_height height")
"""Names that `find_node` looks for; `k` and `d` are of ROS 2."""
MORE_K = word_list(
    "CM A KK intrinsics intrinsic intrinsic_mat cam_mtx cam_matrix camera_mat cam_mat camera_mtx "
    "camera_intrinsics matrix mat int_mat"
)
"""Of 9 numbers, or of 4: fx fy cx cy."""
MORE_D = word_list(
    "k kc distortions distortion_coefs distortion_coef distortion_coeff distortion_params "
    "distortion_parameters distortion_vector dist_coef dist_vec dists dst coeffs coefficients"
)
"""Of any other number of them."""
_PLAIN_K = tuple(map(plain_name, (*K_NAMES, *MORE_K)))
_PLAIN_D = tuple(map(plain_name, (*DISTORTION_NAMES, *MORE_D)))
R_NAMES = word_list(
    "R rotation rotation_matrix Rot rot_mat rot_matrix om rvec R_mat R_stereo stereo_R "
    "stereo_rotation rotation_vector"
)
T_NAMES = word_list(
    "T translation translation_vector Trans trans_vec tvec t T_stereo stereo_T stereo_translation "
    "trans_vector"
)
UNIT_NAMES = word_list("unit units length_unit length_units world_units distance_units")
ONE_BY_ONE = word_list("fx fy cx cy k1 k2 k3 k4 k5 k6 p1 p2")
MODEL_NAMES = word_list("distortion_model model fisheye_model")
OF_BOTH = {*map(plain_name, (*SIZE_NAMES, *WIDTH_NAMES, *HEIGHT_NAMES, *MODEL_NAMES))}
_KNOWN = OF_BOTH | {
    *map(plain_name, (*K_NAMES, *DISTORTION_NAMES, *MORE_K, *MORE_D, *R_NAMES, *T_NAMES)),
    *map(plain_name, (*ONE_BY_ONE, *UNIT_NAMES)),
}
_CONTAINERS = word_list(
    "intrinsics intrinsic distortion camera cameras cameraparameters data parameters params "
    "calibration calib resolution imagesize image size model extrinsics extrinsic stereo "
    "stereoparams stereocalibration pose transform lens lenses result results coefficients "
    "stereorectifier"
)
"""Nodes that name no camera."""
_CAMERA, _WORD, _BETWEEN = r"cam(?:era)?[\s_.-]*", "left|right|primary|secondary", r"[\s_.-]"
_ALONE = re.compile(rf"(?:{_CAMERA})?({_WORD}|[lrab]|\d{{1,2}})", re.IGNORECASE)
_SIDED = tuple(
    re.compile(pattern, re.IGNORECASE)
    for pattern in (
        rf"(?P<base>.+?){_BETWEEN}*(?:{_CAMERA})?(?P<side>{_WORD}|[lr]|\d{{1,2}})",
        rf"(?P<side>{_WORD}){_BETWEEN}*(?P<base>.+)",
        rf"(?:{_CAMERA}(?P<side>\d{{1,2}}|[ab](?={_BETWEEN})){_BETWEEN}*)(?P<base>.+)",
        rf"(?P<side>[lr]|\d{{1,2}}){_BETWEEN}+(?P<base>.+)",
        rf"(?P<base>[a-z]+){_BETWEEN}+(?P<side>{_WORD}|[lr]|\d){_BETWEEN}+(?P<rest>.+)",
    )
)
_SIDES = {"l": "left", "r": "right"}
_ORDER = ("left", "primary", "right", "secondary")
_DEEPEST, _MOST_NODES, _LONGEST_KEY = 10, 1_000, 80
"""Far more than files of cameras have; a key is matched in a time that grows with its square."""

USUAL = word_list(
    "plumb_bob rational_polynomial rational thin_prism tilted brown brown_conrady radtan radtan5 "
    "radtan8 radial_tangential pinhole perspective opencv opencv4 opencv5 opencv8 full_opencv"
)
FISHEYE = word_list("equidistant equi kannala_brandt kannala_brandt4 kb4 fisheye opencv_fisheye")


def cameras_among(tree: Storage) -> dict[str, Storage]:
    """The nodes of each camera by its name, `left` and `0` before `right` and `1`; empty where
    there are none beside those of the whole file.

    A name is what all names of a camera's nodes share, before, behind or around the node's own:
    `K1`, `mtx_left`, `Camera1.fx`, `{"left": {"K": ...}}`, `{"K": {"left": ...}}`.
    """
    groups = _groups(tree)
    shared = {key: node for key, node in groups.pop("", {}).items() if plain_name(key) in OF_BOTH}
    cameras = {name: {**shared, **nodes} for name, nodes in groups.items() if _has_lens(nodes)}
    return dict(sorted(cameras.items(), key=lambda item: _rank(item[0])))


def has_matrix(tree: Storage) -> bool:
    """Whether a file has a matrix of its own, and not one for each camera, under K's names."""
    node = find_node(tree, K_NAMES)
    if isinstance(node, dict):
        return bool({"data", "rows", "cols"} & node.keys())
    return node is not None


def has_one_lens(tree: Storage) -> bool:
    """Whether there is the lens of one camera, of the whole file or of a part without a name."""
    return _has_lens(tree) or _has_lens(nodes_of_all(tree)) or len(cameras_among(tree)) == 1


def nodes_of_all(tree: Storage) -> Storage:
    """The nodes that are no single camera's, such as R and T of a pair."""
    return _groups(tree).get("", {})


def _has_lens(nodes: Storage) -> bool:
    return count(as_lens(nodes).get("camera_matrix")) == 9


def _rank(name: str) -> tuple[int, int]:
    if name.isdecimal():
        return 0, int(name)
    return (0, _ORDER.index(name)) if name in _ORDER else (1, 0)


def _groups(tree: Storage) -> dict[str, dict[str, Any]]:
    """The known nodes by camera; those of none by an empty name."""
    placed = [*filter(None, map(_placed, islice(_leaves(tree), _MOST_NODES)))]
    # Two of a name, as of several resolutions, are told apart by all that is around them.
    once = len({(side, base) for side, _, base, _ in placed}) == len(placed)
    groups: dict[str, dict[str, Any]] = {}
    for side, around, base, node in placed:
        groups.setdefault(side if once else around, {})[base] = node
    return groups


def _leaves(node: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    if len(path) > _DEEPEST:
        return
    if isinstance(node, dict) and not isinstance(node.get("data"), list):
        items = [(str(key), value) for key, value in node.items()]
    elif isinstance(node, list) and any(isinstance(item, dict) for item in node[:2]):
        items = [(_name_of(item, k), item) for k, item in enumerate(node)]
    else:
        yield path, node
        return
    for key, value in items:  # LEFT.K, Camera.width
        yield from _leaves(value, (*path, *key[:_LONGEST_KEY].split(".")))


def _name_of(item: Any, k: int) -> str:
    stated = find_node(item, ("name", "id", "label")) if isinstance(item, dict) else None
    return stated if isinstance(stated, str) and stated else str(k)


def _placed(leaf: tuple[tuple[str, ...], Any]) -> tuple[str, str, str, Any] | None:
    """The camera of a node, its name with all around it, the node's own name, and the node."""
    (*parents, key), node = leaf
    side = ""
    # k1 is a coefficient, or all those of camera 1.
    if plain_name(key) not in _KNOWN or (key in ONE_BY_ONE and count(node) > 1):
        base, side = _split(key)
        if not base and parents and plain_name(parents[-1]) in _KNOWN and _ALONE.fullmatch(key):
            base, side = parents.pop(), key  # {"K": {"left": ...}}
        if not base:
            return None
        key = base
    words = [part for part in (*parents, side) if part and plain_name(part) not in _CONTAINERS]
    sides = [match[1].lower() for word in words if (match := _ALONE.fullmatch(word))]
    around = ".".join(words)
    if not sides:
        return around, around, key, node
    side = _SIDES.get(sides[-1], sides[-1])
    return str(int(side)) if side.isdecimal() else side, around, key, node


def _split(key: str) -> tuple[str, str]:
    """The known name in a key with that of a camera, and the camera's; empty if it is none."""
    for pattern in _SIDED if len(key) <= _LONGEST_KEY else ():
        if match := pattern.fullmatch(key):
            parts = match.groupdict()
            base = "_".join(filter(None, (parts["base"], parts.get("rest"))))
            if plain_name(base) in _KNOWN:
                return base, parts["side"]
    return "", ""


def count(node: Any) -> int:
    """The number of numbers in a node."""
    data = node.get("data") if isinstance(node, dict) else node
    if not isinstance(data, list):
        return 0
    return sum(len(row) if isinstance(row, list) else is_numeric(row) for row in data)


def as_lens(nodes: Storage) -> Storage:
    """The nodes of a camera, with K as `camera_matrix` and the distortion as
    `distortion_coefficients` where they have another known name.

    Short names mean either, as `k` does: K has 9 numbers.
    """
    nodes = with_matrices(nodes)
    plain = {plain_name(key): node for key, node in nodes.items()}
    named = [plain.get(name) for name in _PLAIN_K]
    K = next((node for node in named if count(node) == 9), None)
    if K is None and (four := next((node for node in named if count(node) == 4), None)) is not None:
        values = four["data"] if isinstance(four, dict) else four
        fx, fy, cx, cy = values[0] if isinstance(values[0], list) else values
        K = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
    D = (plain.get(name) for name in _PLAIN_D)
    lens = next((node for node in D if node is not None and count(node) != 9), None)
    found = {"camera_matrix": K, "distortion_coefficients": lens}
    return {**nodes, **{key: node for key, node in found.items() if node is not None}}


def what_is_in(tree: Storage) -> str:
    """What a file holds that is not known, for an error."""
    keys = ", ".join(key[:40] for key in [*tree][:12]) or "none"
    more = f" and {len(tree) - 12} more" if len(tree) > 12 else ""
    stated = {**nodes_of_all(tree), **next(iter(cameras_among(tree).values()), {})}
    sizes = (*SIZE_NAMES, *WIDTH_NAMES)
    return f"keys: {keys}{more}{'; no image size' * (find_node(stated, sizes) is None)}"


def stated_lens_model(storage: Storage, source: str) -> bool | None:
    """Whether the lens in a file is stated to be a fisheye; None if the file does not state it."""
    for key in ("distortion_model", "model"):
        stated = find_node(storage, [key])
        name = plain_name(stated) if isinstance(stated, str) else ""
        if name in map(plain_name, FISHEYE + USUAL):
            return name in map(plain_name, FISHEYE)
        if key != "model" and name not in ("", "none"):  # a model may be that of the camera
            raise StereocalError(
                f"{source}: the lens model {str(stated)[:40]} is not supported; use plumb_bob, "
                "rational_polynomial or equidistant."
            )
    fisheye = find_node(storage, ["fisheye_model"])  # of OpenCV's calibration program
    return bool(fisheye) if isinstance(fisheye, int) else None


def image_size_in(storage: Storage, source: str) -> tuple[int, int] | None:
    """Width and height in a file; None if it does not state them."""
    names = WIDTH_NAMES, HEIGHT_NAMES, SIZE_NAMES
    width, height, size = (find_node(storage, keys) for keys in names)
    if width is not None and height is not None:
        size = [width, height]
    if isinstance(size, dict):
        size = size.get("data") or [find_node(size, keys) for keys in names[:2]]
    if isinstance(size, str):
        size = [int(side) for side in re.findall(r"\d{1,9}", size)]
    if size is None:
        return None
    if not isinstance(size, list) or len(size) != 2 or not all(map(is_numeric, size)):
        raise StereocalError(
            f"{source}: the image size, {str(size)[:60]}, is not a number for each side."
        )
    with naming(source):
        return _whole(size[0]), _whole(size[1])


def _whole(side: float) -> int:
    if not abs(side) < 1e9:  # rejects NaN too
        raise StereocalError(f"the image size has a side of {side:g} px.")
    return int(side)
