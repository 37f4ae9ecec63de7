"""The field sheet: places of the bar that both cameras see, and one page that says all."""

from io import BytesIO

import numpy as np
import pypdfium2
import pytest

from stereocal.field.planning.bars import bar_places, margin_px
from stereocal.field.planning.plan import AimedPose, Plan, SensorLens, sees
from stereocal.field.printing.sheet import field_sheet
from stereocal.rig.geometry import Pose
from tests.field.plans import plan
from tools.photographs.rendering import turned

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
    document = pypdfium2.PdfDocument(BytesIO(pdf))
    try:
        assert len(document) == 1
        words: str = document[0].get_textpage().get_text_range()
    finally:
        document.close()
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
