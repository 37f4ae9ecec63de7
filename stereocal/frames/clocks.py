"""The times of the photographs of a camera, by what its files say."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stereocal.frames.by_time import Alignment, align
from stereocal.rig.compiled import FloatArray
from stereocal.system.taken import Source, Taken

LEAST_PAUSE_S = 2.0
"""Files that were written faster than this tell when they were copied."""


@dataclass(frozen=True, eq=False)
class Times:
    """The times of one camera."""

    names: list[str]
    """Photographs with a time, in order."""
    seconds: FloatArray
    step: float
    source: Source
    zones: list[float | None]


def times_of(names: Sequence[str], taken: Mapping[str, Taken]) -> Times:
    """Of most of the photographs of a camera, by one source."""
    sources = [taken[name].source for name in names if taken[name].seconds is not None]
    source: Source = max(sources, key=sources.count, default="")
    own = {name: taken[name] for name in names if source and taken[name].source == source}
    seconds = np.array([one.seconds for one in own.values()], np.float64)
    step = max((one.step for one in own.values()), default=1.0)
    return Times([*own], seconds, step, source, [one.zone for one in own.values()])


def aligned_clocks(first: Times, second: Times) -> Alignment | None:
    """The photographs of two cameras that fit by time; None if their times cannot tell."""
    times = first, second
    zones = [zone for own in times for zone in own.zones]
    clocks = []
    for own in times:
        if own.source == "file" and _pause(own.seconds) < LEAST_PAUSE_S:
            return None
        ahead = np.zeros(len(own.names))
        if None not in own.zones and own.zones:
            # Of one camera only, no more than what its zone has changed.
            start = own.zones[0] if None in zones else 0.0
            ahead = np.array(own.zones, np.float64) - (start or 0.0)
        clocks.append(own.seconds - ahead)
    return align(clocks[0], clocks[1], (times[0].step, times[1].step))


def _pause(seconds: FloatArray) -> float:
    return float(np.median(np.diff(np.sort(seconds)))) if len(seconds) > 1 else 0.0
