"""Pairs of photographs by name: the ways in which people name them, and what cannot be told."""

import random
from collections.abc import Iterable, Sequence

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from stereocal.frames.pairing import Pairing, PhotographPair, number_pairs, pair_names
from stereocal.frames.proposal import Choice, propose
from stereocal.system.array_types import FloatArray
from stereocal.system.taken import Source, Taken

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


def made(style: str, frames: set[int]) -> list[PhotographPair]:
    first, second = STYLES[style]
    return [PhotographPair(n, first.format(n=n), second.format(n=n)) for n in sorted(frames)]


def names_of(pairs: list[PhotographPair], seed: int = 1) -> list[str]:
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
    assert [*number_pairs(pairs)] == [1, 2, 3]
    long = {f"*{n}{'0' * 40}": (f"l{n}", f"r{n}") for n in (7, 8)}
    assert [*number_pairs(long)] == [1, 2]


def test_names_that_differ_in_capitals_spaces_and_zeros_pair() -> None:
    found = pair_names(["Left 07.png", "right_7.PNG", "LEFT-08.png", "Right 8.png"])
    assert twos(found) == {("Left 07.png", "right_7.PNG"), ("LEFT-08.png", "Right 8.png")}


# By name, by the time taken, in order

T0 = 1.7e9


def walk(frames: int, seed: int = 1) -> FloatArray:
    """The moments of photographs taken by hand, s."""
    gaps: FloatArray = np.random.default_rng(seed).lognormal(2.5, 0.7, frames)
    return np.cumsum(gaps) + T0


def shots(
    pattern: str,
    moments: FloatArray,
    first: int,
    *,
    source: Source = "camera",
    step: float = 0.01,
    body: str = "",
) -> dict[str, Taken]:
    """Photographs with consecutive numbers and the times of a clock that cuts off its digits."""
    times = np.floor(moments / step) * step
    names = (pattern.format(n=(first + i - 1) % 9999 + 1) for i in range(len(moments)))
    return {
        name: Taken(float(at), step, source, body=body)
        for name, at in zip(names, times, strict=True)
    }


def without_times(names: Iterable[str]) -> dict[str, Taken]:
    return dict.fromkeys(names, Taken())


def straight(
    first: Iterable[str], second: Iterable[str], lost: Sequence[int] = ()
) -> set[tuple[str, str]]:
    """The true pairs of photographs in order; `lost` moments lack in either camera."""
    return {two for i, two in enumerate(zip(first, second, strict=True)) if i not in lost}


@pytest.mark.parametrize("step", [0.01, 1.0])
@pytest.mark.parametrize("clocks_s", [0.0, 12.4, -86_410.3])
def test_photographs_are_paired_by_time_and_a_missing_one_is_named(
    step: float, clocks_s: float
) -> None:
    moments = walk(25)
    late = np.random.default_rng(2).normal(0, 0.05, 25)
    first = shots("IMG_{n:04}.JPG", moments, 1001, step=step)
    second = shots("DSC_{n:04}.jpg", moments + clocks_s + late, 231, step=step)
    found = propose({**first, **second})
    assert found.way == "time" and found.pairing.complete
    assert twos(found.pairing) == straight(first, second)
    assert [pair.frame for pair in found.pairing.pairs] == list(range(1001, 1026))
    if step < 1 and clocks_s > 0:
        assert "25 pairs by the time taken; the clocks are 12.4 s apart" in found.pairing.sentence
    # The thirteenth was not taken by the secondary camera, the twentieth not by the primary.
    names = list(first), list(second)
    rest = {**first, **second}
    del rest[names[1][12]], rest[names[0][19]]
    slipped = propose(rest)
    assert slipped.way == "time"
    assert twos(slipped.pairing) == straight(first, second, (12, 19))
    assert [(one.name, one.camera) for one in slipped.slips] == [
        ("IMG_1013.JPG", 0),
        ("DSC_0250.jpg", 1),
    ]
    assert str(slipped.slips[0]) == (
        "IMG_1013 has no partner: one photograph is missing in the secondary after DSC_0242"
    )
    # In order, they are mended by leaving these out.
    choice = Choice("order", tuple(one.name for one in slipped.slips))
    assert twos(propose(rest, choice).pairing) == twos(slipped.pairing)


def test_times_at_equal_intervals_tell_only_what_they_can() -> None:
    moments: FloatArray = T0 + 5.0 * np.arange(20, dtype=np.float64)
    first, second = shots("IMG_{n}.jpg", moments, 1), shots("DSC_{n}.jpg", moments + 99.0, 301)
    assert propose({**first, **second}).way == "time"
    inside = {**first, **second}
    del inside["DSC_310.jpg"]
    found = propose(inside)
    assert found.way == "time" and [one.name for one in found.slips] == ["IMG_10.jpg"]
    at_the_end = {**first, **second}
    del at_the_end["DSC_320.jpg"]
    open_end = propose(at_the_end)
    assert open_end.pairing.ambiguous and not open_end.slips


def test_bursts_within_one_step_of_the_clock_are_paired_in_order() -> None:
    bursts: FloatArray = (np.floor(walk(8))[:, None] + [0.1, 0.4, 0.7]).ravel()
    first = shots("IMG_{n}.jpg", bursts, 1)
    second = shots("DSC_{n}.jpg", bursts + 50.0, 301, step=1.0)
    found = propose({**first, **second})
    assert found.way == "time" and twos(found.pairing) == straight(first, second)
    del second["DSC_305.jpg"]  # the middle one of the second burst
    fewer = propose({**first, **second})
    assert len(fewer.pairing.pairs) == 23 and fewer.pairing.alone[0].name in (
        "IMG_4.jpg",
        "IMG_5.jpg",
        "IMG_6.jpg",
    )


def test_times_of_unrelated_photographs_pair_nothing() -> None:
    """Of 400 trials with 25 photographs none was sure, with 10 five, with 5 nineteen."""
    for seed in range(10):
        first = shots("IMG_{n}.jpg", walk(20, seed), 1)
        second = shots("DSC_{n}.jpg", walk(20, seed + 100) + 500.0, 301)
        assert propose({**first, **second}).way == "order"


def test_the_times_of_files_that_were_copied_are_not_those_of_photographs() -> None:
    copied: FloatArray = T0 + 0.02 * np.arange(12, dtype=np.float64)
    first = shots("a/IMG_{n}.jpg", copied, 1, source="file", step=1.0)
    second = shots("b/DSC_{n}.jpg", copied + 3.0, 301, source="file", step=1.0)
    assert propose({**first, **second}).way == "order"
    moments = walk(12)
    first = shots("a/IMG_{n}.jpg", moments, 1, source="file", step=1.0)
    second = shots("b/DSC_{n}.jpg", moments + 3.0, 301, source="file", step=1.0)
    found = propose({**first, **second})
    assert found.way == "time" and "12 pairs by the time of the files" in found.pairing.sentence


def test_clocks_contradict_names_whose_counters_differ() -> None:
    """Two cameras of one kind count from different numbers: equal names are not one moment."""
    moments = walk(20)
    first, second = (shots(f"{c}/IMG_{{n:04}}.JPG", moments, n) for c, n in (("A", 1), ("B", 4)))
    found = propose({**first, **second})
    assert found.way == "time" and twos(found.pairing) == straight(first, second)
    renamed = {name.replace("B/IMG_", "B/"): one for name, one in second.items()}
    assert twos(propose({**first, **renamed}).pairing) == straight(first, renamed)
    # Even where the names pair all: one was lost on either side, and the files were renamed.
    lost = [*range(7), *range(8, 20)], [*range(13), *range(14, 20)]
    left, right = (
        shots(f"{side}{{n}}.jpg", moments[own], 1)
        for side, own in zip(("left", "right"), lost, strict=True)
    )
    found = propose({**left, **right})
    assert found.ways["name"].complete and found.way == "time" and len(found.slips) == 2


ORDERED = {
    "two counters": ("IMG_{n:04}.JPG", "DSC_{n:04}.JPG", 1001, 231),
    "rollover": ("IMG_{n:04}.JPG", "DSC_{n:04}.JPG", 9990, 231),
    "rollover of the second": ("IMG_{n:04}.JPG", "DSC_{n:04}.JPG", 9, 9995),
    "no leading zeros": ("a {n}.png", "b-{n}.png", 1, 95),
    "folders": ("one camera/IMG_{n}.JPG", "other/IMG_{n}.JPG", 1, 401),
    "one maker, one folder": ("IMG_{n:04}.JPG", "IMG_{n:04}.JPG", 1001, 4310),
    "words": ("left_{n}.jpg", "right_{n}.jpg", 1, 501),
}


@pytest.mark.parametrize("style", ORDERED)
@pytest.mark.parametrize("mixed", [False, True])
def test_photographs_are_paired_in_the_order_of_their_counters(style: str, mixed: bool) -> None:
    one, two, at, begin = ORDERED[style]
    first = list(shots(one, walk(25), at))
    second = list(shots(two, walk(25), begin))
    given = [*first, *second]
    if mixed:
        random.Random(4).shuffle(given)
    found = propose(without_times(given))
    assert found.way == "order" and found.pairing.complete
    assert {frozenset(two) for two in twos(found.pairing)} == {
        frozenset(two) for two in straight(first, second)
    }
    if not mixed or style == "words":
        assert twos(found.pairing) == straight(first, second)
        turned = propose(without_times(given), Choice(exchanged=True)).pairing
        assert twos(turned) == {(b, a) for a, b in straight(first, second)}
    # One less: it is asked which.
    fewer = propose(without_times([name for name in given if name != second[7]]))
    assert fewer.way == "order" and fewer.pairing.ambiguous and len(fewer.pairing.alone) == 1
    mended = propose(
        without_times(name for name in given if name != second[7]), Choice("order", (first[7],))
    )
    assert {frozenset(two) for two in twos(mended.pairing)} == {
        frozenset(two) for two in straight(first, second, (7,))
    }


def test_names_pair_by_any_two_beginnings_folders_or_numbers() -> None:
    for one, two in (
        ("links_{n}.png", "rechts_{n}.png"),
        ("Canon/IMG_{n}.JPG", "Nikon/IMG_{n}.JPG"),
        ("x{n}_0.png", "x{n}_1.png"),
        ("secondary/DSC_{n}.JPG", "primary/IMG_{n}.JPG"),
        ("primary/x{n}_0.png", "secondary/x{n}_1.png"),
        ("kamera3_{n}.png", "kamera7_{n}.png"),
    ):
        first, second = ([text.format(n=n) for n in (8, 9, 10, 12)] for text in (one, two))
        found = propose(without_times([*first, *second]))
        assert found.way == "name" and found.pairing.complete, one
        own = (second, first) if one.startswith("secondary") else (first, second)
        assert twos(found.pairing) == straight(*own)
        assert [pair.frame for pair in found.pairing.pairs] == [8, 9, 10, 12]


def test_the_camera_that_the_file_names_tells_whose_it_is() -> None:
    moments = walk(10)
    first = shots("P{n:04}.JPG", moments, 1, body="maker 1 serial 7")
    second = shots("P{n:04}.JPG", moments + 5.0, 11, body="maker 1 serial 8")
    between = {
        name: one for two in zip(first.items(), second.items(), strict=True) for name, one in two
    }
    found = propose(between)
    assert found.way == "time" and twos(found.pairing) == straight(first, second)


def test_a_zone_that_changed_in_between_is_allowed_for() -> None:
    moments = walk(12)
    phone = {
        f"PXL_{i}.jpg": Taken(
            float(at + (3600 if i < 6 else 0)), 0.001, "camera", 3600.0 if i < 6 else 0.0
        )
        for i, at in enumerate(moments)
    }
    other = shots("DSC_{n}.jpg", moments + 7.0, 10)
    found = propose({**phone, **other})
    assert found.way == "time" and twos(found.pairing) == straight(phone, other)
