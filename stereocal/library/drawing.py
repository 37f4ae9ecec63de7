"""Figures and tables of the dashboard, for which Plotly is imported when one is asked for."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from stereocal.errors import StereocalError

if TYPE_CHECKING:
    import plotly.graph_objects as go


def draw(name: str, *arguments: Any, **named: Any) -> go.Figure:
    """What a function of `stereocal.figures` draws, by its module and name.

    Raises:
        StereocalError: Plotly is not installed.
    """
    return of_figures(name, *arguments, **named)


def of_figures(name: str, *arguments: Any, **named: Any) -> Any:
    """What a function of `stereocal.figures` makes; raises as `draw`."""
    module, function = name.split(".")
    try:
        drawn = importlib.import_module(f"stereocal.figures.{module}")
    except ModuleNotFoundError as error:
        raise StereocalError(
            f"Figures need {error.name}, which is not installed: pip install 'stereocal[dashboard]'"
        ) from error
    return getattr(drawn, function)(*arguments, **named)
