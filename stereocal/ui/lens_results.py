"""Results of the Lenses page: answer, table, figures, downloads, and use of the lens."""

from __future__ import annotations

from functools import partial

import streamlit as st

from stereocal.figures import lens as figures
from stereocal.figures.style import count
from stereocal.formats.camera_file import write_camera, write_opencv_camera
from stereocal.intrinsics import quality
from stereocal.intrinsics.calibrate_lens import LensCalibration, digest_of
from stereocal.intrinsics.files import about
from stereocal.projects.lens import ProjectLens
from stereocal.ui.downloads import offer
from stereocal.ui.fields import choose
from stereocal.ui.figure import show_figure
from stereocal.ui.messages import ErrorsShown, readable
from stereocal.ui.refusal import refusing
from stereocal.ui.texts import escape_markdown


@st.cache_data(show_spinner=False, max_entries=8)
def _note_on_model(digest: str, _lens: LensCalibration) -> str:  # noqa: ARG001 - the key
    return quality.note_on_model(_lens.search, _lens.settings)


def show_lens(store: ProjectLens) -> None:
    """The last finished lens of a camera."""
    # Reported above, where it can be calibrated again.
    lens = readable(lambda: store.calibration, told=False)
    search = readable(lambda: store.search, told=False)
    if search is not None and search.refused:
        with st.expander(f"{count(len(search.refused), 'photograph')} without a usable board"):
            for item in search.refused:
                st.markdown(f"- {escape_markdown(item.name)}: {escape_markdown(item.reason)}.")
    if lens is None:
        return
    st.header(f"The {store.which} camera's lens", divider="gray")
    for sentence in quality.advice(lens):
        st.warning(escape_markdown(sentence))
    st.success(escape_markdown(quality.lens_answer(lens)))
    st.caption(escape_markdown(_note_on_model(digest_of(lens.search, lens.settings), lens)))
    if text := quality.hint(lens):
        st.caption(text)
    _use_and_downloads(store, lens)
    results, without = f"The {lens.settings.repeats} results", "Without distortion"
    views = {
        results: (figures.plot_draws, figures.describe_draws, "draws"),
        "Photograph by photograph": (
            figures.plot_view_errors,
            figures.describe_view_errors,
            "view_errors",
        ),
        "What the lens leaves": (
            figures.plot_residual_field,
            figures.describe_residual_field,
            "residual_field",
        ),
    }
    view = choose(store.project, "lens_view", "Look at", [*views, without])
    if view == without:
        _show_preview(store, lens)
    else:
        plot, describe, key = views[view]
        show_figure(plot(lens), describe(lens), key)
    st.table(quality.lens_table(lens))
    st.caption(
        "The median of the draws is the result. Its standard error comes from how much the results "
        "differ (delete-d jackknife); errors that all photographs share, such as a bent board, are "
        "not in it. The last column is one calibration with all photographs."
    )


def _use_and_downloads(store: ProjectLens, lens: LensCalibration) -> None:
    use, ours, opencv = st.columns(3)
    used = store.is_used
    use.button(
        "In use for this project" if used else "Use for this project",
        type="primary",
        disabled=used,
        on_click=partial(_use, store),
        key=f"use_lens_{store.which}",
        icon=":material/check:" if used else None,
    )
    offer(
        "Download camera.json",
        write_camera(lens.camera, about(lens)),
        f"{store.which}.json",
        f"lens_json_{store.which}",
        place=ours,
        help="With the standard errors.",
    )
    offer(
        "Download OpenCV YAML",
        write_opencv_camera(lens.camera),
        f"{store.which}.yml",
        f"lens_yaml_{store.which}",
        place=opencv,
        help="Without the standard errors.",
    )


def _use(store: ProjectLens) -> None:
    with refusing():
        store.use()


def _show_preview(store: ProjectLens, lens: LensCalibration) -> None:
    photographs = store.photographs
    names = [view.name for view in lens.search.views if view.name in photographs]
    if not names:
        st.info("The photographs of this lens have been removed.")
        return
    name = choose(store.project, f"preview_{store.which}", "Photograph", names, as_menu=True)
    view = next(view for view in lens.search.views if view.name == name)
    with ErrorsShown():
        marked, straight = quality.preview(photographs[name], lens.camera, view)
        left, right = st.columns(2)
        caption = "As photographed, with the corners that were found"
        left.image(marked, caption=caption, width="stretch")
        shift = quality.largest_shift_px(lens.camera)
        caption = f"Without the lens's distortion, which moves points by up to {shift:.1f} px"
        right.image(straight, caption=caption, width="stretch")
