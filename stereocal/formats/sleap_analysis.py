"""The points of an analysis file of SLEAP (HDF5), as its CSV table.

A process of its own reads it, which starts in half the time since little is imported here.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from stereocal.errors import DAMAGED, StereocalError
from stereocal.system.limits import Limits
from stereocal.system.tables import MAXIMUM_CELLS

ARRAYS = {
    "tracks": (4, "f", True),
    "node_names": (1, "OS", True),
    "track_names": (1, "OS", False),
    "point_scores": (3, "f", False),
}
"""Number of axes, dtype kinds, and whether the array is required."""


def analysis_table(path: Path, source: str) -> bytes:
    """The CSV table of an analysis file, which native code reads."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            arrays = {name: _array(file, name, path.stat().st_size, source) for name in ARRAYS}
    except (*DAMAGED, RuntimeError) as error:
        if isinstance(error, StereocalError):
            raise
        raise StereocalError(f"{source}: this HDF5 file is damaged ({error}).") from error
    tracks, names, tracked, scores = arrays.values()
    return _sleap_csv(
        tracks, _texts(names), _texts(() if tracked is None else tracked), scores, source
    )


def _array(file: Any, name: str, size: int, source: str) -> Any:
    """An array of the file of `size` bytes, not following links to other files.

    Returns:
        None if it is missing and not required.
    """
    import h5py

    axes, kinds, required = ARRAYS[name]
    link = file.get(name, getlink=True)  # "in" would follow the link
    if link is None and not required:
        return None
    array = file[name] if isinstance(link, h5py.HardLink) else None
    if not isinstance(array, h5py.Dataset) or array.external or array.is_virtual:
        raise StereocalError(
            f"{source}: this is an HDF5 file without {name!r}, so not an analysis file of SLEAP "
            "(Export Analysis HDF5): use the points as CSV."
        )
    if array.ndim != axes or array.size > MAXIMUM_CELLS or array.dtype.kind not in kinds:
        raise StereocalError(
            f"{source}: {name!r} has the shape {array.shape} of {array.dtype}, which no analysis "
            "file of SLEAP has."
        )
    Limits.from_environment().check_expansion(size, array.size * array.dtype.itemsize, source)
    return array[()]


def _texts(names: Any) -> list[str]:
    return [str(n, "utf-8", "replace") if isinstance(n, bytes) else str(n) for n in names]


def _sleap_csv(
    tracks: Any, nodes: list[str], tracked: list[str], scores: Any, source: str
) -> bytes:
    """`tracks` has the shape (tracks, 2, nodes, frames), `scores` (tracks, nodes, frames)."""
    count, _, parts, frames = tracks.shape
    expected = (count, 2, len(nodes), frames)
    scored = scores is not None and scores.shape == (count, parts, frames)
    if tracks.shape != expected or tracks.dtype.kind != "f" or (scores is not None and not scored):
        raise StereocalError(
            f"{source}: 'tracks' has the shape {tracks.shape}; an analysis file of SLEAP has "
            f"(tracks, 2, nodes, frames), here {expected}."
        )
    seen = np.isfinite(tracks).all(axis=1).any(axis=1)  # tracks, frames
    frame, track = np.nonzero(seen.T)
    Limits.from_environment().check_rows(len(frame), source)
    columns: dict[str, Any] = {
        "track": [tracked[k] if k < len(tracked) else f"track_{k}" for k in track],
        "frame_idx": frame,
    }
    for node, name in enumerate(nodes):
        for axis, suffix in enumerate("xy"):
            columns[f"{name}.{suffix}"] = tracks[track, axis, node, frame].astype(float)
        if scored:
            columns[f"{name}.score"] = scores[track, node, frame].astype(float)
    return pd.DataFrame(columns).to_csv(index=False, lineterminator="\n").encode()
