"""The targets of all frames: each photograph by itself, then A and B agreed between the cameras."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

from stereocal.detection import detect_targets
from stereocal.errors import StereocalError
from stereocal.formats.photograph import GreyImage, read_photograph
from stereocal.formats.photograph_files import Photographs
from stereocal.frames import Centre, CentrePair, Frame, State
from stereocal.inspection import Progress, collect, look_through, wrong_sizes
from stereocal.pairing import CAMERAS, Pair

STAGES = ("photographs looked through", "photographs searched for targets")
NOTHING: CentrePair = (None, None)


@dataclass(frozen=True)
class Sighting:
    """What was seen in one photograph."""

    centres: CentrePair
    state: State
    reason: str = ""


Locate = Callable[[GreyImage], Sighting]


def sight_all(
    pairs: Sequence[Pair],
    photographs: Photographs,
    problems: Mapping[str, str],
    locate: Locate,
    executor: Executor,
    progress: Progress,
    cancelled: Callable[[], bool],
) -> list[Frame] | None:
    """Look for the targets in every photograph of the pairs; each is read when its turn comes.

    Args:
        photographs: files on disk by name; one that is missing is said with its frame.
        problems: photographs that are known to be useless, with a sentence; they are not read.
        locate: finds the targets in one photograph; with a process pool it must be importable.

    Returns:
        The frames in the order of the pairs; None if it was cancelled.
    """
    names = dict.fromkeys(name for pair in pairs for name in (pair.primary, pair.secondary))
    work = {
        executor.submit(_sight, photographs[name], name, locate): name
        for name in names
        if name in photographs and name not in problems
    }
    seen = collect(work, progress, cancelled)
    if seen is None:
        return None
    for name in names:
        reason = problems.get(name, f"{name}: there is no such photograph.")
        seen.setdefault(name, Sighting(NOTHING, "refused", reason))
    return [_frame(pair, seen[pair.primary], seen[pair.secondary]) for pair in pairs]


def _sight(path: Path, name: str, locate: Locate) -> Sighting:
    try:
        return locate(read_photograph(path, name))
    except StereocalError as error:
        return Sighting(NOTHING, "refused", str(error))


def _frame(pair: Pair, primary: Sighting, secondary: Sighting) -> Frame:
    both = (primary, secondary)
    states = {sighting.state for sighting in both}
    state: State = (
        "refused" if "refused" in states else "doubtful" if "doubtful" in states else "found"
    )
    reasons = [
        sighting.reason
        if sighting.reason.startswith((pair.primary, pair.secondary))
        else f"{CAMERAS[camera]}: {sighting.reason}"
        for camera, sighting in enumerate(both)
        if sighting.reason
    ]
    return Frame(
        frame=pair.frame,
        files=(pair.primary, pair.secondary),
        centres=(primary.centres, secondary.centres),
        state=state,
        reason=" ".join(reasons),
        use=state == "found",
    )


def only_centres(found: Sequence[Centre]) -> CentrePair:
    """One or two centres as A and B, as they come; their names are agreed later."""
    first, second = [*found, None, None][:2]
    return first, second


def locate_targets(image: GreyImage) -> Sighting:
    """What `detection.detect_targets` sees in a photograph."""
    found = detect_targets(image)
    centres = [
        Centre(float(corner.centre[0]), float(corner.centre[1]), corner.sigma_px)
        for corner in found.targets or ()
    ]
    return Sighting(only_centres(centres), found.state, found.sentence)


def detect_frames(
    pairs: Sequence[Pair],
    photographs: Photographs,
    sizes: Sequence[tuple[int, int] | None],
    executor: Executor,
    begin: Callable[[str], None],
    progress: Progress,
    cancelled: Callable[[], bool] = lambda: False,
) -> list[Frame] | None:
    """All of it: look the photographs through, find the targets, agree on A and B.

    Args:
        photographs: files on disk by name.
        sizes: (width, height) that the primary and the secondary camera's file tell, or None.
        begin: is told when a stage of `STAGES` begins, whose progress follows.

    Returns:
        A frame for each pair, in their order; None if it was cancelled. A photograph that cannot be
        used refuses its own frame only.
    """
    begin(STAGES[0])
    wanted = dict.fromkeys(name for pair in pairs for name in (pair.primary, pair.secondary))
    there = {name: photographs[name] for name in wanted if name in photographs}
    looked = look_through(there, executor, progress, cancelled)
    if looked is None:
        return None
    found, problems = looked
    problems = problems | wrong_sizes(pairs, found, sizes)
    begin(STAGES[1])
    return sight_all(pairs, photographs, problems, locate_targets, executor, progress, cancelled)


def keep_corrections(found: Sequence[Frame], before: Sequence[Frame]) -> list[Frame]:
    """The new frames, but those that a person has worked on as they were."""
    touched = {
        (frame.frame, frame.files): frame
        for frame in before
        if any(centre and centre.source != "detected" for pair in frame.centres for centre in pair)
    }
    return [touched.get((frame.frame, frame.files), frame) for frame in found]
