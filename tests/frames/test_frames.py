"""What is kept of photographed frames, and the table and the pictures that are made of it."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from stereocal.detection.detect import State
from stereocal.formats.correspondences_csv import read_table, write_table
from stereocal.frames.frame import (
    Centre,
    CentrePair,
    Frame,
    correspondences_of,
    pack_frames,
    unpack_frames,
)
from stereocal.frames.thumbnails import HEIGHT, WIDTH, box_around, tile

PRIMARY: CentrePair = (Centre(10.0, 20.0, 0.1), Centre(30.0, 40.0, 0.2, "corrected"))
SECONDARY: CentrePair = (Centre(11.0, 21.0, None, "manual"), Centre(31.0, 41.0, 0.3))


def frame(number: int = 1, state: State = "found", use: bool = True) -> Frame:
    files = (f"left{number}.png", f"right{number}.png")
    return Frame(number, files, (PRIMARY, SECONDARY), state, "", use)


coordinates = st.floats(-1e4, 1e4)
centres = st.none() | st.builds(
    Centre,
    coordinates,
    coordinates,
    st.none() | st.floats(1e-6, 10),
    st.sampled_from(["detected", "corrected", "manual"]),
)
frames = st.builds(
    Frame,
    st.integers(1 - 2**53, 2**53 - 1),
    st.tuples(st.text(), st.text()),
    st.tuples(st.tuples(centres, centres), st.tuples(centres, centres)),
    st.sampled_from(["found", "doubtful", "refused"]),
    st.text(),
    st.booleans(),
)


@given(st.lists(frames, max_size=5))
@settings(max_examples=15)
def test_there_and_back(given_frames: list[Frame]) -> None:
    assert unpack_frames(pack_frames(given_frames)) == given_frames


def test_the_table_has_what_both_cameras_see_in_used_frames() -> None:
    half = frame(3).moved(1, 0, None)
    rows = correspondences_of([half, frame(2, use=False), frame(1)])
    np.testing.assert_array_equal(rows.frame, [1, 1, 3])
    np.testing.assert_array_equal(rows.target, [0, 1, 1])
    np.testing.assert_array_equal(rows.primary, [[10, 20], [30, 40], [30, 40]])
    np.testing.assert_array_equal(rows.secondary, [[11, 21], [31, 41], [31, 41]])
    np.testing.assert_array_equal(rows.sigma_primary_px, [0.1, 0.2, 0.2])
    np.testing.assert_array_equal(rows.sigma_secondary_px, [np.nan, 0.3, 0.3])
    # A row is as little automatic as the less automatic one of its points.
    np.testing.assert_array_equal(rows.source, [2, 1, 1])
    back = read_table(write_table(rows), "t").strict("t")
    np.testing.assert_array_equal(back.source, rows.source)


class TestThumbnails:
    image = np.full((400, 600), 90, np.uint8)

    @given(st.tuples(centres, centres), st.integers(16, 900), st.integers(16, 900))
    def test_any_centres_in_any_image(self, pair: CentrePair, width: int, height: int) -> None:
        left, top, right, bottom = box_around(pair, (height, width))
        assert 0 <= left < right <= width and 0 <= top < bottom <= height
        inside = [c for c in pair if c and 0 <= c.u <= width - 1 and 0 <= c.v <= height - 1]
        if len(inside) == sum(one is not None for one in pair):
            assert all(left <= c.u <= right and top <= c.v <= bottom for c in inside)
        assert tile(np.zeros((height, width), np.uint8), pair).shape == (HEIGHT, WIDTH, 3)
