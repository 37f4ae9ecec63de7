"""Positions of tracked points between the recorded frames."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stereocal.rig.tracks import MeasuredOffset, TimeOffset, interpolate
from stereocal.system.array_types import FloatArray, IntArray
from tests.refused import refused
from tests.rigs import known_rig as rig

FRAMES = np.array([0, 1, 2, 3, 4, 5, 9, 10, 20, 30, 31, 32])


def curve(times: FloatArray | IntArray, degree: int) -> FloatArray:
    x = np.asarray(times, dtype=np.float64) / 10
    return np.column_stack([100 + 30 * x**degree, 50 - 20 * x**degree])


@given(late=st.floats(-1.5, 1.5))
def test_polynomials_are_met_as_far_as_neighbours_allow(late: float) -> None:
    """Run of six: cubics. Run of three: parabolas. Run of two: lines. One alone: nothing."""
    track = np.zeros(len(FRAMES), dtype=np.int64)
    at = FRAMES - late
    for degree, run, neighbours in ((3, slice(0, 6), 4), (2, slice(9, 12), 3), (1, slice(6, 8), 2)):
        found = interpolate(track, FRAMES, curve(FRAMES, degree), np.full(len(FRAMES), late))
        first, last = FRAMES[run][0], FRAMES[run][-1]
        inner = np.zeros(len(FRAMES), dtype=bool)
        margin = (neighbours - 2) // 2
        inner[run] = (at[run] >= first + margin) & (at[run] <= last - margin)
        assert found.known[inner].all()
        np.testing.assert_allclose(found.positions[inner], curve(at, degree)[inner], atol=1e-9)
        step = np.maximum(at, 1e-3)
        slopes = (curve(step + 1e-5, degree) - curve(step - 1e-5, degree)) / 2e-5
        if degree < 3:
            np.testing.assert_allclose(found.velocities[inner], slopes[inner], atol=0.1)
        if abs(late - round(late)) > 1e-6:
            assert not found.known[8]  # frame 20
        assert (found.variance[found.known] <= 1 + 1e-12).all()


def test_at_the_frames_themselves_all_stay() -> None:
    track = np.zeros(len(FRAMES), dtype=np.int64)
    found = interpolate(track, FRAMES, curve(FRAMES, 1), np.zeros(len(FRAMES)))
    known = FRAMES != 20
    np.testing.assert_array_equal(found.positions[known], curve(FRAMES, 1)[known])
    assert not found.known[~known].any()


def test_tracks_are_not_mixed_and_doubled_points_are_left_out() -> None:
    track = np.array([0, 0, 0, 1, 1, 2, 2, 2])
    times = np.array([1, 2, 3, 4, 5, 1, 1, 2])
    found = interpolate(track, times, curve(times, 1), np.full(8, 0.5))
    assert found.known.tolist() == [False, True, True, False, True, False, False, False]


def test_points_that_would_leave_the_image_stay() -> None:
    data = rig.dataset(12)
    shifted = data.shifted(TimeOffset(0.5)).correspondences
    size = np.array(data.secondary.image_size)
    assert ((shifted.secondary >= -0.5) & (shifted.secondary <= size - 0.5)).all()
    stay = np.isnan(shifted.motion[:, 0])
    np.testing.assert_array_equal(shifted.secondary[stay], data.correspondences.secondary[stay])


def test_the_entries_of_a_file() -> None:
    full = MeasuredOffset(0.3, 1e-5, 70.0, 0.002, 3e-6)
    assert MeasuredOffset.from_json(full.to_json()) == full
    assert MeasuredOffset.from_json({}) is None
    assert "0.3000 ± 0.0020 frame intervals later" in full.sentence()
    text = {"value": "x", "standard_error": 1}
    for bad, said in ((3, "'int'"), (text, "'x'"), ({"value": 1}, "'standard_error'")):
        with refused("time offset", said):
            MeasuredOffset.from_json({"time_offset_frames": bad})
    with refused("time offset", "finite"):
        MeasuredOffset.from_json(
            {"time_offset_frames": {"value": float("nan"), "standard_error": 1}}
        )
