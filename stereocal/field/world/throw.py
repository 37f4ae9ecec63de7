"""The vertical and the strength of gravity from objects in free flight.

The path of a throw solves x'' = g - k |x'| x', with gravity g as a vector and the drag k common to
all throws of a file. Fitted without drag, a path leans: the drag of a tennis ball (k = 0.011 per
metre) at 6 m/s horizontally is 0.4 m/s^2, or 2 degrees of the vertical.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import block_diag

from stereocal.errors import StereocalError
from stereocal.evaluation.summary import Estimate
from stereocal.field.world import frame
from stereocal.field.world.adjustment import Blocks, Solution, solve
from stereocal.field.world.gravity import Gravity
from stereocal.field.world.noise import (
    ErrorModel,
    MeasuredPoints,
    error_model_of,
    measured_points,
    reconstructed,
    tilt_jacobian,
)
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import Rig
from stereocal.rig.tracks import interpolate
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import rounded

FEWEST_FRAMES = 6
"""Frames of one throw; fewer leave drag and noise undetermined."""
LONGEST_S = 30.0
STEPS = 64
"""Steps of the integration of a path; even, for Simpson's rule."""
ROUNDS = 60
CONTRADICTION = 10.0
"""Residuals over the parameters' image noise, above which the path is no free flight."""
ADVICE = "Take a longer flight, a faster camera, or several throws in different directions."


class Flight(NamedTuple):
    """The frames of one throw: their rows in the table, and seconds from its first frame."""

    rows: IntArray
    times: FloatArray


@dataclass(frozen=True, eq=False)
class FlightFit:
    """Gravity and drag."""

    solution: Solution
    """Gravity (3,) in the primary's frame, m/s^2; the drag per metre, if fitted; and the first
    position and velocity of each throw."""
    noise: ErrorModel
    tilt_jacobian: FloatArray
    """(3, r): what the parameters' errors do to the direction of reconstructed plumb lines."""

    @property
    def up(self) -> FloatArray:
        """(3,) unit vector in the primary's frame."""
        return np.asarray(-self.solution.x[:3] / np.linalg.norm(self.solution.x[:3]))

    @property
    def bound(self) -> float:
        """Angle that holds the error of the vertical at 95 %, radians."""
        size = float(np.linalg.norm(self.solution.x[:3]))
        tilts = -self.solution.shift[:3] / size - self.tilt_jacobian
        covariance = self.solution.covariance[:3, :3] / size**2
        across = np.linalg.svd(self.up[None])[2][1:]
        return self.solution.bound(across @ (covariance + tilts @ tilts.T) @ across.T)

    @property
    def strength(self) -> Estimate:
        """|g|, m/s^2."""
        of_noise = float(self.up @ self.solution.covariance[:3, :3] @ self.up)
        variance = of_noise + float(np.sum((self.up @ self.solution.shift[:3]) ** 2))
        return self.solution.interval(float(np.linalg.norm(self.solution.x[:3])), variance)


def world_of_throw(
    rig: RigParameters, throw: frame.Throw, stated: frame.WorldSettings
) -> frame.WorldFrame:
    """The world frame whose vertical is the acceleration of thrown objects."""
    noise, throw = error_model_of(rig, stated.sigma_px), throw_in_step(rig, throw)
    flights = flights_of(throw)
    names = tuple(
        f"frame {number} of {track}" if track else f"frame {number}"
        for number, track in zip(throw.frames, throw.tracks, strict=True)
    )
    measured = measured_points(rig, reconstructed(rig, throw.pixels, names), noise.spread)
    plain, fit = (fit_flights(rig, measured, flights, noise, drag) for drag in (False, True))
    chosen = fit if stated.drag else plain
    if chosen is None:
        raise StereocalError("The path does not settle; are all frames of a free flight?")
    widening = chosen.solution.widening * chosen.noise.sigma_px / noise.sigma_px
    if widening > CONTRADICTION or (widening > 3 and not chosen.bound < frame.LARGEST_TILT):
        raise StereocalError(
            f"The points are {widening:.0f} times the image noise of {rounded(noise.sigma_px)} px "
            "off the path of a free flight. Leave out frames in which the object was held, caught "
            "or bounced, and make sure that both cameras number the frames alike."
        )
    frame.check_tilt("The throw leaves the vertical", chosen.bound, ADVICE)
    drag = None
    if fit is not None:
        drag = fit.solution.interval(float(fit.solution.x[3]), fit.solution.covariance[3, 3])
    gravity = Gravity(
        chosen.strength,
        throw.frame_rate,
        stated.drag,
        drag,
        None if plain is None else plain.strength.value,
        _per_frame_of_offset(rig, throw, flights),
    )
    first, usual = chosen.solution.x[-6 * len(flights) :][:3], (frame.CAMERA, frame.VIEW)
    pose = frame.frame_of_up(rig, chosen.up, stated.axes, {frame.FIRST: first}, {}, usual)
    throws = f"{len(flights)} throws" if len(flights) > 1 else "a throw"
    sentence = (
        f"World frame of {throws} of {len(throw.frames)} frames: "
        f"{frame.vertical_in_words(pose, chosen.bound)}. {gravity.sentence}"
    )
    limits = {**chosen.noise.entries, "vertical_deg": float(np.degrees(chosen.bound))}
    return frame.WorldFrame(
        pose, "throw", limits, sentence, gravity.notes, {"gravity": gravity.to_json()}
    )


def throw_in_step(rig: RigParameters, throw: frame.Throw) -> frame.Throw:
    """The throw with its secondary points at the instants of the primary's, by the time offset of
    the parameters; without the frames at its ends that have no neighbours for that.
    """
    if rig.time_offset is None:
        return throw
    flights_of(throw)  # what is no throw is refused as it was given
    codes, times = np.unique(throw.tracks, return_inverse=True)[1], throw.frames
    seen, offsets = throw.pixels[:, 2:], rig.time_offset.at(times)
    interpolated = interpolate(codes.astype(np.int64), times, seen, offsets)
    pixels = np.hstack([throw.pixels[:, :2], interpolated.positions])[interpolated.known]
    tracks = tuple(
        name for name, kept in zip(throw.tracks, interpolated.known, strict=True) if kept
    )
    return frame.Throw(tracks, times[interpolated.known], pixels, throw.frame_rate)


def flights_of(throw: frame.Throw) -> list[Flight]:
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
        times = (frames - frames[0]) / throw.frame_rate
        if not times[-1] <= LONGEST_S:
            raise StereocalError(
                f"{where} lasts {times[-1]:.0f} s; is the frame rate right, and are these frames "
                "of one throw?"
            )
        flights.append(Flight(rows, times))
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
    rig: Rig, measured: MeasuredPoints, flights: Sequence[Flight], noise: ErrorModel, drag: bool
) -> FlightFit | None:
    """Gravity and paths, with the noise that the residuals show; None if the drag diverges."""
    order = np.concatenate([flight.rows for flight in flights])
    xyz = measured.xyz[order]
    W = np.linalg.inv(np.linalg.cholesky(measured.own[order])) / noise.sigma_px
    head = 4 if drag else 3

    def paths(x: FloatArray) -> FloatArray:
        k, begun = float(x[3]) if drag else 0.0, x[head:].reshape(-1, 6)
        with np.errstate(over="ignore", invalid="ignore"):
            both = zip(flights, begun, strict=True)
            return np.concatenate(
                [path(f.times, start[:3], start[3:], x[:3], k) for f, start in both]
            )

    def errors(x: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("nij,nj->ni", W, xyz - paths(x)).ravel())

    def by_rig(x: FloatArray) -> FloatArray:
        # On the path: at the measured points, a change of scale would contain their noise.
        on_path = measured_points(rig, paths(x), noise.spread).by_rig
        return np.asarray(np.einsum("nij,njr->nir", W, on_path).reshape(3 * len(W), -1))

    of_error = np.repeat(np.arange(len(flights)), [3 * len(flight.times) for flight in flights])
    start = np.insert(_start(xyz, flights), 3, [0.0] * drag)
    try:
        solution = solve(errors, start, by_rig, Blocks(head, 6, of_error))
    except (ValueError, np.linalg.LinAlgError):
        return None
    factor = None if noise.source == "stated" else solution.noise_factor
    if factor is not None:
        solution = solution.scaled(factor)
        noise = replace(noise, sigma_px=noise.sigma_px * factor, source="residuals")
    up = -solution.x[:3] / np.linalg.norm(solution.x[:3])
    return FlightFit(solution, noise, tilt_jacobian(rig, up, xyz, noise.spread))


def _start(xyz: FloatArray, flights: Sequence[Flight]) -> FloatArray:
    """The unknowns without drag, by unweighted least squares."""
    starts = block_diag(*(np.column_stack([np.ones(len(f.times)), f.times]) for f in flights))
    times = np.concatenate([flight.times for flight in flights])
    x = np.linalg.lstsq(np.column_stack([0.5 * times**2, starts]), xyz, rcond=None)[0]
    return np.asarray(x.ravel())


def _per_frame_of_offset(
    rig: RigParameters, throw: frame.Throw, flights: Sequence[Flight]
) -> float | None:
    """Change of the measured |g| if the secondary's frames were taken one frame later; None if
    that cannot be computed."""
    strengths = []
    order = np.concatenate([flight.rows for flight in flights])
    speed = [np.gradient(throw.pixels[flight.rows, 2:], flight.times, axis=0) for flight in flights]
    for frames in (-0.5, 0.5):
        pixels = throw.pixels[order]
        pixels[:, 2:] += frames / throw.frame_rate * np.concatenate(speed)
        xyz = rig.reconstruct(pixels[:, :2], pixels[:, 2:])
        if not np.isfinite(xyz).all():
            return None
        strengths.append(float(np.linalg.norm(_start(xyz, flights)[:3])))
    return strengths[1] - strengths[0]
