"""What the Check page stores in a project: parameters to check, and new images."""

from __future__ import annotations

from stereocal.formats.inputs import images_in
from stereocal.projects.application import parameters_in
from stereocal.projects.files import (
    StoredFile,
    file_named,
    keep_file,
    name_files,
)
from stereocal.projects.project import Project
from stereocal.rig.parameters import RigParameters

CHECK = "check"
"""Part of a project."""
PARAMETERS, IMAGES = "parameters", "images"


class ProjectCheck:
    """The Check page's files of one project. Every change is on disk when its method returns."""

    def __init__(self, project: Project) -> None:
        self.project = project
        self.database = project.database

    def keep_parameters(self, label: str, content: bytes) -> None:
        """Store a parameter file.

        Raises:
            StereocalError: it is not a parameter file; nothing has changed.
        """
        parameters_in(content, label)
        self._keep(PARAMETERS, label, content)

    def keep_images(self, label: str, content: bytes, rig: RigParameters | None) -> None:
        """Store new bars or matched points.

        Args:
            rig: the parameters to be checked; None if there are none yet.
        """
        if rig is not None:
            images_in(content, label, rig)
        self._keep(IMAGES, label, content)

    def file(self, name: str) -> tuple[str, StoredFile] | None:
        """Label and content of `PARAMETERS` or `IMAGES`; None if not given."""
        return file_named(self.database, CHECK, name)

    def _keep(self, name: str, label: str, content: bytes) -> None:
        with self.database.transaction():
            stored = keep_file(self.database, content, label)
            name_files(self.database, CHECK, {name: stored}, label)
