"""The file of a plan, `stereocal-plan/1`: JSON, camera files beside it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from stereocal.errors import StereocalError, naming
from stereocal.field.planning.plan import AimedPose, Plan, SensorLens, Uncertainty
from stereocal.formats.camera_file import CAMERA_FORMAT, read_camera, write_camera
from stereocal.rig.camera import CAMERAS, Camera, LensModel
from stereocal.rig.geometry import Pose
from stereocal.system.json_text import read_json

PLAN_FORMAT = "stereocal-plan/1"
LARGEST_BYTES = 4_000_000
LONGEST_NAME = 200
LENS = "a camera file, or an object with focal_mm, sensor_mm [w, h] and image_size [w, h]"


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
        return _content(path.parent / beside)

    return parse_plan(_content(path), str(path), file_beside, lens_model)


def parse_plan(
    content: bytes,
    source: str,
    file_beside: Callable[[str], bytes],
    lens_model: LensModel | None = None,
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
    cameras = _object(data, "cameras", source)
    volume = _object(data, "volume", source)
    stated = _object(data, "uncertainty", source)

    def camera(which: str) -> Camera | SensorLens:
        return _camera(cameras, which, source, file_beside, lens_model)

    frames = _number(data, "frames", source)
    if frames != int(frames):
        raise StereocalError(f"{source}: frames is {frames:g}; it must be a whole number.")
    primary, secondary, pose = camera("primary"), camera("secondary"), _pose(data, source)
    near_m, far_m = (_number(volume, key, f"{source}: volume") for key in ("near_m", "far_m"))
    bar_m, noise_px = (_number(data, key, source) for key in ("bar_m", "noise_px"))
    errors = {
        key: _number(stated, key, f"{source}: uncertainty")
        for key in ("focal", "centre_px", "baseline_m", "bar_m")
    }
    with naming(source):
        return Plan(
            name=str(data.get("name") or Path(source).stem)[:LONGEST_NAME],
            stated_primary=primary,
            stated_secondary=secondary,
            stated_pose=pose,
            near_m=near_m,
            far_m=far_m,
            bar_m=bar_m,
            frames=int(frames),
            noise_px=noise_px,
            uncertainty=Uncertainty(**errors),
        )


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
        **(
            {"pose": _named(pose, "baseline_m", "toe_in_deg", "height_difference_m")}
            if isinstance(pose, AimedPose)
            else {"R": pose.R.tolist(), "T": pose.T.tolist()}
        ),
        "volume": {"near_m": plan.near_m, "far_m": plan.far_m},
        "bar_m": plan.bar_m,
        "frames": plan.frames,
        "noise_px": plan.noise_px,
        "uncertainty": _named(plan.uncertainty, "focal", "centre_px", "baseline_m", "bar_m"),
    }
    return (json.dumps(content, indent=2, ensure_ascii=False) + "\n").encode()


def _named(of: object, *names: str) -> dict[str, Any]:
    """Some attributes of an object, by name."""
    return {name: getattr(of, name) for name in names}


def _camera_entry(stated: Camera | SensorLens) -> dict[str, Any]:
    if isinstance(stated, SensorLens):
        return {
            "focal_mm": stated.focal_mm,
            "sensor_mm": list(stated.sensor_mm),
            "image_size": list(stated.image_size),
            **({"model": stated.model} if stated.model != "brown" else {}),
        }
    entry: dict[str, Any] = json.loads(write_camera(stated))
    return entry


def _camera(
    cameras: Mapping[str, Any],
    which: str,
    source: str,
    file_beside: Callable[[str], bytes],
    lens_model: LensModel | None,
) -> Camera | SensorLens:
    if which not in CAMERAS or which not in cameras:
        raise StereocalError(f'{source}: "cameras" has no "{which}"; state {LENS}.')
    entry, where = cameras[which], f"{source}: {which}"
    if isinstance(entry, str):
        return read_camera(file_beside(entry), f"{source}: {entry}", lens_model)
    if not isinstance(entry, dict):
        raise StereocalError(f"{where}: this is not a camera; state {LENS}.")
    if "format" in entry:
        if entry["format"] != CAMERA_FORMAT:
            raise StereocalError(f'{where}: this version reads "{CAMERA_FORMAT}" only.')
        return Camera.from_json(entry, where)
    width, height = _two(entry, "image_size", where)
    if width != int(width) or height != int(height):
        raise StereocalError(f"{where}: image_size must be two whole numbers of pixels.")
    sensor, focal = _two(entry, "sensor_mm", where), _number(entry, "focal_mm", where)
    with naming(where):
        return SensorLens(focal, sensor, (int(width), int(height)), entry.get("model", "brown"))


def _pose(data: Mapping[str, Any], source: str) -> Pose | AimedPose:
    if ("pose" in data) == ("R" in data or "T" in data):
        raise StereocalError(
            f'{source}: state either "R" and "T", or "pose" with baseline_m, toe_in_deg and '
            "height_difference_m."
        )
    if "pose" in data:
        stated, where = _object(data, "pose", source), f"{source}: pose"
        baseline, toe_in = (_number(stated, key, where) for key in ("baseline_m", "toe_in_deg"))
        height = _number(stated, "height_difference_m", where) if len(stated) > 2 else 0.0
        with naming(source):
            return AimedPose(baseline, toe_in, height)
    try:
        R, T = (np.array(data[key], dtype=np.float64) for key in ("R", "T"))
    except (KeyError, TypeError, ValueError) as error:
        raise StereocalError(
            f"{source}: R must be 3 rows of 3 numbers, and T 3 numbers in metres."
        ) from error
    with naming(source):
        return Pose(R, T)


def _object(data: Mapping[str, Any], key: str, source: str) -> Mapping[str, Any]:
    value = data.get(key)
    if not isinstance(value, dict):
        what = "is missing" if key not in data else "is not an object"
        raise StereocalError(f'{source}: "{key}" {what}.')
    return value


def _number(data: Mapping[str, Any], key: str, where: str) -> float:
    """A finite number."""
    if key not in data:
        raise StereocalError(f"{where}: {key} is missing.")
    value = data[key]
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e300:
        raise StereocalError(f"{where}: {key} is {value!r}; it must be a number.")
    return float(value)


def _two(data: Mapping[str, Any], key: str, where: str) -> tuple[float, float]:
    value = data.get(key)
    if not isinstance(value, list) or len(value) != 2:
        what = "is missing" if key not in data else "is not two numbers"
        raise StereocalError(f"{where}: {key} {what}; write [width, height].")
    pair = dict(enumerate(value))
    first, second = (_number({key: pair[i]}, key, where) for i in (0, 1))
    return first, second


def _content(path: Path) -> bytes:
    try:
        if not path.is_file():  # a pipe would never end
            raise StereocalError(f"{path}: there is no such file.")
        if path.stat().st_size > LARGEST_BYTES:
            raise StereocalError(f"{path}: the file is too large for a plan or a camera.")
        return path.read_bytes()
    except OSError as error:
        raise StereocalError(
            f"{path}: the file cannot be read ({error.strerror or error})."
        ) from error
