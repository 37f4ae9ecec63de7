"""What a file knows about cameras that look through windows, and how they may have moved."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.field.checking.fits import WIDE_ANGLE, Change
from stereocal.field.checking.prior import lens_variances, prior_of, root_of
from stereocal.fit.least_squares.small_steps import (
    FACTOR,
    STEP,
    cameras_at,
    lens_places,
    step_between,
)
from stereocal.fit.least_squares.unknowns import DEFAULT_DISTANCE
from stereocal.fit.least_squares.views import Cameras
from stereocal.fit.rig_file import RigFile
from stereocal.rig.camera import camera_in_words
from stereocal.rig.geometry import AT_ORIGIN, Pose
from stereocal.rig.parameters import RigParameters
from stereocal.rig.recording import Recording
from stereocal.rig.rig import PlacedCamera
from stereocal.rig.window import moved_window
from stereocal.system.array_types import FloatArray

Placed = Mapping[str, PlacedCamera]
SAME_WALL = 1e-6
"""Difference of normals, and of distances in m, within which cameras look through one window."""
WALL = "the wall"
"""What all cameras that have a window look through, where it is one."""
WIDE_M = 1.0
"""Standard deviation of a shift; it only keeps finite what the images do not determine."""


@dataclass(frozen=True, eq=False)
class Known:
    """Cameras by a parameter file: normal, a step root N(0, 1) from where they are."""

    placed: Placed
    covariance: FloatArray
    """(Q, Q): of the unknowns of `views`, each window in the frame of its own camera."""
    noise_px: float
    degrees: float
    """Of freedom, behind the noise."""
    scatter_m: float
    design_effect: float

    @property
    def at(self) -> Cameras:
        return cameras_at(*zip(*self.placed.values(), strict=True))

    @cached_property
    def root(self) -> FloatArray:
        """(Q, r)."""
        return root_of(self.covariance)

    def seen_in(self, recording: Recording) -> "Known":
        """With the error of the object of a recording, which may be another one, and with errors of
        the lenses that no calibration shows, where its images are (`prior.Prior`)."""
        covariance, length = self.covariance.copy(), recording.object.longest_m
        covariance[FACTOR], covariance[:, FACTOR] = 0.0, 0.0
        sigma = recording.object.sigma_m or DEFAULT_DISTANCE * length
        covariance[FACTOR, FACTOR] = (sigma / length) ** 2
        for number, (camera, _) in enumerate(self.placed.values()):
            places, pixels = lens_places(number), recording.points[recording.camera == number]
            if len(pixels):
                variances = lens_variances(camera, camera.K[0, 0], pixels, self.noise_px)
                covariance[places, places] += variances
        return replace(self, covariance=covariance)


def known_of_rig(rig: RigFile) -> Known:
    """What rig.json knows."""
    figures = rig.about.figures
    if figures is None:
        return Known(rig.placed, rig.covariance, rig.noise_px, 1.0, 0.0, 1.0)
    degrees = max(3.0 * figures.independent_frames, 1.0)
    of_object = figures.length_scatter_m, figures.design_effect
    return Known(rig.placed, rig.covariance, rig.noise_px, degrees, *of_object)


def known_of_pair(parameters: RigParameters, source: str, names: Iterable[str]) -> Known:
    """What a parameter file of two cameras knows, whose new images have these names."""
    it = prior_of(parameters, source)
    placed = dict(zip(names, parameters.placed.values(), strict=True))
    return Known(placed, it.covariance, it.sigma_px, it.degrees, it.scatter_m, it.design_effect)


@dataclass(frozen=True, eq=False)
class Move:
    """What may have happened to one camera or one window."""

    what: str
    """Such as `camera c1`, or `WALL`."""
    how: str
    """`turned` or `moved`; of a window `shifted`."""
    sigma: tuple[float, ...]
    after: Callable[[Placed, FloatArray], Placed]
    """The cameras after it, by its values: radians about three axes, and metres; of a window
    radians about two axes across its normal, and metres along it."""


def after(moves: Sequence[Move], known: Known, u: FloatArray) -> Known:
    """The cameras after moves, by all their values (m,)."""
    placed = known.placed
    for move in moves:
        mine, u = u[: len(move.sigma)], u[len(move.sigma) :]
        placed = move.after(placed, mine)
    return replace(known, placed=placed)


def directions(moves: Sequence[Move], known: Known, u: FloatArray) -> Change:
    """The directions of moves about where they have brought the cameras by values u (m,)."""
    steps = STEP * np.eye(len(u))
    ends = [[after(moves, known, u + way * e).at for way in (1.0, -1.0)] for e in steps]
    columns = [step_between(*pair) / (2.0 * STEP) for pair in ends]
    sigma = np.array([sigma for move in moves for sigma in move.sigma])
    return Change(np.reshape(columns, (len(u), len(known.covariance))).T, sigma)


def moves_of(placed: Placed, seen: Sequence[str]) -> list[Move]:
    """Each of the cameras that new images are of turned about its centre, or moved, and each of
    their windows moved.

    A wall that several cameras look through stays when one of them moves; a port goes along.
    """
    behind = [name for name, it in placed.items() if it.camera.window]
    groups = [group for group in _groups_of(placed) if not {*group}.isdisjoint(seen)]
    moves = list[Move]()
    for name in seen:
        stands = any(name in group and len(group) > 1 for group in groups)
        by, turn = partial(_camera_moved, name, stands), (WIDE_ANGLE,) * 3
        moves.append(Move(camera_in_words(name), "turned", turn, by))
        moves.append(Move(camera_in_words(name), "moved", (*turn, *(WIDE_M,) * 3), by))
    for group in groups:
        is_wall = len(group) == len(behind) > 1
        what = WALL if is_wall else f"the window of {camera_in_words(*group)}"
        sigma = WIDE_ANGLE, WIDE_ANGLE, WIDE_M
        moves.append(Move(what, "shifted", sigma, partial(_window_moved, group)))
    return moves


def all_that_shows(moves: Sequence[Move]) -> list[Move]:
    """The moves that images can tell from each other: the first camera stands."""
    return [it for it in moves if it.how != "turned" and it.what != moves[0].what]


def _groups_of(placed: Placed) -> list[list[str]]:
    """The cameras that look through each window: several through one wall."""
    planes = {name: np.hstack(_plane(it)) for name, it in placed.items() if it.camera.window}
    groups = dict[str, list[str]]()
    for name, plane in planes.items():
        first = next(it for it in planes if np.allclose(planes[it], plane, 0.0, SAME_WALL))
        groups.setdefault(first, []).append(name)
    return [*groups.values()]


def _plane(of: PlacedCamera) -> tuple[FloatArray, float]:
    """The normal (3,) and the distance of a camera's window in the frame of the reference."""
    window = of.camera.window
    assert window is not None
    normal = np.array(window.normal)
    return normal @ of.pose.R, window.distance_m - float(normal @ of.pose.T)


def _camera_moved(name: str, window_stands: bool, placed: Placed, u: FloatArray) -> Placed:
    """A camera turned by the rotation vector u[:3] about its own axes, and moved by u[3:]."""
    step = Pose(Rotation.from_rotvec(u[:3]).as_matrix(), u[3:] if len(u) > 3 else np.zeros(3))
    camera, pose = placed[name]
    if camera.window is not None and window_stands:
        camera = replace(camera, window=moved_window(camera.window, step))
    if name != next(iter(placed)):
        return {**placed, name: PlacedCamera(camera, step @ pose)}
    back = (step @ pose).inverse()  # the others, in the frame of the reference that has moved
    others = {other: PlacedCamera(it.camera, it.pose @ back) for other, it in placed.items()}
    return {**others, name: PlacedCamera(camera, AT_ORIGIN)}


def _window_moved(group: Sequence[str], placed: Placed, u: FloatArray) -> Placed:
    """A window turned by u[:2] about two axes across its normal, and u[2] farther from the middle
    of its cameras."""
    normal, distance = _plane(placed[group[0]])
    middle = np.mean([placed[name].pose.inverse().T for name in group], axis=0)
    across = np.linalg.svd(normal[None])[2][1:]
    turned = Rotation.from_rotvec(u[:2] @ across).apply(normal)
    distance += float(u[2] + (turned - normal) @ middle)
    new = dict(placed)
    for name in group:
        camera, pose = placed[name]
        assert camera.window is not None
        seen = pose.R @ turned
        x, y, z = seen.tolist()
        away = distance + float(seen @ pose.T)
        window = replace(camera.window, normal=(x, y, z), distance_m=away)
        new[name] = PlacedCamera(replace(camera, window=window), pose)
    return new
