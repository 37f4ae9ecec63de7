"""Sound files to begin from, small and of every kind that a reader knows."""

import io
import json
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from stereocal.formats.camera_file import write_camera
from stereocal.rig.rig import Rig
from tests.field.world_tables import lines_csv, survey_csv, throw_csv
from tests.formats import test_other_programs_points as other
from tests.formats.test_other_programs_points import hdf5
from tests.rigs.known_rig import PRIMARY, RIG, SECONDARY
from tests.rigs.worlds import known_place, plumb_lines, surveyed, thrown

FIELD = Path(__file__).parents[2] / "sample_data" / "field"


@cache
def field() -> Mapping[str, bytes]:
    """The files of the sample data set."""
    return {path.name: path.read_bytes() for path in FIELD.iterdir()}


def layouts() -> Mapping[str, Sequence[bytes]]:
    """Point files by the program that writes them."""
    return {
        "wand": [other.WAND, b"a1x,a1y,a2x,a2y,b1x,b1y,b2x,b2y\n" + other.WAND],
        "dltdv": [other.DLTDV5, other.DLTDV8],
        "deeplabcut": [other.deeplabcut(0)],
        "sleap": [other.sleap(0)],
        "tracktor": [other.tracktor(0)],
        "argus": [other.ARGUS],
        "trackmate": [other.trackmate(0, "micron", 0.65)],
        "long table": [b"frame,u,v,bird\n1,1,2,a\n2,3,4,b\n", b"time;x;y\n1;1,5;2\n", other.odd(0)],
    }


@cache
def sleap() -> Sequence[bytes]:
    """Analysis files: two tracks of three nodes in four frames, and a bare one.

    The names have a fixed length: HDF5's library hangs on spoilt heaps of others, which only the
    child process of the server survives.
    """
    names, tags = np.array([b"nose", b"wing", b"tail"]), np.array([b"a", b"b"])
    tracks = np.arange(48, dtype=np.float64).reshape(2, 2, 3, 4) + 0.25
    tracks[1, :, :, 2] = np.nan
    scores = np.full((2, 3, 4), 0.9)
    whole = hdf5(tracks=tracks, node_names=names, track_names=tags, point_scores=scores)
    return [whole, hdf5(tracks=tracks[:1], node_names=names)]


def points() -> Sequence[bytes]:
    """Tables of points, with commas and with semicolons."""
    return [b"frame,u,v,bird\n1,1.5,2,a\n1,3,4,b\n3,5,6,\n", b"frame;u;v\n2;1,5;2\n1;3;4\n"]


def correspondences() -> Sequence[bytes]:
    """The table to calibrate with, and one with all its columns."""
    known = (
        b"frame,target,u_primary,v_primary,u_secondary,v_secondary,distance_m,x_m,y_m,z_m,"
        b"sigma_primary_px,sigma_secondary_px,source\n"
        b"1,A,1.5,2,3,4,0.9,1,2,3,0.1,0.1,detected\n1,B,5,6,7,8,0.9,,,,,,\n"
    )
    return [field()["correspondences.csv"][:600].rsplit(b"\n", 1)[0], known]


def world(opening: str, closing: str) -> bytes:
    """A 4x4 table, in brackets or bare."""
    table = np.eye(4) + np.pad([[1.5], [2.0], [-3.0]], ((0, 1), (3, 0)))
    rows = [opening + ",".join(map(repr, row)) + closing for row in table.tolist()]
    return (opening + (",\n" if opening else "\n").join(rows) + closing).encode()


def world_json() -> bytes:
    """A file of a world frame."""
    table = np.eye(4).tolist()
    return json.dumps(
        {"format": "stereocal-world/1", "source": "plumb", "world_from_primary": table}
    ).encode()


@cache
def observed() -> Mapping[str, bytes]:
    """Tables that a world frame is found from."""
    place = known_place(Rig(PRIMARY, SECONDARY, RIG), np.random.default_rng(4))
    return {
        "a survey": survey_csv(surveyed(place, 5)),
        "lines": lines_csv(plumb_lines(place, 2, clicks=4)),
        "a throw": throw_csv(thrown(place)),
    }


def uncertain_camera() -> bytes:
    """A camera of ours with its uncertainty."""
    content = json.loads(write_camera(PRIMARY))
    sigmas = {"fx": 1, "fy": 1, "cx": 2, "cy": 2, "distortion": [0.1] * 5}
    return json.dumps({**content, "uncertainty": sigmas}).encode()


def photographs() -> Mapping[str, Sequence[bytes]]:
    """Small photographs by format: grey, colours, transparency, 8 and 16 bits."""
    progressive = (cv2.IMWRITE_JPEG_PROGRESSIVE, 1, cv2.IMWRITE_JPEG_RST_INTERVAL, 2)
    bilevel = image(".png", flags=(cv2.IMWRITE_PNG_BILEVEL, 1))
    return {
        "PNG": [image(".png"), image(".png", 3), image(".png", 4, 16), bilevel],
        "JPEG": [image(".jpg"), image(".jpg", 3), image(".jpg", 3, flags=progressive)],
        "TIFF": [image(".tif"), image(".tif", 3, 16), image(".tiff", 1, 16)],
        "BMP": [image(".bmp"), image(".bmp", 3)],
        "PGM": [image(".pgm"), image(".ppm", 3, 16), b"P2\n16 17 9\n" + b"7 " * 272],
    }


def image(ending: str, channels: int = 1, bits: int = 8, flags: Sequence[int] = ()) -> bytes:
    """One of them, 24x20 px."""
    rows, columns = np.mgrid[:20, :24]
    grey = ((rows * 7 + columns * 5) % 256 * (257 if bits == 16 else 1)).astype(f"uint{bits}")
    pixels = grey if channels == 1 else np.dstack([grey] * channels)
    return bytes(cv2.imencode(ending, pixels, list(flags))[1])


@cache
def parquet() -> Sequence[bytes]:
    """Sound tables, and tables whose columns have types that nobody expects there."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    sound = {"frame": [1, 1, 2], "u": [1.5, 2, 3], "v": [4.0, 5, 6]}
    odd: tuple[Mapping[str, Any], ...] = (
        sound,
        {**sound, "bird": ["a", None, "b"]},
        {**sound, "frame": ["1", "2", "x"]},
        {**sound, "u": [None, None, None]},
        {**sound, "u": [[1.0], [2.0], []]},
        {**sound, "v": [b"1", b"\xff", None]},
        {**sound, "frame": [1.5, None, 2.0]},
        {**sound, "frame": np.array([2**63, 1, 0], np.uint64)},
        {**sound, "u": [True, False, None]},
        {**sound, "u": [{"a": 1}, None, None]},
        {**sound, "frame": [np.datetime64("2026-01-01T00:00", "s")] * 3},
        {**sound, "v": pa.array([1, 2, 3]).cast(pa.decimal128(30, 2))},
        {**sound, "v": pa.array(["1", "2", "3"]).dictionary_encode()},
        {**sound, "": [1, 2, 3], " u": [1, 2, 3]},
        {"frame": [], "u": [], "v": []},
    )
    found = []
    for columns in odd:
        for compression in ("none", "snappy"):
            out = io.BytesIO()
            pq.write_table(pa.table(dict(columns)), out, compression=compression)
            found.append(out.getvalue())
    return found
