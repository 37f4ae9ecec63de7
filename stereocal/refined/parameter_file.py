"""The parameter file of the refined set, with its lenses and uncertainties."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from stereocal.refined.refine import RefinedResult
from stereocal.refined.stated_inputs import Input
from stereocal.refined.two_views import BAR, SHARED, TIME
from stereocal.refined.uncertainty import COVARIANCE_OF, standard_errors
from stereocal.rig.camera import CAMERAS, LENS_UNKNOWNS, Camera
from stereocal.rig.dataset import Dataset
from stereocal.rig.parameters import ForecastEntries, RigParameters, about_data
from stereocal.rig.volume import Volume
from stereocal.system.array_types import FloatArray


def covariance_names(cameras: Sequence[Camera]) -> tuple[str, ...]:
    """`COVARIANCE_OF`, with the k3 and k4 of a fisheye instead of p1 and p2."""
    fisheyes = {
        f"{which}_{usual}": f"{which}_{of_fisheye}"
        for which, camera in zip(CAMERAS, cameras, strict=True)
        for usual, of_fisheye in zip(LENS_UNKNOWNS, camera.lens_names, strict=True)
    }
    return tuple(fisheyes.get(name, name) for name in COVARIANCE_OF)


def refined_parameters(
    result: RefinedResult,
    inputs: Sequence[Input] = (),
    validation: Mapping[str, Any] | None = None,
    left_out: Collection[int] = (),
    forecast: ForecastEntries | None = None,
    given: Dataset | None = None,
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


def covariance_entry(covariance: FloatArray, cameras: Sequence[Camera]) -> dict[str, Any]:
    """The entry of a file on the covariance (25, 25) of the shared unknowns."""
    kept = SHARED if covariance[TIME:].any() else TIME
    return {
        "of": list(covariance_names(cameras)[:kept]),
        "matrix": covariance[:kept, :kept].tolist(),
    }


def uncertainties_of(result: RefinedResult, inputs: Sequence[Input] = ()) -> dict[str, Any]:
    """Noise, standard errors, covariance, frames left out and inputs that disagree, as JSON."""
    bar = result.dataset.target_distance_m
    return {
        "sigma_px": {"value": float(result.sigma_px.value), "source": result.sigma_px.source},
        "bar_scatter_m": {
            "value": float(result.scatter_m.value),
            "source": result.scatter_m.source,
        },
        "standard_errors": {name: value.sigma for name, value in standard_errors(result).items()},
        "bar_length_m": {
            "stated": bar,
            "estimate": bar * result.bar_factor,
            "standard_error": bar * float(np.sqrt(result.covariance[BAR, BAR])),
        },
        "covariance": covariance_entry(result.covariance, (result.primary, result.secondary)),
        "design_effect": result.design_effect,
        "frames_left_out": [
            {"frame": frame, "share_of_misfit": share}
            for frame, share in result.outlying_frames.items()
        ],
        "inputs_that_disagree": [item.advice for item in inputs if item.accused],
    }
