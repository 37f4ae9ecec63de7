"""The targets of all frames: each photograph by itself, then A and B agreed between the cameras."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path

from stereocal.camera import Camera
from stereocal.corner_fit import Corner
from stereocal.dataset import TARGETS
from stereocal.detection import Detection, detect_targets, refusal
from stereocal.errors import StereocalError
from stereocal.formats.photograph import read_photograph
from stereocal.formats.photograph_files import Photographs
from stereocal.frames import Centre, CentrePair, Frame, State
from stereocal.inspection import Progress, collect, look_through, wrong_sizes
from stereocal.labelling import FrameLabels, LabelledPair, label_targets
from stereocal.pairing import CAMERAS, Pair

STAGES = ("photographs looked through", "photographs searched for targets")
NOTHING: CentrePair = (None, None)
UNREADABLE = (0, 0)


def detect_frames(
    pairs: Sequence[Pair],
    photographs: Photographs,
    cameras: tuple[Camera, Camera],
    executor: Executor,
    begin: Callable[[str], None],
    progress: Progress,
    cancelled: Callable[[], bool] = lambda: False,
) -> list[Frame] | None:
    """All of it: look the photographs through, find the targets, agree on A and B.

    Args:
        photographs: files on disk by name; each is read when its turn comes.
        cameras: the primary and the secondary; their photographs must have their size.
        begin: is told when a stage of `STAGES` begins, whose progress follows.

    Returns:
        A frame for each pair, in their order; None if it was cancelled. A photograph that cannot be
        used refuses its own frame only. Doubtful frames are not used until a person says so.
    """
    begin(STAGES[0])
    wanted = dict.fromkeys(name for pair in pairs for name in (pair.primary, pair.secondary))
    there = {name: photographs[name] for name in wanted if name in photographs}
    looked = look_through(there, executor, progress, cancelled)
    if looked is None:
        return None
    sizes, problems = looked
    problems |= {name: f"{name}: there is no such photograph." for name in wanted.keys() - there}
    problems |= wrong_sizes(pairs, sizes, [camera.image_size for camera in cameras])
    begin(STAGES[1])
    work = {
        executor.submit(_detect, path, name): name
        for name, path in there.items()
        if name not in problems
    }
    seen = collect(work, progress, cancelled)
    if seen is None:
        return None
    seen |= {name: refusal(UNREADABLE, "unreadable", said) for name, said in problems.items()}
    return _agree(pairs, seen, cameras)


def keep_corrections(found: Sequence[Frame], before: Sequence[Frame]) -> list[Frame]:
    """The new frames, but those that a person has worked on as they were."""
    touched = {
        (frame.frame, frame.files): frame
        for frame in before
        if frame.reviewed
        or any(centre and centre.source != "detected" for pair in frame.centres for centre in pair)
    }
    return [touched.get((frame.frame, frame.files), frame) for frame in found]


def _detect(path: Path, name: str) -> Detection:
    try:
        return detect_targets(read_photograph(path, name))
    except StereocalError as error:
        return refusal(UNREADABLE, "unreadable", str(error))


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
        # What one photograph shows is kept: a person may add what the other one hides.
        state = "refused"
        centres = _as_seen(both[0]), _as_seen(both[1])
        reason = " ".join(
            _said(one, name, i)
            for i, (one, name) in enumerate(zip(both, (pair.primary, pair.secondary), strict=True))
            if one.sentence
        )
    return Frame(
        frame=pair.frame,
        files=(pair.primary, pair.secondary),
        centres=centres,
        state=state,
        reason=reason,
        use=state == "found",
    )


def _said(found: Detection, name: str, camera: int) -> str:
    """What is wrong with one photograph, with its camera, or its name if it stands there."""
    sentence = found.sentence
    return sentence if sentence.startswith(name) else f"{CAMERAS[camera].capitalize()}: {sentence}"


def _as_seen(found: Detection) -> CentrePair:
    if found.targets is None:
        return NOTHING
    return _centre(found.targets[0]), _centre(found.targets[1])


def _centre(corner: Corner) -> Centre:
    return Centre(float(corner.centre[0]), float(corner.centre[1]), corner.sigma_px)
