"""The field for the noise of the user's points: on Apply, in its world frame, and on Check."""

from __future__ import annotations

import streamlit as st

from stereocal.matching.point_noise import PointNoise
from stereocal.projects.project import Project
from stereocal.system.numbers import rounded
from stereocal.ui.fields import Field, number, setting

SOURCES = {
    "estimated": "estimated",
    "stated": "as stated",
    "columns": "by their columns",
    "calibration": "as the targets",
}


def noise_field(project: Project, key: str) -> Field:
    """The noise as stated (px); None where the points decide."""
    return setting(project, key, None, number(0.001, or_none=True))


def ask_noise(field: Field, usual: PointNoise | str, otherwise: str) -> float | None:
    """Draw the field; returns its value.

    Args:
        usual: what is taken where the field is empty, or words for it.
        otherwise: how that is found.
    """
    if not isinstance(usual, str):
        usual = f"{rounded(usual.sigma_px)}, {SOURCES[usual.source]}"
    st.number_input(
        "My points are known to (px)",
        min_value=0.001,
        value=None,
        step=0.1,
        format="%.4g",
        placeholder=usual,
        help=f"One standard deviation of an image coordinate of your points. Empty: {otherwise}.",
        **field.widget(),
    )
    value: float | None = field.value()
    return value
