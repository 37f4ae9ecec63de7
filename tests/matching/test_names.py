"""Points that have names in both cameras: names decide, and the images check the names."""

from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

from stereocal.cli import main
from stereocal.library.tables import match
from stereocal.matching.application import read_result
from stereocal.matching.match_tables import match_tables
from stereocal.matching.measure_tables import measure_tables
from stereocal.matching.point_table import PointTable
from stereocal.matching.settled import Stated
from stereocal.matching.tables_by_camera import Report
from stereocal.rig.camera import CAMERAS
from stereocal.rig.correspondences import PIXELS
from stereocal.system.csv_text import csv_text
from stereocal.system.names import JoinedNames
from tests.further import further
from tests.matching.test_point_noise import FILE, seen
from tests.refused import refused

CASE = Path(__file__).parents[1] / "cases" / "named_points"
LAYOUTS = {
    "deeplabcut": ("dlc_left.csv", "dlc_right.csv"),
    "sleap": ("sleap_left.csv", "sleap_right.csv"),
    "dltdv8": 2 * ("dltdv8_xypts.csv",),
    "argus": 2 * ("argus_xypts.csv",),
}
FRAMES, POINTS = 30, 6
Tables = tuple[pd.DataFrame, pd.DataFrame]


@pytest.fixture(scope="module")
def tables() -> Tables:
    """Points of 0.3 px with a name in both cameras; a tenth is missing in either."""
    first, second = seen(0.3, FRAMES, POINTS)
    return tuple(  # type: ignore[return-value]
        each.assign(bodypart="part " + each["bird"].astype(str)).rename(columns={"bird": "truth"})
        for each in (first, second)
    )


def reported(folder: Path, tables: Tables, names: str = "auto") -> tuple[Report, pd.DataFrame]:
    given: dict[str, PointTable] = {
        which: PointTable(own) for which, own in zip(CAMERAS, tables, strict=True)
    }
    report = match_tables(FILE, given, folder / "pairs.csv", Stated(names=names))
    return report, pd.read_csv(folder / "pairs.csv")


@pytest.mark.parametrize("layout", [*LAYOUTS][:1] + further(*[*LAYOUTS][1:]))
def test_eight_points_of_an_animal(layout: str, tmp_path: Path) -> None:
    """60 frames of an animal of 10 cm, points of 0.8 px: without names, 131 of 476 are wrong."""
    out = tmp_path / "pairs.csv"
    cameras = ["--cameras", "1,2"] * (layout in ("dltdv8", "argus"))
    files = [str(CASE / name) for name in LAYOUTS[layout]]
    given = ["--parameters", str(CASE / "parameters.json"), "--out", str(out), *cameras]
    assert main(["match", *files, "--layout", layout, *given]) == 0
    pairs = pd.read_csv(out)
    assert len(pairs) == 480 and not pairs["ambiguous"].any()
    assert (pairs["point_primary"] == pairs["point_secondary"]).all()
    assert pairs["within_threshold"].mean() > 0.95  # 0.987 by the noise
    # Of 960 coordinates with a noise of 0.8 px; measured 0.80.
    assert pairs["sigma_primary_px"].iloc[0] == pytest.approx(0.8, rel=0.08)
    assert main(["match", *files, "--layout", layout, *given, "--names", "none"]) == 0
    pairs = pd.read_csv(out)
    assert (pairs["point_primary"] != pairs["point_secondary"]).sum() == 131


@pytest.mark.parametrize("spelled", [str.capitalize, lambda name: f"{name[:2]}_{name[2:]} "])
def test_capitals_and_blanks_do_not_tell_names_apart(
    spelled: Callable[[str], str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With other names, 131 of the pairs were of different points; `gillet` is in one table."""
    table = (CASE / "dlc_right.csv").read_text().splitlines()
    names = [spelled(name) for name in table[1].split(",")[1:]]
    table[1] = ",".join(["bodyparts", *names])
    (tmp_path / "right.csv").write_text("\n".join(table))
    left = (CASE / "dlc_left.csv").read_text()

    def pairs_of(left: str) -> pd.DataFrame:
        (tmp_path / "left.csv").write_text(left)
        files = [str(tmp_path / "left.csv"), "--layout", "deeplabcut", str(tmp_path / "right.csv")]
        given = ["--parameters", str(CASE / "parameters.json"), "--out", str(tmp_path / "out.csv")]
        assert main(["match", *files, *given]) == 0
        return pd.read_csv(tmp_path / "out.csv")

    pairs = pairs_of(left)
    assert len(pairs) == 480
    assert (pairs["point_primary"].map(spelled).str.strip() == pairs["point_secondary"]).all()
    assert "Only" not in capsys.readouterr().out
    pairs_of(left.replace("gill", "gillet"))
    said = capsys.readouterr().out
    assert "gillet" in said and spelled("gill").strip() in said


def test_names_that_one_table_tells_apart_stay_apart() -> None:
    joined = JoinedNames.of([["a", "A", "left wing", "12", "x"], ["a", "Left_Wing", "1_2", "X"]])
    assert joined.alike == {"Left_Wing": "left wing", "X": "x"}
    assert joined.apart == (("a", "A"),) and joined.alone == ("A", "12", "1_2")


def test_a_name_that_one_camera_sees_has_no_partner(tables: Tables) -> None:
    pairs = match(FILE, *tables)
    both = tables[0].merge(tables[1], on=["frame", "bodypart"])
    assert len(pairs) == len(both) < min(map(len, tables))
    assert (pairs["bodypart_primary"] == pairs["bodypart_secondary"]).all()


def test_points_without_a_name_are_matched_by_the_images(tables: Tables) -> None:
    """Part 0 has a name of its own in each camera, part 1 has none."""
    first, second = (
        each.assign(bodypart=each["bodypart"].replace({"part 0": own, "part 1": ""}))
        for each, own in zip(tables, ("nose", "snout"), strict=True)
    )
    pairs = match(FILE, first, second)
    of_both = pairs["truth_primary"] == pairs["truth_secondary"]
    unnamed = pairs["truth_primary"] < 2
    assert of_both[~unnamed].all()
    # 54 of 60 are seen by both; measured: 51 pairs, of these 49 right.
    assert unnamed.sum() > 40 and of_both[unnamed].mean() > 0.9


def test_two_animals_share_the_names_of_their_parts(tables: Tables) -> None:
    first, second = (
        each.assign(bodypart=(each["truth"] // 2).map({0: "head", 1: "back", 2: "tail"}))
        for each in tables
    )
    pairs = match(FILE, first, second)
    assert (pairs["bodypart_primary"] == pairs["bodypart_secondary"]).all()
    # Of two of a name the images decide; measured: 0.99 right, without names 0.96.
    assert (pairs["truth_primary"] == pairs["truth_secondary"]).mean() > 0.97


def test_tracks_that_each_camera_counts_for_itself_do_not_decide(
    tables: Tables, tmp_path: Path
) -> None:
    first, second = (each.drop(columns="bodypart") for each in tables)
    first, second = first.assign(track=first["truth"]), second.assign(track=second["truth"])
    report, pairs = reported(tmp_path, (first, second))
    assert report.names.columns == ("track",) and "within_threshold" in pairs
    other = second.assign(track=(second["truth"] + 1) % POINTS)
    report, pairs = reported(tmp_path, (first, other))
    assert report.names.columns == () and "within_threshold" not in pairs
    assert (pairs["truth_primary"] == pairs["truth_secondary"]).mean() > 0.95
    assert any("track do not fit the images" in note for note in report.notes)
    report, pairs = reported(tmp_path, (first, other), "track")
    assert (pairs["track_primary"] == pairs["track_secondary"]).all()


def test_names_stay_text_from_the_points_to_what_is_read_of_them(
    tables: Tables, tmp_path: Path
) -> None:
    """1 and 1.0 are two tracks; a name that a spreadsheet would run is written harmlessly."""
    called = ["1", "1.0", "v1", "v1.0", "=cmd", "-x"]
    given: dict[str, PointTable] = {}
    for which, own in zip(CAMERAS, tables, strict=True):
        named = own.assign(track=own["truth"].map(dict(enumerate(called))))
        path = tmp_path / f"{which}.csv"
        named.drop(columns=["bodypart", "truth"]).to_csv(path, index=False)
        given[which] = PointTable(path)
    pairs, points = tmp_path / "pairs.csv", tmp_path / "points.csv"
    report = match_tables(FILE, given, pairs)
    assert report.names.common == {*called}
    measure_tables(FILE, PointTable(pairs, PIXELS), points)
    for path, column in ((pairs, "track_primary"), (points, "track")):
        assert b",=cmd" not in path.read_bytes() and b",-x" not in path.read_bytes()
        found = read_result(path.read_bytes())
        assert {*found[column]} == {*called} and found["error_px"].dtype == float
        numbers = csv_text(found[found[column].isin(called[:2])])
        assert {*read_result(numbers.encode())[column]} == {"1", "1.0"}
    short = {0: "nose", 1: 201 * "x"}
    first, second = (each.assign(bodypart=each["truth"].map(short)) for each in tables)
    with refused("bodypart", "200"):
        match(FILE, first.dropna(), second.dropna())


def test_names_exchanged_in_a_camera_are_told(tables: Tables, tmp_path: Path) -> None:
    first, second = tables
    report, _ = reported(tmp_path, (first, second))
    assert not any("exchanged" in note for note in report.notes)
    late = second["frame"] >= 0.6 * FRAMES
    exchanged = {"part 0": "part 1", "part 1": "part 0"}
    names = second["bodypart"].where(~late, second["bodypart"].replace(exchanged))
    report, pairs = reported(tmp_path, (first, second.assign(bodypart=names)))
    wrong = pairs["truth_primary"] != pairs["truth_secondary"]
    assert wrong.sum() > 10
    # Two of them lie on one epipolar line by chance.
    assert (~pairs["within_threshold"][wrong]).mean() > 0.8
    assert pairs["within_threshold"][~wrong].mean() > 0.95
    (note,) = (note for note in report.notes if "exchanged" in note)
    assert "part 0" in note and "part 1" in note and "part 4" not in note


def test_points_of_other_moments_are_told_by_their_scatter(tables: Tables, tmp_path: Path) -> None:
    first, second = tables
    report, _ = reported(tmp_path, (first, second))
    assert not any("rarely noise" in note for note in report.notes)
    late = second.assign(frame=second["frame"] + 3)
    report, _ = reported(tmp_path, (first, late), "bodypart")
    assert any("rarely noise" in note for note in report.notes)


def test_a_column_that_is_not_there(tables: Tables, tmp_path: Path) -> None:
    with refused("'limb'"):
        reported(tmp_path, tables, "limb")
