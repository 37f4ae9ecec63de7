"""Find the targets of all frames: detect in each photograph, then label A and B."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
from itertools import combinations

import cv2
import numpy as np

from stereocal.detection.balls import find_balls
from stereocal.detection.detect import detect_targets
from stereocal.detection.tags import find_tags
from stereocal.detection.target import Balls, Sighting, Tags, Target
from stereocal.errors import StereocalError
from stereocal.frames.all_cameras import Found
from stereocal.frames.by_motion import found_by_motion
from stereocal.frames.frame import Frame, describe_frames
from stereocal.frames.labelling import label_frames, points_by_photograph
from stereocal.frames.pairing import Pairing, pairs_of
from stereocal.rig.camera import Camera
from stereocal.rig.rigid_object import RigidObject
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.photograph import (
    PhotographFile,
    photograph_size,
    read_colours,
    read_photograph,
)
from stereocal.system.photograph_files import Photographs, for_worker
from stereocal.system.records import pack
from stereocal.system.tasks import Earlier, Progress, Task, run_tasks

STAGES = ("photographs checked", "photographs searched for targets")


def detect_frames(
    pairing: Pairing,
    photographs: Photographs,
    cameras: Mapping[str, Camera],
    target: Target,
    executor: Executor,
    begin: Callable[[str], None],
    progress: Progress,
    earlier: Earlier[Sighting] | None = None,
) -> Found:
    """Check the photographs, find the targets, find by these which photographs belong together if
    the cameras were started by hand, and label A and B in every pair of cameras.

    Args:
        photographs: files on disk by name, read one at a time.
        cameras: the photographs must have their image size.
        target: what is on the bar.
        begin: called with each stage of `STAGES` when it begins.
        earlier: checkpoint of earlier results by file name, which must identify the content.

    Returns:
        An unusable photograph affects its own frame only. Doubtful frames are not used until the
        user decides.
    """
    names, ways, bar = pairing.names(cameras), ways_of(target), RigidObject.bar(1.0)
    seen = search_photographs(
        names, photographs, cameras, target, executor, begin, progress, earlier
    )
    exchanged, late = frozenset[str](), dict.fromkeys(cameras, 0.0)
    if pairing.by_hand is not None:
        places = points_by_photograph(names, seen, target)
        motion = found_by_motion(pairing.by_hand, places, cameras, bar, ways)
        pairing, exchanged, late = pairing.told_by(motion), motion.exchanged, {**motion.late}
    labelled = {
        (one, other): label_frames(
            pairs_of(pairing.moments, one, other),
            seen,
            (cameras[one], cameras[other]),
            target,
            exchanged,
            late[other] - late[one],
        )
        for one, other in combinations(cameras, 2)
    }
    points = {
        pair: {frame.frame: _points(frame) for frame in of_pair if frame.use}
        for pair, of_pair in labelled.items()
    }
    why = {name: one.missing or " ".join(one.doubts) for name, one in seen.items()}
    frames = next(iter(labelled.values())) if len(cameras) == 2 else []
    sentence = describe_frames(frames) if frames else ""
    return Found(pairing, cameras, bar, ways, points, why, frames, sentence)


def ways_of(target: Target) -> list[IntArray]:
    """The orders of the targets with which the bar looks the same, its own first."""
    return [np.arange(2), np.array([1, 0])][: 1 if target.named else 2]


def search_photographs(
    names: Mapping[str, Sequence[str]],
    photographs: Photographs,
    cameras: Mapping[str, Camera],
    target: Target,
    executor: Executor,
    begin: Callable[[str], None],
    progress: Progress,
    earlier: Earlier[Sighting] | None,
) -> dict[str, Sighting]:
    """What each photograph shows, by name: `detect_frames` without the labels.

    Args:
        names: the photographs of each camera.
    """
    begin(STAGES[0])
    camera_of = {name: camera for camera, of_camera in names.items() for name in of_camera}
    there = {name: photographs[name] for name in camera_of if name in photographs}
    problems = {name: f"{name}: there is no such photograph." for name in {*camera_of} - {*there}}
    # Not on workers: this takes 0.5 ms a photograph, the search 100 times as long.
    for done, (name, path) in enumerate(there.items()):
        try:
            size, camera = photograph_size(path, name), camera_of[name]
            if size != (expected := cameras[camera].image_size):
                problems[name] = (
                    f"{name}: it has {size[0]}x{size[1]} px, and the {camera} camera's file says "
                    f"{expected[0]}x{expected[1]}."
                )
        except StereocalError as error:
            problems[name] = str(error)
        progress(done + 1, len(there))
    begin(STAGES[1])
    searched = {name: path for name, path in there.items() if name not in problems}
    looked_for = {
        camera: hashlib.sha256(pack([target, lens.to_json()])).hexdigest()
        for camera, lens in cameras.items()
    }
    tasks = (
        Task(
            _search,
            (target, cameras[camera_of[name]], for_worker(path, executor), name),
            key=f"{path.name} {looked_for[camera_of[name]]}",
        )
        for name, path in searched.items()
    )
    every = run_tasks(tasks, executor, len(searched), progress, earlier)
    with closing(every) as finished:
        sightings = dict(zip(searched, (sighting for _, sighting in finished), strict=True))
    return sightings | {name: _unreadable(why) for name, why in problems.items()}


def _search(target: Target, camera: Camera, photograph: PhotographFile, name: str) -> Sighting:
    """The targets of one photograph: the task of an executor."""
    cv2.setNumThreads(1)  # the executor already uses all cores
    try:
        if isinstance(target, Balls):
            return find_balls(read_colours(photograph, name), target, camera)
        image = read_photograph(photograph, name)
        if isinstance(target, Tags):
            return find_tags(image, target, camera)
        return detect_targets(image).sighting
    except StereocalError as error:
        return _unreadable(str(error))


def _unreadable(why: str) -> Sighting:
    return Sighting((None, None), why, unreadable=True)


def _points(frame: Frame) -> tuple[FloatArray, FloatArray]:
    """(2, 3) in both cameras: u, v and the standard error of A and B; NaN if not seen."""
    first, second = (
        np.array([(c.u, c.v, c.sigma_px) if c else 3 * (None,) for c in pair], dtype=np.float64)
        for pair in frame.centres
    )
    return first, second


def keep_corrections(frames: Sequence[Frame], before: Sequence[Frame]) -> list[Frame]:
    """The new frames, but as they were where the user reviewed, corrected or placed something; of
    the others, `use` is kept if the state is unchanged."""
    old = {(frame.frame, frame.files): frame for frame in before}
    kept = []
    for frame in frames:
        last = old.get((frame.frame, frame.files), frame)
        placed = any(c and c.source != "detected" for pair in last.centres for c in pair)
        if last.reviewed or last.corrected or placed:
            kept.append(last)
        else:
            kept.append(frame.used(last.use) if last.state == frame.state else frame)
    return kept


def compile_detection() -> None:
    """Compile the numba code of the search (8 s the first time) on synthetic photographs."""
    photograph = np.full((240, 320), 120, np.uint8)
    board = np.kron([[40, 200], [200, 40]], np.ones((35, 35))).astype(np.uint8)
    for left in (60, 190):
        photograph[85:155, left : left + 70] = board
    detect_targets(cv2.GaussianBlur(photograph, (0, 0), 1.0))
    coloured = np.full((240, 320, 3), 120, np.uint8)
    for left, blue in ((60, 0), (190, 220)):
        cv2.circle(coloured, (left + 35, 120), 30, (blue, 0, 220 - blue), -1)
    find_balls(coloured, Balls(("#dc0000", "#0000dc")))
