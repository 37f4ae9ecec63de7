"""Find the targets of all frames: detect in each photograph, then label A and B."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from typing import Any

import cv2
import numpy as np

from stereocal.detection.balls import find_balls
from stereocal.detection.detect import Detection, detect_targets, refusal
from stereocal.detection.fit import Corner
from stereocal.detection.sighting import Sighting
from stereocal.detection.target import BAR, Balls, Bar2x2, Target
from stereocal.frames.frame import Centre, CentrePair, Frame, State
from stereocal.frames.inspection import inspect_photographs, wrong_sizes
from stereocal.frames.labelling import FrameLabels, LabelledPair, label_targets
from stereocal.frames.named import frames_of
from stereocal.frames.pairing import Pair
from stereocal.frames.series import detect_series, search_series, sight_in_file
from stereocal.rig.camera import CAMERAS, Camera, CameraName
from stereocal.rig.dataset import TARGETS
from stereocal.system.photograph_files import Photographs
from stereocal.system.records import of_plain, pack
from stereocal.system.tasks import Pieces, Progress

STAGES = ("photographs checked", "photographs searched for targets")
NOTHING: CentrePair = (None, None)
UNREADABLE = (0, 0)


def pack_detection(found: Detection | Sighting) -> bytes | None:
    """A detection; None for an unreadable photograph, so that it is tried again next time."""
    again = found.unreadable if isinstance(found, Sighting) else found.reason == "unreadable"
    return None if again else pack(found)


def unpack_detection(content: bytes) -> Detection | Sighting:
    """The exact detection of `pack_detection`; ValueError if the content is damaged."""
    data = json.loads(content)
    if not isinstance(data, dict):
        raise ValueError(content)
    return of_plain(data, Sighting) if "spots" in data else of_plain(data, Detection)


def detect_frames(
    pairs: Sequence[Pair],
    photographs: Photographs,
    cameras: tuple[Camera, Camera],
    executor: Executor,
    begin: Callable[[str], None],
    progress: Progress,
    cancelled: Callable[[], bool] = lambda: False,
    pieces: Pieces[Any] | None = None,
    target: Target = BAR,
) -> list[Frame] | None:
    """Check the photographs, find the targets, and label A and B.

    Args:
        photographs: files on disk by name, read one at a time.
        cameras: primary and secondary; the photographs must have their image size.
        begin: called with each stage of `STAGES` when it begins.
        pieces: as for `detect_series`.
        target: what is on the bar.

    Returns:
        A frame for each pair, in order; None if cancelled. An unusable photograph affects its own
        frame only. Doubtful frames are not used until the user decides.
    """
    names = {str(camera): [getattr(pair, camera) for pair in pairs] for camera in CAMERAS}
    lenses: dict[str, Camera] = dict(zip(CAMERAS, cameras, strict=True))
    seen = search_photographs(
        names, photographs, lenses, executor, begin, progress, cancelled, pieces, target
    )
    return None if seen is None else label_frames(pairs, seen, cameras, target)


def search_photographs(
    names: Mapping[str, Sequence[str]],
    photographs: Photographs,
    cameras: Mapping[str, Camera],
    executor: Executor,
    begin: Callable[[str], None],
    progress: Progress,
    cancelled: Callable[[], bool],
    pieces: Pieces[Any] | None,
    target: Target,
) -> dict[str, Any] | None:
    """Check the photographs and find the targets in each, as `detect_frames`.

    Args:
        names: of the photographs of each camera.

    Returns:
        By photograph a `Detection` of a bar with 2x2 targets, a `Sighting` of others.
    """
    begin(STAGES[0])
    camera_of = {name: camera for camera, own in names.items() for name in own}
    there = {name: photographs[name] for name in camera_of if name in photographs}
    inspected = inspect_photographs(there, progress, cancelled)
    if inspected is None:
        return None
    sizes, problems = inspected
    problems |= {name: f"{name}: there is no such photograph." for name in {*camera_of} - {*there}}
    problems |= wrong_sizes(names, sizes, {key: own.image_size for key, own in cameras.items()})
    begin(STAGES[1])
    searched = {name: path for name, path in there.items() if name not in problems}
    if not isinstance(target, Bar2x2):
        spots = search_series(
            searched,
            lambda name: partial(sight_in_file, target, cameras[camera_of[name]]),
            executor,
            progress,
            cancelled,
            pieces,
        )
        if spots is None:
            return None
        return spots | {name: Sighting((None, None), why, True) for name, why in problems.items()}
    seen = detect_series(searched, executor, progress, cancelled, pieces)
    if seen is None:
        return None
    return seen | {name: refusal(UNREADABLE, "unreadable", why) for name, why in problems.items()}


def label_frames(
    pairs: Sequence[Pair], seen: Mapping[str, Any], cameras: tuple[Camera, Camera], target: Target
) -> list[Frame]:
    """A frame for each pair, in order, with A and B told apart.

    Args:
        seen: of `search_photographs`.
    """
    if isinstance(target, Bar2x2):
        return _agree(pairs, seen, cameras)
    return frames_of(pairs, seen, cameras, target)


def keep_corrections(found: Sequence[Frame], before: Sequence[Frame]) -> list[Frame]:
    """The new frames, with the user's decisions about the old ones.

    A frame that the user reviewed or corrected, or in which the user placed a target, stays as it
    was. Of the others, `use` is kept if the state is unchanged.
    """
    old = {(frame.frame, frame.files): frame for frame in before}
    kept = []
    for frame in found:
        last = old.get((frame.frame, frame.files))
        if last is None:
            kept.append(frame)
        elif (
            last.reviewed
            or last.corrected
            or any(c and c.source != "detected" for pair in last.centres for c in pair)
        ):
            kept.append(last)
        elif last.state == frame.state:
            kept.append(frame.used(last.use))
        else:
            kept.append(frame)
    return kept


def compile_detection() -> None:
    """Compile the numba code of the search (12 s the first time) on a synthetic photograph."""
    photograph = np.full((240, 320), 120, np.uint8)
    board = np.kron([[40, 200], [200, 40]], np.ones((35, 35))).astype(np.uint8)
    for left in (60, 190):
        photograph[85:155, left : left + 70] = board
    detect_targets(cv2.GaussianBlur(photograph, (0, 0), 1.0))
    find_balls(cv2.cvtColor(photograph, cv2.COLOR_GRAY2BGR), Balls(("#ff0000", "#0000ff")))


def _agree(
    pairs: Sequence[Pair], seen: Mapping[str, Detection], cameras: tuple[Camera, Camera]
) -> list[Frame]:
    labelling = label_targets(
        {pair.frame: seen[pair.primary] for pair in pairs},
        {pair.frame: seen[pair.secondary] for pair in pairs},
        cameras,
    )
    labels = {report.frame: report for report in labelling.frames}
    labelled = {(found.frame, found.target): found for found in labelling.pairs}
    return [_frame(pair, seen, labels[pair.frame], labelled) for pair in pairs]


def _frame(
    pair: Pair,
    seen: Mapping[str, Detection],
    report: FrameLabels,
    labelled: Mapping[tuple[int, str], LabelledPair],
) -> Frame:
    both = seen[pair.primary], seen[pair.secondary]
    found = [labelled.get((pair.frame, target)) for target in TARGETS]
    if all(found):
        first, second = (
            tuple(_centre(getattr(one, camera)) for one in found) for camera in CAMERAS
        )
        state: State = "found" if report.state in ("agreed", "swapped") else "doubtful"
        centres: tuple[CentrePair, CentrePair] = ((first[0], first[1]), (second[0], second[1]))
        reason = report.sentence
    else:
        # Targets of one photograph are kept: the user may add those of the other.
        state = "refused"
        centres = _as_seen(both[0]), _as_seen(both[1])
        reason = " ".join(
            _message(one, camera) for one, camera in zip(both, CAMERAS, strict=True) if one.sentence
        )
    return Frame(
        frame=pair.frame,
        files=(pair.primary, pair.secondary),
        centres=centres,
        state=state,
        reason=reason,
        use=state == "found",
    )


def _message(found: Detection, camera: CameraName) -> str:
    """The message on one photograph, starting with its name or its camera."""
    if found.reason == "unreadable":
        return found.sentence
    return f"{camera.capitalize()}: {found.sentence}"


def _as_seen(found: Detection) -> CentrePair:
    if found.targets is None:
        return NOTHING
    return _centre(found.targets[0]), _centre(found.targets[1])


def _centre(corner: Corner) -> Centre:
    return Centre(float(corner.centre[0]), float(corner.centre[1]), corner.sigma_px)
