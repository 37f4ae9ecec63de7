"""Name the targets A and B alike in both cameras of a frame.

Detection orders the two targets of a photograph left to right or top to bottom; the cameras may
differ, and the epipolar geometry decides (`epipolar_labels`). If a photograph shows more than two
boards, the unambiguous frames decide which are the targets (`choosing`).

Balls and tags have names of their own: the epipolar geometry checks them. A frame that does not fit
the others, or fits them only with A and B exchanged in one camera, is doubtful. Balls of one colour
are named by it.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from stereocal.detection.balls import CERTAIN, choose_balls
from stereocal.detection.detect import State
from stereocal.detection.target import Balls, Sighting, Spot, Target
from stereocal.frames.choosing import choose_boards
from stereocal.frames.epipolar_labels import FrameLabels, decide_labels
from stereocal.frames.frame import Centre, CentrePair, Frame
from stereocal.frames.pairing import PhotographPair
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.tracks import interpolate
from stereocal.system.array_types import FloatArray

EXCHANGED = "A and B fit the other frames only if they are exchanged in one camera."
FAR_SIGMAS = 4.0
"""A frame that is this much within its own stated errors fits, though others fit better."""
SAME_PX, SAME_RADII = 4.0, 0.7
LEAST, SHARE = 3, 0.15
"""Other photographs with a candidate at the same place, and their share of all."""


def points_by_photograph(
    names: Mapping[str, Sequence[str]], seen: Mapping[str, Sighting], target: Target
) -> dict[str, FloatArray]:
    """(2, 2) pixels of A and B in each photograph of all cameras, NaN where not seen."""
    points = dict[str, FloatArray]()
    for of_camera in names.values():
        sightings = [seen[name] for name in of_camera]
        if isinstance(target, Balls):
            sightings = without_still(sightings)
        for name, sighting in zip(of_camera, sightings, strict=True):
            places = [one.centre if one else (np.nan, np.nan) for one in sighting.spots]
            points[name] = np.array(places)
    return points


def label_frames(
    pairs: Sequence[PhotographPair],
    seen: Mapping[str, Sighting],
    cameras: tuple[Camera, Camera],
    target: Target,
    exchanged: Collection[str] = (),
    late: float = 0.0,
) -> list[Frame]:
    """A frame for each pair, in order, with A and B told apart.

    Args:
        seen: of `search_photographs`.
        exchanged: photographs in which the targets have each other's names.
        late: by what part of a frame the secondary's photographs are later.
    """
    frames = _labelled(pairs, seen, cameras, target, exchanged, late)
    open_frames = {
        pair.frame: (seen[pair.primary], seen[pair.secondary])
        for pair in pairs
        if any(seen[name].alternatives for name in (pair.primary, pair.secondary))
    }
    if not open_frames:
        return frames
    sure = np.array([frame.places for frame in frames if frame.use]).reshape(-1, 2, 2, 2)
    chosen = choose_boards(sure, open_frames, cameras)
    decided = dict(seen)
    for pair in pairs:
        if (one := chosen.get(pair.frame)) is not None:
            decided |= {pair.primary: one.primary, pair.secondary: one.secondary}
    return [
        replace(frame, reason=f"{frame.reason} {chosen[frame.frame].sentence}".strip())
        if frame.state != "refused" and frame.frame in chosen
        else frame
        for frame in _labelled(pairs, decided, cameras, target, exchanged, late)
    ]


def _labelled(
    pairs: Sequence[PhotographPair],
    seen: Mapping[str, Sighting],
    cameras: tuple[Camera, Camera],
    target: Target,
    exchanged: Collection[str],
    late: float,
) -> list[Frame]:
    """The frames, without a choice among more than two boards."""
    sides = [[seen[getattr(pair, which)] for pair in pairs] for which in CAMERAS]
    if isinstance(target, Balls):
        sides = [without_still(sightings) for sightings in sides]
    both = {
        pair.frame: (
            first.turned(pair.primary in exchanged),
            second.turned(pair.secondary in exchanged),
        )
        for pair, first, second in zip(pairs, *sides, strict=True)
    }
    centres = {
        frame: np.array([[one.centre for one in sighting.spots if one] for sighting in sightings])
        for frame, sightings in sorted(both.items())
        if all(all(sighting.spots) for sighting in sightings)
    }
    if late and centres:
        centres = _at_primary(centres, late)
    decided = decide_labels(centres, cameras)
    named = target.named
    return [_frame(pair, both[pair.frame], named, decided.get(pair.frame)) for pair in pairs]


def _at_primary(centres: Mapping[int, FloatArray], late: float) -> dict[int, FloatArray]:
    """The centres with those of the secondary at the instants of the primary's frames; where they
    have no neighbours, as they are."""
    pixels = np.array([*centres.values()])
    frames, targets = np.repeat([*centres], 2), np.tile([0, 1], len(pixels))
    seen = pixels[:, 1].reshape(-1, 2)
    moved = interpolate(targets, frames, seen, np.full(len(seen), late))
    pixels[:, 1] = np.where(moved.known[:, None], moved.positions, seen).reshape(-1, 2, 2)
    return dict(zip(centres, pixels, strict=True))


def _frame(
    pair: PhotographPair,
    both: tuple[Sighting, Sighting],
    named: bool,
    decided: tuple[bool, FrameLabels] | None,
) -> Frame:
    first, second = both
    reasons = [
        sighting.missing if sighting.unreadable else f"{camera.capitalize()}: {sighting.missing}"
        for sighting, camera in zip(both, CAMERAS, strict=True)
        if sighting.missing
    ]
    sure = decided is not None
    if decided is not None:
        exchange, report = decided
        if not named:
            second = second.turned(exchange)
            sure = report.is_sure
            reasons.append(report.sentence)
        else:
            spots = [one for one in (*first.spots, *second.spots) if one]
            stated = np.sqrt(np.mean([spot.sigma_px**2 for spot in spots]))
            far = report.state == "outlying" and report.residual_px > FAR_SIGMAS * stated
            sure = not exchange and not far
            if not sure:
                reasons.append(EXCHANGED if exchange else report.sentence)
    doubts = [
        f"In the {camera}: {doubt}"
        for sighting, camera in zip((first, second), CAMERAS, strict=True)
        for doubt in sighting.doubts
    ]
    shared = [a and b for a, b in zip(first.spots, second.spots, strict=True)]
    state: State = "found" if sure and not doubts else "doubtful"
    if not any(shared) or not (named or all(shared)):
        state = "refused"
    return Frame(
        frame=pair.frame,
        files=(pair.primary, pair.secondary),
        # Targets of one photograph are kept: the user may add those of the other.
        centres=(_centres(first), _centres(second)),
        state=state,
        reason=" ".join(filter(None, [*reasons, *doubts])),
        use=state == "found",
    )


def _centres(seen: Sighting) -> CentrePair:
    a, b = (
        Centre(float(one.centre[0]), float(one.centre[1]), one.sigma_px) if one else None
        for one in seen.spots
    )
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
    for row, one in enumerate(seen):
        left = [moving[k][row] for k in range(len(one.candidates))]
        enough = 1 if len(left) == 2 else 2
        kept = tuple(
            its if sum(spot.score >= CERTAIN for spot in its) >= enough else candidates
            for candidates, its in zip(one.candidates, left, strict=True)
        )
        chosen.append(choose_balls(kept) if one.candidates else one)
    return chosen


def _moving(candidates: list[tuple[Spot, ...]]) -> list[tuple[Spot, ...]]:
    """The candidates of each photograph at whose place others have none."""
    every = [(row, spot) for row, spots in enumerate(candidates) for spot in spots]
    if not every:
        return candidates
    places = np.array([(spot.u, spot.v) for _, spot in every])
    reach = [max(SAME_PX, SAME_RADII * spot.radius_px) for _, spot in every]
    near = cKDTree(places).query_ball_point(places, reach)
    least = max(LEAST, SHARE * len(candidates))
    moving: list[tuple[Spot, ...]] = [() for _ in candidates]
    for (row, spot), close in zip(every, near, strict=True):
        if len({every[k][0] for k in close}) - 1 < least:
            moving[row] += (spot,)
    return moving
