"""The report of a validation: one HTML file that holds everything and opens without a network."""

import datetime
import math
from collections.abc import Mapping, Sequence

import pandas as pd
import plotly

from stereocal.calibration.methods import METHOD_NAMES, PAPER_SETS, Method
from stereocal.evaluation.evaluate import EvaluationSettings
from stereocal.evaluation.summary import BOOTSTRAPS, FEWEST_RUNS, MethodSummary
from stereocal.figures import two_sets
from stereocal.figures.comparison import describe_comparison, plot_comparison
from stereocal.figures.html import html_figure, html_page, html_plot, html_table, paragraphs
from stereocal.figures.style import in_order
from stereocal.figures.tables import ANGLE_TITLES, contents_table, validation_table
from stereocal.figures.validation import COLUMNS, describe_validation, plot_validation
from stereocal.fit.results import Calibration
from stereocal.fit.screening.screen import Screening
from stereocal.rig.camera import CAMERAS
from stereocal.rig.geometry import Angles
from stereocal.rig.pair import Pair
from stereocal.rig.result_file import software_versions
from stereocal.system.numbers import rounded
from stereocal.system.settings import descriptions
from stereocal.verdict.in_words import left_out_line, listed
from stereocal.verdict.recommendation import Recommendation
from stereocal.verdict.validation_in_words import validation_answer


def report_html(
    summaries: Mapping[Method, MethodSummary],
    by_dataset: Mapping[str, Mapping[Method, MethodSummary]],
    datasets: Sequence[Pair],
    settings: EvaluationSettings,
    screenings: Sequence[Screening] = (),
    recommended: tuple[Calibration, Recommendation] | None = None,
) -> str:
    """The whole report as the text of one file.

    Args:
        summaries: all data sets pooled.
        by_dataset: each data set on its own, by name; drawn when there are several.
        datasets: in the order in which they were evaluated, with all frames.
        screenings: of the data sets, in order, where frames were left out.
        recommended: the calibration of a single data set, and its recommendation.
    """
    first = recommended[1].text if recommended else validation_answer(summaries)
    several = len(datasets) > 1
    named = f"{len(datasets)} data sets" if several else datasets[0].name or "a data set"
    versions = {**software_versions(), "plotly": plotly.__version__}
    software = html_table(pd.DataFrame({"Version": versions}).rename_axis("Program"))
    written = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")
    sections = {
        "Why two sets": _why_two_sets(recommended[0]) if recommended else "",
        "What was done": paragraphs(*_procedure(settings, "data sets" if several else "runs")),
        "Data sets" if several else "Data set": _datasets(datasets, screenings),
        "How well each method matches and measures": _validation(summaries),
        "The figures in numbers": html_table(validation_table(summaries)),
        "The data sets compared": html_figure(
            plot_comparison(by_dataset), describe_comparison(by_dataset)
        )
        if len(by_dataset) > 1
        else "",
        "Angles: mean ± spread over the runs, in degrees": _angles(summaries, datasets),
        "Settings": html_table(_settings(settings, summaries)),
        "Software": f"{software}\n{paragraphs(f'Written on {written}.')}",
    }
    return html_page(f"Validation of {named}", first, sections)


def _procedure(settings: EvaluationSettings, units: str) -> tuple[str, ...]:
    """What was done, in words; intervals are over the `units`."""
    intervals = (
        f"Intervals are 95 % bootstrap intervals over the {units} ({BOOTSTRAPS} resamplings)."
    )
    if settings.runs < FEWEST_RUNS:
        intervals = f"With fewer than {FEWEST_RUNS} runs there are no intervals."
    return (
        f"In each of {settings.runs} runs for each data set, {settings.calibration_frames} frames "
        "drawn at random calibrated the rig in three ways: by the essential matrix, by a search "
        "for the smallest reprojection error (2D set), and by a search for the smallest error of "
        "the bar's length (3D set). The other frames tested the result."
        + " Frames that follow each other and have alike errors were drawn together."
        * (settings.splits == "runs"),
        "Matching: each point of the primary camera was paired with points of the secondary. Pairs "
        "of the same target in the same frame are correct, all others wrong. The probability "
        "densities of log10 of the residual and of the reprojection error were compared: the area "
        "in which those of correct and of wrong pairs overlap says how often a wrong pair looks "
        "right (false correspondence probability, FCP). The recommended threshold is where they "
        "cross.",
        "Measuring: the 3D error is |D − Dᴿ| / D, with the measured length D of the bar and the "
        "reconstructed length Dᴿ.",
        f"{intervals} Values of zero and pairs behind a camera are counted, not dropped.",
    )


def _datasets(datasets: Sequence[Pair], screenings: Sequence[Screening]) -> str:
    rows = []
    for dataset in datasets:
        points = dataset.correspondences
        *_, baseline, known_length = contents_table(dataset)["Read"]
        counts = {"Frames": len(points.frames), "Pairs": len(points), "Bars": len(points.bars)}
        lengths = {"Baseline": baseline, "Bar": known_length}
        rows.append({**counts, **lengths, "SHA-256 of its numbers": dataset.sha256})
    table = pd.DataFrame(rows, index=pd.Index([dataset.name for dataset in datasets], name="Name"))
    notes = [f"{d.name}: {d.notes}" for d in datasets if d.notes]
    notes += [f"{s.full_dataset.name}: {s.time_note}" for s in screenings if s.time_note]
    notes += [f"{s.full_dataset.name}: {left_out_line(s)}" for s in screenings if s.left_out]
    return f"{html_table(table, 'data')}\n{paragraphs(*notes)}"


def _validation(summaries: Mapping[Method, MethodSummary]) -> str:
    """The grid on a wide screen, its columns one below the other on a narrow one."""
    words = describe_validation(summaries)
    wide = html_plot(plot_validation(summaries), words, "plot wide")
    # A finger that moves over a figure scrolls the page.
    narrow = [
        html_plot(plot_validation(summaries, [column]), words, "plot narrow") for column in COLUMNS
    ]
    return "\n".join([wide, *narrow, paragraphs(words)])


def _why_two_sets(calibration: Calibration) -> str:
    """The frame that shows it best, with the paper's two sets side by side."""
    frame = two_sets.telling_frame(calibration)
    views = two_sets.frame_views(calibration, frame)
    columns = []
    for method in PAPER_SETS:
        plots = [
            html_plot(
                two_sets.plot_image(views, method, camera),
                two_sets.describe_image(views, method, camera),
            )
            for camera in range(len(CAMERAS))
        ]
        plots.append(
            html_figure(two_sets.plot_gap(views, method), two_sets.describe_gap(views, method))
        )
        head = f"<h3>{METHOD_NAMES[method]}: primary and secondary image, and the rays</h3>"
        columns.append(f"<div>{head}{''.join(plots)}</div>")
    words = paragraphs(f"Frame {frame}. {two_sets.describe_two_sets(views)}")
    return f'{words}<div class="sets">{"".join(columns)}</div>'


def _angles(summaries: Mapping[Method, MethodSummary], datasets: Sequence[Pair]) -> str:
    columns = {}
    for method in in_order(summaries):
        means, spreads = summaries[method].angle_means, summaries[method].angle_spreads
        columns[METHOD_NAMES[method]] = [
            f"{math.degrees(mean):.4f} ± {math.degrees(spread):.4f}"
            for mean, spread in zip(means.flat, spreads.flat, strict=True)
        ]
    rows = [
        (f"{dataset.name}: " if len(datasets) > 1 else "")
        + ANGLE_TITLES[name].removesuffix(" (degrees)")
        for dataset in datasets
        for name in Angles._fields
    ]
    return html_table(pd.DataFrame(columns, index=pd.Index(rows, name="Angle")))


def _settings(
    settings: EvaluationSettings, summaries: Mapping[Method, MethodSummary]
) -> pd.DataFrame:
    described = descriptions(EvaluationSettings)
    lines = {described[name].title: _setting(value) for name, value in settings.to_json().items()}
    edges = next(iter(summaries.values())).residual.correct.edges
    lines["Width of the bins (decades)"] = f"{rounded(edges[1] - edges[0], 3)}"
    return pd.DataFrame({"Value": lines}).rename_axis("Setting")


def _setting(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_setting(inner)}" for key, inner in value.items())
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list) and value:
        return listed(value)
    return "none" if value in (None, []) else str(value)
