"""What a person gives, ready to be computed with: in step, with its baseline found; new images."""

import tempfile
from dataclasses import replace
from functools import partial
from pathlib import Path

from stereocal.errors import StereocalError, naming
from stereocal.field.checking.new_images import NewImages, images_of_bars, images_of_pairs
from stereocal.field.checking.to_check import ToCheck, with_new
from stereocal.fit.rig_file import Parameters, RigFile
from stereocal.fit.timing.to_calibrate import in_step, pair_to_calibrate
from stereocal.formats.correspondences_csv import read_table
from stereocal.formats.dataset_files import parse_zip
from stereocal.formats.points_csv import read_points_csv
from stereocal.matching.point_table import PointTable, is_parquet
from stereocal.rig.camera import CAMERAS, LensModel
from stereocal.rig.correspondences import PIXELS
from stereocal.rig.pair import Pair
from stereocal.rig.parameters import RigParameters
from stereocal.rig.recording import Recording
from stereocal.system.tables import names_of, text_of
from stereocal.system.zip_files import is_zip

TARGET = "target"
"""Column of a table of bars."""


def pair_in_zip(content: bytes, label: str, lens_model: LensModel | None = None) -> Pair:
    """The data set of two cameras in a zip's content, in step and with its baseline found."""
    recording = parse_zip(content, label, lens_model)
    with naming(label):
        return pair_to_calibrate(recording)


def to_check(content: bytes, label: str, rig: Parameters) -> ToCheck:
    """New images in an uploaded file: a zip with `dataset.json`, or a table."""
    return with_new(rig, partial(images_in, content, label), partial(recording_in, content, label))


def images_in(content: bytes, label: str, rig: RigParameters) -> NewImages:
    """New images of two cameras in a file."""
    if is_zip(content):
        return images_of_bars(pair_in_zip(content, label), rig)
    with tempfile.TemporaryDirectory(prefix="stereocal-") as folder:
        path = Path(folder) / f"table{Path(label).suffix.lower()}"
        path.write_bytes(content)
        return images_in_table(path, label, rig)


def recording_in(content: bytes, label: str, rig: RigFile) -> Recording:
    """New images of a rig in a file: a zip with `dataset.json`, or a table `points.csv` of the
    object that the rig was calibrated with."""
    if is_zip(content):
        recording = parse_zip(content, label)
        with naming(label):
            return in_step(recording)
    if rig.object is None:
        raise StereocalError(
            f"{label}: the rig's file does not say which object it was calibrated with. Give a "
            "data set with dataset.json."
        )
    own_frames = "frame" not in names_of(text_of(content, label), label)[0]
    as_given = read_points_csv(content, rig.cameras, rig.object, label, own_frames=own_frames)
    return replace(in_step(replace(as_given, own_frames=own_frames)), name=label)


def images_in_table(path: Path, label: str, rig: RigParameters) -> NewImages:
    """New images in a table: bars if it has a column `target`, else matched points alone.

    A table does not state the length of its bars: it is taken for that of the calibration.
    """
    table = PointTable(path, PIXELS, label)
    if TARGET not in table.names or is_parquet(path):
        return images_of_pairs(table, rig)
    length = rig.length_m
    if length is None:
        raise StereocalError(
            f"{label}: the length of the bars is unknown. Give a data set with dataset.json, or "
            "matched points without the column target."
        )
    rows = read_table(path.read_bytes(), label).strict(label)
    known = Recording.of_two(label, rig.primary, rig.secondary, rig.pose.baseline, length)
    return images_of_bars(known.with_pairs(rows).pair(*CAMERAS), rig)
