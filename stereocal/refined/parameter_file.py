"""The parameter file of the refined set, with its lenses and uncertainties."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from stereocal.refined.bar_fit import BAR
from stereocal.refined.refine import RefinedResult
from stereocal.refined.stated_inputs import Input
from stereocal.refined.uncertainty import LENS, standard_errors
from stereocal.rig.camera import CAMERAS
from stereocal.rig.geometry import Angles
from stereocal.rig.parameters import RigParameters, inputs_of
from stereocal.rig.volume import Volume

COVARIANCE_OF = (
    *Angles._fields,
    "baseline_m",
    "bar_factor",
    *(f"{camera}_{key}" for camera in CAMERAS for key in LENS),
)
"""Names of the rows of the covariance, in order."""


def refined_parameters(
    result: RefinedResult,
    inputs: Sequence[Input] = (),
    validation: Mapping[str, Any] | None = None,
    left_out: Collection[int] = (),
) -> RigParameters:
    """The file `parameters_refined.json`: method `refined`, purpose `both`.

    Args:
        inputs: from `disagreement.what_disagrees`, if it was computed.
        validation: figures of a validation; its `threshold_px` becomes the matching threshold.
        left_out: frames left out by the screening, in addition to those that the fit left out.
    """
    return RigParameters(
        method="refined",
        primary=result.primary,
        secondary=result.secondary,
        pose=result.pose,
        cost=result.cost,
        settings=result.settings.to_json(),
        inputs=inputs_of(result.dataset, result.frames),
        matching_threshold_px=validation["threshold_px"] if validation else None,
        validation=validation,
        uncertainties=uncertainties_of(result, inputs),
        frames_left_out=tuple(sorted({*left_out, *result.outlying_frames})),
        noise_px=float(result.sigma_px.value),
        volume=Volume.of_bars(result.points_m[~result.outlying]),
    )


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
        "covariance": {"of": list(COVARIANCE_OF), "matrix": result.covariance.tolist()},
        "frames_left_out": [
            {"frame": frame, "share_of_misfit": share}
            for frame, share in result.outlying_frames.items()
        ],
        "inputs_that_disagree": [item.advice for item in inputs if item.accused],
    }
