"""Markers are read in the dictionaries that may be there, and none is lost by that."""

import cv2
import numpy as np
import pytest

from stereocal.intrinsics.markers import DICTIONARIES, markers_in
from tests.intrinsics.test_held_object import renderings
from tools.photographs.objects import Kind


@pytest.mark.parametrize("kind", ["board", "charuco", "tags"])
def test_as_opencv_reads_them_in_all_dictionaries(kind: Kind) -> None:
    """Also of 78 photographs of all kinds and of the sample data."""
    own, _ = renderings(kind, 2)
    grey = np.asarray(cv2.cvtColor(next(iter(own.values())), cv2.COLOR_BGR2GRAY), np.uint8)
    found = markers_in(grey)
    assert kind == "board" or "4X4_250" in found
    for name in DICTIONARIES:
        printed = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))
        corners, numbers, _ = cv2.aruco.ArucoDetector(printed).detectMarkers(grey)
        assert (numbers is not None) == (name in found)
        if name in found:
            np.testing.assert_array_equal(found[name][0], np.ravel(numbers))
            np.testing.assert_array_equal(found[name][1], np.reshape(corners, (-1, 4, 2)))
