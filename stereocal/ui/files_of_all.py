"""Files of three cameras and more on the Data page: what is asked about them, the recording that
they make together, and the press that uses it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import streamlit as st

from stereocal.fit.timing.to_calibrate import in_step, pair_to_calibrate
from stereocal.formats.archives.all_cameras import Gathered, cameras_in, gather_all, targets_in
from stereocal.formats.archives.gather import is_table
from stereocal.formats.exchange.options import ExchangeOptions, Frames
from stereocal.frames.pairing import natural
from stereocal.projects.application import ProjectApplication
from stereocal.projects.given import ProjectGiven
from stereocal.projects.project import Project
from stereocal.rig.camera import Camera
from stereocal.system.latest import once_or_refused
from stereocal.ui import jobs
from stereocal.ui.fields import Field, Number, one_of, setting
from stereocal.ui.in_step import ask_if_in_step
from stereocal.ui.intake import give_pair
from stereocal.ui.menu import PRESS_FIRST
from stereocal.ui.messages import button, readable, show_with_button
from stereocal.ui.navigation import go_to
from stereocal.ui.press import press
from stereocal.ui.texts import escape_markdown
from stereocal.ui.wizard import USE_POINTS, Questions


@dataclass(frozen=True)
class FilesOfAll:
    """The files of three cameras and more, with the answers about them."""

    project: Project
    contents: Mapping[str, bytes]
    """The files by name; empty where only the recording that they made is there."""
    options: ExchangeOptions

    @cached_property
    def tables(self) -> dict[str, bytes]:
        return {name: content for name, content in self.contents.items() if is_table(name, content)}

    @property
    def of_cameras(self) -> dict[str, bytes]:
        return {name: content for name, content in self.contents.items() if name not in self.tables}

    @cached_property
    def cameras(self) -> dict[str, Camera]:
        """The cameras by name; none while their files cannot be read."""
        return readable(lambda: cameras_in(self.of_cameras, self.options), warn=False) or {}

    @property
    def targets(self) -> list[str]:
        """The targets of the table, whose places along the bar are to be stated from the first.

        Raises:
            StereocalError: it has too many.
        """
        return sorted({t for name, table in self.tables.items() for t in targets_in(table, name)})

    def place(self, target: str) -> Field:
        """The place of a target along the bar, in metres."""
        return setting(self.project, f"several_{target}_m", None, Number(0.0, or_none=True))

    @cached_property
    def gathered(self) -> Gathered:
        """The recording.

        Raises:
            StereocalError: the files make none yet.
        """
        if not self.contents and (recording := self.project.recording_as_given) is not None:
            return Gathered(recording, (), ())
        name = self.project.inputs.name or "Rig"
        stated = {target: self.place(target).value() for target in self.targets[1:]}
        places = {target: metres for target, metres in stated.items() if metres}
        digests = [(part, file.sha256) for part, file in ProjectGiven(self.project).parts.items()]
        return once_or_refused(
            "files of all cameras",
            repr((digests, self.options, places, name)),
            lambda: gather_all(self.contents, self.options, name, places),
        )


def ask_about_files(project: Project | None) -> FilesOfAll | None:
    """The files of three cameras and more, and the questions about them; None of two cameras."""
    if project is None or not (store := ProjectGiven(project)).of_more_than_two:
        return None
    parts = store.parts
    contents = {name: parts[name].read_bytes() for name in sorted(parts, key=natural)}
    if not contents:
        return FilesOfAll(project, contents, ExchangeOptions())
    with st.container(horizontal=True):
        for name in contents:
            label, key, drop = escape_markdown(name), f"drop_{name}", store.drop_part
            button(label, key, drop, name, icon="close", help="Remove this file.")
    for name in store.replaced:
        words, key, undo = f"{name} was replaced.", f"undo_{name}", store.undo_part
        show_with_button("info", words, "Undo", key, undo, name, icon="undo")
    questions = Questions(project, "several_{}")
    with st.expander("Correct or complete what the files say"):
        left, right = st.columns(2)
        lens_model, corner = questions.ask(left, "lens_model"), questions.ask(right, "corner")
        frames = _of_tables(project).ask(st.container(), "frames")
    options = ExchangeOptions(lens_model=lens_model, corner=corner, frames=frames)
    files = FilesOfAll(project, contents, options)
    if len(files.of_cameras) == 1:
        (name,) = files.of_cameras
        button("Use only two of these cameras", "several_two", _use_two, store, name)
    return files


def _of_tables(project: Project) -> Questions:
    """Questions that are asked anew of other tables."""
    parts = ProjectGiven(project).parts.items()
    tables = [file.sha256[:12] for name, file in parts if is_table(name, file.read_bytes())]
    return Questions(project, "several_{}", " ".join(tables))


def _use_two(store: ProjectGiven, name: str) -> None:
    """Ask which two cameras of a file of all to use, and of the table."""
    application = ProjectApplication(store.project)
    for part, file in store.parts.items():
        application.ask("archive" if part == name else "bars", part, file.read_bytes())
        store.drop_part(part)


def offer_to_use(files: FilesOfAll) -> None:
    """The press that goes on with what was read."""
    if not files.contents:
        return
    gathered, answers = files.gathered, dict[str, Frames]({"": files.options.frames or "common"})
    title = "Calibrate all" if len(gathered.recording.cameras) > 2 else USE_POINTS
    # Of what is in use already, the next thing to do is on the page Calibrate.
    is_used = files.project.is_given(gathered.files)
    if gathered.is_long and files.options.frames is None and not is_used:
        answers = ask_if_in_step(gathered.recording, gathered.recording.own_frames)
    st.session_state[PRESS_FIRST] = not is_used
    with st.container(horizontal=True):
        for number, (words, frames) in enumerate(answers.items()):
            key, first = f"several_run{f'_{number}' * bool(number)}", not (is_used or number)
            button(words or title, key, _use, files, frames if words else None, first=first)


def _use(files: FilesOfAll, frames: Frames | None) -> None:
    """Store the recording and go on with it: calibrate a rig, or open a pair.

    Args:
        frames: how they are counted, if that is answered now.
    """
    project = files.project
    if frames is not None:
        _of_tables(project).field("frames", None, one_of((None, "common", "own"))).set(frames)
        files = replace(files, options=replace(files.options, frames=frames))
    gathered = files.gathered
    recording = gathered.recording
    if len(recording.cameras) == 2:
        give_pair(project, pair_to_calibrate(project.inputs.applied_to(recording)))
        for name in files.contents:
            ProjectGiven(project).drop_part(name)
        return
    project.give_recording(in_step(recording), gathered.files, same_lengths=True)
    jobs.drop_pairs(project)
    press(project)
    go_to("calibrate")
