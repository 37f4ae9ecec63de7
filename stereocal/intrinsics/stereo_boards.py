"""A board in front of two cameras: a recording of its corners, and the lenses if not known.

The finder orders the corners by the colours of the squares (`in_board_order`). Where a
board looks the same turned, the two cameras may disagree. Then the geometry decides: with the right
order all boards give one pose of the cameras. The direction of a row in the images does not tell:
one camera may hang upside down.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple, TypeVar

import cv2
import numpy as np

from stereocal.errors import StereocalError
from stereocal.frames import all_cameras
from stereocal.frames.by_motion import found_by_motion, paired_by_motion, pairs_of
from stereocal.frames.pairing import ByHand, Moments, Pair, Pairing, pair_names
from stereocal.intrinsics.boards import BoardSearch, BoardView, FoundBoard, Refused, find_boards
from stereocal.intrinsics.calibrate_lens import LensCalibration, calibrate_lens
from stereocal.intrinsics.lens_fit import (
    LensSettings,
    board_pose,
    camera_of,
    solve_lens,
    with_better_model,
)
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import BoardPattern, RigidObject
from stereocal.system.photograph_files import Photographs
from stereocal.system.sampling import evenly_spread
from stereocal.system.tasks import Earlier, Progress

SAME_PLACE_PX = 1.0
"""Two boards whose corners lie closer together than this in both images stand at one place."""
FITTING_PX = 8.0
"""Median distance of corners from where another board's pose of the cameras puts them, of boards in
the right order. A wrong order gives tens of pixels."""
ROUGHLY = 20
"""Boards that tell a lens well enough to bring cameras into step."""
MOST_HYPOTHESES = 40
STAGES = ("boards of the primary", "boards of the secondary", "lenses")
BOARDS_STAGE = "photographs searched for boards"
Begin = Callable[[str], None]
C = TypeVar("C")


class SeenBoard(NamedTuple):
    """A board in both photographs of a frame."""

    frame: int
    views: tuple[BoardView, BoardView]


@dataclass(frozen=True, eq=False)
class StereoBoards:
    """The boards in the photographs of two cameras."""

    pairing: Pairing
    searches: tuple[BoardSearch, ...]
    """One for each camera, without repeated boards."""
    repeated: Mapping[int, int]
    """Frames left out because their board stands where that of an earlier frame did."""

    @property
    def pattern(self) -> BoardPattern:
        """What is printed on the board."""
        return self.searches[0].pattern

    @property
    def common(self) -> list[SeenBoard]:
        """The boards that both cameras see, by frame."""
        return _seen_by_both(self.pairing.pairs, self.searches)

    @property
    def refused(self) -> tuple[Refused, ...]:
        """The photographs without a usable board."""
        return self.searches[0].refused + self.searches[1].refused

    @property
    def doubtful(self) -> dict[int, str]:
        """Why frames are not used."""
        reasons = {item.name: item.reason for item in self.refused}
        found = {
            frame: f"the board stands where it does in frame {first}"
            for frame, first in self.repeated.items()
        }
        for pair in self.pairing.pairs:
            own = [name for name in (pair.primary, pair.secondary) if name in reasons]
            if own:
                found[pair.frame] = "; ".join(f"{name}: {reasons[name]}" for name in own)
        return found

    @property
    def sentence(self) -> str:
        """What was found, for the user."""
        found = [len(search.views) for search in self.searches]
        parts = [
            f"{len(self.common)} boards of {self.pattern} inner corners are in photographs of both "
            f"cameras; {found[0]} in the primary's, {found[1]} in the secondary's."
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
    photographs: Photographs,
    pattern: BoardPattern,
    executor: Executor,
    begin: Begin = lambda _: None,
    progress: Progress | None = None,
    earlier: Earlier[FoundBoard] | None = None,
    pairing: Pairing | None = None,
    lenses: tuple[Camera, Camera] | None = None,
) -> StereoBoards:
    """The boards in the photographs of two cameras, which are told apart by their names.

    Args:
        begin: called with the name of each stage.
        progress, earlier: as for `find_boards`.
        pairing: which photographs belong together; None: by their names.
        lenses: by which cameras that were started by hand are brought into step; None: fitted to
            some of the boards.
    """
    if pairing is None and (pairing := pair_names(photographs)).ambiguous:
        raise StereocalError(pairing.sentence)
    if not pairing.pairs:
        raise StereocalError(pairing.sentence)
    names = pairing.names
    for alone in () if pairing.by_hand else pairing.alone:
        names[CAMERAS[alone.camera]].append(alone.name)
    searches = []
    for own, stage in zip(names.values(), STAGES, strict=False):
        begin(stage)
        files = {name: photographs[name] for name in own}
        searches.append(find_boards(files, pattern, executor, progress, earlier))
    if pairing.by_hand:
        first, second = lenses or map(_rough_lens, searches)
        pairing = paired_by_motion(pairing, *_about_motion(searches, (first, second)))
    return stereo_boards(pairing, tuple(searches))


def _about_motion(
    searches: Sequence[BoardSearch], cameras: C
) -> tuple[dict[str, FloatArray], C, RigidObject, list[IntArray]]:
    """What `found_by_motion` asks."""
    pattern = searches[0].pattern
    points = {view.name: _whole(view, pattern) for search in searches for view in search.views}
    return points, cameras, RigidObject.of_board(pattern), orders_of(pattern)


def _whole(view: BoardView, pattern: BoardPattern) -> FloatArray:
    """(n, 2): pixels of all corners of the board, NaN if not seen."""
    points = np.full((len(pattern.points), 2), np.nan)
    points[view.ids] = view.corners
    return points


def _rough_lens(search: BoardSearch) -> Camera:
    """The lens of some of the boards."""
    views = [search.views[k] for k in evenly_spread(len(search.views), ROUGHLY)]
    settings = with_better_model(replace(search, views=tuple(views)), LensSettings())
    values = solve_lens(search.pattern, views, search.image_size, settings)
    return camera_of(values, search.image_size, settings.model)


def stereo_boards(pairing: Pairing, both: tuple[BoardSearch, ...]) -> StereoBoards:
    """The boards that were found by camera, without repeated ones."""
    boards = StereoBoards(pairing, both, {})
    common = boards.common
    if not common:
        raise StereocalError(
            f"No board is in both photographs of a frame: {len(both[0].views)} were found in the "
            f"primary's photographs, {len(both[1].views)} in the secondary's. Photograph it where "
            "both cameras see it, at the same moment."
        )
    repeated = _repeated(common)
    again = [view.name for seen in common if seen.frame in repeated for view in seen.views]
    kept = tuple(search.without(again) for search in both)
    return replace(boards, searches=kept, repeated=repeated)


def lenses_of_boards(
    boards: StereoBoards,
    settings: LensSettings | None,
    executor: Executor,
    progress: Progress | None = None,
) -> tuple[LensCalibration, LensCalibration]:
    """The lenses from all boards of each camera.

    Args:
        settings: None: with the lens model that predicts the camera's held-out boards better.
    """
    first, second = (
        calibrate_lens(
            search,
            settings or with_better_model(search, LensSettings()),
            executor,
            progress,
            without_each=True,
        )
        for search in boards.searches
    )
    return first, second


def recording_of(boards: StereoBoards, cameras: tuple[Camera, Camera], name: str) -> Recording:
    """The recording of the boards that both cameras see; an error if the images of one are
    mirrored, or of another size than its lens."""
    frames = {view.name: str(seen.frame) for seen in boards.common for view in seen.views}
    named: dict[str, Camera] = {}
    for which, camera, search in zip(CAMERAS, cameras, boards.searches, strict=True):
        _check_size(which, camera, search)
        known = camera.uncertainty
        if known is not None:  # what the lens is without each board: by frame, not by photograph
            without = {frames.get(own, own): change for own, change in known.without.items()}
            camera = replace(camera, uncertainty=replace(known, without=without))
        named[which] = camera
    moments: Moments = {
        pair.frame: {CAMERAS[0]: pair.primary, CAMERAS[1]: pair.secondary}
        for pair in boards.pairing.pairs
    }
    found = _put_together(moments, {CAMERAS: boards.common}, named, boards.pattern, {})
    return replace(found.recording, name=name)


def boards_in_all_cameras(
    moments: Moments | ByHand,
    photographs: Photographs,
    cameras: Mapping[str, Camera],
    pattern: BoardPattern,
    executor: Executor,
    begin: Begin,
    progress: Progress | None = None,
    earlier: Earlier[FoundBoard] | None = None,
) -> all_cameras.FoundRecording:
    """The boards in the photographs of three cameras and more, as `find_in_all_cameras`."""
    searches: dict[str, BoardSearch] = {}
    for camera, names in all_cameras.names_by_camera(moments, cameras).items():
        if names:
            begin(BOARDS_STAGE)
            own = {name: photographs[name] for name in names}
            search = find_boards(own, pattern, executor, progress, earlier)
            _check_size(camera, cameras[camera], search)
            searches[camera] = search
    by_pair, told = {}, ""
    if isinstance(moments, ByHand):
        about = _about_motion([*searches.values()], cameras)
        motion, told = found_by_motion(moments, *about)
        moments = moments.moments(motion.later)
    for one, other in combinations(searches, 2):
        both = searches[one], searches[other]
        seen = _seen_by_both(pairs_of(moments, one, other), both)
        repeated = _repeated(seen)
        if once := [each for each in seen if each.frame not in repeated]:
            by_pair[one, other] = once
    why = {item.name: item.reason for each in searches.values() for item in each.refused}
    return replace(_put_together(moments, by_pair, cameras, pattern, why), told=told)


def _put_together(
    moments: Moments,
    by_pair: Mapping[tuple[str, str], Sequence[SeenBoard]],
    cameras: Mapping[str, Camera],
    pattern: BoardPattern,
    why: Mapping[str, str],
) -> all_cameras.FoundRecording:
    """The recording of the boards that were found pair by pair."""

    def whole(view: BoardView) -> FloatArray:
        """(n, 3): with no standard error."""
        return np.column_stack([_whole(view, pattern), np.full(len(pattern.points), np.nan)])

    points = {}
    for (one, other), boards in by_pair.items():
        both = boards_in_one_order(boards, (cameras[one], cameras[other]), pattern)
        points[one, other] = {
            seen.frame: (whole(seen.views[0]), whole(seen.views[1])) for seen in both
        }
    board = RigidObject.of_board(pattern)
    return all_cameras.put_together(moments, points, orders_of(pattern), cameras, board, why)


def _check_size(which: str, camera: Camera, search: BoardSearch) -> None:
    if camera.image_size != search.image_size:
        raise StereocalError(
            f"The {which}'s photographs have {search.image_size[0]}x{search.image_size[1]} px, "
            f"its camera file {camera.image_size[0]}x{camera.image_size[1]}."
        )


def _seen_by_both(pairs: Iterable[Pair], both: Sequence[BoardSearch]) -> list[SeenBoard]:
    """The boards in both photographs of a pair, by frame."""
    first, second = ({view.name: view for view in search.views} for search in both)
    return [
        SeenBoard(pair.frame, (first[pair.primary], second[pair.secondary]))
        for pair in pairs
        if pair.primary in first and pair.secondary in second
    ]


def _repeated(common: Sequence[SeenBoard]) -> dict[int, int]:
    """Frames whose board stands where that of an earlier frame did, and that frame."""
    found: dict[int, int] = {}
    for at, seen in enumerate(common):
        same = (
            earlier.frame
            for earlier in common[:at]
            if earlier.frame not in found and all(map(_same_place, seen.views, earlier.views))
        )
        if (first := next(same, None)) is not None:
            found[seen.frame] = first
    return found


def _same_place(one: BoardView, other: BoardView) -> bool:
    _, a, b = np.intersect1d(one.ids, other.ids, return_indices=True)
    apart = np.linalg.norm(one.corners[a] - other.corners[b], axis=1)
    return 2 * len(a) >= len(one.ids) and bool(np.median(apart) < SAME_PLACE_PX)


def orders_of(pattern: BoardPattern) -> list[IntArray]:
    """Other numbers of the corners with which a board looks the same, each (n,); its own first."""
    grid = np.arange(pattern.rows * pattern.columns).reshape(pattern.rows, pattern.columns)
    turned = [grid]
    if pattern.dictionary is None and (pattern.rows + pattern.columns) % 2 == 0:
        turned.append(grid[::-1, ::-1])
        if pattern.rows == pattern.columns and pattern.rows % 2 == 0:
            turned += [np.rot90(grid), np.rot90(grid, 3)]
    return [order.ravel() for order in turned]


def boards_in_one_order(
    common: Sequence[SeenBoard], cameras: tuple[Camera, Camera], pattern: BoardPattern
) -> list[SeenBoard]:
    """The boards with the corners of the secondary's in the order of the primary's; an error if the
    images of one camera are mirrored."""
    orders = orders_of(pattern)
    errors, chosen = _best_orders(common, cameras, pattern, orders)
    if np.median(errors) > FITTING_PX and len(common) > 2:
        grid = np.arange(len(pattern.points)).reshape(pattern.rows, pattern.columns)
        flipped = [grid[:, ::-1].ravel(), grid[::-1].ravel()]
        mirrored, camera = _mirrored(common, cameras[1])
        if np.median(_best_orders(mirrored, (cameras[0], camera), pattern, flipped)[0]) <= (
            FITTING_PX
        ):
            raise StereocalError(
                "The photographs of one camera are mirrored, left to right: only then do all "
                "boards give one pose of the cameras. Give them as the camera recorded them."
            )
    return [
        SeenBoard(seen.frame, (seen.views[0], _renumbered(seen.views[1], orders[order])))
        for seen, order in zip(common, chosen, strict=True)
    ]


def _mirrored(common: Sequence[SeenBoard], camera: Camera) -> tuple[list[SeenBoard], Camera]:
    """The boards as a mirrored secondary camera would see them, and that camera."""
    right = camera.image_size[0] - 1.0
    K, distortion = camera.K.copy(), camera.distortion.copy()
    K[0, 1:] = -K[0, 1], right - K[0, 2]
    if not camera.is_fisheye:
        distortion[3:4] *= -1.0
    found = []
    for frame, (first, second) in common:
        corners = np.array([right, 0.0]) + [-1.0, 1.0] * second.corners
        found.append(SeenBoard(frame, (first, replace(second, corners=corners))))
    return found, replace(camera, K=K, distortion=distortion)


def _renumbered(view: BoardView, order: IntArray) -> BoardView:
    return replace(view, ids=order[view.ids])


def _best_orders(
    common: Sequence[SeenBoard],
    cameras: tuple[Camera, Camera],
    pattern: BoardPattern,
    orders: Sequence[IntArray],
) -> tuple[FloatArray, IntArray]:
    """For each board, the distance (px) of its best order from the pose of the cameras that
    explains most boards, and the order's index."""
    candidates = [[_renumbered(seen.views[1], order) for order in orders] for seen in common]
    boards = [_pose(cameras[0], pattern, seen.views[0]) for seen in common]
    every = max(len(common) // MOST_HYPOTHESES, 1)
    best = np.full((len(common), len(orders)), np.inf)
    for own, board in list(zip(candidates, boards, strict=True))[::every]:
        for view in own:
            rig = _pose(cameras[1], pattern, view) @ board.inverse()
            found = np.array(
                [
                    [_distance_px(cameras[1], pattern, rig @ at, other) for other in others]
                    for others, at in zip(candidates, boards, strict=True)
                ]
            )
            if np.median(found.min(axis=1)) < np.median(best.min(axis=1)):
                best = found
    return best.min(axis=1), best.argmin(axis=1).astype(np.int64)


def _pose(camera: Camera, pattern: BoardPattern, view: BoardView) -> Pose:
    """`camera_from_board`; behind the camera, where it fits nothing, if the view gives none."""
    found = board_pose(camera, pattern, view)
    if found is None:
        return Pose(np.eye(3), np.array([0.0, 0.0, -1.0]))
    return Pose(np.asarray(cv2.Rodrigues(found[:3])[0], dtype=np.float64), found[3:])


def _distance_px(camera: Camera, pattern: BoardPattern, pose: Pose, view: BoardView) -> float:
    """Median distance of a board's corners from where a pose puts them; infinite behind it."""
    points, corners = pose.apply(pattern.points[view.ids]), view.corners
    if camera.is_fisheye:
        used = camera.uses(camera.undistort(corners))
        points, corners = points[used], corners[used]
    if not (len(points) and (points[:, 2] > 0).all()):
        return np.inf
    with np.errstate(all="ignore"):  # far outside the image a distortion may have no value
        apart = np.linalg.norm(camera.project(points) - corners, axis=1)
    return float(np.median(np.nan_to_num(apart, nan=np.inf)))
