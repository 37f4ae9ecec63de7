"""The unknowns of the refined method, their priors, and its settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np

from stereocal.errors import StereocalError
from stereocal.refined.bar_fit import BAR, BASELINE, EPSILON, PRIMARY, SECONDARY, SHARED
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Pose

DEFAULT_FOCAL = 0.01
DEFAULT_CENTRE_PX = 10.0
DEFAULT_BASELINE = 0.01
"""As a fraction of the baseline, which is measured between housings but ends inside the lenses."""
DEFAULT_DISTANCE = 0.001
"""As a fraction of the bar: half a millimetre on half a metre."""

ANGLES = ("yaw", "pitch", "roll", "delta", "epsilon")


@dataclass(frozen=True)
class LensPrior:
    """Standard deviations of the prior of a lens; 0 holds a value fixed, infinity means no prior.

    Raises:
        StereocalError: a negative number or NaN.
    """

    focal: float = DEFAULT_FOCAL
    """Standard deviation of the focal length, as a fraction of it."""
    centre_px: float = DEFAULT_CENTRE_PX
    """Standard deviation of each coordinate of the principal point, in pixels."""
    apart: bool = False
    """Whether fx and fy vary separately; otherwise they share one factor."""

    def __post_init__(self) -> None:
        if not (self.focal >= 0 and self.centre_px >= 0):
            raise StereocalError("The uncertainty of a lens must be 0 (fixed) or more.")


FIXED_LENS = LensPrior(0.0, 0.0)


@dataclass(frozen=True)
class RefineSettings:
    """Settings of the refined method. An uncertainty of 0 holds the value fixed.

    Raises:
        StereocalError: a negative number, NaN, or an unknown loss.
    """

    primary: LensPrior | None = None
    """None: the camera's own uncertainty if it has one, else 1 % and 10 px."""
    secondary: LensPrior | None = None
    baseline_sigma_m: float | None = None
    """None: the data set's value if it has one, else 1 % of the baseline."""
    distance_sigma_m: float | None = None
    """Standard deviation of the measured bar length, common to all frames. None: the data set's
    value if it has one, else 0.1 %."""
    sigma_px: float | None = None
    """Noise of an image coordinate. None: estimated from the residuals."""
    scatter_m: float | None = None
    """Scatter of the bar's length from frame to frame. None: estimated from the residuals."""
    loss: Literal["robust", "squares"] = "robust"
    """`squares` uses every frame with full weight."""
    maximum_steps: int = 60
    """Maximum number of steps of each solve."""

    def __post_init__(self) -> None:
        for name in ("baseline_sigma_m", "distance_sigma_m", "scatter_m", "sigma_px"):
            value = getattr(self, name)
            if value is not None and not value >= 0:
                raise StereocalError(f"{name} is {value}: it must be 0 or more.")
        if self.sigma_px == 0:
            raise StereocalError("sigma_px is 0: it must be above 0.")
        if self.loss not in ("robust", "squares"):
            raise StereocalError(f'The loss "{self.loss}" is unknown: robust or squares.')
        if self.maximum_steps < 1:
            raise StereocalError("maximum_steps must be at least 1.")

    def to_json(self) -> dict[str, Any]:
        """All settings; infinity is written as the string "inf", since JSON has no infinity."""
        settings: dict[str, Any] = _without_infinity(asdict(self))
        return settings

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> RefineSettings:
        """The settings that `to_json` describes; missing ones keep their defaults.

        Raises:
            StereocalError: an unknown setting, or a value of the wrong type or out of range.
        """
        given = {name: _number(value) for name, value in data.items()}
        for lens in CAMERAS:
            if isinstance(own := given.get(lens), Mapping):
                numbers = {name: _number(value) for name, value in own.items()}
                given[lens] = LensPrior(**numbers)
        try:
            return cls(**given)
        except TypeError as error:
            raise StereocalError(f"The settings cannot be read: {error}.") from error


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The free parameters p of a solve and the 15 shared unknowns q = origin + M p."""

    names: tuple[str, ...]
    origin: FloatArray
    """(15,): the initial angles, and the stated values of the others."""
    M: FloatArray
    """(15, k)."""
    sigma: FloatArray
    """(k,): standard deviations of the priors of p; infinite without a prior."""

    @property
    def precision(self) -> FloatArray:
        """(k,): 1 / sigma^2."""
        return 1.0 / np.square(self.sigma)


def unknowns_of(
    dataset: Dataset, start: Pose, settings: RefineSettings, bars: bool = True
) -> Unknowns:
    """The unknowns of a data set.

    Args:
        bars: whether there are bars; if not, the bar's length is held fixed.

    Raises:
        StereocalError: neither baseline nor bar has a prior, so nothing determines the scale.
    """
    origin = np.empty(SHARED)
    origin[: EPSILON + 1] = start.angles
    origin[BASELINE], origin[BAR] = dataset.baseline_m, 1.0
    for at, camera in ((PRIMARY, dataset.primary), (SECONDARY, dataset.secondary)):
        origin[at : at + 4] = _lens(camera)
    baseline = baseline_sigma_m(dataset, settings)
    bar = distance_sigma_m(dataset, settings) / dataset.target_distance_m if bars else 0.0
    if np.isinf(baseline) and (np.isinf(bar) or not bars):
        raise StereocalError(
            "Nothing fixes the scale: give the baseline or the bar a finite uncertainty."
        )
    columns: list[tuple[str, float, FloatArray]] = [
        (name, np.inf, _unit(i)) for i, name in enumerate(ANGLES)
    ]
    columns += [("baseline", baseline, _unit(BASELINE)), ("bar", bar, _unit(BAR))]
    for name, at, prior in (
        ("primary", PRIMARY, lens_prior(dataset.primary, settings.primary)),
        ("secondary", SECONDARY, lens_prior(dataset.secondary, settings.secondary)),
    ):
        along_x, along_y = origin[at] * _unit(at), origin[at + 1] * _unit(at + 1)
        if prior.apart:
            columns += [
                (f"{name} fx", prior.focal, along_x),
                (f"{name} fy", prior.focal, along_y),
            ]
        else:
            columns.append((f"{name} focal", prior.focal, along_x + along_y))
        columns += [
            (f"{name} cx", prior.centre_px, _unit(at + 2)),
            (f"{name} cy", prior.centre_px, _unit(at + 3)),
        ]
    free = [column for column in columns if column[1] > 0]
    return Unknowns(
        names=tuple(name for name, _, _ in free),
        origin=origin,
        M=np.ascontiguousarray(np.column_stack([along for _, _, along in free])),
        sigma=np.array([sigma for _, sigma, _ in free]),
    )


def lens_prior(camera: Camera, given: LensPrior | None) -> LensPrior:
    """The prior of a lens: `given`, else from the camera's uncertainty, else the default.

    The camera's uncertainty has standard errors of fx, fy, cx and cy. The prior uses the root mean
    square of the relative errors of fx and fy, and the larger error of cx and cy.
    """
    if given is not None:
        return given
    known = camera.uncertainty
    if known is None:
        return LensPrior()
    relative = np.array([known.fx / camera.K[0, 0], known.fy / camera.K[1, 1]])
    return LensPrior(float(np.sqrt(np.mean(relative**2))), max(known.cx, known.cy))


def with_lens_priors(settings: RefineSettings, dataset: Dataset) -> RefineSettings:
    """The same settings with explicit priors of both lenses."""
    return replace(
        settings,
        primary=lens_prior(dataset.primary, settings.primary),
        secondary=lens_prior(dataset.secondary, settings.secondary),
    )


def baseline_sigma_m(dataset: Dataset, settings: RefineSettings) -> float:
    """Standard deviation of the measured baseline, with the defaults of `RefineSettings`."""
    return _first(
        settings.baseline_sigma_m, dataset.baseline_sigma_m, DEFAULT_BASELINE * dataset.baseline_m
    )


def distance_sigma_m(dataset: Dataset, settings: RefineSettings) -> float:
    """Standard deviation of the measured bar, with the defaults of `RefineSettings`."""
    return _first(
        settings.distance_sigma_m,
        dataset.target_distance_sigma_m,
        DEFAULT_DISTANCE * dataset.target_distance_m,
    )


def camera_of(stated: Camera, lens: FloatArray) -> Camera:
    """The stated camera with `lens`, (fx, fy, cx, cy), instead of its own."""
    K = stated.K.copy()
    K[0, 0], K[1, 1], K[0, 2], K[1, 2] = lens
    return Camera(K, stated.distortion, stated.image_size)


def _lens(camera: Camera) -> FloatArray:
    K = camera.K
    return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]])


def _unit(at: int) -> FloatArray:
    unit = np.zeros(SHARED)
    unit[at] = 1.0
    return unit


def _first(*values: float | None) -> float:
    return next(value for value in values if value is not None)


def _number(value: Any) -> Any:
    return np.inf if value == "inf" else value


def _without_infinity(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_infinity(inner) for key, inner in value.items()}
    return "inf" if isinstance(value, float) and np.isinf(value) else value
