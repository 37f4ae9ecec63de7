"""The Data page for cameras that were started by hand: how they were brought into step."""

import streamlit as st

from stereocal.figures.started_by_hand import describe_offsets, plot_offsets
from stereocal.network.started_by_hand import bring_into_step
from stereocal.projects.project import Project
from stereocal.projects.recording import ProjectRecording
from stereocal.rig.recording import Recording
from stereocal.ui.figure import show_figure
from stereocal.ui.messages import readable
from stereocal.ui.texts import escape_markdown


def show_in_step(project: Project) -> None:
    """What was found, and on demand the figure of each pair; nothing of cameras in step."""
    recording, starts, notes = _counted(project)
    if recording is None or not (notes or any(starts.values())):
        return
    with st.container(key="started_by_hand"):
        st.subheader("The cameras were started by hand")
        listed = notes or [f"{name} was started at frame {at}." for name, at in starts.items()]
        st.markdown("\n".join(f"- {escape_markdown(note)}" for note in listed))
        if not st.toggle("Show the error at each offset", key="show_offsets"):
            return
        with st.spinner("Trying all offsets ..."):
            found = readable(lambda: bring_into_step(recording))
        for pair, own in ({} if found is None else found.pairs).items():
            st.caption(escape_markdown(" and ".join(pair)))
            show_figure(plot_offsets(own), describe_offsets(own), f"offsets_{'_'.join(pair)}")


def _counted(project: Project) -> tuple[Recording | None, dict[str, int], list[str]]:
    """The recording as its cameras counted, which frame was 0 of each, and what was found."""
    recording = ProjectRecording(project).read() if project.pair is None else None
    if recording is None:
        dataset = readable(lambda: project.dataset, told=False)
        if dataset is None:
            return None, {}, []
        recording = Recording.of_pair(dataset)
        starts: dict[str, int] = {"primary": 0, "secondary": dataset.start_frame}
        notes = [*dataset.step_notes]
    else:
        starts, notes = dict(recording.start_frames), [*recording.step_notes]
    back = {name: -start for name, start in starts.items()}
    return recording.counted_from(back), starts, notes
