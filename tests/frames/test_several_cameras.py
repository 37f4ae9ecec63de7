"""Whose names are of several cameras, and whose videos are chapters of one recording."""

import pytest

from stereocal.frames.several_cameras import cameras_told, chapters_in_words, chapters_of
from stereocal.system.taken import Taken

FIRST, SECOND = range(1, 9), range(1, 7)


def told(names: list[str], body: str = "") -> dict[str, int]:
    cameras = cameras_told(dict.fromkeys(names, Taken(body=body)))
    return {camera: len(series.names) for camera, series in cameras.items()}


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("left/GOPR12{n}.png", "right/GOPR56{n}.png"),
        ("left{n}.jpg", "right{n}.jpg"),
        ("cam0/data/17{n}.png", "cam1/data/18{n}.png"),
        ("Camera_01/{n}.png", "Camera_02/{n}.png"),
        ("GoPro1/GOPR12{n}.JPG", "GoPro2/GOPR56{n}.JPG"),
        ("calibration/2024/L/DSC{n}.tif", "calibration/2024/R/IMG{n}.tif"),
        ("3D_L000{n}.jpg", "3D_R000{n}.jpg"),
        ("image_0/00{n}.png", "image_1/00{n}.png"),
        ("{n}_0.png", "{n}_1.png"),
    ],
)
def test_names_of_two_cameras(first: str, second: str) -> None:
    names = [first.format(n=n) for n in FIRST] + [second.format(n=n) for n in SECOND]
    assert told(names) == {"primary": 8, "secondary": 6}


def test_names_of_three_cameras() -> None:
    names = [f"cam{camera}/{n}.png" for camera in (1, 2, 3) for n in FIRST]
    assert told(names) == {"cam1": 8, "cam2": 8, "cam3": 8}


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("monday/GOPR00{n}.JPG", "tuesday/GOPR01{n}.JPG"),
        ("2024-05-01/img_{n}.png", "2024-05-02/img_{n}.png"),
        ("100GOPRO/GOPR00{n}.JPG", "101GOPRO/GOPR01{n}.JPG"),
        ("1/IMG_10{n}.png", "2/IMG_11{n}.png"),
        ("day1_{n}.png", "day2_{n}.png"),
        ("IMG_{n}.png", "IMG_1{n}.png"),
        ("GX010123/00{n}.png", "GX020123/00{n}.png"),
        ("left/{n}.png", "left/again/{n}.png"),
    ],
)
def test_one_camera_on_two_days(first: str, second: str) -> None:
    assert told([name.format(n=n) for n in FIRST for name in (first, second)]) == {}


def test_a_view_that_counts_is_no_camera() -> None:
    assert told([f"view{n}.png" for n in range(12)]) == {}
    assert told([f"c{n}.png" for n in range(12)]) == {}
    assert told(["img_0.png", "img_1.png"]) == {}


def test_files_that_name_two_cameras() -> None:
    taken = {f"{n:02}.jpg": Taken(body=f"GoPro HERO9 {n % 2}") for n in range(10)}
    assert [len(series.names) for series in cameras_told(taken).values()] == [5, 5]
    assert not cameras_told(dict.fromkeys(taken, Taken(body="GoPro HERO9")))


@pytest.mark.parametrize(
    "chapters",
    [
        ["GX010123.MP4", "GX020123.MP4", "GX030123.MP4"],
        ["gh010123.mp4", "gh020123.mp4"],
        ["left/GOPR0123.MP4", "left/GP010123.MP4", "left/GP020123.MP4"],
        ["DJI_0007_001.MP4", "DJI_0007_002.MP4"],
        ["VID_20240501_101500_00_001.mp4", "VID_20240501_101500_00_002.mp4"],
    ],
)
def test_chapters_of_a_recording(chapters: list[str]) -> None:
    assert chapters_of(chapters[::-1]) == [chapters]
    words = chapters_in_words(chapters)
    assert all(f"file '{name}'" in words for name in chapters) and "ffmpeg" in words


@pytest.mark.parametrize(
    "videos",
    [
        ["GX010123.MP4", "GX010124.MP4"],
        ["left/GX010123.MP4", "right/GX020123.MP4"],
        ["GOPR0123.MP4", "GOPR0124.MP4"],
        ["DJI_0001.MP4", "DJI_0002.MP4"],
        ["cam_001.mp4", "cam_002.mp4"],
        ["primary.mp4", "secondary.mp4"],
    ],
)
def test_videos_of_two_cameras_are_no_chapters(videos: list[str]) -> None:
    assert chapters_of(videos) == [[name] for name in videos] and not chapters_in_words(videos)
