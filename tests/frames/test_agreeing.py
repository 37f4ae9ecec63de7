"""One press takes the doubtful frames that agree with the sure ones, and no wrong one."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from stereocal.detection.detect import State
from stereocal.frames.agreeing import agreeing
from stereocal.frames.frame import Centre, Frame
from stereocal.frames.review import Review, undo, use_agreeing, use_frame
from tests.refused import refused
from tests.rigs import known_rig as rig

CAMERAS = (rig.PRIMARY, rig.SECONDARY)
NOISE_PX = 0.1


def frames(
    pixels: Sequence[npt.NDArray[np.float64]], state: State, first: int, sigma_px: float
) -> list[Frame]:
    """Frames of pixels of each camera (f, 2, 2): frame, target, u and v."""
    found = []
    for k, both in enumerate(zip(*pixels, strict=True), first):
        primary, secondary = (
            tuple(Centre(float(u), float(v), sigma_px) for u, v in own) for own in both
        )
        files = (f"l{k}.png", f"r{k}.png")
        centres = ((primary[0], primary[1]), (secondary[0], secondary[1]))
        found.append(Frame(k, files, centres, state, use=state == "found"))
    return found


def recorded(seed: int, sure: int, doubtful: int, worse: float) -> tuple[list[Frame], list[Frame]]:
    """Sure frames, and right doubtful ones with more noise, which they state."""
    rng = np.random.default_rng(seed)
    images = [each.reshape(-1, 2, 2) for each in rig.images(rig.bar_ends(sure + doubtful, seed))]
    noise = np.where(np.arange(sure + doubtful) < sure, 1.0, worse)[:, None, None] * NOISE_PX
    seen = [image + noise * rng.normal(size=image.shape) for image in images]
    return (
        frames([own[:sure] for own in seen], "found", 1, NOISE_PX),
        frames([own[sure:] for own in seen], "doubtful", 1 + sure, worse * NOISE_PX),
    )


def shifted(frame: Frame, camera: int, target: int, by: tuple[float, float]) -> Frame:
    centre = frame.centres[camera][target]
    assert centre is not None
    moved = replace(centre, u=centre.u + by[0], v=centre.v + by[1])
    return frame.moved(camera, target, moved)


@pytest.mark.parametrize("seed", range(10))
def test_right_ones_are_taken_and_wrong_ones_are_not(seed: int) -> None:
    sure, doubtful = recorded(seed, 15, 20, 3.0)
    # 20 right ones: at four sigma of 40 points hardly any is missed.
    assert len(agreeing(sure, doubtful, CAMERAS)) >= 18
    rng = np.random.default_rng(seed)
    width, height = rig.PRIMARY.image_size
    wrong = [
        # Another thing of the photograph in place of one target.
        shifted(doubtful[0], 1, 0, (0.0, 15.0)),
        shifted(doubtful[1], 0, 1, (-40.0, 30.0)),
        # Along the epipolar lines, which are nearly level: only the length of the bar tells.
        shifted(shifted(doubtful[2], 1, 0, (60.0, 0.0)), 1, 1, (-60.0, 0.0)),
        doubtful[3].swapped(0),
        # The photographs of another moment.
        replace(doubtful[4], centres=(doubtful[4].centres[0], doubtful[5].centres[1])),
        *(
            shifted(
                frame, 1, target, (rng.uniform(-0.3, 0.3) * width, rng.uniform(0.02, 0.3) * height)
            )
            for frame in doubtful[6:]
            for target in (0, 1)
        ),
    ]
    assert agreeing(sure, wrong, CAMERAS) == []


def test_of_a_bar_along_the_epipolar_lines_the_length_tells() -> None:
    sure, _ = recorded(1, 15, 1, 1.0)
    along = 0.5 * rig.BAR_M * rig.RIG.inverse().T / rig.BASELINE_M
    middle = np.array([0.2, 0.1, 7.0])
    pixels = [each.reshape(-1, 2, 2) for each in rig.images([middle - along, middle + along])]
    (frame,) = frames(pixels, "doubtful", 99, NOISE_PX)
    assert agreeing(sure, [frame], CAMERAS) == [99]
    assert agreeing(sure, [frame.swapped(1)], CAMERAS) == []


def test_too_few_sure_frames_are_said() -> None:
    sure, doubtful = recorded(1, 5, 3, 1.0)
    with refused("5 frames"):
        agreeing(sure, doubtful, CAMERAS)


def test_one_press_is_undone_at_once() -> None:
    sure, doubtful = recorded(2, 15, 8, 1.0)
    doubtful[3] = shifted(doubtful[3], 1, 0, (0.0, 30.0))
    start = use_frame(Review((*sure, *doubtful)), 1, False)
    after, said = use_agreeing(start, CAMERAS)
    assert sum(frame.use for frame in after.frames) == 14 + 7 and not after.frame(19).use
    assert said.startswith("7 of 8 doubtful frames are now used") and "other 1 does not" in said
    assert after.acts == 2 and undo(after) == start
    again, _ = use_agreeing(after, CAMERAS)
    assert again == after
