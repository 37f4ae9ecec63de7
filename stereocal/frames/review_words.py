"""Sentences and a table on one frame under review."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from stereocal.errors import StereocalError
from stereocal.frames.epipolar_residuals import epipolar_residuals_px
from stereocal.frames.frame import Centre, Frame
from stereocal.frames.review import is_open
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.dataset import TARGETS

DECIDE = "Please decide: check all four targets, then use it or leave it out."
PLACED_BY = {
    "detected": "found",
    "corrected": "you, at the fitted corner",
    "manual": "you, by hand",
}


def describe_use(frame: Frame) -> str:
    """Sentences on whether a frame is used, and what is left to do."""
    shared = [TARGETS[target] for target in frame.targets_in_both]
    if frame.use and len(shared) == 1:
        sentence = f"It is used, with target {shared[0]} only."
    elif frame.use and shared:
        sentence = "It is used."
    elif shared:
        sentence = "It is left out."
    else:
        sentence = "It is left out: no target is placed in both photographs."
    if frame.corrected or frame.reviewed:
        sentence += f" You have {'corrected' if frame.corrected else 'reviewed'} it."
    if is_open(frame):
        sentence += f" {DECIDE}"
    return sentence


def describe_residuals(
    frames: Sequence[Frame], frame: Frame, cameras: tuple[Camera | None, Camera | None]
) -> str:
    """A sentence with the distances from the epipolar lines, or why they are unknown."""
    primary, secondary = cameras
    if primary is None or secondary is None:
        return "Both camera files are needed to compare this frame with the others."
    try:
        found = epipolar_residuals_px(frames, frame.frame, (primary, secondary))
    except StereocalError as error:
        return str(error)
    if not found:
        return "Place a target in both photographs to compare this frame with the others."
    each = ", ".join(f"{TARGETS[target]} {away:.2f} px" for target, away in found.items())
    return f"Distance from the epipolar lines of the other frames: {each}."


def centres_table(frame: Frame) -> pd.DataFrame:
    """The centres of a frame, one row per target and camera."""
    lines = {
        f"{TARGETS[target]} {CAMERAS[camera]}": _cells(frame.centres[camera][target])
        for target in (0, 1)
        for camera in (0, 1)
    }
    columns = ["u, px", "v, px", "Sigma, px", "Placed by"]
    return pd.DataFrame.from_dict(lines, orient="index", columns=columns).rename_axis("Target")


def _cells(centre: Centre | None) -> list[str]:
    if centre is None:
        return ["–", "–", "–", "not placed"]
    sigma = "unknown" if centre.sigma_px is None else f"{centre.sigma_px:.3f}"
    return [f"{centre.u:.2f}", f"{centre.v:.2f}", sigma, PLACED_BY[centre.source]]
