"""Files that a page's commands begin with, where they are not the sample data."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.world import known_places, plumb_lines, surveyed, thrown
from stereocal.formats.exchange.exchange import export_files
from stereocal.rig.camera import Camera
from stereocal.rig.rig import Rig
from tests.archives import easywand_fields, mat, wand_csv
from tests.field.world_tables import PIXELS, lines_csv, survey_csv, throw_csv
from tests.known_rig import PRIMARY, RIG, SECONDARY


def archives(folder: Path) -> None:
    """A file of easyWand; a table of a wand with Kalibr's cameras."""
    path = folder / "flight_easyWandData.mat"
    path.write_bytes(mat({"easyWandData": easywand_fields(25)}))
    (folder / "wand.csv").write_bytes(wand_csv(25))
    # Kalibr has no k3.
    cameras = (Camera(c.K, c.distortion[:4], c.image_size) for c in (PRIMARY, SECONDARY))
    for name, content in export_files(Rig(*cameras, RIG), "kalibr").items():
        (folder / name).write_bytes(content)


def world(folder: Path) -> None:
    """Parameters, what was surveyed, and pairs."""
    place = next(known_places(1, 21))
    place.rig.save(folder / "parameters_3d.json")
    (folder / "survey.csv").write_bytes(survey_csv(surveyed(place, 5)))
    (folder / "plumb.csv").write_bytes(lines_csv(plumb_lines(place)))
    (folder / "throw.csv").write_bytes(throw_csv(thrown(place)))
    pairs = pd.DataFrame(place.images(np.array([[0.0, 0.0, 6.0]]), 0.0), columns=PIXELS)
    pairs.insert(0, "frame", [1])
    pairs.to_csv(folder / "pairs.csv", index=False)


GIVEN: dict[str, Callable[[Path], None]] = {"docs/archives.md": archives, "docs/world.md": world}
