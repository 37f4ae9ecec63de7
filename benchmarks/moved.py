"""A camera that moves while a real recording is taken: which turn is told, and what stood still.

    python -m benchmarks.moved {still,turned} RECORDING... [--angles 0.05 0.1] [--axes 3]

A recording is a folder with dataset.json, of any number of cameras, or a pair of it: ewand123:1-3.

- still: parts in time of 40 frames and more, each half over the next, as they are: of how many it
  is said that a camera moved;
- turned: each camera is turned about its x, y and z axis (its image goes up, aside, round) from a
  third, the half and three quarters of the frames on: how often that is told, with three cameras
  and more of the right one, and how many frames off the frame is (median).
"""

import argparse
import re
from collections import defaultdict
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.errors import StereocalError
from stereocal.fit.calibrate import calibrate_rig
from stereocal.formats.dataset_files import read_recording
from stereocal.rig.recording import Recording
from stereocal.system.array_types import FloatArray

ANGLES = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
FROM = (1 / 3, 1 / 2, 3 / 4)
LENGTHS = (40, 60, 100, 160, 250)


def recording(name: str) -> Recording:
    """A recording, or two cameras of it."""
    path, _, pair = name.partition(":")
    whole = read_recording(path)
    return whole.of_cameras(pair.split("-")) if pair else whole


def turned(rows: Recording, name: str, vector: FloatArray, frame: int) -> Recording:
    """One camera turned about its centre from a frame on; points that leave its image are lost."""
    camera, points = rows.cameras[name], rows.points.copy()
    after = (rows.camera == [*rows.cameras].index(name)) & (rows.frame >= frame)
    rays = np.column_stack([camera.undistort(points[after]), np.ones(after.sum())])
    points[after] = camera.project(rays @ Rotation.from_rotvec(vector).as_matrix().T)
    inside = ((points > 0) & (points < np.array(camera.image_size) - 1)).all(axis=1)
    return replace(rows, points=points).where(np.asarray(inside | ~after))


def said(rows: Recording) -> str:
    """What is said of a movement; empty if nothing is."""
    try:
        words = calibrate_rig(rows).warnings
    except StereocalError as error:
        words = (str(error),)
    return next((word for word in words if " moved " in word), "")


def common_frames(rows: Recording) -> list[int]:
    """The frames that two cameras or more see."""
    frames, images = rows.images()
    seen = np.isfinite(images[..., 0]).any(axis=1).sum(axis=1) > 1
    return list(map(int, frames[seen]))


def still(name: str) -> None:
    """Print of how many parts it is said that a camera moved."""
    rows, told, total = recording(name), list[str](), 0
    frames = common_frames(rows)
    for length in (*LENGTHS, len(frames)):
        for begin in range(0, len(frames) - length + 1, length // 2):
            part = frames[begin : begin + length]
            words = said(rows.where(np.isin(rows.frame, part)))
            total += 1
            told += [f"{part[0]} to {part[-1]}: {words[:90]}"] * bool(words)
    print(f"{name}: said to have moved {len(told)} of {total}", *told, sep="\n    ", flush=True)


def turns(name: str, angles: list[float], axes: int) -> None:
    """Print how many turns are told."""
    rows = recording(name)
    frames = common_frames(rows)
    for angle in angles:
        found, away = defaultdict[str, list[bool]](list), list[int]()
        for camera in rows.cameras:
            for share in FROM:
                first = frames[int(share * len(frames))]
                for axis in range(axes):
                    vector = np.radians(angle) * np.eye(3)[axis]
                    words = said(turned(rows, camera, vector, first))
                    right = len(rows.cameras) < 3 or f"camera {camera} " in words
                    found[f"camera {camera}"].append(bool(words) and right)
                    found[f"about {'xyz'[axis]}"].append(bool(words) and right)
                    if at := re.search(r"(?:frame|and) (\d+)[,:]", words):
                        away.append(abs(int(at[1]) - first))
        each = ", ".join(f"{key} {sum(own)} of {len(own)}" for key, own in found.items())
        off = f"; {np.median(away):.0f} frames off" if away else ""
        print(f"  {name}, {angle} degrees: {each}{off}", flush=True)


def main() -> None:
    """A study of recordings."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study", choices=("still", "turned"))
    parser.add_argument("recordings", nargs="+")
    parser.add_argument("--angles", nargs="*", type=float, default=ANGLES)
    parser.add_argument("--axes", type=int, choices=(1, 2, 3), default=3)
    parsed = parser.parse_args()
    for name in parsed.recordings:
        if parsed.study == "still":
            still(name)
        else:
            turns(name, parsed.angles, parsed.axes)


if __name__ == "__main__":
    main()
