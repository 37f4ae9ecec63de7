"""Which doubtful frames agree with the sure ones, so that a person need not look at each.

The pose of the cameras, and how far points are from their epipolar lines by noise alone, come from
the frames that are used. A doubtful frame agrees if both of its targets are as near to their lines,
its bar is as long as the others, and it would not agree as well with A and B exchanged in one
camera. A wrong point is near its line by chance once in some hundred times, both of a frame hardly
ever; one that lies along its line shows in the length of the bar.
"""

from collections.abc import Sequence

import numpy as np

from stereocal.calibration.essential import calibrate_essential
from stereocal.errors import StereocalError
from stereocal.fit.screening.outliers import MAD_TO_SIGMA
from stereocal.frames.epipolar_labels import (
    MINIMUM_FRAMES,
    SAME_LENGTH,
    SMALLEST_EXCESS_PX,
    both_ways,
    frame_focal_px,
)
from stereocal.frames.frame import Frame
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import sampson, triangulate_rays
from stereocal.system.array_types import FloatArray

SIGMAS = 4.0
"""A point agrees within this many standard deviations of its distance from its line."""
LARGEST_SIGMA_PX = 1.0
"""The most of a point's stated standard error that is allowed for: what is located worse is not
used."""
PARAMETERS = 5
"""The angles of a pose: each point of the known frames gives one equation."""


def agreeing(
    sure: Sequence[Frame], doubtful: Sequence[Frame], cameras: tuple[Camera, Camera]
) -> list[int]:
    """The numbers of the doubtful frames that agree with the sure ones: with their labels, and not
    with A and B exchanged in one photograph.

    Args:
        sure, doubtful: of these, those with both targets in both photographs count.

    Raises:
        StereocalError: fewer than `MINIMUM_FRAMES` sure frames, or they determine no pose.
    """
    known = [frame for frame in sure if len(frame.targets_in_both) == 2]
    asked = [frame for frame in doubtful if len(frame.targets_in_both) == 2]
    if len(known) < MINIMUM_FRAMES:
        raise StereocalError(
            f"{len(known)} frames with both targets are used; at least {MINIMUM_FRAMES} are needed "
            "to judge the doubtful ones by their epipolar lines. Look at these one by one."
        )
    known_rays, asked_rays = (_rays(frames, cameras) for frames in (known, asked))
    pose = calibrate_essential(_columns(known_rays[0]), 1.0).pose

    def away_px(rays: FloatArray, frames: Sequence[Frame]) -> FloatArray:
        """(2, f, 2): distance from the line by labelling, frame and target."""
        focal = frame_focal_px(cameras, [rays[0][..., :2], rays[0][..., 2:]])
        assert len(focal) == len(frames)
        return np.asarray(np.abs(focal[:, None] * sampson(pose.essential, rays)))

    noise_px = MAD_TO_SIGMA * float(np.median(away_px(known_rays, known)[0]))
    points = 2 * len(known)
    noise_px *= float(np.sqrt(points / (points - PARAMETERS)))
    lengths = [_lengths(pose.R, pose.T, way) for way in (known_rays[0], *asked_rays)]
    usual = float(np.nanmedian(lengths[0]))
    off = [np.abs(np.log(bar_lengths / usual)) for bar_lengths in lengths]
    spread = SIGMAS * MAD_TO_SIGMA * float(np.nanmedian(off[0]))
    stated = np.minimum([_sigma_px(frame) for frame in asked], LARGEST_SIGMA_PX)
    limit = np.maximum(SIGMAS * np.hypot(noise_px, stated), SMALLEST_EXCESS_PX)
    fits = away_px(asked_rays, asked).max(axis=2) <= limit
    fits &= np.array(off[1:]) <= max(SAME_LENGTH, spread)
    return [
        frame.frame
        for frame, (as_labelled, other) in zip(asked, fits.T, strict=True)
        if as_labelled > other
    ]


def _rays(frames: Sequence[Frame], cameras: tuple[Camera, Camera]) -> FloatArray:
    """(2, f, 2, 4), as of `both_ways`."""
    pixels = np.array([frame.places for frame in frames]).reshape(-1, 2, 2, 2)
    primary, secondary = (
        camera.undistort(pixels[:, :, which].reshape(-1, 2)).reshape(-1, 2, 2)
        for which, camera in enumerate(cameras)
    )
    return both_ways(primary, secondary)


def _columns(rays: FloatArray) -> FloatArray:
    """(4, n), as in `geometry`, of (f, 2, 4)."""
    return np.ascontiguousarray(rays.reshape(-1, 4).T)


def _lengths(R: FloatArray, T: FloatArray, rays: FloatArray) -> FloatArray:
    """(f,): lengths of the bar per baseline; NaN behind a camera."""
    points = triangulate_rays(R, T, _columns(rays))
    return np.asarray(np.linalg.norm(points[::2] - points[1::2], axis=1))


def _sigma_px(frame: Frame) -> float:
    """The largest stated standard error of its points; 0 where none is stated."""
    return max(c.sigma_px or 0.0 for pair in frame.centres for c in pair if c)
