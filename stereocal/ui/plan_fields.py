"""The controls of the Plan page, and the plan that they state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import streamlit as st

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
from stereocal.ui.fields import Field, Fit, number, one_of, setting, yes_or_no
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
BAR_M, NOISE_PX, MM = (0.0, 1000.0), (0.0, 20.0), (SMALLEST_MM, LARGEST_MM)
TOE_IN_DEG = (-10.0, 60.0)
LONGEST_NAME = 200


def plan_controls(project: Project | None) -> Plan:
    """Draw the controls.

    Returns:
        The plan that they state.
    """
    cameras = _cameras(project)
    pose = _pose(project)
    near, far = _range(project)
    bar, frames, noise = st.columns(3)
    bar_m = bar.number_input(
        "Bar: distance of the two targets (m)",
        *BAR_M,
        step=0.05,
        format="%.4g",
        **field(project, "bar_m").widget(),
    )
    count = field(project, "frames")
    frames_chosen = frames.select_slider(
        "Frames of the bar", _with(FRAMES, count.value()), **count.widget()
    )
    noise_px = noise.number_input(
        "Noise of a target in the image (px)",
        *NOISE_PX,
        step=0.05,
        format="%.3g",
        help="0.1 to 0.3 px for detected targets; 1 px or more for clicked points.",
        **field(project, "noise_px").widget(),
    )
    known = _known(project)
    return Plan(
        str(field(project, "name").value()) or "Plan",
        *cameras,
        pose,
        near,
        far,
        bar_m,
        int(frames_chosen),
        noise_px,
        known,
    )


def field(project: Project | None, name: str) -> Field:
    """One of the plain values of the plan."""
    usual, fit = _PLAIN[name]
    return setting(project, f"plan_{name}", usual, fit)


def show_plan(project: Project | None, plan: Plan) -> None:
    """Set all controls to a plan."""
    pose, own = plan.stated_pose, plan.uncertainty
    values: dict[str, Any] = {
        "name": plan.name,
        "bar_m": plan.bar_m,
        "frames": plan.frames,
        "noise_px": plan.noise_px,
        "focal_percent": 100 * own.focal,
        "centre_px": own.centre_px,
        "baseline_mm": 1000 * own.baseline_m,
        "bar_mm": 1000 * own.bar_m,
        "near_m": plan.near_m,
        "far_m": plan.far_m,
        "stated_pose": None,
        "alike": plan.stated_primary == plan.stated_secondary,
    }
    if isinstance(pose, AimedPose):
        values |= {
            "baseline_m": pose.baseline_m,
            "toe_in_deg": pose.toe_in_deg,
            "height_m": pose.height_difference_m,
        }
    else:
        values["stated_pose"] = {"R": pose.R.tolist(), "T": pose.T.tolist()}
    for name, value in values.items():
        field(project, name).set(value)
    for which, stated in zip(CAMERAS, (plan.stated_primary, plan.stated_secondary), strict=True):
        _show_camera(project, which, stated)


def _show_camera(project: Project | None, which: CameraName, stated: Camera | SensorLens) -> None:
    if isinstance(stated, Camera):
        _file(project, which).set(write_camera(stated).decode())
        _choice(project, which).set(FILE)
        return
    for name, common in COMMON.items():
        if common.lens(stated.focal_mm) == stated:
            _choice(project, which).set(name)
            _focal(project, which, name).set(stated.focal_mm)
            return
    if stated.model == "fisheye":  # a sensor that is typed has the usual lens
        _file(project, which).set(write_camera(stated.camera).decode())
        _choice(project, which).set(FILE)
        return
    _choice(project, which).set(OTHER)
    _focal(project, which, OTHER).set(stated.focal_mm)
    for own, value in zip(
        _sensor(project, which), (*stated.sensor_mm, *stated.image_size), strict=True
    ):
        own.set(value)


def _cameras(project: Project | None) -> tuple[Camera | SensorLens, Camera | SensorLens]:
    alike = field(project, "alike")
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
    focal = right.number_input(
        "Focal length (mm)",
        *MM,
        step=1.0,
        format="%.4g",
        help="The lens's own, not the 35 mm equivalent.",
        **_focal(project, which, chosen).widget(),
    )
    if chosen != OTHER:
        return COMMON[chosen].lens(focal)
    titles = ("Sensor width (mm)", "Sensor height (mm)", "Image width (px)", "Image height (px)")
    numbers = [
        column.number_input(name, min_value=own_least, **own.widget())
        for column, name, own, own_least in zip(
            st.columns(4), titles, _sensor(project, which), (MM[0], MM[0], 1, 1), strict=True
        )
    ]
    width, height, across, down = numbers
    return SensorLens(focal, (width, height), (int(across), int(down)))


def _from_file(project: Project | None, which: CameraName) -> Camera:
    kept = _file(project, which)
    upload = st.file_uploader(
        f"Camera file, {which}", type=CAMERA_KINDS, key=f"upload_plan_{which}"
    )
    take_one(upload, partial(take_camera, kept))
    if kept.value() is None:
        raise StereocalError(f"Give the file of the {which} camera, or choose a camera above.")
    camera = read_camera(str(kept.value()).encode(), f"{which} camera")
    width, height = camera.image_size
    st.caption(f"In use: {width} x {height} px, focal length {rounded(camera.K[0, 0], 5)} px")
    return camera


def take_camera(kept: Field, name: str, content: bytes, model: LensModel | None = None) -> None:
    """Keep the camera in a file; if it may be a fisheye's, ask."""
    try:
        camera = read_camera(content, name, model)
    except FourCoefficientsError as error:
        ask_lens(error, lambda one: callback(partial(take_camera, kept, name, content, one))())
        return
    kept.set(write_camera(camera).decode())
    clear_refusal()


def _pose(project: Project | None) -> Pose | AimedPose:
    stated = field(project, "stated_pose")
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
    baseline = field(project, "baseline_m")
    baseline_m = left.select_slider(
        "Baseline (m)", _with(LENGTHS, baseline.value()), **baseline.widget()
    )
    turned = field(project, "toe_in_deg")
    lowest, highest = min(TOE_IN_DEG[0], turned.value()), max(TOE_IN_DEG[1], turned.value())
    toe = right.slider(
        "Each camera turned in by (°)",
        lowest,
        highest,
        step=0.5,
        help="From parallel. Both optical axes then meet in front of the middle of the baseline.",
        **turned.widget(),
    )
    return AimedPose(baseline_m, toe, field(project, "height_m").value())


def _range(project: Project | None) -> tuple[float, float]:
    titles = {"near_m": "Nearest, ahead of the primary camera (m)", "far_m": "Farthest (m)"}
    near, far = (
        column.select_slider(title, _with(LENGTHS, own.value()), **own.widget())
        for column, (title, own) in zip(
            st.columns(2),
            ((title, field(project, name)) for name, title in titles.items()),
            strict=True,
        )
    )
    return float(near), float(far)


def _known(project: Project | None) -> Uncertainty:
    with st.expander("How well known, and heights"):
        columns = st.columns(5)
        for column, name, title, step in zip(
            columns,
            ("focal_percent", "centre_px", "baseline_mm", "bar_mm", "height_m"),
            (
                "Focal lengths, ± %",
                "Image centres, ± px",
                "Baseline, ± mm",
                "Bar, ± mm",
                "Secondary higher by (m)",
            ),
            (0.1, 1.0, 1.0, 0.1, 0.1),
            strict=True,
        ):
            column.number_input(title, step=step, format="%.4g", **field(project, name).widget())
    return Uncertainty(
        field(project, "focal_percent").value() / 100,
        field(project, "centre_px").value(),
        field(project, "baseline_mm").value() / 1000,
        field(project, "bar_mm").value() / 1000,
    )


def _choice(project: Project | None, which: CameraName) -> Field:
    return setting(project, f"plan_{which}_camera", CHOICES[0], one_of(CHOICES))


def _focal(project: Project | None, which: CameraName, camera: str) -> Field:
    """Each camera of the list keeps its own focal length."""
    usual = COMMON[camera].focal_mm if camera in COMMON else 50.0
    name = f"plan_{which}_focal_{camera}"
    return setting(project, f"plan_{which}_focal", usual, number(*MM), name=name)


def _sensor(project: Project | None, which: CameraName) -> list[Field]:
    """Width and height in mm, and in pixels."""
    usual = (23.5, 15.6, 6000, 4000)
    names = ("width_mm", "height_mm", "width_px", "height_px")
    return [
        setting(project, f"plan_{which}_{name}", own, number(type(own)(0)))
        for name, own in zip(names, usual, strict=True)
    ]


def _file(project: Project | None, which: CameraName) -> Field:
    """The text of the camera file."""
    return setting(project, f"plan_{which}_file", None, lambda text: text and str(text))


def _pose_or_none(value: Any) -> dict[str, Any] | None:
    if value is None:
        return None
    try:
        pose = _pose_of(value)
    except DAMAGED as error:
        raise ValueError(value) from error
    return {"R": pose.R.tolist(), "T": pose.T.tolist()}


def _pose_of(value: Mapping[str, Any]) -> Pose:
    return Pose(*(np.array(value[key], dtype=np.float64) for key in ("R", "T")))


def _with(options: Sequence[Any], value: Any) -> list[Any]:
    """The options of a slider, with its value among them."""
    return sorted({*options, value})


_PLAIN: dict[str, tuple[Any, Fit]] = {
    "name": ("Plan", str),
    "alike": (True, yes_or_no),
    "baseline_m": (4.5, number(0.0)),
    "toe_in_deg": (10.0, number(-80.0, 80.0)),
    "height_m": (0.0, number(-1000.0, 1000.0)),
    "stated_pose": (None, _pose_or_none),
    "near_m": (8.0, number(0.0)),
    "far_m": (25.0, number(0.0)),
    "bar_m": (0.9, number(*BAR_M)),
    "frames": (25, number(1)),
    "noise_px": (0.2, number(*NOISE_PX)),
    "focal_percent": (100 * USUAL.focal, number(0.0)),
    "centre_px": (USUAL.centre_px, number(0.0)),
    "baseline_mm": (1000 * USUAL.baseline_m, number(0.0)),
    "bar_mm": (1000 * USUAL.bar_m, number(0.0)),
}
