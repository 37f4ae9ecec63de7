"""What spoils photographs: where it should, and nowhere else."""

from __future__ import annotations

import json
from functools import cache

import cv2
import numpy as np
import pytest

from stereocal.detection.detect import detect_targets
from tests.tools.test_photographs import PLAIN, SHIPPED, is_x_corner, small_scene
from tools.photographs.bars import SAMPLE_FLAWS, BarSettings, Flaw, PhotographPair, photograph_bars

BAR = BarSettings(board_m=0.3, tilt_rad=(0.0, 0.3))
MOTION = Flaw("motion", motion_m=(0.03, 0.0, 0.0))


@cache
def taken(flaw: Flaw | None = None) -> list[PhotographPair]:
    """Three frames, the second with a flaw if there is one."""
    flaws = {2: flaw} if flaw else {}
    rng = np.random.default_rng(2)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tools.photographs.bars.MOTION_STEPS", 11)  # 0.7 px each
        return list(photograph_bars(small_scene(1, 3), (120.0, 90.0), BAR, PLAIN, rng, flaws))


@pytest.mark.parametrize("flaw", [Flaw("glare", glare=90.0), MOTION, Flaw("leaf", leaf=1.7)])
def test_only_the_frame_concerned_changes(flaw: Flaw) -> None:
    for sound, other in zip(taken(), taken(flaw), strict=True):
        same = [
            np.array_equal(sound.primary, other.primary),
            np.array_equal(sound.secondary, other.secondary),
        ]
        assert not same[0] if sound.frame == 2 else all(same)
        np.testing.assert_array_equal(sound.centres_primary, other.centres_primary)


def test_motion_blurs_along_its_direction_and_leaves_the_centre() -> None:
    sound, other = taken()[1], taken(MOTION)[1]
    for images in ((sound.primary, other.primary), (sound.secondary, other.secondary)):
        along, across = (
            np.abs(np.diff(images[1].astype(float), axis=axis)).max()
            / np.abs(np.diff(images[0].astype(float), axis=axis)).max()
            for axis in (1, 0)
        )
        assert along < 0.8
        assert across > along
    assert all(is_x_corner(other.primary, centre, 8) for centre in other.centres_primary)


def test_the_sample_has_three_doubtful_frames_and_a_refused_one() -> None:
    """As detection sees them; it finds both targets of all other frames without doubt."""
    found = {}
    for frame in SAMPLE_FLAWS:
        for which in ("primary", "secondary"):
            image = cv2.imread(str(SHIPPED / which / f"{frame:04d}.jpg"), cv2.IMREAD_UNCHANGED)
            found[frame, which] = detect_targets(np.asarray(image)).state
    assert {key: state for key, state in found.items() if state != "found"} == {
        (9, "secondary"): "doubtful",
        (11, "primary"): "doubtful",
        (11, "secondary"): "doubtful",
        (19, "primary"): "refused",
        (22, "primary"): "doubtful",
    }
    frames = json.loads((SHIPPED / "truth.json").read_text())["frames"]
    stated = {each["frame"]: each["flaw"] for each in frames if "flaw" in each}
    assert stated == {frame: flaw.what for frame, flaw in SAMPLE_FLAWS.items()}
