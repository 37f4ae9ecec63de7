"""The ends of a bar from a table of a tracking program, which may have several cameras."""

from __future__ import annotations

from dataclasses import dataclass, replace

from stereocal.errors import StereocalError
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.exchange.reading import chosen_pair
from stereocal.formats.point_files import read_bars
from stereocal.formats.point_layouts import propose_layout
from stereocal.rig.dataset import Correspondences

Heights = tuple[int | None, int | None]
"""Of the images of the primary and the secondary, px."""


@dataclass(frozen=True, eq=False)
class Bars:
    """The rows of a table, and how it was read."""

    rows: Correspondences
    words: str
    remarks: tuple[str, ...] = ()
    """For the user."""


def holds_bars(content: bytes, source: str) -> bool:
    """Whether a file seems to have two or more points in two or more cameras."""
    try:
        layout = propose_layout(content, source)
    except StereocalError:
        return False
    return len(layout.cameras) > 1 and len(layout.points) > 1


def bars_of(content: bytes, source: str, options: ExchangeOptions, heights: Heights) -> Bars:
    """The bars in a file."""
    layout = propose_layout(content, source, options.layout)
    if len(layout.points) < 2:
        raise StereocalError(
            f"a table with both ends of the bar is expected; this looks like {layout.program} with "
            f"the points {', '.join(layout.points)[:60]}.",
            source,
        )
    layout = replace(layout, origin=options.origin(layout.origin))
    chosen = chosen_pair(layout.cameras, options.cameras, source)
    if layout.origin.corner == "lower-left" and None in heights:
        raise StereocalError(
            "the points are counted from the lower left, so the image height is needed: give the "
            "camera files, or --image-size WxH.",
            source,
        )
    remarks, ends = chosen.remarks, options.ends or (layout.points[0], layout.points[1])
    if ends[0] == ends[1]:
        raise StereocalError(
            f"the ends A and B are the same point ({ends[0]}): choose two.", source
        )
    if len(layout.points) > 2 and options.ends is None:
        remarks += (
            f"There are {len(layout.points)} points; {ends[0]} and {ends[1]} were taken as the "
            "ends A and B of the bar.",
        )
    rows = read_bars(content, layout, chosen.names, ends, heights, source)
    corner = layout.origin.corner.replace("-", " ")
    return Bars(rows, f"{layout.program}, {chosen.words}, counted from the {corner}", remarks)
