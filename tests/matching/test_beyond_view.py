"""Points that a fisheye sees more than 75 degrees from its axis have no partner and no place."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from stereocal.matching.match_tables import match_tables
from stereocal.matching.measure_tables import measure_tables
from stereocal.matching.point_table import PointTable
from stereocal.rig.correspondences import PIXELS
from stereocal.rig.parameters import RigParameters
from tests.fisheye_rig import fisheye_rig


def test_points_beyond_the_view_are_counted_and_have_no_place(tmp_path: Path) -> None:
    rig = fisheye_rig(175.0)
    plain = RigParameters(rig.primary, rig.secondary, rig.pose, "refined", 0.0, {}, {})
    parameters = replace(plain, matching_threshold_px=1.0)
    angles = np.radians([40.0, 60.0, 79.0, 81.0])  # from the primary's axis
    points = np.column_stack([-np.tan(angles), np.zeros(4), np.ones(4)])
    one, two = rig.primary.project(points), rig.secondary.project(rig.pose.apply(points))
    frame = np.arange(1, 5)
    sides = dict(zip(("primary", "secondary"), (one, two), strict=True))
    tables = {
        name: PointTable(pd.DataFrame({"frame": frame, "u": own[:, 0], "v": own[:, 1]}))
        for name, own in sides.items()
    }
    report = match_tables(parameters, tables, tmp_path / "pairs.csv")
    assert report.found == 2
    assert any("2 points of the primary camera" in note for note in report.notes)
    pairs = pd.DataFrame(np.column_stack([one, two]), columns=list(PIXELS)).assign(frame=frame)
    measured = measure_tables(parameters, PointTable(pairs, PIXELS), tmp_path / "points.csv")
    found = pd.read_csv(tmp_path / "points.csv")
    np.testing.assert_allclose(found.loc[:1, ["x", "y", "z"]], points[:2], atol=1e-6)
    assert found.loc[2:, "x"].isna().all() and measured.lost == 2
    assert any("2 points of the primary camera" in note for note in measured.notes)
