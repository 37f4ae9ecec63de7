"""Cameras that counted their own frames: their offset is found, or it is said to be open."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from stereocal.cli import main
from stereocal.fit.readings.lost_frames import lost_in_step
from stereocal.fit.timing.offset_of_pair import offset_of_pair
from stereocal.fit.timing.started_by_hand import bring_into_step
from stereocal.formats.dataset_files import pack_recording, read_recording
from stereocal.rig.camera import CAMERAS
from stereocal.rig.frame_rates import at_slowest
from stereocal.rig.recording import Recording
from stereocal.rig.tracks import TimeOffset
from stereocal.simulation.simulate import field_rig
from stereocal.system.numbers import rounded
from tests.further import further, of_a_whole_soak
from tests.refused import refused
from tests.rigs.mistakes import joined
from tests.rigs.moving_bar import move_bar, record

PAIR = ("1", "2")


@cache
def _real() -> Recording:
    return read_recording("sample_data/rig")


def _window(first: int, last: int, later: int = 0) -> Recording:
    """Frames of cameras 1 and 2 of the real recording; of camera 2 those that are `later`."""
    pair = _real().of_cameras(PAIR)
    begin = first + later * pair.camera
    return pair.where((pair.frame >= begin) & (pair.frame < begin + last - first))


@pytest.mark.parametrize("start", [137, *further(0, -9876)])
def test_the_offset_of_a_window_is_found_with_its_standard_error(start: int) -> None:
    counted = _window(300, 420, later=25).counted_from({"2": -start})
    found = offset_of_pair(counted, PAIR)
    assert abs(found.measured.frames - start) < 4 * found.measured.sigma < 0.05
    assert found.px < 0.5
    assert min(found.one_off_px, found.other_px) > 5 * found.px
    assert f"one frame off {rounded(found.one_off_px)}" in found.sentence()


@pytest.mark.parametrize("begin", [(2**53 - 900, 2**53 - 900), (2**53 - 900, 0)])
def test_frames_near_2_to_the_53_are_counted_exactly(begin: tuple[int, int]) -> None:
    """With whole numbers as floats, the second said 11.992 ± 0.002 frames for 12.000."""
    window = _window(300, 400).counted_from({"2": -12})
    usual = bring_into_step(window)
    far = window.counted_from(dict(zip(PAIR, begin, strict=True)))
    found, more = bring_into_step(far), begin[0] - begin[1]
    assert found.recording.start_frames == {"1": 0, "2": 12 + more}
    assert found.late == pytest.approx(usual.late, abs=1e-9) and abs(found.late["2"]) < 0.01
    np.testing.assert_array_equal(found.recording.frame, usual.recording.frame + begin[0])
    told, offset = (each.pairs[PAIR].exact for each in (usual, found))
    assert float(offset - more - told) == pytest.approx(0, abs=1e-9)
    assert f"Frame 0 of 2 is frame {offset:.3f}" in found.answer[0]


def test_frames_near_2_to_the_53_keep_their_parts() -> None:
    late = np.where(_window(300, 400).camera == 1, 0.3, 0.0)
    positions = [
        _window(300, 400).counted_from(begin).moved(late)[0].positions
        for begin in ({}, {"1": 2**53 - 900, "2": 2**53 - 900}, {"2": 2**53 - 900})
    ]
    np.testing.assert_allclose(positions[1:], [positions[0]] * 2, atol=1e-9)
    rates = {"1": 60.0, "2": 30.0}
    near, far = (
        at_slowest(_window(300, 400).counted_from({"1": 2 * n, "2": n}), rates)
        for n in (0, 2**52 - 900)
    )
    np.testing.assert_array_equal(far.frame, near.frame + 2**52 - 900)
    np.testing.assert_allclose(far.points, near.points, atol=1e-9)


def _lost(recording: Recording, name: str, at: int, ahead: int) -> Recording:
    """A camera's count from a frame on is ahead, as of frames that it lost, or behind."""
    mine = recording.camera == [*recording.cameras].index(name)
    lost = mine & (recording.frame >= at) & (recording.frame < at + ahead)
    frame = np.where(mine & (recording.frame >= at), recording.frame - ahead, recording.frame)
    return replace(recording, frame=frame).where(~lost)


@pytest.mark.parametrize(("at", "ahead"), [(384, 1), *further((339, -2), (421, 1))])
def test_frames_lost_by_one_of_two_cameras_are_named(at: int, ahead: int) -> None:
    """By its own count, with the first frame from there on that both see, at most 2 later; 12 of 12
    were named in four windows, and in none of these as they are."""
    window = _real().of_cameras(PAIR)
    window = window.where(np.isin(window.frame, np.unique(window.frame[window.frame >= 300])[:150]))
    counted = _lost(window, "2", at, ahead).counted_from({"2": -40})
    told = lost_in_step(bring_into_step(counted).recording)
    own = at - 40 + max(-ahead, 0)
    named = re.match(r"From frame (\d+) on camera 2 seems to be (\d) frames? (ahead|behind)", told)
    assert named and 0 <= int(named[1]) - own <= 2
    assert named.groups()[1:] == (str(abs(ahead)), "ahead" if ahead > 0 else "behind")
    assert lost_in_step(bring_into_step(window.counted_from({"2": -40})).recording) == ""


def test_of_three_cameras_it_is_said_which_lost_frames() -> None:
    window = _real().where((_real().frame >= 300) & (_real().frame < 450))
    counted = _lost(window, "1", 410, 1).counted_from({"3": -40})
    told = lost_in_step(bring_into_step(counted).recording)
    assert told.startswith("From frame 410 on camera 1 seems to be 1 frame ahead of the others")


def test_pairs_that_contradict_each_other_by_lost_frames_name_them() -> None:
    """Of camera 3 either part was taken: "contradict each other by 0.67 frames" was said."""
    window = _real().where((_real().frame >= 300) & (_real().frame < 450))
    with refused("From frame 345 on camera 3 seems to be 2 frames behind the others: it has 2"):
        bring_into_step(_lost(window, "3", 376, -2).counted_from({"3": -40}))


def test_sync_names_the_frame_that_a_camera_has_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Frame 60 of the first is frame 43 of the second by its own count."""
    read = read_recording(Path(__file__).parents[1] / "cases" / "frame_dropped" / "dup1")
    counted = replace(read.counted_from({"secondary": -17}), own_frames=True)
    for name, content in pack_recording(counted).items():
        (tmp_path / name).write_bytes(content)
    assert main(["sync", str(tmp_path), "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    assert "From frame 43 on the secondary camera seems to be 1 frame behind the primary" in told


def _later(recording: Recording, part: float) -> Recording:
    """The points of camera 2 where they were by a part of a frame later."""
    moved, inside = recording.moved(np.where(recording.camera == 1, -part, 0.0))
    return replace(recording, points=moved.positions).where(inside)


@pytest.mark.parametrize(("first", "camera"), [(300, 1), *further((300, 0), (500, 1), (500, 0))])
def test_ends_exchanged_in_some_frames_spoil_nothing(first: int, camera: int) -> None:
    """Measured: 0.400 ± 0.002 frames. With the ends as they are named, no offset was found of the
    first window, and 0.035 ± 0.042 frames of the third."""
    named = _later(_window(first, first + 120, later=25), 0.4)
    some = np.random.default_rng(5).random(900) < 0.3
    exchanged = (named.camera == camera) & some[named.frame]
    target = np.where(exchanged, named.object.half_turn[named.target], named.target)
    found = offset_of_pair(replace(named, target=target), PAIR).measured
    assert abs(found.frames - 0.4) < 3 * found.sigma < 0.015


def test_the_scale_is_that_of_the_points_in_step() -> None:
    """Out of step the lengths gave a baseline of 2.0 m for 4.9, and no fit was found."""
    found = offset_of_pair(_later(_window(100, 200, later=25), 0.4), PAIR).measured
    assert abs(found.frames - 0.4) < 3 * found.sigma < 0.01


def test_a_camera_of_half_the_rate_is_brought_into_step_by_the_stated_rates() -> None:
    two = _window(300, 420)
    own = two.where((two.camera == 0) | (two.frame % 2 == 1))
    counted = replace(own, frame=np.where(own.camera == 1, (own.frame - 301) // 2, own.frame))
    with refused('"frame_rates": {"1": 60, "2": 30}'):
        bring_into_step(counted)
    in_step = bring_into_step(at_slowest(counted, {"1": 60.0, "2": 30.0}))
    value, sigma = in_step.offsets["2"]
    assert abs(value - 150.5) < 4 * sigma < 0.1


@of_a_whole_soak  # twice as many frames are above
def test_rates_a_thousandth_apart_are_named() -> None:
    """In 5,000 frames the cameras are five frames further apart at the end."""
    rng = np.random.default_rng(7)
    bar = move_bar(field_rig(), rng, 5000, 0.9)
    data = record(bar, rng, 0.3, "long", TimeOffset(0.3, 60 / 59.94 - 1.0))
    own = replace(data.recording, frame=np.tile(data.correspondences.time_frame, len(CAMERAS)))
    with refused('"primary": 60, "secondary": 59.94'):
        bring_into_step(own)


def test_ends_exchanged_in_one_camera_throughout_are_named() -> None:
    named = _window(300, 420, later=25)
    ends = named.object.half_turn[named.target]
    exchanged = replace(named, target=np.where(named.camera == 1, ends, named.target))
    one, other = (named.object.names[at] for at in named.object.longest)
    with refused(f"{one} and {other}", "1 and 2"):
        bring_into_step(exchanged)
    orders = [np.arange(3), named.object.half_turn]
    in_step = bring_into_step(exchanged, orders=orders)
    assert abs(in_step.offsets["2"][0]) < 0.02
    assert (in_step.recording.target == named.target).all()


def test_points_at_the_frames_of_the_slowest_camera_are_where_they_were_then() -> None:
    two = _window(300, 360)
    even = replace(two, points=np.column_stack([two.frame, 1.5 * two.frame + 50.0]))
    found = at_slowest(even, {"1": 59.94, "2": 60.0})
    own_frame = found.frame * np.array([1.0, 60 / 59.94])[found.camera]
    np.testing.assert_allclose(found.points[:, 0], own_frame)
    np.testing.assert_allclose(found.points[:, 1], 1.5 * own_frame + 50.0)
    assert len(found.frame) > 0.9 * len(two.frame)


def _resting(at: int, first: int, frames: int) -> Recording:
    """A frame of the recording for a number of frames."""
    still = _window(at, at + 1)
    added = range(first - at, first - at + frames)
    return joined(*(still.counted_from(dict.fromkeys(PAIR, more)) for more in added))


def test_a_motion_that_repeats_itself_leaves_two_offsets() -> None:
    once = _window(300, 345)
    again = [once.counted_from(dict.fromkeys(PAIR, 45 * turn)) for turn in range(4)]
    with refused("1 and 2", 45, "0.31 px"):
        offset_of_pair(joined(*again), PAIR)


@pytest.mark.parametrize(
    ("recorded", "of", "said"),
    [
        (_window, (50, 250, 300), "15 px"),  # at different times
        (_resting, (300, 0, 200), "25 moments"),
        *((_window, (300, 300 + few), "25 moments") for few in (1, 2, 20, 30)),
    ],
)
def test_what_tells_no_offset_is_refused(
    recorded: Callable[..., Recording], of: tuple[int, ...], said: str
) -> None:
    with refused("1 and 2", said):
        offset_of_pair(recorded(*of), PAIR)


def test_a_long_rest_before_and_after_does_no_harm() -> None:
    rested = joined(_resting(300, 0, 300), _window(300, 420), _resting(419, 420, 300))
    found = offset_of_pair(rested.counted_from({"2": -77}), PAIR)
    assert found.measured.frames == pytest.approx(77, abs=0.02)


def test_short_arcs_at_the_ends_of_a_smooth_motion_do_not_hide_the_offset() -> None:
    """Of 60 frames a second, 50 at an end of the recordings fit at a wrong offset, to the noise."""
    rng, start = np.random.default_rng(6), 200.4
    bar = move_bar(field_rig(), rng, 1200, 0.9, frames_between=60)
    data = record(replace(bar, frames=900), rng, 0.2, "smooth", TimeOffset(start))
    own = replace(data.recording, frame=np.tile(data.correspondences.time_frame, len(CAMERAS)))
    found = offset_of_pair(own, CAMERAS)
    assert abs(found.measured.frames - start) < 4 * found.measured.sigma < 0.1
