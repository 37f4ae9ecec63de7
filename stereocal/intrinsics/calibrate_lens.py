"""Calibrate a camera's lens from photographs of a board: the paper's Section 5.

The lens is calibrated 50 times, each time from 20 of about 50 photographs drawn at random; each
parameter is the median of the 50 results.

**The spread of the 50 results is not the error of the median**: all draws come from the same
n = 50 photographs, and two draws of m = 20 share 8 on average. Each result leaves out d = n - m
photographs; the mean square deviation of such results from the result of all photographs, times
m / d, estimates the variance of the latter (delete-d jackknife: Shao & Wu 1989, Annals of
Statistics 17, 1176). With 20 of 50 the spread is sqrt(30 / 20) = 1.2 times the standard error,
with 20 of 30 it is 0.7 times, and with 20 of 21 only 0.2 times. `standard_errors` adds to the
jackknife the part due to the finite number of draws (measured in benchmarks/README.md, "Lens").
Errors common to all photographs are not covered: a board that is not flat, or a lens that five
coefficients do not describe.
"""

import hashlib
from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from stereocal.errors import StereocalError
from stereocal.intrinsics.boards import BoardSearch, BoardView
from stereocal.intrinsics.fisheye_fit import CRITERIA, UNDETERMINED, fit_fisheye
from stereocal.rig.camera import (
    FISHEYE_UNKNOWNS,
    LENS_MODELS,
    LENS_UNKNOWNS,
    Camera,
    LensModel,
    LensUncertainty,
)
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.settings import Settings, described
from stereocal.system.tasks import Progress, Task, run_tasks

PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
"""For the usual lens; a fisheye has `FISHEYE_UNKNOWNS`, and a ninth that is not used."""
RECOMMENDED_VIEWS = 50
FEWEST_VIEWS = 8
"""Photographs below which draws are not made smaller unasked."""
MINIMUM_VIEWS = 3
"""Two photographs give four equations for the four parameters of K, and nothing to check them."""
SMALLEST_BOARD = 4
OUTLYING = 2.0
"""A photograph is an outlier if its error exceeds this multiple of the median."""
CHUNK = 5
SHRUNK = 0.02
"""Share of the identity in the correlation."""
MEDIAN_OVER_MEAN = np.pi / 2
"""Variance of the median of normally distributed numbers over that of their mean."""
SIGMA_TAIL = 15.8655
"""Percent below one standard deviation under the mean of a normal distribution."""


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
        0,
        "Seed",
        "Source of the random numbers: the same seed gives the same file.",
        between=(0, 2**63 - 1),
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
        """(9,): 1 for a parameter that is fitted, 0 for one that is held at 0 or not used."""
        if self.model == "fisheye":
            return np.array([1.0] * 8 + [0.0])
        tangential = float(not self.zero_tangential)
        return np.array([1.0] * 6 + [tangential, tangential, float(not self.fix_k3)])


@dataclass(frozen=True, eq=False)
class LensCalibration:
    """The results of all draws, and the lens calculated from them."""

    search: BoardSearch
    settings: LensSettings
    drawn: IntArray
    """(repeats, subset): indices of the views of each draw."""
    draws: FloatArray
    """(repeats, 9): `PARAMETERS` of each draw."""
    of_all: FloatArray
    """(9,): `PARAMETERS` from all photographs at once."""
    without: FloatArray | None = None
    """(views, 9): without each of the photographs; None if not asked for."""

    @cached_property
    def values(self) -> FloatArray:
        """(9,): the medians, as in the paper; of a fisheye those of all photographs at once.

        k1 to k4 are so correlated that the medians of each do not belong together: at 150 degrees
        they erred by 1.4 % more on held-out boards.
        """
        if self.settings.model == "fisheye":
            return self.of_all
        return np.asarray(np.median(self.draws, axis=0))

    @property
    def per_draw(self) -> int:
        """Photographs of each draw."""
        return int(self.drawn.shape[1])

    @cached_property
    def spread(self) -> FloatArray:
        """(9,): half the width of the interval with the middle 68 % of the draws."""
        low, high = np.percentile(self.draws, (SIGMA_TAIL, 100 - SIGMA_TAIL), axis=0)
        return np.asarray(0.5 * (high - low))

    @cached_property
    def standard_errors(self) -> FloatArray:
        """(9,): standard errors of `values`, by the delete-d jackknife (see the module)."""
        views, repeats = len(self.search.views), len(self.drawn)
        variance = self.spread**2
        jackknife = self.per_draw / (views - self.per_draw) * variance
        return np.asarray(np.sqrt(jackknife + MEDIAN_OVER_MEAN * variance / repeats))

    @cached_property
    def correlation(self) -> FloatArray:
        """(8, 8): correlation of the errors of `LENS_UNKNOWNS`, that of the draws.

        Shrunk by 2 % so that it can be inverted: fewer than 9 draws determine no full matrix.
        """
        known = self.draws[:, : len(LENS_UNKNOWNS)]
        scale = known.std(axis=0)
        found = np.eye(len(LENS_UNKNOWNS))
        free = np.flatnonzero(scale > 0)
        if len(free) > 1:
            among = np.corrcoef(known[:, free], rowvar=False)
            found[np.ix_(free, free)] = (1 - SHRUNK) * among + SHRUNK * np.eye(len(free))
        return found

    @cached_property
    def camera(self) -> Camera:
        """The camera with `values` and their standard errors."""
        sigma = self.standard_errors[: len(self.settings.parameters)]
        without = dict[str, FloatArray]()
        if self.without is not None:
            changes = (self.without - self.of_all)[:, : len(LENS_UNKNOWNS)]
            without = {v.name: row for v, row in zip(self.search.views, changes, strict=True)}
        fx, fy, cx, cy = sigma[:4].tolist()
        uncertainty = LensUncertainty(fx, fy, cx, cy, sigma[4:], self.correlation, without)
        lens = _camera(self.values, self.search.image_size, self.settings.model)
        return replace(lens, uncertainty=uncertainty)

    @cached_property
    def residuals(self) -> list[FloatArray]:
        """For each view (n, 2): found minus projected corners, px, with the best-fit pose."""
        return [_residuals(self.camera, self.search.pattern, view) for view in self.search.views]

    @cached_property
    def view_errors(self) -> FloatArray:
        """(views,): root mean square reprojection error of each view, px."""
        return np.array([_rms(found) for found in self.residuals])

    @property
    def error_px(self) -> float:
        """Root mean square reprojection error of all corners."""
        return _rms(np.concatenate(self.residuals))

    @property
    def outlying(self) -> list[str]:
        """Photographs whose error is more than `OUTLYING` times the median of all."""
        far = self.view_errors > OUTLYING * np.median(self.view_errors)
        return [self.search.views[at].name for at in np.flatnonzero(far)]


def _rms(residuals: FloatArray) -> float:
    return float(np.sqrt((residuals**2).sum(axis=1).mean()))


def calibrate_lens(
    search: BoardSearch,
    settings: LensSettings,
    executor: Executor,
    progress: Progress | None = None,
    without_each: bool = False,
) -> LensCalibration:
    """Calibrate all draws on any executor; the result depends on the settings only.

    Args:
        progress: called with the number of draws done and the total.
        without_each: whether to calibrate without each of the photographs too.
    """
    views = search.views
    size = _draw_size(search, settings)
    draws = (np.random.default_rng([settings.seed, each]) for each in range(settings.repeats))
    drawn = np.array([np.sort(rng.choice(len(views), size, False)) for rng in draws])
    every, total = np.arange(len(views))[None], settings.repeats
    chunks = [every, *(drawn[at : at + CHUNK] for at in range(0, total, CHUNK))]
    if without_each:
        chunks += [np.delete(every, at, axis=1) for at in range(len(views))]
        total += len(views)
    own = replace(search, refused=())
    # Every draw would try all starts, or two neighbouring ones might end in different lenses.
    start = _started(search, settings) if settings.model == "fisheye" else None
    given = own, settings, start
    tasks = (
        Task(solve_draws, (*given, chunk), len(chunk) * (number > 0))
        for number, chunk in enumerate(chunks)
    )
    with closing(run_tasks(tasks, executor, total, progress)) as finished:
        found = np.vstack([part for _, part in finished])
    used, without = np.split(found, [1 + settings.repeats])
    if not np.isfinite(used).all() or used[:, :2].min() <= 0:
        raise StereocalError(UNDETERMINED)
    others = without if without_each else None
    return LensCalibration(search, settings, drawn, used[1:], used[0], others)


def digest_of_draws(search: BoardSearch, settings: LensSettings) -> str:
    """Digest of all that a draw depends on, except its number."""
    digest = hashlib.sha256(repr((search.pattern, search.image_size, settings)).encode())
    for view in search.views:
        digest.update(view.ids.astype(np.int64).tobytes() + view.corners.tobytes())
    return digest.hexdigest()[:32]


def solve_draws(
    search: BoardSearch, settings: LensSettings, start: FloatArray | None, drawn: IntArray
) -> FloatArray:
    """(draws, 9): `PARAMETERS` of some draws; the task of an executor.

    Args:
        start: as for `solve_lens`.
    """
    pattern, size = search.pattern, search.image_size
    of_draws = ([search.views[at] for at in draw] for draw in drawn)
    return np.array([solve_lens(pattern, views, size, settings, start) for views in of_draws])


def _started(search: BoardSearch, settings: LensSettings) -> FloatArray:
    """(9,): `PARAMETERS` of a fisheye from boards that are spread over the photographs."""
    few = search.views[:: max(1, len(search.views) // settings.subset)]
    return solve_lens(search.pattern, few, search.image_size, settings)


def solve_lens(
    pattern: BoardPattern,
    views: Sequence[BoardView],
    image_size: tuple[int, int],
    settings: LensSettings,
    start: FloatArray | None = None,
) -> FloatArray:
    """(9,): `PARAMETERS` by OpenCV's `calibrateCamera` (Zhang 2000) or `fisheye.calibrate`.

    20 views of 216 corners take 0.02 to 0.03 s; an initial guess would save a third of that.

    Args:
        start: (9,): `PARAMETERS` from which a fisheye is fitted; None: the best from `STARTS`.
    """
    if cv2.getNumThreads() > 1:
        # The executor uses all cores. Multithreaded, OpenCV is not reproducible: 14 different
        # results in 20 runs, 1e-9 apart.
        cv2.setNumThreads(1)
    kind = "f8" if settings.model == "fisheye" else "f4"
    boards = (
        [pattern.points[view.ids].astype(kind)[None] for view in views],
        [view.corners.astype(kind)[None] for view in views],
        image_size,
    )
    if settings.model == "fisheye":
        return fit_fisheye(boards, start)
    flags = cv2.CALIB_FIX_K3 * settings.fix_k3
    flags += cv2.CALIB_ZERO_TANGENT_DIST * settings.zero_tangential
    try:
        _, K, distortion, *_ = cv2.calibrateCamera(
            *boards, np.eye(3), np.zeros(5), flags=flags, criteria=CRITERIA
        )
    except cv2.error as error:
        raise StereocalError(UNDETERMINED) from error
    return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *np.ravel(distortion)[:5]])


def held_out_px(search: BoardSearch, settings: LensSettings) -> dict[LensModel, float]:
    """Error of each lens model on boards that it was not fitted to, root mean square px.

    Every second board is fitted and the others tested, and the reverse; only the pose of a board
    is fitted to its own corners. NaN for a model that the boards do not determine.
    """
    found: dict[LensModel, float] = {}
    for model in LENS_MODELS:
        own, errors = replace(settings, model=model), []
        for fitted, tested in ((0, 1), (1, 0)):
            try:
                values = solve_lens(search.pattern, search.views[fitted::2], search.image_size, own)
                camera = _camera(values, search.image_size, model)
            except StereocalError:
                errors.append(np.full((1, 2), np.nan))
                continue
            errors += [_residuals(camera, search.pattern, v) for v in search.views[tested::2]]
        found[model] = _rms(np.concatenate(errors))
    return found


def _draw_size(search: BoardSearch, settings: LensSettings) -> int:
    """Photographs per draw: as set, or two thirds of those with a board if there are no more.

    With two thirds of 8 boards, true errors over stated ones had an RMS of 1.02 for 40 simulated
    lenses of 50 mm; with draws of all but one it was 1.23.
    """
    views = len(search.views)
    if views > settings.subset:
        return settings.subset
    if views >= FEWEST_VIEWS:
        return 2 * views // 3
    photographs = views + len(search.refused)
    of_all = f"{views} of {photographs}" if search.refused else str(views)
    there = "1 photograph" if photographs == 1 else f"{of_all} photographs"
    few = f" Or draw fewer than {views} each time." if views > MINIMUM_VIEWS else ""
    raise StereocalError(
        f"The board was found in {there}: at least {FEWEST_VIEWS} are needed; about "
        f"{RECOMMENDED_VIEWS} are recommended.{few}"
    )


def _camera(values: FloatArray, image_size: tuple[int, int], model: LensModel) -> Camera:
    fx, fy, cx, cy = values[:4]
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return Camera(K, values[4:8] if model == "fisheye" else values[4:], image_size, model=model)


def board_pose(camera: Camera, pattern: BoardPattern, view: BoardView) -> FloatArray | None:
    """(6,): rotation vector and position (`camera_from_board`) of a board, not yet refined.

    None if its corners do not determine it.
    """
    points, corners, K, distortion = pattern.points[view.ids], view.corners, camera.K, np.empty(0)
    if camera.is_fisheye:
        corners, K = camera.undistort(corners), np.eye(3)
        known = np.isfinite(corners).all(axis=1)
        points, corners = points[known], corners[known]
    else:
        distortion = camera.distortion
    if len(points) < SMALLEST_BOARD:
        return None
    found, turn, shift = cv2.solvePnP(points, corners, K, distortion)
    return np.concatenate([turn, shift]).ravel() if found else None


def _residuals(camera: Camera, pattern: BoardPattern, view: BoardView) -> FloatArray:
    """Found minus projected corners (n, 2), px, with the best-fit pose of the board."""
    points, pose = pattern.points[view.ids], board_pose(camera, pattern, view)
    if pose is None:
        return np.full((len(points), 2), np.nan)
    project = cv2.fisheye.projectPoints if camera.is_fisheye else cv2.projectPoints

    def residuals(pose: FloatArray) -> FloatArray:
        seen, _ = project(points[:, None], pose[:3], pose[3:], camera.K, camera.distortion)
        return view.corners.ravel() - np.asarray(seen, dtype=np.float64).ravel()

    if camera.is_fisheye:  # which `solvePnPRefineLM` does not know
        from scipy.optimize import least_squares  # takes 0.3 s, which every worker would wait for

        pose = np.asarray(least_squares(residuals, pose, method="lm").x)
    else:
        turn, shift = np.split(pose[:, None], 2)
        refined = cv2.solvePnPRefineLM(
            points, view.corners, camera.K, camera.distortion, turn, shift
        )
        pose = np.concatenate(refined, dtype=np.float64).ravel()
    return residuals(pose).reshape(-1, 2)
