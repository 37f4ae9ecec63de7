"""Internal functions as compiled code runs them: what Python calls is their source."""

import inspect
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numba

from stereocal.rig.compiled import FAST_MATH

P = ParamSpec("P")
T = TypeVar("T")


def machine_code(function: Callable[P, T]) -> Callable[P, T]:
    """The function compiled so that Python can call it, and not kept on disk."""
    built: Callable[P, T] = numba.njit(error_model="numpy", fastmath=FAST_MATH)(
        inspect.unwrap(function)
    )
    return built
