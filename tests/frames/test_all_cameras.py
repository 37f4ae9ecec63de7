"""Photographs of three cameras, to one recording."""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from stereocal.detection.target import parse_target
from stereocal.fit.calibrate import calibrate_rig
from stereocal.frames.all_cameras import Found, by_folder, in_one_order, match_names
from stereocal.frames.pairing import Pairing
from stereocal.frames.search import detect_frames
from stereocal.rig.rigid_object import RigidObject
from stereocal.system.photograph_files import photographs_in
from tests.files import encoded, write
from tests.frames.test_pairing import shots, walk
from tests.further import further
from tests.photographs.small_rig import BAR_M, CAMERAS, POSES, TAGS, photographed_bars
from tests.refused import refused

EITHER_WAY = [np.array([0, 1]), np.array([1, 0])]
FRAMES = {"bar2x2": 12, TAGS: 8}


def search(files: Mapping[str, bytes], kind: str) -> Found:
    with TemporaryDirectory() as folder, ThreadPoolExecutor(2) as executor:
        write(dict(files), Path(folder))
        found = photographs_in(Path(folder), Path(folder))
        about = Pairing(match_names(by_folder(files, CAMERAS))), found, CAMERAS, parse_target(kind)
        return detect_frames(*about, executor, lambda _: None, lambda *_: None)


@lru_cache
def seen_in_part(kind: str) -> Found:
    """Each camera sees nothing in one frame, and one photograph is missing."""
    files = dict(photographed_bars(kind, FRAMES[kind])[0])
    blank = encoded(np.full((600, 800), 110, np.uint8))
    files |= {"left/0002.png": blank, "mid/0003.png": blank, "right/0004.png": b"damaged"}
    del files["left/0005.png"]
    return search(files, kind)


@pytest.mark.parametrize("kind", ["bar2x2", *further(TAGS)])
def test_all_cameras_name_the_ends_alike(kind: str) -> None:
    found, (_, truth) = seen_in_part(kind), photographed_bars(kind, FRAMES[kind])
    recording = found.recording
    seen, exchanged = set(), set()
    for frame in range(1, FRAMES[kind] + 1):
        apart = []
        for number, name in enumerate(CAMERAS):
            rows = (recording.frame == frame) & (recording.camera == number)
            if rows.any():
                assert recording.target[rows].tolist() == [0, 1]
                own, true = recording.points[rows], truth[f"{name}/{frame:04}.png"]
                apart.append([np.abs(own - true[way]).max() for way in EITHER_WAY])
                seen.add((frame, name))
        # One order fits all cameras of a frame.
        way = int(np.argmin(np.max(apart, axis=0)))
        assert np.max(apart, axis=0)[way] < 0.3
        exchanged.add(way)
    unseen = {(2, "left"), (3, "mid"), (4, "right"), (5, "left")}
    assert seen == {*product(range(1, FRAMES[kind] + 1), CAMERAS)} - unseen
    assert exchanged == ({0} if kind == TAGS else {0, 1})
    unused = [line.split(":")[0] for line in found.unused]
    assert unused == ["left/0002.png", "mid/0003.png", "right/0004.png"]
    assert (recording.sigma_px > 0).all()


def test_the_recording_gives_the_true_rig() -> None:
    bar = RigidObject.bar(BAR_M)
    rig = calibrate_rig(replace(seen_in_part("bar2x2").recording, object=bar))
    for name, pose in POSES.items():
        found = rig.poses[name]
        apart = np.linalg.norm(found.inverse().T - pose.inverse().T)
        assert apart < 0.01


def test_pairs_are_joined_and_contradictions_named() -> None:
    points = {name: np.array([[k, 1.0, 0.1], [k, 2.0, np.nan]]) for k, name in enumerate("abcd")}

    def pair(one: str, other: str, swapped: bool = False) -> tuple[np.ndarray, np.ndarray]:
        return points[one], points[other][::-1] if swapped else points[other]

    ways, first = EITHER_WAY, {("a", "b"): pair("a", "b", True)}
    chain = first | {("b", "c"): pair("b", "c"), ("c", "d"): pair("c", "d")}
    joined, agree = in_one_order(chain, ways)
    assert agree and list(joined) == ["a", "b", "c", "d"]
    assert [joined[each][0, 1] for each in "abcd"] == [1.0, 2.0, 2.0, 2.0]
    assert in_one_order({**chain, ("a", "d"): pair("a", "d", True)}, ways)[1]
    assert not in_one_order({**chain, ("a", "d"): pair("a", "d")}, ways)[1]
    # What shares no camera with the first pair has no order with it.
    apart, agree = in_one_order({("a", "b"): pair("a", "b"), ("c", "d"): pair("c", "d")}, ways)
    assert agree and list(apart) == ["a", "b"]


def test_photographs_of_one_moment_have_one_name() -> None:
    def matched(**folders: str) -> dict[int, dict[str, str]]:
        names = {
            key: [f"{key}/{name}.png" for name in text.split()] for key, text in folders.items()
        }
        found = match_names(names)
        return {frame: dict(files) for frame, files in found.items()}

    assert matched(a="07 08", b="08 09", c="07") == {
        7: {"a": "a/07.png", "c": "c/07.png"},
        8: {"a": "a/08.png", "b": "b/08.png"},
    }
    two = matched(a="cam1_07 cam1_11", b="cam2_11 cam2_12", c="11_c3 12_c3")
    assert {frame: [*files] for frame, files in two.items()} == {11: [*"abc"], 12: [*"bc"]}
    long = "9" * 5000  # which Python makes no number of
    assert len(matched(a=f"1 {long}", b=f"1 {long}", c="1")) == 2
    with refused("name"):
        matched(a="x y z", b="p q r")  # never by their order
    with refused("photographs of a "):
        match_names({"a": ["a/7.png", "a/7.jpg"], "b": ["b/7.png"]})


def test_photographs_with_counters_of_their_own_are_matched_by_time() -> None:
    moments = walk(15)
    patterns = {"a": ("a/IMG_{n}.jpg", 1001), "b": ("b/DSC_{n}.jpg", 231), "c": ("c/P{n}.jpg", 9)}
    shot = {
        camera: shots(pattern, moments + 50.0 * k, first)
        for k, (camera, (pattern, first)) in enumerate(patterns.items())
    }
    del shot["c"]["c/P12.jpg"]
    taken = {name: one for own in shot.values() for name, one in own.items()}
    found = match_names({camera: [*own] for camera, own in shot.items()}, taken)
    assert [*found] == list(range(1001, 1016))
    assert found[1003] == {"a": "a/IMG_1003.jpg", "b": "b/DSC_233.jpg", "c": "c/P11.jpg"}
    assert found[1004] == {"a": "a/IMG_1004.jpg", "b": "b/DSC_234.jpg"}
    # Cameras of one kind count from different numbers: equal names are not one moment.
    alike = {c: shots(f"{c}/IMG_{{n}}.jpg", moments, k) for c, k in (("a", 1), ("b", 5), ("c", 3))}
    taken = {name: one for own in alike.values() for name, one in own.items()}
    found = match_names({camera: [*own] for camera, own in alike.items()}, taken)
    assert found[1] == {"a": "a/IMG_1.jpg", "b": "b/IMG_5.jpg", "c": "c/IMG_3.jpg"}
