"""Tables whose columns a person or a spreadsheet named: one recording written in many ways."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from stereocal.cli import main
from stereocal.formats.archives.all_cameras import gather_all
from stereocal.formats.archives.gather import bars_of
from stereocal.formats.camera_file import write_camera
from stereocal.formats.column_roles import parse_roles, propose_roles, roles_text
from stereocal.formats.correspondences_csv import read_table
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.point_answers import answered, first_answers, layout_of
from stereocal.formats.point_files import read_points
from stereocal.rig.correspondences import Correspondences
from tests.refused import refused
from tests.rigs.known_rig import PRIMARY, SECONDARY, dataset

ROWS = dataset(8, noise_px=0.5).correspondences
SIDES = (ROWS.primary, ROWS.secondary)
TARGET = np.array(["A", "B"])[ROWS.target]
AXES = ("x", "y")
Written = Callable[[str, str], bytes]


def per_target(names: tuple[str, str], titles: tuple[str, str], header: str) -> bytes:
    """A row for each target; `header` of a coordinate by camera and axis."""
    table = pd.DataFrame({titles[0]: ROWS.frame, titles[1]: TARGET})
    for name, side in zip(names, SIDES, strict=True):
        for axis, own in zip(AXES, side.T, strict=True):
            table[header.format(c=name, a=axis)] = own
    return table.to_csv(index=False).encode()


def per_frame(names: tuple[str, str], header: str, frame: str | None = None) -> bytes:
    """A row for each frame."""
    table = {}
    for name, side in zip(names, SIDES, strict=True):
        for target in "AB":
            for axis, own in zip(AXES, side[target == TARGET].T, strict=True):
                table[header.format(c=name, a=axis, t=target)] = own
    found = pd.DataFrame(table)
    if frame:
        found.insert(0, frame, ROWS.frame[TARGET == "A"])
    return found.to_csv(index=False).encode()


def per_point(titles: str, names: tuple[str, str], photo: str = "{}", sep: str = ",") -> bytes:
    """A row for each point in each camera."""
    rows = [
        (photo.format(frame), name, target, *side[k])
        for k, (frame, target) in enumerate(zip(ROWS.frame, TARGET, strict=True))
        for name, side in zip(names, SIDES, strict=True)
    ]
    table = pd.DataFrame(rows, columns=titles.split())
    return table.to_csv(index=False, sep=sep, decimal="," if sep == ";" else ".").encode()


TABLES = {
    "spreadsheet": per_target(
        ("Camera 1", "Camera 2"), ("Frame number", "End of bar"), "{c} {a} (px)"
    ),
    "glued": per_target(("left", "right"), ("Bild", "Marker"), "{c}{a}"),
    "number last": per_target(("1", "2"), ("frame", "target"), "{a}{c}"),
    "wide": per_frame(("left", "right"), "{c}_{t}_{a}"),
    "wide, camera last": per_frame(("cam1", "cam2"), "{t} {c} {a}", "image"),
    "wide, axis first": per_frame(("L", "R"), "{a}_{c}_{t}", "frame"),
    "wide, numbers": per_frame(("1", "2"), "{t}{c}{a}", "Frame"),
    "camelCase": per_frame(("left", "right"), "{c}{t}{a}", "t"),
    "long": per_point("photo camera marker x y", ("left", "right"), "IMG_{:04d}.JPG", ";"),
    "long, others": per_point("Frame View Point u v", ("primary", "secondary")),
    "of Windows": per_target(("Kamera 1", "Kamera 2"), ("Bild", "Marker"), "{c} {a} für px")
    .decode()
    .encode("cp1252"),
    "old Macintosh": per_frame(("left", "right"), "{c}_{t}_{a}", "frame").replace(b"\n", b"\r"),
    "with a title": b"Bars of 3 May,,,,\n\n" + per_point("Frame Cam End col row", ("1", "2")),
}


def rows_of(content: bytes, roles: str | None = None) -> Correspondences:
    return bars_of(content, "t.csv", ExchangeOptions(roles=roles), (None, None)).rows


@pytest.mark.parametrize("name", TABLES)
def test_headers_name_the_columns(name: str) -> None:
    rows = rows_of(TABLES[name])
    order = np.lexsort([ROWS.target, ROWS.frame])
    found = np.lexsort([rows.target, rows.frame])
    if name != "wide":
        np.testing.assert_array_equal(rows.frame[found], ROWS.frame[order])
    np.testing.assert_array_equal(rows.target[found], ROWS.target[order])
    np.testing.assert_allclose(rows.primary[found], ROWS.primary[order], rtol=0, atol=1e-9)
    np.testing.assert_allclose(rows.secondary[found], ROWS.secondary[order], rtol=0, atol=1e-9)


UNKNOWN = per_point("when which who right down", ("left", "right"), "P{}.png")


def test_a_person_says_what_the_header_does_not() -> None:
    with refused("t.csv: ", "which, who, right, down", "--roles"):
        rows_of(UNKNOWN)
    assert len(rows_of(UNKNOWN, "frame,camera,target,x,y")) == len(ROWS)
    for roles, *said in (
        ("frame,camera,target,x", "x", "y"),
        ("frame,camera,target,x,y,-", "6", "5"),
        ("frame,-,target,x,y", "camera"),
        ("frame,camera,-,x,y", "end"),
        ("frame,camera,camera,x,y", "camera"),
        ("frame,camera,whom,x,y", "column 3", "'whom'"),
    ):
        with refused("t.csv: ", *said):
            rows_of(UNKNOWN, roles)


def test_roles_are_one_text() -> None:
    roles = propose_roles([["Frame", "left A x", "left A y", "note"]])
    assert roles_text(roles) == "frame,x:left:A,y:left:A,-"
    assert parse_roles(roles_text(roles), "") == roles


def test_numbers_without_names_are_not_guessed() -> None:
    """Which of x1 and x2 is of which camera or target is not said."""
    layout = layout_of(b"frame,x1,y1,x2,y2\n1,2,3,4,5\n2,3,4,5,6\n", "t.csv")
    assert layout.points == ("1", "2") and len(layout.cameras) == 1


def test_points_of_one_camera_keep_their_names() -> None:
    content = TABLES["long"]
    layout = layout_of(content, "t.csv")
    for which, (camera, side) in enumerate(zip(("left", "right"), SIDES, strict=True)):
        answers = first_answers(layout, which)
        assert answers.camera == camera
        table = read_points(content, answered(layout, answers, content, "t.csv"), camera)
        assert table["point"].tolist() == TARGET.tolist()
        np.testing.assert_allclose(table[["u", "v"]].to_numpy(), side, rtol=0, atol=1e-9)


def test_a_point_twice_is_named() -> None:
    again = TABLES["long"] + TABLES["long"].splitlines()[1] + b"\n"
    with refused("t.csv: ", "frame 1", "point A", "left"):
        rows_of(again)


@pytest.mark.parametrize("number", ["0001", "1\u00b22/1", "9" * 5000 + "/1"])
def test_photographs_of_equal_numbers_are_counted_in_order(number: str) -> None:
    """Also where a number has a sign that is no digit, or too many."""
    content = TABLES["long"].replace(b"IMG_0001", f"b2/IMG_{number}".encode())
    content = content.replace(b"IMG_0002", f"b1/{number}".encode())
    frames = rows_of(content).frame
    assert sorted({*frames.tolist()}) == list(range(1, 9))


@pytest.mark.parametrize("name", ["f{:05}_1080p.png", "frame{:04}_cam1.png", "take 2 {:03}.JPG"])
def test_the_number_of_a_photograph_is_that_which_tells_them_apart(name: str) -> None:
    def numbers(rows: str) -> list[int]:
        layout = layout_of(content := f"frame,x,y\n{rows}".encode(), "t.csv")
        return read_points(content, layout, layout.cameras[0], source="t.csv")["frame"].tolist()

    assert numbers("".join(f"{name.format(n)},{n},{n + 1}\n" for n in (7, 12, 3))) == [3, 7, 12]
    with refused("line 5: ", "mean"):
        numbers("1,2,3\n2,3,4\n3,4,5\nmean,3,4\n")
    with refused("left", "frames"):
        numbers("left,2,3\nright,3,4\n")


def test_three_cameras() -> None:
    own = TABLES["long"].decode().splitlines()
    third = [line.replace(";left;", ";top;") for line in own if ";left;" in line]
    content = ("\n".join([*own, *third]) + "\n").encode()
    lenses = {"left.json": PRIMARY, "right.json": SECONDARY, "top.json": PRIMARY}
    files = {name: write_camera(camera) for name, camera in lenses.items()}
    found = gather_all({**files, "t.csv": content}, ExchangeOptions(), "rig", {"B": 0.9})
    assert len(found.recording.cameras) == 3
    assert len(found.recording.frame) == 3 * len(ROWS)


def test_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, out = tmp_path / "t.csv", tmp_path / "set"
    table.write_bytes(UNKNOWN)
    lenses = []
    for name, camera in (("l.json", PRIMARY), ("r.json", SECONDARY)):
        (tmp_path / name).write_bytes(write_camera(camera))
        lenses.append(str(tmp_path / name))
    given = [str(table), *lenses, "--baseline", "2", "--distance", "0.9", "--out", str(out)]
    assert main(["import", *given]) == 2
    assert "--roles -,-,-,-,-: correct that" in capsys.readouterr().err
    assert main(["import", *given, "--roles", "frame,camera,target,x,y"]) == 0
    read = read_table((out / "correspondences.csv").read_bytes(), "t").strict("t")
    assert len(read) == len(ROWS)
