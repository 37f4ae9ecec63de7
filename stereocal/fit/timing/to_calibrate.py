"""What is found of a recording before it is calibrated: where each camera's count of frames began,
and a baseline that was not measured."""

from stereocal.fit.start.baseline import with_baseline_found
from stereocal.fit.timing.started_by_hand import bring_into_step
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording


def in_step(recording: Recording) -> Recording:
    """The recording with one count of frames; cameras that count their own are brought into step.

    Raises:
        StereocalError: the data do not tell it, or pairs contradict each other.
    """
    return bring_into_step(recording).recording if recording.own_frames else recording


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
    return with_baseline_found(recording.pair(*chosen))
