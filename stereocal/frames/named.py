"""Frames from targets that have names of their own: balls and tags.

Their names need no epipolar geometry. It checks them: a frame that does not fit the others, or fits
them only with A and B exchanged in one camera, is doubtful. Balls of one colour are named by it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial import cKDTree

from stereocal.detection.balls import CERTAIN, choose
from stereocal.detection.sighting import Sighting, Spot
from stereocal.detection.target import Balls, Tags
from stereocal.frames.epipolar_labels import compare_labels, frame_focal_px
from stereocal.frames.frame import Centre, CentrePair, Frame, State
from stereocal.frames.labelling import FrameLabels, decide_labels
from stereocal.frames.pairing import Pair
from stereocal.rig.camera import CAMERAS, Camera

EXCHANGED = "A and B fit the other frames only if they are exchanged in one camera."
FAR_SIGMAS = 4.0
"""A frame that is this much within its own stated errors fits, though others fit better."""
SAME_PX, SAME_RADII = 4.0, 0.7
LEAST, SHARE = 3, 0.15
"""Other photographs with a candidate at the same place, and their share of all."""
Spots = tuple[Spot | None, Spot | None]


def frames_of(
    pairs: Sequence[Pair],
    seen: Mapping[str, Sighting],
    cameras: tuple[Camera, Camera],
    target: Balls | Tags,
    seed: int = 0,
) -> list[Frame]:
    """A frame for each pair, in order.

    Args:
        seen: by the name of the photograph.
    """
    named = isinstance(target, Tags) or target.named
    sides = [
        without_still([seen[name] for name in names])
        for names in ([p.primary for p in pairs], [p.secondary for p in pairs])
    ]
    both = {pair.frame: (sides[0][k], sides[1][k]) for k, pair in enumerate(pairs)}
    whole = [frame for frame, found in both.items() if all(all(one.spots) for one in found)]
    rays = [
        camera.undistort(
            [(spot.u, spot.v) for frame in whole for spot in both[frame][i].spots if spot]
        ).reshape(-1, 2, 2)
        for i, camera in enumerate(cameras)
    ]
    focal = frame_focal_px(cameras, rays)
    labels = compare_labels(rays[0], rays[1], focal, np.random.default_rng(seed))
    decided = dict(zip(whole, decide_labels(whole, labels), strict=True))
    return [_frame(pair, both[pair.frame], named, decided.get(pair.frame)) for pair in pairs]


def _frame(
    pair: Pair,
    both: tuple[Sighting, Sighting],
    named: bool,
    decided: tuple[bool, FrameLabels] | None,
) -> Frame:
    first, second = (found.spots for found in both)
    reasons = [
        found.missing if found.unreadable else f"{camera.capitalize()}: {found.missing}"
        for found, camera in zip(both, CAMERAS, strict=True)
        if found.missing
    ]
    sure = decided is not None
    if decided is not None:
        exchange, report = decided
        if not named:
            second = second[::-1] if exchange else second
            sure = report.is_sure
            reasons.append(report.sentence)
        else:
            stated = np.sqrt(np.mean([spot.sigma_px**2 for spot in (*first, *second) if spot]))
            far = report.state == "outlying" and report.residual_px > FAR_SIGMAS * stated
            sure = not exchange and not far
            if not sure:
                reasons.append(EXCHANGED if exchange else report.sentence)
    doubts = [
        f"In the {camera}: {doubt}"
        for spots, camera in zip((first, second), CAMERAS, strict=True)
        for spot in spots
        if spot
        for doubt in spot.doubts
    ]
    shared = [a and b for a, b in zip(first, second, strict=True)]
    state: State = "found" if sure and not doubts else "doubtful"
    if not any(shared) or not (named or all(shared)):
        state = "refused"
    return Frame(
        frame=pair.frame,
        files=(pair.primary, pair.secondary),
        centres=(_centres(first), _centres(second)),
        state=state,
        reason=" ".join(filter(None, [*reasons, *doubts])),
        use=state == "found",
    )


def _centres(spots: Spots) -> CentrePair:
    a, b = (Centre(spot.u, spot.v, spot.sigma_px) if spot else None for spot in spots)
    return a, b


def without_still(seen: Sequence[Sighting]) -> list[Sighting]:
    """Choose again in all photographs of one camera, without what is in the same place in others:
    what stands still before a camera that does not move is not the bar.

    A photograph where nothing else looks like a ball keeps its choice: the bar may rest.
    """
    if not any(one.candidates for one in seen):
        return list(seen)
    moving = [
        _moving([one.candidates[k] if one.candidates else () for one in seen])
        for k in range(max(len(one.candidates) for one in seen))
    ]
    chosen = []
    for at, one in enumerate(seen):
        left = [moving[k][at] for k in range(len(one.candidates))]
        enough = 1 if len(left) == 2 else 2
        kept = tuple(
            its if sum(spot.score >= CERTAIN for spot in its) >= enough else own
            for own, its in zip(one.candidates, left, strict=True)
        )
        chosen.append(choose(kept) if one.candidates else one)
    return chosen


def _moving(candidates: list[tuple[Spot, ...]]) -> list[tuple[Spot, ...]]:
    """Of each photograph, the candidates at whose place others have none."""
    every = [(at, spot) for at, own in enumerate(candidates) for spot in own]
    if not every:
        return candidates
    places = np.array([(spot.u, spot.v) for _, spot in every])
    reach = [max(SAME_PX, SAME_RADII * spot.radius_px) for _, spot in every]
    near = cKDTree(places).query_ball_point(places, reach)
    least = max(LEAST, SHARE * len(candidates))
    found: list[tuple[Spot, ...]] = [() for _ in candidates]
    for (at, spot), own in zip(every, near, strict=True):
        if len({every[k][0] for k in own}) - 1 < least:
            found[at] += (spot,)
    return found
