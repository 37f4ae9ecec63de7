"""Point files of tracking programs: layout told by the header, points counted as ours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stereocal.errors import StereocalError
from stereocal.formats.point_files import read_points
from stereocal.formats.point_layouts import propose_layout
from tests.known_rig import bar_ends, images

FIRST, SECOND = images(bar_ends(6))
HEIGHTS = (1200, 1024)


def wand(header: str = "") -> bytes:
    """Three cameras, both ends, from the lower left; the third sees nothing."""
    lines = [header] if header else []
    for k in range(6):
        cells = []
        for end in (0, 1):
            for view, height in zip((FIRST, SECOND), HEIGHTS, strict=True):
                u, v = view[2 * k + end]
                cells += [u, height - v]
            cells += [np.nan, np.nan]
        lines.append(",".join("NaN" if np.isnan(x) else repr(float(x)) for x in cells))
    lines[-1] = ",".join(["0"] * 12)
    return ("\n".join(lines) + "\n").encode()


def test_deeplabcut_with_several_animals() -> None:
    content = (
        b"scorer,net,net,net\nindividuals,a,a,a\nbodyparts,nose,nose,nose\n"
        b"coords,x,y,likelihood\n0,1,2,1\n"
    )
    assert propose_layout(content, "dlc.csv").points == ("a nose",)


@pytest.mark.parametrize(("unit", "asks"), [("(pixel)", False), ("(micron)", True)])
def test_trackmate(unit: str, asks: bool) -> None:
    content = (
        "LABEL,ID,TRACK_ID,QUALITY,POSITION_X,POSITION_Y,POSITION_Z,FRAME\n"
        "Label,Spot ID,Track ID,Quality,X,Y,Z,Frame\n"
        "Label,Spot ID,Track ID,Quality,X,Y,Z,Frame\n"
        f",,,(quality),{unit},{unit},{unit},\n"
        "ID7,7,3,1.5,100.5,50.25,0,2\nID8,8,3,1.5,101.5,51.25,0,1\n"
    ).encode()
    layout = propose_layout(content, "spots.csv")
    assert layout.program == "TrackMate"
    assert any("micron" in question for question in layout.questions) == asks
    table = read_points(content, replace(layout, px_per_unit=2.0), "cam1")
    assert list(table) == ["frame", "u", "v", "track"]
    assert table["frame"].tolist() == [1, 2]  # in the order of the frames
    assert table["u"].tolist() == [203.0, 201.0]
    assert table["track"].tolist() == ["3", "3"]


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "empty"),
        (b"frame,u,v\n", "x.csv"),
        (b"\x00\x01\x02\n\x03", "text file"),
        (b"name,size\nx,1\n", "layout"),
        (b"1,2,3\n4,5,6\n", "layout"),
    ],
)
def test_what_is_no_point_file(content: bytes, says: str) -> None:
    with pytest.raises(StereocalError, match=says):
        propose_layout(content, "x.csv")
