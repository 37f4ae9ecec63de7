"""Sentences and a table on one frame under review."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
import pandas as pd

from stereocal.calibration.essential import MINIMUM_PAIRS, calibrate_essential
from stereocal.errors import StereocalError
from stereocal.frames.frame import Frame, correspondences_of
from stereocal.frames.review import is_open
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.dataset import TARGETS
from stereocal.rig.geometry import stack_rays
from stereocal.rig.rig import Rig

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


def epipolar_residuals_px(
    frames: Sequence[Frame], number: int, cameras: tuple[Camera, Camera]
) -> dict[int, float]:
    """Distance from the epipolar line of each target that both photographs of a frame show.

    The essential matrix is estimated from the other used frames, without the frame itself.

    Returns:
        By target (0 A, 1 B), px as of `Camera`, the larger of the two cameras.
    """
    others = [frame for frame in frames if frame.use and frame.frame != number]
    shared = sum(len(frame.targets_in_both) for frame in others)
    if shared < MINIMUM_PAIRS:
        raise StereocalError(
            f"The other used frames have {shared} point pairs; at least {MINIMUM_PAIRS} are needed "
            "for the epipolar geometry."
        )
    (own,) = (frame for frame in frames if frame.frame == number)
    if not own.targets_in_both:
        return {}
    rows = correspondences_of(others)
    rays = stack_rays(cameras[0].undistort(rows.primary), cameras[1].undistort(rows.secondary))
    rays = rays[:, np.isfinite(rays).all(axis=0)]
    pose = calibrate_essential(rays, 1.0).pose
    points = correspondences_of([own.used(True)])
    distances = Rig(*cameras, pose).epipolar_distances(points.primary, points.secondary)
    worst = distances.max(axis=1)
    return {int(t): float(away) for t, away in zip(points.target, worst, strict=True)}


def centres_table(frame: Frame) -> pd.DataFrame:
    """The centres of a frame, one row per target and camera."""
    lines = {}
    for target, camera in product((0, 1), (0, 1)):
        cells, centre = ["–", "–", "–", "not placed"], frame.centres[camera][target]
        if centre is not None:
            sigma = "unknown" if centre.sigma_px is None else f"{centre.sigma_px:.3f}"
            cells = [f"{centre.u:.2f}", f"{centre.v:.2f}", sigma, PLACED_BY[centre.source]]
        lines[f"{TARGETS[target]} {CAMERAS[camera]}"] = cells
    columns = ["u, px", "v, px", "Sigma, px", "Placed by"]
    return pd.DataFrame.from_dict(lines, orient="index", columns=columns).rename_axis("Target")
