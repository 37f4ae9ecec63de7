"""Calibrate a camera's lens from photographs of a board: the paper's Section 5.

The lens is calibrated 50 times, each time from 20 of about 50 photographs drawn at random; each
parameter is the median of the 50 results.

**The spread of the 50 results is not the error of the median**: all draws come from the same
n = 50 photographs, and two draws of m = 20 share 8 on average. Each result leaves out d = n - m
photographs; the mean square deviation of such results from the result of all photographs, times
m / d, estimates the variance of the latter (delete-d jackknife: Shao & Wu 1989, Annals of
Statistics 17, 1176). With 20 of 50 the spread is sqrt(30 / 20) = 1.2 times the standard error,
with 20 of 30 it is 0.7 times, and with 20 of 21 only 0.2 times. `standard_errors` adds to the
jackknife the part due to the finite number of draws (tests/intrinsics/test_intrinsics.py measures).
Errors common to all photographs are not covered: a board that is not flat, or a lens that five
coefficients do not describe.
"""

import hashlib
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stereocal.errors import StereocalError
from stereocal.intrinsics.boards import BoardSearch
from stereocal.intrinsics.fisheye_fit import lens_information, lenses_without_each
from stereocal.intrinsics.lens_fit import (
    FEWEST_VIEWS,
    MINIMUM_VIEWS,
    LensSettings,
    boards_of,
    camera_of,
    errors_of_usual_lens,
    residuals_of,
    rms_px,
    solve_lens,
    undetermined,
)
from stereocal.rig.camera import LENS_UNKNOWNS, Camera, LensUncertainty
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.tasks import Progress, Task, run_tasks

RECOMMENDED_VIEWS = 50
OUTLYING = 2.0
"""A photograph is an outlier if its error exceeds this multiple of the median."""
CHUNK = 5
MEDIAN_CHI2_8 = 7.344
"""Median of chi-square with 8 degrees of freedom."""
SHRUNK = 0.02
"""Share of the identity in the correlation."""
MEDIAN_OVER_MEAN = np.pi / 2
"""Variance of the median of normally distributed numbers over that of their mean."""
SIGMA_TAIL = 15.8655
"""Percent below one standard deviation under the mean of a normal distribution."""


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
        if self.settings.model == "fisheye":
            return np.append(np.sqrt(np.diag(self._covariance)), 0.0)
        views, repeats = len(self.search.views), len(self.drawn)
        variance = self.spread**2
        jackknife = self.per_draw / (views - self.per_draw) * variance
        sigma = np.asarray(np.sqrt(jackknife + MEDIAN_OVER_MEAN * variance / repeats))
        if views >= FEWEST_VIEWS:
            return sigma
        search = self.search
        least = errors_of_usual_lens(search.pattern, search.views, search.image_size, self.settings)
        return np.asarray(np.maximum(sigma, least))

    @cached_property
    def correlation(self) -> FloatArray:
        """(8, 8): correlation of the errors of `LENS_UNKNOWNS`, that of the draws.

        Shrunk by 2 % so that it can be inverted: fewer than 9 draws determine no full matrix.
        """
        if self.settings.model == "fisheye":
            sigma = self.standard_errors[: len(LENS_UNKNOWNS)]
            return np.asarray(self._covariance / np.outer(sigma, sigma))
        known = self.draws[:, : len(LENS_UNKNOWNS)]
        scale = known.std(axis=0)
        correlation = np.eye(len(LENS_UNKNOWNS))
        free = np.flatnonzero(scale > 0)
        if len(free) > 1:
            among = np.corrcoef(known[:, free], rowvar=False)
            correlation[np.ix_(free, free)] = (1 - SHRUNK) * among + SHRUNK * np.eye(len(free))
        return correlation

    @cached_property
    def _covariance(self) -> FloatArray:
        """(8, 8): of the errors of a fisheye: that of the least squares, scaled to how much the
        draws differ by the jackknife.

        k1 to k4 cancel each other at all angles where there are corners, which a correlation of few
        draws, shrunk, does not say: of 40 lenses it stated 2.2 times the true shift at 70 degrees
        (rms of errors over stated ones 0.59; with this 1.04).
        """
        unknowns = len(LENS_UNKNOWNS)
        boards = boards_of(self.search.pattern, self.search.views)
        information = lens_information(boards, self.of_all[:unknowns])[0].sum(axis=0)
        scale = np.sqrt(np.diag(information))
        covariance = np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
        apart = self.draws[:, :unknowns] - self.of_all[:unknowns]
        excess = np.einsum("ni,ij,nj->n", apart, information, apart)
        jackknife = self.per_draw / (len(self.search.views) - self.per_draw)
        factor = jackknife * float(np.median(excess)) / MEDIAN_CHI2_8
        return np.asarray(factor * covariance)

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
        lens = camera_of(self.values, self.search.image_size, self.settings.model)
        return replace(lens, uncertainty=uncertainty)

    @cached_property
    def residuals(self) -> list[FloatArray]:
        """For each view (n, 2): found minus projected corners, px, with the best-fit pose."""
        return [residuals_of(self.camera, self.search.pattern, view) for view in self.search.views]

    @cached_property
    def view_errors(self) -> FloatArray:
        """(views,): root mean square reprojection error of each view, px."""
        return np.array([rms_px(residuals) for residuals in self.residuals])

    @property
    def error_px(self) -> float:
        """Root mean square reprojection error of all corners."""
        return rms_px(np.concatenate(self.residuals))

    @property
    def outlying(self) -> list[str]:
        """Photographs whose error is more than `OUTLYING` times the median of all."""
        far = self.view_errors > OUTLYING * np.median(self.view_errors)
        return [self.search.views[k].name for k in np.flatnonzero(far)]


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
    draws = (np.random.default_rng([settings.seed, number]) for number in range(settings.repeats))
    drawn = np.array([np.sort(rng.choice(len(views), size, False)) for rng in draws])
    every, total = np.arange(len(views))[None], settings.repeats
    chunks = [every, *(drawn[first : first + CHUNK] for first in range(0, total, CHUNK))]
    fisheye = settings.model == "fisheye"
    if without_each and not fisheye:
        chunks += [np.delete(every, k, axis=1) for k in range(len(views))]
        total += len(views)
    searched = replace(search, refused=())
    # Every draw would try all starts, or two neighbouring ones might end in different lenses.
    start = _started(search, settings) if fisheye else None
    tasks = (
        Task(solve_draws, (searched, settings, start, chunk), len(chunk) * (number > 0))
        for number, chunk in enumerate(chunks)
    )
    with closing(run_tasks(tasks, executor, total, progress)) as finished:
        lenses = np.vstack([part for _, part in finished])
    used, without = np.split(lenses, [1 + settings.repeats])
    if not np.isfinite(used).all() or used[:, :2].min() <= 0:
        raise undetermined(search, settings)
    others = without if without_each else None
    if without_each and fisheye:
        boards = boards_of(search.pattern, views)
        others = np.pad(
            lenses_without_each(boards, used[0, : len(LENS_UNKNOWNS)]), ((0, 0), (0, 1))
        )
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
    of_draws = ([search.views[k] for k in draw] for draw in drawn)
    return np.array([solve_lens(pattern, views, size, settings, start) for views in of_draws])


def _started(search: BoardSearch, settings: LensSettings) -> FloatArray:
    """(9,): `PARAMETERS` of a fisheye from boards that are spread over the photographs."""
    few = search.views[:: max(1, len(search.views) // settings.subset)]
    return solve_lens(search.pattern, few, search.image_size, settings)


def _draw_size(search: BoardSearch, settings: LensSettings) -> int:
    """Photographs per draw: as set, or two thirds of those with a board if there are no more.

    With two thirds of 8 boards, true errors over stated ones had an RMS of 1.02 for 40 simulated
    lenses of 50 mm; with draws of all but one it was 1.23.
    """
    views = len(search.views)
    if views > settings.subset:
        return settings.subset
    if views > MINIMUM_VIEWS:
        return max(MINIMUM_VIEWS, 2 * views // 3)
    photographs = views + len(search.refused)
    of_all = f"{views} of {photographs}" if search.refused else str(views)
    there = "1 photograph" if photographs == 1 else f"{of_all} photographs"
    raise StereocalError(
        f"The board was found in {there}: at least {MINIMUM_VIEWS + 1} are needed; about "
        f"{RECOMMENDED_VIEWS} are recommended."
    )
