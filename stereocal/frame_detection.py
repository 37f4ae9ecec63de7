"""The targets of all frames: each photograph by itself, then A and B agreed between the cameras."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

from stereocal.errors import StereocalError
from stereocal.formats.photograph import GreyImage, read_photograph
from stereocal.formats.photograph_files import Photographs
from stereocal.frames import Centre, CentrePair, Frame, State
from stereocal.inspection import Progress, collect
from stereocal.pairing import CAMERAS, Pair

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
