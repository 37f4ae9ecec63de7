"""Store lens calibrations and their intermediate results."""

from __future__ import annotations

import dataclasses
import io
import json
from typing import Any, cast

import numpy as np

from stereocal.errors import DAMAGED, StereocalError
from stereocal.intrinsics.boards import BoardSearch, BoardView, Refused
from stereocal.intrinsics.calibrate_lens import PARAMETERS, LensCalibration, LensSettings
from stereocal.rig.board_pattern import BoardPattern
from stereocal.rig.compiled import FloatArray
from stereocal.system.arrays import read_arrays, shaped
from stereocal.system.records import of_plain, pack, unpack

RESULT_FORMAT = "stereocal-lens/1"
MAXIMUM_PIXELS = 1_000_000
"""Along one side of a photograph."""


def about(calibration: LensCalibration) -> dict[str, Any]:
    """How the camera was calibrated, for its file."""
    search, settings = calibration.search, calibration.settings
    what = "all photographs at once; errors from" if settings.model == "fisheye" else "median of"
    return {
        "method": (
            f"{what} {settings.repeats} calibrations, each with {calibration.per_draw} of "
            f"{len(search.views)} photographs"
        ),
        "uncertainty": "standard errors (delete-d jackknife)",
        "board": dataclasses.asdict(search.pattern),
        "settings": dataclasses.asdict(settings),
        "reprojection_error_px": calibration.error_px,
        "spread": _named(calibration, calibration.spread),
        "all_photographs": _named(calibration, calibration.of_all),
    }


def _named(calibration: LensCalibration, values: FloatArray) -> dict[str, float]:
    pairs = zip(calibration.settings.parameters, values.tolist(), strict=True)
    return {name: value for name, value in pairs if name}


def pack_search(search: BoardSearch) -> bytes:
    """The found boards as one file."""
    return _pack(_search_json(search), _search_arrays(search))


def unpack_search(content: bytes) -> BoardSearch:
    """The boards of `pack_search`."""
    return _search(*_unpack(content))


def pack_lens(calibration: LensCalibration) -> bytes:
    """A calibration as one file."""
    head = _search_json(calibration.search)
    head["settings"] = dataclasses.asdict(calibration.settings)
    arrays = {name: getattr(calibration, name) for name in ("drawn", "draws", "of_all")}
    return _pack(head, _search_arrays(calibration.search) | arrays)


def unpack_lens(content: bytes) -> LensCalibration:
    """The calibration of `pack_lens`."""
    head, arrays = _unpack(content)
    try:
        settings = of_plain(head["settings"], LensSettings)
        search = _search(head, arrays)
        drawn = shaped(arrays["drawn"], "iu", settings.repeats, arrays["drawn"].shape[-1])
        draws = shaped(arrays["draws"], "f", settings.repeats, len(PARAMETERS))
        of_all = shaped(arrays["of_all"], "f", len(PARAMETERS))
        if not 0 <= drawn.min() <= drawn.max() < len(search.views) > drawn.shape[1]:
            raise ValueError(drawn)
        lens = LensCalibration(search, settings, drawn, draws, of_all)
        lens.camera.to_json()  # raises an error for an invalid camera
        return lens
    except DAMAGED as error:
        raise StereocalError(_DAMAGED) from error


def pack_board(result: BoardView | Refused) -> bytes | None:
    """The result of one photograph; None if it was unreadable, so that it is tried again."""
    return None if result.image_size is None else pack(result)


def unpack_board(content: bytes) -> BoardView | Refused:
    """The exact result of `pack_board`; ValueError if the content is damaged."""
    return cast(BoardView | Refused, unpack(content, cast(Any, BoardView | Refused)))


def unpack_draws(content: bytes) -> FloatArray:
    """(n, 9): parameters of draws that `pack` has stored; ValueError if they are damaged."""
    return unpack(content, FloatArray).reshape(-1, len(PARAMETERS))


_DAMAGED = "The last lens result of this project cannot be read; calibrate the lens again."


def _search_json(search: BoardSearch) -> dict[str, Any]:
    return {
        "format": RESULT_FORMAT,
        "pattern": dataclasses.asdict(search.pattern),
        "views": [[view.name, view.image_size, view.turned] for view in search.views],
        "refused": [[item.name, item.reason, item.image_size] for item in search.refused],
    }


def _search_arrays(search: BoardSearch) -> dict[str, Any]:
    return {
        "ids": np.concatenate([view.ids for view in search.views]),
        "corners": np.concatenate([view.corners for view in search.views]),
        "counts": np.array([len(view.ids) for view in search.views]),
    }


def _search(head: dict[str, Any], arrays: dict[str, Any]) -> BoardSearch:
    try:
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
        parts = zip(np.split(ids, ends), np.split(corners, ends), strict=True)
        views = tuple(
            BoardView(str(name), _size(size), own_ids, own_corners, bool(turned))
            for (name, size, turned), (own_ids, own_corners) in zip(
                head["views"], parts, strict=True
            )
        )
        refused = tuple(
            Refused(str(name), str(reason), _size(size) if size else None)
            for name, reason, size in head["refused"]
        )
        return BoardSearch(pattern, views, refused)
    except DAMAGED as error:
        raise StereocalError(_DAMAGED) from error


def _size(size: Any) -> tuple[int, int]:
    width, height = (int(side) for side in size)
    if not 0 < width < MAXIMUM_PIXELS > height > 0:
        raise ValueError(size)
    return width, height


def _pack(head: dict[str, Any], arrays: dict[str, Any]) -> bytes:
    packed = io.BytesIO()
    text = np.frombuffer(json.dumps(head, allow_nan=False).encode(), np.uint8)
    np.savez_compressed(packed, head=text, **arrays)
    return packed.getvalue()


def _unpack(content: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    try:
        arrays = read_arrays(content, "The boards")
        head = json.loads(arrays.pop("head").tobytes())
    except DAMAGED as error:
        raise StereocalError(_DAMAGED) from error
    if not isinstance(head, dict) or head.get("format") != RESULT_FORMAT:
        raise StereocalError(_DAMAGED)
    return head, arrays
