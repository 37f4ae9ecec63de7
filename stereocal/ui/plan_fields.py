"""The controls of the Plan page, and the plan that they state."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.errors import DAMAGED, StereocalError
from stereocal.field.planning.common_cameras import COMMON
from stereocal.field.planning.plan import (
    LARGEST_MM,
    SMALLEST_MM,
    AimedPose,
    Plan,
    SensorLens,
    Uncertainty,
)
from stereocal.formats.camera_file import read_camera, write_camera
from stereocal.formats.lens_model import FourCoefficientsError
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, Camera, CameraName, LensModel
from stereocal.rig.geometry import Pose
from stereocal.system.numbers import rounded
from stereocal.ui.fields import Field, Number, one_of, setting, yes_or_no
from stereocal.ui.intake import CAMERA_KINDS, clear_refusal, take_one
from stereocal.ui.messages import callback
from stereocal.ui.refusal import ask_lens

OTHER, FILE = "Other: sensor and pixels", "A camera file"
CHOICES = (*COMMON, OTHER, FILE)
_TENS = (1, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.8, 2, 2.2, 2.5, 2.8, 3, 3.5, 4, 4.5, 5, 5.5, 6, 7, 8, 9)
LENGTHS = tuple(float(f"{tens * 10.0**power:.3g}") for power in range(-2, 3) for tens in _TENS)
"""Steps of sliders of lengths in metres, 0.01 to 900."""
FRAMES = (5, 6, 8, 10, 12, 15, 20, 25, 30, 40, 50, 75, 100, 150, 200, 300, 500, 1000, 2000)
USUAL = Uncertainty()
POSITIVE = Number(0.0)
MM = Number(SMALLEST_MM, LARGEST_MM)
TOE_IN_DEG = (-10.0, 60.0)
LONGEST_NAME = 200
NAME = "plan_name"
TOE_IN, HIGHER = "Each camera turned in by (°)", "Secondary higher by (m)"
BAR, NOISE = "Bar: distance of the two targets (m)", "Noise of a target in the image (px)"
NOISES = "0.1 to 0.3 px for detected targets; 1 px or more for clicked points."


@dataclass(frozen=True)
class _Control:
    """The field of one number of the plan."""

    of: str
    """The attribute of the plan."""
    title: str
    usual: float
    bounds: Number = POSITIVE
    options: Sequence[float] = ()
    """Of a slider."""
    scale: float = 1
    """From the plan's unit to the field's."""
    step: float = 0.1
    help: str | None = None


_NUMBERS = {
    "baseline_m": _Control("stated_pose.baseline_m", "Baseline (m)", 4.5, options=LENGTHS),
    "toe_in_deg": _Control("stated_pose.toe_in_deg", TOE_IN, 10.0, Number(-80.0, 80.0)),
    "near_m": _Control("near_m", "Nearest, ahead of the primary camera (m)", 8.0, options=LENGTHS),
    "far_m": _Control("far_m", "Farthest (m)", 25.0, options=LENGTHS),
    "bar_m": _Control("bar_m", BAR, 0.9, Number(0.0, 1000.0), step=0.05),
    "frames": _Control("frames", "Frames of the bar", 25, Number(1), FRAMES),
    "noise_px": _Control("noise_px", NOISE, 0.2, Number(0.0, 20.0), step=0.05, help=NOISES),
    "focal_percent": _Control("uncertainty.focal", "Focal lengths, ± %", USUAL.focal, scale=100),
    "centre_px": _Control(
        "uncertainty.centre_px", "Image centres, ± px", USUAL.centre_px, step=1.0
    ),
    "baseline_mm": _Control(
        "uncertainty.baseline_m", "Baseline, ± mm", USUAL.baseline_m, scale=1000, step=1.0
    ),
    "bar_mm": _Control("uncertainty.bar_m", "Bar, ± mm", USUAL.bar_m, scale=1000),
    "height_m": _Control("stated_pose.height_difference_m", HIGHER, 0.0, Number(-1000.0, 1000.0)),
}
_SENSOR = {
    "width_mm": ("Sensor width (mm)", 23.5, MM),
    "height_mm": ("Sensor height (mm)", 15.6, MM),
    "width_px": ("Image width (px)", 6000, Number(1)),
    "height_px": ("Image height (px)", 4000, Number(1)),
}


def plan_controls(project: Project | None) -> Plan:
    """Draw the controls.

    Returns:
        The plan that they state.
    """
    cameras = _cameras(project)
    pose = _pose(project)
    near_m, far_m = _ask(project, st.columns(2), "near_m", "far_m")
    bar_m, frames, noise_px = _ask(project, st.columns(3), "bar_m", "frames", "noise_px")
    with st.expander("How well known, and heights"):
        names = ("focal_percent", "centre_px", "baseline_mm", "bar_mm", "height_m")
        *known, _ = _ask(project, st.columns(5), *names)
    name = str(name_field(project).value()) or "Plan"
    return Plan(
        name, *cameras, pose, near_m, far_m, bar_m, int(frames), noise_px, Uncertainty(*known)
    )


def _field(project: Project | None, name: str) -> Field:
    asked = _NUMBERS[name]
    return setting(project, f"plan_{name}", asked.scale * asked.usual, asked.bounds)


def _ask(project: Project | None, places: Sequence[DeltaGenerator], *names: str) -> list[Any]:
    """Draw fields beside each other; their values in the plan's units."""
    found = []
    for place, name in zip(places, names, strict=True):
        asked, own = _NUMBERS[name], _field(project, name)
        if asked.options:
            options = sorted({*asked.options, own.value()})
            found.append(place.select_slider(asked.title, options, **own.widget()))
        else:
            value = own.number_input(asked.title, place, step=asked.step, help=asked.help)
            found.append(value / asked.scale)
    return found


def name_field(project: Project | None) -> Field:
    """The name of the plan."""
    return setting(project, NAME, "Plan", str)


def _alike(project: Project | None) -> Field:
    return setting(project, "plan_alike", True, yes_or_no)


def _stated_pose(project: Project | None) -> Field:
    """R and T of a plan that states them; None for cameras that are aimed."""
    return setting(project, "plan_stated_pose", None, _pose_or_none)


def show_plan(project: Project | None, plan: Plan) -> None:
    """Set all controls to a plan."""
    pose = plan.stated_pose
    stated = None if isinstance(pose, AimedPose) else {"R": pose.R.tolist(), "T": pose.T.tolist()}
    name_field(project).set(plan.name)
    _alike(project).set(plan.stated_primary == plan.stated_secondary)
    _stated_pose(project).set(stated)
    for name, asked in _NUMBERS.items():
        if stated is None or not asked.of.startswith("stated_pose."):
            _field(project, name).set(asked.scale * attrgetter(asked.of)(plan))
    for which, camera in zip(CAMERAS, (plan.stated_primary, plan.stated_secondary), strict=True):
        _show_camera(project, which, camera)


def _show_camera(project: Project | None, which: CameraName, stated: Camera | SensorLens) -> None:
    known = (
        name
        for name, common in COMMON.items()
        if isinstance(stated, SensorLens) and common.lens(stated.focal_mm) == stated
    )
    choice = next(known, OTHER)
    # A sensor that is typed has the usual lens.
    if isinstance(stated, Camera) or (choice == OTHER and stated.model == "fisheye"):
        camera = stated if isinstance(stated, Camera) else stated.camera
        _file(project, which).set(write_camera(camera).decode())
        choice = FILE
    else:
        _focal(project, which, choice).set(stated.focal_mm)
        if choice == OTHER:
            sizes = (*stated.sensor_mm, *stated.image_size)
            for name, value in zip(_SENSOR, sizes, strict=True):
                _sensor(project, which, name).set(value)
    _choice(project, which).set(choice)


def _cameras(project: Project | None) -> tuple[Camera | SensorLens, Camera | SensorLens]:
    alike = _alike(project)
    one = "Both cameras" if alike.value() else "Primary camera, on the left"
    primary = _camera(project, "primary", one)
    st.toggle("Both cameras are alike", **alike.widget())
    if alike.value():
        return primary, primary
    return primary, _camera(project, "secondary", "Secondary camera, on the right")


def _camera(project: Project | None, which: CameraName, title: str) -> Camera | SensorLens:
    left, right = st.columns([3, 2], vertical_alignment="bottom")
    chosen = left.selectbox(title, CHOICES, **_choice(project, which).widget())
    if chosen == FILE:
        with right:
            return _from_file(project, which)
    focal = _focal(project, which, chosen).number_input(
        "Focal length (mm)", right, step=1.0, help="The lens's own, not the 35 mm equivalent."
    )
    if chosen != OTHER:
        return COMMON[chosen].lens(focal)
    width, height, across, down = (
        _sensor(project, which, name).number_input(_SENSOR[name][0], place)
        for name, place in zip(_SENSOR, st.columns(4), strict=True)
    )
    return SensorLens(focal, (width, height), (int(across), int(down)))


def _from_file(project: Project | None, which: CameraName) -> Camera:
    kept = _file(project, which)
    upload = st.file_uploader(
        f"Camera file, {which}", type=CAMERA_KINDS, key=f"upload_plan_{which}"
    )

    def take(name: str, content: bytes) -> None:
        ask_if_fisheye(
            lambda model: kept.set(write_camera(read_camera(content, name, model)).decode())
        )

    take_one(upload, take)
    if kept.value() is None:
        raise StereocalError(f"Give the file of the {which} camera, or choose a camera above.")
    camera = read_camera(str(kept.value()).encode(), f"{which} camera")
    width, height = camera.image_size
    st.caption(f"In use: {width} x {height} px, focal length {rounded(camera.K[0, 0], 5)} px")
    return camera


def ask_if_fisheye(
    take: Callable[[LensModel | None], None], model: LensModel | None = None
) -> None:
    """Take an upload; if a camera in it may be a fisheye's, ask, and take it as what it is."""
    try:
        take(model)
    except FourCoefficientsError as error:
        ask_lens(error, lambda known: callback(ask_if_fisheye)(take, known))
    else:
        clear_refusal()


def _pose(project: Project | None) -> Pose | AimedPose:
    stated = _stated_pose(project)
    if stated.value() is not None:
        pose = _pose_of(stated.value())
        left, right = st.columns([3, 2], vertical_alignment="center")
        left.markdown(
            f"Pose of the cameras: R and T of the plan, baseline {rounded(pose.baseline, 4)} m."
        )
        right.button(
            "State baseline and toe-in instead",
            key="plan_aim",
            on_click=callback(stated.set),
            args=(None,),
        )
        return pose
    left, right = st.columns(2)
    (baseline_m,) = _ask(project, [left], "baseline_m")
    turned = _field(project, "toe_in_deg")
    toe = right.slider(
        TOE_IN,
        min(TOE_IN_DEG[0], turned.value()),
        max(TOE_IN_DEG[1], turned.value()),
        step=0.5,
        help="From parallel. Both optical axes then meet in front of the middle of the baseline.",
        **turned.widget(),
    )
    return AimedPose(baseline_m, toe, _field(project, "height_m").value())


def _choice(project: Project | None, which: CameraName) -> Field:
    return setting(project, f"plan_{which}_camera", CHOICES[0], one_of(CHOICES))


def _focal(project: Project | None, which: CameraName, camera: str) -> Field:
    """Each camera of the list keeps its own focal length."""
    usual = COMMON[camera].focal_mm if camera in COMMON else 50.0
    name = f"plan_{which}_focal_{camera}"
    return setting(project, f"plan_{which}_focal", usual, MM, name=name)


def _sensor(project: Project | None, which: CameraName, name: str) -> Field:
    _, usual, bounds = _SENSOR[name]
    return setting(project, f"plan_{which}_{name}", usual, bounds)


def _file(project: Project | None, which: CameraName) -> Field:
    """The text of the camera file."""
    return setting(project, f"plan_{which}_file", None, lambda text: text and str(text))


def _pose_or_none(value: Any) -> Any:
    try:
        return None if value is None else _pose_of(value) and value
    except DAMAGED as error:
        raise ValueError(value) from error


def _pose_of(value: Mapping[str, Any]) -> Pose:
    return Pose(*(np.array(value[key], dtype=np.float64) for key in ("R", "T")))
