"""The fit of a lens to boards, its residuals, and which lens model predicts held-out boards better.

The usual lens is fitted by OpenCV's `calibrateCamera` (Zhang 2000), a fisheye by `fisheye_fit`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from stereocal.errors import StereocalError
from stereocal.intrinsics.boards import BoardSearch, BoardView
from stereocal.intrinsics.fisheye_fit import UNDETERMINED, Boards, fit_fisheye, pose_boards
from stereocal.rig.camera import FISHEYE_UNKNOWNS, LENS_MODELS, Camera, LensModel
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import SEEDS
from stereocal.system.settings import Settings, described

PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
"""For the usual lens; a fisheye has `FISHEYE_UNKNOWNS`, and a ninth that is not used."""
FEWEST_VIEWS = 8
"""Photographs below which models are not compared, and draws alone do not tell the errors."""
MINIMUM_VIEWS = 3
"""Two photographs give four equations for the four parameters of K, and nothing to check them."""
SMALLEST_BOARD = 4
"""Corners below which a board has no single pose: three leave up to four."""
LEVEL = 0.07
"""Relative difference of the errors of two lens models below which they count as equal. Of 620
simulated usual lenses with 8 to 20 boards, a fisheye was better by up to 5.4 % on both halves, and
by up to 12 % on all boards together."""
CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 1000, 1e-12)
"""Of fits of wide lenses (100 degrees, 7 boards) 5 % had not ended after 100 steps, most of them
with more than 1.1 times the least error; all had after 300."""


@dataclass(frozen=True)
class LensSettings(Settings):
    """Settings of the lens calibration."""

    subset: int = described(
        20,
        "Photographs of a draw",
        "With no more boards than this, two thirds of them. Paper: 20 of 50.",
        between=(MINIMUM_VIEWS, 1000),
    )
    repeats: int = described(
        50,
        "Draws",
        "The result is their median; of a fisheye they give the errors only. Paper: 50.",
        between=(2, 10_000),
    )
    seed: int = described(
        0, "Seed", "Source of the random numbers: the same seed gives the same file.", between=SEEDS
    )
    fix_k3: bool = described(
        False, "Hold k3 at 0", "Steadier for long lenses, which distort little. Paper: not held."
    )
    zero_tangential: bool = described(
        False,
        "Hold p1 and p2 at 0",
        "If the lens is known to be perpendicular to the sensor. Paper: not held.",
    )

    model: LensModel = described(
        "brown",
        "Lens model",
        "Brown: OpenCV's usual lens, k1 k2 p1 p2 k3. Fisheye: k1 k2 k3 k4, for action cameras and "
        "other wide lenses.",
        choices=LENS_MODELS,
    )

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters of a draw that the lens has: 9, or 8 of a fisheye."""
        return FISHEYE_UNKNOWNS if self.model == "fisheye" else PARAMETERS

    @property
    def free(self) -> FloatArray:
        """(9,): 1 for each of `PARAMETERS` that is fitted, 0 for those held at 0 or not used."""
        if self.model == "fisheye":  # fx, fy, cx, cy, k1 to k4
            return np.array([1.0] * 8 + [0.0])
        tangential, k3 = float(not self.zero_tangential), float(not self.fix_k3)
        return np.array([1.0] * 6 + [tangential, tangential, k3])  # fx, fy, cx, cy, k1, k2 first


def solve_lens(
    pattern: BoardPattern,
    views: Sequence[BoardView],
    image_size: tuple[int, int],
    settings: LensSettings,
    start: FloatArray | None = None,
) -> FloatArray:
    """(9,): `PARAMETERS` by OpenCV's `calibrateCamera` (Zhang 2000); of a fisheye by `fit_fisheye`.

    20 views of 216 corners take 0.02 to 0.03 s; an initial guess would save a third of that.

    Args:
        start: (9,): `PARAMETERS` from which a fisheye is fitted; None: the best from `STARTS`.
    """
    if cv2.getNumThreads() > 1:
        # The executor uses all cores. Multithreaded, OpenCV is not reproducible: 14 different
        # results in 20 runs, 1e-9 apart.
        cv2.setNumThreads(1)
    if settings.model == "fisheye":
        return fit_fisheye(boards_of(pattern, views), image_size, start)
    K, distortion, *_ = _by_opencv(cv2.calibrateCamera, pattern, views, image_size, settings)
    return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *np.ravel(distortion)[:5]])


def errors_of_usual_lens(
    pattern: BoardPattern,
    views: Sequence[BoardView],
    image_size: tuple[int, int],
    settings: LensSettings,
) -> FloatArray:
    """(9,): standard errors of `PARAMETERS` by the residuals of the corners, as OpenCV has them,
    which takes 10 to 20 % longer than the lens alone."""
    solve = cv2.calibrateCameraExtended
    sigma = _by_opencv(solve, pattern, views, image_size, settings)[4]
    return np.asarray(sigma, dtype=np.float64).ravel()[: len(PARAMETERS)]


def _by_opencv(
    solve: Callable[..., tuple[Any, ...]],
    pattern: BoardPattern,
    views: Sequence[BoardView],
    image_size: tuple[int, int],
    settings: LensSettings,
) -> tuple[Any, ...]:
    """What a function of OpenCV returns after the residual: K, distortion, poses, and so on."""
    boards = (
        [pattern.points[view.ids].astype("f4") for view in views],
        [view.corners.astype("f4") for view in views],
        image_size,
    )
    flags = cv2.CALIB_FIX_K3 * settings.fix_k3
    flags += cv2.CALIB_ZERO_TANGENT_DIST * settings.zero_tangential
    try:
        _, *results = solve(*boards, np.eye(3), np.zeros(5), flags=flags, criteria=CRITERIA)
    except cv2.error as error:
        raise StereocalError(UNDETERMINED) from error
    return tuple(results)


def held_out_px(search: BoardSearch, settings: LensSettings) -> dict[LensModel, FloatArray]:
    """(2,): the error of each lens model on boards that it was not fitted to, RMS in px.

    Every second board is fitted and the others tested, and the reverse; only the pose of a board
    is fitted to its own corners. Infinite for a model that the boards do not determine. Empty for
    fewer than `FEWEST_VIEWS` boards.
    """
    errors: dict[LensModel, FloatArray] = {}
    for model in LENS_MODELS if len(search.views) >= FEWEST_VIEWS else ():
        tried = replace(settings, model=model)
        errors[model] = np.array([_tested(search, tried, part) for part in (0, 1)])
    return errors


def _tested(search: BoardSearch, settings: LensSettings, part: int) -> float:
    """Error of the lens of every second board on the others, px."""
    fitted, tested = search.views[part::2], search.views[1 - part :: 2]
    try:
        values = solve_lens(search.pattern, fitted, search.image_size, settings)
        camera = camera_of(values, search.image_size, settings.model)
    except StereocalError:
        return np.inf
    px = rms_px(np.concatenate([residuals_of(camera, search.pattern, view) for view in tested]))
    return px if np.isfinite(px) else np.inf


def better_model(px: Mapping[LensModel, FloatArray], chosen: LensModel) -> LensModel:
    """The lens model whose errors on both halves of the held-out boards are smaller than those of
    the chosen one by more than `LEVEL`; the chosen one if there is none.

    Args:
        px: of `held_out_px`.
    """
    others = (model for model, errors in px.items() if (errors < (1 - LEVEL) * px[chosen]).all())
    return next(others, chosen)


def with_better_model(search: BoardSearch, settings: LensSettings) -> LensSettings:
    """The settings with the lens model that predicts held-out boards better."""
    return replace(settings, model=better_model(held_out_px(search, settings), settings.model))


def undetermined(search: BoardSearch, settings: LensSettings) -> StereocalError:
    """The error for boards that determine no lens of a model; it names the other if that does."""
    px = held_out_px(search, settings)
    if (better := better_model(px, settings.model)) == settings.model:
        return StereocalError(UNDETERMINED)
    return StereocalError(
        f"The boards determine no lens of the model {settings.model}, but one of the model "
        f"{better}, which predicts held-out boards to {px[better].max():.2f} px: use that."
    )


def camera_of(values: FloatArray, image_size: tuple[int, int], model: LensModel) -> Camera:
    """The camera with the `PARAMETERS` (9,) of a fit."""
    fx, fy, cx, cy = values[:4]
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return Camera(K, values[4:8] if model == "fisheye" else values[4:], image_size, model=model)


def boards_of(pattern: BoardPattern, views: Sequence[BoardView]) -> Boards:
    return Boards([pattern.points[view.ids] for view in views], [view.corners for view in views])


def board_pose(camera: Camera, pattern: BoardPattern, view: BoardView) -> FloatArray | None:
    """(6,): rotation vector and position (`camera_from_board`) of a board; None if its corners do
    not determine it.

    Of a fisheye it is the best fit. Of the model `brown` it is OpenCV's start, which
    `residuals_of` refines.
    """
    points, corners = pattern.points[view.ids], view.corners
    if len(points) < SMALLEST_BOARD:
        return None
    if camera.is_fisheye:
        posed = pose_boards(boards_of(pattern, [view]), camera.lens_values)
        return np.append(cv2.Rodrigues(posed.R[0])[0], posed.t[0])
    solved, rotation, position = cv2.solvePnP(points, corners, camera.K, camera.distortion)
    return np.concatenate([rotation, position]).ravel() if solved else None


def residuals_of(camera: Camera, pattern: BoardPattern, view: BoardView) -> FloatArray:
    """Found minus projected corners (n, 2), px, with the best-fit pose of the board."""
    points = pattern.points[view.ids]
    if camera.is_fisheye and len(points) >= SMALLEST_BOARD:
        return pose_boards(boards_of(pattern, [view]), camera.lens_values).residuals
    pose = board_pose(camera, pattern, view)
    if pose is None:
        return np.full((len(points), 2), np.nan)
    refined = cv2.solvePnPRefineLM(
        points, view.corners, camera.K, camera.distortion, pose[:3, None], pose[3:, None]
    )
    seen, _ = cv2.projectPoints(points, *refined, camera.K, camera.distortion)
    return view.corners - np.asarray(seen, dtype=np.float64).reshape(-1, 2)


def rms_px(residuals: FloatArray) -> float:
    """Root mean square length of residuals (n, 2)."""
    return float(np.sqrt((residuals**2).sum(axis=1).mean()))
