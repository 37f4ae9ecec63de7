"""The place for new images on the page Check: a data set, a table, photographs or videos of any
cameras; or the pairs of Apply."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import PurePosixPath

import streamlit as st

from stereocal.fit.rig_file import Parameters, RigFile
from stereocal.formats.dataset_description import POINTS, TABLE
from stereocal.formats.dataset_files import pack_recording
from stereocal.formats.dropped import Dropped
from stereocal.frames.all_cameras import Found
from stereocal.matching.point_table import PARQUET
from stereocal.projects.application import IMAGES, ProjectCheck
from stereocal.projects.files import StoredFile
from stereocal.projects.given import ProjectGiven
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.rig.rigid_object import RigidObject
from stereocal.system.made_from import Parts
from stereocal.system.numbers import count
from stereocal.system.zip_files import pack_zip
from stereocal.ui.door import ask_whose, ask_whose_video, place_videos
from stereocal.ui.fields import Number, one_of, setting
from stereocal.ui.holding import holds_board
from stereocal.ui.intake import drop_zone
from stereocal.ui.messages import button, readable
from stereocal.ui.search import ask_held, press_search, search_work, tell_changed
from stereocal.ui.texts import escape_markdown
from stereocal.ui.videos import show_frames_taken, take_videos, video_settings

OF_PAIR = "New bars or matched points: photographs, videos, a zip, or a table"
OF_RIG = "New bars: photographs of all cameras, a zip, or a table"
CAN_BE_GIVEN = """
- **Photographs** of the bar or the board by all cameras, or a **video** of each of two.
- A **data set**: a zip or a folder with `dataset.json`.
- A **table** of bars like `{}`, or of matched points of two cameras alone, like `pairs.csv` of
  Apply.

Five bars or 50 points are a good start.
"""
MISSING_OF_PAIR = (
    "Still missing: new bars (five are a good start), or matched points without lengths (50 are a "
    "good start)."
)
MISSING_OF_RIG = "Still missing: new bars that two cameras or more see (five are a good start)."
MATCHED, FILE = "The pairs of Apply", "A file"
CHOSEN = "check_images"
"""Setting: which of the two is checked."""
OF_HELD = ("held", "board_")
"""What the names of settings begin with that say what is held."""


@dataclass(frozen=True)
class NewImagesForm:
    """Where new images are given; before there are parameters, files only."""

    store: ProjectCheck
    rig: Parameters | None

    @cached_property
    def _photographs(self) -> ProjectPhotographs:
        """The new photographs, whose project is one of their own."""
        return ProjectPhotographs(self.store.of_images)

    @property
    def _is_rig(self) -> bool:
        return isinstance(self.rig, RigFile)

    def choose(self, matched: StoredFile | None) -> StoredFile | None:
        """Draw the place; the images in use, None if there are none.

        Args:
            matched: pairs of Apply, which serve too, of two cameras.
        """
        project, stored = self._photographs.project, self.store.file(IMAGES)
        offered = {MATCHED: None if self._is_rig else matched, FILE: stored}
        kinds = [kind for kind, file in offered.items() if file is not None]
        usual = FILE if stored else MATCHED
        kind = setting(self.store.project, CHOSEN, usual, one_of(kinds or [usual]))
        zone, whose = st.container(), st.container()
        with st.expander("What can I give?"):
            st.markdown(CAN_BE_GIVEN.format(POINTS if self._is_rig else TABLE))
            use_videos = partial(take_videos, settings=video_settings(project), project=project)
        with zone:

            def take(dropped: Dropped[StoredFile]) -> None:
                dropped.use(partial(self._take, use_videos, dropped))

            title, key = OF_RIG if self._is_rig else OF_PAIR, "upload_check_images"
            drop_zone(title, key, self._photographs.keep, take, tables=PARQUET)
        with whose:
            ask_whose(ProjectGiven(project))
            ask_whose_video(use_videos)
            show_frames_taken(project)
            self._search()
        if len(kinds) > 1:
            kind.menu("Check")
        images = offered[kind.value()]
        if images is not None:
            st.caption(f"In use: {escape_markdown(images.label)}")
        return images

    def tell_missing(self) -> None:
        """Say that there are none yet."""
        st.info(MISSING_OF_RIG if self._is_rig else MISSING_OF_PAIR)

    def _take(self, use_videos: Callable[..., None], dropped: Dropped[StoredFile]) -> None:
        """Use what was given: photographs and videos to be searched, or a file as it is."""
        project_files = ProjectGiven(self._photographs.project)
        tables, data_set = dropped.of("table"), bool(dropped.of("data set"))
        has_points = any(PurePosixPath(name).suffix.lower() == ".csv" for name in dropped.files)
        if data_set and (has_points or not dropped.photographs):
            self._use(dropped.source, pack_zip(dropped.files))
        elif dropped.photographs:
            placed = self.rig.placed if self.rig else {}
            project_files.name_cameras({name: camera.camera for name, camera in placed.items()})
            project_files.add_photographs(dropped.photographs)
            self._hold_as_in_the_data()
        elif videos := dropped.of("video"):
            place_videos(videos, use_videos)
        elif tables:
            self._use(*next(iter(tables.items())))
        else:
            dropped.problems += [f"{name}: this is no new image." for name in dropped.files]

    def _use(self, name: str, content: bytes) -> None:
        self.store.keep_images(name, content, self.rig)
        self.store.project.keep_settings({CHOSEN: FILE})

    def _hold_as_in_the_data(self) -> None:
        """Until something else is said, what was held for the calibration is held again."""
        project, whole = self._photographs.project, self.store.project.settings
        if "held" not in project.settings and "held" in whole:
            project.keep_settings({n: value for n, value in whole.items() if n.startswith(OF_HELD)})

    def _search(self) -> None:
        """What is held in the new photographs, and the press that looks for it."""
        store, project = self._photographs, self._photographs.project
        files = readable(lambda: store.photographs) or {}
        if not files:
            return
        if self.rig is None:
            st.info("The photographs are searched once there are parameters: they hold the lenses.")
            return
        cameras = {name: placed.camera for name, placed in self.rig.placed.items()}
        with st.container(border=True):
            pairing = readable(lambda: store.paired([*cameras]))
            moments = pairing.moments if pairing else {}
            with st.container(horizontal=True, vertical_alignment="center"):
                st.markdown(f"{count(len(files), 'photograph')}, {count(len(moments), 'frame')}.")
                button("Remove the photographs", "check_clear", store.clear)
            if pairing is None:
                return
            held, ready = ask_held(store, pairing, fold=True)
            length_m = None
            if not holds_board(project):
                length = setting(project, "length_m", self.rig.length_m, Number(0.0, or_none=True))
                label = "Distance between targets A and B (m)"
                length_m = length.number_input(label, format="%.10g") or None
                ready = ready and length_m is not None
            keep = partial(self._keep, length_m)
            more = {"distance between the targets": length_m}
            work = search_work(store, pairing, cameras, held, keep, **more)
            tell_changed(store, work)
            press_search(work, "targets", "find_new", bool(store.found_in), ready)

    def _keep(self, length_m: float | None, result: Found, made_from: Parts) -> None:
        """Use the targets that were found as the new images."""
        recording, photographs = result.recording, len(self._photographs.photographs)
        frames = len({*recording.frame.tolist()})
        label = f"targets found in {frames} frames of {photographs} photographs"
        held_object = recording.object if length_m is None else RigidObject.bar(length_m)
        whole = replace(recording, object=held_object, name=label)
        self._use(label, pack_zip(pack_recording(whole)))
        self._photographs.keep_found_in(made_from)
