"""The unknowns of the refined method, their priors, and its settings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, Self

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.errors import StereocalError
from stereocal.fit.least_squares.small_steps import (
    FACTOR,
    OF_PAIR,
    OF_PAIR_BEHIND_WINDOWS,
    lens_places,
)
from stereocal.fit.least_squares.stated_windows import cameras_of, window_blocks
from stereocal.fit.least_squares.views import DRIFT, EACH, LENS, TIME, TRANSLATION
from stereocal.rig.camera import CAMERAS, LENS_UNKNOWNS, Camera, camera_in_words
from stereocal.rig.geometry import Pose
from stereocal.rig.measured_lengths import check_uncertainty
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording, labels_of
from stereocal.system.array_types import FloatArray
from stereocal.system.settings import Settings

DEFAULT_FOCAL = 0.01
DEFAULT_CENTRE_PX = 10.0
DEFAULT_BASELINE = 0.01
"""As a fraction of the baseline, which is measured between housings but ends inside the lenses."""
DEFAULT_DISTANCE = 0.001
"""As a fraction of the bar: half a millimetre on half a metre."""

HELD_BASELINE = 1e-5
"""Of a baseline that is held: its uncertainty as a fraction of it, far below what any rig can use.
T is on a sphere then, and steps along a thinner one are too short to arrive: with 1e-7 15 of 25
rigs had not after 60 steps, with 1e-5 all are where they are with 1e-6, to 0.02 standard errors."""
FIXED = 1e-10
"""A value with a smaller standard deviation is held fixed: far below what any of them can be known
to, and large enough that its inverse square is a number."""
SMALLEST_EIGENVALUE = 1e-13
"""Of the scaled normal equations: with a smaller one the errors of rounding are as large as the
equations, and the covariance has negative variances."""

WIDE_TIME, WIDE_DRIFT = 10.0, 0.1
"""Standard deviations of the time offset, in frames, and of its drift, that hardly restrict them;
they keep those finite about which the motion says nothing."""


@dataclass(frozen=True)
class LensPrior:
    """Standard deviations of the prior of a lens; 0 holds a value, infinity means no prior."""

    focal: float = DEFAULT_FOCAL
    """Standard deviation of the focal length, as a fraction of it."""
    centre_px: float = DEFAULT_CENTRE_PX
    """Standard deviation of each coordinate of the principal point, in pixels."""
    apart: bool = False
    """Whether fx and fy vary separately; otherwise they share one factor."""
    distortion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """Of k1, k2, p1 and p2; of a fisheye's k1, k2, k3 and k4."""
    correlation: tuple[tuple[float, ...], ...] | None = None
    """(8, 8), between fx, fy, cx, cy, k1, k2, p1, p2, used with `apart`; None if independent. That
    of a value that is fixed or has no prior is not used."""

    def __post_init__(self) -> None:
        if not all(sigma >= 0 for sigma in (self.focal, self.centre_px, *self.distortion)):
            raise StereocalError("The uncertainty of a lens must be 0 (fixed) or more.")


@dataclass(frozen=True)
class RigMarginal:
    """What a rig says of two of its cameras: no fit of their own images changes it."""

    turn: tuple[float, ...]
    """(3,): rotation vector of the second camera from the first."""
    q: tuple[float, ...]
    """(33,), with windows (43,): as of `views`, without turns."""
    covariance: tuple[tuple[float, ...], ...]
    """As many by as many."""
    design_effect: float

    def __post_init__(self) -> None:
        numbers = np.array([self.q, *self.covariance], dtype=np.float64)
        size = OF_PAIR if len(self.q) == OF_PAIR else OF_PAIR_BEHIND_WINDOWS
        whole = numbers.shape == (size + 1, size) and len(self.turn) == TRANSLATION
        if not (whole and np.isfinite(numbers).all() and np.isfinite(self.turn).all()):
            raise ValueError("what the rig says of its pair has other numbers")

    @property
    def pose(self) -> Pose:
        """`second_from_first`."""
        T = self.q[EACH + TRANSLATION : EACH + LENS]
        return Pose(Rotation.from_rotvec(self.turn).as_matrix(), np.array(T))


FIXED_LENS = LensPrior(0.0, 0.0)
FREE_DISTORTION = (0.5, 1.0, 0.02, 0.02)
"""Standard deviations of k1, k2, p1, p2 that hardly restrict them; they keep those finite about
which the images say nothing."""
FREE_FISHEYE = (0.3, 0.3, 0.3, 0.3)
"""The same of k1, k2, k3, k4 of a fisheye."""


@dataclass(frozen=True)
class RefineSettings(Settings):
    """Settings of the refined method. An uncertainty of 0 holds the value fixed."""

    lenses: Mapping[str, LensPrior] = field(default_factory=dict)
    """By camera (`Recording.labels`), of two by their names too. Others: the camera's own
    uncertainty if it has one, else 1 % and 10 px."""
    baseline_sigma_m: float | None = None
    """Of each measured baseline. None: the recording's value if it has one, else 1 % of it."""
    distance_sigma_m: float | None = None
    """Standard deviation of the length of the bar, of an object of its longest distance, common to
    all frames. None: the recording's value if it has one, else 0.1 %."""
    sigma_px: float | None = None
    """Noise of an image coordinate. None: estimated from the residuals."""
    scatter_m: float | None = None
    """Scatter of the bar's length from frame to frame. None: estimated from the residuals."""
    loss: Literal["robust", "squares"] = "robust"
    """`squares` uses every frame with full weight."""
    free_distortion: tuple[str, ...] = ()
    """Cameras whose k1, k2, p1 and p2 are estimated from the images, whatever is stated."""
    time_offset: bool = False
    """Whether the time offset of each camera but the first is an unknown, for points that have been
    shifted in time."""
    time_drift: bool = False
    """Whether its drift is one too."""
    maximum_steps: int = 60
    """Maximum number of steps of each solve."""

    of_rig: RigMarginal | None = None
    """Of a pair of a rig: its cameras as the rig has them, instead of the priors above."""

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
        """The settings, with the lenses under the labels of their cameras."""
        content = super().to_json()
        lenses = content.pop("lenses")
        return {**dict.fromkeys(CAMERAS), **lenses, **content}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """Settings of a file; earlier versions had `rest`, of a pair of a rig: it is made again."""
        known = {setting.name for setting in fields(cls)}
        lenses = {
            key: it for key, it in data.items() if key not in known and isinstance(it, Mapping)
        }
        rest = {key: it for key, it in data.items() if key not in (*lenses, *CAMERAS, "rest")}
        return super().from_json({"lenses": lenses, **rest})


Block = tuple[list[tuple[str, float, list[int]]], FloatArray | None]
"""Parameters with a common prior: of each its name, standard deviation and places in q, and their
correlation; None if independent."""


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The free parameters p of a solve and the unknowns of `views`, q = origin + M p."""

    names: tuple[str, ...]
    origin: FloatArray
    """(Q,): the first T of each camera, and the stated values of the others."""
    M: FloatArray
    """(Q, k)."""
    sigma: FloatArray
    """(k,): standard deviations of the priors of p; infinite without a prior."""
    precision: FloatArray
    """(k, k): inverse of the covariance of the priors of p; 0 without a prior."""

    def named(self, p: FloatArray) -> dict[str, float]:
        """The values p (k,) of the free parameters by name."""
        return dict(zip(self.names, p.tolist(), strict=True))

    def covariance(self, information: FloatArray) -> FloatArray:
        """(k, k): covariance of p, from the priors and the information (Q, Q) about q; NaN where
        nothing is known of one."""
        A = self.M.T @ information @ self.M + self.precision
        if not (np.diag(A) > 0.0).all():
            return np.full_like(A, np.nan)
        scale = 1.0 / np.sqrt(np.diag(A))  # the units differ by orders of magnitude
        return np.asarray(np.linalg.inv(A * np.outer(scale, scale)) * np.outer(scale, scale))

    def determined(self, information: FloatArray) -> bool:
        """Whether priors and information (Q, Q) determine all of p, in double precision."""
        A = self.M.T @ information @ self.M + self.precision
        diagonal = np.diag(A)
        if not (np.isfinite(A).all() and (diagonal > 0).all()):
            return False
        scale = 1.0 / np.sqrt(diagonal)
        return bool(np.linalg.eigvalsh(A * np.outer(scale, scale))[0] > SMALLEST_EIGENVALUE)

    def prior_covariance(self, columns: list[int]) -> FloatArray:
        """The covariance of the priors of some free parameters, which must all have one."""
        known = np.flatnonzero(np.isfinite(self.sigma))
        whole = np.linalg.inv(self.precision[np.ix_(known, known)])
        places = np.searchsorted(known, columns)
        return np.asarray(whole[np.ix_(places, places)])


def inverse_of(A: FloatArray, least: float = 1e-15) -> FloatArray:
    """(k, k): the inverse of a normal matrix whose units differ, in what it determines.

    Args:
        least: eigenvalue of the scaled matrix over the largest one; smaller ones are left out.
    """
    diagonal = np.diag(A)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    units = np.outer(scale, scale)
    return np.asarray(np.linalg.pinv(A * units, least, hermitian=True) * units)


def unknowns_of(
    recording: Recording, poses: Sequence[Pose], settings: RefineSettings, has_lengths: bool = True
) -> Unknowns:
    """The unknowns of a recording; the first camera is the reference and has no pose.

    Args:
        poses: `camera_from_reference` of each camera, where the fit begins.
        has_lengths: whether any length is known; if not, their factor is held fixed.
    """
    origin = cameras_of(recording, poses).q
    blocks: list[Block] = []
    focal_lengths: list[int] = []
    for number, (name, lens) in enumerate(lenses_of(recording, settings).items()):
        first, places = EACH * number, lens_places(number)
        focal_lengths += places[:2]
        if number:
            turns = [(f"{name} turn {axis}", np.inf, [first + i]) for i, axis in enumerate("xyz")]
            shifts = [
                (f"{name} {axis}", np.inf, [first + TRANSLATION + i])
                for i, axis in enumerate("xyz")
            ]
            blocks.append((turns + shifts, None))
        blocks.append(lens_block(name, lens, places))
        offset, drift = (bool(number) * it for it in (settings.time_offset, settings.time_drift))
        times = [
            (f"{name} time offset", WIDE_TIME * offset, [first + TIME]),
            (f"{name} time drift", WIDE_DRIFT * drift, [first + DRIFT]),
        ]
        blocks.append((times, None))
    blocks += [(columns, None) for columns in window_blocks(recording)]
    sigma, _ = length_sigma(recording, settings)
    blocks.append(([("object", sigma * has_lengths, [len(origin) + FACTOR])], None))
    return free_parameters(blocks, origin, focal_lengths)


def free_parameters(
    blocks: Sequence[Block], origin: FloatArray, focal_lengths: Sequence[int]
) -> Unknowns:
    """The free parameters among some unknowns.

    Args:
        blocks: all that may be free.
        origin: (Q,): the unknowns where the free parameters are 0.
        focal_lengths: places in q whose free parameters are fractions of their origin.
    """
    unit = np.ones(len(origin))
    unit[list(focal_lengths)] = origin[list(focal_lengths)]
    names: list[str] = []
    sigmas, along = [], []
    precision = np.zeros((len(origin), len(origin)))
    for columns, correlation in blocks:
        free = [i for i, (_, sigma, _) in enumerate(columns) if sigma > FIXED]
        for name, _, places in (columns[i] for i in free):
            names.append(name)
            along.append(np.zeros(len(origin)))
            along[-1][places] = unit[places]
        of_block = np.array([columns[i][1] for i in free])
        sigmas.append(of_block)
        known = np.flatnonzero(np.isfinite(of_block))
        if len(known):
            whole = np.eye(len(columns)) if correlation is None else correlation
            among = whole[np.ix_(free, free)][np.ix_(known, known)]
            rows = len(names) - len(free) + known
            spread = np.outer(of_block[known], of_block[known])
            precision[np.ix_(rows, rows)] = np.linalg.inv(among * spread)
    return Unknowns(
        names=tuple(names),
        origin=origin,
        M=np.ascontiguousarray(np.column_stack(along)),
        sigma=np.concatenate(sigmas),
        precision=precision[: len(names), : len(names)].copy(),
    )


def lens_block(name: str, prior: LensPrior, places: list[int]) -> Block:
    """The free parameters of a lens.

    Args:
        places: (8,): of `LENS_UNKNOWNS` in q.
    """
    if prior.apart:
        columns = [
            (f"{name} fx", prior.focal, [places[0]]),
            (f"{name} fy", prior.focal, [places[1]]),
        ]
    else:
        columns = [(f"{name} focal", prior.focal, places[:2])]
    sigmas = (prior.centre_px, prior.centre_px, *prior.distortion)
    columns += [
        (f"{name} {key}", sigma, [place])
        for key, sigma, place in zip(LENS_UNKNOWNS[2:], sigmas, places[2:], strict=True)
    ]
    whole = prior.correlation if prior.apart else None
    return columns, None if whole is None else np.array(whole)


def lens_prior(camera: Camera, given: LensPrior | None) -> LensPrior:
    """The prior of a lens: `given`, else from the camera's uncertainty, else the default.

    The camera's uncertainty has standard errors of fx, fy, cx, cy and the distortion, perhaps with
    their correlation. The prior uses the root mean square of the relative errors of fx and fy, and
    the larger error of cx and cy.
    """
    if given is not None:
        return given
    known = camera.uncertainty
    if known is None:
        return LensPrior()
    relative = np.array([known.fx / camera.K[0, 0], known.fy / camera.K[1, 1]])
    k1, k2, p1, p2 = [*known.distortion.tolist(), 0.0, 0.0, 0.0, 0.0][:4]
    whole = known.correlation
    return LensPrior(
        focal=float(np.sqrt(np.mean(relative**2))),
        centre_px=max(known.cx, known.cy),
        apart=whole is not None,
        distortion=(k1, k2, p1, p2),
        correlation=None if whole is None else tuple(tuple(row) for row in whole.tolist()),
    )


def check_named(settings: RefineSettings, recording: Recording) -> None:
    """Raise a `StereocalError` if settings name a camera that there is not."""
    known, there = {*recording.labels, *recording.cameras}, " and ".join(recording.labels)
    for what, named in (("lenses", settings.lenses), ("free_distortion", settings.free_distortion)):
        if unknown := [name for name in named if name not in known]:
            raise StereocalError(f"{what} names {camera_in_words(unknown[0])}: there are {there}.")


def settings_for(recording: Recording, settings: RefineSettings) -> RefineSettings:
    """The settings with what the recording says of its lenses and its timing.

    Raises:
        StereocalError: they name a camera that there is not.
    """
    check_named(settings, recording)
    known: dict[str, Any] = {"lenses": lenses_of(recording, settings)}
    if not recording.offsets:
        known |= {"time_offset": False, "time_drift": False}
    return replace(settings, **known)


def free_distortion(camera: Camera) -> tuple[float, float, float, float]:
    """Standard deviations that hardly restrict the first four coefficients of a lens."""
    return FREE_FISHEYE if camera.is_fisheye else FREE_DISTORTION


def lenses_of(recording: Recording, settings: RefineSettings) -> dict[str, LensPrior]:
    """The priors of the lenses, by camera (`Recording.labels`)."""
    stated = stated_lenses(recording, settings)
    cameras = zip(recording.labels, recording.cameras.items(), strict=True)
    return {label: lens_prior(camera, stated.get(name)) for label, (name, camera) in cameras}


def stated_lenses(recording: Recording, settings: RefineSettings) -> dict[str, LensPrior]:
    """Those of the settings, and those whose distortion is free, by the cameras' names."""
    priors: dict[str, LensPrior] = {}
    for label, (name, camera) in zip(recording.labels, recording.cameras.items(), strict=True):
        words = (label,) if name in recording.labels else (label, name)
        given = next((settings.lenses[word] for word in words if word in settings.lenses), None)
        if {*words} & {*settings.free_distortion}:
            given = replace(lens_prior(camera, given), distortion=free_distortion(camera))
        if given is not None:
            priors[name] = given
    return priors


def of_some(recording: Recording, settings: RefineSettings, names: Sequence[str]) -> RefineSettings:
    """The settings of a fit of some of the cameras."""
    stated, labelled = stated_lenses(recording, settings), zip(labels_of(names), names, strict=True)
    lenses = {label: stated[name] for label, name in labelled if name in stated}
    return replace(settings, lenses=lenses, free_distortion=())


def length_sigma(recording: Recording, settings: RefineSettings) -> tuple[float, bool]:
    """Standard deviation of the measured length, a fraction, and whether it was stated."""
    for stated in (settings.distance_sigma_m, recording.object.sigma_m):
        if stated is not None:
            return stated / recording.object.longest_m, True
    return DEFAULT_DISTANCE, False


def distance_sigma_m(recording: Recording, settings: RefineSettings) -> float:
    """The same in m."""
    held = recording.object
    return _first(settings.distance_sigma_m, held.sigma_m, DEFAULT_DISTANCE * held.longest_m)


def baseline_sigma_m(dataset: Pair, settings: RefineSettings) -> float:
    """Standard deviation of the measured baseline, with the defaults of `RefineSettings`."""
    return _first(
        settings.baseline_sigma_m, dataset.baseline_sigma_m, DEFAULT_BASELINE * dataset.baseline_m
    )


def measured_baselines(recording: Recording, settings: RefineSettings) -> FloatArray:
    """The measured baselines, as `adjustment.add_baselines` takes them; without those that are
    free. Those that are held have the uncertainty `HELD_BASELINE`."""
    numbers = {name: number for number, name in enumerate(recording.cameras)}
    stated, rows = (settings.baseline_sigma_m, recording.baseline_sigma_m), []
    for (first, second), length in recording.baselines_m.items():
        sigma = _first(*stated, DEFAULT_BASELINE * length)
        if np.isfinite(sigma):
            held = max(sigma, HELD_BASELINE * length)
            rows.append((numbers[first], numbers[second], length, held))
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def check_stated(settings: RefineSettings, recording: Recording) -> None:
    """Check the cameras that settings name, and the uncertainties of lengths; 0 and infinity may
    be.

    Raises:
        StereocalError: which camera there is not, or which uncertainty is impossible.
    """
    check_named(settings, recording)
    object_m = recording.object.longest_m
    for what, sigma, lengths in (
        ("baseline", settings.baseline_sigma_m, [*recording.baselines_m.values()]),
        ("distance between the targets", settings.distance_sigma_m, [object_m]),
    ):
        for length in lengths if sigma and np.isfinite(sigma) else ():
            check_uncertainty(what, sigma, length)


def _first(*values: float | None) -> float:
    return next(value for value in values if value is not None)
