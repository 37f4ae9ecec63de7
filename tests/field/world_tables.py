"""Tables that a world frame is found from, as people write them."""

from collections.abc import Sequence

import pandas as pd

from stereocal.field.world.frame import Line, Survey, Throw

PIXELS = ["u_primary", "v_primary", "u_secondary", "v_secondary"]


def lines_csv(lines: Sequence[Line]) -> bytes:
    rows = [
        {"line": line.name, "kind": line.kind, **dict(zip(names, pixel, strict=True))}
        for line in lines
        for side, names in zip(line.pixels, (PIXELS[:2], PIXELS[2:]), strict=True)
        for pixel in side
    ]
    return pd.DataFrame(rows).to_csv(index=False).encode()


def survey_csv(survey: Survey) -> bytes:
    table = pd.DataFrame(survey.world_m, columns=["x", "y", "z"])
    table.insert(0, "point", survey.names)
    table[PIXELS] = survey.pixels
    return table.to_csv(index=False).encode()


def throw_csv(throw: Throw) -> bytes:
    table = pd.DataFrame(throw.pixels, columns=PIXELS)
    table.insert(0, "frame", throw.frames)
    table["throw"] = throw.tracks
    return table.to_csv(index=False).encode()
