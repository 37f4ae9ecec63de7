"""Simulate a bar that is moved by hand before two cameras that need not be in step.

bar = move_bar(field_rig(4.5), rng, frames=300, length_m=0.9)
dataset = record(bar, rng, noise_px=0.15, name="moving", offset=TimeOffset(0.3))
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.interpolate import CubicSpline

from stereocal.formats.camera_file import write_camera
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.rig.tracks import TimeOffset
from stereocal.simulation.simulate import (
    FIELD_DEPTHS_M,
    MARGIN_PX,
    Nominal,
    Scene,
    field_rig,
    observe,
    place_bars,
)
from stereocal.system.array_types import FloatArray

FRAMES_BETWEEN = 30
"""From one of the random positions to the next. With the tests' rig the bar then moves at 4 to 20
pixels a frame, as one carried at 1 to 2 m/s does at 30 frames a second."""


@dataclass(frozen=True, eq=False)
class MovingBar:
    """A rig, and a bar on a smooth path."""

    rig: Rig
    frames: int
    length_m: float
    depths_m: tuple[float, float]
    path: CubicSpline
    """Of the bar's centre and direction, (6,), against the frame of the primary camera."""

    def ends_m(self, times: npt.ArrayLike) -> FloatArray:
        """(n, 2, 3): A and B at these times, in frames, in the primary's frame."""
        at = self.path(np.asarray(times, dtype=np.float64))
        half = 0.5 * self.length_m * at[:, 3:] / np.linalg.norm(at[:, 3:], axis=1, keepdims=True)
        return np.stack([at[:, :3] - half, at[:, :3] + half], axis=1)


def move_bar(
    rig: Rig,
    rng: np.random.Generator,
    frames: int,
    length_m: float,
    depths_m: tuple[float, float] = FIELD_DEPTHS_M,
    frames_between: int = FRAMES_BETWEEN,
) -> MovingBar:
    """A smooth path through random positions and directions of the bar.

    Args:
        depths_m: smallest and largest z of both ends, in the frames of both cameras.
        frames_between: frames from one position to the next.
    """
    count = frames // frames_between + 4
    ends = place_bars(rig, rng, count, length_m, depths_m).ends_m
    along = ends[:, 1] - ends[:, 0]
    for i in range(1, count):  # so that the bar never turns by more than a right angle
        along[i] *= 1.0 if along[i] @ along[i - 1] >= 0 else -1.0
    times = frames_between * (np.arange(count) - 1.0)
    path = CubicSpline(times, np.column_stack([ends.mean(axis=1), along]))
    return MovingBar(rig, frames, length_m, depths_m, path)


def record(
    bar: MovingBar,
    rng: np.random.Generator,
    noise_px: float,
    name: str,
    offset: TimeOffset | None = None,
    nominal: Nominal | None = None,
) -> Pair:
    """Simulate the recording; frames in which an end is out of view are missing.

    Args:
        offset: by which the secondary camera is late; None: in step.
        nominal: lenses and lengths of the data set; the true ones if None.
    """
    recorded = np.arange(bar.frames)
    ends, late = bar.ends_m(recorded), bar.ends_m(recorded + (offset or TimeOffset()).at(recorded))
    seen = Scene(bar.rig, ends, late).in_view(bar.depths_m, MARGIN_PX)
    data = observe(Scene(bar.rig, ends[seen], late[seen]), rng, noise_px, name, nominal)
    times = np.repeat(recorded[seen], 2)
    return data.changed(correspondences=replace(data.correspondences, time_frame=times))


def counted_by_themselves(later: int = 137, frames: int = 400) -> tuple[dict[str, bytes], Pair]:
    """A table and a camera file of each of two cameras, the second of which was started some frames
    later and counts its own from 0; and the data set in step, with the true pose."""
    rng = np.random.default_rng(7)
    data = record(move_bar(field_rig(4.5), rng, frames, 0.9), rng, noise_px=0.15, name="moving")
    rows, files = data.correspondences, dict[str, bytes]()
    recorded = pd.DataFrame({"frame": rows.time_frame, "target": np.array(["A", "B"])[rows.target]})
    sides = (("left", data.primary, rows.primary, 0), ("right", data.secondary, rows.secondary, 1))
    for name, camera, pixels, second in sides:
        table = recorded.assign(x=pixels[:, 0], y=pixels[:, 1])
        kept = table["frame"] >= later if second else table["frame"] < frames - later
        table["frame"] -= later * second
        files[f"{name}.csv"] = table[kept].to_csv(index=False).encode()
        files[f"{name}.json"] = write_camera(camera)
    return files, data
