"""Read arrays from an untrusted .npz file."""

import io
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.lib import format as npy

from stereocal.errors import StereocalError
from stereocal.system.zip_files import unzip

Array = npt.NDArray[Any]
LARGEST = 1e100
"""Larger numbers are rejected, since their squares may overflow."""


def read_arrays(content: bytes, source: str) -> dict[str, Array]:
    """The arrays by name, as from `numpy.load`, within the limits for zip files."""
    arrays = {}
    for name, packed in unzip(content, source, lambda name: name.endswith(".npy")).items():
        try:
            arrays[name.removesuffix(".npy")] = _array(packed)
        except Exception as error:  # NumPy's parser of headers may raise anything
            raise StereocalError(f"{source}: {name} is damaged.") from error
    return arrays


def _array(packed: bytes) -> Array:
    array: Array = npy.read_array(io.BytesIO(packed), allow_pickle=False)
    if array.dtype.kind not in "biuf" or array.itemsize > 8:
        raise ValueError(array.dtype)
    if array.dtype.kind == "f" and (np.isinf(array) | (np.abs(array) > LARGEST)).any():
        raise ValueError("infinite")
    if array.dtype.kind == "f":
        array[np.isnan(array)] = np.nan  # signalling NaNs cause warnings
    return array


def shaped(array: Array, kinds: str, *shape: int | None) -> Array:
    """The array, if its dtype is one of `kinds` and it has this shape; None is any length.

    Raises:
        ValueError: another dtype or shape.
    """
    fits = array.ndim == len(shape) and all(
        wanted is None or wanted == length
        for wanted, length in zip(shape, array.shape, strict=True)
    )
    if not fits or array.dtype.kind not in kinds:
        raise ValueError(f"{array.dtype} {array.shape} instead of {shape}")
    return array
