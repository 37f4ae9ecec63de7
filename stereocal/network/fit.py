"""The joint adjustment of a rig: its unknowns, their priors, and the robust fit of N views."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from stereocal.refined.adjustment import add_baselines
from stereocal.refined.observations import Observations
from stereocal.refined.refine import RefinedResult
from stereocal.refined.robust import RobustFit
from stereocal.refined.two_views import unknowns_of_views, with_lens
from stereocal.refined.unknowns import (
    DEFAULT_BASELINE,
    DEFAULT_DISTANCE,
    WIDE_DRIFT,
    WIDE_TIME,
    Block,
    LensPrior,
    RefineSettings,
    Unknowns,
    free_parameters,
    lens_block,
    lens_prior,
)
from stereocal.refined.views import DISTORTION, DRIFT, EACH, LENS, TIME, TRANSLATION, Cameras
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import Recording
from stereocal.system.array_types import FloatArray


@dataclass(frozen=True)
class RigSettings:
    """What is stated of a rig's cameras and lengths, where the recording does not say it."""

    lenses: Mapping[str, LensPrior] = field(default_factory=dict)
    """By camera. Others: the camera's own uncertainty if it has one, else 1 % and 10 px."""
    baseline_sigma_m: float | None = None
    """None: the recording's, else 1 % of each."""
    object_sigma: float | None = None
    """Standard deviation of the object's lengths, as a fraction, common to all. None: the
    recording's, else 0.1 %."""
    time_offsets: bool | None = None
    """Whether each camera may be out of step by some frames; None: where that is significant."""
    time_drifts: bool = False
    """Whether these offsets drift."""


def lens_places(number: int) -> list[int]:
    """The places in q of the lens unknowns of a camera."""
    first, distortion = EACH * number + LENS, EACH * number + DISTORTION
    return [*range(first, first + 4), *range(distortion, distortion + 4)]


def unknowns_of_rig(
    recording: Recording, poses: Sequence[Pose], settings: RigSettings, bars: bool = True
) -> Unknowns:
    """The unknowns of a recording; the first camera is the reference and has no pose.

    Args:
        poses: `camera_from_reference` of each camera.
        bars: whether there are known lengths; if not, their factor is held fixed.
    """
    count = EACH * len(recording.cameras) + 1
    origin = np.zeros(count)
    origin[-1] = 1.0
    blocks: list[Block] = []
    focal_lengths: list[int] = []
    for number, (name, camera) in enumerate(recording.cameras.items()):
        first, places = EACH * number, lens_places(number)
        origin[first + TRANSLATION : first + LENS] = poses[number].T
        origin[places] = camera.lens_values
        focal_lengths += places[:2]
        if number:
            turns = [(f"{name} turn {axis}", np.inf, [first + i]) for i, axis in enumerate("xyz")]
            shifts = [
                (f"{name} {axis}", np.inf, [first + TRANSLATION + i])
                for i, axis in enumerate("xyz")
            ]
            blocks.append((turns + shifts, None))
        blocks.append(lens_block(name, lens_prior(camera, settings.lenses.get(name)), places))
        offset = WIDE_TIME * bool(settings.time_offsets and number > 0)
        drift = WIDE_DRIFT * bool(offset and settings.time_drifts)
        times = [
            (f"{name} time offset", offset, [first + TIME]),
            (f"{name} time drift", drift, [first + DRIFT]),
        ]
        blocks.append((times, None))
    sigma, _ = object_sigma(recording, settings)
    blocks.append(([("object", sigma * bars, [count - 1])], None))
    return free_parameters(blocks, origin, focal_lengths)


def object_sigma(recording: Recording, settings: RigSettings) -> tuple[float, bool]:
    """Standard deviation of the object's lengths, a fraction, and whether it was stated."""
    stated = recording.object.sigma_m
    if settings.object_sigma is not None:
        return settings.object_sigma, True
    if stated is not None:
        return stated / recording.object.longest_m, True
    return DEFAULT_DISTANCE, False


def baselines_of(recording: Recording, settings: RigSettings) -> FloatArray:
    """The measured baselines, as `adjustment.add_baselines` takes them."""
    numbers = {name: number for number, name in enumerate(recording.cameras)}
    stated = settings.baseline_sigma_m or recording.baseline_sigma_m
    rows = [
        (numbers[first], numbers[second], length, stated or DEFAULT_BASELINE * length)
        for (first, second), length in recording.baselines_m.items()
        if not np.isinf(stated or 0.0)
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def camera_at(stated: Camera, q: FloatArray, number: int) -> Camera:
    """The stated camera with the lens of q."""
    return with_lens(stated, q[lens_places(number)])


class RigFit(RobustFit):
    """A fit from first poses."""

    def __init__(
        self,
        recording: Recording,
        poses: Sequence[Pose],
        settings: RigSettings,
        motion: FloatArray | None = None,
        held: RefineSettings | None = None,
    ) -> None:
        """From first poses.

        Args:
            motion: (n, 3): as of `Observations.of_recording`, if known.
            held: with the noise that is not to be estimated.
        """
        self.recording, self.rig_settings = recording, settings
        seen = Observations.of_recording(recording, motion)
        unknowns = unknowns_of_rig(recording, poses, settings, seen.has_lengths)
        R, baselines = np.array([pose.R for pose in poses]), baselines_of(recording, settings)
        super().__init__(seen, unknowns, held or RefineSettings(), R, baselines)

    @property
    def cameras(self) -> Cameras:
        """As of `views`, with the stated distortion."""
        return self.views(self.q)[0]

    @property
    def poses(self) -> list[Pose]:
        """`camera_from_reference` of each camera."""
        T = self.q[:-1].reshape(-1, EACH)[:, 3:6]
        return [Pose(R, shift) for R, shift in zip(self.R, T, strict=True)]

    @property
    def information(self) -> FloatArray:
        """(Q, Q): of images, lengths and baselines, without the other priors."""
        H = self.H.copy()
        add_baselines(self.baselines, self.q, self.R, H, np.empty(len(H)))
        return H

    @property
    def is_determined(self) -> bool:
        """Whether all that was solved for is a number with an error."""
        return bool(np.isfinite(self.q).all()) and self.unknowns.determined(self.information)

    def end_at(self, pair: RefinedResult) -> None:
        """Take the refined set of a pair, where there are no other cameras."""
        q, self.R, _ = unknowns_of_views(pair.q)
        self.p = np.linalg.pinv(self.unknowns.M) @ (q - self.unknowns.origin)
        self.sigma_px, self.scatter = pair.sigma_px.value, pair.scatter_m.value
        self.outlying = np.isin(self.frames, pair.frames[pair.outlying])
        self.evaluate(np.where(self.outlying, 0.0, np.inf))
        self.cost, self.steps, self.converged = pair.cost, pair.steps, True
