"""The parameter file of the refined set, with its lenses and uncertainties."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stereocal.fit.errors.stated_inputs import Input
from stereocal.fit.least_squares.small_steps import (
    FACTOR,
    OF_PAIR,
    OF_PAIR_BEHIND_WINDOWS,
    lens_places,
    pose_places,
)
from stereocal.fit.least_squares.stated_windows import PARTS
from stereocal.fit.least_squares.unknowns import FIXED, baseline_sigma_m
from stereocal.fit.least_squares.views import DRIFT, EACH, TIME
from stereocal.fit.refined_result import RefinedResult
from stereocal.rig.camera import CAMERAS, LENS_UNKNOWNS, Camera
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.pair import Pair
from stereocal.rig.parameters import ForecastEntries, RigParameters, about_data
from stereocal.rig.rig import Rig
from stereocal.rig.volume import Volume
from stereocal.system.array_types import FloatArray

POSE = len(Angles._fields) + 1
"""The first of the values of a file's covariance are the five angles and the baseline."""
COVARIANCE_OF = (
    *Angles._fields,
    "baseline_m",
    "bar_factor",
    *(f"{camera}_{key}" for camera in CAMERAS for key in LENS_UNKNOWNS[:4]),
    *(f"{camera}_{key}" for camera in CAMERAS for key in LENS_UNKNOWNS[4:]),
    "time_offset_frames",
    "time_drift",
)
"""Names of the rows of a file's covariance, in order; files without a time offset end before it."""
WINDOWS_OF = tuple(f"{camera}_window_{part}" for camera in CAMERAS for part in PARTS)
"""Names of further rows, at the end, of cameras that look through windows."""
PLACES = [
    FACTOR,
    *lens_places(0)[:4],
    *lens_places(1)[:4],
    *lens_places(0)[4:],
    *lens_places(1)[4:],
    EACH + TIME,
    EACH + DRIFT,
]
"""Of these values, from the factor of the bar on, among the unknowns of `views`."""


@dataclass(frozen=True)
class Value:
    """An estimate and its standard error, which is 0 if the value was held fixed."""

    value: float
    sigma: float


def covariance_names(cameras: Sequence[Camera]) -> tuple[str, ...]:
    """`COVARIANCE_OF`, with the k3 and k4 of a fisheye instead of p1 and p2, and windows."""
    fisheyes = {
        f"{which}_{usual}": f"{which}_{of_fisheye}"
        for which, camera in zip(CAMERAS, cameras, strict=True)
        for usual, of_fisheye in zip(LENS_UNKNOWNS, camera.lens_names, strict=True)
    }
    names = tuple(fisheyes.get(name, name) for name in COVARIANCE_OF)
    through = any(camera.window is not None for camera in cameras)
    return (*names, *WINDOWS_OF) if through else names


def refined_parameters(
    result: RefinedResult,
    inputs: Sequence[Input] = (),
    validation: Mapping[str, Any] | None = None,
    left_out: Collection[int] = (),
    forecast: ForecastEntries | None = None,
    given: Pair | None = None,
) -> RigParameters:
    """The file `parameters_refined.json`: method `refined`, purpose `both`.

    Args:
        inputs: from `disagreement.compare_inputs`, if they were compared.
        validation, forecast: as of `about_data`.
        left_out: frames left out by the screening, in addition to those that the fit left out.
        given: the data set with all its frames, which the file names; None: that of the fit.
    """
    uncertainties = uncertainties_of(result, inputs)
    offset = result.time_offset if result.settings.time_offset else None
    return RigParameters(
        method="refined",
        primary=result.primary,
        secondary=result.secondary,
        pose=result.pose,
        cost=result.cost,
        settings=result.settings.to_json(),
        uncertainties={**uncertainties, **(forecast.uncertainties if forecast else {})},
        frames_left_out=tuple(sorted({*left_out, *result.outlying_frames})),
        noise_px=float(result.sigma_px.value),
        volume=Volume.of_bars(result.used_points_m),
        **about_data(given or result.dataset, result.frames, offset, validation, forecast),
    )


def by_angles(pose: Pose) -> FloatArray:
    """(6, 6): derivatives of a small rotation of the secondary camera about its own axes, and of T,
    by the five angles of the paper and the baseline.

    R is a product of rotations about y, x and z: an angle turns about its axis, rotated by the
    factors to its left. Singular where the angles have no direction: delta and epsilon with a
    baseline along an optical axis, yaw and roll with a pitch of 90 degrees.
    """
    yaw, _, _, delta, epsilon = pose.angles
    t, J = pose.T / pose.baseline, np.zeros((6, 6))
    J[:3, 0], J[:3, 1] = [0.0, 1.0, 0.0], [np.cos(yaw), 0.0, -np.sin(yaw)]
    J[:3, 2] = pose.R[:, 2]
    across = [-np.sin(delta) * np.cos(epsilon), -np.sin(delta) * np.sin(epsilon), np.cos(delta)]
    J[3:, 3], J[3:, 4] = pose.baseline * np.array(across), [-pose.T[1], pose.T[0], 0.0]
    J[3:, 5] = t
    return J


def of_file(covariance: FloatArray, pose: Pose) -> FloatArray:
    """(25, 25): a covariance (33, 33) of the unknowns of two cameras by the values of a file; with
    windows (35, 35), of (43, 43)."""
    J = _by_values(len(covariance), np.asarray(np.linalg.inv(by_angles(pose)), np.float64))
    return np.asarray(J @ covariance @ J.T)


def _by_values(size: int, by_pose: FloatArray) -> FloatArray:
    """(v, size): derivatives of the values of a file by as many unknowns, those of the pose given;
    all others are the same in both."""
    places = [*PLACES, *range(2 * EACH, size - 1)]
    J = np.zeros((POSE + len(places), size))
    J[:POSE, pose_places(1)] = by_pose
    J[range(POSE, len(J)), places] = 1.0
    return J


def covariance_entry(covariance: FloatArray, rig: Rig) -> dict[str, Any]:
    """The entry of a file on the covariance (33, 33) of the unknowns of a rig."""
    values = of_file(covariance, rig.pose)
    time = len(COVARIANCE_OF) - 2 if len(values) == len(COVARIANCE_OF) else len(values)
    kept = len(values) if values[time:].any() else time
    names = covariance_names((rig.primary, rig.secondary))
    return {"of": list(names[:kept]), "matrix": values[:kept, :kept].tolist()}


def covariance_of_entry(entry: Mapping[str, Any], rig: Rig) -> FloatArray:
    """(33, 33), with windows (43, 43): the covariance of the unknowns of `views` that a file has in
    one entry.

    Raises:
        KeyError, TypeError, ValueError: the entry is damaged.
    """
    names, whole = list(entry["of"]), np.array(entry["matrix"], dtype=np.float64)
    if whole.shape != (len(names), len(names)) or not np.isfinite(whole).all():
        raise ValueError("the covariance is not a square table of numbers")
    known = covariance_names((rig.primary, rig.secondary))
    if missing := set(known[:POSE]) - set(names):
        raise ValueError(f"the covariance is without {sorted(missing)[0]}")
    size = OF_PAIR if len(known) == len(COVARIANCE_OF) else OF_PAIR_BEHIND_WINDOWS
    B = _by_values(size, by_angles(rig.pose).T)
    B = B[[known.index(name) for name in names]]
    return np.asarray(B.T @ whole @ B)


def standard_errors(covariance: FloatArray, rig: Rig) -> dict[str, Value]:
    """The five angles in radians, `baseline_m`, and fx, fy, cx, cy of each camera in pixels, with
    their standard errors by a covariance (33, 33)."""
    lenses = np.concatenate([camera.lens_values[:4] for camera in (rig.primary, rig.secondary)])
    values = [*rig.pose.angles, rig.pose.baseline, np.nan, *lenses.tolist()]
    errors = np.sqrt(np.diag(of_file(covariance, rig.pose))).tolist()
    known = zip(COVARIANCE_OF, values, errors, strict=False)
    return {name: Value(value, sigma) for name, value, sigma in known if name != "bar_factor"}


def errors_of_set(result: RefinedResult) -> dict[str, Value]:
    """The same of a refined set; 0 for a baseline that was held."""
    errors = standard_errors(result.covariance_of_file, result.rig)
    if baseline_sigma_m(result.dataset, result.settings) <= FIXED:
        errors["baseline_m"] = Value(errors["baseline_m"].value, 0.0)
    return errors


def uncertainties_of(result: RefinedResult, inputs: Sequence[Input] = ()) -> dict[str, Any]:
    """Noise, standard errors, covariance, frames left out and inputs that disagree, as JSON."""
    bar, errors = result.dataset.target_distance_m, errors_of_set(result)
    return {
        "sigma_px": {"value": float(result.sigma_px.value), "source": result.sigma_px.source},
        "bar_scatter_m": {
            "value": float(result.scatter_m.value),
            "source": result.scatter_m.source,
        },
        "standard_errors": {name: value.sigma for name, value in errors.items()},
        "bar_length_m": {
            "stated": bar,
            "estimate": bar * result.bar_factor,
            "standard_error": bar * float(np.sqrt(result.covariance[FACTOR, FACTOR])),
        },
        "covariance": covariance_entry(result.covariance_of_file, result.rig),
        "design_effect": result.design_effect,
        "frames_left_out": [
            {"frame": frame, "share_of_misfit": share}
            for frame, share in result.outlying_frames.items()
        ],
        "inputs_that_disagree": [item.advice for item in inputs if item.accused],
    }
