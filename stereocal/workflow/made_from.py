"""What calibrations and validations are made from, for pages that tell what has changed since."""

import math
from collections.abc import Sequence
from itertools import combinations

from stereocal.calibration.methods import CalibrationSettings
from stereocal.evaluation.evaluate import EvaluationSettings
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.results import Calibration
from stereocal.fit.start.pairs import pair_name
from stereocal.formats.evaluation_files import Evaluation
from stereocal.rig.camera import camera_in_words
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.system.made_from import Parts, digest_of

DATA, WINDOWS = "data", "windows"


def parts_of(recording: Recording) -> Parts:
    """Lenses, lengths and points."""
    bar, several = recording.object, len(recording.cameras) > 2
    lenses = {
        f"lens of {camera_in_words(name)}": [
            digest_of([camera.to_json(), camera.uncertainty and camera.uncertainty.to_json()])
        ]
        for name, camera in zip(recording.labels, recording.cameras.values(), strict=True)
    }
    baselines = {
        f"baseline {pair_name(pair)}" if several else "baseline": _metres(
            recording.baseline_m(*pair)
        )
        for pair in combinations(recording.cameras, 2)
    }
    return {
        **lenses,
        **baselines,
        "distance between the targets": _metres(bar.longest_m),
        "shape of the object": [
            digest_of([bar.names, (bar.points / bar.longest_m).round(9).tolist()])
        ],
        "uncertainty of the baseline": _metres(recording.baseline_sigma_m),
        "uncertainty of the distance between the targets": _metres(bar.sigma_m),
        "points": [recording.points_digest],
        **({WINDOWS: [it.to_json() for it in recording.windows]} if recording.windows else {}),
    }


def _metres(value: float | None) -> str:
    if value is None:
        return "not stated"
    return f"{value:.12g} m" if math.isfinite(value) else "not measured"


def calibration_parts(
    dataset: Pair, settings: CalibrationSettings, refined: RefineSettings | None
) -> Parts:
    """What a calibration of two cameras is made from."""
    parts = {**parts_of(dataset.recording), **settings.parts}
    if refined is not None:
        noise_px = refined.sigma_px
        parts |= {
            "noise of an image point": "estimated" if noise_px is None else f"{noise_px:.12g} px",
            "cameras whose distortion is estimated": [*refined.free_distortion],
        }
    return parts


def parts_of_calibration(calibration: Calibration) -> Parts:
    """What a finished one was made from."""
    refined = None if calibration.refined is None else calibration.refined.settings
    return calibration_parts(calibration.dataset, calibration.settings, refined)


def evaluation_parts(sha256: Sequence[str], settings: EvaluationSettings) -> Parts:
    """What a validation is made from.

    Args:
        sha256: of the data sets, in their order.
    """
    return {DATA: [*sha256], **settings.parts}


def parts_of_evaluation(evaluation: Evaluation) -> Parts:
    """What a finished one was made from."""
    return evaluation_parts(evaluation.sha256, evaluation.settings)
