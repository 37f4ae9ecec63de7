"""Prints: true to scale, and found by the detection that they are made for."""

import math
import xml.etree.ElementTree as ElementTree
from contextlib import closing
from io import BytesIO

import numpy as np
import pypdfium2
import pytest

from stereocal.detection.detect import detect_targets
from stereocal.detection.tags import find_tags
from stereocal.detection.target import Tags, parse_target
from stereocal.field.planning.bars import bar_places, margin_px
from stereocal.field.planning.plan import AimedPose, Plan, SensorLens, sees
from stereocal.field.printing.paper import PAPERS, Paper, Sheet, paper_named
from stereocal.field.printing.print_target import target_size
from stereocal.field.printing.prints import print_board, print_tags, print_targets
from stereocal.field.printing.sheet import field_sheet
from stereocal.intrinsics.boards import BoardView, find_board
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.array_types import FloatArray
from tests.field.plans import plan
from tests.further import further
from tests.refused import refused
from tools.photographs.rendering import (
    Board,
    Photograph,
    PhotographSettings,
    Placed,
    photograph,
    turned,
)

INCH_MM, DPI, FINE = 25.4, 200.0, 4
CAMERA = Camera(
    K=np.array([[2400.0, 0.0, 799.5], [0.0, 2400.0, 599.5], [0.0, 0.0, 1.0]]),
    distortion=np.array([-0.1, 0.05, 0.0005, -0.0004, 0.0]),
    image_size=(1600, 1200),
)


def posed(distance_m: float, tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Pose:
    """A sheet nearly in the middle of the view; the tilt is a rotation vector in radians."""
    return Pose(turned(tilt), np.array([0.01, -0.02, distance_m]))


def rasterised(pdf: bytes, dpi: float) -> FloatArray:
    """(h, w): grey levels of the only page, means of 4x4 dots.

    PDFium widens rectangles to whole dots, which is why there are more of them.
    """
    with closing(pypdfium2.PdfDocument(pdf)) as document:
        assert len(document) == 1
        dots = document[0].render(scale=FINE * dpi / 72.0, grayscale=True).to_numpy()
    height, width = (side // FINE for side in dots.shape[:2])
    whole = dots[: height * FINE, : width * FINE].reshape(height, FINE, width, FINE)
    return np.asarray(whole.mean(axis=(1, 3)), dtype=np.float64)


def photographed(sheet: Sheet, pose: Pose) -> Photograph:
    """The whole sheet on a dark wall."""
    return placed_before_camera([(_inked(rasterised(sheet.pdf(), DPI)), pose)])


def placed_before_camera(boards: list[tuple[Board, Pose]]) -> Photograph:
    """What `CAMERA` sees of boards before a dark wall."""
    placed = [Placed(board, pose) for board, pose in boards]
    rng = np.random.default_rng(5)
    return photograph(CAMERA, 70.0, placed, PhotographSettings(), rng)


def cut_target(sheet: Sheet, side_mm: float) -> Board:
    """The first target of a sheet, cut out along the ends of its black squares."""
    picture = rasterised(sheet.pdf(), DPI)
    half = 0.5 * side_mm * DPI / INCH_MM

    def wide(line: FloatArray) -> list[tuple[int, int]]:
        return [run for run in black_runs(line) if run[1] - run[0] > 0.9 * half]

    rows = np.flatnonzero([bool(wide(row)) for row in picture])
    left, middle = wide(picture[rows[5]])[0]
    top, centre = wide(picture[:, (left + middle) // 2])[0]
    cut = picture[top : 2 * centre - top, left : 2 * middle - left]
    return _inked(cut)


def black_runs(line: FloatArray) -> list[tuple[int, int]]:
    """Start and end of each black part of a line of grey levels."""
    steps = np.diff(np.concatenate([[False], line < 128, [False]]).astype(np.int64))
    return [(int(start), int(stop)) for start, stop in np.flatnonzero(steps).reshape(-1, 2)]


def _inked(picture: FloatArray) -> Board:
    ink, white, metres = 25.0, 215.0, 1e-3 * INCH_MM / DPI
    height, width = picture.shape
    return Board(ink + (white - ink) / 255.0 * picture, (width * metres, height * metres))


def on_paper(pixels: FloatArray, pose: Pose) -> FloatArray:
    """Where raw pixels (n, 2) of `CAMERA` lie on the sheet, (n, 2) in mm from its centre."""
    rays = np.column_stack([CAMERA.undistort(pixels), np.ones(len(pixels))])
    to_plane = np.linalg.inv(np.column_stack([pose.R[:, :2], pose.T]))
    flat = rays @ to_plane.T
    metres: FloatArray = flat[:, :2] / flat[:, 2:]
    return 1e3 * metres


A4, A3 = PAPERS["A4"], PAPERS["A3"]
SCALE = 1e-3
"""Lengths are right to 0.1 %."""
TILT = (0.5, -0.3, 0.2)


def rectangles(sheet: Sheet) -> FloatArray:
    """(n, 4): left, lower edge, width and height of all rectangles of the SVG, in mm."""
    root = ElementTree.parse(BytesIO(sheet.svg().encode())).getroot()
    assert root.get("width") == f"{sheet.paper.width_mm:g}mm"
    view = [float(number) for number in str(root.get("viewBox")).split()]
    assert view[2] == pytest.approx(sheet.paper.width_mm / INCH_MM * 72, abs=1e-4)
    assert view[3] == pytest.approx(sheet.paper.height_mm / INCH_MM * 72, abs=1e-4)
    found = [
        [float(node.attrib[name]) for name in ("x", "y", "width", "height")]
        for node in root.findall(".//{*}g/{*}rect")
    ]
    return np.array(found)


@pytest.mark.parametrize(("side_m", "tilt"), [(0.05, TILT), *further((0.1, (0.0, 0.0, 0.0)))])
def test_printed_targets_are_found_and_their_scale_is_right(
    side_m: float, tilt: tuple[float, float, float]
) -> None:
    sheet = print_targets(side_m, A4)
    squares = rectangles(sheet)
    corners = squares[::2, 0] + squares[::2, 2] - 0.5 * sheet.paper.width_mm
    pose = posed(25 * side_m, tilt)
    found = detect_targets(photographed(sheet, pose))
    assert found.targets is not None, found.sentence
    centres = on_paper(np.array([corner.centre for corner in found.targets]), pose)
    # Measured: 0.016 % and 0.06 mm at most.
    assert math.dist(*centres) == pytest.approx(np.ptp(corners), rel=SCALE)
    np.testing.assert_allclose(np.sort(centres[:, 0]), np.sort(corners), atol=0.1)


@pytest.mark.parametrize("target", ["tags:4X4_50:3,7", *further("tags:APRILTAG_36h11:0,5")])
def test_printed_tags_are_found_and_their_scale_is_right(target: str) -> None:
    tags, side_m = parse_target(target), 0.09
    assert isinstance(tags, Tags)
    sheet = print_tags(tags, side_m, A4)
    pose = posed(0.9, TILT)
    found = find_tags(photographed(sheet, pose), tags, CAMERA)
    assert not found.missing
    centres = on_paper(np.array([(spot.u, spot.v) for spot in found.spots if spot]), pose)
    # From the first cell to the last, side by side or one above the other.
    cells = rectangles(sheet)
    apart = np.ptp(cells[:, :2], axis=0).max() + cells[0, 2] - 1e3 * side_m
    assert math.dist(*centres) == pytest.approx(apart, rel=SCALE)
    with refused("A4", " A"):
        print_tags(tags, 0.15, A4)


@pytest.mark.parametrize(("side_m", "paper"), [(0.05, A4), *further((0.27, A3))])
def test_cut_targets_on_a_bar_are_found_without_a_doubt(side_m: float, paper: Paper) -> None:
    target = cut_target(print_targets(side_m, paper), 1e3 * side_m)
    assert target.size_m == pytest.approx((side_m, side_m), rel=SCALE)
    poses = [
        Pose(posed(1.0, TILT).R, np.array([sign * 2.5 * side_m, 0.2 * side_m, 30 * side_m]))
        for sign in (-1.0, 1.0)
    ]
    image = placed_before_camera([(target, pose) for pose in poses])
    found = detect_targets(image)
    assert found.state == "found", found.sentence
    assert found.targets is not None
    for corner, pose in zip(found.targets, poses, strict=True):
        away_mm = np.linalg.norm(on_paper(corner.centre[None], pose)[0])
        assert away_mm < SCALE * 1e3 * side_m


def test_squares_and_ruler_are_printed_at_true_scale() -> None:
    sheet = print_targets(0.18, A4)
    squares = rectangles(sheet)
    np.testing.assert_allclose(squares[:, 2:], 90.0, rtol=1e-6)
    dpi = 300.0
    picture = rasterised(sheet.pdf(), dpi)
    assert picture.shape == pytest.approx((297 / INCH_MM * dpi, 210 / INCH_MM * dpi), abs=1)
    mm = INCH_MM / dpi
    ticks = picture[round((297.0 - 10.5) / mm)]
    ends = [0.5 * (start + stop) * mm for start, stop in black_runs(ticks)]
    assert len(ends) == 3  # 0, 50 and 100 mm reach so far down
    assert ends[-1] - ends[0] == pytest.approx(100.0, rel=SCALE)


def test_the_size_of_a_target_follows_from_the_distance() -> None:
    size = target_size(7120.0, 8.0, 25.0)
    assert size.side_m == pytest.approx(0.18)
    assert size.sentence == "A target of 180 mm is 51 px across at 25 m and 160 px at 8 m."
    alone = target_size(7120.0, 25.0, 25.0)
    assert "51 px across at 25 m." in alone.sentence
    near = target_size(7120.0, 2.0, 25.0)
    assert "keep the bar beyond 3.2 m, or print smaller targets" in near.sentence
    far = target_size(7120.0, 8.0, 25.0, 15.0)
    assert "at least 20 px: print larger targets" in far.sentence


def test_what_does_not_fit_names_a_paper_that_does() -> None:
    for draw, *said in (
        (lambda: print_targets(0.3, A4), "300 mm", "A4", "A2"),
        (lambda: print_targets(0.9, PAPERS["A0"]), "900 mm", "A0"),
        (lambda: print_targets(0.0, A4), "0.002 to 10 m"),
        (lambda: paper_named("B5"), '"B5"', "A4, A3"),
        (lambda: print_board(BoardPattern(18, 12, 0.03), A4), "13 mm", "A2"),
        (lambda: print_board(BoardPattern(18, 12, 0.0003), A4), "1 mm"),
    ):
        with refused(*said):
            draw()


@pytest.mark.parametrize(
    "pattern",
    [BoardPattern(9, 12, 0.02), *further(BoardPattern(13, 9, 0.02, "DICT_5X5_250", 0.015))],
    ids=["upright", "charuco"],
)
def test_a_printed_board_is_found_with_all_corners_and_its_scale_is_right(
    pattern: BoardPattern,
) -> None:
    pose = posed(0.9, TILT)
    view = find_board(photographed(print_board(pattern, A3), pose), pattern, "print")
    assert isinstance(view, BoardView)
    assert len(view.ids) == pattern.columns * pattern.rows
    corners = on_paper(view.corners, pose).reshape(pattern.rows, pattern.columns, 2)
    for steps in (np.diff(corners, axis=1), np.diff(corners, axis=0)):
        lengths = np.linalg.norm(steps, axis=2)
        assert lengths.mean() == pytest.approx(20.0, rel=SCALE)
        np.testing.assert_allclose(lengths, 20.0, atol=0.15)


WIDE = SensorLens(12.0, (11.3, 7.1), (1920, 1200))
TANK = plan(
    stated_primary=WIDE,
    stated_secondary=WIDE,
    near_m=0.6,
    far_m=1.2,
    bar_m=0.12,
    stated_pose=AimedPose(0.4, 12.0),
)
ABOVE = plan(stated_pose=Pose(turned((0.1, 0.0, 0.02)), np.array([0.0, 2.0, 0.1])), near_m=15.0)
"""The secondary stands above the primary, and looks down."""
PLANS = [plan(), plan(frames=7), plan(frames=200), plan(stated_pose=AimedPose(4.5)), TANK, ABOVE]


def words_of(pdf: bytes) -> str:
    with closing(pypdfium2.PdfDocument(pdf)) as document:
        assert len(document) == 1
        words: str = document[0].get_textpage().get_text_range()
    return " ".join(words.split())


@pytest.mark.parametrize("planned", PLANS)
def test_both_cameras_see_every_bar_of_the_checklist(planned: Plan) -> None:
    places = bar_places(planned)
    assert len(places) == planned.frames
    ends = np.array([place.ends_m for place in places])
    np.testing.assert_allclose(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), planned.bar_m)
    points = ends.reshape(-1, 3)
    assert sees(planned.primary, points, margin_px(planned, planned.primary.image_size)).all()
    there = planned.pose.apply(points)
    assert sees(planned.secondary, there, margin_px(planned, planned.secondary.image_size)).all()
    assert (points[:, 2] >= planned.near_m).all()
    assert (points[:, 2] <= planned.far_m).all()


def test_the_sheet_says_where_what_and_how() -> None:
    words = words_of(field_sheet(plan()))
    for said in (
        "Field sheet: field",
        "Secondary (S) 4.5 m from the primary (P), to the right, seen from behind",
        "0.2 m higher",
        "P 10.0° in, S 10.0° in. The axes meet about 12.8 m ahead",
        "Targets of 175 mm: 50 px across at 25 m, 156 px at 8 m",
        "expose for at most 1.1 ms, with both cameras in step to 0.45 ms",
        "Bar: 25 frames of a bar of 0.9 m",
        "8.2 m ahead",
        "add 3.5 mm for each cm",
        "Between the entrance pupils",
        "Trigger, time offset of S",
    ):
        assert said in words
    assert words.count("❏") == 25
