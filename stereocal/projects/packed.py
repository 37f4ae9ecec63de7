"""The files of data that are at hand; no project reads them again."""

import hashlib

from stereocal.formats.camera_file import write_camera
from stereocal.formats.correspondences_csv import Table, write_table
from stereocal.formats.dataset_description import TABLE
from stereocal.projects.inputs import Slot
from stereocal.rig.camera import Camera
from stereocal.rig.correspondences import Correspondences
from stereocal.rig.pair import Pair
from stereocal.system import latest

NAMES: dict[Slot, str] = {
    "primary": "primary.json",
    "secondary": "secondary.json",
    "correspondences": TABLE,
}
"""Slots, and the names of their files."""


def as_read(content: bytes, read: Camera | Table) -> bytes:
    """The content of a file from which `read` was read: no project reads it again."""
    step = "camera" if isinstance(read, Camera) else "table"
    latest.keep(step, hashlib.sha256(content).hexdigest(), read)
    return content


def packed_table(rows: Correspondences) -> bytes:
    """The file of a table of points, which is not read again."""
    return as_read(write_table(rows), Table(rows, []))


def packed_files(dataset: Pair) -> dict[Slot, bytes]:
    """The files of a data set, which are not read again."""
    return {
        "primary": as_read(write_camera(dataset.primary), dataset.primary),
        "secondary": as_read(write_camera(dataset.secondary), dataset.secondary),
        "correspondences": packed_table(dataset.correspondences),
    }
