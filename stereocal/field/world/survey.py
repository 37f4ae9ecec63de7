"""The world frame of surveyed points: a rigid fit, and whether the survey can be true."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.errors import StereocalError
from stereocal.field.world.adjustment import Solution, solve
from stereocal.field.world.frame import (
    CAMERA,
    LARGEST_TILT,
    SURVEY,
    Axes,
    WorldFrame,
    about_noise,
    camera_directions,
    degrees,
    frame_of_up,
    uprightness,
)
from stereocal.field.world.noise import (
    MeasuredPoints,
    Noise,
    measured_points,
    noise_of,
    reconstructed,
)
from stereocal.field.world.observed import Survey
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import RigParameters
from stereocal.system.numbers import rounded

SURVEY_SIGMA_M = 0.005
FEWEST_POINTS = 3
CLEARLY_WORSE = 25.0
"""Difference of chi-square that tells the survey from its mirror image: five standard errors."""
LARGEST_RESIDUAL = 0.05
"""Root mean square residual over the extent of the points; above it the input is contradictory."""
MOST_TRIED = 50
"""Points that are left out one by one to find the one that contradicts the others."""
LARGEST_SCALE = 1.2
"""Lengths of the survey over those measured; beyond it one of the two has another unit."""
UPSIDE_DOWN = -0.2
"""`uprightness` below which cameras count as upside down."""
UPRIGHT = 0.5
"""Least `uprightness` that tells points in one plane from mirrored ones: tilted by 60 degrees."""
MIRROR = np.diag([1.0, 1.0, -1.0])


@dataclass(frozen=True, eq=False)
class RigidFit:
    """world = R (X - middle) + centre, and its errors."""

    measured: MeasuredPoints
    world_m: FloatArray
    sigma_m: float
    noise: Noise
    R: FloatArray
    centre: FloatArray
    scale: float
    solution: Solution
    """Of a small rotation about the world's axes, the centre, and, if fitted, log scale."""

    @property
    def middle(self) -> FloatArray:
        return np.asarray(self.measured.xyz.mean(axis=0))

    @property
    def pose(self) -> Pose:
        """`world_from_primary`."""
        return Pose(self.R, self.centre - self.R @ self.middle)

    @property
    def residuals_m(self) -> FloatArray:
        """(n, 3): measured minus surveyed, in the world's axes."""
        scaled = self.scale * (self.measured.xyz - self.middle) @ self.R.T + self.centre
        return np.asarray(scaled - self.world_m)

    @property
    def limit_m(self) -> float:
        """Largest root mean square residual of points that do not contradict each other."""
        return LARGEST_RESIDUAL * _rms(self.world_m - self.world_m.mean(axis=0))

    @property
    def is_close(self) -> bool:
        """Whether the residuals are below this limit, or no larger than the noise explains."""
        return _rms(self.residuals_m) <= self.limit_m or self.solution.widening < 3


def world_of_survey(
    rig: RigParameters,
    survey: Survey,
    axes: Axes | None = None,
    sigma_px: float | None = None,
    sigma_m: float = SURVEY_SIGMA_M,
) -> WorldFrame:
    """The world frame of surveyed points.

    Args:
        sigma_px: noise of an image coordinate; None: that of the parameters.
        sigma_m: standard error of a surveyed coordinate.
    """
    if not (np.isfinite(sigma_m) and sigma_m >= 0):
        raise StereocalError(f"The survey's standard error is {sigma_m} m; it must be 0 or more.")
    axes, noise = axes or Axes(), noise_of(rig, sigma_px)
    distinct = list(dict.fromkeys(survey.names))
    if len(distinct) < FEWEST_POINTS:
        raise StereocalError(
            f"A survey needs at least 3 points that do not lie on one line; there are "
            f"{len(distinct)}."
        )
    xyz = survey.measured_m.copy()
    seen = np.asarray(np.isnan(xyz).any(axis=1))
    names = tuple(name for name, there in zip(survey.names, seen, strict=True) if there)
    if names:
        xyz[seen] = reconstructed(rig, survey.pixels[seen], names)
    measured = measured_points(rig, xyz, noise.spread)
    if not np.isfinite(measured.own).all():
        raise StereocalError("A measured point of the survey lies behind a camera.")
    _refuse_line(survey.world_m, "surveyed")
    _refuse_line(xyz, "measured")
    with_scale = fit_rigid(measured, survey.world_m, noise, sigma_m, scale=True)
    mirrored = fit_rigid(measured, survey.world_m @ MIRROR, noise, sigma_m, scale=True)
    hand = _hand(with_scale, mirrored)
    if hand < 0 and mirrored.is_close:
        raise StereocalError(
            "The surveyed points fit only as a mirror image: their axes are left-handed. "
            "Exchange two of the columns x, y, z, or change the sign of one, whichever is wrong: "
            "for example x to the right, y ahead, z up."
        )
    _refuse_scale(with_scale)
    fit = fit_rigid(measured, survey.world_m, noise, sigma_m)
    _refuse_contradiction(with_scale, survey)
    up = fit.R[2]
    if not hand and uprightness(rig, up) < UPRIGHT:
        raise StereocalError(
            "Cannot tell whether the survey is mirrored: its points lie in one plane, and with z "
            "up they would put the cameras upside down or on their side. Two axes may be "
            "exchanged, or one sign be wrong. Survey one more point well off the plane."
        )
    pose = _placed(rig, survey, fit.pose, axes)
    return _found(rig, survey, fit, with_scale, pose, bool(hand))


def fit_rigid(
    measured: MeasuredPoints, world_m: FloatArray, noise: Noise, sigma_m: float, scale: bool = False
) -> RigidFit:
    """The rotation and shift, and if asked the scale, that fit measured to surveyed points best."""
    covariance = noise.sigma_px**2 * measured.own + sigma_m**2 * np.eye(3)
    W = np.linalg.inv(np.linalg.cholesky(covariance))
    middle = measured.xyz.mean(axis=0)
    about = measured.xyz - middle
    weights = 1.0 / np.trace(covariance, axis1=1, axis2=2)
    shift = np.average(world_m, axis=0, weights=weights)
    own = np.average(about, axis=0, weights=weights)
    start, _ = Rotation.align_vectors(world_m - shift, about - own, weights=weights)
    R0 = start.as_matrix()
    centre0 = shift - R0 @ own
    size = np.sqrt(np.mean(np.sum((world_m - shift) ** 2, axis=1)))
    scale0 = size / np.sqrt(np.mean(np.sum((about - own) ** 2, axis=1)))
    log0 = float(np.log(scale0)) if scale else 0.0

    def unpacked(x: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        factor = np.exp(log0 + x[6]) if scale else 1.0
        return Rotation.from_rotvec(x[:3]).as_matrix() @ R0, centre0 + x[3:6], float(factor)

    def errors(x: FloatArray) -> FloatArray:
        R, centre, factor = unpacked(x)
        off = about - (world_m - centre) @ R / factor
        return np.asarray(np.einsum("nij,nj->ni", W, off).ravel())

    by_rig = np.einsum("nij,njr->nir", W, measured.by_rig).reshape(3 * len(W), -1)
    # A survey says where the reconstructed points are, right or wrong; only its scale is a
    # statement about the parameters.
    found = solve(errors, np.zeros(7 if scale else 6), (lambda _: by_rig) if scale else None)
    R, centre, factor = unpacked(found.x)
    return RigidFit(measured, world_m, sigma_m, noise, R, centre, factor, found)


def _refuse_line(points: FloatArray, what: str) -> None:
    extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if not extent[1] > 0.01 * extent[0]:
        raise StereocalError(
            f"The {what} points lie on one line, so nothing fixes the turn about it: add a point "
            "well off the line."
        )


def _hand(fit: RigidFit, mirrored: RigidFit) -> int:
    """1: right-handed axes fit clearly better; -1: left-handed ones; 0: cannot tell."""
    squares = fit.solution.chi_square, mirrored.solution.chi_square
    widening = max(1.0, min(squares) / max(fit.solution.degrees, 1))
    difference = (squares[1] - squares[0]) / widening
    return int(np.sign(difference)) if abs(difference) > CLEARLY_WORSE else 0


def _refuse_scale(with_scale: RigidFit) -> None:
    """Refuse another unit; where the points do not fit with any, that is the error."""
    scale = with_scale.scale
    if 1 / LARGEST_SCALE < scale < LARGEST_SCALE or not with_scale.is_close:
        return
    raise StereocalError(
        f"The survey's distances are {rounded(scale, 3)} times those measured with these "
        "parameters: "
        "write the survey in metres, or make sure that the parameters are of these cameras."
    )


def _refuse_contradiction(fit: RigidFit, survey: Survey) -> None:
    """Refuse residuals that no noise explains; name the point where one alone contradicts.

    Args:
        fit: with its scale, whose difference is reported, not an error.
    """
    if fit.is_close:
        return
    culprits = []
    names = np.array(survey.names)
    distinct = list(dict.fromkeys(survey.names))
    for name in distinct if FEWEST_POINTS + 1 < len(distinct) <= MOST_TRIED else []:
        rest = names != name
        part = replace(
            fit.measured,
            **{key: getattr(fit.measured, key)[rest] for key in ("xyz", "own", "by_rig")},
        )
        again = fit_rigid(part, survey.world_m[rest], fit.noise, fit.sigma_m, scale=True)
        if _rms(again.residuals_m) < 0.2 * fit.limit_m:
            culprits.append(name)
    where = (
        f"without {culprits[0]} the others agree: check its coordinates and its image points"
        if len(culprits) == 1
        else "cannot tell which: check the names, the coordinates and the image points"
    )
    raise StereocalError(
        "The surveyed and the measured points contradict each other by "
        f"{rounded(_rms(fit.residuals_m), 3)} m (root mean square): {where}."
    )


def _rms(vectors: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


def _placed(rig: RigParameters, survey: Survey, pose: Pose, axes: Axes) -> Pose:
    """The pose with the chosen origin and axes."""
    to_primary = pose.inverse()
    points = {
        name: to_primary.apply(survey.world_m[survey.names.index(name)])
        for name in dict.fromkeys(survey.names)
    }
    origins = {**points, CAMERA: np.zeros(3), SURVEY: to_primary.T}
    directions = {**camera_directions(rig), SURVEY: pose.R[0]}
    return frame_of_up(pose.R[2], axes, origins, directions, (SURVEY, SURVEY))


def _found(
    rig: RigParameters,
    survey: Survey,
    fit: RigidFit,
    with_scale: RigidFit,
    pose: Pose,
    hand_is_known: bool,
) -> WorldFrame:
    solution = fit.solution
    covariance = solution.covariance
    tilt = solution.bound(covariance[:2, :2])
    if tilt > LARGEST_TILT or solution.bound(covariance[2:3, 2:3]) > LARGEST_TILT:
        raise StereocalError(
            f"The points leave the axes undetermined by {degrees(tilt)} or more: survey points "
            "farther apart, and not along one line."
        )
    residuals = {
        name: fit.residuals_m[np.array(survey.names) == name].mean(axis=0)
        for name in dict.fromkeys(survey.names)
    }
    sizes = {name: float(np.linalg.norm(each)) for name, each in residuals.items()}
    worst = max(sizes, key=lambda name: sizes[name])
    position = solution.bound(covariance[3:6, 3:6])
    scaled = with_scale.solution
    half = scaled.quantile * float(np.sqrt(scaled.covariance[6, 6] + np.sum(scaled.shift[6] ** 2)))
    x, y, z = pose.T.tolist()
    rms = float(np.sqrt(np.mean(np.square(list(sizes.values())))))
    sentence = (
        f"World frame of {len(residuals)} surveyed points: residuals {rounded(rms)} m (root mean "
        f"square), largest {rounded(sizes[worst])} m at {worst}; axes within {degrees(tilt)}, "
        f"position within {rounded(position)} m (95 %). The primary stands at x {x:.2f}, y "
        f"{y:.2f}, z {z:.2f} m."
    )
    return WorldFrame(
        pose,
        "survey",
        {
            **about_noise(fit.noise),
            "survey_m": fit.sigma_m,
            "vertical_deg": float(np.degrees(tilt)),
            "heading_deg": float(np.degrees(solution.bound(covariance[2:3, 2:3]))),
            "position_m": position,
        },
        sentence,
        _notes(fit, with_scale, half, rig, hand_is_known),
        {
            "residuals_m": {name: each.tolist() for name, each in residuals.items()},
            "scale": {
                "value": with_scale.scale,
                "low": with_scale.scale * float(np.exp(-half)),
                "high": with_scale.scale * float(np.exp(half)),
            },
        },
    )


def _notes(
    fit: RigidFit, with_scale: RigidFit, half: float, rig: RigParameters, hand_is_known: bool
) -> tuple[str, ...]:
    notes = []
    off = float(np.log(with_scale.scale))
    if abs(off) > half and abs(off) > 0.001:
        low, high = sorted(100 * abs(np.expm1(off + each)) for each in (-half, half))
        notes.append(
            f"Distances of the survey are {rounded(100 * abs(np.expm1(off)))} % ({rounded(low)} to "
            f"{rounded(high)}) {'longer' if off > 0 else 'shorter'} than measured: the survey, or "
            "the scale of the parameters (bar, baseline), is wrong. The scale was not changed."
        )
    if fit.solution.degrees and fit.solution.widening > 2:
        why = (
            "A point may be wrong."
            if with_scale.solution.widening > 2
            else "The errors that the parameter file states of itself explain them."
        )
        notes.append(
            f"The residuals are {fit.solution.widening:.1f} times as large as "
            f"{rounded(fit.noise.sigma_px)} px and {rounded(1000 * fit.sigma_m)} mm of survey "
            f"explain; the errors stated are larger by that factor. {why}"
        )
    if not hand_is_known:
        notes.append(
            "The points lie in one plane, so a mirrored survey would fit as well: the axes are "
            "taken for right-handed. A point well off the plane would tell."
        )
    elif uprightness(rig, fit.R[2]) < UPSIDE_DOWN:
        notes.append("z points down as the cameras see it, or they hang upside down.")
    return tuple(notes)
