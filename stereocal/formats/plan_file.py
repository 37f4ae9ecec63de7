"""The file of a plan, `stereocal-plan/1`: JSON, camera files beside it."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, fields, make_dataclass
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar

import numpy as np

from stereocal.errors import StereocalError, naming
from stereocal.field.planning.plan import AimedPose, Plan, PlannedWindow, SensorLens, Uncertainty
from stereocal.formats.camera_file import CAMERA_FORMAT, read_camera, write_camera
from stereocal.rig.camera import CAMERAS, Camera, LensModel
from stereocal.rig.geometry import Pose
from stereocal.system.atomic_files import read_whole
from stereocal.system.json_text import read_json
from stereocal.system.names import label_of
from stereocal.system.records import of_plain

T = TypeVar("T")
FileBeside = Callable[[str], bytes]
PLAN_FORMAT = "stereocal-plan/1"
LARGEST_BYTES = 4_000_000
LENS = "a camera file, or an object with focal_mm, sensor_mm [w, h] and image_size [w, h]"


_Volume = make_dataclass("_Volume", [("near_m", float), ("far_m", float)])
_Recording = make_dataclass("_Recording", [("bar_m", float), ("frames", int), ("noise_px", float)])
_Needed = make_dataclass("_Needed", [("length_error", float)])


def read_plan(path: str | Path, lens_model: LensModel | None = None) -> Plan:
    """Read a plan; camera files are looked for beside it.

    Args:
        lens_model: meaning of four distortion coefficients if a camera file does not state it.
    """
    path = Path(path)

    def file_beside(name: str) -> bytes:
        # Of untrusted plans: no other file of the computer is read, nor quoted in a message.
        beside = PurePosixPath(name.replace("\\", "/"))
        if not name.isprintable() or beside.is_absolute() or ".." in beside.parts or ":" in name:
            raise StereocalError(
                f"{path}: the camera file {name!r} is not beside the plan; copy it there, and give "
                "its name."
            )
        if not (path.parent / beside).is_file():  # a pipe would never end
            raise StereocalError(f"{path.parent / beside}: there is no such file.")
        return read_whole(path.parent / beside, LARGEST_BYTES)

    return parse_plan(read_whole(path, LARGEST_BYTES), str(path), file_beside, lens_model)


def parse_plan(
    content: bytes, source: str, file_beside: FileBeside, lens_model: LensModel | None = None
) -> Plan:
    """A plan from the content of its file.

    Args:
        file_beside: the content of a camera file that the plan names.
    """
    if len(content) > LARGEST_BYTES:
        raise StereocalError(f"{source}: {len(content)} bytes are too many for a plan.")
    data = read_json(content, source)
    if not isinstance(data, dict) or data.get("format") != PLAN_FORMAT:
        raise StereocalError(f'{source}: a plan is a JSON object with "format": "{PLAN_FORMAT}".')
    cameras = data.get("cameras")
    if not isinstance(cameras, dict):
        raise StereocalError(f'{source}: "cameras" must name the primary and the secondary.')
    primary, secondary = (
        _camera(cameras.get(which), f"{source}: {which}", file_beside, lens_model)
        for which in CAMERAS
    )
    pose = _pose(data, source)
    volume: Any = _part(data.get("volume"), _Volume, f"{source}: volume")
    uncertainty = _part(data.get("uncertainty"), Uncertainty, f"{source}: uncertainty")
    recording: Any = _part(data, _Recording, source)
    needed: Any = None
    if "needed" in data:
        needed = _part(data["needed"], _Needed, f"{source}: needed").length_error
    window: PlannedWindow | None = None
    if "window" in data:
        usual = ("thickness_m", "medium", "glass", "normal")
        window = _part(data["window"], PlannedWindow, f"{source}: window", usual)
    name = label_of(str(data.get("name") or Path(source).stem))
    stated = {**vars(volume), **vars(recording), "uncertainty": uncertainty, "needed": needed}
    with naming(source):
        return Plan(name, primary, secondary, pose, window=window, **stated)


def write_plan(plan: Plan) -> bytes:
    """The file of a plan, read back exactly by `parse_plan`.

    A calibrated camera is written into the plan as the content of its camera file, so that a plan
    is one file.
    """
    pose = plan.stated_pose
    content = {
        "format": PLAN_FORMAT,
        "name": plan.name,
        "cameras": {
            "primary": _camera_entry(plan.stated_primary),
            "secondary": _camera_entry(plan.stated_secondary),
        },
        **({"pose": asdict(pose)} if isinstance(pose, AimedPose) else pose.to_json()),
        "volume": {"near_m": plan.near_m, "far_m": plan.far_m},
        "bar_m": plan.bar_m,
        "frames": plan.frames,
        "noise_px": plan.noise_px,
        "uncertainty": asdict(plan.uncertainty),
        **({} if plan.needed is None else {"needed": {"length_error": plan.needed}}),
        **({} if plan.window is None else {"window": _given(asdict(plan.window))}),
    }
    return (json.dumps(content, indent=2, ensure_ascii=False) + "\n").encode()


def _given(entry: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in entry.items() if value is not None}


def _camera_entry(stated: Camera | SensorLens) -> dict[str, Any]:
    if isinstance(stated, SensorLens):
        usual = {"model"} if stated.model == "brown" else set()
        return {name: value for name, value in asdict(stated).items() if name not in usual}
    entry: dict[str, Any] = json.loads(write_camera(stated))
    return entry


def _camera(
    entry: Any, where: str, file_beside: FileBeside, lens_model: LensModel | None
) -> Camera | SensorLens:
    if isinstance(entry, str):
        return read_camera(file_beside(entry), f"{where}: {entry}", lens_model)
    if not isinstance(entry, dict) or entry.get("format", CAMERA_FORMAT) != CAMERA_FORMAT:
        raise StereocalError(f'{where}: this is not a camera; state {LENS}, or "{CAMERA_FORMAT}".')
    if "format" in entry:
        return Camera.from_json(entry, where)
    return _part(entry, SensorLens, where, ("model",))


def _pose(data: Mapping[str, Any], source: str) -> Pose | AimedPose:
    if ("pose" in data) == ("R" in data or "T" in data):
        raise StereocalError(
            f'{source}: state either "R" and "T", or "pose" with baseline_m, toe_in_deg and '
            "height_difference_m."
        )
    if "pose" in data:
        return _part(data["pose"], AimedPose, f"{source}: pose", ("height_difference_m",))
    try:
        R, T = (np.array(data[key], dtype=np.float64) for key in ("R", "T"))
    except (KeyError, TypeError, ValueError) as error:
        raise StereocalError(
            f"{source}: R must be 3 rows of 3 numbers, and T 3 numbers in metres."
        ) from error
    with naming(source):
        return Pose.nearest(R, T)  # written by hand


def _part(entry: Any, kind: type[T], where: str, optional: tuple[str, ...] = ()) -> T:
    """An object with all fields of a dataclass but the optional ones."""
    if not isinstance(entry, dict):
        raise StereocalError(f"{where}: it is missing, or not an object.")
    names = [entry_field.name for entry_field in fields(kind)]  # type: ignore[arg-type]
    if missing := [name for name in names if name not in entry and name not in optional]:
        raise StereocalError(f"{where}: {missing[0]} is missing.")
    entries = {
        name: int(value) if isinstance(value, float) and value.is_integer() else value
        for name, value in entry.items()
    }
    try:
        return of_plain(entries, kind)
    except ValueError as error:
        reason = str(error) if isinstance(error, StereocalError) else f"{error}."
        raise StereocalError(reason, where) from error
