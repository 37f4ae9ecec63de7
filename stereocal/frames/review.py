"""Manual review of the found frames, as a list of edits that can be undone, and what is said of it.

`Review` is immutable: each edit returns a new one. An edit that changes nothing is not recorded.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from stereocal.calibration.essential import MINIMUM_PAIRS, calibrate_essential
from stereocal.detection.balls import find_balls
from stereocal.detection.detect import corner_near
from stereocal.detection.tags import find_tags
from stereocal.detection.target import BAR, Balls, Bar2x2, Tags, Target
from stereocal.errors import StereocalError
from stereocal.frames.agreeing import agreeing
from stereocal.frames.frame import Centre, Frame, correspondences_of, name_in
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.correspondences import TARGETS
from stereocal.rig.geometry import stack_rays
from stereocal.rig.rig import Rig
from stereocal.system.numbers import count

SAME_POSITION_PX = 1.0
"""Two targets of a photograph are farther apart: the smallest board is 20 px across."""
SPOT_REACH_PX = 12.0
SAME_TARGET_PX = 30.0
"""A centre this close to a target moves it, even if the other target is still missing."""
DECIDE = "Please decide: check all four targets, then use it or leave it out."
PLACED_BY = {
    "detected": "found",
    "corrected": "you, at the fitted corner",
    "manual": "you, by hand",
}


@dataclass(frozen=True)
class Edit:
    """One frame before and after an edit."""

    before: Frame
    after: Frame
    act: int | None = None
    """What edits of several frames by one press share: they are undone together."""


@dataclass(frozen=True)
class Review:
    """The current frames, and the edits made so far, latest last."""

    frames: tuple[Frame, ...]
    edits: tuple[Edit, ...] = ()

    @property
    def acts(self) -> int:
        """How many times something can be undone."""
        joined = (e.act is not None and e.act == d.act for d, e in pairwise(self.edits))
        return len(self.edits) - sum(joined)

    def frame(self, number: int) -> Frame:
        """The frame of this number."""
        for frame in self.frames:
            if frame.frame == number:
                return frame
        raise StereocalError(f"There is no frame {number} any more; choose another.")


def centre_at(
    image: npt.NDArray[Any],
    point: tuple[float, float],
    raw: bool,
    target: Target = BAR,
    camera: Camera | None = None,
) -> Centre:
    """The centre for a click: the fitted target near it, or the click itself.

    Args:
        image: (h, w), grey; (h, w, 3), blue, green, red, for balls.
        point: the click (u, v), px.
        raw: use the click itself, with unknown standard error.
        target: what is on the bar.
        camera: its lens; used for balls and tags.
    """
    height, width = image.shape[:2]
    u, v = point
    # "not <=" rejects NaN too.
    if not (-0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5):
        raise StereocalError("The click is outside the photograph.")
    if raw:
        return Centre(u, v, None, "manual")
    if not isinstance(target, Bar2x2):
        return _spot_at(image, point, target, camera)
    corner = corner_near(image, point)
    if corner is None:
        raise StereocalError(
            f"There is no corner of four squares near ({u:.1f}, {v:.1f}). Click nearer to one, or "
            "keep the raw click."
        )
    return Centre(float(corner.centre[0]), float(corner.centre[1]), corner.sigma_px, "corrected")


def _spot_at(
    image: npt.NDArray[Any], point: tuple[float, float], target: Balls | Tags, camera: Camera | None
) -> Centre:
    """The centre of the ball or tag near a click."""
    if isinstance(target, Tags):
        what, sighting = "tag", find_tags(image, target, camera)
    else:
        what, sighting = "ball", find_balls(image, target, camera)
    every = [spot for spots in (sighting.spots, *sighting.candidates) for spot in spots if spot]
    near = min(every, key=lambda spot: math.dist(spot.centre, point), default=None)
    if near is None or math.dist(near.centre, point) > max(SPOT_REACH_PX, near.radius_px):
        raise StereocalError(
            f"There is no {what} near ({point[0]:.1f}, {point[1]:.1f}). Click on one, or keep the "
            "raw click."
        )
    return Centre(near.u, near.v, near.sigma_px, "corrected")


def target_meant(frame: Frame, camera: int, centre: Centre) -> int:
    """The target (0 A, 1 B) that a new centre belongs to.

    The missing target, unless the centre is close to the other; if none is missing, the nearest.
    """
    if not any(frame.centres[camera]):
        raise StereocalError(
            f"Neither A nor B is placed in {name_in(camera, frame)}: choose one of them above, and "
            "click again."
        )
    distances = [_distance(placed, centre) for placed in frame.centres[camera]]
    # The missing one is infinitely far.
    far = min(distances) > SAME_TARGET_PX and math.inf in distances
    return distances.index(math.inf if far else min(distances))


def place_target(review: Review, number: int, camera: int, target: int, centre: Centre) -> Review:
    """Set a target in one camera."""
    frame = review.frame(number)
    if _distance(frame.centres[camera][1 - target], centre) < SAME_POSITION_PX:
        raise StereocalError(
            f"Target {TARGETS[1 - target]} is already at this position in "
            f"{name_in(camera, frame)}; swap A and B if that is wrong."
        )
    return _corrected(review, frame, frame.moved(camera, target, centre))


def swap(review: Review, number: int, camera: int) -> Review:
    """Exchange A and B in one camera."""
    frame = review.frame(number)
    swapped = frame.swapped(camera)
    return review if swapped == frame else _corrected(review, frame, swapped)


def use_frame(review: Review, number: int, use: bool) -> Review:
    """Use a frame, or leave it out."""
    frame = review.frame(number)
    if use and not frame.targets_in_both:
        raise StereocalError(
            f"Frame {number} cannot be used: no target is placed in both photographs."
        )
    return _edited(review, frame, replace(frame, use=use, reviewed=True))


def use_agreeing(review: Review, cameras: tuple[Camera, Camera]) -> tuple[Review, str]:
    """Use all doubtful frames whose points agree with the epipolar lines of the frames in use, as
    one act; and what was done, as a sentence.

    Raises:
        StereocalError: as of `agreeing`.
    """
    doubtful = [f for f in review.frames if is_undecided(f) and len(f.targets_in_both) == 2]
    agreed = agreeing([f for f in review.frames if f.use], doubtful, cameras)
    act = 1 + max((edit.act or 0 for edit in review.edits), default=0)
    before = len(review.edits)
    for number in agreed:
        review = use_frame(review, number, True)
    edits = [replace(edit, act=act) for edit in review.edits[before:]]
    review = replace(review, edits=(*review.edits[:before], *edits))
    left = len(doubtful) - len(agreed)
    rest = f" The other {left} {'does' if left == 1 else 'do'} not: look at them." if left else ""
    are = "is now used: it agrees" if len(agreed) == 1 else "are now used: they agree"
    of = f"{len(agreed)} of {count(len(doubtful), 'doubtful frame')}"
    return review, f"{of} {are} with the epipolar lines and the bar's length of the others.{rest}"


def undo(review: Review) -> Review:
    """Undo the latest act, if any: an edit, or those of several frames by one press.

    Only the fields changed by the edit are restored; later changes of other fields remain.
    """
    if not review.edits:
        return review
    *earlier, last = review.edits
    if last.act is not None and earlier and earlier[-1].act == last.act:
        review = undo(replace(review, edits=tuple(earlier)))
        earlier = [*review.edits]
    before, after = vars(last.before), vars(last.after)
    changed = {name: value for name, value in before.items() if value != after[name]}
    frames = [
        replace(frame, **changed) if frame.frame == last.after.frame else frame
        for frame in review.frames
    ]
    return Review(tuple(frames), tuple(earlier))


def is_undecided(frame: Frame) -> bool:
    """Whether the user has still to decide: doubtful or refused, and not reviewed."""
    return frame.state != "found" and not frame.reviewed


def next_doubtful(frames: Sequence[Frame], number: int) -> int | None:
    """The next open frame after `number`, cyclically; None if there is none."""
    doubtful = [frame.frame for frame in frames if is_undecided(frame) and frame.frame != number]
    return min(doubtful, key=lambda other: (other < number, other), default=None)


def beside(frames: Sequence[Frame], number: int, step: int) -> int:
    """The frame `step` positions further on, limited to the first and last frame."""
    numbers = sorted(frame.frame for frame in frames)
    return numbers[min(max(numbers.index(number) + step, 0), len(numbers) - 1)]


def _corrected(review: Review, before: Frame, after: Frame) -> Review:
    """Record a correction, which decides whether a frame is used only if all its targets are sure.

    In a doubtful or refused one the other targets may be wrong too, unless the user placed all.
    """
    placed = [c is not None and c.source != "detected" for pair in after.centres for c in pair]
    shared = bool(after.targets_in_both)
    if after.state == "found" or all(placed):
        after = replace(after, use=shared, reviewed=True)
    return _edited(review, before, replace(after, use=after.use and shared, corrected=True))


def _edited(review: Review, before: Frame, after: Frame) -> Review:
    if after == before:
        return review
    frames = tuple(after if frame.frame == before.frame else frame for frame in review.frames)
    return Review(frames, (*review.edits, Edit(before, after)))


def _distance(placed: Centre | None, centre: Centre) -> float:
    """Distance in px; infinite if the target is not placed."""
    return math.inf if placed is None else math.dist((placed.u, placed.v), (centre.u, centre.v))


def describe_use(frame: Frame) -> str:
    """Sentences on whether a frame is used, and what is left to do."""
    shared = [TARGETS[target] for target in frame.targets_in_both]
    if frame.use and len(shared) == 1:
        sentence = f"It is used, with target {shared[0]} only."
    elif frame.use and shared:
        sentence = "It is used."
    elif shared:
        sentence = "It is left out."
    else:
        sentence = "It is left out: no target is placed in both photographs."
    if frame.corrected or frame.reviewed:
        sentence += f" You have {'corrected' if frame.corrected else 'reviewed'} it."
    if is_undecided(frame):
        sentence += f" {DECIDE}"
    return sentence


def describe_residuals(
    frames: Sequence[Frame], frame: Frame, cameras: tuple[Camera | None, Camera | None]
) -> str:
    """A sentence with the distances from the epipolar lines, or why they are unknown."""
    primary, secondary = cameras
    if primary is None or secondary is None:
        return "Both camera files are needed to compare this frame with the others."
    try:
        residuals_px = epipolar_residuals_px(frames, frame.frame, (primary, secondary))
    except StereocalError as error:
        return str(error)
    if not residuals_px:
        return "Place a target in both photographs to compare this frame with the others."
    listed = ", ".join(f"{TARGETS[target]} {away:.2f} px" for target, away in residuals_px.items())
    return f"Distance from the epipolar lines of the other frames: {listed}."


def epipolar_residuals_px(
    frames: Sequence[Frame], number: int, cameras: tuple[Camera, Camera]
) -> dict[int, float]:
    """Distance from the epipolar line of each target that both photographs of a frame show.

    The essential matrix is estimated from the other used frames, without the frame itself.

    Returns:
        By target (0 A, 1 B), px as of `Camera`, the larger of the two cameras.
    """
    others = [frame for frame in frames if frame.use and frame.frame != number]
    shared = sum(len(frame.targets_in_both) for frame in others)
    if shared < MINIMUM_PAIRS:
        raise StereocalError(
            f"The other used frames have {shared} point pairs; at least {MINIMUM_PAIRS} are needed "
            "for the epipolar geometry."
        )
    (reviewed,) = (frame for frame in frames if frame.frame == number)
    if not reviewed.targets_in_both:
        return {}
    rows = correspondences_of(others)
    rays = stack_rays(cameras[0].undistort(rows.primary), cameras[1].undistort(rows.secondary))
    rays = rays[:, np.isfinite(rays).all(axis=0)]
    pose = calibrate_essential(rays, 1.0).pose
    points = correspondences_of([reviewed.used(True)])
    distances = Rig(*cameras, pose).epipolar_distances(points.primary, points.secondary)
    worst = distances.max(axis=1)
    return {int(t): float(away) for t, away in zip(points.target, worst, strict=True)}


def centres_table(frame: Frame) -> pd.DataFrame:
    """The centres of a frame, one row per target and camera."""
    lines = {}
    for target, camera in product((0, 1), (0, 1)):
        cells, centre = ["–", "–", "–", "not placed"], frame.centres[camera][target]
        if centre is not None:
            sigma = "unknown" if centre.sigma_px is None else f"{centre.sigma_px:.3f}"
            cells = [f"{centre.u:.2f}", f"{centre.v:.2f}", sigma, PLACED_BY[centre.source]]
        lines[f"{TARGETS[target]} {CAMERAS[camera]}"] = cells
    columns = ["u, px", "v, px", "Sigma, px", "Placed by"]
    return pd.DataFrame.from_dict(lines, orient="index", columns=columns).rename_axis("Target")
