"""The world frame of surveyed points: a rigid fit, and whether the survey can be true."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.errors import StereocalError
from stereocal.evaluation.summary import Estimate
from stereocal.field.world import frame
from stereocal.field.world.adjustment import Solution, culprit, solve
from stereocal.field.world.noise import (
    ErrorModel,
    MeasuredPoints,
    error_model_of,
    measured_points,
    reconstructed,
)
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import RigParameters
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import rounded

FEWEST_POINTS = 3
CLEARLY_WORSE = 25.0
"""Difference of chi-square that tells the survey from its mirror image: five standard errors."""
LARGEST_RESIDUAL = 0.05
"""Root mean square residual over the extent of the points; above it the input is contradictory."""
METRES_A_DEGREE = 111_320.0
"""Of latitude; of longitude it is less by the cosine of the latitude."""
SUITS = (0.3, 5.0)
"""Extent of two coordinates in degrees, as metres, over that of the measured points, which holds
the height too; degrees of longitude are down to a fifth as long at 78 degrees."""
MOST_TRIED = 50
"""Points that are left out one by one to find the one that contradicts the others."""
LARGEST_SCALE = 1.2
"""Lengths of the survey over those measured; beyond it one of the two has another unit."""
UPSIDE_DOWN = -0.2
"""`uprightness` below which cameras count as upside down."""
UPRIGHT = 0.5
"""Least `uprightness` that tells points in one plane from mirrored ones: tilted by 60 degrees."""


@dataclass(frozen=True, eq=False)
class RigidFit:
    """world = R (X - middle) + centre, and its errors."""

    pose: Pose
    """`world_from_primary`."""
    scale: float
    residuals_m: FloatArray
    """(n, 3): measured minus surveyed, in the world's axes."""
    limit_m: float
    """Largest root mean square residual of points that do not contradict each other."""
    solution: Solution
    """A small rotation about the world's axes, the centre, and, if fitted, log scale."""

    @property
    def rms_m(self) -> float:
        return _rms(self.residuals_m)

    @property
    def is_close(self) -> bool:
        """Whether the residuals are small, or no larger than the noise explains."""
        return self.rms_m <= self.limit_m or self.solution.widening < 3


def world_of_survey(
    rig: RigParameters, survey: frame.Survey, stated: frame.WorldSettings
) -> frame.WorldFrame:
    """The world frame of surveyed points."""
    sigma_m, world_m = stated.survey_sigma_m, survey.world_m
    if not (np.isfinite(sigma_m) and sigma_m >= 0):
        raise StereocalError(f"The survey's standard error is {sigma_m} m; it must be 0 or more.")
    noise, names = error_model_of(rig, stated.sigma_px), np.array(survey.names)
    distinct = list(dict.fromkeys(survey.names))
    measured = _measured(rig, survey, noise)
    scaled, hand = _scaled_fit(measured, survey, noise, sigma_m)
    fit = fit_rigid(measured, world_m, noise, sigma_m)
    if not hand and frame.uprightness(rig, fit.pose.R[2]) < UPRIGHT:
        raise StereocalError(
            "Cannot tell whether the survey is mirrored: its points lie in one plane, and with z "
            "up they would put the cameras upside down or on their side. Two axes may be "
            "exchanged, or one sign be wrong. Survey one more point well off the plane."
        )
    to_primary = fit.pose.inverse()
    origins = {name: to_primary.apply(world_m[survey.names.index(name)]) for name in distinct}
    origins[frame.SURVEY] = to_primary.T
    up, along, usual = fit.pose.R[2], {frame.SURVEY: fit.pose.R[0]}, (frame.SURVEY, frame.SURVEY)
    pose = frame.frame_of_up(rig, up, stated.axes, origins, along, usual)
    residuals = {name: fit.residuals_m[names == name].mean(axis=0) for name in distinct}
    tilt, heading, position = (
        fit.solution.bound(fit.solution.covariance[part, part])
        for part in (slice(2), slice(2, 3), slice(3, 6))
    )
    advice = "Survey points farther apart, and not along one line."
    frame.check_tilt("The points leave the axes", max(tilt, heading), advice)
    limits = {
        "survey_m": sigma_m,
        "vertical_deg": float(np.degrees(tilt)),
        "heading_deg": float(np.degrees(heading)),
        "position_m": position,
    }
    variance = scaled.solution.covariance[6, 6] + np.sum(scaled.solution.shift[6] ** 2)
    scale = scaled.solution.interval(float(np.log(scaled.scale)), variance)
    return frame.WorldFrame(
        pose,
        "survey",
        {**noise.entries, **limits},
        _sentence(pose, residuals, tilt, position),
        tuple(_notes(rig, fit, scaled, scale, noise, sigma_m, hand)),
        {
            "residuals_m": {name: residual.tolist() for name, residual in residuals.items()},
            "scale": {name: float(np.exp(logarithm)) for name, logarithm in vars(scale).items()},
        },
    )


def _measured(rig: RigParameters, survey: frame.Survey, noise: ErrorModel) -> MeasuredPoints:
    """The surveyed points as measured; an error if they are too few or badly placed."""
    if (count := len({*survey.names})) < FEWEST_POINTS:
        raise StereocalError(
            f"A survey needs at least 3 points that do not lie on one line; there are {count}."
        )
    xyz = survey.measured_m.copy()
    seen = np.isnan(xyz).any(axis=1)
    if seen.any():
        names = tuple(np.array(survey.names)[seen].tolist())
        xyz[seen] = reconstructed(rig, survey.pixels[seen], names)
    measured = measured_points(rig, xyz, noise.spread)
    if not np.isfinite(measured.own).all():
        raise StereocalError("A measured point of the survey lies behind a camera.")
    _check_spread(survey.world_m, xyz)
    return measured


def _scaled_fit(
    measured: MeasuredPoints, survey: frame.Survey, noise: ErrorModel, sigma_m: float
) -> tuple[RigidFit, int]:
    """The fit with a free scale, and its `_hand`; an error if the points fit only as a mirror
    image, in another unit, or not at all."""
    world_m, names = survey.world_m, np.array(survey.names)
    scaled, mirrored = (
        fit_rigid(measured, seen_as, noise, sigma_m, scale=True)
        for seen_as in (world_m, world_m * (1, 1, -1))
    )
    hand = _hand(scaled, mirrored)
    if hand < 0 and mirrored.is_close:
        raise StereocalError(
            "The surveyed points fit only as a mirror image: their axes are left-handed. "
            "Exchange two of the columns x, y, z, or change the sign of one, whichever is wrong: "
            "for example x to the right, y ahead, z up."
        )
    if not 1 / LARGEST_SCALE < scaled.scale < LARGEST_SCALE and scaled.is_close:
        raise StereocalError(
            f"The survey's distances are {rounded(scaled.scale, 3)} times those measured with "
            "these parameters: write the survey in metres, or make sure that the parameters are "
            "of these cameras."
        )
    if not scaled.is_close:

        def agree_without(name: str) -> bool:
            rest = names != name
            part = MeasuredPoints(*(values[rest] for values in vars(measured).values()))
            again = fit_rigid(part, world_m[rest], noise, sigma_m, scale=True)
            return again.rms_m < 0.2 * scaled.limit_m

        distinct = list(dict.fromkeys(survey.names))
        tried = distinct if len(distinct) > FEWEST_POINTS + 1 else []
        raise StereocalError(
            "The surveyed and the measured points contradict each other by "
            f"{rounded(scaled.rms_m, 3)} m (root mean square): "
            f"{culprit(tried, agree_without, MOST_TRIED)}. Check the names, the coordinates and "
            "the image points."
        )
    return scaled, hand


def _check_spread(surveyed: FloatArray, measured: FloatArray) -> None:
    if names := _in_degrees(surveyed, measured):
        raise StereocalError(
            f"The survey's {names[0]} and {names[1]} look like latitude and longitude in degrees: "
            "they are the right size for these points at 111 km a degree. Metres are needed: "
            "project them first, for example to UTM, east as x, north as y, height as z."
        )
    for points, what in ((surveyed, "surveyed"), (measured, "measured")):
        extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if not extent[1] > 0.01 * extent[0]:
            raise StereocalError(
                f"The {what} points lie on one line, so nothing fixes the turn about it: add a "
                "point well off the line."
            )


def _in_degrees(surveyed: FloatArray, measured: FloatArray) -> str:
    """The two coordinates that suit the measured points as degrees, and are far too small in
    metres; empty if none do."""
    extent = np.ptp(surveyed, axis=0)
    size = float(np.linalg.norm(np.ptp(measured, axis=0)))
    for pair in ([0, 1], [1, 2], [0, 2]):
        values = np.abs(surveyed[:, pair]).max(axis=0)
        ratio = METRES_A_DEGREE * float(np.linalg.norm(extent[pair])) / size if size else np.inf
        if values.max() <= 180 and values.min() <= 90 and SUITS[0] < ratio < SUITS[1]:
            return "".join("xyz"[column] for column in pair)
    return ""


def fit_rigid(
    measured: MeasuredPoints,
    world_m: FloatArray,
    noise: ErrorModel,
    sigma_m: float,
    scale: bool = False,
) -> RigidFit:
    """The rotation and shift, and if asked the scale, that fit measured to surveyed points best."""
    covariance = noise.sigma_px**2 * measured.own + sigma_m**2 * np.eye(3)
    W = np.linalg.inv(np.linalg.cholesky(covariance))
    middle = measured.xyz.mean(axis=0)
    centred = measured.xyz - middle
    weights = 1.0 / np.trace(covariance, axis1=1, axis2=2)
    shift, mean = (np.average(points, axis=0, weights=weights) for points in (world_m, centred))
    start, _ = Rotation.align_vectors(world_m - shift, centred - mean, weights=weights)
    R0 = start.as_matrix()
    centre0 = shift - R0 @ mean
    log0 = float(np.log(_rms(world_m - shift) / _rms(centred - mean))) if scale else 0.0

    def unpacked(x: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        factor = np.exp(log0 + x[6]) if scale else 1.0
        return Rotation.from_rotvec(x[:3]).as_matrix() @ R0, centre0 + x[3:6], float(factor)

    def errors(x: FloatArray) -> FloatArray:
        R, centre, factor = unpacked(x)
        off = centred - (world_m - centre) @ R / factor
        return np.asarray(np.einsum("nij,nj->ni", W, off).ravel())

    by_rig = np.einsum("nij,njr->nir", W, measured.by_rig).reshape(3 * len(W), -1)
    # A survey says where the reconstructed points are, right or wrong; only its scale is a
    # statement about the parameters.
    solution = solve(errors, np.zeros(7 if scale else 6), (lambda _: by_rig) if scale else None)
    R, centre, factor = unpacked(solution.x)
    residuals = factor * centred @ R.T + centre - world_m
    limit = LARGEST_RESIDUAL * _rms(world_m - world_m.mean(axis=0))
    return RigidFit(Pose(R, centre - R @ middle), factor, residuals, limit, solution)


def _hand(fit: RigidFit, mirrored: RigidFit) -> int:
    """1: right-handed axes fit clearly better; -1: left-handed ones; 0: cannot tell."""
    squares = fit.solution.chi_square, mirrored.solution.chi_square
    widening = max(1.0, min(squares) / max(fit.solution.degrees, 1))
    difference = (squares[1] - squares[0]) / widening
    return int(np.sign(difference)) if abs(difference) > CLEARLY_WORSE else 0


def _rms(vectors: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


def _sentence(pose: Pose, residuals: dict[str, FloatArray], tilt: float, position: float) -> str:
    sizes = {name: float(np.linalg.norm(residual)) for name, residual in residuals.items()}
    worst = max(sizes, key=lambda name: sizes[name])
    x, y, z = pose.T.tolist()
    return (
        f"World frame of {len(residuals)} surveyed points: residuals "
        f"{rounded(_rms(np.array(list(residuals.values()))))} m (root mean square), largest "
        f"{rounded(sizes[worst])} m at {worst}; axes within {frame.degrees(tilt)}, position within "
        f"{rounded(position)} m (95 %). The primary stands at x {x:.2f}, y {y:.2f}, z {z:.2f} m."
    )


def _notes(
    rig: RigParameters,
    fit: RigidFit,
    scaled: RigidFit,
    scale: Estimate,
    noise: ErrorModel,
    sigma_m: float,
    hand: int,
) -> Iterator[str]:
    """Doubts about scale, residuals and axes; `scale` is the logarithm of the survey's."""
    if not scale.low <= 0 <= scale.high and abs(scale.value) > 0.001:
        off, *ends = (100 * abs(np.expm1(logarithm)) for logarithm in vars(scale).values())
        yield (
            f"Distances of the survey are {rounded(off)} % ({rounded(min(ends))} to "
            f"{rounded(max(ends))}) {'longer' if scale.value > 0 else 'shorter'} than measured: "
            "the survey, or the scale of the parameters (bar, baseline), is wrong. The scale was "
            "not changed."
        )
    widening = fit.solution.widening
    if fit.solution.degrees and widening > 2:
        why = (
            "A point may be wrong."
            if scaled.solution.widening > 2
            else "The errors that the parameter file states of itself explain them."
        )
        yield (
            f"The residuals are {widening:.1f} times as large as {rounded(noise.sigma_px)} px and "
            f"{rounded(1000 * sigma_m)} mm of survey explain; the errors stated are larger by that "
            f"factor. {why}"
        )
    if not hand:
        yield (
            "The points lie in one plane, so a mirrored survey would fit as well: the axes are "
            "taken for right-handed. A point well off the plane would tell."
        )
    elif frame.uprightness(rig, fit.pose.R[2]) < UPSIDE_DOWN:
        yield "z points down as the cameras see it, or they hang upside down."
