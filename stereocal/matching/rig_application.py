"""Match and measure the points of a rig of three cameras and more, and write both tables.

The tables are identical to those of the commands `match --rig` and `reconstruct --rig`.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.matching.application import POINTS, STAGES, Outcome, Points, world_to_json
from stereocal.matching.names import AUTO
from stereocal.matching.pairs import POINT
from stereocal.matching.point_table import PointTable
from stereocal.matching.reconstruction import name_of_world
from stereocal.matching.several_files import match_rig
from stereocal.matching.several_reconstruction import reconstruct_rig
from stereocal.network.rig_file import RigFile
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import Recording
from stereocal.verdict.in_words import listed

TRACKS = "tracks.csv"
SECONDS_PER_FRAME, SECONDS_PER_GROUP = 0.012, 1e-4
"""CPU time per frame, and per pair of images of one frame: 60 frames of three cameras and three
points took 1.4 s."""


@dataclass(frozen=True, eq=False)
class RigApplication:
    """The input: points by camera, and the rig."""

    points: Mapping[str, Points]
    rig: RigFile
    world: Pose | None = None
    """`world_from_reference` of the points; None: points in the reference's frame."""
    sigma_px: float | None = None
    """Noise of the points; None: estimated."""
    names: str = AUTO
    """As of `pairs.match`."""

    @property
    def rows(self) -> list[int]:
        """The numbers of points of the cameras."""
        return [each.rows for each in self.points.values()]

    @property
    def used(self) -> dict[str, Any]:
        """As of `Outcome`."""
        return {"points": [each.label for each in self.points.values()], "rig": self.rig.digest}

    @property
    def shown_depths_m(self) -> list[float | None]:
        """Any depth."""
        return [0.0, None]

    @property
    def digest(self) -> str:
        """Digest of the input, independent of dates."""
        points = [[name, each.name] for name, each in self.points.items()]
        world = None if self.world is None else name_of_world(self.world)
        content = json.dumps([points, self.rig.digest, world, self.sigma_px, self.names])
        return hashlib.sha256(content.encode()).hexdigest()

    @property
    def expected_seconds(self) -> float:
        """Estimated time, for frames with about equal numbers of points."""
        frames = max(each.frames for each in self.points.values())
        pairs = sum(self.rows) ** 2 / max(frames, 1)
        return SECONDS_PER_FRAME * frames + SECONDS_PER_GROUP * pairs


def apply_rig(
    work: RigApplication,
    tables: Mapping[str, Path],
    folder: Path,
    begin: Callable[[str], None] | None = None,
    progress: Callable[[int, int], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> Outcome | None:
    """Write `tracks.csv` and `points.csv` into a folder; None if cancelled.

    Args:
        tables: the points by camera.
    """
    if begin is not None:
        begin(STAGES[0])
    given = {
        name: PointTable(path, POINT, work.points[name].label) for name, path in tables.items()
    }
    tracks = folder / TRACKS
    matched = match_rig(work.rig, given, tracks, work.sigma_px, progress, cancelled, work.names)
    if matched is None:
        return None
    found = sum(matched.by_views.values())
    if not found:
        raise StereocalError(
            "No two points of different cameras belong together: make sure that the points and the "
            "cameras are not exchanged, and that the points are of the same frames; or state the "
            "noise of the points, if they are less exact."
        )
    if begin is not None:
        begin(STAGES[1])
    measured = reconstruct_rig(work.rig, tracks, folder / POINTS, work.world, work.sigma_px)
    labels = listed([each.label for each in work.points.values()])
    frame = "" if work.world is None else f", in the world frame {name_of_world(work.world)}"
    return Outcome(
        digest=work.digest,
        threshold_px=0.0,
        depths_m=work.shown_depths_m,
        pairs=found,
        behind=measured.lost,
        sentences=[*matched.sentences(), measured.sentence()],
        notes=[*matched.notes],
        made_with=f"{labels}; the rig of the cameras {listed(work.rig.names)}{frame}.",
        tables=[each.name for each in work.points.values()],
        measured_with={
            "rig": {
                name: {**own.camera.to_json(), "R": own.pose.R.tolist(), "T": own.pose.T.tolist()}
                for name, own in work.rig.placed.items()
            },
            "world_from_primary": world_to_json(work.world),
        },
        used=work.used,
        sigma_px=work.sigma_px,
        names=work.names,
        matched=TRACKS,
        cameras=[*work.points],
    )


def points_by_camera(recording: Recording) -> dict[str, pd.DataFrame]:
    """The object's points as a table of each camera that sees any; `target` is passed through and
    not used for matching."""
    targets = np.array(recording.object.names)[recording.target]
    table = pd.DataFrame(
        {
            "frame": recording.frame,
            "u": recording.points[:, 0],
            "v": recording.points[:, 1],
            "target": targets,
        }
    ).sort_values("frame", kind="stable")
    found = {
        name: table[recording.camera[table.index] == number]
        for number, name in enumerate(recording.cameras)
    }
    return {name: own for name, own in found.items() if len(own)}
