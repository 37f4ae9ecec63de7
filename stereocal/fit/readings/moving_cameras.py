"""Cameras that move against each other in every frame, as on drones or in hands.

A turn of a camera shifts all points of a frame by about the same. A wrong lens shifts them by where
they are in the images, whatever the frame, and noise shifts each by itself. So the errors of a
frame are alike, and those of points at the same place in other frames are not. So are they of a
camera that is out of step, or moved once, which are looked for before.
"""

from itertools import chain

import numpy as np
from scipy.spatial import KDTree

from stereocal.calibration.wrong_inputs import essential_fit
from stereocal.fit.start.pairs import pairs_worth_a_fit
from stereocal.rig.camera import camera_in_words
from stereocal.rig.geometry import sampson
from stereocal.rig.pair import Pair
from stereocal.rig.recording import CameraPair, Recording
from stereocal.system.numbers import rounded

LEAST_PX = 1.0
"""Median error of the points that is worth a word; of cameras that turn by 0.1 degrees in each
frame, 0.7."""
LARGEST_SHARE = 0.45
"""Of the difference between the points of a frame in the error itself, and in the difference of
neighbours in the images. With cameras that turn by 0.3 degrees in each frame 0.10 to 0.25 and 0.11
to 0.42; with other mistakes 0.46 and 0.47 at least, 0.8 and 1 in the mean."""
NEIGHBOURS = 4
"""Of a point, the nearest of which that is of another frame counts."""


def moving_cameras(recording: Recording) -> str:
    """A message if cameras seem to move in every frame; else empty, also behind windows, whose
    errors of a start are alike in a frame too."""
    if recording.has_windows:
        return ""
    errors_px, steady = dict[CameraPair, float](), set[str]()
    for pair in pairs_worth_a_fit(recording):
        error_px, is_of_frames = _error_px(recording.pair(*pair))
        if is_of_frames and error_px > LEAST_PX:
            errors_px[pair] = error_px
        elif error_px < LEAST_PX:
            steady |= {*pair}
    if not errors_px:
        return ""
    moving = {*chain(*errors_px)} - steady
    who = (
        f"{camera_in_words(*moving, begins=True)} seems to move against the others"
        if len(moving) == 1
        else "The cameras seem to move against each other"
    )
    return (
        f"{who} in every frame, as on drones or in hands, or the images are not of the same "
        f"moment: the points of a frame are off alike, by {rounded(max(errors_px.values()))} px, "
        "and differently in the next. Mount the cameras on one bar or on firm ground, and let one "
        "signal start all images."
    )


def _error_px(data: Pair) -> tuple[float, bool]:
    """The median error of the points of two cameras, infinite where no pose fits, and whether it is
    that of their frames."""
    pose, bars = essential_fit(data).pose, data.correspondences.bars
    if pose is None:
        return np.inf, False
    rays, frame = data.rays.T[bars].reshape(-1, 4), data.correspondences.frame[bars].ravel()
    errors = sampson(pose.essential, rays)
    near = np.asarray(KDTree(rays).query(rays, min(NEIGHBOURS, len(rays)))[1])
    nearest = near[np.arange(len(rays)), (frame[near] != frame[:, None]).argmax(axis=1)]
    error, among = np.median(np.abs(errors)), np.median(np.abs(errors - errors[nearest]))
    within = np.median(np.abs(errors[::2] - errors[1::2]))
    focal_px = np.mean([camera.K[0, 0] for camera in (data.primary, data.secondary)])
    return float(error * focal_px), bool(within < LARGEST_SHARE * min(error, among))
