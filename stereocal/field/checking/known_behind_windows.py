"""What a parameter file knows about cameras that look through windows, and how they may move."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.errors import StereocalError
from stereocal.field.checking.fits import WIDE_ANGLE, WIDE_FOCAL, Change
from stereocal.field.checking.prior import lens_variances, prior_of
from stereocal.fit.least_squares.small_steps import (
    FACTOR,
    cameras_at,
    lens_places,
    moved,
    step_between,
    window_at,
    window_places,
    window_values,
)
from stereocal.fit.least_squares.unknowns import DEFAULT_DISTANCE
from stereocal.fit.least_squares.views import EACH, Cameras
from stereocal.fit.least_squares.windows import KIND, SHARED
from stereocal.fit.rig_file import RigFile
from stereocal.rig.camera import CAMERAS, camera_in_words
from stereocal.rig.geometry import AT_ORIGIN, Pose
from stereocal.rig.parameters import RigParameters
from stereocal.rig.recording import Recording
from stereocal.rig.rig import PlacedCamera
from stereocal.rig.window import moved_window
from stereocal.system.array_types import FloatArray

Placed = Mapping[str, PlacedCamera]
SAME_WALL = 1e-6
"""Difference of normals, and of distances in m, within which cameras look through one window."""
WIDE_M = 1.0
"""Standard deviation of a shift; it only keeps finite what the images do not determine."""
STEP = 1e-6
"""Of differences, in radians and m."""


def groups_of(placed: Placed) -> list[tuple[str, ...]]:
    """The cameras that look through each window: several through one wall."""
    groups = list[tuple[FloatArray, list[str]]]()
    for name, (camera, pose) in placed.items():
        if camera.window is None:
            continue
        normal, (distance, *others) = np.split(camera.window.values, [3])
        plane = np.array([*normal @ pose.R, distance - normal @ pose.T, *others])  # the reference's
        for known, group in groups:
            if np.allclose(known, plane, rtol=0.0, atol=SAME_WALL):
                group.append(name)
                break
        else:
            groups.append((plane, [name]))
    return [tuple(group) for _, group in groups]


@dataclass(frozen=True, eq=False)
class Known:
    """Cameras by a parameter file."""

    placed: Placed
    covariance: FloatArray
    """(Q, Q): of the unknowns of `views`, each window in the frame of its own camera."""
    factor: float
    length_m: float | None
    noise_px: float
    degrees: float
    scatter_m: float
    design_effect: float

    @property
    def at(self) -> Cameras:
        """Where they are."""
        return at(self.placed, self.factor)

    def of_cameras(self, names: Sequence[str]) -> "Known":
        """What is known of some of the cameras, the first of which is among them."""
        every, whole = [*self.placed], len(self.covariance)
        if names[0] != every[0]:
            raise StereocalError(
                f"The images are without {camera_in_words(every[0])}, in whose frame the rig is: "
                "check with images of that camera too."
            )
        numbers = [every.index(name) for name in names]
        windows = [window_places(number, len(every)) for number in numbers]
        cameras = [slice(EACH * number, EACH * (number + 1)) for number in numbers]
        kept = [*chain(*(range(it.start, it.stop) for it in cameras + windows)), whole - 1]
        placed = {name: self.placed[name] for name in names}
        return replace(self, placed=placed, covariance=self.covariance[np.ix_(kept, kept)])

    def seen_in(self, recording: Recording) -> "Known":
        """With the length of the object of a recording, and with errors of the lenses that no
        calibration shows, where its images are."""
        covariance, factor, length = self.covariance.copy(), self.factor, recording.object.longest_m
        if self.length_m is None or not np.isclose(self.length_m, length, rtol=1e-6, atol=0.0):
            sigma = recording.object.sigma_m or DEFAULT_DISTANCE * length
            factor, covariance[FACTOR], covariance[:, FACTOR] = 1.0, 0.0, 0.0
            covariance[FACTOR, FACTOR] = (sigma / length) ** 2
        for number, placed in enumerate(self.placed.values()):
            places, pixels = lens_places(number), recording.points[recording.camera == number]
            if len(pixels):
                f = float(np.mean(np.diag(placed.camera.K)[:2]))
                variances = lens_variances(placed.camera, f, pixels, self.noise_px)
                covariance[places, places] += variances
        return replace(self, covariance=covariance, factor=factor)


def at(placed: Placed, factor: float) -> Cameras:
    """Cameras by their unknowns."""
    cameras = cameras_at(*zip(*placed.values(), strict=True))
    cameras.q[FACTOR] = factor
    return cameras


def known_of_rig(rig: RigFile) -> Known:
    """What rig.json knows."""
    figures = rig.about.figures
    return Known(
        rig.placed,
        _in_own_frames(rig.placed, rig.covariance),
        float(rig.about.object.get("factor", 1.0)),
        rig.length_m,
        rig.noise_px,
        max(3.0 * figures.independent_frames, 1.0) if figures else 1.0,
        figures.length_scatter_m if figures else 0.0,
        figures.design_effect if figures else 1.0,
    )


def known_of_pair(parameters: RigParameters, source: str) -> Known:
    """What a parameter file of two cameras knows."""
    prior, names = prior_of(parameters, source), parameters.camera_names or CAMERAS
    placed = dict(zip(names, parameters.placed.values(), strict=True))
    return Known(
        placed,
        _in_own_frames(placed, prior.covariance),
        float(prior.at.q[FACTOR]),
        parameters.length_m,
        prior.sigma_px,
        prior.degrees,
        prior.scatter_m,
        prior.design_effect,
    )


def _in_own_frames(placed: Placed, covariance: FloatArray) -> FloatArray:
    """(Q, Q): a covariance in which cameras that share a window may have it in the reference's
    frame: its entries are the same for all of them then."""
    cameras, names = at(placed, 1.0), [*placed]
    if len(covariance) != len(cameras.q):
        raise StereocalError(
            "The parameters do not state how exactly their windows are known, so a movement cannot "
            "be separated from their errors: calibrate again."
        )
    group = [names.index(name) for name in groups_of(placed)[0]]
    first, *others = ([*range(*_ends(number, len(names)))] for number in group)
    same = all(np.allclose(covariance[first], covariance[it], atol=0.0) for it in others)
    if group[0] != 0 or not others or not same:
        return covariance
    shared = cameras._replace(q=cameras.q.copy(), windows=cameras.windows.copy())
    shared.windows[group, KIND] = SHARED
    for number in group:
        shared.q[window_places(number, len(names))] = cameras.q[window_places(0, len(names))]
    J = np.eye(len(covariance))
    for number in group:
        rows = window_places(number, len(names))

        def seen(step: FloatArray, number: int = number) -> FloatArray:
            window = window_at(moved(shared, step), number)
            assert window is not None
            return window_values(window)

        J[rows] = np.array([(seen(e) - seen(-e)) / (2 * STEP) for e in STEP * np.eye(len(J))]).T
    return np.asarray(J @ covariance @ J.T)


def _ends(number: int, cameras: int) -> tuple[int, int]:
    places = window_places(number, cameras)
    return places.start, places.stop


@dataclass(frozen=True, eq=False)
class Move:
    """What may have happened to one camera or one window."""

    what: str
    """Such as `camera c1`, or `the wall`."""
    how: str
    """`turned`, `moved` or `refocused`; of a window `shifted`."""
    sigma: tuple[float, ...]
    after: Callable[[Placed, FloatArray], dict[str, PlacedCamera]]
    """The cameras after it, by its values."""


def directions(moves: Sequence[Move], placed: Placed, u: FloatArray) -> Change:
    """The directions of moves about where they have brought the cameras by values u (m,)."""
    there = at(after(moves, placed, u), 1.0)

    def step(change: FloatArray) -> FloatArray:
        return step_between(at(after(moves, placed, u + change), 1.0), there)

    columns = [(step(e) - step(-e)) / (2.0 * STEP) for e in STEP * np.eye(len(u))]
    sigma = np.array([sigma for move in moves for sigma in move.sigma])
    return Change(np.reshape(columns, (len(u), len(there.q))).T, sigma)


def after(moves: Sequence[Move], placed: Placed, u: FloatArray) -> Placed:
    """The cameras after moves, by all their values (m,)."""
    for move in moves:
        mine, u = u[: len(move.sigma)], u[len(move.sigma) :]
        placed = move.after(placed, mine)
    return placed


def single_moves(placed: Placed) -> list[Move]:
    """Each camera turned about its centre, moved or refocused, and each window moved."""
    groups = groups_of(placed)
    moves = list[Move]()
    for name in placed:
        stands = any(name in group and len(group) > 1 for group in groups)
        what, by = camera_in_words(name), partial(_camera_moved, name, stands)
        moves += [
            Move(what, "turned", (WIDE_ANGLE,) * 3, by),
            Move(what, "moved", (*(WIDE_ANGLE,) * 3, *(WIDE_M,) * 3), by),
            Move(what, "refocused", (WIDE_FOCAL,), partial(_refocused, name)),
        ]
    for group in groups:
        what = "the wall" if len(group) > 1 else f"the window of {camera_in_words(*group)}"
        sigma = WIDE_ANGLE, WIDE_ANGLE, WIDE_M
        moves.append(Move(what, "shifted", sigma, partial(_window_moved, group)))
    return moves


def all_moves(placed: Placed) -> list[Move]:
    """Everything that images can show: the reference stands, all the others move."""
    reference = camera_in_words(next(iter(placed)))
    return [
        move
        for move in single_moves(placed)
        if move.how in ("refocused", "shifted") or (move.how == "moved" and move.what != reference)
    ]


def _camera_moved(
    name: str, window_stands: bool, placed: Placed, u: FloatArray
) -> dict[str, PlacedCamera]:
    """A camera turned by the rotation vector u[:3] about its own axes, and moved by u[3:]."""
    step = Pose(Rotation.from_rotvec(u[:3]).as_matrix(), u[3:] if len(u) > 3 else np.zeros(3))
    camera, pose = placed[name]
    if camera.window is not None and window_stands:
        camera = replace(camera, window=moved_window(camera.window, step))
    new = {**placed, name: PlacedCamera(camera, step @ pose)}
    reference = next(iter(placed))
    if name != reference:
        return new
    back = new[reference].pose.inverse()
    new = {other: PlacedCamera(it.camera, it.pose @ back) for other, it in new.items()}
    return {**new, reference: PlacedCamera(camera, AT_ORIGIN)}


def _refocused(name: str, placed: Placed, u: FloatArray) -> dict[str, PlacedCamera]:
    """A focal length times 1 + u[0]."""
    camera, pose = placed[name]
    K = camera.K.copy()
    K[0, 0], K[1, 1] = K[0, 0] * (1.0 + u[0]), K[1, 1] * (1.0 + u[0])
    return {**placed, name: PlacedCamera(replace(camera, K=K), pose)}


def _window_moved(group: tuple[str, ...], placed: Placed, u: FloatArray) -> dict[str, PlacedCamera]:
    """A window turned by u[:2] about two axes across its normal, and u[2] farther from the first of
    its cameras."""
    first = placed[group[0]]
    window = first.camera.window
    assert window is not None
    across = np.linalg.svd(np.array(window.normal)[None])[2][1:]
    x, y, z = Rotation.from_rotvec(u[:2] @ across).apply(window.normal).tolist()
    new = replace(window, normal=(x, y, z), distance_m=window.distance_m + float(u[2]))
    moved_there = dict(placed)
    for name in group:
        camera, pose = placed[name]
        seen = moved_window(new, pose @ first.pose.inverse())
        moved_there[name] = PlacedCamera(replace(camera, window=seen), pose)
    return moved_there
