"""Photographs and zips as files."""

import io
import zipfile
from collections.abc import Mapping
from typing import Any

import cv2
import numpy.typing as npt


def encoded(image: npt.NDArray[Any], suffix: str = ".png") -> bytes:
    """A photograph as a file of the format with this ending."""
    done, content = cv2.imencode(suffix, image)
    assert done
    return bytes(content)


def zipped(files: Mapping[str, bytes], kind: int = zipfile.ZIP_DEFLATED) -> bytes:
    """Files as a zip."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", kind) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return packed.getvalue()
