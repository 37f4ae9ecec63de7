"""What has changed since the calibration, for the menu and for `messages.show_stale`."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from stereocal.projects.project import Project
from stereocal.refined.results import Calibration
from stereocal.rig.camera import CAMERAS
from stereocal.rig.dataset import Dataset
from stereocal.ui.forms import changed_settings, form_values
from stereocal.ui.refined import refine_settings

LENGTHS = {
    "baseline_m": "baseline",
    "target_distance_m": "distance between the targets",
    "baseline_sigma_m": "uncertainty of the baseline",
    "target_distance_sigma_m": "uncertainty of the distance between the targets",
}


def since_calibration(project: Project, result: Calibration, dataset: Dataset) -> str:
    """What data and form say now that they did not when a result was made; empty if nothing."""
    found = [*_of_data(result.dataset, dataset)]
    found += changed_settings(result.settings.to_json(), form_values(project, dataset))
    if result.refined is not None:
        made_with, now = result.refined.settings, refine_settings(project, dataset)
        if made_with.sigma_px != now.sigma_px:
            found.append("noise of an image point")
        if made_with.free_distortion != now.free_distortion:
            found.append("cameras whose distortion is estimated")
    return ", ".join(found)


def _of_data(then: Dataset, now: Dataset) -> Iterator[str]:
    for name, title in LENGTHS.items():
        was, value = getattr(then, name), getattr(now, name)
        if was != value:
            yield f"{title} ({_metres(was)}, now {_metres(value)})"
    if then.sha256 == now.sha256:
        return
    for which in CAMERAS:
        if _lens(then, which) != _lens(now, which):
            yield f"lens of the {which} camera"
    others = "primary", "secondary", "baseline_m", "target_distance_m"
    if replace(then, **{name: getattr(now, name) for name in others}).sha256 != now.sha256:
        yield "points"


def _metres(value: float | None) -> str:
    return "not stated" if value is None else f"{value:g} m"


def _lens(dataset: Dataset, which: str) -> Any:
    camera = getattr(dataset, which)
    return camera.to_json(), camera.uncertainty and camera.uncertainty.to_json()
