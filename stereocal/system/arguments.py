"""Wrong arguments of public functions: an error that says what is meant, and how to get it."""

import inspect
import os
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence, ValuesView
from functools import cache, wraps
from itertools import islice
from numbers import Integral, Real
from pathlib import Path
from types import SimpleNamespace, UnionType
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError

Taken = ParamSpec("Taken")
Result = TypeVar("Result")

LOOKED_AT = 1000
"""Values of a list, of which there may be millions."""
_SET = 'Take a parameter set of a calibration, as run.sets["2d"], or RigParameters.load(path).'
_RECORDING = "Read a recording with stereocal.read(path), or see Recording.from_dataframe."
WAYS = {
    "BoardPattern": "A board is a BoardPattern(columns, rows, square_m).",
    "CalibrationSettings": "Make settings with stereocal.CalibrationSettings().",
    "Camera": "Read a camera with stereocal.read_camera(path).",
    "DataFrame": "Read a table with pandas.read_csv(path).",
    "Pair": _RECORDING,
    "PlacedCameras": f"{_SET} A rig is what stereocal.calibrate_rig(recording) returns.",
    "Pose": "Make a pose with stereocal.Pose(R, T).",
    "Recording": _RECORDING,
    "RigFile": "A rig is what stereocal.calibrate_rig(recording) returns, or RigFile.load(path).",
    "RigParameters": _SET,
}
"""How to get what is of a type, by its name."""
INSTEAD = {
    ("CalibrationRun", "Pair"): "The recording of a calibration is run.dataset.",
    ("CalibrationRun", "Recording"): "The recording of a calibration is run.dataset.",
    ("Pair", "Recording"): "The recording of a Pair is pair.recording.",
}
"""Where what was given has what is meant: what to take of it."""


def checked(function: Callable[Taken, Result]) -> Callable[Taken, Result]:
    """The function, whose arguments are compared with its annotations first.

    Raises:
        StereocalError: an argument is of another type, or missing, or unknown.
    """
    signature = inspect.signature(function)

    @wraps(function)
    def call(*arguments: Taken.args, **named: Taken.kwargs) -> Result:
        try:
            given = signature.bind(*arguments, **named).arguments
        except TypeError as error:
            known = ", ".join(name for name in signature.parameters if name not in ("self", "cls"))
            raise StereocalError(f"{function.__name__}: {error}; it takes {known}.") from None
        for name, hint in _hints(function).items():
            if name in given and not _fits(given[name], hint):
                mistake = f"{name} must be {_in_words(hint)}, not {_of_what(given[name])}."
                ways = _ways(hint, given[name])
                raise StereocalError(" ".join([f"{function.__name__}: {mistake}", *ways]))
        return function(*arguments, **named)

    return call


@cache
def _hints(function: Callable[..., Any]) -> dict[str, Any]:
    """The types of the arguments; that of the result may be known to type checkers only."""
    annotations = {**function.__annotations__}
    annotations.pop("return", None)
    module = vars(sys.modules[function.__module__])
    return get_type_hints(SimpleNamespace(__annotations__=annotations), module)


def _fits(value: Any, hint: Any) -> bool:
    """Whether a value is of the type; one that is not known here is not checked."""
    origin, within = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return any(_fits(value, kind) for kind in within)
    if origin is Literal:
        return isinstance(value, str) and value in within
    if origin is Mapping:
        return isinstance(value, Mapping) and _all_fit(value.values(), within[1])
    if origin in (Iterable, Sequence):
        is_one = isinstance(value, str | bytes | Mapping | pd.DataFrame)
        return isinstance(value, Iterable) and not is_one and _all_fit(value, within[0])
    if origin is tuple:
        is_tuple = isinstance(value, tuple | list) or np.ndim(value) == 1
        return is_tuple and len(value) == len(within) and all(map(_fits, value, within))
    if origin is Callable:
        return callable(value)
    if hint in (int, float):  # those of NumPy too
        return isinstance(value, Integral if hint is int else Real) and not isinstance(value, bool)
    kind = {bool: bool | np.bool_, Path: os.PathLike}.get(hint, hint)
    return not isinstance(kind, type | UnionType) or hint is Any or isinstance(value, kind)


def _all_fit(values: Iterable[Any], hint: Any) -> bool:
    """Whether all are of the type, or the first of many; an iterator would be used up by a look."""
    if not isinstance(values, Sequence | ValuesView):
        return True
    return all(_fits(value, hint) for value in islice(values, LOOKED_AT))


def _alternatives(hint: Any) -> list[Any]:
    """The types that an annotation allows; words are types of their own."""
    if get_origin(hint) in (Union, UnionType):
        return [kind for alternative in get_args(hint) for kind in _alternatives(alternative)]
    return [Literal[word] for word in get_args(hint)] if get_origin(hint) is Literal else [hint]


def _in_words(hint: Any) -> str:
    """A type as in the source, without the modules."""
    words = [
        repr(*get_args(kind)) if get_origin(kind) is Literal else inspect.formatannotation(kind)
        for kind in _alternatives(hint)
    ]
    return re.sub(r"[\w.]+\.(?=\w)", "", " | ".join(words)).replace("NoneType", "None")


def _of_what(value: Any) -> str:
    """What was given."""
    if value is None or isinstance(value, str | Path | Real):
        return repr(value)[:80]
    name = type(value).__name__
    if not isinstance(value, list | tuple | dict):
        return name
    items = value.values() if isinstance(value, dict) else value
    return f"{name} of {' and '.join(sorted({type(item).__name__ for item in items})) or 'nothing'}"


def _ways(hint: Any, value: Any) -> list[str]:
    """How to get what is meant."""
    within = [get_args(kind)[0] for kind in _alternatives(hint) if get_origin(kind) is Sequence]
    if any(_fits(value, kind) for kind in within):
        return ["Put it into a list."]
    type_given = type(value).__name__
    words = re.findall(r"\w+", _in_words(hint))
    ways = (INSTEAD.get((type_given, word), WAYS.get(word, "")) for word in words)
    return list(dict.fromkeys(filter(None, ways)))
