"""The form of the refined method."""

from typing import Any

import streamlit as st

from stereocal.projects.project import Project
from stereocal.projects.recording import REFINED
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.camera import CAMERAS, CameraName
from stereocal.rig.dataset import Dataset
from stereocal.ui.fields import Field, Number, setting
from stereocal.ui.forms import search_values
from stereocal.ui.lengths import describe_uncertainties
from stereocal.ui.texts import REFINED_SET, escape_markdown


def refine_form(project: Project, dataset: Dataset) -> None:
    """The form of the refined method: uncertainties from the Data page, and the image noise."""
    st.markdown("**The refined set**")
    if project.settings.get(REFINED) is not None:
        st.caption("The refined set is the rig's: its lenses, lengths and noise are set there.")
        return
    st.caption(REFINED_SET)
    st.caption(escape_markdown(describe_uncertainties(dataset)))
    st.page_link("pages/data.py", label="State it on the Data page")
    noise, free = _fields(project)
    title, none = "Estimate the distortion of", "no camera: as its file says"
    told = "k1, k2, p1 and p2, from the images of the bar. Needs bars out to the image borders."
    st.multiselect(title, CAMERAS, placeholder=none, help=told, **free.widget())
    noise.number_input("Noise of an image point, px", help="0: found from the images.")


def refine_settings(project: Project, dataset: Dataset) -> RefineSettings:
    """The settings of the refined method, also for pages that do not show the form.

    They hold the uncertainties of the lengths, which a data set's digest does not cover. Those of a
    pair of a rig hold what the rig says.
    """
    of_rig = project.settings.get(REFINED)
    if of_rig is not None:
        return RefineSettings.from_json(of_rig)
    search, (noise, free) = search_values(project), _fields(project)
    return RefineSettings(
        baseline_sigma_m=dataset.baseline_sigma_m,
        distance_sigma_m=dataset.target_distance_sigma_m,
        sigma_px=noise.value() or None,
        free_distortion=tuple(free.value()),
        time_offset=search["time_offset"],
        time_drift=search["time_drift"],
    )


def _fields(project: Project) -> tuple[Field, Field]:
    """The image noise, and the cameras whose distortion is free, in the order of `CAMERAS`."""
    noise = setting(project, "refine_sigma_px", 0.0, Number(0.0, 1e5))

    def in_order(value: Any) -> list[CameraName]:
        return [name for name in CAMERAS if name in value]

    return noise, setting(project, "free_distortion", [], in_order)
