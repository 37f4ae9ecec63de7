"""Plotly figures of all results (`plot_*`), and their descriptions in words (`describe_*`).

Backgrounds are transparent and texts have no colour, so that the page's light or dark theme
applies.
"""

from stereocal.figures.accuracy import describe_accuracy, plot_accuracy
from stereocal.figures.check_residuals import describe_check, plot_check
from stereocal.figures.comparison import describe_comparison, plot_comparison
from stereocal.figures.coverage import describe_coverage, plot_coverage
from stereocal.figures.disagreement import describe_disagreement, plot_disagreement
from stereocal.figures.frame_errors import plot_frame_errors
from stereocal.figures.frame_panels import describe_frame_errors
from stereocal.figures.lens import (
    describe_draws,
    describe_view_errors,
    plot_draws,
    plot_view_errors,
)
from stereocal.figures.matches import describe_matches, plot_matches
from stereocal.figures.measured import (
    describe_lengths,
    describe_points,
    plot_lengths,
    plot_points,
)
from stereocal.figures.pair_errors import describe_pair_errors, plot_pair_errors
from stereocal.figures.plan_errors import (
    describe_plan_baselines,
    describe_plan_depths,
    describe_plan_map,
    plot_plan_baselines,
    plot_plan_depths,
    plot_plan_map,
)
from stereocal.figures.residual_field import (
    describe_misfit,
    describe_residual_field,
    plot_misfit,
    plot_residual_field,
)
from stereocal.figures.rig import describe_rig, plot_rig
from stereocal.figures.story import (
    describe_story_lengths,
    describe_story_lines,
    describe_two_rays,
    plot_story_lengths,
    plot_story_lines,
    plot_two_rays,
)
from stereocal.figures.style import (
    METHOD_COLOURS,
    METHOD_NAMES,
    METHOD_SYMBOLS,
    TARGET_COLOURS,
    TARGET_SYMBOLS,
)
from stereocal.figures.traces import describe_traces, plot_traces
from stereocal.figures.tradeoff import describe_trade_off, plot_trade_off
from stereocal.figures.two_sets import (
    describe_gap,
    describe_image,
    describe_two_sets,
    plot_gap,
    plot_image,
)
from stereocal.figures.validation import plot_validation
from stereocal.figures.validation_panels import describe_validation

__all__ = [
    "METHOD_COLOURS",
    "METHOD_NAMES",
    "METHOD_SYMBOLS",
    "TARGET_COLOURS",
    "TARGET_SYMBOLS",
    "describe_accuracy",
    "describe_check",
    "describe_comparison",
    "describe_coverage",
    "describe_disagreement",
    "describe_draws",
    "describe_frame_errors",
    "describe_gap",
    "describe_image",
    "describe_lengths",
    "describe_matches",
    "describe_misfit",
    "describe_pair_errors",
    "describe_plan_baselines",
    "describe_plan_depths",
    "describe_plan_map",
    "describe_points",
    "describe_residual_field",
    "describe_rig",
    "describe_story_lengths",
    "describe_story_lines",
    "describe_traces",
    "describe_trade_off",
    "describe_two_rays",
    "describe_two_sets",
    "describe_validation",
    "describe_view_errors",
    "plot_accuracy",
    "plot_check",
    "plot_comparison",
    "plot_coverage",
    "plot_disagreement",
    "plot_draws",
    "plot_frame_errors",
    "plot_gap",
    "plot_image",
    "plot_lengths",
    "plot_matches",
    "plot_misfit",
    "plot_pair_errors",
    "plot_plan_baselines",
    "plot_plan_depths",
    "plot_plan_map",
    "plot_points",
    "plot_residual_field",
    "plot_rig",
    "plot_story_lengths",
    "plot_story_lines",
    "plot_traces",
    "plot_trade_off",
    "plot_two_rays",
    "plot_validation",
    "plot_view_errors",
]
