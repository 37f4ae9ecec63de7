"""Pairs of photographs by name: the ways in which people name them, and what cannot be told."""

import random

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from stereocal.frames.pairing import Pair, Pairing, number_pairs, pair_names

STYLES = {
    "left01": ("left{n:02}.png", "right{n:02}.png"),
    "left-0000": ("left-{n:04}.jpg", "right-{n:04}.jpg"),
    "cam folders": ("rig/cam0/{n:04}.tif", "rig/cam1/{n:04}.tif"),
    "cam folders and names": ("cam0/cam0_{n}.tif", "cam1/cam1_{n}.tif"),
    "Cam1_": ("Cam1_img_{n:03}.tif", "Cam2_img_{n:03}.tif"),
    "camera_01": ("camera_01_{n:03}.tif", "camera_02_{n:03}.tif"),
    "_L": ("IMG_{n:04}_L.JPG", "IMG_{n:04}_R.JPG"),
    "07L": ("{n:02}L.bmp", "{n:02}R.bmp"),
    "L7": ("L{n}.bmp", "R{n}.bmp"),
    "A folder": ("A/{n}.png", "B/{n}.png"),
    "c1": ("run1_c1_{n:04}.png", "run1_c2_{n:04}.png"),
    "image_0": ("image_0/{n:06}.png", "image_1/{n:06}.png"),
    "image_00": ("drive/image_00/{n:06}.png", "drive/image_01/{n:06}.png"),
    "numbers": ("0/{n:06}.png", "1/{n:06}.png"),
    "words": ("Left camera/frame {n}.png", "Right camera/frame {n}.png"),
    "LeftCam": ("LeftCam{n}.png", "RightCam{n}.png"),
    "ours": ("primary/{n}.png", "secondary/{n}.png"),
    "ours and theirs": ("primary/left{n}.png", "secondary/right{n}.png"),
    "ours, other kinds": ("primary/{n}.png", "secondary/{n}.tif"),
    "frame folders": ("{n}/left.png", "{n}/right.png"),
    "both words in a folder": ("stereo_left_right/left{n}.png", "stereo_left_right/right{n}.png"),
    "windows": ("C:\\bat\\left\\{n}.png", "C:\\bat\\right\\{n}.png"),
    "date": ("left_{n:04}_2024.png", "right_{n:04}_2024.png"),
}
FRAMES = st.sets(st.integers(0, 9999), min_size=1, max_size=12)


def made(style: str, frames: set[int]) -> list[Pair]:
    first, second = STYLES[style]
    return [Pair(n, first.format(n=n), second.format(n=n)) for n in sorted(frames)]


def names_of(pairs: list[Pair], seed: int = 1) -> list[str]:
    names = [name for pair in pairs for name in (pair.primary, pair.secondary)]
    random.Random(seed).shuffle(names)
    return names


def twos(pairing: Pairing) -> set[tuple[str, str]]:
    return {(pair.primary, pair.secondary) for pair in pairing.pairs}


@pytest.mark.parametrize("style", STYLES)
@given(frames=FRAMES, seed=st.integers(0, 99))
@example({3, 7, 12, 110}, 1)
@settings(max_examples=5)
def test_the_ways_of_naming(style: str, frames: set[int], seed: int) -> None:
    pairs = made(style, frames)
    found = pair_names(names_of(pairs, seed))
    assert twos(found) == {(pair.primary, pair.secondary) for pair in pairs}
    assert not found.alone and not found.unknown and not found.ambiguous
    assert found.sentence.startswith(f"{len(pairs)} pair")
    # One "date" pair alone is numbered by its last number, the year; and a few folders called by
    # numbers can be cameras as well as frames.
    if len(frames) > 1:
        assert list(found.pairs) == pairs


@given(
    style=st.sampled_from(sorted(set(STYLES) - {"frame folders"})),
    frames=st.sets(st.integers(0, 9999), min_size=3, max_size=12),
    data=st.data(),
)
def test_a_lost_twin_is_named_and_the_others_stay(
    style: str, frames: set[int], data: st.DataObject
) -> None:
    pairs = made(style, frames)
    lost = data.draw(st.sampled_from(pairs))
    camera = data.draw(st.integers(0, 1))
    gone = (lost.primary, lost.secondary)[camera]
    found = pair_names([name for name in names_of(pairs) if name != gone])
    assert twos(found) == {(p.primary, p.secondary) for p in pairs if p != lost}
    assert [(one.name, one.camera) for one in found.alone] == [
        ((lost.secondary, lost.primary)[camera], 1 - camera)
    ]
    twin = found.alone[0].twin
    assert twin.replace("/", "\\").rsplit(".")[0] == gone.replace("/", "\\").rsplit(".")[0]
    assert twin in found.sentence


def test_frames_are_counted_where_no_number_tells_them_apart() -> None:
    pairs = {"*a": ("la", "ra"), "*b": ("lb", "rb"), "*9": ("l9", "r9")}
    assert [pair.frame for pair in number_pairs(pairs)] == [1, 2, 3]
    long = {f"*{n}{'0' * 40}": (f"l{n}", f"r{n}") for n in (7, 8)}
    assert [pair.frame for pair in number_pairs(long)] == [1, 2]
