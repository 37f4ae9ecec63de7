"""Clicked points as tables of other programs, which read them on."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from stereocal.matching.clicks import Clicks


def dltdv_table(clicks: Clicks, cameras: Sequence[str]) -> str:
    """DLTdv8's flat table of all cameras (`xypts.csv`): a row for each frame from 1."""
    frames = range(1, max((each.frame for each in clicks.every.values()), default=0) + 1)
    found = {}
    for number, track in enumerate(clicks.tracks, 1):
        for which, camera in enumerate(cameras, 1):
            pixels = np.full((len(frames), 2), np.nan)
            for each in clicks.along(track, camera):
                if each.frame >= 1:
                    pixels[each.frame - 1] = each.u + 1.0, each.v + 1.0
            found[f"pt{number}_cam{which}_U"], found[f"pt{number}_cam{which}_V"] = pixels.T
    return pd.DataFrame(found).to_csv(index=False, na_rep="NaN", lineterminator="\n")


def sleap_table(clicks: Clicks, camera: str) -> str:
    """SLEAP's table of one camera: a row for each track and frame, of one node."""
    columns = ["track", "frame_idx", "instance.score", "point.x", "point.y", "point.score"]
    rows = [
        (track, each.frame, 1.0, each.u, each.v, 1.0)
        for track in clicks.tracks
        for each in clicks.along(track, camera)
    ]
    return pd.DataFrame(rows, columns=columns).to_csv(index=False, lineterminator="\n")
