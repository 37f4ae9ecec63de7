"""The methods section of a paper, in Markdown with citations, from a result, and its references."""

import platform
from collections.abc import Iterator
from functools import partial

import numpy as np

from stereocal.calibration.methods import ALL_METHODS
from stereocal.evaluation.summary import BOOTSTRAPS, FEWEST_RUNS
from stereocal.fit.least_squares.unknowns import (
    DEFAULT_BASELINE,
    DEFAULT_CENTRE_PX,
    DEFAULT_DISTANCE,
    DEFAULT_FOCAL,
)
from stereocal.matching.application import Outcome
from stereocal.rig.correspondences import SOURCES
from stereocal.rig.pair import Pair
from stereocal.system.numbers import count, rounded
from stereocal.verdict.file_figures import bar_known
from stereocal.verdict.forecast import sure
from stereocal.verdict.in_words import digits, in_percent, listed, named_frames, percent
from stereocal.verdict.recommendation import NAMES
from stereocal.version import __version__
from stereocal.workflow.answer import PairAnswer

PAPER, PROGRAM = "beschi2021", "stereocal"
"""Keys of the entries."""
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
MOST_FRAMES = 40
"""Frames left out that are named one by one."""


def methods_md(answer: PairAnswer, applied: Outcome | None = None) -> str:
    """What was recorded, left out, computed and found, and which set serves what.

    Without a validation there are no held-out figures; without a forecast either, none at all.

    Args:
        applied: how points were matched and measured; None: it says what is recommended.
    """
    caution = answer.recommendation.caution
    warning = [f"**Do not rely on this result: {caution}**"] if caution else []
    use = (
        partial(_applied, applied)
        if applied is not None and "matching" in applied.used
        else _recommended
    )
    parts = (_recording, _left_out, _sets, _validation, _held_out, use, _lengths, _verdict)
    paragraphs = (" ".join(filter(None, part(answer))) for part in parts)
    files = (
        "All figures of each method are in `table.csv`, with 95 % intervals (`_low`, `_high`); "
        "errors are fractions, `predicted_` figures are forecasts for similar bars. The data set "
        "and the parameter files are in the same zip (Python "
        f"{platform.python_version()}, NumPy {np.__version__})."
    )
    return "\n\n".join(["# Calibration", *warning, *filter(None, paragraphs), files]) + "\n"


def _recording(answer: PairAnswer) -> Iterator[str]:
    dataset = answer.run.calibration.dataset
    rows = dataset.correspondences
    what, distances = "A bar with two targets", f"{count(len(rows.bars), 'bar')} with both targets"
    if (rigid_object := rows.rigid_object) is not None:
        distances = count(len(rows.bars), "known distance")
        what = f"A rigid object with {len(rigid_object.names)} targets, the farthest"
        if rigid_object.board is not None:
            kind = "chessboard" if rigid_object.board.dictionary is None else "ChArUco board"
            what = f"A {kind} of {rigid_object.board} inner corners, the farthest"
    primary, secondary = (
        f"{width} × {height} px and a focal length of {digits(float(camera.K[0, 0]), 4)} px"
        for camera in (dataset.primary, dataset.secondary)
        for width, height in (camera.image_size,)
    )
    yield (
        f"The stereo system was calibrated with stereocal {__version__} [@{PROGRAM}], "
        f"which implements and extends the procedure of Beschi et al. [@{PAPER}]."
    )
    yield f"The primary camera had {primary}, the secondary {secondary}."
    yield (
        f"{what} {rounded(dataset.target_distance_m, 6)} m apart"
        f"{_known(dataset.target_distance_sigma_m)} was recorded in "
        f"{count(len(rows.frames), 'frame')}, which gave {count(len(rows), 'pair')} of image "
        f"points and {distances}."
    )
    yield (
        f"The measured baseline was {rounded(dataset.baseline_m, 6)} "
        f"m{_known(dataset.baseline_sigma_m)}."
    )
    by_hand = int(np.sum(rows.source != SOURCES.index("detected")))
    if by_hand < len(rows):
        corrected = f"; {count(by_hand, 'pair')} were corrected or set by hand" if by_hand else ""
        yield f"The targets were detected in the photographs{corrected}."
    if (volume := answer.sets["3d"].volume) is not None:
        yield f"The bars filled depths from {volume.depths} in front of the primary camera."


def _known(sigma_m: float | None) -> str:
    return "" if sigma_m is None else f" (standard error {digits(1000 * sigma_m, 2)} mm)"


def _left_out(answer: PairAnswer) -> Iterator[str]:
    screening = answer.run.calibration.screening
    if frames := screening.contradicting:
        yield (
            f"Before the calibration, a robust fit found {count(len(frames), 'frame')} that "
            f"contradicted the others; {_them(frames)} left out."
        )
    if (shift := screening.shift) is not None:
        yield f"{shift.sentence()} Its points were interpolated at the instants of the primary's."
    if by_user := screening.by_user:
        yield f"{'Further, f' if frames else 'F'}{_them(by_user)[1:]} left out by hand."
    if copies := tuple(screening.copies):
        yield f"F{_them(copies)[1:]} left out as copies of other frames."
    if put_back := answer.run.calibration.settings.frames_put_back:
        verb = "were" if len(put_back) > 1 else "was"
        yield f"F{named_frames(put_back, MOST_FRAMES)[1:]} {verb} kept by hand."
    if answer.run.calibration.settings.all_frames:
        yield "No frame was left out for contradicting the others."


def _them(frames: tuple[int, ...]) -> str:
    return f"{named_frames(frames, MOST_FRAMES)} {'were' if len(frames) > 1 else 'was'}"


def _sets(answer: PairAnswer) -> Iterator[str]:
    calibration = answer.run.calibration
    settings, search = calibration.settings, calibration.settings.search
    solver = "minimising the sum of the squared residuals over the five angles of the pose"
    if settings.essential == "linear":
        solver = "the normalised eight-point algorithm"
    lengths = "error of the length of the bar"
    if settings.known_points:
        lengths = "distance of the points from their known positions"
    yield (
        f"Sets of parameters were estimated from {count(len(calibration.frames), 'frame')}. The "
        f"essential matrix was estimated by {solver}. From there, two Monte Carlo searches changed "
        "one of the five angles of the pose at a time: one minimised the reprojection error (2D "
        f"set), the other the {lengths} (3D set)."
    )
    yield (
        f"Steps began at {_step(search.delta)} rad and were multiplied by {search.shrink:g} when "
        f"fewer than {100 * search.acceptance:g} % of at least {search.minimum_moves} moves were "
        f"accepted; the searches ended below {_step(search.delta_min)} rad (seed {search.seed})."
    )
    if (refined := calibration.refined) is not None:
        free = refined.settings.free_distortion
        also = f" and the distortion of the {' and '.join(free)} camera" if free else ""
        yield (
            "A further set (refined set) is a weighted least-squares adjustment of the pose, the "
            f"baseline, the bar, the focal lengths and image centres{also} to the image points "
            "and the measured lengths, each weighted by its uncertainty; it estimated an image "
            f"noise of {digits(float(refined.sigma_px.value), 2)} px."
        )
        yield _assumed(calibration.dataset)


def _assumed(dataset: Pair) -> str:
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


def _step(radians: float) -> str:
    """`0.001`, `2 × 10⁻⁶`."""
    number, _, exponent = f"{radians:g}".partition("e")
    if not exponent:
        return number
    power = f"10{str(int(exponent)).translate(RAISED)}"
    return power if number == "1" else f"{number} × {power}"


def _validation(answer: PairAnswer) -> Iterator[str]:
    evaluation = answer.evaluation
    if evaluation is None:
        return
    settings = evaluation.settings
    frames = len(answer.run.calibration.screening.dataset.correspondences.frames)
    refined = answer.run.calibration.refined
    follow = refined is not None and refined.clusters.has_runs and settings.splits == "runs"
    yield (
        f"In each of {settings.runs} runs, {settings.calibration_frames} frames drawn at random "
        f"calibrated the system and the other {frames - settings.calibration_frames} tested it "
        f"(seed {settings.calibration.search.seed})."
        + " Frames that follow each other were drawn together."
        * follow
    )
    yield (
        "Each point of the primary camera was paired with its own and with other points of the "
        "secondary camera (correct and wrong pairs). The false correspondence probability (FCP) is "
        "the overlap of the probability densities of the logarithm of the reprojection error of "
        "correct and of wrong pairs; the matching threshold is where they cross. The 3D error is "
        "|D − Dᴿ| / D, with the measured length D of the bar and the reconstructed length Dᴿ."
        + f" Intervals are 95 % bootstrap intervals over the runs ({BOOTSTRAPS} resamplings)."
        * (settings.runs >= FEWEST_RUNS)
    )


def _held_out(answer: PairAnswer) -> Iterator[str]:
    if answer.evaluation is None:
        return
    every, sentences = answer.evaluation.summaries, []
    for method in (method for method in ALL_METHODS if method in every):
        fcp, median = (every[method].main(name) for name in ("reprojection", "reconstruction"))
        measured = ", and no bar could be measured"
        if np.isfinite(median.value):
            within = percent(every[method].reconstruction.p95)
            measured = (
                f" and a median 3D error of {in_percent(median)}, with 95 % of bars within "
                f"{within} %"
            )
        sentences.append(f"{NAMES[method]} had an FCP of {in_percent(fcp)}{measured}")
    yield f"On held-out frames: {'; '.join(sentences)} (`table.csv`)."


def _applied(applied: Outcome, answer: PairAnswer) -> Iterator[str]:
    """Which set matched and which measured the points of the project."""
    used, sets = applied.used, []
    for method, digest in (used["matching"], used["measuring"]):
        parameters = answer.sets.get(method)
        is_same = parameters is not None and parameters.digest == digest
        another = "" if is_same else " of another calibration"
        sets.append(NAMES[method] + another)
    names = " and ".join(f"`{label}`" for label in used["points"])
    below = rounded(applied.threshold_px, 4)
    yield f"The points of {names} were matched with {sets[0]} below {below} px."
    yield f"Their positions were reconstructed with {sets[1]}."


def _recommended(answer: PairAnswer) -> Iterator[str]:
    """Which set is recommended for what; no points of the project were matched."""
    recommendation = answer.recommendation
    match, measure, let_in = recommendation.match, recommendation.measure, ""
    held_out, forecast = match.wrong_let_in.held_out, match.wrong_let_in.forecast
    where, share = "on held-out frames", held_out
    if held_out is None and forecast is not None:
        where, share = "in the forecast", forecast.value
    if share is not None:
        let_in = f", a threshold that {percent(share)} % of wrong pairs passed {where}"
    yield f"To match points, {NAMES[match.method]}{match.below} is recommended{let_in}."
    yield f"To reconstruct positions and lengths, {NAMES[measure.method]} is recommended."


def _lengths(answer: PairAnswer) -> Iterator[str]:
    """How well lengths in metres are known, and what of that is the bar."""
    recommendation = answer.recommendation
    metric, scatter = (
        estimate.best(recommendation.forecast_holds)
        for estimate in (recommendation.measure.metric_p95, recommendation.measure.length_p95)
    )
    if metric is not None and scatter is not None:
        known = bar_known(answer.run.calibration, answer.run.forecast)
        yield (
            f"95 % of lengths in metres are within {in_percent(metric)}, with {known.in_words}; "
            f"relative to the {known.word} within {in_percent(scatter)}."
        )


def _verdict(answer: PairAnswer) -> Iterator[str]:
    verdict = answer.recommendation.verdict
    if verdict is None or not answer.recommendation.forecast_holds:
        return
    if verdict.kind == "one":
        yield f"One set serves both purposes here ({sure(verdict.chance_of_one)} sure)."
    elif verdict.kind == "two":
        yield f"Two sets are worth it here ({sure(1 - verdict.chance_of_one)} sure)."


def references_bib() -> bytes:
    """`references.bib`: the paper of the method, and the program with its version."""
    return f"""@misc{{{PAPER},
  author = {{Beschi, Riccardo and Feng, Xiao and Melillo, Stefania and Parisi, Leonardo and
            Postiglione, Lorena}},
  title = {{{{Stereo camera system calibration: the need of two sets of parameters}}}},
  year = {{2021}},
  eprint = {{2101.05725}},
  archivePrefix = {{arXiv}},
  url = {{https://arxiv.org/abs/2101.05725}},
}}

@software{{{PROGRAM},
  author = {{{{The developers of stereocal}}}},
  title = {{{{stereocal}}}},
  version = {{{__version__}}},
}}
""".encode()
