"""Is a board as long along its rows, compared with its columns, as is stated?

Printers stretch a page by a per cent along one side. The cameras see it: the corners of each board,
as they are reconstructed, give the lengths along both sides, whose ratio depends neither on the
scale nor, over boards turned in all directions, on the lenses. Where all rows are level, or all
upright, wrong ratios of fx and fy look the same.
"""

import numpy as np

from stereocal.errors import StereocalError
from stereocal.fit.refined_result import RefinedResult
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import rounded

SURE = 5.0
"""Standard errors. Of 24 simulated sound pairs with 20 boards at most 2.5; with boards stretched by
0.5 % 26 in the median, by 1.5 % 77 and at least 12."""
SMALLEST = 0.003
"""Of a stretch that is named: of sound pairs 0.0014 at most, from errors of the lenses."""
LARGEST = 0.01
"""A larger one is rejected: no file says that its lengths are wrong by so much."""
HELD_ALIKE = 0.5
"""Share of a wrong ratio of fx and fy that looks like a stretch: 1 where all rows are level, 0 over
all directions. Above it the two are not told apart."""
FEWEST = 5
"""Boards, and corners of each."""


def stretched_board(fit: RefinedResult) -> str:
    """What a ruler along both sides of the board would show; empty if the images do not tell.

    Raises:
        StereocalError: says the same of a stretch above `LARGEST`, of boards not held alike.
    """
    board = fit.dataset.board
    if board is None:
        return ""
    stretches, level = _stretches(fit).T
    if len(stretches) < FEWEST:
        return ""
    stretch = float(stretches.mean())
    sigma = float(stretches.std(ddof=1)) * np.sqrt(fit.design_effect / len(stretches))
    if abs(stretch) < max(SMALLEST, SURE * sigma):
        return ""
    row, column = (1000.0 * board.square_m * (n - 1) for n in (board.columns, board.rows))
    along, across = ("rows", "columns") if stretch > 0.0 else ("columns", "rows")
    message = (
        f"By the images the {along} of the board are {rounded(100 * abs(stretch))} ± "
        f"{rounded(100 * sigma)} % longer than stated, compared with its {across}: was it "
        "stretched by the printer? Lengths are wrong by up to as much. Measure with a ruler from "
        f"the first corner to the last: stated are {row:.1f} mm along a row and {column:.1f} mm "
        f"along a column; it will be {row * np.exp(stretch):.1f} mm and {column:.1f} mm, or "
        f"{row:.1f} mm and {column * np.exp(-stretch):.1f} mm, or between. Print it again, or "
        "state the measured places of its corners as an object."
    )
    if abs(level.mean()) > HELD_ALIKE:
        return (
            f"{message} The boards were all held alike: lenses whose fx and fy are in a wrong "
            "ratio would look the same. Check them too, or record boards with their rows level and "
            "others with them upright."
        )
    if abs(stretch) > LARGEST:
        raise StereocalError(message)
    return message


def _stretches(fit: RefinedResult) -> FloatArray:
    """(b, 2): of each board the length along its rows over that along its columns, over those
    stated, in logarithms; and whether its rows are level (1) or upright (-1) in the image."""
    rows = fit.dataset.correspondences.where(fit.used_rows)
    assert rows.rigid_object is not None
    points = fit.rig.reconstruct(rows.primary, rows.secondary)
    known, stretches = np.isfinite(points).all(axis=1), []
    corners = np.column_stack([rows.rigid_object.points[rows.target][:, :2], np.ones(len(rows))])
    for frame in rows.frames:
        of_frame = known & (rows.frame == frame)
        if of_frame.sum() < FEWEST or np.linalg.matrix_rank(corners[of_frame]) < 3:
            continue
        sides = np.linalg.lstsq(corners[of_frame], points[of_frame], rcond=None)[0][:2]
        along, across = np.linalg.norm(sides, axis=1)
        level = np.cos(2.0 * np.arctan2(sides[0, 1], sides[0, 0]))
        stretches.append((np.log(along / across), level))
    return np.array(stretches).reshape(-1, 2)
