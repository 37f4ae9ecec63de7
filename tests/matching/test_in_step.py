"""Points of cameras that are not in step are shifted before they are matched or measured."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from stereocal.library.tables import match
from stereocal.matching.application import points_by_camera
from stereocal.matching.in_step import points_in_step
from stereocal.matching.match_tables import match_tables
from stereocal.matching.measure_tables import measure_tables
from stereocal.matching.own_count import SHIFT
from stereocal.matching.pairs import Stated
from stereocal.matching.point_table import PointTable
from stereocal.rig.camera import CAMERAS
from stereocal.rig.correspondences import PIXELS, Correspondences
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import Rig
from stereocal.rig.tracks import MeasuredOffset, TimeOffset
from tests import known_rig as rig
from tests.refined.test_time_offset import moving
from tests.rigs.moving_bar import move_bar, record

LATE = 0.7


@pytest.fixture(scope="module")
def late() -> RigParameters:
    """The true rig, with the offset."""
    plain = RigParameters(rig.PRIMARY, rig.SECONDARY, rig.RIG, "refined", 0.0, {}, {})
    offset = MeasuredOffset(LATE, sigma=0.001)
    return replace(plain, matching_threshold_px=1.5, time_offset=offset)


def test_tables_on_disk_are_the_same(late: RigParameters, tmp_path: Path) -> None:
    points = points_by_camera(moving(LATE))
    tables = {}
    for which, table in points.items():
        table.to_csv(tmp_path / f"{which}.csv", index=False)
        tables[which] = PointTable(tmp_path / f"{which}.csv")
    lost = tmp_path / "lost.csv"
    match_tables(late, tables, tmp_path / "pairs.csv", Stated(1e-3), lost)
    assert SHIFT in pd.read_csv(lost)  # so that they are not shifted once more
    report = match_tables(late, tables, tmp_path / "pairs.csv")
    assert any("were shifted in time by 0.700 frames" in note for note in report.notes)
    found = pd.read_csv(tmp_path / "pairs.csv")
    np.testing.assert_allclose(
        found[list(PIXELS)],
        match(late, points["primary"], points["secondary"])[list(PIXELS)],
        atol=1e-9,
    )
    measured = measure_tables(
        late, PointTable(tmp_path / "pairs.csv", PIXELS), tmp_path / "points.csv"
    )
    assert not any("shifted" in note for note in measured.notes)


def test_pairs_from_elsewhere_are_shifted_when_they_are_measured(
    late: RigParameters, tmp_path: Path
) -> None:
    rows = moving(LATE).correspondences
    pairs = pd.DataFrame(
        np.column_stack([rows.primary, rows.secondary]), columns=list(PIXELS)
    ).assign(frame=rows.frame, time_frame=rows.time_frame, end=rows.target)
    pairs.sort_values("frame").to_csv(tmp_path / "pairs.csv", index=False)
    report = measure_tables(
        late, PointTable(tmp_path / "pairs.csv", PIXELS), tmp_path / "points.csv"
    )
    assert "were shifted in time" in report.notes[0]
    assert pd.read_csv(tmp_path / "points.csv")["error_px"].median() < 0.3


def moved(
    rig: RigParameters, primary: pd.DataFrame, secondary: pd.DataFrame
) -> tuple[pd.DataFrame, list[str]]:
    """The points of the secondary in step with the primary's, and what was done."""
    tables, notes = points_in_step(rig, dict(zip(CAMERAS, (primary, secondary), strict=True)))
    return tables["secondary"], notes["secondary"]


def _named(rows: Correspondences) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The points of both cameras by their numbers as recorded, with the names of both ends."""
    one, other = (
        pd.DataFrame({"frame": rows.time_frame, "u": own[:, 0], "v": own[:, 1], "end": rows.target})
        for own in (rows.primary, rows.secondary)
    )
    return one, other


def test_the_offset_of_the_points_themselves_is_used(late: RigParameters) -> None:
    """That of the calibrated recording leaves an error of 0.3 frames."""
    one, other = _named(moving(LATE).correspondences)
    assert late.time_offset is not None
    kept, (note,) = moved(late, one, other)
    assert "themselves" not in note
    another = replace(late, time_offset=replace(late.time_offset, frames=LATE - 0.3))
    found, (note,) = moved(another, one, other)
    assert "themselves" in note
    np.testing.assert_allclose(found["u"], kept["u"], atol=0.2)
    np.testing.assert_allclose(found[SHIFT].median(), LATE, atol=0.02)


def test_points_in_step_but_for_their_noise_get_no_offset_of_their_own(late: RigParameters) -> None:
    """Of 60 recordings, 5 got one from standard errors that were 2.3 times too small."""
    told = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        bar = move_bar(Rig(rig.PRIMARY, rig.SECONDARY, rig.RIG), rng, 60, rig.BAR_M, (4.0, 10.0))
        rows = record(bar, rng, 2.0, "noisy", TimeOffset(LATE)).correspondences
        told += [note for note in moved(late, *_named(rows))[1] if "themselves" in note]
    assert not told
