"""The check where frames follow each other, of rigs that stood still and of rigs that moved."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stereocal.field.checking.check_words import notes
from stereocal.field.checking.new_images import NewImages, images_of_bars
from stereocal.field.checking.prior import prior_of
from stereocal.field.checking.recheck import recheck
from stereocal.field.checking.repair import repaired_parameters
from stereocal.formats.dataset_files import read_dataset
from stereocal.refined.parameter_file import refined_parameters
from stereocal.refined.refine import refine
from stereocal.refined.screening import screen
from stereocal.rig.dataset import Correspondences
from stereocal.rig.rig import Rig
from tests.rigs.bumps import Case, bumped, seen_by
from tests.rigs.refined_rigs import Misjudged, in_runs, random_rig, stated, waved_scene

RECORDING = Path(__file__).parents[2] / "sample_data" / "recording"
OFF = Misjudged()
RUN, FRAMES, NEW = 10, 200, 80


def waved_cases(trials: int) -> Iterator[Case]:
    """Rigs calibrated with a waved bar, whose noise is alike for runs of frames."""
    for seed in range(trials):
        rng = np.random.default_rng([seed, 91])
        scene = waved_scene(random_rig(rng), rng, FRAMES, RUN)
        data = in_runs(stated(scene, rng, OFF), rng, RUN, OFF.noise_px)
        fit = refine(data, OFF.settings())
        yield Case(scene.rig, data, prior_of(refined_parameters(fit)), rng)


def waved_bars(case: Case, *rigs: Rig) -> NewImages:
    """New frames of a waved bar, seen by several rigs in turn."""
    seen = [seen_by(case, waved_scene(rig, case.rng, NEW // len(rigs), RUN)) for rig in rigs]
    rows = [part.correspondences for part in seen]
    whole = Correspondences.from_arrays(
        np.arange(2 * NEW) // 2,
        "AB" * NEW,
        np.concatenate([each.primary for each in rows]),
        np.concatenate([each.secondary for each in rows]),
    )
    data = in_runs(replace(seen[0], correspondences=whole), case.rng, RUN, OFF.noise_px)
    return images_of_bars(data, case.prior.rig)


@pytest.mark.soak
def test_runs_are_no_movement_and_a_turn_is_still_found() -> None:
    """With new frames taken as independent, 4 of the first 12 unmoved rigs had moved."""
    alarms = found = since = 0
    for case in waved_cases(8):
        moved = bumped(case, np.radians(0.2))
        alarms += recheck(case.prior, waved_bars(case, case.truth)).changed
        late = recheck(case.prior, waved_bars(case, case.truth, moved))
        found += late.changed
        since += late.since is not None
    # Measured on 600 unmoved rigs: 7; on 200 that moved: 197 and 129. The stated share of alarms
    # is 1 in 100.
    assert alarms <= 1
    assert found >= 7
    assert since >= 3


def test_a_recording_has_not_moved_against_itself_and_says_how_its_frames_count() -> None:
    data = screen(read_dataset(RECORDING)).dataset
    fit = refine(data)
    prior = prior_of(refined_parameters(fit))
    assert prior.design_effect == fit.design_effect > 2
    check = recheck(prior, images_of_bars(data, prior.rig))
    assert check.verdict != "moved"
    assert check.noise.design_effect >= prior.design_effect
    assert any("independent ones" in note for note in notes(check))
    written = repaired_parameters(check, None).uncertainties
    assert written is not None
    assert written["design_effect"] == check.noise.design_effect
