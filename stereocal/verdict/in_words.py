"""Numbers and frames in sentences, and why a result is not to be relied on."""

import math
from collections.abc import Collection, Iterable, Sequence

import numpy as np

from stereocal.calibration.methods import POOR_LENGTH, CalibrationSettings, errors_of
from stereocal.errors import StereocalError
from stereocal.evaluation.summary import Estimate
from stereocal.fit.results import Calibration
from stereocal.fit.screening.screen import MAXIMUM_LEFT_OUT, Screening
from stereocal.rig.pair import Pair
from stereocal.system.numbers import count, plural
from stereocal.system.numbers import digits as digits
from stereocal.system.settings import descriptions


def left_out_line(screening: Screening) -> str:
    """Sentences on the frames left out, and on those whose targets look exchanged; or empty."""
    sentences = []
    if frames := screening.contradicting:
        verb = "contradicts" if len(frames) == 1 else "contradict"
        sentences.append(f"Left out: {named_frames(frames)}, which {verb} the others.")
        if which := screening.exchanged:
            where = "there" if which == frames else f"in {named_frames(which)}"
            sentences.append(f"A and B look exchanged in one camera {where}.")
    if screening.by_user:
        sentences.append(f"Left out by you: {named_frames(screening.by_user)}.")
    if copies := screening.copies:
        sentences.append(
            f"Left out as well: {named_frames([*copies])}, with exactly the points of "
            f"{named_frames(sorted({*copies.values()}))}; a copy adds no information."
        )
    if alone := screening.without_neighbours:
        sentences.append(
            f"{count(len(alone), 'frame', 'have')} no neighbours in time to shift the points by: "
            "left out too."
        )
    return " ".join(sentences)


def named_frames(frames: Sequence[int], most: int = 12) -> str:
    """Frames with their numbers in a sentence: `frame 3`, `frames 3, 8 and 12`."""
    return f"{plural(len(frames), 'frame')} {listed(frames, most)}"


def in_ranges(frames: Collection[int]) -> str:
    """Frame numbers with the gaps between them: `0 to 11, 13 and 20 to 24`."""
    numbers = np.unique(np.array([*frames], dtype=np.int64))
    if not len(numbers):
        return "none"
    ranges = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    return listed([f"{a[0]} to {a[-1]}" if len(a) > 1 else f"{a[0]}" for a in ranges])


def refuse_unknown_frames(settings: CalibrationSettings, datasets: Iterable[Pair]) -> None:
    """Reject numbers of frames to leave out or to put back that no data set has."""
    known = {frame for dataset in datasets for frame in dataset.correspondences.frames.tolist()}
    described = descriptions(CalibrationSettings)
    for name in ("frames_left_out", "frames_put_back"):
        if unknown := sorted({*getattr(settings, name)} - known):
            raise StereocalError(
                f"{described[name].title}: there is no {named_frames(unknown)}. The frames are "
                f"{in_ranges(known)}.",
                option=f"--{described[name].option} with one of these",
            )


def why_not_trusted(calibration: Calibration) -> str:
    """Why a calibration is not reliable, judged on held-out frames if there are any; or empty."""
    held_out = calibration.held_out_frames
    tested = held_out if len(held_out) else calibration.frames
    error = errors_of(calibration.dataset.of_frames(tested), calibration.methods["3d"].pose)
    return why_held_out_not_trusted([calibration.screening], [error.p95_length])


def why_held_out_not_trusted(
    screenings: Sequence[Screening], p95_lengths: Sequence[float | None]
) -> str:
    """Why held-out frames show that a result is not reliable, by the set that measures best; or
    empty.

    Args:
        p95_lengths: 95 % of the length errors of each set.
    """
    known = [error for error in p95_lengths if error is not None and math.isfinite(error)]
    best = min(known, default=0.0)
    reasons = [
        f"{percent(screening.share)} % of the frames of {screening.full_dataset.name} contradict "
        "the others and were left out."
        for screening in screenings
        if screening.share > MAXIMUM_LEFT_OUT
    ]
    if best > POOR_LENGTH:
        reasons.append(f"5 % of the bars have length errors above {percent(best)} %.")
    return " ".join(reasons)


def listed(frames: Sequence[object], most: int = 12) -> str:
    """Frame numbers in a sentence, `3, 8 and 12`, with the number of further ones."""
    shown = [str(frame) for frame in frames[:most]]
    if len(frames) > most:
        return f"{', '.join(shown)} and {len(frames) - most} more"
    return " and ".join([", ".join(shown[:-1]), shown[-1]] if len(shown) > 1 else shown)


def percent(fraction: float) -> str:
    """A fraction in percent, without the percent sign: 0.0037 gives `0.37`."""
    return digits(round(100 * fraction, 9) + 0.0, 2)


def interval(estimate: Estimate) -> str:
    """The interval of a fraction, in percent: `0.18 to 0.51`."""
    return f"{percent(estimate.low)} to {percent(estimate.high)}"


def in_percent(figure: Estimate | float) -> str:
    """A share or a relative error in percent, with its interval if it has one."""
    if not isinstance(figure, Estimate):
        return f"{percent(figure)} %"
    known = math.isfinite(figure.low) and math.isfinite(figure.high)
    return f"{percent(figure.value)} %" + (f" ({interval(figure)})" if known else "")
