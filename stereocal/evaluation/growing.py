"""Validate while one looks: the runs can be read as they come, and refined fits are kept.

The runs of the paper's methods come in turn with refined fits, so that the first of both are there
at once. Of 100 runs of 25 frames the refined fits take 0.3 s of CPU time, everything else 0.1 s.
They depend on the frames drawn and on the essential matrix, not on the steps of the searches, so
that they are kept for the next position of a slider.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import fields, replace
from itertools import chain, zip_longest

from stereocal.calibration.montecarlo import SearchSettings
from stereocal.evaluation.evaluate import (
    EvaluationSettings,
    RunCounts,
    check_split,
    stacked,
    tasks_of_runs,
)
from stereocal.rig.pair import Pair
from stereocal.system.latest import Latest
from stereocal.system.tasks import Progress, Task, run_tasks

MOST_CHUNKS = 500
"""Of at most 10 runs each, which take 0.1 MB."""
FITTED_AT_ONCE = 250
"""Frames fitted by one task, which lasts about as long as one of 5,000 frames without fits."""


class KeptFits(Latest[list[RunCounts]]):
    """The refined sets of recent runs, by chunk."""

    def __init__(self) -> None:
        super().__init__(MOST_CHUNKS)

    def get(self, key: str) -> list[RunCounts] | None:
        return super().get(key) if key else None

    def keep(self, key: str, runs: list[RunCounts]) -> None:
        if key:
            super().keep(key, [_refined_part(run) for run in runs])


class GrowingRuns:
    """The runs of `evaluate`, of the same numbers; one thread computes them, others may look."""

    def __init__(self, datasets: int, settings: EvaluationSettings) -> None:
        self.settings = settings
        self._paper: list[list[RunCounts]] = [[] for _ in range(datasets)]
        self._fits: list[list[RunCounts]] = [[] for _ in range(datasets)]

    @property
    def total(self) -> int:
        """The number of all runs."""
        return self.settings.runs * len(self._paper)

    def so_far(self, refined: bool) -> list[list[RunCounts]]:
        """The runs that are there, by data set.

        Args:
            refined: those that the refined method has, with it.
        """
        if not refined or self.settings.refined is None:
            return [[*runs] for runs in self._paper]
        return [
            [stacked(run, fit) for run, fit in zip(paper, fits, strict=False)]
            for paper, fits in zip(self._paper, self._fits, strict=True)
        ]

    def compute(
        self,
        datasets: Sequence[Pair],
        executor: Executor,
        kept: KeptFits,
        progress: Progress | None = None,
    ) -> list[list[RunCounts]]:
        """Compute all runs, with the refined fits from `kept` where they are.

        Args:
            progress: as of `evaluate`, but a run counts twice if it is fitted too.
        """
        for dataset in datasets:
            check_split(dataset, self.settings.calibration_frames)
        total = self.total * (1 if self.settings.refined is None else 2)
        with closing(run_tasks(self._tasks(datasets), executor, total, progress, kept)) as finished:
            for task, runs in finished:
                number = task.arguments[2]
                if task.key:
                    self._fits[number] += [_refined_part(run) for run in runs]
                else:
                    self._paper[number] += runs
        return self.so_far(refined=True)

    def _tasks(self, datasets: Sequence[Pair]) -> Iterator[Task[list[RunCounts]]]:
        """The paper's methods, which are not kept and so without a key, in turn with the fits."""
        without_fits = replace(self.settings, refined=None)
        paper = (replace(task, key="") for task in tasks_of_runs(datasets, without_fits))
        if self.settings.refined is None:
            return paper
        seed = without_fits.calibration.search.seed
        # Of the paper's methods only the essential matrix is used here: the searches end at once.
        usual = replace(without_fits.calibration, search=SearchSettings(seed=seed, maximum_moves=1))
        of_fits = replace(self.settings, calibration=usual)
        fits = tasks_of_runs(datasets, of_fits, frames_at_once=FITTED_AT_ONCE)
        in_turn = chain.from_iterable(zip_longest(paper, fits))
        return (task for task in in_turn if task is not None)


def _refined_part(run: RunCounts) -> RunCounts:
    return RunCounts(*(getattr(run, one.name)[-1:] for one in fields(RunCounts)))
