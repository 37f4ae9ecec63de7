"""Arrays in one file (NumPy's .npz), read from strangers: nothing is believed before it is held."""

from __future__ import annotations

import io
import math
from tokenize import TokenError
from typing import Any

import numpy as np
import numpy.typing as npt

from stereocal.errors import DAMAGED, StereocalError
from stereocal.formats.zip_files import unzip

Array = npt.NDArray[Any]
KINDS = "biuf"
"""Truth values and numbers; never objects, which are programs."""
LARGEST = 1e100
"""No number of ours is larger; its square would not be a number any more."""


def read_arrays(content: bytes, source: str) -> dict[str, Array]:
    """The arrays by name. `numpy.load` makes room for what a head claims, and runs into its errors.

    Raises:
        StereocalError: not such a file, damaged, too large, or with other things than numbers.
    """
    found = {}
    for name, packed in unzip(content, source, lambda name: name.endswith(".npy")).items():
        try:
            found[name.removesuffix(".npy")] = _array(packed)
        except (*DAMAGED, SyntaxError, TokenError) as error:  # a head is Python's literals
            raise StereocalError(f"{source}: {name} is damaged.") from error
    return found


def _array(packed: bytes) -> Array:
    file = io.BytesIO(packed)
    if np.lib.format.read_magic(file) != (1, 0):
        raise ValueError("version")
    shape, by_columns, dtype = np.lib.format.read_array_header_1_0(file)
    data = packed[file.tell() :]
    if dtype.kind not in KINDS or math.prod(shape) * dtype.itemsize != len(data):
        raise ValueError(shape)
    array = np.frombuffer(data, dtype).reshape(shape, order="F" if by_columns else "C").copy()
    if dtype.kind == "f" and (np.isinf(array) | (np.abs(array) > LARGEST)).any():
        raise ValueError("infinite")
    return array


def shaped(array: Array, kinds: str, *shape: int | None) -> Array:
    """The array, if it has such numbers and this shape; None is any length.

    Raises:
        ValueError: it has not.
    """
    fits = array.ndim == len(shape) and all(
        wanted is None or wanted == length
        for wanted, length in zip(shape, array.shape, strict=True)
    )
    if not fits or array.dtype.kind not in kinds:
        raise ValueError(f"{array.dtype} {array.shape} instead of {shape}")
    return array
