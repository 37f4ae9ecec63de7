"""The controls of the Plan page, and the plan that they state."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter
from typing import Any

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.errors import DAMAGED, StereocalError
from stereocal.field.planning.common_cameras import COMMON
from stereocal.field.planning.plan import (
    LARGEST_MM,
    SMALLEST_MM,
    AimedPose,
    Plan,
    PlannedWindow,
    SensorLens,
    Uncertainty,
)
from stereocal.formats.camera_file import read_camera, write_camera
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, Camera, CameraName
from stereocal.rig.geometry import Pose
from stereocal.rig.window import GLASS, LARGEST_INDEX, SMALLEST_INDEX, WATER
from stereocal.system.numbers import rounded
from stereocal.ui.fields import Field, Fit, Number, one_of, setting, yes_or_no
from stereocal.ui.intake import CAMERA_KINDS, take_one
from stereocal.ui.messages import ask_about_lens, show_with_button

OTHER, FILE = "Other: sensor and pixels", "A camera file"
CHOICES = (*COMMON, OTHER, FILE)
_TENS = (1, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.8, 2, 2.2, 2.5, 2.8, 3, 3.5, 4, 4.5, 5, 5.5, 6, 7, 8, 9)
LENGTHS = tuple(float(f"{tens * 10.0**power:.3g}") for power in range(-2, 3) for tens in _TENS)
"""Steps of sliders of lengths in metres, 0.01 to 900."""
FRAMES = (5, 6, 8, 10, 12, 15, 20, 25, 30, 40, 50, 75, 100, 150, 200, 300, 500, 1000, 2000)
USUAL = Uncertainty()
POSITIVE = Number(0.0)
INDEX = Number(SMALLEST_INDEX, LARGEST_INDEX)
MM = Number(SMALLEST_MM, LARGEST_MM)
TOE_IN_DEG = (-10.0, 60.0)
TOE_IN, HIGHER = "Each camera turned in by (°)", "Secondary higher by (m)"
CENTRES = "Image centres, ± px"
NEEDED = "Needed: 95 % of lengths within (%)"
BAR, NOISE = "Bar: distance of the two targets (m)", "Noise of a target in the image (px)"
NOISES = "0.1 to 0.3 px for detected targets; 1 px or more for clicked points."
Stated = Camera | SensorLens


@dataclass(frozen=True)
class _Control:
    """The field of one number of the plan."""

    attribute: str
    """The attribute of the plan."""
    title: str
    usual: float
    bounds: Number = POSITIVE
    options: Sequence[float] = ()
    """Positions of a slider."""
    scale: float = 1
    """Converts the plan's unit to the field's."""
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
    "needed_percent": _Control("needed", NEEDED, 0.01, Number(0.0, 99.0), scale=100),
    "focal_percent": _Control("uncertainty.focal", "Focal lengths, ± %", USUAL.focal, scale=100),
    "centre_px": _Control("uncertainty.centre_px", CENTRES, USUAL.centre_px, step=1.0),
    "baseline_mm": _Control(
        "uncertainty.baseline_m", "Baseline, ± mm", USUAL.baseline_m, scale=1000, step=1.0
    ),
    "bar_mm": _Control("uncertainty.bar_m", "Bar, ± mm", USUAL.bar_m, scale=1000),
    "height_m": _Control("stated_pose.height_difference_m", HIGHER, 0.0, Number(-1000.0, 1000.0)),
    "window_m": _Control("window.distance_m", "Primary camera to window (m)", 0.4, step=0.05),
    "window_mm": _Control(
        "window.thickness_m", "Thickness (mm)", 0.01, Number(0.0, 1000.0), scale=1000, step=1.0
    ),
    "medium": _Control("window.medium", "Index behind it", WATER, INDEX, step=0.001),
    "glass": _Control("window.glass", "Index of the window", GLASS, INDEX, step=0.01),
}
_WINDOW = ("window_m", "window_mm", "medium", "glass")
_SENSOR = {
    "width_mm": "Sensor width (mm)",
    "height_mm": "Sensor height (mm)",
    "width_px": "Image width (px)",
    "height_px": "Image height (px)",
}


def _pose_or_none(value: Any) -> Any:
    try:
        return None if value is None else Pose.from_json(value) and value
    except DAMAGED as error:
        raise ValueError(value) from error


_FIELDS: dict[str, tuple[Any, Fit]] = {
    **{name: (control.scale * control.usual, control.bounds) for name, control in _NUMBERS.items()},
    "name": ("Plan", str),
    "alike": (True, yes_or_no),
    "window": (False, yes_or_no),
    "window_normal": (None, lambda normal: normal and [float(part) for part in normal]),
    "stated_pose": (None, _pose_or_none),  # R and T; None for cameras that are aimed
    # Of a camera:
    "camera": (CHOICES[0], one_of(CHOICES)),
    "file": (None, lambda text: text and str(text)),  # its text
    "width_mm": (23.5, MM),
    "height_mm": (15.6, MM),
    "width_px": (6000, Number(1)),
    "height_px": (4000, Number(1)),
}
"""The default of each value, and what may be stored."""


def plan_field(project: Project | None, name: str, which: str = "") -> Field:
    """The field of a value of the plan, or of one of its cameras."""
    usual, fit = _FIELDS[name]
    return setting(project, f"plan_{which}_{name}" if which else f"plan_{name}", usual, fit)


def _focal(project: Project | None, which: CameraName, camera: str) -> Field:
    """Each camera of the list keeps its own focal length."""
    usual = COMMON[camera].focal_mm if camera in COMMON else 50.0
    key = f"plan_{which}_focal"
    return setting(project, key, usual, MM, name=f"{key}_{camera}")


def plan_controls(project: Project | None) -> Plan:
    """Draw the controls.

    Returns:
        The plan that they state.
    """
    alike = plan_field(project, "alike")
    title = "Both cameras" if alike.value() else "Primary camera, on the left"
    primary = secondary = _camera(project, "primary", title)
    st.toggle("Both cameras are alike", **alike.widget())
    if not alike.value():
        secondary = _camera(project, "secondary", "Secondary camera, on the right")
    pose = _pose(project)
    near_m, far_m = _ask(project, st.columns(2), "near_m", "far_m")
    bar_m, frames, noise_px, needed = _ask(
        project, st.columns(4), "bar_m", "frames", "noise_px", "needed_percent"
    )
    with st.expander("How well known, and heights"):
        names = ("focal_percent", "centre_px", "baseline_mm", "bar_mm", "height_m")
        *known, _ = _ask(project, st.columns(5), *names)
    window = _window(project)
    return Plan(
        str(plan_field(project, "name").value()) or "Plan",
        primary,
        secondary,
        pose,
        near_m,
        far_m,
        bar_m,
        int(frames),
        noise_px,
        Uncertainty(*known),
        needed,
        window,
    )


def _window(project: Project | None) -> PlannedWindow | None:
    """The window that both cameras look through; None in air."""
    field, normal = plan_field(project, "window"), plan_field(project, "window_normal").value()
    st.toggle("The cameras look through a window, as into water", **field.widget())
    if not field.value():
        return None
    distance_m, thickness_m, medium, glass = _ask(project, st.columns(4), *_WINDOW)
    along = None if normal is None else tuple(normal)
    return PlannedWindow(distance_m, thickness_m, medium, glass, along)


def _ask(project: Project | None, places: Sequence[DeltaGenerator], *names: str) -> list[Any]:
    """Draw fields beside each other; their values in the plan's units."""
    values = []
    for place, name in zip(places, names, strict=True):
        control, field = _NUMBERS[name], plan_field(project, name)
        if control.options:
            options = sorted({*control.options, field.value()})
            values.append(place.select_slider(control.title, options, **field.widget()))
        else:
            value = field.number_input(control.title, place, step=control.step, help=control.help)
            values.append(value / control.scale)
    return values


def show_plan(project: Project | None, plan: Plan) -> None:
    """Set all controls to a plan."""
    pose, cameras = plan.stated_pose, (plan.stated_primary, plan.stated_secondary)
    stated = None if isinstance(pose, AimedPose) else pose.to_json()
    values = {"name": plan.name, "alike": cameras[0] == cameras[1], "stated_pose": stated}
    for name, control in _NUMBERS.items():
        if name in _WINDOW and plan.window is None:
            continue
        if stated is None or not control.attribute.startswith("stated_pose."):
            stated_value = attrgetter(control.attribute)(plan)
            values[name] = control.scale * (control.usual if stated_value is None else stated_value)
    values["window"] = plan.window is not None
    values["window_normal"] = plan.window and plan.window.normal
    for name, value in values.items():
        plan_field(project, name).set(value)
    for which, camera in zip(CAMERAS, cameras, strict=True):
        _show_camera(project, which, camera)


def _show_camera(project: Project | None, which: CameraName, stated: Stated) -> None:
    names = (
        name
        for name, common in COMMON.items()
        if isinstance(stated, SensorLens) and replace(common, focal_mm=stated.focal_mm) == stated
    )
    values: dict[str, Any] = {"camera": next(names, OTHER)}
    # A sensor that is typed has the usual lens.
    if isinstance(stated, Camera) or (values["camera"] == OTHER and stated.model == "fisheye"):
        camera = stated if isinstance(stated, Camera) else stated.camera
        values = {"camera": FILE, "file": write_camera(camera).decode()}
    else:
        _focal(project, which, values["camera"]).set(stated.focal_mm)
        if values["camera"] == OTHER:
            values |= zip(_SENSOR, (*stated.sensor_mm, *stated.image_size), strict=True)
    for name, value in values.items():
        plan_field(project, name, which).set(value)


def _camera(project: Project | None, which: CameraName, title: str) -> Stated:
    left, right = st.columns([3, 2], vertical_alignment="bottom")
    chosen = plan_field(project, "camera", which).menu(title, left)
    if chosen == FILE:
        with right:
            return _from_file(project, which)
    field, hint = (_focal(project, which, chosen), "The lens's own, not the 35 mm equivalent.")
    focal = field.number_input("Focal length (mm)", right, step=1.0, help=hint)
    if chosen != OTHER:
        return replace(COMMON[chosen], focal_mm=focal)
    width, height, across, down = (
        plan_field(project, name, which).number_input(_SENSOR[name], place)
        for name, place in zip(_SENSOR, st.columns(4), strict=True)
    )
    return SensorLens(focal, (width, height), (int(across), int(down)))


def _from_file(project: Project | None, which: CameraName) -> Camera:
    field = plan_field(project, "file", which)

    def take(name: str, content: bytes) -> None:
        ask_about_lens(
            lambda *answers: field.set(write_camera(read_camera(content, name, *answers)).decode())
        )

    title, key = f"Camera file, {which}", f"upload_plan_{which}"
    take_one(st.file_uploader(title, type=CAMERA_KINDS, key=key), take)
    if field.value() is None:
        raise StereocalError(f"Give the file of the {which} camera, or choose a camera above.")
    camera = read_camera(str(field.value()).encode(), f"{which} camera")
    width, height = camera.image_size
    st.caption(f"In use: {width} x {height} px, focal length {rounded(camera.K[0, 0], 5)} px")
    return camera


def _pose(project: Project | None) -> Pose | AimedPose:
    stated = plan_field(project, "stated_pose")
    if stated.value() is not None:
        pose = Pose.from_json(stated.value())
        baseline, label = rounded(pose.baseline, 4), "State baseline and toe-in instead"
        words = f"Pose of the cameras: R and T of the plan, baseline {baseline} m."
        show_with_button("markdown", words, label, "plan_aim", partial(stated.set, None))
        return pose
    left, right = st.columns(2)
    (baseline_m,) = _ask(project, [left], "baseline_m")
    toe_field = plan_field(project, "toe_in_deg")
    low, high = min(TOE_IN_DEG[0], toe_field.value()), max(TOE_IN_DEG[1], toe_field.value())
    hint = "From parallel. Both optical axes then meet in front of the middle of the baseline."
    toe = right.slider(TOE_IN, low, high, step=0.5, help=hint, **toe_field.widget())
    return AimedPose(baseline_m, toe, plan_field(project, "height_m").value())
