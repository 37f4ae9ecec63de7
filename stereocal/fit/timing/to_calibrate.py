"""What is found of a recording before it is calibrated: where each camera's count of frames began,
and a baseline that was not measured."""

import math

from stereocal.calibration.corrections import fitting_px
from stereocal.errors import StereocalError
from stereocal.fit.start.baseline import with_baseline_found
from stereocal.fit.timing.offset_of_pair import offset_of_pair, px_as_numbered
from stereocal.fit.timing.started_by_hand import bring_into_step
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.system.numbers import count, rounded

MANY_IN_COMMON = 0.5
"""Part of the frames of the camera with fewer that both see, which is enough where these frames
are too few to tell more."""


def in_step(recording: Recording) -> Recording:
    """The recording with one count of frames; cameras that count their own are brought into step.

    Raises:
        StereocalError: the data do not tell it, or pairs contradict each other.
    """
    return bring_into_step(recording).recording if recording.own_frames else recording


def what_frames_tell(recording: Recording) -> tuple[bool | None, str]:
    """Whether the frames of the cameras are one count as they are numbered, by the points; None if
    the points do not tell; and why they are not, or may not be, in a sentence.

    Only what stands out counts: that points fit at another offset, and not as they are numbered.
    """
    doubt = ""
    for pair in recording.pairs:
        two = recording.of_cameras(pair)
        shared = len(two.common_frames(*pair))
        try:
            px = px_as_numbered(two)
        except StereocalError:  # too many numbers to search, as of time stamps, of one clock
            continue
        fewer = min(len({*two.frame[two.camera == k].tolist()}) for k in (0, 1))
        is_apart = fitting_px(two.cameras.values()) < px < math.inf
        if not is_apart and (px < math.inf or shared > MANY_IN_COMMON * fewer):
            continue
        fit = f"both cameras see a point in {count(shared, 'frame')} only"
        if is_apart:
            fit = f"the points of the cameras lie {rounded(px)} px from their epipolar lines"
        fit = f"As the frames are numbered, {fit}."
        try:
            offset = offset_of_pair(recording, pair)
        except StereocalError:
            doubt = fit
            continue
        if abs(offset.measured.frames) > 1:
            return False, f"{fit} {offset.sentence()}"
    return None if doubt else True, doubt


def pair_to_calibrate(recording: Recording, pair: str | None = None) -> Pair:
    """The data set of two cameras in step, with its baseline measured or found.

    Args:
        pair: such as `left-right`; None: the only two.

    Raises:
        StereocalError: there is no such pair, or no step or baseline can be found.
    """
    if pair is None:
        recording = in_step(recording)
    chosen = recording.chosen_pair(pair)
    if recording.own_frames or recording.start_frames:
        recording = in_step(recording.of_cameras(chosen))
    two = recording.pair(*chosen)
    return two if two.recording.has_windows else with_baseline_found(two)
