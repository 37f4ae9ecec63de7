"""A recording of N cameras, of which some are late."""

import numpy as np

from stereocal.rig.tracks import TimeOffset
from tests.rigs.moving_wand import wave_wand

LATE = {"c2": 0.4, "c3": -1.3}
OFFSETS = {name: TimeOffset(frames) for name, frames in LATE.items()}


def test_points_of_late_cameras_are_where_they_were_in_step() -> None:
    """Against the truth; measured: 0.003 px at most, where the wand moves by 6 to 11 px a frame. As
    recorded, they are 0.5 to 13 px away."""
    _, in_step = wave_wand(1, np.zeros(3), 60, noise_px=0.0)
    _, recorded = wave_wand(1, np.array([0.0, *LATE.values()]), 60, noise_px=0.0)
    shifted = recorded.shifted(OFFSETS)
    true = in_step.images()[1]
    frames, images = shifted.where(shifted.usable).images()
    apart = np.linalg.norm(images - true[frames], axis=3)
    assert np.isfinite(apart).mean() > 0.8
    assert np.nanmax(apart) < 0.01
    as_recorded = np.linalg.norm(recorded.images()[1] - true, axis=3)
    assert np.nanmin(as_recorded[..., 1:]) > 0.3
    assert shifted.sha256 == recorded.sha256
    assert shifted.usable[shifted.camera == 0].all() and not shifted.usable.all()


def test_a_pair_is_shifted_as_its_recording() -> None:
    _, recorded = wave_wand(2, np.array([0.0, *LATE.values()]), 60)
    shifted = recorded.shifted(OFFSETS)
    for name, offset in OFFSETS.items():
        seen = recorded.pair("c1", name).shifted(offset)
        view = shifted.pair("c1", name)
        assert view.time_offset == seen.time_offset == offset
        # A pair's neighbours are those that both cameras see, so that it has fewer.
        known = np.isfinite(seen.correspondences.motion[:, 0])
        assert known.mean() > 0.8
        inner = known & (
            np.abs(view.correspondences.motion - seen.correspondences.motion).max(1) < 1e-9
        )
        assert inner.mean() > 0.8
        np.testing.assert_allclose(
            view.correspondences.secondary[inner], seen.correspondences.secondary[inner], atol=1e-9
        )


def test_taken_as_recorded_nothing_is_known_of_a_shift() -> None:
    _, recorded = wave_wand(1, np.array([0.0, *LATE.values()]), 30)
    shifted = recorded.shifted(OFFSETS)
    taken = shifted.taken_as_recorded()
    np.testing.assert_array_equal(taken.points, shifted.points)
    np.testing.assert_array_equal(shifted.recorded_points, recorded.points)
    assert not taken.offsets and taken.sha256 != recorded.sha256
