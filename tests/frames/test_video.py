"""Frames of two videos: the right ones by their time stamps, and missing ones are reported."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from stereocal.errors import StereocalError
from stereocal.frames.pairing import pair_names
from stereocal.frames.video.extract import VideoReport, VideoSettings, extract
from stereocal.frames.video.footage import of_photographs, of_videos
from stereocal.rig.camera import CAMERAS
from stereocal.system.photograph import GreyImage, read_colours, read_photograph
from stereocal.system.tasks import StoppedError
from tests.files import encoded
from tests.further import further
from tests.refused import refused
from tools.photographs.videos import number_in, picture, write_video

pytest.importorskip("av")

RATE = 25.0


def constant(frames: int, start: float = 0.0) -> list[float]:
    return [start + k / RATE for k in range(frames)]


def taken(
    videos: tuple[Path, Path], settings: VideoSettings
) -> tuple[VideoReport, dict[str, GreyImage]]:
    found: dict[str, GreyImage] = {}

    def keep(name: str, content: bytes) -> None:
        found[name] = read_photograph(content, name)

    report = extract(dict(zip(CAMERAS, videos, strict=True)), settings, keep)
    return report, found


@pytest.mark.parametrize("suffix", [".mp4", *further(".mkv")])
def test_every_nth_frame_of_a_constant_rate(tmp_path: Path, suffix: str) -> None:
    first, second = (write_video(tmp_path / f"{name}{suffix}", constant(60)) for name in "ab")
    videos = first, second
    report, found = taken(videos, VideoSettings("every", 10))
    assert report.taken == 6
    assert {number_in(image) for image in found.values()} == {0, 10, 20, 30, 40, 50}
    for which in ("primary", "secondary"):
        assert number_in(found[f"{which}/000031.png"]) == 30
    pairing = pair_names(found)
    assert [pair.frame for pair in pairing.pairs] == [1, 11, 21, 31, 41, 51]
    text = " ".join(report.sentences)
    assert "60 frames, 25 frames a second; no frame is missing" in text
    assert not report.frames_missing


def test_of_one_video_the_sharpest_still_frame_of_each_second(tmp_path: Path) -> None:
    """Each picture is held for three fifths of its second, and blurred by motion in the others."""

    def draw(k: int) -> GreyImage:
        second, moment = divmod(k, 5)
        held = picture(second)
        return (
            held if moment in (1, 2, 3) else np.asarray(cv2.blur(held, (9 + moment, 1)), np.uint8)
        )

    path = write_video(tmp_path / "a.mp4", [k / 5 for k in range(5 * 32)], draw=draw)
    found: dict[str, GreyImage] = {}

    def keep(name: str, content: bytes) -> None:
        found[name] = read_photograph(content, name)

    report = extract({"board": path}, VideoSettings(), keep)
    assert report.taken == 32
    numbers = [int(name.removeprefix("board/").split(".")[0]) for name in found]
    assert all((number - 1) % 5 in (1, 2, 3) for number in numbers)
    assert [number_in(image) for image in found.values()] == [*range(32)]


def test_frames_keep_their_colours_when_asked(tmp_path: Path) -> None:
    def red(number: int) -> GreyImage:
        grey = picture(number)
        return np.stack([grey, grey // 2, grey // 2], axis=-1).astype(np.uint8)

    path = write_video(tmp_path / "a.mp4", constant(12), draw=red)
    for coloured in (True, False):
        frames: dict[str, bytes] = {}
        extract(
            {"primary": path, "secondary": path},
            VideoSettings("every", 5, coloured=coloured),
            frames.__setitem__,
        )
        for name, content in frames.items():
            blue, _, reds = (part.astype(int) for part in cv2.split(read_colours(content, name)))
            assert (float((reds - blue).mean()) > 15.0) == coloured


def test_a_dropped_frame_is_reported_and_the_pairs_stay_right(tmp_path: Path) -> None:
    kept = [k for k in range(60) if k not in (20, 41, 42)]
    videos = (
        write_video(tmp_path / "a.mp4", constant(60)),
        write_video(tmp_path / "b.mp4", [k / RATE for k in kept], numbers=kept),
    )
    report, found = taken(videos, VideoSettings("every", 1))
    assert "3 frames are missing: 1 after 0.760 s, 2 after 1.600 s" in report.sentences[1]
    assert report.frames_missing
    assert report.taken == 57
    for name, image in found.items():
        assert number_in(image) == int(name.split("/")[1].split(".")[0]) - 1


def test_cancelled(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.mp4", constant(30))
    settings = VideoSettings("still")

    def cancel(_done: int, _total: int) -> None:
        raise StoppedError

    with pytest.raises(StoppedError):
        extract({"primary": path, "secondary": path}, settings, lambda *_: None, progress=cancel)


def test_damaged_and_other_files_leave_a_sentence(tmp_path: Path) -> None:
    good = write_video(tmp_path / "a.mp4", constant(40))
    content = good.read_bytes()
    bad = tmp_path / "b.mp4"
    for damaged in (
        content[: len(content) // 2],
        b"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n" + str(good).encode() + b"\n",
        b"ffconcat version 1.0\nfile " + str(good).encode() + b"\n",
    ):
        bad.write_bytes(damaged)
        with refused("b.mp4"):
            extract({"primary": good, "secondary": bad}, VideoSettings("every"), lambda *_: None)
    broken = bytearray(content)
    rng = np.random.default_rng(0)
    for at in rng.integers(50, len(broken) // 2, 300):
        broken[at] = rng.integers(256)
    bad.write_bytes(bytes(broken))
    try:
        extract({"primary": good, "secondary": bad}, VideoSettings("every", 5), lambda *_: None)
    except StereocalError as error:
        assert "b.mp4" in str(error)


def test_frames_are_shown_as_one_goes_also_of_cameras_started_by_hand(tmp_path: Path) -> None:
    seconds = [k / 25 for k in range(30)]
    paths = {
        "primary": write_video(tmp_path / "a.mp4", seconds),
        # Its first frame is the primary's sixth.
        "secondary": write_video(tmp_path / "b.mp4", seconds[:20], numbers=range(5, 25)),
        "third": write_video(tmp_path / "c.mp4", seconds[:25], numbers=range(2, 27)),
    }
    labels = {"primary": "a.mp4", "secondary": "b.mp4", "third": "c.mp4"}
    footage = of_videos(paths, labels, {"secondary": 5, "third": 2})
    assert footage.numbers == list(range(6, 26))
    for number in (6, 20, 8, 25):
        shown = [number_in(footage.grey(camera, number)) for camera in paths]
        assert shown == [number - 1] * 3
    assert number_in(of_videos(paths, labels).grey("secondary", 1)) == 5
    with refused("frames"):
        of_videos(paths, labels, {"third": 1000})


def test_photographs_are_shown_by_their_frames() -> None:
    files = {n: {c: encoded(picture(n)) for c in ("primary", "secondary")} for n in (7, 3)}
    files[5] = {"primary": encoded(picture(5))}
    labels = {"primary": "a", "secondary": "b"}
    footage = of_photographs(files, labels)
    assert footage.numbers == [3, 7]
    assert number_in(footage.grey("secondary", 7)) == 7
    files[7]["primary"] = files[7]["primary"][:-40]
    with refused("PNG"):
        of_photographs(files, labels).picture("primary", 7)
