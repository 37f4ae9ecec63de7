"""A part of many that stands for all."""

import numpy as np
import numpy.typing as npt


def evenly_spread(count: int, most: int) -> npt.NDArray[np.int64]:
    """(k,): at most so many of the indices below `count`, evenly spread, with the first and the
    last; all where there are no more."""
    return np.linspace(0, count - 1, min(count, most)).round().astype(np.int64)
