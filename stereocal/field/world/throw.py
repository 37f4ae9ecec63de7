"""The vertical and the strength of gravity from objects in free flight.

The path of a throw solves x'' = g - k |x'| x', with gravity g as a vector and the drag k common to
all throws of a file. Fitted without drag, a path leans: the drag of a tennis ball (k = 0.011 per
metre) at 6 m/s horizontally is 0.4 m/s^2, or 2 degrees of the vertical.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.interpolate import CubicHermiteSpline

from stereocal.errors import StereocalError
from stereocal.field.world.adjustment import Blocks, Solution, solve
from stereocal.field.world.frame import (
    CAMERA,
    FIRST,
    LARGEST_TILT,
    VIEW,
    Axes,
    WorldFrame,
    about_noise,
    camera_directions,
    degrees,
    frame_of_up,
    how_cameras_stand,
    tilt_covariance,
)
from stereocal.field.world.gravity import Gravity, difference_words, drag_words
from stereocal.field.world.noise import (
    MeasuredPoints,
    Noise,
    measured_points,
    noise_of,
    reconstructed,
    turns_at,
)
from stereocal.field.world.observed import Throw
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import Rig
from stereocal.rig.tracks import interpolate
from stereocal.system.numbers import rounded

FEWEST_FRAMES = 6
"""Of one throw; fewer leave drag and noise undetermined."""
LONGEST_S = 30.0
STEPS = 64
"""Of the integration of a path; even, for Simpson's rule."""
ROUNDS = 60
CONTRADICTION = 10.0
"""Residuals over the parameters' image noise, above which the path is no free flight."""


@dataclass(frozen=True, eq=False)
class Flight:
    """The frames of one throw."""

    rows: IntArray
    """Of the table."""
    times: FloatArray
    """(n,) seconds from its first frame."""


@dataclass(frozen=True, eq=False)
class FlightFit:
    """Gravity and drag."""

    solution: Solution
    """Of gravity (3,) in the primary's frame, m/s^2; the drag per metre, if fitted; and the first
    position and velocity of each throw."""
    noise: Noise
    turns: FloatArray
    """(3, r): what the parameters' errors do to the direction of reconstructed plumb lines."""

    @property
    def gravity(self) -> FloatArray:
        return np.asarray(self.solution.x[:3])

    @property
    def up(self) -> FloatArray:
        """(3,) unit vector in the primary's frame."""
        return np.asarray(-self.gravity / np.linalg.norm(self.gravity))

    @property
    def bound(self) -> float:
        """Angle that holds the error of the vertical at 95 %, radians."""
        size = float(np.linalg.norm(self.gravity))
        turns = -self.solution.shift[:3] / size - self.turns
        own = self.solution.covariance[:3, :3] / size**2
        return self.solution.bound(tilt_covariance(self.up, own + turns @ turns.T))

    @property
    def strength(self) -> tuple[float, float]:
        """|g| and half of its 95 % interval, m/s^2."""
        own = float(self.up @ self.solution.covariance[:3, :3] @ self.up)
        variance = own + float(np.sum((self.up @ self.solution.shift[:3]) ** 2))
        half = self.solution.quantile * float(np.sqrt(variance))
        return float(np.linalg.norm(self.gravity)), half


def world_of_throw(
    rig: RigParameters,
    throw: Throw,
    axes: Axes | None = None,
    sigma_px: float | None = None,
    drag: bool = True,
) -> WorldFrame:
    """The world frame whose vertical is the acceleration of thrown objects.

    Args:
        sigma_px: noise of an image coordinate; None: as the residuals show it.
        drag: whether the air may slow the object; False for one that is heavy for its size.
    """
    axes, noise = axes or Axes(), noise_of(rig, sigma_px)
    throw = in_step(rig, throw)
    flights = flights_of(throw)
    names = tuple(
        f"frame {frame} of {track}" if track else f"frame {frame}"
        for frame, track in zip(throw.frames, throw.tracks, strict=True)
    )
    xyz = reconstructed(rig, throw.pixels, names)
    measured = measured_points(rig, xyz, noise.spread)
    plain = fit_flights(rig, measured, flights, noise, drag=False)
    fit = fit_flights(rig, measured, flights, noise, drag=True)
    if drag and fit is None:
        raise StereocalError("The path does not settle; are all frames of a free flight?")
    chosen = fit if drag and fit is not None else plain
    assert chosen is not None  # the fit without drag is linear
    _refuse_contradiction(chosen, noise)
    if not chosen.bound < LARGEST_TILT:
        raise StereocalError(
            f"The throw leaves the vertical undetermined (within {degrees(chosen.bound)}): take a "
            "longer flight, a faster camera, or several throws in different directions."
        )
    found = _gravity(rig, throw, flights, chosen, plain, fit)
    origins = {CAMERA: np.zeros(3), FIRST: chosen.solution.x[-6 * len(flights) :][:3]}
    pose = frame_of_up(chosen.up, axes, origins, camera_directions(rig), (CAMERA, VIEW))
    throws = f"{len(flights)} throws" if len(flights) > 1 else "a throw"
    sentence = (
        f"World frame of {throws} of {len(throw.frames)} frames: the vertical is known within "
        f"{degrees(chosen.bound)} (95 %); {how_cameras_stand(pose)}. {found.sentence}"
    )
    return WorldFrame(
        pose,
        "throw",
        {**about_noise(chosen.noise), "vertical_deg": float(np.degrees(chosen.bound))},
        sentence,
        (*drag_words(found), *difference_words(found)),
        {"gravity": found.to_json()},
    )


def in_step(rig: RigParameters, throw: Throw) -> Throw:
    """The throw with its secondary points at the instants of the primary's, by the time offset of
    the parameters; without the frames at its ends that have no neighbours for that.
    """
    if rig.time_offset is None:
        return throw
    flights_of(throw)  # what is no throw is refused as it was given
    codes, times = np.unique(throw.tracks, return_inverse=True)[1], throw.frames
    seen, late = throw.pixels[:, 2:], rig.time_offset.at(times)
    found = interpolate(codes.astype(np.int64), times, seen, late)
    pixels = np.hstack([throw.pixels[:, :2], found.positions])[found.known]
    tracks = tuple(name for name, kept in zip(throw.tracks, found.known, strict=True) if kept)
    return Throw(tracks, times[found.known], pixels, throw.frame_rate)


def flights_of(throw: Throw) -> list[Flight]:
    """The throws, each in the order of its frames."""
    flights = []
    for track in dict.fromkeys(throw.tracks):
        rows = np.flatnonzero(np.array(throw.tracks) == track)
        rows = rows[np.argsort(throw.frames[rows], kind="stable")]
        frames = throw.frames[rows]
        where = f"Throw {track}" if track else "The throw"
        if len(np.unique(frames)) < len(frames):
            twice = int(frames[1:][np.diff(frames) == 0][0])
            raise StereocalError(
                f"{where} has frame {twice} twice; name several throws in a column throw."
            )
        if len(frames) < FEWEST_FRAMES:
            raise StereocalError(
                f"{where} has {len(frames)} frames with a point in both cameras; at least "
                f"{FEWEST_FRAMES} are needed, 30 are a good start."
            )
        if not frames[-1] - frames[0] <= LONGEST_S * throw.frame_rate:
            raise StereocalError(
                f"{where} lasts {(frames[-1] - frames[0]) / throw.frame_rate:.0f} s; is the frame "
                "rate right, and are these frames of one throw?"
            )
        flights.append(Flight(rows, (frames - frames[0]) / throw.frame_rate))
    return flights


def path(
    times: FloatArray, start: FloatArray, velocity: FloatArray, gravity: FloatArray, drag: float
) -> FloatArray:
    """Positions (n, 3) at times (n,) from 0, of x'' = gravity - drag |x'| x'.

    The velocity is integrated until it stays; each round gains a power of drag x speed x time.
    """
    grid = np.linspace(0.0, max(float(times[-1]), 1e-9), STEPS + 1)
    v = velocity + grid[:, None] * gravity
    for _ in range(ROUNDS if drag else 0):
        slowed = gravity - drag * np.linalg.norm(v, axis=1, keepdims=True) * v
        new = velocity + cumulative_simpson(slowed, x=grid, axis=0, initial=0)
        settled = np.abs(new - v).max() < 1e-13 * max(1.0, float(np.abs(v).max()))
        v = new
        if settled or not np.isfinite(v).all():
            break
    p = start + cumulative_simpson(v, x=grid, axis=0, initial=0)
    if not np.isfinite(p).all():
        return np.full((len(times), 3), np.nan)
    return np.asarray(CubicHermiteSpline(grid, p, v)(times))


def fit_flights(
    rig: Rig, measured: MeasuredPoints, flights: Sequence[Flight], noise: Noise, drag: bool
) -> FlightFit | None:
    """Gravity and paths, with the noise that the residuals show; None if the drag diverges."""
    order = np.concatenate([flight.rows for flight in flights])
    xyz = measured.xyz[order]
    W = np.linalg.inv(np.linalg.cholesky(measured.own[order])) / noise.sigma_px
    head = 4 if drag else 3

    def paths(x: FloatArray) -> FloatArray:
        begun = x[head:].reshape(-1, 6)
        k = float(x[3]) if drag else 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            return np.concatenate(
                [
                    path(flight.times, at[:3], at[3:], x[:3], k)
                    for flight, at in zip(flights, begun, strict=True)
                ]
            )

    def errors(x: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("nij,nj->ni", W, xyz - paths(x)).ravel())

    def by_rig(x: FloatArray) -> FloatArray:
        # On the path: at the measured points, a change of scale would contain their noise.
        on_path = measured_points(rig, paths(x), noise.spread).by_rig
        return np.asarray(np.einsum("nij,njr->nir", W, on_path).reshape(3 * len(W), -1))

    of_error = np.repeat(np.arange(len(flights)), [3 * len(each.times) for each in flights])
    try:
        found = solve(errors, _start(xyz, flights, drag), by_rig, Blocks(head, 6, of_error))
    except (ValueError, np.linalg.LinAlgError):
        return None
    factor = None if noise.source == "stated" else found.noise_factor
    if factor is not None:
        found = found.scaled(factor)
        noise = replace(noise, sigma_px=noise.sigma_px * factor, source="residuals")
    up = -found.x[:3] / np.linalg.norm(found.x[:3])
    return FlightFit(found, noise, turns_at(rig, up, xyz, noise.spread))


def _start(xyz: FloatArray, flights: Sequence[Flight], drag: bool) -> FloatArray:
    """The unknowns without drag, by unweighted least squares."""
    design = np.zeros((len(xyz), 1 + 2 * len(flights)))
    row = 0
    for k, flight in enumerate(flights):
        t = flight.times
        rows = slice(row, row + len(t))
        design[rows, 0] = 0.5 * t**2
        design[rows, 1 + 2 * k], design[rows, 2 + 2 * k] = 1.0, t
        row += len(t)
    x = np.linalg.lstsq(design, xyz, rcond=None)[0]
    return np.concatenate([x[0], [0.0] * drag, x[1:].ravel()])


def _refuse_contradiction(fit: FlightFit, noise: Noise) -> None:
    widening = fit.solution.widening * fit.noise.sigma_px / noise.sigma_px
    if widening > CONTRADICTION or (widening > 3 and not fit.bound < LARGEST_TILT):
        raise StereocalError(
            f"The points are {widening:.0f} times the image noise of {rounded(noise.sigma_px)} px "
            "off the path of a free flight. Leave out frames in which the object was held, caught "
            "or bounced, and make sure that both cameras number the frames alike."
        )


def _gravity(
    rig: RigParameters,
    throw: Throw,
    flights: Sequence[Flight],
    chosen: FlightFit,
    plain: FlightFit | None,
    fit: FlightFit | None,
) -> Gravity:
    value, half = chosen.strength
    about_drag: dict[str, Any] = {}
    if fit is not None:
        k = float(fit.solution.x[3])
        reach = fit.solution.quantile * float(np.sqrt(fit.solution.covariance[3, 3]))
        about_drag = {"drag": (k, k - reach, k + reach)}
    return Gravity(
        value,
        value - half,
        value + half,
        throw.frame_rate,
        chosen is fit,
        without_drag=None if plain is None else plain.strength[0],
        per_frame=_per_frame_of_offset(rig, throw, flights),
        **about_drag,
    )


def _per_frame_of_offset(
    rig: RigParameters, throw: Throw, flights: Sequence[Flight]
) -> float | None:
    """Change of the measured |g| if the secondary's frames were taken one frame later; None if
    that cannot be computed."""
    strengths = []
    for frames in (-0.5, 0.5):
        pixels = throw.pixels.copy()
        for flight in flights:
            seen = pixels[flight.rows, 2:]
            pixels[flight.rows, 2:] += (
                frames / throw.frame_rate * np.gradient(seen, flight.times, axis=0)
            )
        xyz = rig.reconstruct(pixels[:, :2], pixels[:, 2:])
        if not np.isfinite(xyz).all():
            return None
        order = np.concatenate([flight.rows for flight in flights])
        strengths.append(float(np.linalg.norm(_start(xyz[order], flights, False)[:3])))
    return strengths[1] - strengths[0]
