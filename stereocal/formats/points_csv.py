"""`points.csv`: a row a point, with its frame, camera, target and pixel coordinates."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from stereocal.errors import PointsOutsideError, naming
from stereocal.formats.correspondences_csv import codes_of
from stereocal.matching.point_table import OWN_FRAME
from stereocal.rig.camera import Camera
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import RigidObject
from stereocal.system.array_types import IntArray
from stereocal.system.csv_text import as_names, csv_text
from stereocal.system.tables import (
    EMPTY,
    LARGEST_INTEGER,
    Column,
    Rows,
    names_of,
    read_rows,
    text_of,
)

REQUIRED = ("frame", "camera", "target", "u", "v")
SIGMA = "sigma_px"
NUMBERS = (
    Column("frame", is_whole=True, most=LARGEST_INTEGER),
    Column(OWN_FRAME, is_whole=True, most=LARGEST_INTEGER),
    Column("u", is_pixel=True),
    Column("v", is_pixel=True),
    Column(SIGMA, may_be_empty=True, is_positive=True),
)


def read_points_csv(
    content: bytes,
    cameras: Mapping[str, Camera],
    rigid_object: RigidObject,
    source: str,
    of_camera: str | None = None,
    own_frames: bool = False,
) -> Recording:
    """The recording of a table of points, without name and baselines.

    Args:
        of_camera: the camera of all rows, if the table has no such column.
        own_frames: take the column `camera_frame`, if there is one, instead of `frame`.
    """
    names, _ = names_of(text_of(content, source), source)
    number = OWN_FRAME if own_frames and OWN_FRAME in names else "frame"
    needed = [name for name in REQUIRED if of_camera is None or name != "camera"]
    needed[0] = number
    rows = read_rows(content, source, needed, NUMBERS, (), EMPTY)
    rows.values["frame"] = rows.values[number]
    if of_camera is not None:
        rows.raw["camera"] = of_camera
    codes: dict[str, IntArray] = {}
    for column, names in (("camera", list(cameras)), ("target", list(rigid_object.names))):
        words = as_names(rows.raw[column])
        allowed = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
        known = {name: i for i, name in enumerate(names)}
        codes[column] = codes_of(words, known, allowed, words, rows.reasons)
    points = np.column_stack([rows.values["u"], rows.values["v"]])
    _refuse_twice(rows, codes["camera"], codes["target"])
    unusable = bool(rows.problems)
    for code, camera in enumerate(cameras.values()):
        its_rows = np.flatnonzero(codes["camera"] == code)
        for k, what in camera.outside(points[its_rows]):
            row = int(its_rows[k])
            rows.reasons.setdefault(row, f"{_at(rows, row)}: the {what}")
    if unusable:
        rows.check(source)
    frame, sigma_px = rows.values["frame"].astype(np.int64), rows.values[SIGMA]
    recording = Recording(
        "", dict(cameras), rigid_object, frame, codes["camera"], codes["target"], points, sigma_px
    )
    if rows.problems:
        raise PointsOutsideError(f"{source}: ", rows.problems, "cannot be used", recording)
    with naming(source):
        return recording.within_view()


def _at(rows: Rows, row: int) -> str:
    camera, target = (rows.raw[name].iloc[row].strip() for name in ("camera", "target"))
    return f"frame {rows.values['frame'][row]:.0f}, camera {camera}, target {target}"


def _refuse_twice(rows: Rows, camera: IntArray, target: IntArray) -> None:
    """Add the valid rows with a point that the table has already."""
    keys = pd.DataFrame({"frame": rows.values["frame"], "camera": camera, "target": target})
    keys = keys.drop(index=list(rows.reasons))
    lines = pd.Series(rows.raw.index.to_numpy(), index=range(len(rows.raw)))
    first = lines[keys.index].groupby([keys[name] for name in keys]).transform("first")
    for row in keys.index[keys.duplicated()].tolist():
        rows.reasons[row] = f"{_at(rows, row)} is in line {first[row]} already"


def write_points(recording: Recording) -> bytes:
    """`points.csv`, read back exactly by `read_points_csv`."""
    table = recording.to_dataframe()
    if recording.start_frames:
        starts = np.array([recording.start_frames[name] for name in recording.cameras])
        table.insert(1, OWN_FRAME, recording.frame - starts[recording.camera])
    return csv_text(table).encode()
