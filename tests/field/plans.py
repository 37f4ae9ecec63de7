"""Plans for tests."""

from dataclasses import replace
from typing import Any

from stereocal.field.planning.plan import AimedPose, Plan, SensorLens

LENS = SensorLens(50.0, (16.352, 12.096), (2336, 1728))
FIELD = Plan("field", LENS, LENS, AimedPose(4.5, 10.0, 0.2), 8.0, 25.0, 0.9)


def plan(**changes: Any) -> Plan:
    """The field day of the paper, with changes."""
    return replace(FIELD, **changes)


def contents(**changes: Any) -> dict[str, Any]:
    """The same as the content of a file; a key with None is left out."""
    lens = {"focal_mm": 50.0, "sensor_mm": [16.352, 12.096], "image_size": [2336, 1728]}
    found: dict[str, Any] = {
        "format": "stereocal-plan/1",
        "name": "field",
        "cameras": {"primary": lens, "secondary": lens},
        "pose": {"baseline_m": 4.5, "toe_in_deg": 10.0, "height_difference_m": 0.2},
        "volume": {"near_m": 8.0, "far_m": 25.0},
        "bar_m": 0.9,
        "frames": 25,
        "noise_px": 0.2,
        "uncertainty": {"focal": 0.003, "centre_px": 5.0, "baseline_m": 0.005, "bar_m": 0.0005},
    }
    found |= changes
    return {key: value for key, value in found.items() if value is not None}
