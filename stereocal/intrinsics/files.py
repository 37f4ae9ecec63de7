"""Store lens calibrations and their intermediate results."""

import io
import json
from dataclasses import asdict
from typing import Any

import numpy as np

from stereocal.errors import damaged
from stereocal.intrinsics.boards import BoardSearch, BoardView, Refused
from stereocal.intrinsics.calibrate_lens import LensCalibration
from stereocal.intrinsics.lens_fit import PARAMETERS, LensSettings
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.arrays import read_arrays, shaped
from stereocal.system.records import of_plain

RESULT_FORMAT = "stereocal-lens/1"
DAMAGED_LENS = "The last lens result of this project cannot be read; calibrate the lens again."
MAXIMUM_PIXELS = 1_000_000
"""Along one side of a photograph."""


def about(calibration: LensCalibration) -> dict[str, Any]:
    """How the camera was calibrated, for its file."""
    search, settings = calibration.search, calibration.settings
    what = "all photographs at once; errors from" if settings.model == "fisheye" else "median of"
    spread, of_all = (
        dict(zip(settings.parameters, values.tolist(), strict=False))
        for values in (calibration.spread, calibration.of_all)
    )
    return {
        "method": (
            f"{what} {settings.repeats} calibrations, each with {calibration.per_draw} of "
            f"{len(search.views)} photographs"
        ),
        "uncertainty": "standard errors (delete-d jackknife)",
        "board": asdict(search.pattern),
        "settings": asdict(settings),
        "reprojection_error_px": calibration.error_px,
        "spread": spread,
        "all_photographs": of_all,
    }


def pack_search(search: BoardSearch) -> bytes:
    """The found boards as one file."""
    return _pack(search, {}, {})


def pack_lens(calibration: LensCalibration) -> bytes:
    """A calibration as one file: its boards, and the results of the draws."""
    arrays = {name: getattr(calibration, name) for name in ("drawn", "draws", "of_all")}
    return _pack(calibration.search, {"settings": asdict(calibration.settings)}, arrays)


def _pack(search: BoardSearch, head: dict[str, Any], arrays: dict[str, Any]) -> bytes:
    head = {
        "format": RESULT_FORMAT,
        "pattern": asdict(search.pattern),
        "views": [[view.name, view.image_size, view.turned] for view in search.views],
        "refused": [[item.name, item.reason, item.image_size] for item in search.refused],
        **head,
    }
    packed = io.BytesIO()
    np.savez_compressed(
        packed,
        head=np.frombuffer(json.dumps(head, allow_nan=False).encode(), np.uint8),
        ids=np.concatenate([view.ids for view in search.views]),
        corners=np.concatenate([view.corners for view in search.views]),
        counts=np.array([len(view.ids) for view in search.views]),
        **arrays,
    )
    return packed.getvalue()


def unpack_search(content: bytes) -> BoardSearch:
    """The boards of `pack_search`."""
    with damaged(DAMAGED_LENS):
        return _search(*_unpack(content))


def unpack_lens(content: bytes) -> LensCalibration:
    """The calibration of `pack_lens`."""
    with damaged(DAMAGED_LENS):
        head, arrays = _unpack(content)
        settings = of_plain(head["settings"], LensSettings)
        search = _search(head, arrays)
        drawn = shaped(arrays["drawn"], "iu", settings.repeats, None)
        draws = shaped(arrays["draws"], "f", settings.repeats, len(PARAMETERS))
        of_all = shaped(arrays["of_all"], "f", len(PARAMETERS))
        if not 0 <= drawn.min() <= drawn.max() < len(search.views) > drawn.shape[1]:
            raise ValueError(drawn)
        lens = LensCalibration(search, settings, drawn, draws, of_all)
        lens.camera.to_json()  # raises an error for an invalid camera
        return lens


def _unpack(content: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    arrays = read_arrays(content, "The boards")
    head = json.loads(arrays.pop("head").tobytes())
    if head["format"] != RESULT_FORMAT:
        raise ValueError(head["format"])
    return head, arrays


def _search(head: dict[str, Any], arrays: dict[str, Any]) -> BoardSearch:
    counts = shaped(arrays["counts"], "iu", len(head["views"]))
    total = int(counts.sum())
    ids = shaped(arrays["ids"], "iu", total)
    corners = shaped(arrays["corners"], "f", total, 2)
    pattern = of_plain(head["pattern"], BoardPattern)
    if counts.min(initial=1) < 1 or not np.isfinite(corners).all():
        raise ValueError(counts)
    if total and not 0 <= ids.min() <= ids.max() < len(pattern.points):
        raise ValueError(ids)
    ends = np.cumsum(counts)[:-1]
    parts = zip(head["views"], np.split(ids, ends), np.split(corners, ends), strict=True)
    views = tuple(
        BoardView(str(name), _size(size), own_ids, own_corners, bool(turned))
        for (name, size, turned), own_ids, own_corners in parts
    )
    refused = tuple(
        Refused(str(name), str(reason), _size(size) if size else None)
        for name, reason, size in head["refused"]
    )
    return BoardSearch(pattern, views, refused)


def _size(size: Any) -> tuple[int, int]:
    width, height = (int(side) for side in size)
    if not 0 < width < MAXIMUM_PIXELS > height > 0:
        raise ValueError(size)
    return width, height
