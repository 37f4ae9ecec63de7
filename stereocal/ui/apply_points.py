"""The points of the Apply page: the project's own, or a file of each camera."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import cycle

import pandas as pd
import streamlit as st

from stereocal.matching.application import Points
from stereocal.projects.application import CLICKED_IN, Asked, ProjectApplication
from stereocal.projects.clicks import ProjectClicks
from stereocal.rig.camera import CAMERAS
from stereocal.rig.rig import camera_in_words
from stereocal.system.numbers import count
from stereocal.ui.fields import Field, one_of, setting
from stereocal.ui.intake import take_one
from stereocal.ui.messages import button
from stereocal.ui.texts import escape_markdown
from stereocal.ui.wizard import ask_about_points

CLICKED = "Click them here"
FEWEST = 2
"""Cameras whose points are needed."""
COLUMNS = 3
KINDS = ["csv", "txt", "tsv", "parquet", "h5", "hdf5", "mat"]
HELP = (
    "A table frame,u,v with further columns, or a file of Argus, easyWand, DLTdv, DeepLabCut "
    "(CSV), SLEAP (CSV or analysis HDF5), Tracktor, TrackMate or another program."
)


@dataclass(frozen=True)
class PointsForm:
    """The choice of points, and the uploaders."""

    store: ProjectApplication
    slots: Mapping[str, Asked]
    """By camera, what its file is for."""
    key: str
    """Of the setting."""
    own: str
    """What the page calls the project's own points."""
    files: str
    """What it calls files."""
    own_tables: Callable[[], Mapping[str, pd.DataFrame]] | None
    """The project's own points by camera; None if it has none."""

    @property
    def missing(self) -> list[str]:
        """The cameras without a file, where files are wanted."""
        return [] if self.is_clicked else self._without_file

    @property
    def _without_file(self) -> list[str]:
        return [camera for camera, slot in self.slots.items() if not self.store.point_file(slot)]

    @property
    def is_clicked(self) -> bool:
        """Whether the points are clicked on the page."""
        return bool(self._kind.value() == CLICKED)

    @property
    def _kind(self) -> Field:
        kinds = [*([self.own] if self.own_tables else []), self.files, CLICKED]
        given = len(self.slots) - len(self._without_file)
        usual = self.files if given >= FEWEST else kinds[0]
        return setting(self.store.project, self.key, usual, one_of(kinds))

    def take(self, heights: Mapping[str, int | None]) -> None:
        """An uploader for each camera, and the questions about its file, unless points are clicked.

        Args:
            heights: rows of the images, by camera, if known.
        """
        if self.is_clicked:
            return
        columns = st.columns(min(len(self.slots), COLUMNS))
        in_use = "In use" if self._kind.value() == self.files else "Not in use"
        for (camera, slot), place in zip(self.slots.items(), cycle(columns), strict=False):
            with place:
                self._upload(slot, camera_in_words(camera), in_use)
        for number, (camera, slot) in enumerate(self.slots.items()):
            ask_about_points(self.store, slot, heights[camera], camera_in_words(camera), number)

    def _upload(self, slot: Asked, camera: str, in_use: str) -> None:
        if (file := self.store.point_file(slot)) is not None:
            st.caption(f"{in_use}: {escape_markdown(file.label)}, {count(file.rows, 'point')}")
            if file.answers is not None:
                button("Read it differently", f"again_{slot}", self.store.ask_again, slot)
        title, key = f"Points of {escape_markdown(camera)}", f"upload_points_{slot}"
        upload = st.file_uploader(title, type=KINDS, key=key, help=HELP)
        take_one(upload, partial(self._offer, slot))

    def _offer(self, slot: Asked, label: str, content: bytes) -> None:
        self.store.offer_points(slot, label, content)
        if len(self.slots) - len(self.missing) >= FEWEST:
            self._kind.set(self.files)

    def choose(self, left_aside: str, source: str) -> dict[str, Points]:
        """The points by camera, of those that have any.

        Args:
            left_aside: what of the project's own points is.
            source: name of the data set that these are from.
        """
        kind = self._kind.menu("Points")
        if kind == CLICKED:
            clicks = ProjectClicks(self.store.project).clicks.of_cameras(self.slots)
            tables = clicks.tables(self.slots, to_match=True) if clicks.are_points else {}
            label = f"{CLICKED_IN} {{}} pictures"
            return {c: self.store.own_points(own, label.format(c)) for c, own in tables.items()}
        if self.own_tables is not None and kind == self.own:
            st.caption(f"{left_aside} are left aside: the matching has to tell them apart.")
            own = self.own_tables()
            labels = {c: f"{c} points" if c in CAMERAS else f"camera {c}" for c in self.slots}
            return {
                camera: self.store.own_points(own[camera], f"{label} of {source}")
                for camera, label in labels.items()
                if camera in own
            }
        found = {camera: self.store.points(slot) for camera, slot in self.slots.items()}
        return {camera: points for camera, points in found.items() if points is not None}
