"""Centres of tags, against renderings."""

import numpy as np
import pytest

from stereocal.detection.tags import find_tags
from stereocal.detection.target import Tags, parse_target
from stereocal.errors import StereocalError
from stereocal.system.array_types import FloatArray
from tests.further import further
from tests.photographs.small_rig import PRIMARY
from tools.photographs.bars import facing, rod
from tools.photographs.objects import tag
from tools.photographs.rendering import HERE, PhotographSettings, Placed, photograph

TAG_M, IDS = 0.1, (3, 7)
TARGET = Tags("4X4_50", IDS)


def errors(side_px: float, count: int, blur_px: float) -> tuple[FloatArray, FloatArray]:
    """Errors (n, 2) px and the stated sigmas (n, 1) of tags of about this size."""
    rng = np.random.default_rng([int(side_px), int(10 * blur_px)])
    off, sigma = [], []
    depth = PRIMARY.K[0, 0] * TAG_M / side_px
    for _ in range(count):
        corners = rng.uniform((-0.3, -0.2), (-0.15, 0.2)), rng.uniform((0.15, -0.2), (0.3, 0.2))
        ends = depth * np.array([[*corner, 1.0] for corner in corners])
        things = [rod(ends[0], ends[1], HERE.T, 0.02)]
        for number, end in zip(IDS, ends, strict=True):
            turned = rng.uniform((0, -3, -3), (0.8, 3, 3)).tolist()
            things.append(Placed(tag(number, TAG_M), facing(end, HERE.T, *turned)))
        image = photograph(PRIMARY, 110.0, things, PhotographSettings(blur_px), rng)
        found, truth = find_tags(image, TARGET, PRIMARY), PRIMARY.project(ends)
        for spot, true in zip(found.spots, truth, strict=True):
            assert spot is not None and not spot.doubts
            off.append((spot.u - true[0], spot.v - true[1]))
            sigma.append([spot.sigma_px])
    return np.array(off), np.array(sigma)


@pytest.mark.parametrize("side_px", [40, *further(80)])
def test_centres_without_a_bias(side_px: float) -> None:
    both = [errors(side_px, 6, blur) for blur in (0.8, 1.4)]
    off, sigma = (np.concatenate(part) for part in zip(*both, strict=True))
    # Wanted: 0.08 px. Measured: 0.03 px at 40 px, 0.012 px at 80 px.
    assert np.sqrt((off**2).mean()) < 0.06
    # OpenCV's AprilTag refinement is 0.5 px off in both directions.
    assert np.abs(off.mean(axis=0)).max() < 0.02
    # Measured over 96 centres each: 0.9 to 1.1.
    assert 0.6 < np.sqrt(((off / sigma) ** 2).mean()) < 1.5


def test_a_missing_tag_is_named() -> None:
    grey = np.full((200, 300), 120, np.uint8)
    found = find_tags(grey, TARGET)
    assert found.spots == (None, None)
    assert "3" in found.missing and "7" in found.missing


NO_TARGETS = """tag bar2x2:4 tags: tags:9X9_50:1,2 tags:4X4_50:3 tags:4X4_50:3,3 tags:4X4_50:3,50
balls balls:red balls:red,blurple balls:bright,red balls:red,blue,red"""


@pytest.mark.parametrize("text", ["", f"tags:4X4_50:3,{'9' * 5000}", *NO_TARGETS.split()])
def test_what_is_no_target_is_refused(text: str) -> None:
    with pytest.raises(StereocalError):
        parse_target(text)


@pytest.mark.parametrize("text", ["tags:DICT_4X4_50:3,7", "tags:4X4_50: 3, 7"])
def test_tags_are_described(text: str) -> None:
    assert parse_target(text) == TARGET
