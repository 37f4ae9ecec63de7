"""Figure and table of the disagreement of each stated input with the other data."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from stereocal.figures import style
from stereocal.fit.errors.disagreement import ACCUSED
from stereocal.fit.errors.stated_inputs import Input, in_digits
from stereocal.system.numbers import rounded
from stereocal.verdict.in_words import digits

ROW, FRAME = 44, 100


def plot_disagreement(inputs: Sequence[Input]) -> go.Figure:
    """The test value of each input in standard errors, with the threshold of disagreement."""
    shown = list(reversed(inputs))
    figure = style.blank(FRAME + ROW * max(len(shown), 1))
    values = np.array([item.standard_errors for item in shown])
    figure.add_bar(
        y=[item.title for item in shown],
        x=values,
        orientation="h",
        showlegend=False,
        marker={
            "color": [style.WRONG_COLOUR if item.accused else style.FAINT for item in shown],
            "line": {"color": style.NEUTRAL, "width": 1},
            # A pattern too, for readers who cannot distinguish the colours.
            "pattern": {"shape": ["/" if item.accused else "" for item in shown]},
        },
        text=["none" if np.isnan(v) else digits(v, 2) for v in values],
        textposition="outside",
        customdata=[_words(item) for item in shown],
        cliponaxis=False,
        hovertemplate="%{customdata}<extra></extra>",
    )
    figure.add_vline(x=ACCUSED, line=style.DASHED)
    most = float(np.nanmax(np.append(values, ACCUSED)))
    title = f"Disagreement (standard errors)<br>Dashed: threshold {ACCUSED:g}"
    figure.update_xaxes(title_text=title, range=[0, 1.2 * most])
    return figure


def disagreement_table(inputs: Sequence[Input]) -> pd.DataFrame:
    """What was stated of each input, and what comes out with images and lengths."""
    rows = {}
    for item in inputs:
        sigma, test_value = item.sigma, item.standard_errors
        stated, estimated = ", ".join(f"{value:g}" for value in item.stated), "held as stated"
        if sigma.all():
            stated = in_digits(item.stated, sigma)
            estimate = f"{in_digits(item.estimate, sigma)} ± {in_digits(sigma, sigma)}"
            estimated = f"{estimate} {item.unit}".rstrip()
        rows[item.title] = {
            "Stated": f"{stated} {item.unit}".rstrip(),
            "Estimated": estimated,
            "Disagreement (standard errors)": (
                "no information" if np.isnan(test_value) else digits(test_value, 2)
            ),
        }
    return pd.DataFrame(rows).T.rename_axis("Input")


def describe_disagreement(inputs: Sequence[Input]) -> str:
    """The figure in words."""
    parts = [_words(item) for item in inputs]
    return f"Disagreement of each input with images and lengths: {'; '.join(parts)}."


def _words(item: Input) -> str:
    if np.isnan(item.standard_errors):
        return f"{item.title}: the images have no information about it"
    disagreement = f"{digits(item.standard_errors, 2)} standard errors"
    if not item.prior_sigma.any() and not item.accused:
        return f"{item.title}: held as stated, {disagreement}"
    stated, estimate = (
        f"{' and '.join(rounded(value, 6) for value in np.atleast_1d(values))} {item.unit}".rstrip()
        for values in (item.stated, item.estimate)
    )
    return f"{item.title}: stated {stated}, estimated {estimate}, {disagreement}"
