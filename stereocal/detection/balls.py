"""Two balls or lamps in a photograph: the images of their centres.

Regions of a ball's colour are candidates. A ball's outline is then fitted to the edges around a
region: a circle in the direction of its centre, so that perspective and lens distortion do not
move the centre. The centroid of a region would be off by 15 to 65 % of the radius where the light
comes from the side. Balls that are too small for an outline keep the centroid, with that error.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.detection.ball_colours import LEAST_CHROMA, Colours, colours_in_eight_bits, masks
from stereocal.detection.outline import fit_outline
from stereocal.detection.target import BRIGHT, Balls, Sighting, Spot, in_reading_order, worst
from stereocal.rig.camera import Camera

SHORTEST_OUTLINE, LEAST_ROUND, MOST_CANDIDATES = 4, 0.2, 10
RIM_RADIUS = 8.0
"""px; smaller balls have no outline to fit."""
LAMP_SIGMA_PX = 0.05
SIDE_LIGHT = 0.25
"""Standard error of the centroid of a small ball in its radii, with light from any side."""
CERTAIN, RUNNER_UP = 0.5, 0.5
SIZE_SPREAD = 0.35
"""Spread of the logarithm of the ratio of the two radii: one ball may be 1.5 times as far as the
other."""
HUES = [
    f"#{red:02x}{green:02x}{blue:02x}"
    for red, green, blue in itertools.product((0, 128, 255), repeat=3)
    if 0 in (red, green, blue) and 255 in (red, green, blue)
]
"""12 pure colours, 30 degrees of hue apart; a rule takes in 25 to both sides."""
LARGE_PX = 1000
MOVED = 25
"""Grey levels by which a pixel differs from the background."""
AGREEING = 0.6
"""Least part of the photographs in which both balls are found with the colours proposed."""


def find_balls(image: npt.NDArray[Any], target: Balls, camera: Camera | None = None) -> Sighting:
    """Find both balls in a photograph (h, w, 3), blue, green, red, of 8 or 16 bits; the camera's
    lens shapes their outlines, which are circles without one."""
    colours = colours_in_eight_bits(image)
    few = colours[::8, ::8]
    if target.named and not np.ptp(few, axis=2).any():
        grey = "The photograph is grey: take it, or the frames of the video, in colours."
        return Sighting((None, None), grey)
    lamps = target.colours[0] == BRIGHT
    return choose_balls(
        tuple(_candidates(colours, mask, camera, lamps) for mask in masks(colours, target))
    )


def choose_balls(candidates: tuple[tuple[Spot, ...], ...]) -> Sighting:
    """The balls among the candidates, a pair of about the same size.

    Args:
        candidates: those for A and those for B, or once those for two balls of one colour.
    """
    if len(candidates) == 2:
        pairs = list(itertools.product(*candidates))
    else:
        pairs = [
            (a, b) if in_reading_order(a.centre, b.centre) else (b, a)
            for a, b in itertools.combinations(candidates[0], 2)
        ]
    pairs.sort(key=lambda pair: -_likeness(pair))
    if pairs:
        a, b = (_with_doubts(pairs, which) for which in (0, 1))
        return Sighting((a, b), "", candidates=candidates)
    if len(candidates) == 1:
        one = " Only one was found." if candidates[0] else ""
        return Sighting((None, None), f"There are no two balls.{one}", candidates=candidates)
    only = [spots[0] if spots else None for spots in candidates]
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
    the_ball = f"The ball at ({spot.u:.0f}, {spot.v:.0f})"
    for pair in pairs[1:]:
        if spot not in pair and _likeness(pair) > RUNNER_UP * _likeness(pairs[0]):
            u, v = pair[which].u, pair[which].v
            doubts.append(
                f"{the_ball} is not the only one like it: another is at ({u:.0f}, {v:.0f})."
            )
            break
    return replace(spot, doubts=tuple(doubts))


class _Region(NamedTuple):
    """A connected region of the target's colour."""

    middle: tuple[float, float]
    """Centre of the smallest circle around it."""
    radius: float
    centroid: tuple[float, float]
    area: float
    roundness: float
    """Area over that of the circle: 1 in even light, 0.5 with light from the side."""


def _candidates(
    colours: Colours, mask: npt.NDArray[np.uint8], camera: Camera | None, lamps: bool
) -> tuple[Spot, ...]:
    """The balls among the regions of a mask, best first."""
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    regions = []
    for outline in outlines:
        if len(outline) < SHORTEST_OUTLINE:
            continue
        (u, v), radius = cv2.minEnclosingCircle(outline)
        moments = cv2.moments(outline)
        # The outline runs through the middles of the outermost pixels.
        area, radius = moments["m00"] + 0.5 * len(outline) + 1.0, radius + 0.5
        x, y = outline.reshape(-1, 2).mean(axis=0).tolist()
        if moments["m00"] > 0:
            x, y = moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]
        roundness = min(1.0, area / (math.pi * radius**2))
        if roundness > LEAST_ROUND:
            regions.append(_Region((u, v), radius, (x, y), area, roundness))
    regions.sort(key=lambda one: -one.roundness * one.radius)
    balls = (_ball(colours, region, camera, lamps) for region in regions[:MOST_CANDIDATES])
    scored = sorted(filter(None, balls), key=lambda one: -one.score)
    apart: list[Spot] = []
    for spot in scored:
        if all(math.dist(spot.centre, s.centre) > s.radius_px for s in apart):
            apart.append(spot)
    return tuple(apart)


def _ball(colours: Colours, region: _Region, camera: Camera | None, lamp: bool) -> Spot | None:
    """The ball at a region, by its outline if it is large enough; None if there is none."""
    fitted = None
    if region.radius >= 0.75 * RIM_RADIUS:
        fitted = fit_outline(colours, region.middle, region.radius, camera)
        if fitted is None:
            return None
    if fitted is None or fitted.radius < RIM_RADIUS:
        u, v = region.centroid
        sigma = LAMP_SIGMA_PX if lamp else SIDE_LIGHT * region.radius
        return _spot(
            Spot(u, v, sigma, region.radius),
            (
                min(1.0, region.radius / RIM_RADIUS),
                f"is small, blurred or dark: its colour is {2 * region.radius:.0f} px across, "
                f"{2 * RIM_RADIUS:.0f} px are the least.",
            ),
            (
                region.roundness,
                f"is not round: its colour fills {100 * region.roundness:.0f} % of a circle.",
            ),
        )
    u, v = fitted.centre.tolist()
    covered = region.area / (math.pi * fitted.radius**2)
    return _spot(
        Spot(u, v, fitted.sigma, fitted.radius),
        (fitted.seen, f"is partly hidden: {100 * fitted.seen:.0f} % of its outline are seen."),
        (
            math.exp(-0.5 * (fitted.scatter / (0.06 * fitted.radius)) ** 2),
            f"has an uneven outline: {fitted.scatter:.1f} px from a circle.",
        ),
        (
            min(1.0, covered / 0.3),
            f"is dark or of another colour: {100 * covered:.0f} % of it have the colour.",
        ),
    )


def _spot(spot: Spot, *factors: tuple[float, str]) -> Spot:
    """The spot with its score, the product of the factors, and the worst of them if it is low."""
    score = math.prod(factor for factor, _ in factors)
    doubt = f"The ball at ({spot.u:.0f}, {spot.v:.0f}) {worst(*factors)}"
    return replace(spot, score=score, doubts=(doubt,) * (score < CERTAIN))


def proposed_colours(cameras: Sequence[Sequence[npt.NDArray[Any]]]) -> Balls | None:
    """The colours of the two balls, the bar having moved between the photographs.

    Args:
        cameras: of each camera, which stood still, at least three photographs (h, w, 3), blue,
            green, red.

    Returns:
        None if no two colours are found in most of the photographs.
    """
    small = [[reduced(image) for image in images] for images in cameras]
    every = [image for images in small for image in images]
    proposals = {target for images in small for target in _pairs(images)}
    best, most = None, math.ceil(AGREEING * len(every)) - 1
    for target in sorted(proposals, key=lambda one: one.colours):
        right = 0
        for left, image in zip(range(len(every), 0, -1), every, strict=True):
            if right + left <= most:
                break  # others are in more photographs, whatever the rest shows
            one = find_balls(image, target)
            right += not one.missing and not any(spot.doubts for spot in one.spots if spot)
        if right > most:
            best, most = target, right
    return best


def reduced(image: npt.NDArray[Any]) -> Colours:
    """The photograph (h, w, 3) with 8 bits, halved until no side is longer than `LARGE_PX`."""
    small = colours_in_eight_bits(image)
    while max(small.shape) > LARGE_PX:
        half = cv2.resize(small, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        small = np.asarray(half, np.uint8)
    return small


def _pairs(images: Sequence[Colours]) -> Iterator[Balls]:
    """In each photograph, the colours of the two balls that stand out most."""
    if len(images) < 3 or len({image.shape for image in images}) > 1:
        return
    background = np.median(images, axis=0)
    for image in images:
        still = np.abs(image - background).max(axis=2) <= MOVED
        moving = image.copy()
        moving[still] = np.median(image)
        spots = [
            spot
            for hue in HUES
            for candidates in find_balls(moving, Balls((hue, hue))).candidates
            for spot in candidates
            if spot.score > CERTAIN
        ]
        spots.sort(key=lambda spot: -spot.score * spot.radius_px)
        for a, b in itertools.islice(itertools.combinations(spots, 2), 3):
            one, other = _colour(image, a), _colour(image, b)
            if one and other and math.dist(a.centre, b.centre) > a.radius_px + b.radius_px:
                yield Balls((min(one, other), max(one, other)))


def _colour(image: Colours, spot: Spot) -> str:
    """The colour of the lit side of a ball; empty for a grey."""
    rows, columns = np.ogrid[: image.shape[0], : image.shape[1]]
    inside = image[np.hypot(rows - spot.v, columns - spot.u) < 0.8 * spot.radius_px]
    chroma = np.ptp(inside, axis=1) if len(inside) else np.zeros(1)
    if chroma.max() < LEAST_CHROMA:
        return ""
    blue, green, red = np.median(inside[chroma >= np.median(chroma)], axis=0).astype(int)
    return f"#{red:02x}{green:02x}{blue:02x}"
