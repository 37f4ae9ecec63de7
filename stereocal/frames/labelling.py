"""Name the targets A and B alike in both cameras of a frame.

Detection orders the two targets of a photograph left to right or top to bottom; the cameras may
differ, and the epipolar geometry decides (`epipolar_labels`). If a photograph shows more than two
boards, the unambiguous frames decide which are the targets (`choosing`).

Balls and tags have names of their own: the epipolar geometry checks them. A frame that does not fit
the others, or fits them only with A and B exchanged in one camera, is doubtful. Balls of one colour
are named by it.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from stereocal.detection.balls import CERTAIN, choose
from stereocal.detection.detect import Detection
from stereocal.detection.fit import Corner
from stereocal.detection.target import Balls, Bar2x2, Sighting, Spot, Tags, Target
from stereocal.frames.choosing import choose_boards
from stereocal.frames.epipolar_labels import FrameLabels, decide_labels
from stereocal.frames.frame import Centre, CentrePair, Frame, State
from stereocal.frames.pairing import Pair
from stereocal.rig.camera import CAMERAS, Camera

EXCHANGED = "A and B fit the other frames only if they are exchanged in one camera."
FAR_SIGMAS = 4.0
"""A frame that is this much within its own stated errors fits, though others fit better."""
SAME_PX, SAME_RADII = 4.0, 0.7
LEAST, SHARE = 3, 0.15
"""Other photographs with a candidate at the same place, and their share of all."""


def label_frames(
    pairs: Sequence[Pair], seen: Mapping[str, Any], cameras: tuple[Camera, Camera], target: Target
) -> list[Frame]:
    """A frame for each pair, in order, with A and B told apart.

    Args:
        seen: of `search_photographs`.
    """
    if not isinstance(target, Bar2x2):
        return frames_of(pairs, seen, cameras, target)
    labels = label_targets({p.frame: (seen[p.primary], seen[p.secondary]) for p in pairs}, cameras)
    reports = {report.frame: report for report in labels}
    return [_frame(pair, seen, reports[pair.frame]) for pair in pairs]


def _frame(pair: Pair, seen: Mapping[str, Detection], report: FrameLabels) -> Frame:
    # Targets of one photograph are kept: the user may add those of the other.
    first, second = report.targets or (seen[pair.primary].targets, seen[pair.secondary].targets)
    state: State = "found" if report.is_sure else "doubtful"
    return Frame(
        frame=pair.frame,
        files=(pair.primary, pair.secondary),
        centres=(_centres(first), _centres(second)),
        state=state if report.targets else "refused",
        reason=report.sentence,
        use=report.is_sure,
    )


def _centres(targets: Iterable[Corner | Spot | None] | None) -> CentrePair:
    a, b = (
        Centre(float(one.centre[0]), float(one.centre[1]), one.sigma_px) if one else None
        for one in targets or (None, None)
    )
    return a, b


def label_targets(
    seen: Mapping[int, tuple[Detection, Detection]], cameras: tuple[Camera, Camera], seed: int = 0
) -> list[FrameLabels]:
    """Make the labels of both cameras agree; where there are too many boards, choose the targets.

    Args:
        seen: the detections of both cameras by frame number.

    Returns:
        A report for each frame, by their numbers.
    """
    reports = _labelled(seen, cameras, seed)
    open_frames = {
        frame: both for frame, both in seen.items() if any(one.alternatives for one in both)
    }
    if not open_frames:
        return reports
    sure = np.array([report.places for report in reports if report.is_sure])
    chosen = choose_boards(sure.reshape(-1, 2, 2, 2), open_frames, cameras)
    decided = {frame: (one.primary, one.secondary) for frame, one in chosen.items()}
    return [
        replace(report, sentence=f"{report.sentence} {chosen[report.frame].sentence}".strip())
        if report.targets and report.frame in chosen
        else report
        for report in _labelled({**seen, **decided}, cameras, seed)
    ]


def _labelled(
    seen: Mapping[int, tuple[Detection, Detection]], cameras: tuple[Camera, Camera], seed: int
) -> list[FrameLabels]:
    corners = {
        frame: (first.targets, second.targets)
        for frame, (first, second) in sorted(seen.items())
        if first.targets and second.targets
    }
    centres = {
        frame: np.array([[corner.centre for corner in own] for own in both])
        for frame, both in corners.items()
    }
    decided = decide_labels(centres, cameras, seed)
    reports = []
    for frame, found in sorted(seen.items()):
        both = tuple(zip(CAMERAS, found, strict=True))
        if frame not in corners:
            why = (
                one.sentence
                if one.reason == "unreadable"
                else f"{camera.capitalize()}: {one.sentence}"
                for camera, one in both
                if one.sentence
            )
            reports.append(FrameLabels(frame, "refused", np.nan, np.nan, " ".join(why)))
            continue
        exchange, report = decided[frame]
        first, second = corners[frame]
        doubts = [
            f"In the {camera}: {one.sentence}" for camera, one in both if one.state == "doubtful"
        ]
        reports.append(
            replace(
                report,
                state="doubtful" if doubts and report.is_sure else report.state,
                sentence=" ".join([report.sentence, *doubts]).strip(),
                targets=(first, second[::-1] if exchange else second),
            )
        )
    return reports


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
    sides = [
        without_still([seen[name] for name in names])
        for names in ([p.primary for p in pairs], [p.secondary for p in pairs])
    ]
    both = {pair.frame: (sides[0][k], sides[1][k]) for k, pair in enumerate(pairs)}
    centres = {
        frame: np.array([[spot.centre for spot in one.spots if spot] for one in found])
        for frame, found in both.items()
        if all(all(one.spots) for one in found)
    }
    decided = decide_labels(centres, cameras, seed)
    return [_named(pair, both[pair.frame], target.named, decided.get(pair.frame)) for pair in pairs]


def _named(
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
