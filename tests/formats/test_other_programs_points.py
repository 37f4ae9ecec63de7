"""Points of other programs, written from one recording: told apart, counted right, matched."""

import io
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest

from stereocal.cli import main
from stereocal.formats.archives.gather import gather
from stereocal.formats.camera_file import write_camera
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.point_answers import UNKNOWN, answered, first_answers, layout_of
from stereocal.formats.point_files import read_bars, read_points
from stereocal.formats.point_layouts import LAYOUTS, layout_name, propose_layout
from stereocal.formats.point_text import point_text
from stereocal.projects.application import ProjectApplication
from stereocal.projects.project import Project
from stereocal.system.array_types import FloatArray
from tests.further import further
from tests.matching.test_matching import RIG_2D
from tests.refused import refused
from tests.rigs.known_rig import PRIMARY, SECONDARY, bar_ends, images

FRAMES = 9
VIEWS = tuple(view.reshape(FRAMES, 2, 2) for view in images(bar_ends(FRAMES)))
"""Of each camera (frames, ends, u and v), by our own projection: the truth."""
HEIGHTS = (PRIMARY.image_size[1], SECONDARY.image_size[1])
FIRST = 11
"""The first frame's number, where a file holds it."""


def csv(header: str, rows: list[list[object]]) -> bytes:
    lines = [header, *(",".join(map(str, row)) for row in rows)]
    return ("\n".join(line for line in lines if line) + "\n").encode()


def rig_columns(theirs: Callable[[FloatArray, int], FloatArray]) -> list[list[object]]:
    """Rows with point outer and camera inner, as DLTdv, Argus and easyWand have them."""
    moved = [theirs(view, height) for view, height in zip(VIEWS, HEIGHTS, strict=True)]
    return [
        [x for end in (0, 1) for view in moved for x in view[k, end].tolist()]
        for k in range(FRAMES)
    ]


def lower_left(view: FloatArray, height: int) -> FloatArray:
    return np.stack([view[..., 0], height - view[..., 1]], axis=-1)


def old_dltdv(view: FloatArray, height: int) -> FloatArray:
    """(u + 1, h - v): the first column is 1, and rows are counted from the bottom."""
    return np.stack([view[..., 0] + 1, height - view[..., 1]], axis=-1)


DLTDV5 = csv(
    ",".join(f"pt{p}_cam{c}_{a}" for p in (1, 2) for c in (1, 2) for a in "XY"),
    rig_columns(old_dltdv),
)
DLTDV8 = csv(
    ",".join(f"{p}_cam{c}_{a}" for p in ("left", "right") for c in (1, 2) for a in "UV"),
    rig_columns(lambda view, _: view + 1),
)
ARGUS = csv(
    ",".join(f"Track {p}_cam_{c}_{a}" for p in (1, 2) for c in (1, 2) for a in "xy"),
    rig_columns(lower_left),
)
WAND = csv("", rig_columns(lower_left))


def points_of(side: int) -> list[tuple[int, int, float, float]]:
    """Frame, end, u and v of each point of a camera."""
    rows = [(k, end, VIEWS[side][k, end]) for k in range(FRAMES) for end in (0, 1)]
    return [(FIRST + k, end, float(uv[0]), float(uv[1])) for k, end, uv in rows]


def tracktor(side: int) -> bytes:
    rows = enumerate(points_of(side))
    return csv(",frame,pos_x,pos_y,id", [[n, k, u, v, end] for n, (k, end, u, v) in rows])


def sleap(side: int, score: float = 0.9) -> bytes:
    """Two nodes, of which the second is not seen in the third frame."""
    rows: list[list[object]] = []
    for k in range(FRAMES):
        cells = [[*VIEWS[side][k, end].tolist(), score] for end in (0, 1)]
        if k == 2:
            cells[1] = ["", "", ""]
        rows.append(["track_0", FIRST + k, 0.8, *cells[0], *cells[1]])
    head = "track,frame_idx,instance.score,nose.x,nose.y,nose.score,tail.x,tail.y,tail.score"
    return csv(head, rows)


def hdf5(**arrays: object) -> bytes:
    """An HDF5 file of these arrays."""
    packed = io.BytesIO()
    with h5py.File(packed, "w", libver="latest") as file:
        for name, values in arrays.items():
            file[name] = values
    return packed.getvalue()


def sleap_h5(side: int) -> bytes:
    """The same recording as `sleap`, as (tracks, 2, nodes, frames)."""
    tracks = np.full((1, 2, 2, FIRST + FRAMES), np.nan)
    tracks[0, :, :, FIRST:] = VIEWS[side].transpose(2, 1, 0)
    tracks[0, :, 1, FIRST + 2] = np.nan
    scores = np.where(np.isnan(tracks[:, 0]), np.nan, 0.9)
    names = {"node_names": [b"nose", b"tail"], "track_names": [b"track_0"]}
    return hdf5(tracks=tracks, point_scores=scores, **names)


def deeplabcut(side: int) -> bytes:
    rows: list[list[object]] = [
        [FIRST + k, *view[0].tolist(), 0.99, *view[1].tolist(), 0.99]
        for k, view in enumerate(VIEWS[side])
    ]
    head = (
        "scorer,n,n,n,n,n,n\nbodyparts,nose,nose,nose,tail,tail,tail\n"
        "coords,x,y,likelihood,x,y,likelihood"
    )
    return csv(head, rows)


def trackmate(side: int, unit: str, scale: float) -> bytes:
    rows: list[list[object]] = [
        ["ID", end, scale * u, scale * v, k] for k, end, u, v in points_of(side)[::-1]
    ]
    head = (
        "LABEL,TRACK_ID,POSITION_X,POSITION_Y,FRAME\nLabel,Track ID,X,Y,Frame\n"
        f"Label,Track ID,X,Y,Frame\n,,({unit}),({unit}),"
    )
    return csv(head, rows)


def odd(side: int) -> bytes:
    """No name of a column says anything."""
    return csv("weight,down,right,when", [[1.5, v, u, k] for k, _, u, v in points_of(side)])


def pixels(content: bytes, side: int) -> pd.DataFrame:
    """The points of one camera with the answers that are proposed first."""
    layout = layout_of(content, "points")
    first = first_answers(layout, side, HEIGHTS[side])
    layout = answered(layout, first, content, "points")
    return read_points(content, layout, first.camera, HEIGHTS[side], "points")


class TestWhoWroteIt:
    @pytest.mark.parametrize(
        ("content", "name"),
        [
            *zip((DLTDV5, DLTDV8, ARGUS, WAND), ("dltdv5", "dltdv8", "argus", "wand"), strict=True),
            *((write(0), write.__name__) for write in (tracktor, sleap, deeplabcut)),
            (trackmate(0, "pixel", 1), "trackmate"),
            (b"t,x,y\n1,2,3\n", "table"),
            (odd(0), None),
        ],
    )
    def test_by_its_header(self, content: bytes, name: str | None) -> None:
        assert layout_name(content, "points") == name
        for other in set(LAYOUTS) - {name, "wand", "table", "argus", "dltdv5"}:
            with refused("points: ", f"layout {other}"):
                propose_layout(content, "points", other)

    @pytest.mark.parametrize("content", [odd(0), b"1,2,3\n4,5,6\n", b"x,y,x\n1,2,3\n4,5,6\n"])
    def test_an_unknown_table_has_no_columns_before_a_person_has_chosen(
        self, content: bytes
    ) -> None:
        layout = layout_of(content, "points")
        assert layout.program == UNKNOWN and layout.roles is not None
        assert layout.columns == () and layout.frame is None
        with refused("points: ", "x", "y"):
            pixels(content, 0)


class TestNumbers:
    """Against our own projection."""

    @pytest.mark.parametrize("content", [DLTDV5, DLTDV8, ARGUS, WAND])
    @pytest.mark.parametrize("side", [0, 1])
    def test_files_with_both_cameras(self, content: bytes, side: int) -> None:
        table = pixels(content, side)
        expected = VIEWS[side].reshape(-1, 2)
        np.testing.assert_allclose(table[["u", "v"]].to_numpy(), expected, rtol=0, atol=1e-9)
        layout = layout_of(content, "points")
        ends = layout.points[0], layout.points[1]
        rows = read_bars(content, layout, ("cam1", "cam2"), ends, HEIGHTS).correspondences
        assert len(rows.bars) == FRAMES
        np.testing.assert_allclose(rows.primary[:FRAMES], VIEWS[0][:, 0], rtol=0, atol=1e-9)

    @pytest.mark.parametrize("head", ["", "row\tcolumn\tvalue\n9\t8\t0\n"])
    def test_sparse_tables_of_dltdv_8(self, head: str) -> None:
        """Column by column, without what is missing."""
        flat = [list(map(float, line.split(","))) for line in DLTDV8.decode().splitlines()[1:]]
        lines = [
            f"{k + 1}\t{c + 1}\t{flat[k][c]!r}"
            for c in range(8)
            for k in range(FRAMES)
            if (k, c // 2) != (4, 3)
        ]
        content = point_text((head + "\n".join(lines) + "\n").encode(), "xypts.tsv")
        assert layout_name(content, "xypts.tsv") == "dltdv8"
        for side in (0, 1):
            table = pixels(content, side)
            expected = VIEWS[side].reshape(-1, 2)
            if side:  # the second point in the second camera is missing once
                expected = np.delete(expected, 9, axis=0)
            np.testing.assert_allclose(table[["u", "v"]].to_numpy(), expected, rtol=0, atol=1e-9)
        plain = b"1,2,3\n1,5,6\n2,2,4\n2,5,4\n3,2,4\n3,5,4\n"
        for other in (plain, "\u00b2,1,2.5\n".encode() * 9):
            assert point_text(other, "frame, u and v") == other

    def test_dltdv_5_counts_as_its_display_does(self) -> None:
        """The first pixel of a 1600x1200 image: column 1, and the top row is at 1200."""
        content = b"pt1_cam1_X,pt1_cam1_Y\n1,1200\n1600,1\n3.25,1100.5\n"
        table = pixels(content, 0)
        np.testing.assert_array_equal(table[["u", "v"]], [[0, 0], [1599, 1199], [2.25, 99.5]])

    def test_argus_with_one_track_and_two_cameras(self) -> None:
        """Four columns, which were taken for both ends of a bar in one camera."""
        rows = [row[:4] for row in rig_columns(lower_left)]
        content = csv(",".join(f"Track 1_cam_{c}_{a}" for c in (1, 2) for a in "xy"), rows)
        layout = layout_of(content, "points")
        assert (layout.program, layout.points) == ("Argus", ("Track 1",))
        assert layout.cameras == ("cam1", "cam2")
        for side in (0, 1):
            found = pixels(content, side)[["u", "v"]].to_numpy()
            np.testing.assert_allclose(found, VIEWS[side][:, 0], rtol=0, atol=1e-9)

    def test_unsure_nodes_of_sleap_can_be_left_out(self) -> None:
        content = sleap(0, score=0.3)
        layout = layout_of(content, "points")
        assert first_answers(layout, 0).least_likelihood == 0
        assert layout.points == ("nose", "tail") and len(pixels(content, 0)) == 2 * FRAMES - 1
        first = first_answers(layout, 0)
        strict = answered(layout, replace(first, least_likelihood=0.4), content, "p")
        assert read_points(content, strict, "cam1").empty


def test_tables_of_one_camera_each_are_imported_as_bars() -> None:
    """The unlikely point of a frame is missing, as on the page."""
    files = {
        "right_dlc.csv": deeplabcut(1),
        "left_dlc.csv": deeplabcut(0).replace(b"0.99", b"0.1", 1),
    }
    lenses = {"left.json": write_camera(PRIMARY), "right.json": write_camera(SECONDARY)}
    found = gather(files | lenses, ExchangeOptions()).correspondences
    assert found is not None and len(found) == 2 * FRAMES - 1 and len(found.bars) == FRAMES - 1
    np.testing.assert_allclose(found.primary[-FRAMES:], VIEWS[1][:, 1], rtol=0, atol=1e-9)


def test_deeplabcut_with_several_animals() -> None:
    content = (
        b"scorer,net,net,net\nindividuals,a,a,a\nbodyparts,nose,nose,nose\n"
        b"coords,x,y,likelihood\n0,1,2,1\n"
    )
    assert propose_layout(content, "dlc.csv").points == ("a nose",)


@pytest.mark.parametrize(("unit", "asks"), [("pixel", False), ("micron", True)])
def test_trackmate(unit: str, asks: bool) -> None:
    content = trackmate(0, unit, 0.5)
    layout = propose_layout(content, "spots.csv")
    assert layout.program == "TrackMate"
    assert any("micron" in question for question in layout.questions) == asks
    table = read_points(content, replace(layout, px_per_unit=2.0), "cam1")
    assert list(table) == ["frame", "u", "v", "track"]
    assert table["frame"].tolist() == [FIRST + k for k in range(FRAMES) for _ in (0, 1)]
    np.testing.assert_allclose(table["u"][table["track"] == "1"], VIEWS[0][:, 1, 0])


class TestHdf5:
    @pytest.mark.parametrize("side", [0, *further(1)])
    def test_sleaps_analysis_file_is_its_csv(self, side: int) -> None:
        from_h5 = pixels(point_text(sleap_h5(side), "a.h5"), side)
        from_csv = pixels(sleap(side), side)
        pd.testing.assert_frame_equal(from_h5, from_csv)  # to the last bit

    def test_two_tracks(self) -> None:
        tracks = np.arange(2 * 2 * 1 * 3, dtype=float).reshape(2, 2, 1, 3)
        tracks[1, 0, 0, 1] = np.nan
        table = pixels(point_text(hdf5(tracks=tracks, node_names=[b"nose"]), "a.h5"), 0)
        rows = table[["frame", "u", "v"]].to_numpy().tolist()
        assert rows == [[0, 0, 3], [0, 6, 9], [1, 1, 4], [2, 2, 5], [2, 8, 11]]
        assert [name[-1] for name in table["track"]] == [*"01001"]

    def test_deeplabcuts_is_named_and_never_read(self, tmp_path: Path) -> None:
        content = hdf5(**{"df_with_missing/table": np.zeros(3)})
        store = ProjectApplication(Project.create(tmp_path))
        for read in (
            point_text,
            layout_of,
            lambda own, name: store.offer_points("primary", name, own),
        ):
            with refused("dlc.h5", "DeepLabCut", "CSV"):
                read(content, "dlc.h5")

    def test_without_h5py(self, monkeypatch: pytest.MonkeyPatch) -> None:
        content = sleap_h5(0)
        monkeypatch.setitem(sys.modules, "h5py", None)
        with refused("a.h5", "h5py"):
            point_text(content, "a.h5")
        with refused("dlc.h5", "DeepLabCut"):  # that needs no h5py
            point_text(b"\x89HDF\r\n\x1a\n" + bytes(90) + b"df_with_missing" + bytes(90), "dlc.h5")
        assert point_text(b"frame,u,v\n", "a.csv") == b"frame,u,v\n"

    def test_links_to_other_files_are_not_followed(self, tmp_path: Path) -> None:
        secret = tmp_path / "secret.h5"
        secret.write_bytes(sleap_h5(0))
        packed = io.BytesIO()
        with h5py.File(packed, "w") as file:
            file["tracks"] = h5py.ExternalLink(str(secret), "tracks")
            file["node_names"] = [b"nose", b"tail"]
        with refused("a.h5", "'tracks'"):
            point_text(packed.getvalue(), "a.h5")


def run_match(tmp_path: Path, contents: tuple[bytes, bytes], *more: str) -> int:
    given = [str(tmp_path / name) for name in ("p.csv", "s.csv")]
    for name, content in zip(given, contents, strict=True):
        Path(name).write_bytes(content)
    RIG_2D.save(tmp_path / "2d.json")
    files = ["--parameters", str(tmp_path / "2d.json"), "--out", str(tmp_path / "pairs.csv")]
    return main(["match", *given, *files, *more])


ONE_CAMERA = {
    "tracktor": (tracktor, ()),
    "sleap": (sleap, ()),
    "deeplabcut": (deeplabcut, ()),
    "trackmate": (lambda side: trackmate(side, "micron", 0.65), ("--px-per-unit", repr(1 / 0.65))),
    "columns": (odd, ("--columns", "when", "right", "2")),
}


class TestCommandLine:
    def check(self, tmp_path: Path, frames: range, count: int = 2 * FRAMES) -> None:
        pairs = pd.read_csv(tmp_path / "pairs.csv")
        assert len(pairs) == count and set(pairs["frame"]) == set(frames)
        # Exact points: what is left is the conversion.
        np.testing.assert_allclose(pairs["error_px"], 0, atol=1e-6)
        expected = VIEWS[0].reshape(-1, 2)
        found = pairs[["u_primary", "v_primary"]].to_numpy()
        nearest = np.linalg.norm(found[:, None] - expected[None], axis=2).min(axis=1)
        np.testing.assert_allclose(nearest, 0, atol=1e-9)

    @pytest.mark.parametrize("layout", ONE_CAMERA)
    def test_one_camera_a_file(
        self, layout: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        write, more = ONE_CAMERA[layout]
        assert run_match(tmp_path, (write(0), write(1)), "--layout", layout, *more) == 0
        self.check(tmp_path, range(FIRST, FIRST + FRAMES), 2 * FRAMES - (layout == "sleap"))
        assert "read as" in capsys.readouterr().out

    def test_cameras_exchanged_and_counted_otherwise(self, tmp_path: Path) -> None:
        """Camera 2 is the primary; the height counts as h + 1, from a first pixel of 0.5."""

        def theirs(view: FloatArray, height: int) -> FloatArray:
            return np.stack([view[..., 0] + 0.5, height + 1 - view[..., 1]], axis=-1)

        swapped = [[row[k] for k in (2, 3, 0, 1, 6, 7, 4, 5)] for row in rig_columns(theirs)]
        content = csv(ARGUS.decode().splitlines()[0], swapped)
        more = ("--cameras", "2,1", "--flip", "h+1", "--first-pixel", "0.5")
        assert run_match(tmp_path, (content, content), "--layout", "argus", *more) == 0
        self.check(tmp_path, range(1, FRAMES + 1))
