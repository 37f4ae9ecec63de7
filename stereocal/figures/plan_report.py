"""The report of a plan: one HTML file that holds everything and opens without a network."""

from __future__ import annotations

from html import escape

import numpy as np
import pandas as pd

from stereocal.field.planning.forecast import PlanForecast
from stereocal.field.planning.in_words import answer
from stereocal.field.planning.plan import AimedPose, Plan
from stereocal.figures.forecast_table import plan_table
from stereocal.figures.html import html_figure, html_page, html_section, html_table, paragraphs
from stereocal.figures.plan_errors import (
    describe_plan_baselines,
    describe_plan_depths,
    describe_plan_map,
    plot_plan_baselines,
    plot_plan_depths,
    plot_plan_map,
)
from stereocal.system.numbers import rounded
from stereocal.verdict.in_words import digits, percent
from stereocal.version import __version__


def plan_report(found: PlanForecast) -> str:
    """The text of the file."""
    plan = found.plan
    title = f"Forecast of the plan {plan.name}"
    advice = "".join(f"<li>{escape(text)}</li>" for text in found.advice.sentences)
    sections = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="answer">{escape(answer(found))}</p>',
        html_section("What would help most", f"<ul>{advice}</ul>"),
        html_figure("Errors by place", plot_plan_map(found), describe_plan_map(found)),
        html_figure("Errors by depth", plot_plan_depths([found]), describe_plan_depths([found])),
        html_figure(
            "Errors by baseline", plot_plan_baselines(found), describe_plan_baselines(found)
        ),
        html_section("What the files will do", html_table(plan_table(found))),
        html_section("How it was computed", paragraphs(how_computed(found))),
        html_section("The plan", html_table(contents_of_plan(plan))),
    ]
    return html_page(title, sections)


def how_computed(found: PlanForecast) -> str:
    """What was drawn and simulated, in words."""
    own, rigs = found.plan.uncertainty, found.rigs.count
    failed = f" {found.failed} of them could not be calibrated." if found.failed else ""
    return (
        f"{rigs} rigs were drawn, whose focal lengths, principal points, baseline and bar differ "
        f"from the plan as it says; on each a recording of {found.plan.frames} bars was simulated "
        f"and calibrated, and the files were judged on fresh bars.{failed} Intervals hold 95 % of "
        "the rigs. Errors by place are those to be expected of the refined set. Length errors are "
        "relative to true lengths, so the error of the bar itself, "
        f"{percent(own.bar_m / found.plan.bar_m)} %, is in them. Computed by "
        f"stereocal {__version__} with the seed {found.seed}."
    )


def contents_of_plan(plan: Plan) -> pd.DataFrame:
    """The plan as a table."""
    own, pose = plan.uncertainty, plan.stated_pose
    lines = {
        "Primary camera": _lens(plan, 0),
        "Secondary camera": _lens(plan, 1),
        "Baseline": f"{rounded(plan.baseline_m, 4)} m ± {rounded(1000 * own.baseline_m, 3)} mm",
        "Volume": f"{rounded(plan.near_m, 4)} to {rounded(plan.far_m, 4)} m ahead of the primary "
        "camera",
        "Bar": f"{rounded(plan.bar_m, 4)} m ± {rounded(1000 * own.bar_m, 3)} mm",
        "Frames": str(plan.frames),
        "Noise of a target in the image": f"{digits(plan.noise_px, 2)} px",
        "Focal lengths known to": f"{percent(own.focal)} %",
        "Image centres known to": f"{rounded(own.centre_px, 3)} px",
    }
    if isinstance(pose, AimedPose):
        lines["Each camera turned in by"] = f"{rounded(pose.toe_in_deg, 3)}°"
        lines["Secondary higher by"] = f"{rounded(pose.height_difference_m, 3)} m"
    else:
        angle = np.degrees(np.arccos(np.clip((np.trace(plan.pose.R) - 1) / 2, -1, 1)))
        lines["Angle between the cameras"] = f"{rounded(angle, 3)}°"
    return pd.DataFrame({"Value": lines}).rename_axis("Planned")


def _lens(plan: Plan, number: int) -> str:
    camera = (plan.primary, plan.secondary)[number]
    width, height = camera.image_size
    return f"{width} x {height} px, focal length {rounded(camera.K[0, 0], 4)} px"
