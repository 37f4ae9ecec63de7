"""A focal length that changes with the distance, as by an autofocus, is named; nothing else is."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stereocal.cli import main
from stereocal.fit.calibrate import calibrate_rig
from stereocal.fit.readings.changing_focal import changing_focal_of_pair
from stereocal.fit.refine import refine
from stereocal.library.calibrations import calibrate
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.simulation.simulate import Scene
from stereocal.system.array_types import FloatArray
from tests.further import further
from tests.rigs.culprits import KINDS, sound, waved
from tests.rigs.mistakes import Change, lengths, moved, of_lenses, sure, zoomed
from tests.rigs.several_cameras import sound as sound_rig

CASE = Path(__file__).parents[1] / "cases" / "autofocus"
NAMED = "The focal length of {} seems to change with the distance of the "


def refocused(
    recording: Recording, name: str, camera: Camera, away_m: FloatArray, by: float
) -> Recording:
    """One camera's focal length grows from the nearest to the farthest frame by a part of it, with
    what an autofocus follows, 1 over the distance.

    Args:
        camera: the true one.
        away_m: of each point.
    """
    near = 1.0 / away_m
    grown = by * ((near.max() - near) / np.ptp(near) - 0.5)
    mine, centre = recording.camera == [*recording.cameras].index(name), camera.K[:2, 2]
    factor = np.where(mine, 1.0 + grown, 1.0)
    return replace(recording, points=centre + (recording.points - centre) * factor[:, None])


def pair(scene: Scene, data: Pair, name: str, by: float) -> Pair:
    """Two cameras, one of which refocuses."""
    camera = getattr(scene.rig, name)
    middles = scene.ends_m.mean(axis=1)
    seen = middles if name == "primary" else scene.rig.pose.apply(middles)
    away = np.linalg.norm(seen, axis=1)[data.recording.frame - data.recording.frame.min()]
    changed = refocused(data.recording, name, camera, away, by)
    return changed.within_view().pair(*CAMERAS)


def test_an_autofocus_is_named_and_no_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """2 % from 2.5 to 7 m; told as 2 % from 3.5 to 7.1 m."""
    assert main(["calibrate", str(CASE), "--out", str(tmp_path), "--runs", "0"]) == 0
    told = capsys.readouterr().out
    assert NAMED.format("one camera") + "bar, by about 2 % from 3.5 to 7.1 m: was its auto" in told
    assert "Measure it again" not in told and "disagree" not in told


def test_simulated_autofocus_is_named() -> None:
    """Measured: 15 of these 18, by 0.9 times the change in the median."""
    told = [
        changing_focal_of_pair(refine(pair(*sound(kind, n)[:2], CAMERAS[n % 2], by)))
        for kind in ("unlike cameras", "like cameras", "cropped")
        for n in (60, 61)
        for by in (0.03, -0.03, 0.05)
    ]
    named = [text for text in told if text.startswith(NAMED.format("one camera") + "bar")]
    assert len(named) >= 14


def test_inputs_are_not_accused_of_it() -> None:
    """An input was, with the advice to widen its uncertainty."""
    scene, data, _ = sound("like cameras", 50)
    calibration = calibrate(pair(scene, data, "primary", 0.06))
    assert calibration.focal_changes
    assert calibration.comparison is not None
    assert any(item.accused for item in calibration.comparison.inputs)
    assert not any(item.accused for item in calibration.inputs)


@pytest.mark.parametrize("kind", ["like cameras", "fisheyes", *further(*KINDS)])
def test_sound_pairs_are_not_accused(kind: str) -> None:
    """None of 192 others was."""
    for number in range(60, 66):
        assert changing_focal_of_pair(refine(sound(kind, number)[1])) == ""
    assert changing_focal_of_pair(refine(waved(60, 0.0))) == ""


@pytest.mark.parametrize(
    "change",
    [
        sure(zoomed(0.05)),
        of_lenses(lambda lens: replace(lens, distortion=0.5 * lens.distortion)),
        sure(lengths(0.95)),
        lengths(bar=1.05),
        moved(0.3),
    ],
    ids=["focal", "distortion", "baseline", "bar", "moved"],
)
def test_other_mistakes_are_no_autofocus(change: Change) -> None:
    for kind in ("unlike cameras", "like cameras"):
        _, data, rng = sound(kind, 62)
        wrong = change(data.recording, rng).within_view().pair(*CAMERAS)
        assert changing_focal_of_pair(refine(wrong)) == ""


def test_of_three_cameras_it_is_said_which() -> None:
    """The third of them; and of the sound rig nothing is said."""
    truth, _ = sound_rig("3 cameras", 2)
    sound_ones = calibrate_rig(truth.recording).warnings
    assert not any("seems to change" in warning for warning in sound_ones)
    middles = truth.poses["c3"].apply(truth.points_m.mean(axis=1))
    frames = truth.recording.frame - truth.recording.frame.min()
    away = np.linalg.norm(middles, axis=1)[frames]
    data = refocused(truth.recording, "c3", truth.cameras["c3"], away, 0.02)
    told = calibrate_rig(data).warnings
    assert any(NAMED.format("camera c3") in warning for warning in told)
    assert not any("contradict the stated lens" in warning for warning in told)
