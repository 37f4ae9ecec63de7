"""Photographs and videos of cameras that were started by hand are paired by the motion."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stereocal.cli import main
from stereocal.errors import StereocalError
from stereocal.fit.calibrate import calibrate_rig
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.timing.out_of_step import with_offset_if_out_of_step
from stereocal.formats.dataset_files import read_dataset, read_recording
from stereocal.frames.by_motion import found_by_motion
from stereocal.frames.pairing import ByHand, Motion
from stereocal.frames.video.extract import VideoSettings, extract
from stereocal.frames.video.sound import heard_later
from stereocal.frames.video.time_stamps import by_themselves
from stereocal.intrinsics.board_order import orders_of
from stereocal.rig.camera import CAMERAS
from stereocal.rig.rigid_object import BoardPattern, RigidObject
from stereocal.system.array_types import FloatArray
from tests.further import of_a_whole_soak
from tests.refused import refused
from tools.photographs.rendering import HERE
from tools.photographs.started_by_hand import (
    CAMERA,
    RATE,
    RIG,
    START_S,
    THIRD,
    THIRD_S,
    Bar,
    write_sample,
)

STEP_S = 2 / RATE


def _counts(of: int) -> dict[str, dict[str, int]]:
    sides = zip(CAMERAS, ("left", "right"), strict=True)
    return {camera: {f"{side}/{k}": k for k in range(of)} for camera, side in sides}


def _seen(
    points_m: Callable[[float], FloatArray], of: int, start_s: float
) -> dict[str, FloatArray]:
    """Of each photograph, the pixels of points that are at `points_m` of a time in seconds."""
    rng, found = np.random.default_rng(1), {}
    for side, pose, first in (("left", HERE, 0.0), ("right", RIG.pose, start_s)):
        for k in range(of):
            pixels = CAMERA.project(pose.apply(points_m(first + k / 15)))
            found[f"{side}/{k}"] = pixels + rng.normal(0.0, 0.1, pixels.shape)
    return found


def _found(of: int, seen: dict[str, FloatArray], *about: Any, **heard: float) -> Motion:
    """What two cameras' photographs of what is held tell, with its orders."""
    lenses = {"primary": CAMERA, "secondary": CAMERA}
    return found_by_motion(ByHand(_counts(of), heard), seen, lenses, *about)


def _offset(motion: Motion, camera: str = "secondary") -> float:
    return motion.later[camera] + motion.late[camera]


def test_ends_that_look_alike_are_followed_and_told_apart() -> None:
    """A and B are exchanged from photographs to photographs, as reading order does."""
    seen = _seen(Bar(8, 15.0).ends_m, 110, 40.4 / 15)
    rng = np.random.default_rng(2)
    turned = {name for name in seen if rng.random() < 0.5}
    mixed = {name: own[::-1] if name in turned else own for name, own in seen.items()}
    orders = [np.arange(2), np.array([1, 0])]
    about = RigidObject.bar(1.0), orders
    found = _found(110, mixed, *about)
    assert _offset(found) == pytest.approx(40.4, abs=0.02)
    assert found.exchanged in (turned, {*seen} - turned)
    assert ByHand(_counts(110)).moments(found.later)[60]["secondary"] == "right/20"
    of_one = {name: own for name, own in seen.items() if name.startswith("left")}
    with pytest.raises(StereocalError):
        _found(110, of_one, *about)


def test_cameras_that_share_a_view_with_one_only_are_joined_through_it() -> None:
    """The first and the third see the bar in turns, and the second both times."""
    bar, orders = Bar(8, 15.0), [np.arange(2), np.array([1, 0])]
    seen, counts = dict[str, FloatArray](), dict[str, dict[str, int]]()
    rng = np.random.default_rng(3)
    starts = {"left": (HERE, 0, 0), "mid": (RIG.pose, 40.4, 0), "third": (THIRD, 20.25, 75)}
    for camera, (pose, start, first) in starts.items():
        counts[camera] = {f"{camera}/{k}": k for k in range(first, 150)}
        for name, k in counts[camera].items():
            pixels = CAMERA.project(pose.apply(bar.ends_m((start + k) / 15)))
            pixels += rng.normal(0.0, 0.1, pixels.shape)
            seen[name] = pixels[:: rng.choice([-1, 1])]
    for k in range(95, 150):
        seen[f"left/{k}"] = np.full((2, 2), np.nan)
    about = dict.fromkeys(starts, CAMERA), RigidObject.bar(1.0), orders
    motion = found_by_motion(ByHand(counts, {"third": 20.0}), seen, *about)
    for camera, (_, start, _) in starts.items():
        assert _offset(motion, camera) == pytest.approx(start, abs=0.03)
    assert "The sound of third agrees" in motion.sentence
    moments = ByHand(counts).moments(motion.later)
    assert moments[100] == {"left": "left/100", "mid": "mid/60", "third": "third/80"}


def test_boards_that_look_alike_when_turned() -> None:
    pattern = BoardPattern(6, 4, 0.08)
    board, bar = RigidObject.of_board(pattern), Bar(6, 15.0)

    def points_m(at_s: float) -> FloatArray:
        first, last = bar.ends_m(at_s)
        along = (last - first) / np.linalg.norm(last - first)
        down = np.cross([0.2, 0.3, 1.0], along)
        centred = board.points - board.points.mean(axis=0)
        axes = np.stack([along, down / np.linalg.norm(down)])
        return np.asarray((first + last) / 2 + centred[:, :2] @ axes)

    seen, half = _seen(points_m, 90, 25.25 / 15), orders_of(pattern)[1]
    mixed = {name: own[half] if name.startswith("right") else own for name, own in seen.items()}
    found = _found(90, mixed, board, orders_of(pattern))
    assert _offset(found) == pytest.approx(25.25, abs=0.02)


def test_sound_decides_between_offsets_that_fit_and_none_other() -> None:
    """The motion repeats itself every 2.4 s."""
    bar = Bar(7, 15.0)
    seen = _seen(lambda at_s: bar.ends_m(at_s % 2.4), 120, 30 / 15)
    about = RigidObject.bar(1.0), [np.arange(2)]
    with refused("offsets"):
        _found(120, seen, *about)
    found = _found(120, seen, *about, secondary=30.3)
    assert found.later["secondary"] == 30 and "sound" in found.sentence
    once = _seen(bar.ends_m, 120, 30 / 15)
    contradicted = _found(120, once, *about, secondary=-20.0)
    assert contradicted.later["secondary"] == 30 and "contradict" in contradicted.sentence


def test_claps_are_heard() -> None:
    def rises(first: int, seed: int) -> FloatArray:
        rng = np.random.default_rng(seed)
        own = np.abs(rng.normal(0.0, 0.05, 1200))
        own[np.array([180, 411, 530, 900, 1017]) - first] += 2.0
        return own

    assert heard_later(rises(0, 1), rises(-150, 2)) == pytest.approx(-1.5, abs=0.02)
    assert heard_later(rises(120, 3), rises(0, 4)) == pytest.approx(-1.2, abs=0.02)
    rng = np.random.default_rng(5)
    assert heard_later(np.abs(rng.normal(size=1200)), np.abs(rng.normal(size=1000))) is None
    assert heard_later(np.empty(0), rises(0, 1)) is None


def test_frames_are_taken_at_equal_times_of_both_rates() -> None:
    primary, secondary = np.arange(300) / 60, np.delete(3.0 + np.arange(100) / 25, 40)
    pairs, step_s = by_themselves([primary, secondary], None)
    assert step_s == pytest.approx(0.08)
    assert (pairs.frames[:, 1] >= 0).sum() == 49  # one is missing
    there = (pairs.frames >= 0).all(axis=1)
    first, second = pairs.frames[there].T
    np.testing.assert_allclose(primary[first], secondary[second] - 3.0, atol=0.5 / 60 + 1e-9)


def test_videos_of_cameras_started_by_hand(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("av")
    videos = write_sample(tmp_path, seconds=7)
    together = extract(dict(zip(CAMERAS, videos, strict=True)), VideoSettings("every", 200), print)
    assert "if the cameras were started by hand, say so" in together.sentences[-1]
    table = tmp_path / "correspondences.csv"
    command = ["detect", str(tmp_path), "--target", "balls:red,yellow", "--out", str(table)]
    command += ["--videos", *map(str, videos), "--pair-by", "motion"]
    assert main([*command, "--clock-ahead", "2"]) == 2
    assert "--clock-ahead compares" in capsys.readouterr().err
    earlier = tmp_path / "primary" / "900001.png"  # by the count of recorded frames
    earlier.parent.mkdir()
    earlier.write_bytes(b"")
    assert main(command) == 2 and "primary/900001.png" in capsys.readouterr().err
    earlier.unlink()
    assert main(command) == 0
    said = capsys.readouterr().err
    assert "The sound agrees" in said
    fit, _ = with_offset_if_out_of_step(read_dataset(tmp_path), RefineSettings())
    later = START_S / STEP_S
    frames = fit.dataset.correspondences.frame
    # The pairs are of whole steps, and the rest is found with the pose.
    assert fit.time_offset.frames == pytest.approx(later - round(later), abs=0.02)
    assert len(frames) > 120
    # 71 frames of 320x240 px; measured: 0.014.
    assert np.linalg.norm(fit.pose.angles - np.array(RIG.pose.angles)) < 0.02


@of_a_whole_soak  # two cameras' videos are above, three cameras' motion too
def test_videos_of_three_cameras_become_a_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("av")
    videos = [*map(str, write_sample(tmp_path, cameras=3, seconds=7))]
    table = tmp_path / "points.csv"
    command = ["detect", str(tmp_path), "--target", "balls:red,yellow", "--out", str(table)]
    assert main([*command, "--videos", *videos[:2], "--pair-by", "motion"]) == 2
    assert "left, right, third" in capsys.readouterr().err
    assert main([*command, "--videos", *videos]) == 2  # not of cameras that started together
    assert main([*command, "--videos", *videos, "--pair-by", "motion"]) == 0
    capsys.readouterr()
    recording = read_recording(tmp_path)
    assert np.isfinite(recording.images()[1]).all(axis=(1, 2, 3)).sum() > 60
    late = calibrate_rig(recording).time_offsets
    for found, start_s in zip(late, (0.0, START_S, THIRD_S), strict=True):
        assert found == pytest.approx(start_s / STEP_S - round(start_s / STEP_S), abs=0.02)
