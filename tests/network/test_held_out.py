"""A rig's errors on frames that it was not fitted to, against those of frames to come."""

from dataclasses import replace

import numpy as np

from stereocal.network.calibrate import calibrate_rig
from stereocal.network.fit import RigSettings
from stereocal.network.held_out import frame_errors, point_fits, relative_length_errors
from stereocal.network.in_words import rig_errors_in_words, rig_sentence
from stereocal.network.result import RigCalibration
from stereocal.network.rig_file import RigFile
from stereocal.refined.unknowns import LensPrior
from stereocal.rig.recording import Recording
from stereocal.simulation.rigs import LENS_ERRORS, simulated_rig
from tests.projects.test_recording import rig_text


def errors_on(rig: RigCalibration, recording: Recording) -> tuple[float, float]:
    """Reprojection error and 95 % of the length errors on other frames."""
    fit = type(rig.fit)(recording, rig.fit.poses, rig.fit.rig_settings)
    points, residuals = point_fits(rig.fit.cameras, fit.seen)
    px = frame_errors(residuals, fit.frame_of, len(fit.frames))
    lengths = np.abs(relative_length_errors(points, fit.seen.distances))
    return float(np.sqrt(np.nanmean(np.square(px)))), float(np.quantile(lengths, 0.95))


def test_they_are_those_of_frames_to_come() -> None:
    """Of rigs fitted to 30 frames of 300, the others are the truth."""
    ratios = []
    for seed in range(4):
        truth = simulated_rig(np.random.default_rng(seed), 3, 300)
        settings = RigSettings(lenses=dict.fromkeys(truth.cameras, LensPrior(*LENS_ERRORS)))
        frames = np.unique(truth.recording.frame)
        few = np.isin(truth.recording.frame, frames[:30])
        rig = calibrate_rig(truth.recording.where(few), settings)
        own, true = rig.held_out["frames"], errors_on(rig, truth.recording.where(~few))
        assert "runs" not in rig.held_out  # its frames do not follow each other
        fitted = float(np.sqrt(np.nanmean(np.square(rig.reprojection_px))))
        ratios.append((own.reprojection_px / true[0], fitted / true[0]))
    # Measured: 1.02 to 1.06 and 0.92 to 0.95; the scatter of 30 frames is 4 %.
    of_held_out, of_fitted = np.mean(ratios, axis=0)
    assert 0.96 < of_held_out < 1.1
    assert of_fitted < 0.96


def test_neighbours_in_a_recording_hide_errors() -> None:
    """On the real sample, every third frame: fitted 0.231 px, singly 0.238 px, in runs 0.254 px."""
    rig = RigFile.loads(rig_text())
    figures = rig.about.figures
    assert figures is not None
    singly, runs = (figures.held_out[name] for name in ("frames", "runs"))
    assert singly.frames == runs.frames == figures.frames
    assert figures.reprojection_px < singly.reprojection_px < runs.reprojection_px
    # The sentence states the runs first, and what each is.
    said = rig_sentence(rig)
    assert rig_errors_in_words(figures) in said.split("whole runs")[0]
    assert (
        rig_errors_in_words(replace(figures, held_out={"frames": singly}))
        in said.split("single frames")[1]
    )
