"""What is computed of all cameras of a recording together: `Run`, whose steps are made when asked
for."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from stereocal.calibration.methods import CalibrationSettings, Method
from stereocal.errors import StereocalError
from stereocal.fit.about_rig import PairOfRig
from stereocal.fit.calibrate import calibrate_rig
from stereocal.fit.in_words import loops_sentence, rig_notes, rig_sentence, windows_sentence
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.parameter_file import refined_parameters
from stereocal.fit.refine import refine
from stereocal.fit.rig_file import RigFile, rig_file
from stereocal.rig.parameters import RigParameters, Timing
from stereocal.rig.recording import CameraPair, Recording
from stereocal.system.latest import step
from stereocal.system.made_from import Parts
from stereocal.system.tasks import Progress
from stereocal.verdict.forecast import forecast_of_set
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.made_from import parts_of
from stereocal.workflow.pair_of_rig import data_of_pair, settings_of_pair
from stereocal.workflow.pair_run import PairRun

Sets = Mapping[Method, RigParameters]
"""The parameter sets of a pair."""
USUAL_FILE = "parameters_refined.json"
"""As of `PairAnswer.parameter_files`."""
FORECAST = (
    *("fcp_reprojection", "median_error_3d", "p95_error_3d", "p95_metric_error_3d"),
    "threshold_px",
)
"""Of a pair's forecast, in rig.json."""


@dataclass(eq=False)
class Run:
    """The rig of a recording, and the sets of its pairs. Each step is made when it is first asked
    for, and kept."""

    recording: Recording
    settings: RefineSettings = field(default_factory=RefineSettings)
    time_offsets: bool | None = None
    """Whether to bring the cameras into step; None: where it is significant."""
    searches: CalibrationSettings | None = None
    """Of the paper's two sets of every pair; None: without them."""
    begin: Callable[[str], object] = lambda _: None
    """Called with the name of each stage that takes time."""
    progress: Progress = lambda *_: None
    """Called with what is done of it, and what there is in all."""

    @property
    def made_from(self) -> Parts:
        """What the rig is computed from, but for the name of the recording."""
        settings = {
            "settings": [self.settings.to_json()],
            "time offsets applied": [self.time_offsets],
        }
        return {**parts_of(self.recording), **settings}

    @step
    def bare_rig(self) -> RigFile:
        """The rig, without the forecasts of its pairs."""
        self.begin("steps")
        return rig_file(
            calibrate_rig(self.recording, self.settings, self.time_offsets, self.progress)
        )

    @step
    def _of_pairs(self) -> tuple[dict[str, Sets], list[str]]:
        """The parameter sets of each pair by its name, and notes on pairs without any."""
        sets, notes = dict[str, Sets](), list[str]()
        pairs = {
            name: it for name, it in self.bare_rig.about.pairs.items() if it.frames is not None
        }
        self.begin("pairs")
        for number, (name, pair) in enumerate(pairs.items()):
            try:
                sets[name] = self._sets_of(pair.cameras)
            except (StereocalError, KeyError) as error:
                notes.append(f"The pair {name} has no files: {error}")
            except np.linalg.LinAlgError:
                notes.append(
                    f"The pair {name} has no files: its images determine too little of it."
                )
            self.progress(number + 1, len(pairs))
        return sets, notes

    def _sets_of(self, pair: CameraPair) -> Sets:
        """The refined set of two cameras, which is the rig's, and the paper's two if asked for."""
        dataset = data_of_pair(self.recording, pair, self.bare_rig)
        settings, of_rig = settings_of_pair(dataset, pair, self.bare_rig), self.bare_rig.pair(*pair)
        sets: Sets
        if dataset.recording.has_windows:
            refined = refine(dataset, settings)
            forecast = forecast_of_set(refined)
            sets = {"refined": refined_parameters(refined, forecast=forecast)}
        elif self.searches is None:
            sets = {"refined": refined_parameters(refine(dataset, settings))}
        else:  # the rig has left out the frames that contradict it
            run = PairRun(dataset, replace(self.searches, all_frames=True), settings)
            if run.forecast is None:
                raise StereocalError("there is no forecast for it.")
            sets = PairAnswer(run).sets
        when: Timing = {"time_offset": of_rig.time_offset, "start_frame": of_rig.start_frame}
        left_out, given = self.bare_rig.about.frames_left_out, self.recording.sha256
        return {
            method: replace(
                parameters,
                inputs={**parameters.inputs, "sha256": given},
                frames_left_out=left_out,
                **when,
            )
            for method, parameters in sets.items()
        }

    @property
    def sets(self) -> dict[str, Sets]:
        """The parameter sets of each pair, by its name."""
        return self._of_pairs[0]

    @step
    def rig(self) -> RigFile:
        """The rig, with the forecasts of its pairs."""
        entries = self.bare_rig.about
        pairs = {**entries.pairs, **{name: self._forecast_of(name) for name in self.sets}}
        return replace(self.bare_rig, about=replace(entries, pairs=pairs))

    def _forecast_of(self, name: str) -> PairOfRig:
        predicted = self.sets[name]["refined"].predicted or {}
        figures = {key: predicted[key] for key in FORECAST if key in predicted}
        return replace(self.bare_rig.about.pairs[name], **figures)

    @property
    def pair_files(self) -> dict[str, bytes]:
        """The files of the pairs, by name; of two cameras behind a window also under the name that
        two in air have."""
        files = {
            f"{name}_{method}.json": parameters.dumps().encode()
            for name, of_pair in self.sets.items()
            for method, parameters in of_pair.items()
        }
        if self.recording.has_windows and len(self.recording.cameras) == 2:
            files |= dict.fromkeys([USUAL_FILE] if files else [], *files.values())
        return files

    @property
    def sentences(self) -> list[str]:
        """How good the rig is."""
        rig = self.rig
        return [
            words
            for words in (rig_sentence(rig), windows_sentence(rig), loops_sentence(rig))
            if words
        ]

    @property
    def notes(self) -> list[str]:
        """What is to be known of the recording, the rig and its pairs."""
        return [*rig_notes(self.rig), *self.recording.step_notes, *self.notes_on_pairs]

    @property
    def notes_on_pairs(self) -> list[str]:
        """On pairs without files."""
        return self._of_pairs[1]
