"""A board in the photographs of two cameras and more: a recording of its corners, and the lenses if
not known."""

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import combinations
from types import MappingProxyType

import numpy as np

from stereocal.errors import StereocalError
from stereocal.frames.all_cameras import Found
from stereocal.frames.by_motion import found_by_motion
from stereocal.frames.pairing import Pairing
from stereocal.intrinsics.board_order import SeenBoard, boards_in_one_order, orders_of
from stereocal.intrinsics.boards import BoardSearch, BoardView, FoundBoard, Refused, find_boards
from stereocal.intrinsics.calibrate_lens import LensCalibration, calibrate_lens
from stereocal.intrinsics.lens_fit import LensSettings, camera_of, solve_lens, with_better_model
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.rigid_object import BoardPattern, RigidObject
from stereocal.system.array_types import FloatArray
from stereocal.system.photograph_files import Photographs
from stereocal.system.sampling import evenly_spread
from stereocal.system.tasks import Earlier, Progress

SAME_PLACE_PX = 1.0
"""Two boards whose corners lie closer together than this in all images stand at one place."""
ROUGHLY = 20
"""Boards that tell a lens well enough to bring cameras into step."""


def stages_of(cameras: Iterable[str]) -> tuple[str, ...]:
    """The stages of a search, one of each camera."""
    return tuple(f"boards of the {camera}" for camera in cameras)


@dataclass(frozen=True, eq=False)
class StereoBoards:
    """The boards in the photographs of two cameras and more."""

    pairing: Pairing
    """Of cameras that were started by hand as the motion tells."""
    searches: Mapping[str, BoardSearch]
    """Of each camera that has photographs, without repeated boards."""
    repeated: Mapping[int, int]
    """Frames left out because their board stands where that of an earlier frame did."""

    @property
    def pattern(self) -> BoardPattern:
        """What is printed on the board."""
        return next(iter(self.searches.values())).pattern

    @property
    def seen(self) -> dict[int, dict[str, BoardView]]:
        """The boards that two cameras or more see, by frame and camera."""
        views = {view.name: view for search in self.searches.values() for view in search.views}
        every = {
            frame: {camera: views[name] for camera, name in files.items() if name in views}
            for frame, files in self.pairing.moments.items()
        }
        return {frame: views for frame, views in every.items() if len(views) > 1}

    def of_pair(self, first: str, second: str) -> list[SeenBoard]:
        """The boards that both cameras see, by frame."""
        return [
            SeenBoard(frame, (views[first], views[second]))
            for frame, views in self.seen.items()
            if first in views and second in views
        ]

    @property
    def refused(self) -> tuple[Refused, ...]:
        """The photographs without a usable board."""
        return tuple(item for search in self.searches.values() for item in search.refused)

    @property
    def doubtful(self) -> dict[int, str]:
        """Why frames are not used."""
        reasons, doubts = {item.name: item.reason for item in self.refused}, dict[int, str]()
        for frame, files in self.pairing.moments.items():
            if names := [name for name in files.values() if name in reasons]:
                doubts[frame] = "; ".join(f"{name}: {reasons[name]}" for name in names)
        return doubts | {
            frame: f"the board stands where it does in frame {first}"
            for frame, first in self.repeated.items()
        }

    @property
    def sentence(self) -> str:
        """What was found in the photographs of two cameras, for the user."""
        counts = [len(search.views) for search in self.searches.values()]
        parts = [
            f"{len(self.seen)} boards of {self.pattern} inner corners are in photographs of both "
            f"cameras; {counts[0]} in the primary's, {counts[1]} in the secondary's."
        ]
        if self.refused:
            of = "; ".join(f"{item.name}: {item.reason}" for item in self.refused[:3])
            more = f"; and {len(self.refused) - 3} more" if len(self.refused) > 3 else ""
            parts.append(f"Not used: {of}{more}.")
        if self.repeated:
            same = ", ".join(f"{frame} (as {first})" for frame, first in self.repeated.items())
            parts.append(
                f"The board stands at the same place in several frames, and counts once: left out "
                f"{same}."
            )
        return " ".join(parts)


def find_stereo_boards(
    pairing: Pairing,
    photographs: Photographs,
    cameras: Mapping[str, Camera | None],
    pattern: BoardPattern,
    executor: Executor,
    begin: Callable[[str], None],
    progress: Progress | None = None,
    earlier: Earlier[FoundBoard] | None = None,
) -> StereoBoards:
    """The boards in the photographs of two cameras and more.

    Args:
        cameras: the lenses, or None where they are not known: cameras that were started by hand
            are brought into step with one that is fitted to some of the boards.
        begin: called with each stage of `stages_of`.
        progress, earlier: as for `find_boards`.
    """
    names = pairing.names(cameras)
    for photograph in pairing.alone:  # for the lens
        names[CAMERAS[photograph.camera]].append(photograph.name)
    searches: dict[str, BoardSearch] = {}
    for stage, (which, chosen) in zip(stages_of(names), names.items(), strict=True):
        if chosen:
            begin(stage)
            files = {name: photographs[name] for name in chosen}
            searches[which] = find_boards(files, pattern, executor, progress, earlier)
            _check_size(which, cameras[which], searches[which])
    if pairing.by_hand is None:
        return stereo_boards(pairing, searches)
    points = {
        view.name: _whole(view, pattern)[:, :2]
        for search in searches.values()
        for view in search.views
    }
    lenses = {which: cameras[which] or _rough_lens(search) for which, search in searches.items()}
    board = RigidObject.of_board(pattern)
    motion = found_by_motion(pairing.by_hand, points, lenses, board, orders_of(pattern))
    return stereo_boards(pairing.told_by(motion), searches)


def _whole(view: BoardView, pattern: BoardPattern) -> FloatArray:
    """(n, 3): u, v of all corners of the board, NaN if not seen, with no standard error."""
    points = np.full((len(pattern.points), 3), np.nan)
    points[view.ids, :2] = view.corners
    return points


def _rough_lens(search: BoardSearch) -> Camera:
    """The lens of some of the boards."""
    views = [search.views[k] for k in evenly_spread(len(search.views), ROUGHLY)]
    settings = with_better_model(replace(search, views=tuple(views)), LensSettings())
    values = solve_lens(search.pattern, views, search.image_size, settings)
    return camera_of(values, search.image_size, settings.model)


def stereo_boards(pairing: Pairing, searches: Mapping[str, BoardSearch]) -> StereoBoards:
    """The boards that were found by camera, without repeated ones."""
    boards = StereoBoards(pairing, searches, {})
    seen = boards.seen
    if not seen:
        counts = ", ".join(
            f"{len(search.views)} of the {name}'s" for name, search in searches.items()
        )
        raise StereocalError(
            f"No two cameras see the board in the same frame: it was found in {counts} "
            "photographs. Photograph it where two cameras see it, at the same moment."
        )
    repeated = _repeated(seen)
    again = [view.name for frame in repeated for view in seen[frame].values()]
    kept = {camera: search.without(again) for camera, search in searches.items()}
    return replace(boards, searches=kept, repeated=repeated)


def lenses_of_boards(
    boards: StereoBoards,
    settings: LensSettings | None,
    executor: Executor,
    progress: Progress | None = None,
) -> dict[str, LensCalibration]:
    """The lens of each camera, from all its boards.

    Args:
        settings: None: with the lens model that predicts the camera's held-out boards better.
    """
    return {
        camera: calibrate_lens(
            search,
            settings or with_better_model(search, LensSettings()),
            executor,
            progress,
            without_each=True,
        )
        for camera, search in boards.searches.items()
    }


def found_of(
    boards: StereoBoards,
    cameras: Mapping[str, Camera],
    made: Mapping[str, LensCalibration] = MappingProxyType({}),
) -> Found:
    """The boards that two cameras or more see; an error if the images of one are mirrored, or of
    another size than its lens.

    Args:
        cameras: the lenses, if not `made` of these boards.
    """
    cameras = {**cameras, **{name: lens.camera for name, lens in made.items()}}
    outlying = {name for lens in made.values() for name in lens.outlying}
    loose = {
        frame: f"The corners in {view.name} fit the lens less than half as well as usual."
        for frame, views in boards.seen.items()
        for view in views.values()
        if view.name in outlying
    }
    frame_of = {
        view.name: str(frame) for frame, views in boards.seen.items() for view in views.values()
    }
    named: dict[str, Camera] = {}
    for which, camera in cameras.items():
        if which in boards.searches:
            _check_size(which, camera, boards.searches[which])
        known = camera.uncertainty
        if known is not None:  # what the lens is without each board: by frame, not by photograph
            without = {frame_of.get(name, name): change for name, change in known.without.items()}
            camera = replace(camera, uncertainty=replace(known, without=without))
        named[which] = camera
    points, pattern = {}, boards.pattern
    for one, other in combinations(boards.searches, 2):
        if both := boards.of_pair(one, other):
            in_order = boards_in_one_order(both, (named[one], named[other]), pattern)
            points[one, other] = {
                frame: (_whole(first, pattern), _whole(second, pattern))
                for frame, (first, second) in in_order
            }
    board, orders = RigidObject.of_board(pattern), orders_of(pattern)
    doubtful, why = boards.doubtful, {item.name: item.reason for item in boards.refused}
    moments = boards.pairing.moments
    again = {name: doubtful[k] for k in boards.repeated for name in moments[k].values()}
    return Found(
        boards.pairing,
        named,
        board,
        orders,
        points,
        again | why,
        sentence=boards.sentence,
        doubtful={**loose, **doubtful},
    )


def _check_size(which: str, camera: Camera | None, search: BoardSearch) -> None:
    if camera is not None and camera.image_size != search.image_size:
        raise StereocalError(
            f"The {which}'s photographs have {search.image_size[0]}x{search.image_size[1]} px, "
            f"its camera file {camera.image_size[0]}x{camera.image_size[1]}."
        )


def _repeated(seen: Mapping[int, Mapping[str, BoardView]]) -> dict[int, int]:
    """Frames whose board stands where that of an earlier frame did, and that frame."""
    repeated, kept = dict[int, int](), dict[int, Mapping[str, BoardView]]()
    for frame, views in seen.items():
        same = (
            earlier
            for earlier, other in kept.items()
            if views.keys() <= other.keys()
            and all(_same_place(view, other[camera]) for camera, view in views.items())
        )
        if (first := next(same, None)) is None:
            kept[frame] = views
        else:
            repeated[frame] = first
    return repeated


def _same_place(one: BoardView, other: BoardView) -> bool:
    _, a, b = np.intersect1d(one.ids, other.ids, return_indices=True)
    apart = np.linalg.norm(one.corners[a] - other.corners[b], axis=1)
    return 2 * len(a) >= len(one.ids) and bool(np.median(apart) < SAME_PLACE_PX)
