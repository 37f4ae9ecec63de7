"""What was read or computed last, in memory, by the digest of its content: no project reads or
computes it again."""

import hashlib
from collections.abc import Callable
from typing import Any, TypeVar

from stereocal.fit.rig_file import RigFile
from stereocal.formats.camera_file import write_camera
from stereocal.formats.correspondences_csv import Table, write_table
from stereocal.formats.dataset_description import TABLE
from stereocal.formats.evaluation_files import Evaluation
from stereocal.projects.inputs import Slot
from stereocal.rig.camera import Camera
from stereocal.rig.correspondences import Correspondences
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.system.latest import Latest
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.pair_run import PairRun

T = TypeVar("T")
NAMES: dict[Slot, str] = {
    "primary": "primary.json",
    "secondary": "secondary.json",
    "correspondences": TABLE,
}
"""Slots, and the names of their files."""
KEPT: dict[type, Latest[Any]] = {
    kind: Latest(most)
    for kind, most in (
        *((Camera, 64), (Table, 8), (Pair, 32), (Recording, 8), (RigFile, 16)),
        *((PairRun, 64), (PairAnswer, 64), (Evaluation, 8)),
    )
}


def once(kind: type[T], key: str, make: Callable[[], T]) -> T:
    found: T = KEPT[kind].once(key, make)
    return found


def as_read(content: bytes, read: Camera | Table) -> bytes:
    """The content of a file from which `read` was read: no project reads it again."""
    KEPT[type(read)].keep(hashlib.sha256(content).hexdigest(), read)
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
