"""The sample data set of photographs: the bar in both cameras, and a chessboard for each lens."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from stereocal.formats.dataset_description import TABLE
from stereocal.formats.dataset_files import pack_dataset
from stereocal.rig.camera import CAMERAS, Camera, CameraName
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import (
    FIELD_BAR_M,
    FIELD_BASELINE_M,
    FIELD_FRAMES,
    TRUTH,
    Nominal,
    Scene,
    field_rig,
    observe,
    truth_of,
)
from stereocal.system.atomic_files import write_atomically
from stereocal.system.tasks import Progress
from tools.photographs.backgrounds import indoors, outdoors
from tools.photographs.bars import (
    NO_FLAW,
    SAMPLE_FLAWS,
    BarSettings,
    Flaw,
    PhotographPair,
    photograph_bars,
    place_visible_bars,
)
from tools.photographs.board_series import (
    LENS_PHOTOGRAPHS,
    LENS_SQUARE_M,
    LENS_SQUARES,
    draw_board_poses,
)
from tools.photographs.rendering import (
    Photograph,
    PhotographSettings,
    Placed,
    chessboard,
    photograph,
)

JPEG_QUALITY = 50
"""Its effect on accuracy is in sample_data/README.md."""
JPEG_QUALITY_HIDDEN = 80
"""Where a leaf hides a target: below 80, blocks of the background look more like a target than what
is left of it."""
POSE_SPREAD_RAD = 0.01
FOCAL_SPREAD = 0.005
CENTRE_SPREAD_PX = 15.0
"""Standard deviations of the rig's angles and lenses from those of `field_rig`."""


@dataclass(frozen=True, eq=False)
class PhotographedField:
    """The ground truth and settings from which the photographs are rendered."""

    scene: Scene
    boards: Mapping[CameraName, list[Pose]]
    """Poses (camera from board) of the chessboard, for `primary` and `secondary`."""
    bar: BarSettings
    settings: PhotographSettings
    seed: int
    flaws: Mapping[int, Flaw] = field(default_factory=lambda: SAMPLE_FLAWS)
    """What spoils some frames of the bar, by frame."""

    @property
    def cameras(self) -> dict[CameraName, Camera]:
        """The two cameras by name."""
        return {which: getattr(self.scene.rig, which) for which in CAMERAS}

    def pairs(self) -> Iterator[PhotographPair]:
        """Render the photographs of the bar, one pair at a time."""
        rng = np.random.default_rng([self.seed, 1])
        backgrounds = outdoors(self.scene.rig, rng)
        return photograph_bars(self.scene, backgrounds, self.bar, self.settings, rng, self.flaws)

    def board_photographs(self, which: CameraName) -> Iterator[Photograph]:
        """Render the photographs of the chessboard by one camera, one at a time."""
        rng = np.random.default_rng([self.seed, 2, CAMERAS.index(which)])
        camera = self.cameras[which]
        board = chessboard(LENS_SQUARES, LENS_SQUARE_M)
        background = indoors(camera, rng)
        for pose in self.boards[which]:
            yield photograph(camera, background, [Placed(board, pose)], self.settings, rng)


def prepare_photographs(
    seed: int, frames: int = FIELD_FRAMES, boards: int = LENS_PHOTOGRAPHS
) -> PhotographedField:
    """Draw the rig, and the poses of the bar and of the chessboards for each camera."""
    rng = np.random.default_rng([seed, 0])
    rig, bar = drawn_rig(rng), BarSettings()
    scene = place_visible_bars(rig, rng, frames, FIELD_BAR_M, bar.board_m)
    poses = {which: draw_board_poses(getattr(rig, which), rng, boards) for which in CAMERAS}
    return PhotographedField(scene, poses, bar, PhotographSettings(), seed)


def drawn_rig(rng: np.random.Generator) -> Rig:
    """A rig like `field_rig` with random lenses and angles; baseline 4.5 m."""
    rig = field_rig(FIELD_BASELINE_M)
    angles = np.array(rig.pose.angles) + POSE_SPREAD_RAD * rng.standard_normal(5)
    cameras = []
    for camera in (rig.primary, rig.secondary):
        K = camera.K.copy()
        K[[0, 1], [0, 1]] *= 1.0 + FOCAL_SPREAD * rng.standard_normal()
        K[:2, 2] += CENTRE_SPREAD_PX * rng.standard_normal(2)
        cameras.append(replace(camera, K=np.round(K, 2)))
    pose = Pose.from_angles(Angles(*angles.tolist()), FIELD_BASELINE_M)
    return Rig(cameras[0], cameras[1], pose)


def jpeg(image: Photograph, quality: int) -> bytes:
    """The bytes of a grey JPEG file, of 8 bits."""
    options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1]
    return bytes(cv2.imencode(".jpg", image, options)[1])


def true_of_photographs(field: PhotographedField) -> dict[str, Any]:
    """The ground truth of the sample, for JSON."""
    truth = truth_of(field.scene, 0.0, field.seed)
    del truth["noise_px"]
    frames = len(field.scene.ends_m)
    for which, points in zip(CAMERAS, field.scene.points_m, strict=True):
        pixels = field.cameras[which].project(points).reshape(frames, 2, 2)
        for entry, centres in zip(truth["frames"], pixels, strict=True):
            entry[f"pixels_{which}"] = {"A": centres[0].tolist(), "B": centres[1].tolist()}
    for number, flaw in field.flaws.items():
        if number <= frames:
            truth["frames"][number - 1]["flaw"] = flaw.what
    truth["bar"] = asdict(field.bar)
    truth["photographs"] = asdict(field.settings)
    boards = {
        which: [
            {"photograph": f"{number:04d}.jpg", "R": pose.R.tolist(), "T": pose.T.tolist()}
            for number, pose in enumerate(own, start=1)
        ]
        for which, own in field.boards.items()
    }
    truth["chessboard"] = {
        "squares": list(LENS_SQUARES),
        "square_m": LENS_SQUARE_M,
        "convention": "x_camera = R @ x_board + T; origin in the middle, x along the columns, "
        "y down along the rows",
        **boards,
    }
    return truth


def write_photographs(
    folder: Path,
    seed: int,
    frames: int = FIELD_FRAMES,
    boards: int = LENS_PHOTOGRAPHS,
    progress: Progress = lambda _done, _total: None,
) -> None:
    """Write a data set of photographs: `primary/0001.jpg`, ..., `boards_primary/`, and the truth.

    There is no table of points; they are to be detected.

    Args:
        progress: called with the number of photographs written and the total.
    """
    field = prepare_photographs(seed, frames, boards)
    for name, content in describing_files(field).items():
        write_atomically(folder / name, content)
    total = 2 * (frames + boards)
    done = 0
    for pair in field.pairs():
        hidden = field.flaws.get(pair.frame, NO_FLAW).leaf > 0
        quality = JPEG_QUALITY_HIDDEN if hidden else JPEG_QUALITY
        for which in CAMERAS:
            content = jpeg(getattr(pair, which), quality)
            write_atomically(folder / which / f"{pair.frame:04d}.jpg", content)
        done += 2
        progress(done, total)
    for which in CAMERAS:
        for number, image in enumerate(field.board_photographs(which), start=1):
            name = f"boards_{which}/{number:04d}.jpg"
            write_atomically(folder / name, jpeg(image, JPEG_QUALITY))
            done += 1
            progress(done, total)


def describing_files(field: PhotographedField) -> dict[str, bytes]:
    """`dataset.json`, the two camera files and `truth.json`."""
    nominal = replace(
        Nominal.exact(field.scene), baseline_m=FIELD_BASELINE_M, target_distance_m=FIELD_BAR_M
    )
    notes = f"Synthetic photographs, seed {field.seed}; the truth is in {TRUTH}."
    exact = observe(field.scene, np.random.default_rng(0), 0.0, "photographs", nominal, notes)
    files = {name: content for name, content in pack_dataset(exact).items() if name != TABLE}
    return {**files, TRUTH: (json.dumps(true_of_photographs(field), indent=2) + "\n").encode()}
