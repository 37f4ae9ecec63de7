"""The report of a validation: one HTML file that holds everything and opens without a network."""

from __future__ import annotations

import datetime
import math
import platform
from collections.abc import Iterable, Mapping, Sequence
from html import escape

import cv2
import numba
import numpy as np
import pandas as pd
import plotly
import scipy

from stereocal.calibration.methods import ALL_METHODS, METHOD_NAMES, CalibrationSettings, Method
from stereocal.calibration.montecarlo import SearchSettings
from stereocal.evaluation.evaluate import EvaluationSettings
from stereocal.evaluation.summary import BOOTSTRAPS, MethodSummary
from stereocal.figures.comparison import describe_comparison, plot_comparison
from stereocal.figures.frame_view import PAPERS, telling_frame, views_of
from stereocal.figures.html import (
    html_figure,
    html_page,
    html_plot,
    html_section,
    html_table,
    paragraphs,
)
from stereocal.figures.tables import (
    ANGLE_TITLES,
    contents_table,
    validation_answer,
    validation_table,
)
from stereocal.figures.two_sets import (
    describe_gap,
    describe_image,
    describe_two_sets,
    plot_gap,
    plot_image,
)
from stereocal.figures.validation import plot_validation
from stereocal.figures.validation_panels import COLUMNS, describe_validation
from stereocal.refined.results import Calibration
from stereocal.refined.screening import Screening
from stereocal.rig.camera import CAMERAS
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Angles
from stereocal.system.described import descriptions
from stereocal.system.numbers import rounded
from stereocal.verdict.in_words import left_out_line, listed
from stereocal.verdict.recommendation import Recommendation
from stereocal.version import __version__

SETTING_NAMES = {
    "maximum_moves": "Most moves of a search",
    "calibration_frames": "Frames to calibrate with, in each run",
    "known_points": "3D cost from known points instead of lengths",
    "runs": "Runs for each data set",
    "refined": "Settings of the refined method",
    "splits": "Left out together (runs: frames that follow each other)",
    **{
        name: about.title
        for settings in (SearchSettings, CalibrationSettings)
        for name, about in descriptions(settings).items()
    },
}


def report_html(
    summaries: Mapping[Method, MethodSummary],
    by_dataset: Mapping[str, Mapping[Method, MethodSummary]],
    datasets: Sequence[Dataset],
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
    title = f"Validation of {_named(datasets)}"
    sections = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="answer">{escape(first)}</p>',
        *_why_two_sets(recommended[0] if recommended else None),
        html_section("What was done", _procedure(datasets, settings)),
        html_section(
            "Data sets" if len(datasets) > 1 else "Data set", _datasets(datasets, screenings)
        ),
        html_section("How well each method matches and measures", _validation(summaries)),
        html_section("The figures in numbers", html_table(validation_table(summaries))),
        *_comparison(by_dataset),
        html_section(
            "Angles: mean ± spread over the runs, in degrees", _angles(summaries, datasets)
        ),
        html_section("Settings", html_table(_settings(settings, summaries))),
        html_section("Software", _software()),
    ]
    return html_page(title, sections)


def _named(datasets: Sequence[Dataset]) -> str:
    if len(datasets) == 1:
        return datasets[0].name or "a data set"
    return f"{len(datasets)} data sets"


def _procedure(datasets: Sequence[Dataset], settings: EvaluationSettings) -> str:
    """What was done, in words."""
    units = "data sets" if len(datasets) > 1 else "runs"
    return paragraphs(
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
        f"Intervals are 95 % bootstrap intervals over the {units} ({BOOTSTRAPS} resamplings). "
        "Values of zero and pairs behind a camera are counted, not dropped.",
    )


def _datasets(datasets: Sequence[Dataset], screenings: Sequence[Screening]) -> str:
    heads = ["Name", "Frames", "Pairs", "Bars", "Baseline", "Bar", "SHA-256 of its numbers"]
    rows = []
    for dataset in datasets:
        lines = contents_table(dataset)["Read"]
        points = dataset.correspondences
        cells = [
            dataset.name,
            len(points.frames),
            len(points),
            len(points.bars),
            lines["Baseline"],
            lines["Distance between the targets"],
        ]
        rows.append(
            "".join(f"<td>{escape(str(cell))}</td>" for cell in cells)
            + f'<td class="digest">{escape(dataset.sha256)}</td>'
        )
    notes = [f"{d.name}: {d.notes}" for d in datasets if d.notes]
    notes += [f"{s.full_dataset.name}: {s.time_note}" for s in screenings if s.time_note]
    notes += [f"{s.full_dataset.name}: {left_out_line(s)}" for s in screenings if s.left_out]
    head = "".join(f'<th scope="col">{text}</th>' for text in heads)
    body = "\n".join(f"<tr>{row}</tr>" for row in rows)
    return (
        f'<div class="scroll" tabindex="0"><table class="data"><thead><tr>{head}</tr></thead>\n'
        f"<tbody>{body}</tbody></table></div>\n{paragraphs(*notes)}"
    )


def _validation(summaries: Mapping[Method, MethodSummary]) -> str:
    """The grid on a wide screen, its columns one below the other on a narrow one."""
    words = describe_validation(summaries)
    wide = html_plot(plot_validation(summaries), words, "plot wide")
    # A finger that moves over a figure scrolls the page.
    narrow = [
        html_plot(plot_validation(summaries, [column]), words, "plot narrow") for column in COLUMNS
    ]
    return "\n".join([wide, *narrow, paragraphs(words)])


def _comparison(by_dataset: Mapping[str, Mapping[Method, MethodSummary]]) -> Iterable[str]:
    if len(by_dataset) < 2:
        return []
    words = describe_comparison(by_dataset)
    return [html_figure("The data sets compared", plot_comparison(by_dataset), words)]


def _why_two_sets(calibration: Calibration | None) -> Iterable[str]:
    """The frame that shows it best, with the paper's two sets side by side."""
    if calibration is None:
        return []
    frame = telling_frame(calibration)
    views = views_of(calibration, frame)
    columns = []
    for method in PAPERS:
        images = [
            html_plot(
                plot_image(views, method, camera), describe_image(views, method, camera), "plot"
            )
            for camera in range(len(CAMERAS))
        ]
        gap = html_plot(plot_gap(views, method), describe_gap(views, method), "plot")
        head = f"<h3>{METHOD_NAMES[method]}: primary and secondary image, and the rays</h3>"
        words = paragraphs(describe_gap(views, method))
        columns.append(f"<div>{head}{''.join(images)}{gap}{words}</div>")
    said = paragraphs(f"Frame {frame}. {describe_two_sets(views)}")
    return [html_section("Why two sets", f'{said}<div class="sets">{"".join(columns)}</div>')]


def _angles(summaries: Mapping[Method, MethodSummary], datasets: Sequence[Dataset]) -> str:
    columns: dict[str, list[str]] = {}
    for method in (method for method in ALL_METHODS if method in summaries):
        means, spreads = summaries[method].angle_means, summaries[method].angle_spreads
        columns[METHOD_NAMES[method]] = [
            f"{math.degrees(mean):.4f} ± {math.degrees(spread):.4f}"
            for mean, spread in zip(means.ravel(), spreads.ravel(), strict=True)
        ]
    titles = [ANGLE_TITLES[name].removesuffix(" (degrees)") for name in Angles._fields]
    rows = [
        f"{dataset.name}: {title}" if len(datasets) > 1 else title
        for dataset in datasets
        for title in titles
    ]
    return html_table(pd.DataFrame(columns, index=pd.Index(rows, name="Angle")))


def _settings(
    settings: EvaluationSettings, summaries: Mapping[Method, MethodSummary]
) -> pd.DataFrame:
    lines = {
        SETTING_NAMES.get(name, name): _setting(value) for name, value in settings.to_json().items()
    }
    edges = next(iter(summaries.values())).residual.correct.edges
    lines["Width of the bins (decades)"] = f"{rounded(edges[1] - edges[0], 3)}"
    return pd.DataFrame({"Value": lines}).rename_axis("Setting")


def _setting(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_setting(inner)}" for key, inner in value.items())
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return listed(value) if value else "none"
    return "none" if value is None else str(value)


def _software() -> str:
    versions = {
        "stereocal": __version__,
        "Python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "numba": numba.__version__,
        "opencv": cv2.__version__,
        "plotly": plotly.__version__,
    }
    written = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")
    table = html_table(pd.DataFrame({"Version": versions}).rename_axis("Program"))
    return f"{table}\n{paragraphs(f'Written on {written}.')}"
