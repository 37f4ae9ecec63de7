"""Validate again with other steps of the searches, without fitting the refined sets again.

Of 100 runs of 25 frames the refined fits take 0.3 s of CPU time, everything else 0.1 s. They depend
on the frames drawn and on the essential matrix, not on the steps of the searches, so that they are
kept for the next position of a slider.
"""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import fields, replace

from stereocal.calibration.montecarlo import SearchSettings
from stereocal.evaluation.evaluate import EvaluationSettings, RunCounts, evaluate, stacked
from stereocal.rig.dataset import Dataset
from stereocal.system.latest import Latest
from stereocal.system.tasks import Progress

MOST_CHUNKS = 200
"""Of 10 runs each, which take 0.1 MB."""


class KeptFits(Latest[list[RunCounts]]):
    """The refined sets of recent runs, by chunk."""

    def __init__(self) -> None:
        super().__init__(MOST_CHUNKS)

    def keep(self, key: str, runs: list[RunCounts]) -> None:
        super().keep(key, [_refined_part(run) for run in runs])


def evaluate_with_kept_fits(
    datasets: Sequence[Dataset],
    settings: EvaluationSettings,
    executor: Executor,
    kept: KeptFits,
    progress: Progress | None = None,
    paper: Sequence[Sequence[RunCounts]] | None = None,
) -> Sequence[Sequence[RunCounts]]:
    """The runs of `evaluate`, by data set, with the refined fits from `kept` where they are.

    Args:
        paper: the runs of the same settings without the refined method; computed if None.
        progress: called after each chunk of fits; what it raises ends the work.
    """
    found = paper or evaluate(datasets, replace(settings, refined=None), executor)
    if settings.refined is None:
        return found
    seed = settings.calibration.search.seed
    # Of the paper's methods only the essential matrix is used here: the searches end at once.
    usual = replace(settings.calibration, search=SearchSettings(seed=seed, maximum_moves=1))
    fits = evaluate(
        datasets, replace(settings, calibration=usual), executor, progress, earlier=kept
    )
    return [
        [stacked(run, _refined_part(fit)) for run, fit in zip(*of_dataset, strict=True)]
        for of_dataset in zip(found, fits, strict=True)
    ]


def _refined_part(run: RunCounts) -> RunCounts:
    return RunCounts(*(getattr(run, one.name)[-1:] for one in fields(RunCounts)))
