"""Whether the files to use depend on the seed of the searches."""

from collections.abc import Sequence
from dataclasses import replace

from stereocal.calibration.methods import Method
from stereocal.calibration.montecarlo import two_searches
from stereocal.refined.results import Calibration
from stereocal.rig.rig import Rig
from stereocal.verdict.forecast import Forecast, files_to_use
from stereocal.verdict.forecast_draws import judge_on_draws

OTHER_SEEDS = (1, 2, 3, 4)
"""Added to the seed of the searches."""
FEWER_DRAWS = 48
"""Draws of the truth for each further seed."""


def conclusions_of_seeds(
    calibration: Calibration, forecast: Forecast, seeds: Sequence[int] = OTHER_SEEDS
) -> str:
    """A sentence if the files to use depend on the seed of the searches; else empty.

    The 3D search stops somewhere along directions that lengths leave almost free, so that its set
    differs from seed to seed (docs/method.md).

    Args:
        seeds: added to the seed of the calibration.
    """
    if calibration.settings.calibration_frames is not None:
        return ""  # another seed would draw other frames
    first, refined = calibration.settings.search.seed, forecast.files["refined"]
    several = [{**_files_of_seed(calibration, first + seed), "refined": refined} for seed in seeds]
    found = [forecast.draws, *judge_on_draws(forecast.model, several, draws=FEWER_DRAWS)]
    if len({files_to_use(draws) for draws in found}) == 1:
        return ""
    lengths = [draws.figures_of("3d").mean_error_3d.value for draws in found]
    return (
        f"Another seed of the search would change which files to use: with {len(found)} seeds, the "
        f"3D set measures with an error of {100 * min(lengths):.2f} to {100 * max(lengths):.2f} %. "
        "Where that matters, calibrate with several seeds, or use the refined set."
    )


def _files_of_seed(calibration: Calibration, seed: int) -> dict[Method, Rig]:
    """The 2D and the 3D set of a calibration with another seed of the searches."""
    settings, dataset = calibration.settings, calibration.screening.dataset
    search, start = replace(settings.search, seed=seed), calibration.methods["essential"].pose
    matching, measuring = (
        Rig(dataset.primary, dataset.secondary, found.pose)
        for found in two_searches(dataset, start, search, settings.known_points)
    )
    return {"2d": matching, "3d": measuring}
