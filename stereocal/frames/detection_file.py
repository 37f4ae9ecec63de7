"""A detection as JSON; Python reads its numbers back exactly."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any, get_args

import numpy as np

from stereocal.detection.checks import Reason
from stereocal.detection.detect import Detection
from stereocal.detection.fit import Corner


def pack_detection(found: Detection) -> bytes | None:
    """The detection; None for an unreadable photograph, so that it is tried again next time."""
    if found.reason == "unreadable":
        return None
    return json.dumps(_detection_json(found)).encode()


def unpack_detection(content: bytes) -> Detection:
    """The detection of `pack_detection`.

    Raises:
        KeyError, TypeError, ValueError: the content is damaged.
    """
    return _detection(json.loads(content))


def _detection_json(found: Detection) -> dict[str, Any]:
    return {
        "image_size": found.image_size,
        "targets": found.targets and [_corner_json(corner) for corner in found.targets],
        "score": found.score,
        "reason": found.reason,
        "doubts": found.doubts,
        "sentence": found.sentence,
        "alternatives": [_detection_json(one) for one in found.alternatives],
    }


def _detection(data: dict[str, Any]) -> Detection:
    width, height = data["image_size"]
    targets = data["targets"]
    if targets is not None:
        first, second = (_corner(item) for item in targets)
        targets = (first, second)
    if data["reason"] is not None and data["reason"] not in get_args(Reason):
        raise ValueError(data["reason"])
    return Detection(
        (int(width), int(height)),
        targets,
        float(data["score"]),
        data["reason"],
        tuple(str(doubt) for doubt in data["doubts"]),
        str(data["sentence"]),
        tuple(_detection(one) for one in data["alternatives"]),
    )


def _corner_json(corner: Corner) -> dict[str, Any]:
    values = {one.name: getattr(corner, one.name) for one in fields(Corner)}
    return {
        name: value.tolist() if hasattr(value, "tolist") else value
        for name, value in values.items()
    }


def _corner(data: dict[str, Any]) -> Corner:
    values: dict[str, Any] = {
        name: np.array(value, dtype=np.float64) if isinstance(value, list) else value
        for name, value in data.items()
    }
    return Corner(**values)
