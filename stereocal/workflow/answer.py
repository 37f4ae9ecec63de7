"""What the run of two cameras comes to: which set to use for what, how good it is, the files."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from stereocal.calibration.methods import FILE_METHODS, Method
from stereocal.fit.errors.stated_inputs import moved_lengths
from stereocal.formats.evaluation_files import Evaluation, validation_figures
from stereocal.rig.parameters import ForecastEntries, RigParameters
from stereocal.system.latest import step
from stereocal.verdict.file_figures import Validated, figures_of
from stereocal.verdict.further_recording import note_on_splits
from stereocal.verdict.recommendation import Recommendation, recommend
from stereocal.workflow.pair_run import PairRun


@dataclass(eq=False)
class PairAnswer:
    """The recommendation and the files of a run. Each step is made when it is first asked for, and
    kept; any thread may ask."""

    run: PairRun
    evaluation: Evaluation | None = None
    """A validation of the frames that are not left out; None without one."""
    figures: Mapping[Any, Validated] | None = None
    """Entries of the files on a validation, by method, instead of those of `evaluation`."""

    @step
    def validation(self) -> Mapping[Any, Validated]:
        """The entries of the files on the validation, by method; empty without one."""
        if self.figures or self.evaluation is None:
            return self.figures or {}
        return validation_figures(self.evaluation.summaries, self.evaluation.settings)

    @step
    def recommendation(self) -> Recommendation:
        """Which file to use for what, and how good they are."""
        run, note = self.run, ""
        recommended = recommend(run.calibration, run.forecast, self.validation, run.no_forecast)
        is_asked = run.forecast is not None and not run.calibration.focal_changes
        moved = moved_lengths(run.inputs) if is_asked else ""
        if (evaluation := self.evaluation) is not None:
            note = note_on_splits(run.screening.dataset, evaluation.settings, evaluation.summaries)
        return replace(
            recommended, sentences=tuple(filter(None, (*recommended.sentences, moved, note)))
        )

    @step
    def forecast_entries(self) -> dict[Method, ForecastEntries]:
        """The entries of the files on the forecast, by method; empty without one."""
        if (forecast := self.run.forecast) is None:
            return {}
        entries = forecast.of_files(self.validation)
        calibration, validation = self.run.calibration, self.validation
        return {
            method: entry.raised(figures_of(method, calibration, forecast, validation).contradicted)
            for method, entry in entries.items()
        }

    @step
    def sets(self) -> dict[Method, RigParameters]:
        """The parameter files: 2d, 3d and, if available, refined."""
        calibration, recommendation = self.run.calibration, self.recommendation.to_json()
        sets: dict[Method, RigParameters] = {}
        for method in FILE_METHODS:
            if method != "refined" or calibration.refined is not None:
                entries = self.validation.get(method), self.forecast_entries.get(method)
                parameters = calibration.parameters(method, *entries)
                sets[method] = replace(parameters, recommendation=recommendation)
        return sets

    @property
    def parameter_files(self) -> dict[str, bytes]:
        """The contents of these files by name."""
        return {f"parameters_{name}.json": rig.dumps().encode() for name, rig in self.sets.items()}

    @property
    def thresholds_px(self) -> dict[Method, float | None]:
        """The matching threshold in each file."""
        return {method: rig.matching_threshold_px for method, rig in self.sets.items()}
