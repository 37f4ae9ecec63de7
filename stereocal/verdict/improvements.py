"""What a better lens calibration, a better baseline or more frames would change.

The forecast of the refined set is repeated with a distribution of the truth that is as narrow as
the improvement would make it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from stereocal.calibration.methods import Method
from stereocal.refined.refine import RefinedResult
from stereocal.rig.compiled import BoolArray
from stereocal.rig.rig import Rig
from stereocal.system.numbers import rounded
from stereocal.verdict.predictive import predict

DRAWS, BARS = 32, 100
KNOWN = 1e6
"""Factor of the information about a parameter that is known exactly."""
MORE_FRAMES = 4
WORTH_IT = 0.93
"""Errors above this fraction of the present ones are no improvement."""


@dataclass(frozen=True)
class Improvement:
    """Mean errors of the refined set, if something were better."""

    reprojection_px: float
    length: float
    """Relative length error."""


def improvements(model: RefinedResult, seed: int = 0) -> dict[str, Improvement]:
    """The errors as they are (key ""), and with each improvement, on the same simulated bars."""
    names = model.unknowns.names
    of_lens = np.array([name.split()[0] in ("primary", "secondary") for name in names])
    of_baseline = np.array([name == "baseline" for name in names])
    none = np.zeros(len(names), dtype=np.bool_)
    cases = {
        "": model,
        "exactly known lenses": _knowing(model, of_lens),
        "an exactly known baseline": _knowing(model, of_baseline),
        f"{MORE_FRAMES} times as many frames": replace(
            _knowing(model, none), information=MORE_FRAMES * model.information
        ),
        "everything known exactly": _knowing(model, ~none),
    }
    return {name: _errors(model, case, seed) for name, case in cases.items()}


def advice_on_improvements(model: RefinedResult, seed: int = 0) -> str:
    """Which improvement would lower the length error of the refined set most, for the user."""
    found = improvements(model, seed)
    now, limit = found.pop("").length, found.pop("everything known exactly").length
    name, best = min(found.items(), key=lambda item: item[1].length)
    noise = f"image noise alone causes a length error of {rounded(100 * limit)} %"
    if best.length > WORTH_IT * now:
        return f"Better lenses, a better baseline or more frames would change little: {noise}."
    return (
        f"What would help most: {name}. The refined set would measure with an error of "
        f"{rounded(100 * best.length)} % instead of {rounded(100 * now)} %; {noise}."
    )


def _knowing(model: RefinedResult, known: BoolArray) -> RefinedResult:
    """The model with some of its free parameters known."""
    M = model.unknowns.M
    whole = np.diag(M.T @ model.information @ M + model.unknowns.precision)
    precision = model.unknowns.precision + np.diag(np.where(known, KNOWN * whole, 0.0))
    return replace(model, unknowns=replace(model.unknowns, precision=precision))


def _errors(model: RefinedResult, knowledge: RefinedResult, seed: int) -> Improvement:
    files: Mapping[Method, Rig] = {"refined": Rig(model.primary, model.secondary, model.pose)}
    found = predict(model, files, seed, DRAWS, BARS, knowledge=knowledge)
    return Improvement(float(np.nanmean(found.correct_px)), float(np.nanmean(found.errors_3d)))
