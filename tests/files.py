"""Files, zips and photographs as files, and the chunks of a PNG."""

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy.typing as npt


def write(files: Mapping[str, bytes], folder: Path) -> None:
    """The files below `folder`."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def description(name: str, baseline_m: float, distance_m: float) -> bytes:
    """The `dataset.json` of two cameras."""
    content = {
        "format": "stereocal-dataset/1",
        "name": name,
        "baseline_m": baseline_m,
        "target_distance_m": distance_m,
        "cameras": {"primary": "primary.json", "secondary": "secondary.json"},
    }
    return json.dumps(content).encode()


def encoded(image: npt.NDArray[Any], suffix: str = ".png") -> bytes:
    """A photograph as a file of the format with this ending."""
    done, content = cv2.imencode(suffix, image)
    assert done
    return bytes(content)


def zipped(files: Mapping[str, bytes], kind: int = zipfile.ZIP_DEFLATED) -> bytes:
    """Files as a zip."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name), content, kind)
    return packed.getvalue()


def chunks_of(png: bytes) -> list[tuple[bytes, bytes]]:
    """Kind and data of each whole chunk; none of another file."""
    found, at = [], 8
    while png[:4] == b"\x89PNG" and at + 12 <= len(png):
        (length,) = struct.unpack_from(">I", png, at)
        found.append((png[at + 4 : at + 8], png[at + 8 : at + 8 + length]))
        at += 12 + length
    return found


def png_of(chunks: Iterable[tuple[bytes, bytes]]) -> bytes:
    """A PNG of these chunks, with right checksums."""
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )
