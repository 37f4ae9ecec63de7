"""What the Check page stores in a project: parameters to check, and new images."""

from __future__ import annotations

from stereocal.formats.inputs import images_in
from stereocal.projects.application import parameters_in
from stereocal.projects.files import StoredFile
from stereocal.projects.project import ProjectPart
from stereocal.rig.parameters import RigParameters

CHECK = "check"
"""Part of a project."""
PARAMETERS, IMAGES = "parameters", "images"


class ProjectCheck(ProjectPart):
    """The Check page's files of one project."""

    def keep_parameters(self, label: str, content: bytes) -> None:
        """Store a parameter file.

        Raises:
            StereocalError: it is not a parameter file; nothing has changed.
        """
        parameters_in(content, label)
        self.database.give(CHECK, PARAMETERS, label, content)

    def keep_images(self, label: str, content: bytes, rig: RigParameters | None) -> None:
        """Store new bars or matched points.

        Args:
            rig: the parameters to be checked; None if there are none yet.
        """
        if rig is not None:
            images_in(content, label, rig)
        self.database.give(CHECK, IMAGES, label, content)

    def file(self, name: str) -> StoredFile | None:
        """`PARAMETERS` or `IMAGES`; None if not given."""
        return self.database.file(CHECK, name)
