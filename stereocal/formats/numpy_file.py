"""The small arrays in an untrusted .npz file of NumPy, as plain lists."""

import io
import zipfile
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from stereocal.errors import StereocalError
from stereocal.system.guarded import read_apart
from stereocal.system.limits import Limits
from stereocal.system.zip_files import DAMAGED_ZIP

MOST_ARRAYS = 1_000
MOST_NUMBERS = 1_000
"""In an array: a camera's have at most 16; those of points and maps are left out."""
MOST_BYTES = 20_000


@lru_cache(maxsize=4)
def read_arrays(content: bytes, source: str) -> dict[str, Any]:
    """The arrays of numbers by name. A process of its own reads them."""
    Limits.from_environment().check_size(len(content), source)
    arrays: dict[str, Any] | None = read_apart(_read, content, source)
    if arrays is None:
        raise StereocalError("this is no .npz file of NumPy that is whole.", source)
    return arrays


def _read(path: Path) -> dict[str, Any] | None:
    """The arrays in a file; None if it is damaged. No pickled objects are loaded."""
    arrays: dict[str, Any] = {}
    try:
        with zipfile.ZipFile(path) as opened:
            for item in opened.infolist()[:MOST_ARRAYS]:
                with opened.open(item) as member:
                    content = member.read(MOST_BYTES + 1)
                name = item.filename.removesuffix(".npy")
                if len(content) <= MOST_BYTES and (array := _array(content)) is not None:
                    arrays[name] = array
    except (*DAMAGED_ZIP, NotImplementedError):
        return None
    return arrays


def _array(content: bytes) -> Any:
    try:
        array = np.load(io.BytesIO(content), allow_pickle=False)
    except (ValueError, EOFError, OSError, MemoryError, SyntaxError):
        return None  # objects of Python, or damaged
    if array.size > MOST_NUMBERS or array.dtype.kind not in "biufUS":
        return None
    if array.dtype.kind == "S":
        array = array.astype(str)
    while array.ndim > 2 and 1 in array.shape:
        array = array.squeeze(array.shape.index(1))
    return array.tolist()
