"""Points of cameras that are not in step are shifted before they are matched or measured, and those
of cameras that were counted apart are paired as they were counted."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from stereocal.errors import StereocalError
from stereocal.field.checking.new_images import NewImages, images_of_bars
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.parameter_file import refined_parameters
from stereocal.fit.start.free_baseline import with_rough_baseline
from stereocal.fit.timing.out_of_step import with_offset_if_out_of_step
from stereocal.formats.dataset_files import read_recording
from stereocal.formats.point_answers import layout_of
from stereocal.formats.point_layouts import OURS
from stereocal.library.tables import match
from stereocal.matching.application import points_by_camera
from stereocal.matching.in_step import SHIFT, pairs_in_step, points_in_step
from stereocal.matching.match_tables import match_tables
from stereocal.matching.measure_tables import measure_tables
from stereocal.matching.point_table import PointTable
from stereocal.matching.settled import Stated
from stereocal.rig.camera import CAMERAS
from stereocal.rig.correspondences import PIXELS, Correspondences
from stereocal.rig.pair import Pair
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import Rig
from stereocal.rig.tracks import MeasuredOffset, TimeOffset
from tests.fit.test_time_offset import moving
from tests.rigs import known_rig as rig
from tests.rigs.moving_bar import move_bar, record

LATE = 0.7
PAIR = ("1", "2")


@pytest.fixture(scope="module")
def late() -> RigParameters:
    """The true rig, with the offset."""
    plain = RigParameters(rig.PRIMARY, rig.SECONDARY, rig.RIG, "refined", 0.0, {}, {})
    offset = MeasuredOffset(LATE, sigma=0.001)
    return replace(plain, matching_threshold_px=1.5, time_offset=offset)


def test_tables_on_disk_are_the_same(late: RigParameters, tmp_path: Path) -> None:
    points = points_by_camera(moving(LATE).recording)
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


def _pairs(dataset: Pair) -> pd.DataFrame:
    """The points of both cameras side by side, with their numbers as recorded."""
    rows = dataset.correspondences
    pairs = pd.DataFrame(np.hstack([rows.primary, rows.secondary]), columns=list(PIXELS))
    return pairs.assign(frame=rows.frame, time_frame=rows.time_frame, end=rows.target)


def test_pairs_from_elsewhere_are_shifted_when_they_are_measured(
    late: RigParameters, tmp_path: Path
) -> None:
    _pairs(moving(LATE)).sort_values("frame").to_csv(tmp_path / "pairs.csv", index=False)
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


@cache
def _bars(first: int, last: int, later: int = 0) -> Pair:
    """Bars of the real recording; the second camera's frames are numbered `later` too high. Their
    baseline is free: the lengths of those in `_parameters` give it."""
    whole = read_recording("sample_data/rig").of_cameras(PAIR)
    kept = whole.where((whole.frame >= first) & (whole.frame < last))
    return kept.counted_from({"2": later}).pair(*PAIR)


@cache
def _parameters() -> RigParameters:
    """Of bars whose second camera was numbered one too high."""
    bars = with_rough_baseline(_bars(0, 100, later=1))
    fit, _ = with_offset_if_out_of_step(bars, RefineSettings())
    return refined_parameters(fit)


def _errors(images: NewImages) -> float:
    return float(np.median(images.errors_with(_parameters())[0]))


def test_whole_frames_of_an_offset_are_a_count() -> None:
    found = _parameters()
    assert found.start_frame == -1
    assert found.time_offset is not None
    assert abs(found.time_offset.frames) < 0.05
    assert RigParameters.loads(found.dumps()).start_frame == -1


def test_a_file_of_an_older_version_is_read_alike() -> None:
    data = json.loads(_parameters().dumps())
    del data["start_frames"]
    data["time_offset_frames"]["value"] -= 1.0
    found = RigParameters.loads(json.dumps(data))
    assert found.start_frame == -1
    assert found.time_offset is not None
    assert found.time_offset.frames == pytest.approx(_parameters().time_offset.frames)  # type: ignore[union-attr]


@pytest.mark.parametrize("later", [0, 1])
def test_new_bars_are_taken_as_they_were_counted(later: int) -> None:
    """Shifted by a frame, the bars of `later` 0 were 20 px off."""
    assert _errors(images_of_bars(_bars(300, 420, later), _parameters())) < 1.0


def _tables(later: int, first: int = 300, last: int = 420) -> list[pd.DataFrame]:
    points = points_by_camera(_bars(first, last).recording).values()
    one, other = (own[["frame", "u", "v"]] for own in points)
    return [one, other.assign(frame=other["frame"] + later)]


@pytest.mark.parametrize("later", [0, 1, -37])
def test_unlabelled_points_tell_how_they_were_counted(later: int) -> None:
    primary, secondary = _tables(later)
    found, notes = moved(_parameters(), primary, secondary)
    np.testing.assert_array_equal(found["frame"], primary["frame"])
    assert notes


def test_points_that_do_not_tell_are_refused() -> None:
    primary, _ = _tables(0, 0, 60)
    _, secondary = _tables(0, 400, 460)
    with pytest.raises(StereocalError):
        moved(_parameters(), primary, secondary)


@pytest.mark.parametrize("fast", [0, 1])
def test_points_of_twice_the_frame_rate_are_paired(fast: int) -> None:
    """Frames in between have points too, of a later motion."""
    tables = _tables(-37, 300, 400)
    expected = tables[0]["frame"] * (1 + (fast == 0))
    twice = tables[fast].assign(frame=2 * tables[fast]["frame"])
    between = tables[fast].shift(-1, fill_value=100.0).assign(frame=twice["frame"] + 1)
    tables[fast] = pd.concat([twice, between])
    found, notes = moved(_parameters(), *tables)
    assert f"is frame {(2.0, 0.5)[fast]:g} k" in notes[0]
    np.testing.assert_array_equal(found["frame"], expected)


@pytest.mark.parametrize("later", [0, 1])
def test_pairs_are_measured_as_they_were_counted(later: int) -> None:
    pairs = _pairs(_bars(300, 420, later))
    found = pd.concat(list(pairs_in_step(PointTable(pairs, PIXELS), _parameters())[0].blocks()))
    kept = found[found["time_shift_frames"] != 0.0]
    pixels = kept[list(PIXELS)].to_numpy()
    errors = np.abs(_parameters().epipolar_errors(pixels[:, :2], pixels[:, 2:]))
    assert len(kept) > 100
    assert np.median(errors) < 1.0


@pytest.mark.parametrize("column", ["frame", "camera_frame"])
def test_tables_of_the_calibrated_recording_are_matched_by_its_count(
    tmp_path: Path, column: str
) -> None:
    paths = [tmp_path / "primary.csv", tmp_path / "secondary.csv"]
    for path, table in zip(paths, _tables(later=1), strict=True):
        table.rename(columns={"frame": column}).to_csv(path, index=False)
        assert layout_of(path.read_bytes(), path.name).program == OURS
    read = [PointTable(path) for path in paths]
    tables: dict[str, PointTable] = dict(zip(CAMERAS, read, strict=True))
    report = match_tables(_parameters(), tables, tmp_path / "pairs.csv", Stated(2.0))
    assert any("frame 0 of the secondary is frame -1" in note for note in report.notes)
    assert len(pd.read_csv(tmp_path / "pairs.csv")) > 150
