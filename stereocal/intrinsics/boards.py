"""Find the inner corners of a chessboard or ChArUco board in photographs.

search = find_boards(photographs, BoardPattern.parse("18x12", square_m=0.03), executor)
"""

import hashlib
import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from stereocal.detection.intensity import eight_bits
from stereocal.errors import StereocalError
from stereocal.intrinsics.board_corners import (
    LARGE_PX,
    OF_OUTER,
    are_crossings,
    find_charuco,
    find_chessboard,
    goes_on,
    halved,
    refine_corners,
)
from stereocal.intrinsics.proposed_board import proposed_board
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.photograph import GreyImage, PhotographFile, read_photograph
from stereocal.system.photograph_files import Photographs, for_worker
from stereocal.system.tasks import Earlier, Progress, Task, run_tasks

MINIMUM_SPACING_PX = 5.0
"""Closer corners overlap: the board is seen edge-on or too far away."""
MINIMUM_CORNERS = 8
SIZE_CHECK_AFTER = 8
"""Photographs after which the stated board size is checked: with a wrong size a search takes ten
times as long, or finds a part of a larger board."""


@dataclass(frozen=True, eq=False)
class BoardView:
    """A board found in a photograph."""

    name: str
    image_size: tuple[int, int]
    """(width, height)."""
    ids: IntArray
    """(n,): rows of `BoardPattern.points`."""
    corners: FloatArray
    """(n, 2): raw pixels."""
    turned: bool = False
    """Whether the order of the corners was corrected."""


class Refused(NamedTuple):
    """A photograph without a usable board, and why."""

    name: str
    reason: str
    image_size: tuple[int, int] | None = None
    """None: the photograph cannot be read."""

    @property
    def unreadable(self) -> bool:
        """Whether it is to be tried again."""
        return self.image_size is None


FoundBoard = BoardView | Refused


@dataclass(frozen=True, eq=False)
class BoardSearch:
    """Results of all photographs of a camera, in the order of their names."""

    pattern: BoardPattern
    views: tuple[BoardView, ...]
    refused: tuple[Refused, ...] = ()

    @property
    def image_size(self) -> tuple[int, int]:
        """(width, height) of all photographs."""
        return self.views[0].image_size

    def without(self, names: Sequence[str]) -> "BoardSearch":
        """The results without those of these photographs."""
        return replace(self, views=tuple(view for view in self.views if view.name not in names))


def find_board(image: GreyImage, pattern: BoardPattern, name: str) -> FoundBoard:
    """The board in a photograph.

    A chessboard must be in view whole, a ChArUco board with at least `MINIMUM_CORNERS` corners.
    Corners that are no crossings of squares are left out: in a strongly tilted board before a
    fisheye of 150 degrees the finder was up to 26 px off at 2 to 4 of 54 corners.
    """
    size = (image.shape[1], image.shape[0])
    refused = partial(Refused, name, image_size=size)
    grey, turned, reach = eight_bits(image), False, pattern.reach
    if pattern.dictionary is None:
        chessboard = find_chessboard(grey, pattern.columns, pattern.rows)
        if chessboard is None:
            return refused(f"no board with {pattern} inner corners is completely visible and sharp")
        if not chessboard.outer:
            return refused(
                f"{pattern} points were found, but the outermost lie on the edge of the board or "
                "of the visible part: count the corners where four squares meet"
            )
        corners, turned = chessboard.corners, chessboard.turned
        reach = min(reach, OF_OUTER * chessboard.outer)
        ids = np.arange(len(corners))
    else:
        squares = (pattern.columns + 1, pattern.rows + 1)
        part = (pattern.square_m, pattern.marker_m or 0.0)
        ids, corners = find_charuco(grey, squares, part, pattern.dictionary)
        if len(ids) < MINIMUM_CORNERS or not all(map(np.ptp, np.divmod(ids, pattern.columns))):
            return refused(f"{len(ids)} corners of the ChArUco board are too few")
    grid = np.full((pattern.rows, pattern.columns, 2), np.nan)
    grid.reshape(-1, 2)[ids] = corners
    steps = [np.linalg.norm(np.diff(grid, axis=axis), axis=2).ravel() for axis in (0, 1)]
    spacing = float(np.nan_to_num(np.fmin.reduce(np.concatenate(steps))))
    if spacing < MINIMUM_SPACING_PX:
        return refused(
            f"the board is too far away or seen edge-on: its corners are {spacing:.1f} px apart, "
            f"and at least {MINIMUM_SPACING_PX:.0f} are needed"
        )
    corners = refine_corners(image, corners, reach * spacing)
    sound = are_crossings(grey, corners, 0.5 * reach * spacing)
    return BoardView(name, size, ids[sound], corners[sound], turned)


def find_boards(
    photographs: Photographs,
    pattern: BoardPattern,
    executor: Executor,
    progress: Progress | None = None,
    earlier: Earlier[FoundBoard] | None = None,
) -> BoardSearch:
    """Find the boards in one camera's photographs; each worker holds one photograph at a time.

    Args:
        photographs: files by name.
        progress: called with the number of photographs done and the total.
        earlier: checkpoint of earlier results by file name, which must identify the content.

    Returns:
        Boards and refused photographs, in order of name.
    """
    if not photographs:
        raise StereocalError("There are no photographs of the board.")
    of_pattern = hashlib.sha256(repr(pattern).encode()).hexdigest()[:16]
    tasks: Iterator[Task[FoundBoard]] = (
        Task(
            _search,
            (for_worker(file, executor), pattern, name),
            key=f"{file.name} {of_pattern} {name}",
        )
        for name, file in photographs.items()
    )
    by_name: dict[str, FoundBoard] = {}
    every = run_tasks(tasks, executor, len(photographs), progress, earlier)
    with closing(every) as finished:
        for _, result in finished:
            by_name[result.name] = result
            if len(by_name) == SIZE_CHECK_AFTER:
                _check_size(photographs, by_name, pattern)
    if len(by_name) < SIZE_CHECK_AFTER:
        _check_size(photographs, by_name, pattern)
    results = [by_name[name] for name in sorted(photographs)]
    _check_sizes(results)
    views = tuple(result for result in results if isinstance(result, BoardView))
    refused = tuple(result for result in results if isinstance(result, Refused))
    if not views:
        many = f"any of the {len(refused)} photographs"
        count = many if len(refused) > 1 else "the photograph"
        board = proposed_board(photographs)
        shown = f" They seem to show one with {board}: state that." if board else ""
        raise StereocalError(
            f"No board with {pattern} inner corners was found in {count} ({refused[0].name}: "
            f"{refused[0].reason}).{shown}"
        )
    return BoardSearch(pattern, views, refused)


def _search(photograph: PhotographFile, pattern: BoardPattern, name: str) -> FoundBoard:
    """The task of an executor."""
    try:
        return find_board(read_photograph(photograph, name), pattern, name)
    except StereocalError as error:
        return Refused(name, error.reason.rstrip("."))


def _check_sizes(results: Sequence[FoundBoard]) -> None:
    sized = [(result.image_size, result.name) for result in results if result.image_size]
    sizes = Counter(size for size, _ in sized)
    if len(sizes) < 2:
        return
    usual = sizes.most_common(1)[0][0]
    odd = [f"{name} is {size[0]}x{size[1]} px" for size, name in sized if size != usual]
    more = f", and {len(odd) - 3} more differ" if len(odd) > 3 else ""
    raise StereocalError(
        f"The photographs of one camera must all have one size: most are {usual[0]}x{usual[1]} px, "
        f"but {', '.join(odd[:3])}{more}; leave these out."
    )


def _check_size(
    photographs: Photographs, results: Mapping[str, FoundBoard], pattern: BoardPattern
) -> None:
    """Raise an error if the first two photographs that show the board, or may, show another."""
    views = {name: view for name, view in results.items() if isinstance(view, BoardView)}
    seen = [*views] or [name for name, result in results.items() if result.image_size]
    if views and pattern.dictionary is not None:
        return
    for name in seen[:2]:
        image = read_photograph(photographs[name])
        if pattern.dictionary is not None:
            _refuse_charuco(image, name, pattern)
        elif not views or _may_be_a_part(views[name], eight_bits(image), pattern):
            _refuse_other_size(eight_bits(image), name, pattern, larger=bool(views))


def _may_be_a_part(view: BoardView, grey: npt.NDArray[np.uint8], pattern: BoardPattern) -> bool:
    """Whether a board may be a part of a larger one: its squares go on, or corners are missing."""
    if len(view.ids) < pattern.rows * pattern.columns:
        return True
    return goes_on(view.corners.reshape(pattern.rows, pattern.columns, 2), grey)


def _refuse_charuco(image: GreyImage, name: str, pattern: BoardPattern) -> None:
    """Raise an error if a photograph is mirrored, so that no marker is read, or shows the ChArUco
    board with columns and rows exchanged: its markers are numbered row by row. (A chessboard is the
    same board then.)
    """
    other = replace(pattern, columns=pattern.rows, rows=pattern.columns)
    if isinstance(find_board(image, other, name), BoardView):
        raise StereocalError(
            f"There is no ChArUco board with {pattern} inner corners, but {name} shows one "
            f"with {other}: exchange columns and rows."
        )
    if isinstance(find_board(image[:, ::-1].copy(), pattern, name), BoardView):
        raise StereocalError(
            f"{name} is mirrored, left to right: mirrored back, it shows the ChArUco board. "
            "Give the photographs as the camera recorded them."
        )


def _refuse_other_size(
    grey: npt.NDArray[np.uint8], name: str, pattern: BoardPattern, larger: bool
) -> None:
    """Raise an error if the size of the board differs by one from the stated size.

    Args:
        larger: look only for larger boards, of which a part was found.
    """
    if max(grey.shape) > LARGE_PX:  # 2 s a photograph less, of the 10 s of a search and its lens
        grey = halved(grey)
    steps = (1, 0) if larger else (1, 0, -1)
    for columns, rows in itertools.product(steps, steps):
        size = pattern.columns + columns, pattern.rows + rows
        if (columns or rows) and min(size) >= 3:
            other = find_chessboard(grey, *size, thorough=False)
            if other is not None and other.outer:
                raise StereocalError(
                    f"There is no board with {pattern} inner corners, but {name} shows one with "
                    f"{size[0]}x{size[1]}: count where four squares meet, not the squares."
                )
