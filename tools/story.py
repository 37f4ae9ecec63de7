"""The story of the Start page: each set fitted to half of the real recording, tested on the rest.

python -m tools.story      # writes assets/story.json
"""

from pathlib import Path

import numpy as np

from stereocal.calibration.methods import Method, errors_of
from stereocal.figures.story import HeldOutSet, Story, best_mean
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.formats.dataset_files import read_dataset
from stereocal.library.calibrations import calibrate
from stereocal.rig.correspondences import TARGETS
from stereocal.rig.geometry import Pose
from stereocal.rig.pair import Pair
from stereocal.system.array_types import FloatArray
from stereocal.system.atomic_files import write_atomically

ROOT = Path(__file__).parents[1]
RECORDING, STORY = ROOT / "sample_data" / "recording", ROOT / "assets" / "story.json"


def tell_story() -> Story:
    """Fitted to the even frames with the default settings, tested on the odd ones."""
    recording = read_dataset(RECORDING)
    frames = recording.correspondences.frames
    fitted, tested = (recording.of_frames(frames[frames % 2 == odd]) for odd in (0, 1))
    found = calibrate(fitted, refined=RefineSettings())
    assert found.refined is not None
    seen: dict[Method, tuple[Pair, Pose]] = {
        method: (tested, result.pose) for method, result in found.methods.items()
    }
    seen["refined"] = (found.refined.apply(tested), found.refined.pose)
    feet = {method: _feet(*each) for method, each in seen.items()}
    # The row whose distances are nearest to the median of each set.
    distances = np.array([np.hypot(*foot.T) for foot, _ in feet.values()])
    away = np.abs(np.log(distances / np.median(distances, axis=1, keepdims=True)))
    row = int(np.argmin(away.max(axis=0)))
    rows = tested.correspondences
    return Story(
        fitted=len(fitted.correspondences.frames),
        frame=int(rows.frame[row]),
        target=TARGETS[rows.target[row]],
        sets={
            method: _held_out(*each, row, *(part[row] for part in feet[method]))
            for method, each in seen.items()
        },
    )


def _held_out(
    tested: Pair, pose: Pose, row: int, foot: FloatArray, along: FloatArray
) -> HeldOutSet:
    lengths = tested.reconstructed_lengths_m(pose) / tested.bar_distances_m - 1.0
    x1, y1, x2, y2 = tested.rays[:, row]
    across = np.cross([x1, y1, 1.0], pose.R.T @ [x2, y2, 1.0])  # of both rays
    gap_m = float(abs(pose.R.T @ pose.T @ across) / np.linalg.norm(across))
    return HeldOutSet(
        length_errors=tuple(lengths.round(6).tolist()),
        reprojection_px=round(best_mean(errors_of(tested, pose).reprojection_px), 4),
        line_px=(tuple(foot.round(4).tolist()), tuple(along.round(6).tolist())),
        gap_m=round(gap_m, 7),
    )


def _feet(tested: Pair, pose: Pose) -> tuple[FloatArray, FloatArray]:
    """Epipolar lines in the secondary image, undistorted pixels: (n, 2) the nearest points,
    relative to the measured ones, and (n, 2) the directions."""
    rows = tested.correspondences
    primary = tested.primary.undistort(rows.primary)
    points = tested.secondary.undistort_to_pixels(rows.secondary)
    n = len(rows)
    lines = np.column_stack([primary, np.ones(n)]) @ pose.essential.T
    lines = lines @ np.linalg.inv(tested.secondary.K)
    lines /= np.hypot(lines[:, 0], lines[:, 1])[:, None]
    distances = (lines * np.column_stack([points, np.ones(n)])).sum(axis=1)
    return -distances[:, None] * lines[:, :2], np.column_stack([-lines[:, 1], lines[:, 0]])


def main() -> None:
    """Write the file that the Start page reads."""
    story = tell_story()
    write_atomically(STORY, story.to_json().encode())
    for method, found in story.sets.items():
        print(
            f"{method:9s} lengths {100 * found.length_error:.3f} %, reprojection "
            f"{found.reprojection_px:.3f} px, line {found.line_distance_px:.2f} px, gap "
            f"{1000 * found.gap_m:.2f} mm"
        )


if __name__ == "__main__":
    main()
