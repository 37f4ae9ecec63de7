"""What stands still before a camera that does not move is not the bar."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from stereocal.detection.balls import CERTAIN, choose
from stereocal.detection.sighting import Sighting, Spot

SAME_PX, SAME_RADII = 4.0, 0.7
LEAST, SHARE = 3, 0.15
"""Other photographs with a candidate at the same place, and their share of all."""


def without_still(seen: Sequence[Sighting]) -> list[Sighting]:
    """Choose again in all photographs of one camera, without what is in the same place in others.

    A photograph where nothing else looks like a ball keeps its choice: the bar may rest.
    """
    if not any(one.candidates for one in seen):
        return list(seen)
    still = [
        _still([one.candidates[k] if one.candidates else () for one in seen])
        for k in range(max(len(one.candidates) for one in seen))
    ]
    chosen = []
    for at, one in enumerate(seen):
        left = tuple(
            tuple(spot for spot, stands in zip(own, still[k][at], strict=True) if not stands)
            for k, own in enumerate(one.candidates)
        )
        enough = 1 if len(left) == 2 else 2
        kept = tuple(
            its if sum(spot.score >= CERTAIN for spot in its) >= enough else own
            for own, its in zip(one.candidates, left, strict=True)
        )
        chosen.append(choose(kept) if one.candidates else one)
    return chosen


def _still(candidates: list[tuple[Spot, ...]]) -> list[list[bool]]:
    """For each photograph and candidate, whether others have one at the same place."""
    where = [
        (at, spot.u, spot.v, max(SAME_PX, SAME_RADII * spot.radius_px))
        for at, own in enumerate(candidates)
        for spot in own
    ]
    if not where:
        return [[] for _ in candidates]
    places = np.array(where)
    near = cKDTree(places[:, 1:3]).query_ball_point(places[:, 1:3], places[:, 3])
    least = max(LEAST, SHARE * len(candidates))
    found: list[list[bool]] = [[] for _ in candidates]
    for (at, *_), own in zip(where, near, strict=True):
        found[at].append(len({int(places[k, 0]) for k in own}) - 1 >= least)
    return found
