"""`stereocal plan`: what a planned field day will measure, and how well."""

import argparse
from functools import partial

from stereocal.commands.console import Number, Options, with_bar
from stereocal.commands.options import WORKERS, finish, questions, refuse_given, workers_from
from stereocal.field.planning.drawn_rigs import draw_rigs
from stereocal.field.planning.forecast import FEWEST_RIGS, MOST_RIGS, forecast, plan_answer
from stereocal.field.planning.plan import Plan
from stereocal.field.planning.through_window import FIELD_DAYS, field_day, forecast_through_window
from stereocal.figures.plan_report import plan_report, window_report
from stereocal.formats.plan_file import read_plan
from stereocal.system.numbers import SEEDS

OPTIONS: Options = {
    "plan": "plan.json",
    "--out OUT": "folder for the two files",
    "--seed N": {"type": Number(int, *SEEDS), "help": "default: 0"},
    "--rigs N": {
        "type": Number(int, FEWEST_RIGS // 4, MOST_RIGS),
        "help": "rigs drawn from the plan (default: 128, fewer for many frames)",
    },
    **questions("lens_model"),
    **WORKERS,
}
DEFAULTS = {"seed": 0}


def run(parsed: argparse.Namespace) -> None:
    """Compute the forecast, write forecast.json and report.html, print the answer."""
    plan = read_plan(parsed.plan, parsed.lens_model)
    if plan.window is not None:
        _run_through_window(plan, parsed)
        return
    with workers_from(parsed, partial(draw_rigs, plan, 0, 0, 2)) as executor:
        planned = with_bar("rigs", partial(forecast, plan, executor, parsed.seed, parsed.rigs))
    files = {"forecast.json": planned.dumps(), "report.html": plan_report(planned).encode()}
    lines = (f"  {sentence}" for sentence in planned.advice.sentences)
    finish(parsed.out, files, plan_answer(planned), *lines)


def _run_through_window(plan: Plan, parsed: argparse.Namespace) -> None:
    """The same behind a window, where fewer field days are simulated."""
    refuse_given(parsed, f"is for plans in air: {FIELD_DAYS} field days are simulated", "rigs")
    with workers_from(parsed, partial(field_day, plan, 0, 0)) as executor:
        found = partial(forecast_through_window, plan, executor, parsed.seed, FIELD_DAYS)
        planned = with_bar("field days", found)
    report = window_report(planned).encode()
    finish(parsed.out, {"forecast.json": planned.dumps(), "report.html": report}, planned.answer)
