"""Every reader of strangers' files, with sound files to begin from: what is fuzzed, and how.

A reader takes the bytes of one file and a scratch folder. It may return, or raise `StereocalError`;
anything else is a bug.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import ZIP_STORED

import numpy as np

from stereocal.errors import StereocalError
from stereocal.field.world.find import find_world
from stereocal.formats.archives.easywand import EasyWandFile, read_easywand
from stereocal.formats.archives.gather import bars_of, gather
from stereocal.formats.camera_file import read_camera, write_camera, write_opencv_camera
from stereocal.formats.column_roles import column_titles
from stereocal.formats.correspondences_csv import read_table
from stereocal.formats.dataset_files import parse_recording, parse_zip, read_dataset
from stereocal.formats.exchange.exchange import export_files, import_files
from stereocal.formats.exchange.matlab import stereo_of
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.other_files import is_hdf5
from stereocal.formats.plan_file import parse_plan, write_plan
from stereocal.formats.point_answers import answered, first_answers, layout_by_hand, layout_of
from stereocal.formats.point_files import read_points
from stereocal.formats.point_layouts import first_rows
from stereocal.formats.recognition import recognise
from stereocal.formats.sleap_analysis import analysis_table
from stereocal.formats.world_file import read_observed, read_world
from stereocal.matching.point_table import PointTable
from stereocal.projects.project import Project
from stereocal.projects.server_settings import ServerSettings
from stereocal.rig.parameters import RigParameters
from stereocal.system.json_text import read_json
from stereocal.system.limits import Limits
from stereocal.system.photograph import read_photograph
from stereocal.system.photograph_files import unpack_photographs
from stereocal.ui.picker import pick_of
from tests.archives import (
    caliscope_files,
    case,
    easywand_fields,
    kalibr_chain,
    stereo_struct,
    wand_csv,
)
from tests.field.plans import FIELD as FIELD_PLAN
from tests.field.plans import contents, plan
from tests.files import zipped
from tests.formats.test_exchange import RICHEST
from tests.formats.test_formats import NODES, with_storage
from tests.hostile_projects import FILES, dataset_zip, project_zip, read_inner, read_project_zip
from tests.rigs.known_rig import PRIMARY, RIG, SECONDARY
from tests.soak import seeds

Read = Callable[[bytes, Path], object]
Seeds = Callable[[], Sequence[bytes]]
KNOWN = RigParameters(PRIMARY, SECONDARY, RIG, "2d", 1.0, {}, {}, noise_px=0.3)


class Reader(NamedTuple):
    """One reader, or one kind of file of it."""

    kind: str
    """How its files are changed: a key of `damage.CHANGES`."""
    seeds: Seeds
    read: Read


@cache
def readers() -> dict[str, Reader]:
    """All readers by name."""
    return {
        name: Reader(*how) for name, how in {**_tables(), **_descriptions(), **_others()}.items()
    }


def these(*contents: bytes) -> Seeds:
    return lambda: contents


def _tables() -> dict[str, tuple[str, Seeds, Read]]:
    def world(content: bytes, _: Path) -> object:
        return find_world(KNOWN, read_observed(content, "o.csv", frame_rate=100.0))

    return {
        **{f"points, {name}": ("text", these(*x), _points) for name, x in seeds.layouts().items()},
        "correspondences.csv": (
            "text",
            these(*seeds.correspondences()),
            lambda content, _: read_table(content, "a.csv").strict("a.csv"),
        ),
        "table of points": ("text", seeds.points, partial(_table, "t.csv")),
        "world, table": ("text", these(seeds.world("", "")), _on_disk(read_world, "w.csv")),
        **{f"world from {x}": ("text", these(own), world) for x, own in seeds.observed().items()},
        "Parquet": ("image", seeds.parquet, partial(_table, "t.parquet")),
        "points, HDF5": ("image", seeds.sleap, _hdf5),
    }


def _descriptions() -> dict[str, tuple[str, Seeds, Read]]:
    ours = these(write_camera(PRIMARY), seeds.uncertain_camera())
    rigs = these(*(rig.dumps().encode() for rig in list(RICHEST.values())[:3]))
    opencv = {**NODES, "distortion_coefficients": PRIMARY.distortion[None].copy()}
    worlds = these(seeds.world("[", "]"), seeds.world_json())
    files = {
        (name, file): x for name in RICHEST for file, x in export_files(RICHEST[name], name).items()
    }
    return {
        "camera, OpenCV YAML": ("text", these(write_opencv_camera(PRIMARY)), _camera),
        "camera, OpenCV XML": ("text", these(with_storage(".xml", **opencv)), _camera),
        "archive, Kalibr": ("text", these(kalibr_chain()), partial(_archive, "c.yaml")),
        **{
            f"cameras, {name}": (
                "json" if name.endswith(".json") else "text",
                these(*case(folder, name).values()),
                partial(_cameras, name),
            )
            for folder, name in DESCRIBED
        },
        "archive, TOML": ("text", caliscope_files, partial(_archive, "c.toml")),
        "camera, ours": ("json", ours, _camera),
        "camera, OpenCV JSON": ("json", these(with_storage(".json", **opencv)), _camera),
        "world, JSON": ("json", worlds, _on_disk(read_world, "w.json")),
        "parameters": ("json", rigs, _parameters),
        "dataset.json": (
            "json",
            these(seeds.field()["dataset.json"]),
            lambda content, _: parse_recording({**seeds.field(), "dataset.json": content}, "a"),
        ),
        "plan": ("json", _plans, _plan),
        "archive, fields of easyWand": (
            "json",
            these(_packed_fields(easywand_fields())),
            _easywand,
        ),
        "archive, fields of MATLAB": (
            "json",
            these(_packed_fields(stereo_struct())),
            lambda content, _: stereo_of({"s": _fields_of(content)}, "a.mat", ExchangeOptions()),
        ),
        **{
            f"{name}, {file}": (
                "json" if file.endswith(".json") else "text",
                these(x),
                partial(_exchange, name, file),
            )
            for (name, file), x in files.items()
        },
    }


def _others() -> dict[str, tuple[str, Seeds, Read]]:
    two = zipped({f"cam{k}/1.png": seeds.image(".png") for k in (0, 1)}, ZIP_STORED)
    addresses = these(b"0" * 32, b"0123456789abcdef" * 2)

    def data_sets() -> list[bytes]:
        return [dataset_zip()]

    photograph = _on_disk(lambda path: read_photograph(path, "p.png"), "p.bin")
    return {
        **{
            f"project, {name}": (file.kind, file.seeds, _of_project(name))
            for name, file in FILES.items()
        },
        **{
            f"photograph, {name}": ("png" if name == "PNG" else "image", these(*x), photograph)
            for name, x in seeds.photographs().items()
        },
        "data set, zip": ("zip", data_sets, lambda content, _: parse_zip(content, "a.zip")),
        "data set, zip on disk": ("zip", data_sets, _on_disk(read_dataset, "a.zip")),
        "photographs, zip": ("zip", these(two), _photographs),
        "project, zip": ("zip", lambda: [project_zip()], read_project_zip),
        "address": (
            "text",
            addresses,
            lambda text, folder: Project.open(folder, text.decode("utf-8", "surrogateescape")),
        ),
        "click": ("json", these(b'{"id": "a", "u": 1.5, "v": 2, "raw": false}'), _click),
        "settings": ("text", these(b"1", b"90.5"), _settings),
    }


def _archive(name: str, content: bytes, _: Path) -> None:
    options = ExchangeOptions(cameras=("1", "3"), unit="m")
    gather({name: content, "wand.csv": wand_csv(5)}, options)


DESCRIBED = (
    *(("zed_conf", "SN0000.conf"), ("oak_json", "calib.json"), ("viame_json", "camera_rig.json")),
    *(("orbslam3_yaml", "rig.yaml"), ("slam_yaml", "cam0.yaml"), ("nested_json", "b.json")),
    *(("other_lenses", "left.cameramodel"), ("text_camera_files", "cam1.txt")),
    *(("text_camera_files", "calib_cam_to_cam.txt"), ("text_camera_files", "results-cam.txt")),
)


def _cameras(name: str, content: bytes, _: Path) -> None:
    options = ExchangeOptions(((1920, 1080), (1920, 1080)), lens_model="brown")
    recognise(name, content)
    gather({name: content}, options, baseline_known=True)


def _packed_fields(fields: dict[str, Any]) -> bytes:
    """Fields of a struct as JSON: of a damaged .mat file, SciPy may crash the process."""
    return json.dumps(fields, default=lambda array: array.tolist()).encode()


def _fields_of(content: bytes) -> dict[str, Any]:
    found = read_json(content, "a.mat")
    if not isinstance(found, dict):
        raise StereocalError("a.mat: no struct.")
    return {name: _field(value) for name, value in found.items()}


def _field(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _field(inner) for name, inner in value.items()}
    try:
        return np.array(value) if isinstance(value, list) else value
    except (ValueError, OverflowError):
        return "not numbers"


def _easywand(content: bytes, _: Path) -> None:
    file = EasyWandFile(_fields_of(content), "a.mat")
    read_easywand(file, ExchangeOptions()).dataset("a", 1.0, 1.0)


def _plans() -> list[bytes]:
    named = {"primary": "a.json", "secondary": contents()["cameras"]["secondary"]}
    known = plan(stated_primary=PRIMARY, stated_pose=FIELD_PLAN.pose)
    return [write_plan(FIELD_PLAN), write_plan(known), json.dumps(contents(cameras=named)).encode()]


def _plan(content: bytes, _: Path) -> None:
    parse_plan(content, "plan.json", lambda _: write_camera(PRIMARY))


def _exchange(name: str, file: str, content: bytes, _: Path) -> None:
    sizes = (PRIMARY.image_size, SECONDARY.image_size)
    options = ExchangeOptions(sizes, corner="lower-left", unit="m", lens_model="brown")
    files = {**export_files(RICHEST[name], name), file: content}
    refused: StereocalError | None = None
    for given in (options, ExchangeOptions()):
        try:
            import_files(files, name, given).dumps()
        except StereocalError as error:
            refused = error
    if refused is not None:
        raise refused


def _click(content: bytes, _: Path) -> None:
    try:
        pick_of(json.loads(content))
    except (ValueError, RecursionError):
        pick_of(content.decode("utf-8", "replace"))


def _settings(content: bytes, _: Path) -> None:
    text = content.decode("utf-8", "replace")
    ServerSettings.from_environment({"STEREOCAL_KEEP_DAYS": text})
    Limits.from_environment({"STEREOCAL_MOST_RATIO": text})


def _camera(content: bytes, _: Path) -> None:
    camera = read_camera(content, "camera")
    width, height = camera.image_size
    camera.undistort([[0.0, 0.0], [width / 2, height / 3]])
    write_camera(camera)


def _parameters(content: bytes, folder: Path) -> None:
    rig = RigParameters.load(_kept(content, folder / "p.json"))
    rig.dumps()
    rig.reprojection_errors([[100.0, 100.0]], [[110.0, 90.0]])
    rig.reconstruct([[100.0, 100.0]], [[110.0, 90.0]])


def _points(content: bytes, _: Path) -> None:
    """As the wizard does: what it looks like, the questions, a preview, and the whole."""
    layout = layout_of(content, "a.csv")
    refused, read = None, 0
    for proposed in (layout, layout_by_hand(content, "a.csv")):
        for which in (0, 1):
            answers = first_answers(proposed, which, 1024)
            try:
                width = len(column_titles(first_rows(content, "a.csv")[0]))
                if not proposed.columns:
                    answers = replace(answers, roles="frame,x,y" if width > 2 else "x,y")
                chosen = answered(proposed, answers, content, "a.csv")
                for rows in (5, None):
                    read_points(content, chosen, answers.camera, 1024, "a.csv", rows)
                    read += 1
            except StereocalError as error:
                refused = error
    if len(layout.cameras) > 1 and len(layout.points) > 1:
        bars_of(content, "a.csv", ExchangeOptions(corner="lower-left"), (1024, 1024))
    if refused and not read:
        raise refused


def _hdf5(content: bytes, folder: Path) -> None:
    # Without its process of its own, which takes a second to start.
    path = _kept(content, folder / "a.h5")
    _points(analysis_table(path, "a.h5") if is_hdf5(content) else content, folder)


def _table(name: str, content: bytes, folder: Path) -> None:
    table = PointTable(_kept(content, folder / name), ("u", "v"), name)
    table.check()
    for _, rows in table.frames():
        rows.to_csv(index=False)


def _photographs(content: bytes, folder: Path) -> None:
    for name, path in unpack_photographs(content, "a.zip", folder / "store").items():
        read_photograph(path, name)


def _of_project(name: str) -> Read:
    return lambda content, _: read_inner(name, content)


def _on_disk(read: Callable[[Path], object], name: str) -> Read:
    return lambda content, folder: read(_kept(content, folder / name))


def _kept(content: bytes, path: Path) -> Path:
    path.write_bytes(content)
    return path
