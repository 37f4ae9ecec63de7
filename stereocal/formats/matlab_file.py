"""Read the structs of an untrusted .mat file (version 5 to 7) as plain data."""

import io
import struct
import zlib
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.other_files import is_matlab
from stereocal.system.array_types import FloatArray
from stereocal.system.arrays import LARGEST
from stereocal.system.guarded import read_apart
from stereocal.system.limits import Limits

Fields = Mapping[str, Any]
"""The fields of a struct: arrays, numbers, texts, and `Fields` of nested structs."""
HEADER = 128
COMPRESSED = 15
"""Type of a compressed element."""
BLOCK = 1_000_000
DEEPEST = 6
SAVE_AGAIN = "In MATLAB, load the file and save its struct with save(..., '-v7')"


@lru_cache(maxsize=4)
def read_structs(content: bytes, source: str) -> dict[str, Fields]:
    """The structs in a .mat file by name; other variables are left out.

    A child process reads it: a file with six damaged bytes made SciPy crash the process, and not
    each time.
    """
    if not is_matlab(content):
        raise StereocalError(f"{source}: this is not a .mat file of version 5 to 7. {SAVE_AGAIN}.")
    if content[:20].startswith(b"MATLAB 7.3") or b"HDF5" in content[:HEADER]:
        raise StereocalError(
            f"{source}: this .mat file has version 7.3, which is not read. {SAVE_AGAIN}."
        )
    Limits.from_environment().check_size(len(content), source)
    try:
        _check_expansion(content, source)
    except (zlib.error, struct.error) as error:
        raise StereocalError(f"{source}: this .mat file is damaged. {SAVE_AGAIN}.") from error
    variables, held = read_apart(_read, content, source)
    if variables is None:
        raise StereocalError(f"{source}: this .mat file is damaged. {SAVE_AGAIN}.")
    if not variables:
        raise StereocalError(
            f"{source}: there is no struct in this .mat file (it contains: {held or 'nothing'}). "
            "Objects are not read: in MATLAB, s = toStruct(stereoParams); "
            "save('stereo.mat', 's', '-v7')."
        )
    structs: dict[str, Fields] = variables
    return structs


def _read(path: Path) -> tuple[dict[str, Fields] | None, str]:
    """The structs in a file, None if it is damaged; and what it contains, in words."""
    # Importing it takes 0.2 s, which every command would wait for.
    from scipy.io import loadmat, whosmat

    file: Any = io.BytesIO(path.read_bytes())
    try:
        kinds = {name: (shape, kind) for name, shape, kind in whosmat(file)}
        wanted = [name for name, known in kinds.items() if known == ((1, 1), "struct")]
        options: Any = {"squeeze_me": True, "struct_as_record": False, "variable_names": wanted}
        loaded = loadmat(file, **options) if wanted else {}
    except Exception:  # SciPy's reader may raise anything
        return None, ""
    variables = {name: _fields(loaded[name], DEEPEST) for name in wanted if name in loaded}
    return variables, ", ".join(f"{name} ({kind})" for name, (_, kind) in kinds.items())


def numbers_in_field(fields: Fields, name: str, source: str) -> FloatArray | None:
    """The numbers in a field, of any shape; None if it is missing or empty."""
    if name not in fields:
        return None
    value = np.asarray(fields[name])
    if value.size == 0:
        return None
    if value.dtype.kind not in "biuf":
        raise StereocalError(f"{source}: {name} contains something that is not a number.")
    numbers = np.array(value, dtype=np.float64)
    if (np.abs(numbers[~np.isnan(numbers)]) > LARGEST).any():
        raise StereocalError(f"{source}: {name} has a number that is infinite or too large.")
    return numbers


def needed_in_field(fields: Fields, name: str, source: str) -> FloatArray:
    """The numbers in a field that must be there."""
    if (numbers := numbers_in_field(fields, name, source)) is None:
        raise StereocalError(f"{source}: {name} is missing.")
    return numbers


def required(fields: Fields, name: str, size: int, source: str) -> FloatArray:
    """(size,): the numbers in a field; a single number stands for all."""
    numbers = needed_in_field(fields, name, source)
    if numbers.size not in (1, size) or not np.isfinite(numbers).all():
        raise StereocalError(
            f"{source}: {name} has the shape {numbers.shape}; {size} finite numbers are expected."
        )
    return np.asarray(np.broadcast_to(numbers.ravel(), size), dtype=np.float64)


def _check_expansion(content: bytes, source: str) -> None:
    """Count the unpacked bytes of the compressed elements without keeping them."""
    order = "<" if content[126:128] == b"IM" else ">"
    limits, offset, total = Limits.from_environment(), HEADER, 0
    while offset + 8 <= len(content):
        kind, size = struct.unpack(order + "II", content[offset : offset + 8])
        offset += 8
        if kind == COMPRESSED:
            unpacker, rest = zlib.decompressobj(), content[offset : offset + size]
            while rest and not unpacker.eof:
                total += len(unpacker.decompress(rest, BLOCK))
                rest = unpacker.unconsumed_tail
                limits.check_expansion(len(content), total, source)
                limits.check_size(total, source)
        offset += size


def _fields(value: Any, depth: int) -> Any:
    """A struct as a mapping, without what is nested deeper than `depth`."""
    names = getattr(value, "_fieldnames", None)
    if names is not None:
        return {name: _fields(getattr(value, name), depth - 1) for name in names} if depth else {}
    plain = isinstance(value, str) or np.asarray(value).dtype.kind in "biufc"
    return value if plain else "not numbers"
