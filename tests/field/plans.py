"""Plans for tests."""

import json
from dataclasses import replace
from typing import Any

from stereocal.field.planning.plan import AimedPose, Plan, SensorLens
from stereocal.formats.plan_file import write_plan

LENS = SensorLens(50.0, (16.352, 12.096), (2336, 1728))
FIELD = Plan("field", LENS, LENS, AimedPose(4.5, 10.0, 0.2), 8.0, 25.0, 0.9)


def plan(**changes: Any) -> Plan:
    """The field day of the paper, with changes."""
    return replace(FIELD, **changes)


def contents(**changes: Any) -> dict[str, Any]:
    """The same as the content of a file; a key with None is left out."""
    found = json.loads(write_plan(FIELD)) | changes
    return {key: value for key, value in found.items() if value is not None}
