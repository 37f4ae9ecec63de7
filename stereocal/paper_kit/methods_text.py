"""The methods section of a paper, in Markdown with citations, from a result."""

from __future__ import annotations

import platform
from collections.abc import Iterator
from functools import partial

import numpy as np

from stereocal.calibration.methods import ALL_METHODS, CalibrationSettings, Method
from stereocal.evaluation.summary import BOOTSTRAPS, MethodSummary
from stereocal.figures.style import count
from stereocal.matching.application import Outcome, digest_of
from stereocal.paper_kit.references import PAPER, PROGRAM
from stereocal.refined.unknowns import (
    DEFAULT_BASELINE,
    DEFAULT_CENTRE_PX,
    DEFAULT_DISTANCE,
    DEFAULT_FOCAL,
)
from stereocal.rig.camera import Camera
from stereocal.rig.dataset import SOURCES, Correspondences, Dataset
from stereocal.system.numbers import rounded
from stereocal.verdict.in_words import digits, interval, listed, percent
from stereocal.verdict.one_or_two_sets import sure
from stereocal.verdict.recommendation import NAMES, FileFigures
from stereocal.version import __version__
from stereocal.workflow import Answer

RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
MOST_FRAMES = 40
"""Frames left out that are named one by one."""


def methods_md(answer: Answer, applied: Outcome | None = None) -> str:
    """What was recorded, left out, computed and found, and which set serves what.

    Without a validation there are no held-out figures; without a forecast either, none at all.

    Args:
        applied: how points were matched and measured; None: it says what is recommended.
    """
    caution = answer.recommendation.caution
    warning = [f"**Do not rely on this result: {caution}**"] if caution else []
    use = partial(_applied, applied) if applied is not None and applied.used else _recommended
    parts = (_recording, _left_out, _sets, _validation, _held_out, use, _verdict, _again)
    paragraphs = (" ".join(filter(None, part(answer))) for part in parts)
    return "\n\n".join(["# Calibration", *warning, *filter(None, paragraphs)]) + "\n"


def _object(rows: Correspondences) -> str:
    """What was moved, up to the distance of its targets."""
    own = rows.rigid_object
    if own is None:
        return "A bar with two targets"
    if own.board is not None:
        kind = "chessboard" if own.board.dictionary is None else "ChArUco board"
        return f"A {kind} of {own.board} inner corners, the farthest"
    return f"A rigid object with {len(own.names)} targets, the farthest"


def _recording(answer: Answer) -> Iterator[str]:
    dataset = answer.calibration.dataset
    rows = dataset.correspondences
    distances = f"{count(len(rows.bars), 'bar')} with both targets"
    if rows.rigid_object is not None:
        distances = count(len(rows.bars), "known distance")
    yield (
        f"The stereo system was calibrated with stereocal {__version__} [@{PROGRAM}], "
        f"which implements and extends the procedure of Beschi et al. [@{PAPER}]."
    )
    yield (
        f"The primary camera had {_camera(dataset.primary)}, the secondary "
        f"{_camera(dataset.secondary)}."
    )
    yield (
        f"{_object(rows)} {rounded(dataset.target_distance_m, 6)} m apart"
        f"{_known(dataset.target_distance_sigma_m)} was recorded in "
        f"{count(len(rows.frames), 'frame')}, which gave {count(len(rows), 'pair')} of image "
        f"points and {distances}."
    )
    yield (
        f"The measured baseline was {rounded(dataset.baseline_m, 6)} "
        f"m{_known(dataset.baseline_sigma_m)}."
    )
    yield from _points(dataset)
    if (volume := answer.sets["3d"].volume) is not None:
        yield f"The bars filled depths from {volume.depths} in front of the primary camera."


def _camera(camera: Camera) -> str:
    width, height = camera.image_size
    return f"{width} × {height} px and a focal length of {digits(float(camera.K[0, 0]), 4)} px"


def _known(sigma_m: float | None) -> str:
    return "" if sigma_m is None else f" (standard error {digits(1000 * sigma_m, 2)} mm)"


def _points(dataset: Dataset) -> Iterator[str]:
    """Where the points come from, if that is known."""
    rows = dataset.correspondences
    found = {name: int(np.sum(rows.source == at)) for at, name in enumerate(SOURCES)}
    if found["detected"]:
        by_hand = len(rows) - found["detected"]
        corrected = f"; {count(by_hand, 'pair')} were corrected or set by hand" if by_hand else ""
        yield f"The targets were detected in the photographs{corrected}."


def _left_out(answer: Answer) -> Iterator[str]:
    screening = answer.calibration.screening
    if frames := screening.contradicting:
        yield (
            f"Before the calibration, a robust fit found {count(len(frames), 'frame')} that "
            f"contradicted the others; {_them(frames)} left out."
        )
    if by_user := screening.by_user:
        yield f"{'Further, f' if frames else 'F'}{_them(by_user)[1:]} left out by hand."
    if copies := tuple(screening.copies):
        yield f"F{_them(copies)[1:]} left out as copies of other frames."
    if put_back := answer.calibration.settings.frames_put_back:
        verb = "were" if len(put_back) > 1 else "was"
        yield f"F{_frames(put_back)[1:]} {verb} kept by hand."
    if answer.calibration.settings.all_frames:
        yield "No frame was left out for contradicting the others."


def _frames(frames: tuple[int, ...]) -> str:
    return f"frame{'s' * (len(frames) > 1)} {listed(frames, MOST_FRAMES)}"


def _them(frames: tuple[int, ...]) -> str:
    return f"{_frames(frames)} {'were' if len(frames) > 1 else 'was'}"


def _sets(answer: Answer) -> Iterator[str]:
    calibration = answer.calibration
    settings, search = calibration.settings, calibration.settings.search
    yield (
        f"Sets of parameters were estimated from {count(len(calibration.frames), 'frame')}. The "
        f"essential matrix was estimated {_solver(settings)}."
    )
    lengths = "distance of the points from their known positions"
    yield (
        "From there, two Monte Carlo searches changed one of the five angles of the pose at a "
        "time: one minimised the reprojection error (2D set), the other the "
        f"{lengths if settings.known_points else 'error of the length of the bar'} (3D set)."
    )
    yield (
        f"Steps began at {_step(search.delta)} rad and were multiplied by {search.shrink:g} when "
        f"fewer than {100 * search.acceptance:g} % of at least {search.minimum_moves} moves were "
        f"accepted; the searches ended below {_step(search.delta_min)} rad (seed {search.seed})."
    )
    if calibration.refined is not None:
        refined = calibration.refined
        free = refined.settings.free_distortion
        also = f" and the distortion of the {' and '.join(free)} camera" if free else ""
        yield (
            "A further set (refined set) is a weighted least-squares adjustment of the pose, the "
            f"baseline, the bar, the focal lengths and image centres{also} to the image points "
            "and the measured lengths, each weighted by its uncertainty; it estimated an image "
            f"noise of {digits(float(refined.sigma_px.value), 2)} px."
        )
        yield _assumed(calibration.dataset)


def _assumed(dataset: Dataset) -> str:
    """The uncertainties that nobody stated."""
    known = all(camera.uncertainty is not None for camera in (dataset.primary, dataset.secondary))
    unstated = [
        f"{100 * share:g} % of the {what}"
        for what, share, stated in (
            ("baseline", DEFAULT_BASELINE, dataset.baseline_sigma_m is not None),
            ("length of the bar", DEFAULT_DISTANCE, dataset.target_distance_sigma_m is not None),
            ("focal lengths", DEFAULT_FOCAL, known),
        )
        if not stated
    ]
    if not known:
        unstated.append(f"{DEFAULT_CENTRE_PX:g} px of the image centres")
    return f"Standard errors of {listed(unstated)} were assumed." if unstated else ""


def _solver(settings: CalibrationSettings) -> str:
    if settings.essential == "linear":
        return "by the normalised eight-point algorithm"
    return "by minimising the sum of the squared residuals over the five angles of the pose"


def _step(radians: float) -> str:
    """`0.001`, `2 × 10⁻⁶`."""
    number, _, exponent = f"{radians:g}".partition("e")
    if not exponent:
        return number
    power = f"10{str(int(exponent)).translate(RAISED)}"
    return power if number == "1" else f"{number} × {power}"


def _validation(answer: Answer) -> Iterator[str]:
    evaluation = answer.evaluation
    if evaluation is None:
        return
    settings = evaluation.settings
    frames = len(answer.calibration.screening.dataset.correspondences.frames)
    refined = answer.calibration.refined
    follow = refined is not None and refined.clusters.has_runs
    drawn_together = follow and settings.splits == "runs"
    yield (
        f"In each of {settings.runs} runs, {settings.calibration_frames} frames drawn at random "
        f"calibrated the system and the other {frames - settings.calibration_frames} tested it "
        f"(seed {settings.calibration.search.seed})."
        + " Frames that follow each other were drawn together."
        * drawn_together
    )
    yield (
        "Each point of the primary camera was paired with its own and with other points of the "
        "secondary camera (correct and wrong pairs). The false correspondence probability (FCP) is "
        "the overlap of the probability densities of the logarithm of the reprojection error of "
        "correct and of wrong pairs; the matching threshold is where they cross. The 3D error is "
        "|D − Dᴿ| / D, with the measured length D of the bar and the reconstructed length Dᴿ. "
        f"Intervals are 95 % bootstrap intervals over the runs ({BOOTSTRAPS} resamplings)."
    )


def _held_out(answer: Answer) -> Iterator[str]:
    if answer.evaluation is None:
        return
    found = answer.evaluation.summaries
    yield "On held-out frames:"
    yield "; ".join(_figures(method, found[method]) for method in ALL_METHODS if method in found)
    yield "(figure `validation`, table `table.csv`)."


def _figures(method: Method, summary: MethodSummary) -> str:
    matching, lengths = summary.reprojection, summary.reconstruction
    found = f"{NAMES[method]} had an FCP of {percent(matching.fcp.value)} % "
    found += f"({interval(matching.fcp)})"
    if not np.isfinite(lengths.median.value):
        return f"{found}, and no bar could be measured"
    return (
        f"{found} and a median 3D error of {percent(lengths.median.value)} % "
        f"({interval(lengths.median)}), with 95 % of bars within {percent(lengths.p95)} %"
    )


def _applied(applied: Outcome, answer: Answer) -> Iterator[str]:
    """Which set matched and which measured the points of the project."""
    used = applied.used
    names = " and ".join(f"`{label}`" for label in used["points"])
    match, measure = (_named(answer, *used[purpose]) for purpose in ("matching", "measuring"))
    below = rounded(applied.threshold_px, 4)
    yield f"The points of {names} were matched with {match} below {below} px."
    yield f"Their positions were reconstructed with {measure}."


def _named(answer: Answer, method: Method, digest: str) -> str:
    """A set that points were matched or measured with."""
    own = answer.sets.get(method)
    another = "" if own is not None and digest_of(own) == digest else " of another calibration"
    return NAMES[method] + another


def _recommended(answer: Answer) -> Iterator[str]:
    """Which set is recommended for what; no points of the project were matched."""
    found = answer.recommendation
    match, measure = found.match, found.measure
    yield f"To match points, {NAMES[match.method]}{match.below} is recommended{_let_in(match)}."
    yield (
        f"To reconstruct positions and lengths, {NAMES[measure.method]} is recommended"
        f"{_within(measure, found.forecast_holds)}."
    )


def _verdict(answer: Answer) -> Iterator[str]:
    found = answer.recommendation
    if found.verdict is not None and found.forecast_holds:
        if found.verdict.kind == "one":
            yield f"One set serves both purposes here ({sure(found.verdict.chance_of_one)} sure)."
        elif found.verdict.kind == "two":
            yield f"Two sets are worth it here ({sure(1 - found.verdict.chance_of_one)} sure)."


def _let_in(match: FileFigures) -> str:
    if match.wrong_let_in.held_out is not None:
        share, where = percent(match.wrong_let_in.held_out), "on held-out frames"
    elif match.wrong_let_in.forecast is not None:
        share, where = percent(match.wrong_let_in.forecast.value), "in the forecast"
    else:
        return ""
    return f", a threshold that {share} % of wrong pairs passed {where}"


def _within(measure: FileFigures, forecast_holds: bool) -> str:
    """95 % of length errors where the held-out figures have not said it."""
    if measure.length_p95.held_out is not None or not forecast_holds:
        return ""
    within = measure.length_p95.percents(forecast_holds)
    return f"; by the forecast, 95 % of lengths are within {within}" if within else ""


def _again(_: Answer) -> Iterator[str]:
    yield (
        "Data, settings, parameter files and their digests are in `archive.zip`; `python -m "
        "stereocal reproduce archive.zip --out DIR` computes the parameter files again (Python "
        f"{platform.python_version()}, NumPy {np.__version__})."
    )


def captions_md(answer: Answer) -> str:
    """The captions of figures and table."""
    measure = NAMES[answer.recommendation.measure.method]
    lines = [
        "**errors_by_frame** Reprojection error and relative error of the length of the bar in "
        "each frame, for the sets calibrated with all frames not left out.",
        f"**rig** Cameras and reconstructed bars, with {measure}, from above and from the side.",
        "**table.csv** All figures of each method, with 95 % intervals (`_low`, `_high`); errors "
        "are fractions, `predicted_` figures are forecasts for similar bars.",
    ]
    if answer.evaluation is not None:
        shown = " (also with the refined set)" if len(answer.evaluation.summaries) > 3 else ""
        lines.insert(
            0,
            "**validation** Probability densities of the errors on held-out frames, by method"
            f"{shown}: residual and reprojection error of correct and of wrong pairs, with the "
            "matching threshold (dashed), and 3D error of the bars, with the line of 1 %. Framed: "
            "best beyond the 95 % intervals (in brackets); level: not apart.",
        )
    return "## Captions\n\n" + "\n\n".join(lines) + "\n"
