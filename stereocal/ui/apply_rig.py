"""The Apply page of a rig of three cameras and more: its points, its parameters, and the world."""

from itertools import cycle

import streamlit as st

from stereocal.matching.application import Application, Points, points_by_camera
from stereocal.matching.names import AUTO
from stereocal.matching.pairs import Stated
from stereocal.network.rig_file import RigFile
from stereocal.projects.application import Asked, ProjectApplication, slot_of
from stereocal.projects.project import Project
from stereocal.projects.recording import ProjectRecording
from stereocal.rig.recording import Recording
from stereocal.rig.rig import camera_in_words
from stereocal.ui.apply import Chosen, upload_points
from stereocal.ui.apply_threshold import ask_names, ask_noise, noise_field
from stereocal.ui.fields import Field, one_of, setting
from stereocal.ui.messages import callback, show_refusal
from stereocal.ui.texts import escape_markdown
from stereocal.ui.wizard import ask_about_points
from stereocal.ui.world import choose_world

OWN, FILES = "The object's own points", "A point file of each camera"
COLUMNS = 3
FEWEST = 2
"""Cameras whose points are needed."""


def applies_rig(project: Project) -> bool:
    """Whether the page is of a rig: the project's, or one given as a file."""
    if project.pair is not None:
        return False
    return ProjectRecording(project).is_given or ProjectApplication(project).rig_given is not None


def choose_inputs(project: Project, store: ProjectApplication) -> Chosen | None:
    """Uploaders of points, and the inputs; None if something is missing."""
    recording = ProjectRecording(project)
    rig, label = recording.rig, "the rig of this project"
    if not recording.is_given and (given := store.rig_given) is not None:
        label, rig = given
        with st.container(horizontal=True, vertical_alignment="center"):
            st.caption(f"In use: {escape_markdown(label)}, a rig of {len(rig.names)} cameras")
            st.button("Use other parameters", key="forget_rig", on_click=callback(store.forget_rig))
    if rig is None:
        st.info("The cameras are not calibrated yet.")
        st.page_link("pages/rig.py", label="Calibrate all on the page Rig")
        return None
    found = recording.read() if recording.is_given else None
    kind = _points_kind(store, rig, has_own=found is not None)
    _take_points(store, rig, kind)
    points_at, noise_at, rig_at = st.columns([2, 1, 1])
    with points_at:
        points = _choose_points(store, rig, found, kind)
        names = ask_names(store, list(points.values())) if points else AUTO
    with noise_at:
        otherwise = "estimated from their epipolar errors, else as exact as the targets"
        sigma_px = ask_noise(noise_field(project, "apply_sigma_px"), "by the points", otherwise)
    rig_at.caption(f"Match and measure with  \nIn use: {escape_markdown(label)}")
    world = choose_world(project, store, rig)
    show_refusal()
    if len(points) < FEWEST:
        st.info("Still missing: the points of two cameras at least.")
        return None
    stated = Stated(sigma_px=sigma_px, names=names)
    return Chosen(Application(points, rig, rig, stated, world), None)


def _points_kind(store: ProjectApplication, rig: RigFile, has_own: bool) -> Field:
    given = sum(store.point_file(slot_of(name)) is not None for name in rig.names)
    kinds = [*([OWN] if has_own else []), FILES]
    usual = FILES if given >= FEWEST else kinds[0]
    return setting(store.project, "apply_points_of_rig", usual, one_of(kinds))


def _take_points(store: ProjectApplication, rig: RigFile, kind: Field) -> None:
    """An uploader for each camera, and questions about its file."""

    def take(side: Asked, name: str, content: bytes) -> None:
        store.offer_points(side, name, content)
        kind.set(FILES)

    used = kind.value() == FILES
    for name, place in zip(rig.names, cycle(st.columns(COLUMNS)), strict=False):
        with place:
            upload_points(store, slot_of(name), camera_in_words(name), used, take)
    for number, (name, camera) in enumerate(rig.cameras.items()):
        words, height = camera_in_words(name), camera.image_size[1]
        ask_about_points(store, slot_of(name), height, words, number)


def _choose_points(
    store: ProjectApplication, rig: RigFile, recording: Recording | None, kind: Field
) -> dict[str, Points]:
    """The points by camera, of those that have any."""
    if recording is not None:
        kind.menu("Points")
    if recording is not None and kind.value() == OWN:
        st.caption("The targets' names are left aside: the matching has to tell them apart.")
        tables = points_by_camera(recording)
        return {
            name: store.own_points(tables[name], f"camera {name} of {recording.name}")
            for name in rig.names
            if name in tables
        }
    found = {name: store.points(slot_of(name)) for name in rig.names}
    return {name: points for name, points in found.items() if points is not None}
