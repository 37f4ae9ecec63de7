"""Two balls or lamps in a photograph: the images of their centres.

Regions of a ball's colour are candidates. A ball's outline is then fitted to the edges around a
region: a circle in the direction of its centre, so that perspective and lens distortion do not
move the centre. The centroid of a region would be off by 15 to 65 % of the radius where the light
comes from the side. Balls that are too small for an outline keep the centroid, with that error.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.detection.ball_colours import Colours, eight_bits, masks
from stereocal.detection.outline import fit_outline
from stereocal.detection.sighting import Sighting, Spot
from stereocal.detection.target import BRIGHT, Balls
from stereocal.rig.camera import Camera

SHORTEST_OUTLINE, LEAST_ROUND, MOST_CANDIDATES = 4, 0.2, 10
RIM_RADIUS = 8.0
"""px; smaller balls have no outline to fit."""
LAMP_SIGMA_PX = 0.05
SIDE_LIGHT = 0.25
"""Standard error of the centroid of a small ball in its radii, with light from any side."""
HIDDEN = 0.45
"""Least part of the outline that must be seen."""
CERTAIN, RUNNER_UP = 0.5, 0.5
SIZE_SPREAD = 0.35
"""Of the logarithm of the ratio of the two radii: one ball may be 1.5 times as far as the other."""


def find_balls(image: npt.NDArray[Any], target: Balls, camera: Camera | None = None) -> Sighting:
    """Find both balls.

    Args:
        image: (h, w, 3), blue, green, red, 8 or 16 bits.
        camera: its lens shapes the outline; None: circles.
    """
    colours = eight_bits(image)
    few = colours[::8, ::8]
    if target.named and not np.ptp(few, axis=2).any():
        grey = "The photograph is grey: take it, or the frames of the video, in colours."
        return Sighting((None, None), grey)
    lamps = target.colours[0] == BRIGHT
    return choose(
        tuple(
            _candidates(colours, _regions(mask), camera, lamps) for mask in masks(colours, target)
        )
    )


def choose(candidates: tuple[tuple[Spot, ...], ...]) -> Sighting:
    """The balls among the candidates, a pair of about the same size.

    Args:
        candidates: those for A and those for B, or once those for two balls of one colour.
    """
    if len(candidates) == 2:
        pairs = list(itertools.product(*candidates))
    else:
        pairs = [
            (a, b) if _order(a, b) else (b, a) for a, b in itertools.combinations(candidates[0], 2)
        ]
    pairs.sort(key=lambda pair: -_likeness(pair))
    if pairs:
        a, b = (_with_doubts(pairs, which) for which in (0, 1))
        return Sighting((a, b), "", candidates=candidates)
    if len(candidates) == 1:
        one = " Only one was found." if candidates[0] else ""
        return Sighting((None, None), f"There are no two balls.{one}", candidates=candidates)
    only = [own[0] if own else None for own in candidates]
    lost = [name for name, spot in zip("AB", only, strict=True) if spot is None]
    missing = f"No ball {' and no ball '.join(lost)} was found."
    return Sighting((only[0], only[1]), missing, candidates=candidates)


def _likeness(pair: tuple[Spot, Spot]) -> float:
    """How much two candidates look like the two balls of a bar, 0 to 1."""
    a, b = pair
    ratio = math.log(a.radius_px / b.radius_px) / SIZE_SPREAD
    return a.score * b.score * math.exp(-0.5 * ratio**2)


def _with_doubts(pairs: list[tuple[Spot, Spot]], which: int) -> Spot:
    """A ball of the best pair, with what is doubtful about it."""
    spot = pairs[0][which]
    doubts = list(spot.doubts)
    at = f"The ball at ({spot.u:.0f}, {spot.v:.0f})"
    if spot.score < CERTAIN:
        doubts.append(f"{at} does not look quite like a ball.")
    for pair in pairs[1:]:
        if spot not in pair and _likeness(pair) > RUNNER_UP * _likeness(pairs[0]):
            u, v = pair[which].u, pair[which].v
            doubts.append(f"{at} may be another one, at ({u:.0f}, {v:.0f}).")
            break
    return replace(spot, doubts=tuple(doubts))


def _order(first: Spot, second: Spot) -> bool:
    """Whether they are ordered from left to right, or from top to bottom."""
    du, dv = second.u - first.u, second.v - first.v
    return (du if abs(du) >= abs(dv) else dv) >= 0


@dataclass(frozen=True, eq=False)
class _Region:
    """A connected region of the target's colour."""

    middle: tuple[float, float]
    """Of the smallest circle around it."""
    radius: float
    centroid: tuple[float, float]
    area: float

    @property
    def roundness(self) -> float:
        """Area over that of the circle: 1 in even light, 0.5 with light from the side."""
        return min(1.0, self.area / (math.pi * self.radius**2))


def _regions(mask: npt.NDArray[np.uint8]) -> list[_Region]:
    """The regions that may be balls, largest round ones first."""
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    found = []
    for outline in outlines:
        if len(outline) < SHORTEST_OUTLINE:
            continue
        (u, v), radius = cv2.minEnclosingCircle(outline)
        moments = cv2.moments(outline)
        # The outline runs through the middles of the outermost pixels.
        area = moments["m00"] + 0.5 * len(outline) + 1.0
        middle = outline.reshape(-1, 2).mean(axis=0).tolist()
        if moments["m00"] > 0:
            middle = [moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]]
        region = _Region((u, v), radius + 0.5, (middle[0], middle[1]), area)
        if region.roundness > LEAST_ROUND:
            found.append(region)
    found.sort(key=lambda one: -one.roundness * one.radius)
    return found[:MOST_CANDIDATES]


def _candidates(
    colours: Colours, regions: list[_Region], camera: Camera | None, lamps: bool
) -> tuple[Spot, ...]:
    """The balls among the regions, best first."""
    found = [spot for region in regions if (spot := _ball(colours, region, camera, lamps))]
    found.sort(key=lambda one: -one.score)
    apart: list[Spot] = []
    for spot in found:
        if all(math.dist((spot.u, spot.v), (s.u, s.v)) > s.radius_px for s in apart):
            apart.append(spot)
    return tuple(apart)


def _ball(colours: Colours, region: _Region, camera: Camera | None, lamp: bool) -> Spot | None:
    """The ball at a region; None if there is none."""
    if region.radius >= 0.75 * RIM_RADIUS:
        found = _outlined(colours, region, camera)
        if found is None or found.radius_px >= RIM_RADIUS:
            return found
    u, v = region.centroid
    sigma = LAMP_SIGMA_PX if lamp else SIDE_LIGHT * region.radius
    score = region.roundness * min(1.0, region.radius / RIM_RADIUS)
    return Spot(u, v, sigma, region.radius, score=score)


def _outlined(colours: Colours, region: _Region, camera: Camera | None) -> Spot | None:
    """The ball at a region by its outline; None if it has none."""
    fitted = fit_outline(colours, region.middle, region.radius, camera)
    if fitted is None:
        return None
    u, v = fitted.centre.tolist()
    doubts: tuple[str, ...] = ()
    if fitted.seen < HIDDEN:
        doubts = (
            f"The ball at ({u:.0f}, {v:.0f}) shows only {100 * fitted.seen:.0f} % of its outline.",
        )
    score = fitted.seen * math.exp(-0.5 * (fitted.scatter / (0.06 * fitted.radius)) ** 2)
    score *= min(1.0, region.area / (0.3 * math.pi * fitted.radius**2))
    return Spot(u, v, fitted.sigma, fitted.radius, doubts, score)
