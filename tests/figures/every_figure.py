"""Every figure of `stereocal.figures` on data with a known truth, with the sentence beneath it."""

import importlib
import pkgutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go

from stereocal import figures
from stereocal.calibration.methods import CalibrationSettings
from stereocal.evaluation.evaluate import EvaluationSettings, evaluate
from stereocal.evaluation.summary import summarise_all
from stereocal.field.checking.repair import FrameErrors, Residuals
from stereocal.field.planning.forecast import forecast
from stereocal.field.planning.through_window import WindowForecast
from stereocal.figures.story import read_story
from stereocal.figures.two_sets import frame_views, telling_frame
from stereocal.fit.errors.disagreement import compare_inputs
from stereocal.fit.errors.misfit import misfit_of
from stereocal.fit.errors.uncertainty import accuracy_map
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.refine import refine
from stereocal.fit.refined_result import RefinedResult
from stereocal.fit.timing.offset_of_pair import offset_of_pair
from stereocal.formats.dataset_files import read_dataset, read_recording
from stereocal.intrinsics.calibrate_lens import calibrate_lens
from stereocal.intrinsics.lens_fit import LensSettings
from stereocal.library.calibrations import calibrate
from stereocal.matching.lengths import check_lengths
from tests.field.plans import plan
from tests.field.test_plan_through_window import TANK
from tests.figures import test_apply_figures as applied
from tests.photographs.lens import search
from tests.rigs.known_rig import BAR_M
from tests.sample_field import FIELD

OF_RIGS = {"plot_cameras", "plot_rig_graph"}
"""Drawn from a rig file, into the report of `stereocal rig`."""
DRAWS = {
    name: function
    for module in pkgutil.iter_modules(figures.__path__, "stereocal.figures.")
    for name, function in vars(importlib.import_module(module.name)).items()
    if name.startswith(("plot_", "describe_")) and name not in OF_RIGS
}
PLOTS = sorted(name.removeprefix("plot_") for name in DRAWS if name.startswith("plot_"))
ROOT = Path(__file__).parents[2]
STORY = ROOT / "assets" / "story.json"

RESIDUALS = Residuals(
    np.arange(1, 6),
    FrameErrors(np.linspace(0.8, 1.4, 5), np.linspace(0.01, 0.04, 5)),
    FrameErrors(np.linspace(0.1, 0.2, 5), np.linspace(0.001, 0.005, 5)),
    changed=True,
)


@dataclass(frozen=True)
class Drawn:
    """A figure and its sentence."""

    figure: go.Figure
    words: str


@cache
def refined_field() -> RefinedResult:
    """The refined set of the sample."""
    return refine(read_dataset(FIELD))


@cache
def every_figure() -> dict[str, Drawn]:
    """By the name of the function without `plot_`; of `points` both meanings of its colour."""
    dataset, refined = read_dataset(FIELD), refined_field()
    calibration = calibrate(dataset, trace=True)
    inputs, misfit = compare_inputs(refined).inputs, misfit_of(refined)
    places = [accuracy_map(refined), accuracy_map(refined, plane="side")]
    settings = EvaluationSettings(CalibrationSettings(), 3, 20, refined=RefineSettings())
    with ThreadPoolExecutor(2) as executor:
        runs = 2 * evaluate([dataset], settings, executor)
        lens = calibrate_lens(search(12, 1), LensSettings(subset=8, repeats=12), executor)
    pooled, by_dataset = summarise_all(["one", "two"], runs)
    check = check_lengths(applied.POINTS, 1.01 * BAR_M, "end_primary", ("A", "B"))
    tables = [
        table[table["frame"] == 1] for table in (applied.PRIMARY_TABLE, applied.SECONDARY_TABLE)
    ]
    left, right = (table[["u", "v"]].to_numpy() for table in tables)
    pairs = applied.PAIRS[applied.PAIRS["frame"] == 1]
    story = read_story(STORY)
    views = frame_views(replace(calibration, refined=refined), telling_frame(calibration))
    plans = [
        forecast(plan(name=name, bar_m=bar), rigs=8)
        for name, bar in (("one", 0.9), ("another", 0.6), ("third", 0.4))
    ]
    rig = read_recording(ROOT / "sample_data" / "rig")
    rig = rig.where(rig.frame < 100)
    # What a figure is drawn of, and its text, where that takes something else.
    given: dict[str, tuple[tuple[Any, ...], ...]] = {
        "accuracy": ((places, refined), (places,)),
        "check": ((RESIDUALS,),),
        "comparison": ((by_dataset,),),
        "coverage": ((dataset,),),
        "disagreement": ((inputs,),),
        "draws": ((lens,),),
        "gap": ((views, "3d"),),
        "image": ((views, "3d", 1),),
        "frame_errors": ((calibration,),),
        "lengths": ((check,),),
        "matches": (
            (pairs, left, "primary", applied.SET.primary.image_size),
            (pairs, {"primary": left, "secondary": right}, 1),
        ),
        "misfit": ((misfit,),),
        "offsets": ((offset_of_pair(rig, ("1", "2")),),),
        "pair_errors": (
            (applied.NEAREST, 0.8),
            (applied.NEAREST, applied.FRAMES, 0.8, applied.CHOICE),
        ),
        "plan_baselines": ((plans[0],),),
        "plan_depths": ((plans,),),
        "plan_map": ((plans[0],),),
        "points": ((applied.POINTS, "frame", applied.SET), (applied.POINTS,)),
        "residual_field": ((lens,),),
        "rig": ((calibration, "3d"),),
        "story_lengths": ((story,),),
        "story_lines": ((story,),),
        "traces": ((calibration,),),
        "two_rays": ((story,),),
        "validation": ((pooled,),),
        "view_errors": ((lens,),),
        "window_plan": ((WindowForecast(TANK, np.array([0.01]), seed=0),),),
    }
    return {
        name: Drawn(DRAWS[f"plot_{name}"](*own[0]), DRAWS[f"describe_{name}"](*own[-1]))
        for name, own in given.items()
    }
