"""When and with which camera a photograph was taken, from its header, its name or its file."""

import io
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from stereocal.system.taken import EXIF, Taken, read_taken, time_in_name

NOON = 1_714_564_800.0
"""2024-05-01, 12:00:00."""


def photograph(form: str, top: dict[int, Any], own: dict[int, Any]) -> bytes:
    tags = Image.Exif()
    tags.update(top)
    tags.get_ifd(EXIF).update(own)
    packed = io.BytesIO()
    Image.new("L", (40, 30)).save(packed, form, exif=tags)
    return packed.getvalue()


@pytest.mark.parametrize("form", ["JPEG", "PNG"])
def test_the_clock_of_the_camera(form: str, tmp_path: Path) -> None:
    own = {0x9003: "2024:05:01 12:00:00", 0x9291: "125", 0x9011: "+02:00", 0xA431: "77"}
    content = photograph(form, {0x010F: "Maker", 0x0110: "One"}, own)
    path = tmp_path / "IMG_20200101_000000"
    path.write_bytes(content)
    for file in (content, path):
        found = read_taken(file, "IMG_20200101_000000.jpg", modified=5.0)
        assert found == Taken(NOON + 0.125, 1e-3, "camera", 7200.0, "Maker One 77", (40, 30))


def test_what_is_not_a_date_or_is_damaged_says_nothing() -> None:
    for bad in ("0000:00:00 00:00:00", "    :  :     :  :  ", "2024-05", ""):
        for form in ("JPEG", "TIFF"):
            content = photograph(form, {0x0132: "2024:05:01 12:00:00"}, {0x9003: bad, 0x9291: "x"})
            assert read_taken(content, "a.jpg").seconds == NOON
    whole = photograph("JPEG", {}, {0x9003: "2024:05:01 12:00:00"})
    for length in (0, 3, 30, 60, 90):
        assert read_taken(whole[:length], "a.jpg").seconds in (None, NOON)
    assert read_taken(b"", "a.jpg", modified=5.0) == Taken(5.0, 2.0, "file")


@pytest.mark.parametrize(
    ("name", "seconds", "step"),
    [
        ("IMG_20240501_120000.jpg", NOON, 1.0),
        ("PXL_20240501_120000125.MP.jpg", NOON + 0.125, 1e-3),
        ("a/2024-05-01 12.00.00.jpg", NOON, 1.0),
        ("20240501_120000_017.jpg", NOON, 1.0),
        ("left/1714564800125000000.png", NOON + 0.125, 1e-9),
        ("1714564800.125.png", NOON + 0.125, 1e-3),
        ("20249901_120000.jpg", None, None),
        ("IMG_1001.jpg", None, None),
    ],
)
def test_times_in_names(name: str, seconds: float | None, step: float | None) -> None:
    found = time_in_name(name)
    assert (found is None) == (seconds is None)
    if found is not None:
        assert found == pytest.approx((seconds, step), abs=1e-6)
