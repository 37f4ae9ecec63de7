"""Whether the corners of a board are numbered as it is stated, which each image tells by itself.

A plane and its image are related by a homography, whatever the lens's focal length and the pose of
the camera. With the numbers of another board, or with rows and columns exchanged, corners lie tens
of pixels from where the best homography puts them. The sign of the homography's determinant says
which way round the corners run.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import KDTree

from stereocal.errors import StereocalError
from stereocal.rig.camera import camera_in_words
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.sampling import evenly_spread

MISNUMBERED = 0.5
"""Residual of the homography over the distance of neighbouring corners, median of the images.
Measured on 40 simulated pairs, with 0.1 to 0.5 px of noise and bent by 0.4 % of their width: 0.03
at most, with K of half the size 0.1; with a column too many or too few, or rows and columns
exchanged: 1.8 and more."""
BETTER = 3.0
"""How many times less the residual of another numbering must be to be named."""
MOST_COLUMNS = 40
MOST_IMAGES = 12
"""The most images of each camera; they all have the same numbers."""
FEWEST_CORNERS = 8
ONE_WAY = 0.9
"""Share of the images in which corners run one way round, to say that they do."""


@dataclass(frozen=True, eq=False)
class BoardImage:
    """The corners of a board in one image."""

    targets: IntArray
    """(n,): their numbers."""
    rays: FloatArray
    """(n, 2): undistorted and normalised."""
    spacing: float
    """Median distance of neighbouring rays."""

    def residual(self, columns: int) -> float:
        """RMS distance from the best homography, over `spacing`, if a row has so many corners."""
        grid = np.column_stack(np.divmod(self.targets, columns)[::-1]).astype(np.float64)
        H: FloatArray | None = cv2.findHomography(grid, self.rays)[0]  # type: ignore[assignment]
        if H is None:
            return np.inf
        mapped = np.column_stack([grid, np.ones(len(grid))]) @ H.T
        with np.errstate(all="ignore"):
            away = np.linalg.norm(mapped[:, :2] / mapped[:, 2:] - self.rays, axis=1)
        rms = float(np.sqrt(np.mean(np.square(away)))) / self.spacing
        return rms if np.isfinite(rms) else np.inf

    def is_clockwise(self, columns: int) -> bool:
        """Whether columns to rows is the way from u to v, as on a board seen from its front."""
        grid = np.column_stack([*np.divmod(self.targets, columns)[::-1], np.ones(len(self.rays))])
        linear = np.linalg.lstsq(grid, self.rays, rcond=None)[0][:2]
        return bool(np.linalg.det(linear) > 0.0)


def board_images(recording: Recording) -> dict[str, list[BoardImage]]:
    """Some images of each camera, of a board; empty where another object is seen."""
    by_camera: dict[str, list[BoardImage]] = {}
    for number, (name, camera) in enumerate(recording.cameras.items()):
        of_camera = np.flatnonzero(recording.camera == number)
        frames, counts = np.unique(recording.frame[of_camera], return_counts=True)
        frames = frames[counts >= FEWEST_CORNERS]
        if recording.object.board is None or not len(frames):
            continue
        by_camera[name] = []
        for frame in frames[evenly_spread(len(frames), MOST_IMAGES)]:
            rows = of_camera[recording.frame[of_camera] == frame]
            rays = camera.undistort(recording.points[rows])
            if np.isfinite(rays).all():
                nearest = np.asarray(KDTree(rays).query(rays, 2)[0])[:, 1]
                spacing = float(np.median(nearest))
                if spacing > 0.0:  # else most corners are at the place of another
                    by_camera[name].append(BoardImage(recording.target[rows], rays, spacing))
    return {name: images for name, images in by_camera.items() if images}


def check_numbering(recording: Recording) -> None:
    """Reject corners that are not numbered row by row, as the stated board has them.

    Raises:
        StereocalError: names the camera, and the board whose numbers fit, if one does.
    """
    board = recording.object.board
    if board is None:
        return
    fitting: dict[str, int] = {}
    images = board_images(recording)
    for name, of_camera in images.items():
        stated = _median(of_camera, board.columns)
        if stated < MISNUMBERED:
            continue
        others = {
            c: _median(of_camera, c) for c in range(2, MOST_COLUMNS + 1) if c != board.columns
        }
        best = min(others, key=lambda columns: others[columns])
        if others[best] < min(MISNUMBERED, stated / BETTER):
            fitting[name] = best
    if fitting:
        raise StereocalError(_message(board, fitting, all_cameras=len(fitting) == len(images)))


def _median(images: list[BoardImage], columns: int) -> float:
    return float(np.median([image.residual(columns) for image in images]))


def _message(board: BoardPattern, fitting: Mapping[str, int], all_cameras: bool) -> str:
    cameras = "all cameras" if all_cameras else camera_in_words(*fitting)
    counts = sorted({*fitting.values()})
    in_words = " or ".join(map(str, counts))
    exchanged = ""
    if counts == [board.rows]:
        exchanged = " Rows and columns seem to be exchanged, in the board or in the table."
    return (
        f"The board is stated to have {board.columns} columns and {board.rows} rows of inner "
        f"corners, but in the images of {cameras} the corners lie as if a row had {in_words}."
        f"{exchanged} Correct the number of columns, or number the corners row by row: the first "
        f"row 0 to {board.columns - 1}."
    )


def run_counter_clockwise(recording: Recording) -> bool:
    """Whether the corners of a board, columns to rows, run counter-clockwise in all cameras."""
    board, images = recording.object.board, board_images(recording)
    if board is None or len(images) < len(recording.cameras):
        return False
    by_camera = images.values()
    shares = [
        np.mean([image.is_clockwise(board.columns) for image in of_camera])
        for of_camera in by_camera
    ]
    return bool(max(shares) < 1.0 - ONE_WAY)


def note_on_ways_round(recording: Recording) -> str:
    """What it may mean that the corners of a board run counter-clockwise; empty if they do not."""
    if not run_counter_clockwise(recording):
        return ""
    return (
        "The corners of the board run counter-clockwise in both cameras, rows after columns: they "
        "are counted so, which does no harm, or the images of both cameras are mirrored, and then "
        "the poses are those of a mirrored rig. The points cannot tell: see whether writing in the "
        "photographs can be read."
    )
