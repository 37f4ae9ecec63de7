"""A recording of all cameras in the files of another program, by reading every pair of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.archives.archive import Taken
from stereocal.formats.archives.easywand import open_easywand
from stereocal.formats.archives.gather import gather
from stereocal.formats.exchange.exchange import camera_names
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.other_files import is_matlab
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import RigidObject


@dataclass(frozen=True, eq=False)
class EveryCamera:
    """The recording, and what was taken from where."""

    recording: Recording
    taken: tuple[Taken, ...]
    remarks: tuple[str, ...]


def gather_all(
    files: Mapping[str, bytes], options: ExchangeOptions, name: str, distance_m: float | None
) -> EveryCamera:
    """The recording of all cameras, named by their numbers; baselines are free.

    Args:
        distance_m: between the targets A and B; None: that of the files.

    Raises:
        StereocalError: the files name fewer than three cameras, or a part is missing.
    """
    count = _count(files)
    if count < 3:
        raise StereocalError(
            "--cameras all is for files of three cameras or more; these name "
            f"{count or 'none'}: give --cameras 1,2."
        )
    cameras: dict[str, Camera] = {}
    images: dict[tuple[int, int, int], FloatArray] = {}
    taken: dict[str, Taken] = {}
    remarks: dict[str, None] = {}
    failed: list[str] = []
    numbers = [str(number + 1) for number in range(count)]
    for pair in combinations(range(count), 2):
        chosen = numbers[pair[0]], numbers[pair[1]]
        try:
            found = gather(files, replace(options, cameras=chosen), baseline_known=True)
        except StereocalError as error:  # as of two cameras that see nothing together
            failed.append(f"Cameras {' and '.join(chosen)}: {error}")
            continue
        distance_m = found.target_distance_m if distance_m is None else distance_m
        if found.primary is None or found.secondary is None or found.correspondences is None:
            lines = found.missing(1.0, distance_m or 1.0)
            raise StereocalError("; ".join(f"{each.what} missing, {each.origin}" for each in lines))
        cameras |= {chosen[0]: found.primary, chosen[1]: found.secondary}
        rows = found.correspondences
        times, targets = rows.time_frame.tolist(), rows.target.tolist()
        for which, pixels in zip(pair, (rows.primary, rows.secondary), strict=True):
            for frame, target, pixel in zip(times, targets, pixels, strict=True):
                before = images.setdefault((frame, which, target), pixel)
                if not np.allclose(before, pixel, rtol=0.0, atol=1e-6):
                    raise StereocalError(
                        f"The table does not have the points of all {count} cameras that the "
                        "camera files name: give the table of all, or --cameras 1,2."
                    )
        taken |= {f"{each.what} {each.taken}": each for each in found.taken}
        remarks |= dict.fromkeys(found.remarks)
    if len(cameras) < count:
        raise StereocalError(failed[0])
    if distance_m is None:
        raise StereocalError("distance A-B is missing: give --distance D in metres.")
    keys = sorted(images)
    frame, camera, target = np.array(keys, dtype=np.int64).T
    recording = Recording(
        name,
        {number: cameras[number] for number in numbers},
        RigidObject.bar(distance_m),
        frame,
        camera,
        target,
        np.array([images[key] for key in keys]),
        np.full(len(keys), np.nan),
    )
    lines = [each for each in taken.values() if "point" not in each.what]
    lines.insert(0, Taken("points", f"{len(keys)} of {count} cameras", ", ".join(files)))
    return EveryCamera(recording, tuple(lines), (*remarks, *failed))


def _count(files: Mapping[str, bytes]) -> int:
    """How many cameras the files name."""
    found = 0
    for name, content in files.items():
        opened = open_easywand(content, name) if is_matlab(content) else None
        named = opened.cameras if opened is not None else camera_names(name, content)
        found = max(found, len(named))
    return found
