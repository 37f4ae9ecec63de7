"""One set or two: does this rig need two sets, and which input disagrees?"""

from stereocal.ui.menu import ensure_navigation

ensure_navigation()


from dataclasses import replace

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.ui import one_set as page
from stereocal.ui.fields import choose
from stereocal.ui.forms import form_values, staleness
from stereocal.ui.messages import end_here, readable
from stereocal.ui.prerequisites import project_with_data
from stereocal.ui.refined import (
    answer_for,
    answer_when_ready,
    calibrated,
    refine_form,
    refined_of,
    wait_for_answer,
)
from stereocal.ui.screening import is_long, screenings_of
from stereocal.ui.texts import ONE_SET, escape_markdown
from stereocal.ui.validation import kept_protocol

st.title("One set or two")
st.subheader("Does this rig need two sets, or does one set do both jobs?")

project, _, dataset = project_with_data()
try:
    with st.expander("What the refined set is, and what it may change"):
        st.markdown(ONE_SET)
        settings = refine_form(project, dataset)
    protocol = kept_protocol(project, [dataset])
    calibration = readable(lambda: project.calibration)
    current = calibration
    stale = calibration and staleness(calibration, dataset, form_values(project, dataset))
    if stale:
        st.warning(f"{stale} This page already shows what the data and the form now give.")
        current = None
    answer = None if current is None else answer_when_ready(project, current)
    calibrated_now = answer is not None
    if answer is None and (current is not None or is_long(dataset)):
        if current is None:
            st.info("For a recording this long, press Calibrate first.")
            st.page_link("pages/calibrate.py", label="Calibrate")
        wait_for_answer(project)
        end_here()
    (screening,) = screenings_of([dataset], protocol.calibration, current)
    kept = screening.dataset
    result = answer.calibration.refined if answer else None
    if result is None or (current is not None and len(current.held_out_frames)):
        result = refined_of(kept, settings)
    if answer is None:
        found = replace(calibrated(dataset, protocol.calibration), refined=result)
        answer = answer_for(found, settings, None)
    inputs = answer.inputs
except StereocalError as error:
    st.error(escape_markdown(str(error)))
    end_here()
page.show_verdict(answer)
place = st.container()
page.show_download(project, answer, calibrated_now)
st.header("What disagrees", divider="gray")
page.show_disagreement(inputs)
page.show_frames_left_out(screening, result)
views = {
    "Matching against measuring": lambda: page.show_trade_off(
        project, kept, result, settings, calibration
    ),
    "How accurate, where": lambda: page.show_accuracy(project, result, kept, settings),
    "Residuals by place": lambda: page.show_misfit(kept, settings),
    "The refined set": lambda: page.show_parameters(result),
}
views[choose(project, "one_set_view", "Look at", views)]()
with place:  # last, because the trials take the processor from the rest of the page
    page.show_seeds(answer)
