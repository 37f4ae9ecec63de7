"""Arrays in one file (NumPy's .npz), read from strangers: nothing is believed before it is held."""

from __future__ import annotations

import math
import re
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from stereocal.errors import DAMAGED, StereocalError
from stereocal.system.zip_files import unzip

Array = npt.NDArray[Any]
HEAD = re.compile(
    rb"\x93NUMPY\x01\x00..{'descr': '(?P<dtype>[<>|](?:b1|[iuf][1248]))', "
    rb"'fortran_order': (?P<columns>True|False), 'shape': \((?P<shape>[\d, ]{0,100})\), } *\n",
    re.DOTALL,
)
"""Truth values and numbers; never objects, which are programs. NumPy writes it so and no other way
(format version 1.0)."""
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
        except DAMAGED as error:
            raise StereocalError(f"{source}: {name} is damaged.") from error
    return found


def _array(packed: bytes) -> Array:
    head = HEAD.match(packed)
    if head is None:
        raise ValueError(packed[:100])
    dtype = np.dtype(head["dtype"].decode())
    shape = tuple(int(side) for side in head["shape"].replace(b" ", b"").split(b",") if side)
    data = packed[10 + int.from_bytes(packed[8:10], "little") :]
    if math.prod(shape) * dtype.itemsize != len(data):
        raise ValueError(shape)
    order: Literal["F", "C"] = "F" if head["columns"] == b"True" else "C"
    array = np.frombuffer(data, dtype).reshape(shape, order=order).copy()
    if dtype.kind == "f" and (np.isinf(array) | (np.abs(array) > LARGEST)).any():
        raise ValueError("infinite")
    if dtype.kind == "f":
        array[np.isnan(array)] = np.nan  # a signalling one raises a warning wherever it is used
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
