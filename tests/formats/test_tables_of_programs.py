"""Tables as programs and people write them: one recording of 25 bars, read as the same points."""

import io
import itertools
import sys
import zipfile
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from stereocal.cli import main
from stereocal.formats.archives.archive import Archive
from stereocal.formats.archives.gather import gather
from stereocal.formats.camera_file import write_camera
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.point_text import point_text
from stereocal.formats.recognition import recognise
from stereocal.matching.point_table import PointTable
from stereocal.rig.camera import Camera
from tests.archives import CASES, case
from tests.files import zipped
from tests.refused import refused

K = np.array([[1500.0, 0.0, 960.0], [0.0, 1500.0, 540.0], [0.0, 0.0, 1.0]])
LENS = write_camera(Camera(K, np.zeros(5), (1920, 1080)))
LENSES = {"left.json": LENS, "right.json": LENS}
XY = pd.read_csv(CASES / "caliscope_xy" / "xy.csv")
POINTS = XY[["sync_index", "port", "point_id", "img_loc_x", "img_loc_y"]].set_axis(
    ["frame", "camera", "target", "x", "y"], axis=1
)
FIRST = ([1384.977, 812.189], [678.280, 799.834])
"""End A in the first frame, in both cameras."""
SIDES = ("left", "right")


def read(files: dict[str, bytes], **options: Any) -> Archive:
    return gather(files | LENSES, ExchangeOptions(**options))


def check(files: dict[str, bytes], first_frame: int = 0, rounded_to: float = 0.006) -> None:
    """All 50 pairs of points are read, with the end A where it was."""
    found = read(files).correspondences
    assert found is not None and (len(found), len(found.bars)) == (50, 25)
    assert found.frame[0] == first_frame
    for side, expected in zip((found.primary, found.secondary), FIRST, strict=True):
        np.testing.assert_allclose(side[0], expected, rtol=0, atol=rounded_to)


def of(camera: int, target: int | None = None) -> pd.DataFrame:
    """The points of one camera, or of one end in it."""
    chosen = POINTS[POINTS["camera"] == camera]
    return chosen if target is None else chosen[chosen["target"] == target]


def wide(header: str, sep: str = ",", end: str = "") -> str:
    """A row for each frame, with both ends in both cameras; pixels from 1, as DLTdv8's."""
    ends = list(itertools.product((0, 1), (0, 1)))
    columns = [of(c, p)[["x", "y"]].to_numpy() + 1.0 for p, c in ends]
    names = [header.format(p="AB"[p], c=c + 1, a=a) for p, c in ends for a in "UV"]
    rows = [names, *np.hstack(columns).round(3).astype(str).tolist()]
    return "".join(f"{sep.join(row)}{end}\n" for row in rows)


@pytest.mark.parametrize("name", ["trailing_sep.csv", "title_line.csv"])
def test_a_wand_with_a_title_or_separators_at_the_ends_of_rows(name: str) -> None:
    check(case("wand_trailing_separator", name), first_frame=1)


@pytest.mark.parametrize(
    "title", ["", "My trial\n", "My trial,,,,,,,,\n2024,3,,,,,,,\n", "My trial\n\n"]
)
@pytest.mark.parametrize("end", ["", ",", ",,,"])
def test_titles_and_empty_columns_hide_no_program(title: str, end: str) -> None:
    """Read as any table with named columns, DLTdv8's would be off by a pixel."""
    check({"xypts.csv": (title + wide("{p}_cam{c}_{a}", end=end)).encode()}, first_frame=1)


def test_a_cell_behind_empty_columns_is_named() -> None:
    (table,) = case("wand_trailing_separator", "trailing_sep.csv").values()
    with refused("line 25", "9 cells"):
        read({"wand.csv": table.rstrip() + b"7\n"})


@pytest.mark.parametrize("names", ["kinovea", "trackpy"])
def test_a_table_for_each_camera_whose_points_are_its_tracks(names: str) -> None:
    check(case("tables_per_camera", *(f"{names}_{side}.csv" for side in SIDES)))


def test_tracker_writes_the_names_of_tracks_above_their_columns() -> None:
    files = {}
    for camera, side in enumerate(SIDES):
        ends = np.hstack([of(camera, p)[["x", "y"]] for p in (0, 1)])
        rows = ["\t".join(map(str, [f"{k / 30:.3f}", *row, ""])) for k, row in enumerate(ends)]
        head = "#multi:\n\tcm A\t\tcm B\t\t\nt\tx\ty\tx\ty\t\n"
        files[f"{side}.txt"] = (head + "\n".join(rows)).encode()
    check(files)


def test_times_between_frames_are_named() -> None:
    left, right = case("tables_per_camera", "kinovea_left.csv", "kinovea_right.csv").values()
    with refused("kinovea_right.csv", "line 6", "72.00", "16.68"):
        read({"kinovea_left.csv": left, "kinovea_right.csv": right.replace(b"66.72;", b"72.00;")})


@pytest.mark.parametrize(
    "called",
    ["{p}_{s}", "end{p}_cam{c}", "{s}_{p}", "cam{c}-{p}", "C01_{t}_{S}", "kamera{c}ende{n}"],
)
@pytest.mark.parametrize("order", [1, -1])
def test_a_table_for_each_end_and_camera(called: str, order: int) -> None:
    files = {}
    for c, p in [*itertools.product((0, 1), (0, 1))][::order]:
        name = called.format(
            p="AB"[p], c=c + 1, s=SIDES[c], S=SIDES[c].upper(), t=("end", "tip")[p], n=p + 1
        )
        files[f"{name}.csv"] = of(c, p)[["frame", "x", "y"]].to_csv(index=False).encode()
    check(files)


def test_names_of_tables_that_do_not_tell_end_and_camera_are_asked_about() -> None:
    files = {
        f"{'AB'[p]}{c + 1}.csv": of(c, p)[["frame", "x", "y"]].to_csv(index=False).encode()
        for c, p in itertools.product((0, 1), (0, 1))
    }
    with refused(*files, "A_left.csv"):
        read(files)


def test_a_table_for_each_end_with_both_cameras() -> None:
    files = {}
    for p in (0, 1):
        table = np.column_stack([of(0, p)[["frame", "x", "y"]], of(1, p)[["x", "y"]]])
        names = ["frame", "left_x", "left_y", "right_x", "right_y"]
        files[f"{'AB'[p]}.csv"] = pd.DataFrame(table, columns=names).to_csv(index=False).encode()
    check(files)


def test_caliscope_counts_instants_by_sync_index() -> None:
    check(case("caliscope_xy", "xy.csv"))
    new = XY.rename(columns={"port": "cam_id", "point_id": "keypoint_id"})
    check({"xy_CHARUCO.csv": new.to_csv(index=False).encode()})


def test_openlpt_has_raw_detections_too() -> None:
    (table,) = case("openlpt", "wand_points.csv").values()
    check({"wand_points.csv": table})
    rows = pd.read_csv(io.BytesIO(table))
    raw = rows.assign(Status="Raw", X=rows["X"] + 3.0)
    both = pd.concat([raw, rows]).sort_values("Frame", kind="stable")
    check({"wand_points.csv": both.to_csv(index=False).encode()})
    stated = read(
        {"wand_points.csv": both.to_csv(index=False).encode()}, roles="frame,camera,-,target,x,y"
    )
    assert stated.correspondences is not None and len(stated.correspondences.bars) == 25
    ends = rows["PointIdx"].map({0: "Filtered_Large", 1: "Filtered_Small"})
    both = pd.concat([raw, rows.assign(Status=ends, PointIdx=0)])
    check({"wand_points.csv": both.to_csv(index=False).encode()})


class TestThousands:
    @pytest.mark.parametrize("sign", [b".", b","])
    def test_in_whole_pixels_are_asked_about(self, sign: bytes) -> None:
        (table,) = case("thousands_whole", "thousands_whole_german.csv").values()
        with refused("line 2", "left_A_x", f"1{sign.decode()}385", "1385"):
            read({"german.csv": table.replace(b".", sign)})

    @pytest.mark.parametrize("sep", [",", ";"])
    def test_sub_pixel_data_with_three_decimals_are_read(self, sep: str) -> None:
        table = POINTS.to_csv(index=False, sep=sep, float_format="%.3f")
        check({"p.csv": (table.replace(".", ",") if sep == ";" else table).encode()})

    @pytest.mark.parametrize(
        ("other", "is_read"), [("1.204", False), ("1.2", True), ("120.25", True)]
    )
    def test_in_points_to_match(self, other: str, is_read: bool, tmp_path: Path) -> None:
        path = tmp_path / "points.csv"
        path.write_text(f"frame;u;v\n1;1.385;812\n2;{other};733\n")
        if is_read:
            assert PointTable(path).check().largest[1] == 812.0
            return
        with refused("line 2", "1.385"):
            PointTable(path).check()


def test_capitals_and_blanks_do_not_tell_ends_apart() -> None:
    ends = {(0, 0): "A tip", (0, 1): "B tip", (1, 0): "a_tip", (1, 1): "b-Tip "}
    named = [ends[k] for k in zip(POINTS["camera"], POINTS["target"], strict=True)]
    check({"p.csv": POINTS.assign(target=named).to_csv(index=False).encode()})
    third = pd.DataFrame([[0, 0, "Nose", 5, 5], [0, 1, "A", 5, 5], [0, 1, "a", 7, 7]])
    rows = pd.concat([POINTS.assign(target=named), third.set_axis(POINTS.columns, axis=1)])
    remarks = " ".join(read({"p.csv": rows.to_csv(index=False).encode()}).remarks)
    assert "Only 0 has the name Nose" in remarks and "A and a are of different points" in remarks


@pytest.mark.parametrize("title", ["frame", "time_ns", "timestamp_ns", "Stamp"])
def test_time_stamps_in_nanoseconds_are_frames(title: str, tmp_path: Path) -> None:
    """Of 19 digits: a float of 64 bits holds every 256th of them."""
    stamps = 1_718_000_000_016_683_001 + 33_366_700 * POINTS["frame"].astype(np.int64)
    table = POINTS.assign(frame=stamps).rename(columns={"frame": title}).to_csv(index=False)
    check({"p.csv": table.encode()}, first_frame=1_718_000_000_016_683_001)
    files = {"p.csv": table.encode(), **LENSES}
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    paths = [str(tmp_path / name) for name in files]
    out = tmp_path / "set"
    between = [paths[0], "--distance", "0.5", paths[1], "--baseline", "1.2", paths[2]]
    assert main(["import", *between, "--out", str(out)]) == 0  # options between files
    frames = pd.read_csv(out / "correspondences.csv")["frame"]
    assert [*frames.unique()] == [*stamps.unique()]


class TestExcel:
    """The second sheet of two; the first has notes."""

    @staticmethod
    def book(edit: Callable[[Any], object] = lambda _: None, title: bool = False) -> bytes:
        openpyxl = pytest.importorskip("openpyxl")
        book = openpyxl.Workbook()
        book.active.append(["Recorded by me", datetime(2024, 5, 1)])
        sheet = book.create_sheet("Points")
        if title:
            sheet.append(["Recorded", datetime(2024, 5, 1)])
            sheet.append([])
        for row in [[*POINTS.columns], *POINTS.astype(object).to_numpy().tolist()]:
            sheet.append(row)
        edit(sheet)
        packed = io.BytesIO()
        book.save(packed)
        return packed.getvalue()

    @pytest.mark.parametrize("title", [True, False])
    def test_the_first_sheet_with_points_is_read(self, title: bool) -> None:
        content = self.book(title=title)
        assert recognise("table.xlsx", content).kind == "table"
        check({"table.xlsx": content})
        assert recognise("day.zip", zipped({"table.xlsx": content})).kind == "zip"

    @pytest.mark.parametrize(
        ("cell", "value"), [("D7", datetime(2024, 5, 1)), ("E9", "=D9+1"), ("A3", "=A2")]
    )
    def test_dates_and_formulas_are_named_by_their_cells(self, cell: str, value: object) -> None:
        with refused("table.xlsx", "Points", cell):
            read({"table.xlsx": self.book(lambda sheet: sheet.__setitem__(cell, value))})

    def test_a_column_of_dates_is_no_column_of_points(self) -> None:
        def add(sheet: Any) -> None:
            for row in range(2, len(POINTS) + 2):
                sheet[f"F{row}"] = datetime(2024, 5, 1)

        check({"table.xlsx": self.book(add)})

    def test_what_cannot_be_read(self, monkeypatch: pytest.MonkeyPatch) -> None:
        content = self.book()
        with refused("t.xlsx", "zip"):
            read({"t.xlsx": content[:-50]})
        monkeypatch.setenv("STEREOCAL_MOST_RATIO", "1")
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as bomb:
            bomb.writestr("xl/workbook.xml", bytes(20_000_000))
        with refused("t.xlsx", "STEREOCAL_MOST_RATIO"):
            point_text(packed.getvalue(), "t.xlsx")
        monkeypatch.setitem(sys.modules, "openpyxl", None)
        with refused("t.xlsx", "pip install openpyxl", "CSV"):
            point_text(content, "t.xlsx")
